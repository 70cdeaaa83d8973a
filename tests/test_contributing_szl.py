"""The recipe of CONTRIBUTING.md for a field of an SZL record, carried out on a copy of the tree: everything else follows it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

from tests.test_contributing import Tree, listed

LINK_FIELD: Final = """        Field("address_source", 1, "Where the IP address comes from.", codes=ADDRESS_SOURCES),
        Field("reserved", 1, "0."),
"""
LINK_FIELD_MADE: Final = """        Field("address_source", 1, "Where the IP address comes from.", codes=ADDRESS_SOURCES),
        Field("link_kind", 1, "What the interface is connected with.", codes=LINK_KINDS),
"""
LINK_TABLE: Final = """ADDRESS_SOURCES: Final = CodeTable("""
LINK_TABLE_MADE: Final = """LINK_KINDS: Final = CodeTable(
    "kind of link",
    1,
    [
        (0, "copper", ""),
        (1, "fibre", ""),
    ],
)

ADDRESS_SOURCES: Final = CodeTable("""
LINK_TEST: Final = """
def test_the_kind_of_link() -> None:
    (_, interface), told = cut(szl(0x0037, bytes(21) + b"\\1" + bytes(26)))
    assert told == []
    assert interface.text("link_kind") == "fibre"


def test_head_only() -> None:
"""
LINK_TRIED: Final = """
import json
from click.testing import CliRunner
from dissect.cli import show
from dissect.layers.part_classes import S7_SZLEthernet
from tests.protocols.s7 import test_szl
test_szl.test_the_kind_of_link()
def shown(*words):
    ran = CliRunner().invoke(show.command, [*words, "captures/crafted/coverage-szl.pcapng"], standalone_mode=False)
    assert ran.exception is None, ran.exception
    return ran.stdout
tree = [line.split()[1:] for line in shown("-V").splitlines() if "link_kind" in line]
lines = [line for line in shown("-T", "jsonl").splitlines() if '"name":"link_kind"' in line]
built = S7_SZLEthernet(link_kind="fibre")
print(json.dumps([tree, len(lines), bytes(built).hex(), S7_SZLEthernet(bytes(built)).link_kind]))
"""


def test_to_add_a_field_to_an_szl_record(tmp_path: Path) -> None:
    tree = Tree(tmp_path / "tree")
    records = "dissect/protocols/s7/szl_records.py"
    tree.replace(records, LINK_FIELD, LINK_FIELD_MADE)
    tree.replace(records, "    LED_STATES,\n    LEDS,\n", "    LED_STATES,\n    LEDS,\n    LINK_KINDS,\n")
    tree.replace("dissect/protocols/s7/szl_tables.py", LINK_TABLE, LINK_TABLE_MADE)
    tree.replace("tests/protocols/s7/test_szl.py", "\ndef test_head_only() -> None:\n", LINK_TEST)
    assert tree.touched() == listed("To add a field to an SZL record")
    shown, lines, built, link = json.loads(tree.python("-c", LINK_TRIED))
    assert shown
    assert all(words == ["link_kind", "0x00", "copper"] for words in shown)
    assert lines == 2
    assert (built, link) == (bytes(21).hex() + "01" + bytes(26).hex(), 1)
