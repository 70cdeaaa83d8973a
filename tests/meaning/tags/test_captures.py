"""A capture as a file of tags: what S7comm-plus says of the variables of a CPU names them in other captures."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import pytest

import dissect
from dissect.meaning.tags import TagError, load_tags
from dissect.meaning.tags.loading import read_tags
from dissect.packets.source.files import open_capture
from dissect.packets.source.packet import PacketSink
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.program import Program
from tests.cli.support import run
from tests.conftest import ROOT
from tests.protocols.s7plus.test_program import TAGS, TANK, VALVE
from tests.testing.oracle.traffic import write_capture

PLANT = ROOT / "captures" / "crafted" / "plus-plant.pcapng"
HOST = "192.0.2.20"
#: The packet of the plant with the answer that declares DB1.
DECLARES = 11


class Packets(PacketSink):
    def __init__(self) -> None:
        self.kept: list[bytes] = []

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        self.kept.append(buf[start:end])


@pytest.fixture
def silent(tmp_path: Path) -> Path:
    """The plant without the declaration."""
    packets = Packets()
    reader = open_capture(str(PLANT))
    while reader.step(packets):
        pass
    del packets.kept[DECLARES - 1]
    return write_capture(tmp_path / "silent.pcap", packets.kept)


def items(capture: Path, *tags: str) -> list[str]:
    """Return what GetMultiVariables asked for."""
    found = []
    for event in dissect.open(str(capture), tags=list(tags) or None, pdus=False):
        if isinstance(event, dissect.Transaction) and event.parameters.function_name.endswith("GetMultiVariables"):
            found += [item.label for item in event.plus_results]
    return found


def test_names_of_one_capture_for_another(silent: Path) -> None:
    assert set(items(silent)) == {"DB1 LID 11"}
    assert set(items(silent, str(PLANT))) == {'DB1."setpoint"'}


def test_names_are_those_of_one_cpu(silent: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    """Another CPU may have other variables there; whose a capture is, may be said."""
    for told, name in ((f"{HOST}={PLANT}", 'DB1."setpoint"'), (f"192.0.2.99={PLANT}", "DB1 LID 11")):
        lines = run(capfdbinary, "transactions", "--tags", told, silent).out.splitlines()
        asked = [line.partition("GetMultiVariables  ")[2] for line in lines if "GetMultiVariables" in line]
        assert {text.partition(" = ")[0] for text in asked} == {name}
    moved = load_tags([PLANT])
    assert moved.naming().program("192.0.2.99") is None
    assert moved.naming("192.0.2.99").program("192.0.2.99") is not None


def test_the_list(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    assert run(capfdbinary, "tags", "list", PLANT).out.splitlines() == [
        f'{HOST}  DB1 LID 9  Real  DB1."level"',
        f'{HOST}  DB1 LID 10  Bool  DB1."pump"',
        f'{HOST}  DB1 LID 11  Int  DB1."setpoint"',
    ]
    values = json.loads(run(capfdbinary, "tags", "list", "-T", "json", PLANT).out)
    assert values["tags"] == []
    assert [one["name"] for one in values["symbols"]] == ['DB1."level"', 'DB1."pump"', 'DB1."setpoint"']
    assert set(values["symbols"][0]) == {"host", "name", "address", "type", "crc"}
    checked = run(capfdbinary, "tags", "check", PLANT)
    assert checked.code == 0
    assert "plus-plant.pcapng: capture, 0 tags, 3 variables of S7comm-plus" in checked.out


def test_a_table_of_addresses_cannot_hold_them(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    ran = run(capfdbinary, "tags", "convert", PLANT)
    assert (ran.code, ran.out) == (2, "")
    assert "which have no address for a table: see 's7dissect tags list'" in ran.err


def test_captures_that_say_nothing_are_refused(tmp_path: Path) -> None:
    (tmp_path / "cut.pcapng").write_bytes(PLANT.read_bytes()[:10])
    told_nothing = ROOT / "captures" / "password.pcapng"
    for path, why in ((told_nothing, "without declarations"), (tmp_path / "cut.pcapng", "cut.pcapng: ")):
        with pytest.raises(TagError, match=why):
            load_tags([path])


def test_members_of_structures_and_areas_are_listed() -> None:
    program = Program()
    program.learn([TANK, VALVE, TAGS])
    found = {one.name: (one.address, one.declared) for one in program.symbols()}
    assert found['DB3."level"'] == ("DB3 LID 9", "Int")
    assert found['DB3."valve".open'] == ("DB3 LID 10.1", "Bool")
    assert found['DB3."valve".inner.open'] == ("DB3 LID 10.2.1", "Bool")
    assert found['DB3."history"'] == ("DB3 LID 11", "Array[-2..5] of Int")
    assert found['M."lamp"'] == ("M LID 20", "Bool")
    assert len(found) < 40  # one that holds itself is followed some levels down


def test_what_passes_counts_for_more_than_what_is_given() -> None:
    given, seen = Program(), Program()
    given.learn([TANK, TAGS])
    seen.learn([TAGS])
    before = seen.count
    seen.adopt(given)
    assert seen.count == given.count > before
    assert seen.find(VariableAddress(0, 0x8A0E0003, 2550, [9])) is not None


@pytest.mark.parametrize(
    "name",
    [
        "plain-big-endian-ns.pcap",
        "plain-ns.pcap",
        "plain-gzip.pcap.gz",
        "plain-zstd.pcap.zst",
        "plain-big-endian-ng.pcapng",
    ],
)
def test_a_capture_is_one_in_every_format_that_is_read(name: str) -> None:
    found = read_tags([str(PLANT.parent / name)])
    assert [problem.text.partition(" of variables")[0] for problem in found.problems] == [
        "is a capture without declarations"
    ]


def test_every_capture_has_its_names_compressed_or_not(silent: Path, tmp_path: Path) -> None:
    packed = tmp_path / "plant.gz"
    packed.write_bytes(gzip.compress(PLANT.read_bytes()))
    assert set(items(silent, str(packed))) == {'DB1."setpoint"'}


def test_tags_that_are_compressed_are_told_from_captures(tmp_path: Path) -> None:
    packed = tmp_path / "tags.csv.gz"
    packed.write_bytes(gzip.compress(b"address,type,name\nMW0,INT,a\n"))
    with pytest.raises(TagError, match=r"not a capture file .*; if it has tags, decompress it first \(gzip\)"):
        load_tags([packed])
