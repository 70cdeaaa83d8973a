"""The fake PLC on its sockets: who may come, what it bears, how it ends."""

from __future__ import annotations

import contextlib
import errno
import os
import random
import socket
import struct
import threading
import time
from pathlib import Path

import pytest

from dissect.online.net.addresses import Address
from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.testing.golden.model import Session
from dissect.testing.playback.server import Recording, Server, ServerError, request_log, service
from dissect.testing.playback.server import socket as line_module
from dissect.testing.playback.server.recording import recording_of
from dissect.testing.playback.server.service import places_to_serve
from dissect.testing.talk import Talk, answer, pdu, push, read, szl, values, words
from tests.online.proxy.support import WRONG, eventually, has_ipv6, tshark
from tests.testing.playback.server.support import CONNECT, PATIENCE_S, Plain, dt, small

# ---- safety ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.7", "::"])
def test_other_machines_only_when_that_is_meant(host: str) -> None:
    with pytest.raises(ServerError, match=r"can be reached from other machines.*--allow-remote"):
        Server(small(), host=host)
    assert places_to_serve(Address(host, 0), allow_remote=True)


def test_it_listens_where_it_says() -> None:
    with Server(small()) as server:
        assert server.host == "127.0.0.1"
        assert 0 < server.port < 65536
        with pytest.raises(ServerError, match=f"cannot listen on 127.0.0.1:{server.port}"):
            Server(small(), server.port)


@pytest.mark.skipif(not has_ipv6(), reason="no IPv6 here")
def test_over_ipv6() -> None:
    with Server(small(), host="::1") as server, Plain(server) as client:
        assert client.words("DB10.DBW4") == [1]


def test_what_is_wrong_with_the_arguments_is_told_before_it_listens() -> None:
    with pytest.raises(ValueError, match="'last' or 'cycle'"):
        Server(small(), repeat="often")
    with pytest.raises(ValueError, match="is not a fault"):
        Server(small(), faults=["break:1"])


# ---- its life -------------------------------------------------------------------------------------------------------


def test_requests_and_what_was_not_recorded_are_told() -> None:
    with Server(small()) as server, Plain(server) as client:
        client.set_up()
        assert client.words("DB10.DBW4") == [1]
        assert client.words("DB10.DBW6", "DB7.DBW0") == [6, "0x0a"]
        asked = server.requests
        assert [(one.number, one.function, one.addresses, one.how) for one in asked] == [
            (1, "Setup communication", (), "same"),
            (2, "Read Var", ("DB10.DBW4",), "same"),
            (3, "Read Var", ("DB10.DBW6", "DB7.DBW0"), "unmatched"),
        ]
        assert server.unmatched == [asked[2]]
        text = "request 3 on connection 1, Read Var DB10.DBW6, DB7.DBW0: not recorded: DB7.DBW0"
        text += " (nearest recorded: DB10.DBW6; DB10.DBW4; DB99.DBW0)"
        assert str(asked[2]) == text
        assert list(server.problems) == [f"unmatched: {text}"]


def test_it_ends_at_once_with_clients_and_answers_open() -> None:
    server = Server(small(), latency_ms=60_000)
    server.start()
    with Plain(server) as client:
        client.send(read("DB10.DBW4"))
        eventually(lambda: bool(server.requests))
        server.close()
        server.close()
        assert client.ended() in {"fin", "reset"}
    with pytest.raises(OSError, match="refused"):
        socket.create_connection((server.host, server.port), 1)


def test_a_server_that_never_ran_is_closed_as_well() -> None:
    server = Server(small())
    server.close()
    with pytest.raises(OSError, match="refused"):
        socket.create_connection((server.host, server.port), 1)


def test_a_bug_is_told_to_who_uses_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(now: float) -> None:
        raise RuntimeError("a bug")

    server = Server(small())
    monkeypatch.setattr(server, "_due", broken)
    with pytest.raises(RuntimeError, match="a bug"), server:
        socket.create_connection((server.host, server.port), PATIENCE_S).close()


def test_a_bug_met_by_one_client_costs_the_others_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    with Server(small()) as server, Plain(server) as other, Plain(server) as client:
        right = line_module.ClientSocket.read

        def broken(self: line_module.ClientSocket) -> bytes | None:
            if self.number == 2:
                raise RuntimeError("a bug")
            return right(self)

        monkeypatch.setattr(line_module.ClientSocket, "read", broken)
        client.send(read("DB10.DBW4"))
        assert client.ended() == "reset"
        assert other.words("DB10.DBW4") == [1]
        assert "connection 2 is aborted: RuntimeError: a bug" in server.problems


