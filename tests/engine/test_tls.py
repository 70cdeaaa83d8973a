"""TLS inside ISO-on-TCP: from TSDUs to the transactions in them."""

from __future__ import annotations

import ssl
from collections.abc import Iterator
from typing import Any

import pytest

from dissect.engine.transactions.connection import Connection
from dissect.protocols.iso.upper import TLS
from tests.engine.findings.plus_scenarios import MODERN, opened, set_up
from tests.engine.findings.plus_scenarios import read as read_plus
from tests.engine.transactions.talk import MS, Talk, dt, item, read
from tests.protocols.s7plus.pdus import INIT_SSL, asked, framed, notified, told
from tests.protocols.tls import sealing
from tests.protocols.tls.sealing import FINISHED, HANDSHAKE, Pair
from tests.protocols.tls.talks import Wire, wire

ASK, TELL, PUSH = framed(asked(5, body=b"what")), framed(told(5)), framed(notified())


def begun(talk: Talk) -> Talk:
    """Everything up to the answer to InitSSL."""
    talk.hello()
    talk.connect()
    talk.ask(framed(asked(1, INIT_SSL, 0, 0x30, bytes(4)), 1))
    talk.tell(framed(told(1, INIT_SSL), 1))
    talk.findings.clear()
    talk.transactions.clear()
    return talk


def spoken(talk: Talk, found: Wire) -> None:
    for side, octets in found.flights:
        talk.packet(side, dt(octets))


def only(talk: Talk) -> Connection:
    (connection,) = talk.connections
    return connection


def facts(talk: Talk) -> list[tuple[str, str]]:
    return [(one.outcome, one.function_name) for one in talk.transactions]


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
def test_what_is_inside_counts_like_what_is_not(version: ssl.TLSVersion) -> None:
    found = wire([(0, ASK), (1, TELL), (1, PUSH)], version)
    talk = Talk()
    talk.unlock(found.key_log)
    spoken(begun(talk), found)
    talk.close()
    assert facts(talk) == [
        ("answered", "S7comm-plus GetMultiVariables"),
        ("unsolicited", "S7comm-plus notification"),
    ] or [outcome for outcome, _ in facts(talk)] == ["answered", "push"]
    (first, _) = talk.transactions
    assert first.latency_ns == MS
    connection = only(talk)
    assert connection.protocol == "s7comm_plus"
    session = connection.tls
    assert session is not None
    assert (session.shut, session.why_closed, session.is_open) == (0, "", True)
    assert talk.pipeline.tls.describe() == {
        "tls": {
            "sessions": 1,
            "decrypted": 1,
            "records_opened": session.opened,
            "records_closed": 0,
            "other_messages": 0,
            "keys_of_sessions": 1,
        }
    }
    assert talk.pipeline.plus.pdus == 5
    assert "session.tls_closed" not in talk.slugs()


def test_without_keys_everything_is_counted_and_nothing_more_is_said() -> None:
    found = wire([(0, ASK), (1, TELL)])
    talk = begun(Talk())
    spoken(talk, found)
    talk.close()
    assert talk.transactions == []
    assert talk.slugs() == ["session.encrypted", "cotp.size_exceeded"]
    connection = only(talk)
    session = connection.tls
    assert session is not None
    assert (session.opened, session.server_name, session.version_name) == (0, "plc.local", "TLS 1.3")
    assert talk.pipeline.iso.tsdus.counts()[TLS] == len(found.flights)
    ending = connection.ending
    assert ending is not None
    assert "last encrypted message" in ending.last_heard() or ending.last_encrypted_ns


def test_without_init_ssl_the_protocol_is_what_is_inside() -> None:
    found = wire([(0, ASK), (1, TELL)])
    talk = Talk()
    talk.unlock(found.key_log)
    talk.hello()
    talk.connect()
    spoken(talk, found)
    talk.close()
    assert only(talk).protocol == "s7comm_plus"
    assert facts(talk) == [("answered", "S7comm-plus GetMultiVariables")]


def test_s7comm_in_tls() -> None:
    question = read(1, item(0x84, 10, 0, 4))
    found = wire([(0, question)])
    talk = Talk()
    talk.unlock(found.key_log)
    talk.hello()
    talk.connect()
    spoken(talk, found)
    talk.close()
    assert facts(talk) == [("unanswered", "Read Var")]
    assert only(talk).protocol == "s7comm"


