"""A fake S7-1500 made of a recording: s7commplus at it, and octets of a client that nobody wrote for it."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import pytest

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.tables import GET_MULTI_VARIABLES
from dissect.testing.golden import golden_text, read_session
from dissect.testing.playback.plus_octets import frames_of, with_sequence
from dissect.testing.playback.server import Server, load_recording
from dissect.testing.playback.server.plus import refuse_plus, renewed
from tests.protocols.s7plus.bodies import get_multi
from tests.protocols.s7plus.pdus import asked, framed
from tests.testing.playback.plus_talk import SESSION, WATCHED, plant, word
from tests.testing.playback.server.support import Plain, dt

FOLDER = Path(__file__).resolve().parent.parent.parent.parent.parent / "captures" / "s7plus"
PLAIN = FOLDER / "s7commplus.pcapng"
OPENED = FOLDER / "s7commplus-tls.pcapng"
REAL = bytes.fromhex("41ac0000")
EXPLORE = bytes.fromhex("7201001d31000004bb000000000000000034000000340001010000000000000000" + "72010000")
#: An answer in version 2 with the integrity id 5.
TOLD = bytes.fromhex("72020016 32 0000 054c 0000 0002 34 00 01 00 04 07 00 00 05 00000000 72020000")


def peer(name: str) -> Any:
    """Import a peer; where it is missing the test is skipped, in CI it fails (tests/skips.py)."""
    return pytest.importorskip(name, reason="s7commplus is not installed: make test-environment does it")


def client_of(server: Server) -> Any:
    client = peer("s7commplus.client").S7CommPlusClient()
    client.connect("127.0.0.1", port=server.port, use_tls=False)
    return client


def as_golden(folder: Path, path: Path) -> Path:
    golden = folder / "x.s7.txt"
    golden.write_text(golden_text(read_session(path)), encoding="utf-8")
    return golden


@pytest.mark.parametrize("form", ["capture", "golden"])
def test_the_client_reads_what_was_recorded(form: str, tmp_path: Path) -> None:
    with Server(PLAIN if form == "capture" else as_golden(tmp_path, PLAIN)) as server:
        for _ in range(2):  # the second one is as welcome as the first
            client = client_of(server)
            client.db_write(1, 0, REAL)
            client.db_write(1, 0, bytes(4))  # a write of another value is the same write
            assert client.db_read_multi([(1, 0, 4), (1, 4, 4)]) == [REAL, bytes(4)]
            assert client.db_read(1, 0, 4) == REAL
            assert client.get_cpu_state() == "RUN"
            assert client.explore()
            client.disconnect()
        assert [str(request) for request in server.unmatched] == []


def test_the_session_of_the_recording_is_heard_again() -> None:
    from captures.record.plus import talk

    peer("s7commplus")
    with Server(PLAIN) as server:
        talk(server.port, tls=False)
        assert len(server.requests) == 13
        assert {request.how for request in server.requests} == {"counted"}


def test_what_was_not_recorded_fails_visibly() -> None:
    with Server(PLAIN) as server:
        client = client_of(server)
        with pytest.raises(RuntimeError):
            client.db_read(9, 0, 4)
        assert client.db_read(1, 0, 4) == REAL  # and the session goes on
        with contextlib.suppress(Exception):
            client.disconnect()
    (missed,) = server.unmatched
    assert "GetMultiVariables DB9.DBD0: no similar request was recorded (nearest recorded: " in str(missed)
    assert "DB1.DBD0" in missed.lacking


def test_a_session_in_opened_tls_is_served_plain_and_tls_ends_the_connection() -> None:
    steps = load_recording(OPENED).scripts[0].steps
    assert len(steps) == 13
    with Server(OPENED) as server:
        with Plain(server) as client:
            for number, step in enumerate(steps, 900):
                client.socket.sendall(dt(with_sequence(step.request, number)))
                answer = parse_plus(client.tpkt()[7:])
                assert (answer.function, answer.sequence) == (parse_plus(step.request).function, number)
        with Plain(server) as client:
            client.socket.sendall(dt(b"\x16\x03\x01\x00\x05hello"))
            assert client.ended() == "fin"
        assert [request.function for request in server.unmatched] == ["no S7comm-plus (TLS is not served)"]


def test_a_fault_hits_by_the_name_of_the_function() -> None:
    with Server(PLAIN, faults=["refuse:Explore:0xff98", "wrong-ref:1"]) as server, Plain(server) as client:
        client.socket.sendall(dt(with_sequence(EXPLORE, 7)))
        answer = parse_plus(client.tpkt()[7:])
        assert (answer.sequence, answer.return_code) == (8, 0xFF98)


def test_an_integrity_id_is_that_of_the_request_plus_its_sequence_number() -> None:
    asked = parse_plus(with_sequence(load_recording(OPENED).scripts[0].steps[9].request, 300))
    assert parse_contents(asked).integrity_id == 5
    answer = renewed(TOLD, asked)
    pdu = parse_plus(answer)
    assert (pdu.sequence, parse_contents(pdu).integrity_id, pdu.malformed) == (300, 305, [])
    assert pdu.whole
    assert len(answer) == len(TOLD) + 1
    refused = parse_plus(refuse_plus(asked))
    assert (refused.sequence, refused.return_code, parse_contents(refused).integrity_id) == (300, 0xFF89, 305)


def test_frames_of_an_answer_are_sent_one_by_one() -> None:
    first, last = (
        b"\x72\x01\x00\x0e" + bytes.fromhex("3200000054c00000001000000000"),
        b"\x72\x01\x00\x02ab\x72\x01\x00\x00",
    )
    assert frames_of(first[: 4 + 14] + last) == [first[: 4 + 14], last]


def multi(*words: VariableAddress) -> bytes:
    return framed(asked(5, GET_MULTI_VARIABLES, SESSION, body=get_multi(*words)))


def told_items(client: Plain, request: bytes) -> tuple[list[tuple[int, object]], list[tuple[int, int]], int]:
    client.socket.sendall(dt(request))
    pdu = parse_plus(client.tpkt()[7:])
    found = parse_contents(pdu)
    assert found.whole
    return [(number, value.content) for number, value in found.items], found.refusals, found.integrity_id


def test_reads_are_put_together_of_recorded_items(tmp_path: Path) -> None:
    with Server(plant(tmp_path / "plant.pcapng")) as server:
        with Plain(server) as client:
            # Each item in its own order: the word that counts, one recorded beside another, one that was refused.
            assert told_items(client, multi(word(4), word(0))) == ([(1, 4), (2, 7)], [], 14)
            assert told_items(client, multi(word(0), word(2), word(90))) == ([(1, 8), (2, 2)], [(3, 0x8104)], 14)
            assert told_items(client, multi(word(0))) == ([(1, 8)], [], 14)
            assert server.unmatched == []
            assert {request.how for request in server.requests} == {"items"}
            # One that nobody read is refused, and told; what is known beside it is given.
            assert told_items(client, multi(word(2), word(50))) == ([(1, 2)], [(2, 0x8104)], 14)
            # Where nothing is known, all of it is refused.
            client.socket.sendall(dt(multi(word(50), word(52))))
            assert parse_plus(client.tpkt()[7:]).return_code == 0xFF89
        with Plain(server) as client:  # another client begins anew
            assert told_items(client, multi(word(0)))[0] == [(1, 7)]
    assert [request.lacking.partition(" (")[0] for request in server.unmatched] == [
        "not recorded: DB1.DBW50",
        "no similar request was recorded",
    ]


def test_a_subscription_is_served_with_its_notifications(tmp_path: Path) -> None:
    path = plant(tmp_path / "plant.pcapng")
    (subscribe,) = [step for step in load_recording(path).scripts[0].steps if step.then]
    assert len(subscribe.then) == 2
    with Server(path) as server, Plain(server) as client:
        client.socket.sendall(dt(with_sequence(subscribe.request, 77)))
        answer = parse_plus(client.tpkt()[7:])
        assert (answer.sequence, parse_contents(answer).ids) == (77, [WATCHED])
        heard = [parse_plus(client.tpkt()[7:]) for _ in range(2)]
        assert [pdu.subscription_id for pdu in heard] == [WATCHED] * 2
        contents = [[(number, value.content) for number, value in parse_contents(pdu).items] for pdu in heard]
        assert contents == [[(1, 7)], [(1, 9)]]
        assert server.unmatched == []