def test_answers_take_as_long_as_was_recorded() -> None:
    talk = Talk()
    talk >> read("MW0")
    talk.wait(300)
    talk << words(1)
    talk >> read("MW2") << words(2)
    with Server(talk.recording(), latency_ms=None) as server, Plain(server) as client:
        began = time.monotonic()
        slow, fast = client.send_together(read("MW0"), read("MW2"))
        assert [client.pdu().pdu_ref, client.pdu().pdu_ref] == [fast, slow]
        assert time.monotonic() - began >= 0.3


def test_answers_take_as_long_as_is_said() -> None:
    with Server(small(), latency_ms=80) as server, Plain(server) as client:
        began = time.monotonic()
        assert client.words("DB10.DBW4") == [1]
        assert time.monotonic() - began >= 0.08


def test_who_has_no_more_to_say_still_hears_the_answers() -> None:
    with Server(small(), latency_ms=60) as server, Plain(server) as client:
        client.send(read("DB10.DBW4"))
        client.send(read("DB10.DBW4"))
        client.socket.shutdown(socket.SHUT_WR)
        assert [client.pdu().data[-1], client.pdu().data[-1]] == [1, 2]
        assert client.tpkt() == b""


def test_what_the_server_says_by_itself_follows_what_was_asked() -> None:
    talk = Talk()
    talk >> read("MW0") << words(1)
    talk << push(4, 6, b"\x01\x02")
    talk << pdu(bytes.fromhex("32010000000000060000") + b"\x1c\x00\x00\x00\x00\x00")
    talk >> answer(bytes.fromhex("32030000000000010000") + b"\0\0\x1c")
    talk << push(4, 6, b"\x03\x04")
    with Server(talk.recording()) as server, Plain(server) as client:
        assert client.words("MW0") == [1]
        assert client.pdu().data[-2:] == b"\x01\x02"
        job = client.pdu()
        assert (job.rosctr, job.function) == (1, 0x1C)
        assert client.silent()  # it waits for the answer
        client.socket.sendall(dt(bytes.fromhex("32030000") + job.octets[4:6] + bytes.fromhex("000100000000") + b"\x1c"))
        assert client.pdu().data[-2:] == b"\x03\x04"
        assert server.unmatched == []


# ---- recording ------------------------------------------------------------------------------------------------------


def test_the_capture_of_what_passes_is_without_fault(tmp_path: Path) -> None:
    path = tmp_path / "passed.pcapng"
    with Server(small(), writer=PcapngWriter(str(path)), faults=["cut:3"]) as server:
        with Plain(server) as client:
            client.set_up()
            assert client.words("DB10.DBW4") == [1]
            client.send(read("DB10.DBW4"))
            assert client.ended() == "reset"
        with Plain(server) as client:
            assert client.words("DB10.DBW4") == [1]
    assert tshark(path, WRONG, port=server.port) == []
    seen = tshark(path, "s7comm || tcp.flags.reset==1", "tcp.flags.reset", "tcp.stream", port=server.port)
    assert [row[2] for row in seen if row[1] == "1"] == ["0"]
    assert len(seen) == 7 + 1


def test_a_full_disk_costs_the_capture_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = PcapngWriter(str(tmp_path / "full.pcapng"))

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with Server(small(), writer=writer) as server, Plain(server) as client:
        monkeypatch.setattr(writer, "packet", full)
        assert client.words("DB10.DBW4") == [1]
        server.close()
        assert "the capture file is incomplete: No space left on device" in server.problems


# ---- hostile clients ------------------------------------------------------------------------------------------------


def alive(server: Server) -> bool:
    with Plain(server) as client:
        return client.words("DB10.DBW4") == [1]


@pytest.mark.parametrize(
    "octets",
    [
        b"GET / HTTP/1.1\r\nHost: plc\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01",
        b"\x03\x00\x00\x03",
        b"\x03\x00\x00\x05\x00",
        b"\x03\x00\x00\x07\x02\xf0\x80",
        CONNECT + CONNECT,
        CONNECT + b"\x03\x00\x00\x09\x04\x70\x00\x00\x00",
        CONNECT + b"\x03\x00\x00\x08\xff\xf0\x80\x32",
        random.Random(1).randbytes(70_000),
    ],
    ids=["http", "tls", "length", "short", "no-connection", "twice", "error-tpdu", "long-header", "noise"],
)
def test_garbage_ends_the_connection_and_nothing_else(octets: bytes) -> None:
    with Server(small()) as server:
        with Plain(server, b"") as client:
            client.socket.sendall(octets)
            assert client.ended() == "reset"
        assert alive(server)
        assert "connection 1 is ended" in server.problems[0]


