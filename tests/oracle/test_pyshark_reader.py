"""pyshark as a second way to Wireshark, in a process of its own."""

from __future__ import annotations

import asyncio
from pathlib import Path
from random import Random

import pytest

from dissect.oracle.pyshark_reader import _decoded, read_pyshark
from dissect.oracle.tshark import OracleError, read_tshark
from tests.oracle.traffic import conversation, interleaved, write_capture


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Some connections, on port 102 and another, with several messages in a segment."""
    rng = Random(8)
    packets = interleaved(rng, [conversation(rng, number, [102 if number % 2 else 10102]) for number in range(4)])
    return str(write_capture(tmp_path_factory.mktemp("made") / "made.pcap", packets))


def test_the_same_facts_as_from_tshark(capture: str) -> None:
    direct = list(read_tshark(capture, [10102]))
    other = list(read_pyshark(capture, [10102]))
    assert [frame.number for frame in other] == [frame.number for frame in direct]
    for mine, its in zip(other, direct, strict=True):
        assert mine.protocols == its.protocols
        for kind in ("tpdus", "pdus"):
            assert [(one.octets, one.facts) for one in getattr(mine, kind)] == [
                (one.octets, one.facts) for one in getattr(its, kind)
            ]
    assert max(len(frame.pdus) for frame in other) > 1


def test_after_another_event_loop_ran(capture: str) -> None:
    asyncio.run(asyncio.sleep(0))
    assert next(read_pyshark(capture, [10102])).tpdus


def test_ports_have_to_be_told(capture: str) -> None:
    assert len(list(read_pyshark(capture))) < len(list(read_pyshark(capture, [10102])))


def test_a_file_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(OracleError, match=r"pyshark, reading .*nothing.pcap: it failed with code 1: .*No such file"):
        list(read_pyshark(str(tmp_path / "nothing.pcap")))


def test_a_file_that_is_no_capture(tmp_path: Path) -> None:
    path = tmp_path / "text.pcap"
    path.write_text("this is not a capture")
    with pytest.raises(OracleError, match="isn't a capture file"):
        list(read_pyshark(str(path)))


def test_a_line_that_is_no_json_is_told_with_its_place() -> None:
    with pytest.raises(OracleError, match=r"reading a.pcap: .*byte 5\), near b'\{\"a\":x\}'"):
        _decoded(b'{"a":x}', "a.pcap")