def test_what_is_neither_is_counted() -> None:
    found = wire([(0, b"GET / HTTP/1.1"), (1, b"\x00\x01")])
    talk = Talk()
    talk.unlock(found.key_log)
    spoken(begun(talk), found)
    talk.close()
    assert talk.transactions == []
    assert talk.pipeline.tls.other == 2
    assert [one.detail for one in talk.findings if one.slug == "session.foreign_on_102"] == [
        "unknown in TLS: begins with 47 45 54 20 2f 20 48 54"  # once for a protocol
    ]


def test_what_is_neither_between_sound_pdus_is_reported() -> None:
    talk = Talk()
    pair = Pair()
    talk.unlock(pair.keys())
    begun(talk)
    client, server = pair.ends
    said = [*pair.begun, (0, client.seal(ASK)), (0, client.seal(bytes(range(256)))), (1, server.seal(bytes(500)))]
    for side, octets in [*said, (1, server.seal(TELL))]:
        talk.packet(side, dt(octets))
    talk.close()
    assert facts(talk) == [("answered", "S7comm-plus GetMultiVariables")]
    assert [one.detail for one in talk.findings if one.slug == "session.foreign_on_102"] == [
        "unknown in TLS: begins with 00 01 02 03 04 05 06 07"
    ]


# ---- records and TSDUs have nothing to do with each other -----------------------------------------------------------


def cuts(octets: bytes, size: int) -> Iterator[bytes]:
    for at in range(0, len(octets), size):
        yield octets[at : at + size]


@pytest.mark.parametrize("size", [2, 4, 5, 6, 7, 29, 100, 1000])
def test_records_over_many_tsdus(size: int) -> None:
    pair = Pair()
    client, server = pair.ends
    talk = Talk()
    talk.unlock(pair.keys())
    begun(talk)
    for side, octets in [*pair.begun, (0, client.seal(ASK)), (1, server.seal(TELL))]:
        for piece in cuts(octets, size):
            talk.packet(side, dt(piece))
    talk.close()
    assert facts(talk) == [("answered", "S7comm-plus GetMultiVariables")]
    session = only(talk).tls
    assert session is not None
    assert session.shut == 0
    assert [int(one.reader.skipped) for one in session.directions] == [0, 0]


def test_frames_over_many_records_and_many_in_one() -> None:
    pair = Pair()
    client, server = pair.ends
    talk = Talk()
    talk.unlock(pair.keys())
    begun(talk)
    for side, octets in pair.begun:
        talk.packet(side, dt(octets))
    for piece in cuts(ASK + framed(asked(6)), 3):
        talk.ask(client.seal(piece))
    talk.tell(server.seal(TELL + framed(told(6))))
    talk.close()
    assert facts(talk) == [("answered", "S7comm-plus GetMultiVariables")] * 2


def test_a_pdu_in_several_frames() -> None:
    whole = asked(5, body=bytes(3000))
    frames = [framed(whole[:1000], trailer=False), framed(whole[1000:2000], trailer=False), framed(whole[2000:])]
    found = wire([(0, frame) for frame in frames] + [(1, TELL)])
    talk = Talk()
    talk.unlock(found.key_log)
    spoken(begun(talk), found)
    talk.close()
    (transaction,) = talk.transactions
    assert transaction.outcome == "answered"
    assert len(transaction.request_octets) == sum(map(len, frames))


# ---- what is odd ----------------------------------------------------------------------------------------------------


def test_sound_pdus_beside_tls_are_never_hidden() -> None:
    """Whoever sends half a record keeps nobody from reading what is sent in clear."""
    pair = Pair()
    talk = Talk()
    talk.unlock(pair.keys())
    begun(talk)
    for side, octets in pair.begun:
        talk.packet(side, dt(octets))
    talk.ask(b"\x17\x03\x03\x40\x00half")
    talk.ask(ASK)
    talk.tell(TELL)
    talk.ask(read(1, item(0x84, 10, 0, 4)))
    talk.close()
    assert facts(talk)[0] == ("answered", "S7comm-plus GetMultiVariables")
    assert ("unanswered", "Read Var") in facts(talk)