@pytest.mark.parametrize(
    "octets", [b"\x72\x01\x00\x00", b"2", b"\x32\x09" + bytes(10), b"\x32\x03" + bytes(10), b"\x32" * 500], ids=str
)
def test_other_messages_are_told_and_not_answered(octets: bytes) -> None:
    with Server(small()) as server, Plain(server) as client:
        client.socket.sendall(dt(octets))
        assert client.words("DB10.DBW4") == [1]
        assert [one.octets for one in server.unmatched] == [octets]


def test_a_message_without_end_is_not_collected() -> None:
    with Server(small()) as server:
        with Plain(server) as client:
            piece = b"\x03\x00\x40\x07\x02\xf0\x00" + bytes(16384)
            try:
                for _ in range(6):
                    client.socket.sendall(piece)
                assert client.ended() == "reset"
            except ConnectionError:
                pass
        eventually(lambda: "connection 1 is ended: an endless message" in server.problems)
        assert alive(server)


def test_the_largest_tpkt_one_octet_at_a_time_and_never_whole() -> None:
    with Server(small()) as server:
        with Plain(server) as client:
            client.socket.sendall(b"\x03\x00\xff\xff\x02\xf0\x80")
            for octet in bytes(300):
                client.socket.sendall(bytes((octet,)))
            assert alive(server)
        assert alive(server)


def test_a_request_in_pieces_of_an_octet() -> None:
    with Server(small()) as server, Plain(server, b"") as client:
        for octet in CONNECT + dt(read("DB10.DBW4").octets):
            client.socket.sendall(bytes((octet,)))
        client.tpkt()
        assert client.pdu().data == b"\xff\x04\x00\x10\x00\x01"


def test_who_does_not_ask_for_a_connection_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "CONNECT_S", 0.05)
    monkeypatch.setattr(service, "_LOOK_S", 0.02)
    with Server(small()) as server, Plain(server, b"") as silent:
        silent.socket.sendall(CONNECT[:10])
        assert silent.ended() == "reset"
        assert "no connect request within 0.05 s" in server.problems[0]


def ending(end: str, *latencies_ms: float) -> Recording:
    """A recording of requests that the server ended: each for another word."""
    talk = Talk()
    for number, _ in enumerate(latencies_ms):
        talk >> read(f"MW{2 * number}") << words(number)
    recording = talk.recording()
    script = recording.scripts[0]
    script.steps = script.steps[1:]
    script.end = end
    for step, latency_ms in zip(script.steps, latencies_ms, strict=True):
        step.latency_ns = int(latency_ms * 1e6)
    return recording


@pytest.mark.parametrize("end", ["fin", "reset", "disconnect", "error_tpdu"])
def test_the_end_waits_for_answers_that_take_longer(end: str) -> None:
    with Server(ending(end, 150, 1), latency_ms=None) as server, Plain(server) as client:
        client.socket.sendall(dt(read("MW0").octets) + dt(read("MW2").octets))
        assert [client.pdu().data[-1] for _ in range(2)] == [1, 0]
        if end in {"disconnect", "error_tpdu"}:
            assert client.tpkt()[5] >> 4 == {"disconnect": 8, "error_tpdu": 7}[end]
        assert client.ended() == ("reset" if end == "reset" else "fin")


def test_who_says_more_than_was_recorded_sees_the_recorded_end() -> None:
    with Server(ending("fin", 0)) as server, Plain(server) as client:
        client.socket.sendall(dt(read("MW0").octets))
        assert client.socket.recv(7, socket.MSG_WAITALL)
        for _ in range(10):  # nobody reads it there, and yet the end is no reset
            client.socket.sendall(dt(read("MW2").octets))
        assert client.ended() == "fin"
        client.socket.close()
        eventually(lambda: not server._clients)


def test_who_never_says_its_end_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "LEAVE_S", 0.05)
    monkeypatch.setattr(service, "_LOOK_S", 0.02)
    with Server(ending("fin", 0)) as server, Plain(server) as client:
        client.socket.sendall(dt(read("MW0").octets))
        assert client.ended() == "fin"
        eventually(lambda: not server._clients)


