"""tshark as a child: its JSON cut into records, its failures told clearly, its segments."""

from __future__ import annotations

import io
import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest

from dissect.testing.oracle import tshark
from dissect.testing.oracle.tshark import Child, OracleError, preferences, read_segments, read_tshark, records
from tests.build import dt
from tests.testing.oracle.traffic import PUSH_ACK, Connection, connect, conversation, setup, write_capture

RECORDS = [
    {"_source": {"layers": {"frame": {"frame.number": "1"}, "text": 'brace }\n  },\n  { "quote" \\'}}},
    {"_source": {"layers": {}}},
    {"_source": {"layers": {"list": [{"a": "1"}, {"b": [["00", 1, 2, 0, 4]]}]}}},
]


@pytest.mark.parametrize("size", [1, 2, 3, 7, 64, 100_000])
@pytest.mark.parametrize("count", [0, 1, 3])
def test_records_are_cut_wherever_the_chunks_end(monkeypatch: pytest.MonkeyPatch, size: int, count: int) -> None:
    monkeypatch.setattr(tshark, "_CHUNK", size)
    text = json.dumps(RECORDS[:count], indent=2).replace("\n  {", "\n  {", 1) + "\n\n"
    found = [json.loads(record) for record in records(io.BytesIO(text.encode()))]
    assert found == RECORDS[:count]


def test_a_record_is_given_before_the_next_one_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tshark, "_CHUNK", 16)
    stream = io.BytesIO(json.dumps(RECORDS * 50, indent=2).encode())
    next(records(stream))
    assert stream.tell() < 400


def test_packets_with_tpkts(tmp_path: Path) -> None:
    connection = Connection(Random(1), 1, port=10102)
    connection.open()
    connection.put(0, PUSH_ACK, connect(Random(1), 0xE0, 0))
    connection.put(0, PUSH_ACK, dt(setup(Random(1), 1, 1)) + dt(setup(Random(1), 1, 2)))
    path = str(write_capture(tmp_path / "made.pcap", connection.packets))
    assert list(read_tshark(path)) == [], "Wireshark has to be told of other ports"
    first, second = read_tshark(path, [10102])
    assert (first.number, len(first.tpdus), len(first.pdus)) == (4, 1, 0)
    assert (second.number, len(second.tpdus), len(second.pdus)) == (5, 2, 2)


def test_a_message_whose_header_is_cut_by_a_segment_on_another_port(tmp_path: Path) -> None:
    """Decode-as (-d tcp.port==N,tpkt) would not show it: the dissector it takes wants four octets at once."""
    connection = Connection(Random(1), 1, port=10102)
    connection.open()
    message = connect(Random(1), 0xE0, 0)
    connection.put(0, PUSH_ACK, message[:1])
    connection.put(0, PUSH_ACK, message[1:])
    (frame,) = read_tshark(str(write_capture(tmp_path / "made.pcap", connection.packets)), [10102])
    assert frame.number == 5


def test_preferences_name_every_port() -> None:
    assert preferences([2000, 1102], reorder=False)["tpkt.tcp.port"] == "102,1102,2000"
    assert preferences([], reorder=False)["tcp.reassemble_out_of_order"] == "FALSE"
    assert preferences([], reorder=True)["tcp.reassemble_out_of_order"] == "TRUE"


def test_without_tshark(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tshark, "PROGRAM", "no-such-program")
    with pytest.raises(OracleError, match=r"no-such-program cannot be started .*apt install tshark"):
        list(read_tshark("any.pcap"))


@pytest.mark.skipif(shutil.which("tshark") is None, reason="tshark is not installed")
@pytest.mark.parametrize("read", [read_tshark, read_segments])
def test_a_file_that_is_none(tmp_path: Path, read: Callable[[str], object]) -> None:
    with pytest.raises(OracleError, match=r"reading .*nothing.pcap: it failed with code \d+: .*doesn't exist"):
        list(read(str(tmp_path / "nothing.pcap")))  # type: ignore[call-overload]


def test_a_file_cut_off_gives_its_packets_first(tmp_path: Path) -> None:
    path = write_capture(tmp_path / "made.pcap", conversation(Random(3), 1, [10102]))
    path.write_bytes(path.read_bytes()[:-5])
    frames = read_tshark(str(path), [10102])
    assert next(frames).tpdus
    with pytest.raises(OracleError, match="cut short"):
        list(frames)


def test_a_reader_may_stop_early(tmp_path: Path) -> None:
    frames = read_tshark(str(write_capture(tmp_path / "made.pcap", conversation(Random(3), 1, [10102]))), [10102])
    next(frames)
    frames.close()  # type: ignore[attr-defined]


def test_a_child_that_says_nothing() -> None:
    child = Child([sys.executable, "-c", "raise SystemExit(7)"], "the test")
    with pytest.raises(OracleError, match="the test: it failed with code 7: it does not say why"):
        child.close()


def test_a_child_that_complains_much_does_not_block() -> None:
    code = "import sys; sys.stderr.write('x' * 1_000_000 + '\\nthe reason\\n'); sys.exit(3)"
    child = Child([sys.executable, "-c", code], "the test")
    assert child.stdout.read() == b""
    with pytest.raises(OracleError, match="code 3: the reason"):
        child.close()


def test_segments(tmp_path: Path) -> None:
    connection = Connection(Random(1), 1)
    connection.sequence = [0xFFFFFFFE, 500]
    connection.open()
    connection.put(0, PUSH_ACK, b"abcd")
    connection.put(1, PUSH_ACK, b"xyz")
    connection.put(0, PUSH_ACK, b"abcd", sequence=0xFFFFFFFF)
    first, second, third = read_segments(str(write_capture(tmp_path / "made.pcap", connection.packets)))
    assert (first.frame, first.sequence, first.payload, first.remarks) == (4, 0xFFFFFFFF, b"abcd", frozenset())
    assert (second.frame, second.sequence, second.payload) == (5, 501, b"xyz")
    assert first.flow == third.flow != second.flow
    assert "tcp.analysis.retransmission" in third.remarks