def test_after_a_gap_what_follows_is_opened() -> None:
    pair = Pair()
    client, server = pair.ends
    talk = Talk()
    talk.unlock(pair.keys())
    begun(talk)
    for side, octets in pair.begun:
        talk.packet(side, dt(octets))
    talk.lose(0, *[client.seal(b"lost") for _ in range(9)])
    talk.ask(client.seal(ASK))
    talk.tell(server.seal(TELL))
    talk.close()
    assert facts(talk) == [("answered", "S7comm-plus GetMultiVariables")]
    session = only(talk).tls
    assert session is not None
    assert (session.shut, session.why_closed) == (0, "")


def test_keys_that_come_after_the_records() -> None:
    pair = Pair()
    client, server = pair.ends
    talk = Talk()
    keys = talk.unlock(b"")
    begun(talk)
    for side, octets in pair.begun:
        talk.packet(side, dt(octets))
    number = talk.ask(client.seal(ASK))
    keys.add(pair.keys())
    answer = talk.tell(server.seal(TELL))
    talk.close()
    assert facts(talk) == [("answered", "S7comm-plus GetMultiVariables")]
    assert talk.pairs() == [(number, answer)]


def test_what_waits_for_keys_counts_as_held() -> None:
    pair = Pair()
    talk = Talk()
    talk.unlock(b"")
    begun(talk)
    for side, octets in pair.begun:
        talk.packet(side, dt(octets))
    (end,) = talk.pipeline.table.all_open()
    held = [talk.pipeline.iso.held(one) for one in (end, end.peer) if one is not None]
    assert held == [len(pair.ends[0].seal(FINISHED, HANDSHAKE)) * 2, 0]


def test_the_reason_is_a_finding() -> None:
    found = wire([(0, ASK)])
    half = b"\n".join([line for line in found.key_log.splitlines() if not line.startswith(b"SERVER")])
    talk = Talk()
    talk.unlock(half)
    spoken(begun(talk), found)
    talk.close()
    (said,) = [one.detail for one in talk.findings if one.slug == "session.tls_closed"]
    assert said.endswith(
        " encrypted records stay closed: the key log lacks SERVER_HANDSHAKE_TRAFFIC_SECRET of its session"
    )
    # What is said of every encrypted connection holds here too: keys were given, and where it says why they did not open it.
    (encrypted,) = [one.rule.advice for one in talk.findings if one.slug == "session.encrypted"]
    assert "without its session keys" not in encrypted.lower()
    assert "session.tls_closed" in encrypted


def test_a_key_log_in_the_capture() -> None:
    found = wire([(0, ASK), (1, TELL)])
    talk = Talk()
    talk.pipeline.secrets(found.key_log)
    spoken(begun(talk), found)
    talk.close()
    assert facts(talk) == [("answered", "S7comm-plus GetMultiVariables")]


def test_what_only_looks_like_tls_is_told_as_before() -> None:
    talk = Talk()
    talk.hello()
    talk.connect()
    talk.ask(b"\x15\x03nothing of it")
    talk.ask(b"\xee\xee\xee")
    talk.tell(b"\xdd\xdd")
    talk.ask(read(1, item(0x84, 10, 0, 4)))
    talk.close()
    assert facts(talk) == [("unanswered", "Read Var")]
    session = only(talk).tls
    assert session is not None
    assert session.directions[0].reader.skipped == 15
    assert talk.pipeline.iso.tsdus.counts()[TLS] == 1


def test_what_the_handshake_costs_is_bounded() -> None:
    talk = begun(Talk())
    flood = sealing.record(22, b"\x0b\x00\xff\xff" + bytes(16000))
    for _ in range(100):
        talk.tell(flood)
        (side,) = talk.pipeline.table.all_open()
        assert side.peer is not None
        assert talk.pipeline.iso.held(side) + talk.pipeline.iso.held(side.peer) < 400_000
    talk.close()


class Said:
    """Takes what scenarios of findings say, as records for a session: (side, octets)."""

    def __init__(self) -> None:
        self.flights: list[tuple[int, bytes]] = []

    def ask(self, octets: bytes) -> None:
        self.flights.append((0, octets))

    def tell(self, octets: bytes) -> None:
        self.flights.append((1, octets))