def test_a_reset_in_the_midst_of_an_answer_costs_nobody_else_anything(monkeypatch: pytest.MonkeyPatch) -> None:
    talk = Talk(pdu=960)
    talk >> read("DB1.DBB0 x900") << values(*[0] * 900)
    with Server(talk.recording(), faults=["split:*"]) as server, Plain(server) as other:
        for _ in range(20):
            with Plain(server) as client:
                client.socket.sendall(dt(read("DB1.DBB0 x900").octets) * 50)
                client.socket.recv(7)
                client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        assert other.ask(read("DB1.DBB0 x900")).return_codes() == [0xFF]
        eventually(lambda: len(server._clients) == 1)
        assert not server._plans


def test_a_thousand_short_connections_leave_nothing_behind() -> None:
    def one(number: int) -> None:
        with Plain(server, CONNECT if number % 3 else b"") as client:
            if number % 2:
                client.send(read("DB10.DBW4"))
            elif number % 5 == 0:
                client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))

    def held() -> tuple[int, int]:
        return len(list(Path("/proc/self/fd").iterdir())), threading.active_count()

    with Server(small()) as server:
        before = held()
        one(1)
        eventually(lambda: held() == before)
        for number in range(1000):
            one(number)
        eventually(lambda: server.connections == 1001 and not server._clients)
        eventually(lambda: held() == before)  # a line is off the list a moment before its socket is closed
        assert not server._plans


def test_more_clients_than_are_served_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "MAX_CLIENTS", 3)
    monkeypatch.setattr(service, "_LOOK_S", 0.02)
    with Server(small()) as server:
        clients = [Plain(server) for _ in range(3)]
        waiting = Plain(server, b"")
        waiting.socket.sendall(CONNECT)
        assert waiting.silent()
        clients.pop().socket.close()
        assert waiting.tpkt()
        assert waiting.words("DB10.DBW4") == [1]
        for client in (*clients, waiting):
            client.socket.close()
        assert "3 clients are connected; more must wait until one disconnects" in server.problems[0]


def test_a_hundred_clients_at_once() -> None:
    with Server(small()) as server:
        heard: list[int | str] = []

        def one() -> None:
            with Plain(server) as client:
                heard.extend(client.words("DB10.DBW4"))

        threads = [threading.Thread(target=one) for _ in range(120)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(PATIENCE_S)
        assert heard == [1] * 120


def send_until_it_ends(to: socket.socket, octets: bytes) -> None:
    with contextlib.suppress(OSError):
        while True:
            to.sendall(octets)


def test_who_does_not_read_is_not_read_from_and_in_the_end_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "TAKE_S", 0.1)
    monkeypatch.setattr(service, "_LOOK_S", 0.02)
    monkeypatch.setattr(line_module, "MAX_HELD", 100_000)
    talk = Talk(pdu=960)
    talk >> read("DB1.DBB0 x900") << values(*[0] * 900)
    with Server(talk.recording()) as server, Plain(server) as client:
        seen = [0]

        def dropped() -> bool:
            seen.extend([line.held for line in list(server._clients)])
            return any("accepted no data" in text for text in server.problems)

        requests = dt(read("DB1.DBB0 x900").octets) * 1000
        sender = threading.Thread(target=send_until_it_ends, args=(client.socket, requests))
        sender.start()
        eventually(dropped)
        sender.join(PATIENCE_S)
        # One read of requests may be answered beyond the bound.
        assert 0 < max(seen) < 100_000 + line_module.PIECE // 31 * 940
        with Plain(server) as other:
            assert other.ask(read("DB1.DBB0 x900")).return_codes() == [0xFF]


def test_what_is_remembered_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(request_log, "MAX_REQUESTS", 5)
    monkeypatch.setattr(request_log, "MAX_UNMATCHED", 3)
    with Server(small()) as server, Plain(server) as client:
        for _ in range(8):
            client.ask(szl(0x7777))
        assert [one.number for one in server.requests] == [4, 5, 6, 7, 8]
        assert [one.number for one in server.unmatched] == [6, 7, 8]
        assert (server.log.total, server.log.unmatched_total) == (8, 8)


def test_an_empty_recording_has_nothing_to_serve() -> None:
    with pytest.raises(ServerError, match="nothing to serve"):
        recording_of(Session("made up"))
    assert Recording().steps == 0
