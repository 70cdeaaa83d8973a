"""python-snap7 at the fake PLC, by the very script that the recordings were made with."""

from __future__ import annotations

from pathlib import Path

import pytest
import snap7.error
from snap7.client import Client
from snap7.type import Area, WordLen

from captures.record import talk_python
from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.testing.golden import golden_text, read_session
from dissect.testing.playback.server import Server

FOLDER = Path(__file__).resolve().parent.parent.parent.parent.parent / "captures"
#: Recordings by python-snap7, and what it said in them.
SESSIONS = {
    "connect-close": "connect-close",
    "read-areas-python": "read-areas",
    "write-areas-python": "write-areas",
    "multi-items-python": "multi-items",
    "many-open": "many-open",
    "item-errors-python": "item-errors",
    "szl-python": "szl",
    "blocks-python": "blocks",
    "clock-python": "clock",
    "transfer": "transfer",
    "batched": "pairs",
    "answer-twice": "twice",
}


@pytest.mark.parametrize(("name", "conversation"), SESSIONS.items())
def test_the_client_goes_through_its_session(name: str, conversation: str) -> None:
    with Server(FOLDER / f"{name}.pcapng") as server:
        talk_python.CONVERSATIONS[conversation](server.port)
        assert [str(request) for request in server.unmatched] == []
        assert {request.how for request in server.requests} <= {"same", "counted", "valued"}


@pytest.mark.parametrize(
    ("name", "conversation"), [("transfer", "transfer"), ("szl-python", "szl"), ("clock-python", "clock")]
)
def test_a_golden_of_the_session_serves_as_well(name: str, conversation: str, tmp_path: Path) -> None:
    path = tmp_path / "x.s7.txt"
    path.write_text(golden_text(read_session(FOLDER / f"{name}.pcapng")), encoding="utf-8")
    with Server(path) as server:
        talk_python.CONVERSATIONS[conversation](server.port)
        assert [str(request) for request in server.unmatched] == []


def test_two_clients_hear_the_same_at_once() -> None:
    with Server(FOLDER / "answer-twice.pcapng") as server:
        clients = [talk_python.connect(server.port) for _ in range(3)]
        heard = [[client.db_read(1, 4 * number, 4) for client in clients] for number in range(3)]
        for client in clients:
            client.disconnect()
    assert heard == [[bytearray(range(4 * number, 4 * number + 4))] * 3 for number in range(3)]


def connected(server: Server) -> Client:
    client = Client()
    client.connect("127.0.0.1", 0, 2, server.port)
    return client


def test_a_client_of_another_make_reads_a_recording_of_the_native_one() -> None:
    with Server(FOLDER / "read-areas.pcapng") as server:
        client = connected(server)
        assert client.get_pdu_length() == 480
        assert client.read_area(Area.MK, 0, 20, 3, WordLen.Word) == bytearray(range(20, 26))
        assert client.read_area(Area.DB, 1, 5, 1, WordLen.Byte) == bytearray([5])
        assert server.unmatched == []
        with pytest.raises((snap7.error.S7Error, RuntimeError)):
            client.read_area(Area.DB, 77, 0, 2)
        client.disconnect()
        assert [request.addresses for request in server.unmatched] == [("DB77.DBB0 x2",)]


def test_with_memory_a_client_reads_what_it_wrote() -> None:
    with Server(FOLDER / "read-areas.pcapng", memory=True) as server:
        client = connected(server)
        assert client.read_area(Area.MK, 0, 20, 3, WordLen.Word) == bytearray(range(20, 26))
        client.write_area(Area.MK, 0, 20, bytearray(b"\xaa\xbb"), WordLen.Word)
        assert client.read_area(Area.MK, 0, 20, 3, WordLen.Word) == bytearray(b"\xaa\xbb\x16\x17\x18\x19")
        assert client.mb_read(21, 2) == bytearray(b"\xbb\x16")
        client.disconnect()
        assert server.unmatched == []


def test_what_passes_is_recorded_and_can_be_served_again(tmp_path: Path) -> None:
    first = tmp_path / "again.pcapng"
    with Server(FOLDER / "clock-python.pcapng", writer=PcapngWriter(str(first))) as server:
        talk_python.clock(server.port)
    with Server(first) as server:
        talk_python.clock(server.port)
        assert [request.how for request in server.requests] == ["same"] * 4