@pytest.mark.parametrize("key", [False, True])
def test_findings_of_sessions_are_right_inside_tls(key: bool) -> None:
    """No clear text where there is TLS; the challenge that is left unanswered is the way without TLS."""
    said: Any = Said()
    opened(said, version=MODERN)
    set_up(said, key=key)
    read_plus(said, 3)
    found = wire(said.flights)
    talk = Talk()
    talk.unlock(found.key_log)
    spoken(begun(talk), found)
    talk.close()
    assert [function for _, function in facts(talk)] == [
        "S7comm-plus CreateObject", "S7comm-plus SetMultiVariables", "S7comm-plus GetMultiVariables",
    ]  # fmt: skip
    assert not {"security.clear_text", "security.unauthenticated", "session.tls_closed"} & set(talk.slugs())


def test_the_same_without_tls_is_clear_text_and_unauthenticated() -> None:
    talk = Talk()
    talk.hello()
    talk.connect()
    opened(talk, version=MODERN)
    set_up(talk, key=False)
    read_plus(talk, 3)
    talk.close()
    assert {"security.clear_text", "security.unauthenticated"} <= set(talk.slugs())


def test_tls_without_init_ssl_is_no_clear_text_either() -> None:
    """TLS may begin behind the connection's confirmation at once; what is inside is encrypted all the same."""
    said: Any = Said()
    opened(said, version=MODERN)
    set_up(said, key=False)
    read_plus(said, 3)
    found = wire(said.flights)
    talk = Talk()
    talk.unlock(found.key_log)
    talk.hello()
    talk.connect()
    spoken(talk, found)
    talk.close()
    assert len(talk.transactions) == 3
    assert not {"security.clear_text", "security.unauthenticated"} & set(talk.slugs())


# ---- frames that never end ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ends", ["gap", "end"])
def test_what_there_is_of_a_frame_inside_tls_is_used(ends: str) -> None:
    """A request whose frame is cut short by a gap, or by the end of the connection."""
    pair = Pair()
    client, _ = pair.ends
    talk = Talk()
    talk.unlock(pair.keys())
    begun(talk)
    for side, octets in pair.begun:
        talk.packet(side, dt(octets))
    talk.ask(client.seal(ASK[:-4]))
    (one,) = talk.pipeline.table.all_open()
    assert talk.pipeline.tls.held(one) > 0
    if ends == "gap":
        talk.lose(0, client.seal(b"lost"))
        talk.ask(client.seal(ASK))
        talk.packet(1)
        talk.silence(3_000 * MS)
    talk.close()
    assert [outcome for outcome, _ in facts(talk)] == ["unanswered"] * (2 if ends == "gap" else 1)
    assert talk.pipeline.plus.cut_pdus <= 1


def test_the_time_of_the_last_encrypted_message_is_that_of_the_server() -> None:
    """Of what it sent and nobody can read; what is decrypted is known better."""
    for keys in (False, True):
        pair = Pair()
        client, server = pair.ends
        talk = Talk()
        if keys:
            talk.unlock(pair.keys())
        begun(talk)
        for side, octets in pair.begun:
            talk.packet(side, dt(octets))
        talk.ask(client.seal(ASK), after_ns=100 * MS)
        talk.tell(server.seal(TELL), after_ns=100 * MS)
        told_ns = talk.now_ns
        talk.ask(client.seal(framed(asked(6))), after_ns=100 * MS)
        talk.close()
        assert (only(talk).last_encrypted_ns == told_ns) is not keys


def test_each_side_of_a_connection_is_decrypted_as_its_own() -> None:
    """Keys come late: what waited is passed on with its own packets, of both sides."""
    pair = Pair()
    client, server = pair.ends
    talk = Talk()
    keys = talk.unlock(b"")
    begun(talk)
    for side, octets in pair.begun:
        talk.packet(side, dt(octets))
    pairs = []
    for number in (5, 6):
        asks = talk.ask(client.seal(framed(asked(number))))
        pairs.append((asks, talk.tell(server.seal(framed(told(number))))))
    assert talk.transactions == []
    keys.add(pair.keys())
    last = talk.ask(client.seal(framed(asked(7))))
    talk.close()
    assert talk.pairs() == [*pairs, (last, 0)]
    assert [one.asked_by for one in talk.transactions] == [0, 0, 0]
    assert talk.pipeline.tls.describe()["tls"]["sessions"] == 1  # type: ignore[index]
