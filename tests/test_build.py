"""The builder of the tests says what stands in the worked examples of the reference, and takes nothing from the package."""

from __future__ import annotations

import ast
from pathlib import Path

from tests import build


def test_it_takes_nothing_from_the_package() -> None:
    tree = ast.parse(Path(build.__file__).read_text("utf-8"))
    imported = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    imported |= {name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names}
    assert imported == {"__future__", "collections.abc", "struct", "typing"}


def test_a_setup_and_its_answer() -> None:
    asked = build.dt(build.pdu(build.JOB, 0x0400, build.setup_block(1, 1, 480)))
    assert asked.hex() == "0300001902f08032010000040000080000f0000001000101e0"
    told = build.pdu(build.ACK_DATA, 0x0400, build.setup_block(1, 1, 240))
    assert told.hex() == "320300000400000800000000f0000001000100f0"


def test_a_read_of_two_items_of_which_one_is_refused() -> None:
    items = [build.any_item(2, 3, 10, 0x84, 32), build.any_item(1, 1, 0, 0x83, 5)]
    asked = build.pdu(build.JOB, 1, bytes((build.READ, 2)) + b"".join(items))
    assert asked.hex() == "32010000000100" + "1a0000" + "0402" + "120a10020003000a84000020" + "120a10010001000083000005"
    data = build.joined([build.data_item(0xFF, 4, b"abc"), build.refused_item(5)])
    assert data.hex() == "ff040018" + "616263" + "00" + "05000000"
    assert build.data_item(0, 3, b"\x01").hex() == "00030001" + "01"
    assert build.data_item(0xFF, 9, b"abc").hex() == "ff090003" + "616263"


def test_userdata_short_and_extended() -> None:
    assert build.userdata_head(1, 4, 1).hex() == "0001120411440100"
    assert build.userdata_head(2, 4, 1, 3, unit=7, last=1, error=0xD402).hex() == "000112081284010307" + "01d402"
    assert build.payload(b"").hex() == "0a000000"
    assert build.payload(b"\x00\x11\x00\x00").hex() == "ff090004" + "00110000"
