"""Which protocol a connection speaks, what is said of others, and connections that the selection of a user leaves out."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.connection import FOREIGN, ISO, PROBING, Connection
from dissect.engine.transactions.side import Side
from tests import build
from tests.cases import each
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    CONFIRM,
    CONNECT,
    FIN,
    MS,
    RST,
    SECOND,
    SERVER,
    SYN,
    Talk,
    dbw,
    dt,
    granted,
    read,
    setup,
    words,
)
from tests.protocols.s7plus.pdus import INIT_SSL, asked, framed
from tests.protocols.tls.talks import wire

FOREIGN_ON_102 = "session.foreign_on_102"
HELLO = bytes.fromhex("160301002f0100002b0303") + bytes(41)
COOKIE = b"Cookie: mstshash=op\r\n\x01\x00\x08\x00\x03\x00\x00\x00"
RDP_CONNECT = build.tpdu(b"\xe0\x00\x00\x00\x01\x00", COOKIE)


def begun(port: int = 102) -> Talk:
    talk = Talk(server_port=port)
    talk.hello()
    talk.connect()
    return talk


def said(talk: Talk, slug: str = FOREIGN_ON_102) -> list[tuple[str, list[int]]]:
    return [(one.detail, list(one.frames)) for one in talk.findings if one.slug == slug]


def side_of(talk: Talk) -> Side:
    (side,) = talk.pipeline.table.all_open()
    return side


# ---- other protocols ------------------------------------------------------------------------------------------------


@each("first", [b"\x7f\x65\x82\x01\x94", b"\x7f\x66\x82\x01\x45"])
def test_rdp_inside_iso_on_tcp_takes_the_connection(first: bytes) -> None:
    """It also sends what is no TPKT: that is no garbage, but of another protocol."""
    talk = begun()
    frame = talk.packet(CLIENT, dt(first))
    talk.packet(CLIENT, b"\x04\x00\x10what")
    talk.packet(SERVER, b"\x44\x05\x80ever")
    talk.close()
    what = "initial" if first[1] == 0x65 else "response"
    assert said(talk) == [(f"rdp: T.125 connect-{what}", [frame])]
    (connection,) = talk.connections
    assert (connection.protocol, connection._state) == ("rdp", FOREIGN)
    assert talk.slugs() == [FOREIGN_ON_102]
    assert talk.pipeline.counters.packet_counts()["other_protocol"] == 2


@each("side", [CLIENT, SERVER])
def test_stray_octets_before_another_protocol_are_reported_when_it_takes_the_connection(side: int) -> None:
    """Of either side: nothing comes any more that could end them."""
    talk = begun()
    first = talk.packet(side, b"\xff" * 50)
    talk.packet(1 - side, dt(b"\x7f\x66\x82\x01\x45"))
    assert talk.slugs() == ["tpkt.garbage", FOREIGN_ON_102]
    (finding, _) = talk.findings
    assert finding.frames == [first]
    assert finding.detail.endswith("decoding did not resume")


def test_what_looks_like_rdp_among_s7_ends_nothing() -> None:
    talk = begun()
    talk.ask(setup(0))
    talk.tell(granted(0))
    frame = talk.packet(CLIENT, dt(b"\x7f\x65\x82\x01\x94"))
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.close()
    assert said(talk) == [("rdp: T.125 connect-initial", [frame])]
    assert talk.outcomes() == ["answered", "answered"]
    assert talk.connections[0].protocol == "s7comm"


@pytest.mark.parametrize("port", [102, 2000])
def test_what_waited_behind_an_rdp_request_is_of_another_protocol_too(port: int) -> None:
    """The request is captured after what follows it, which is passed on with it."""
    talk = Talk(server_port=port)
    talk.hello()
    at = talk.seq[CLIENT]
    talk.packet(CLIENT, HELLO, seq=at + len(RDP_CONNECT))
    frame = talk.packet(CLIENT, RDP_CONNECT)
    talk.finish()
    assert said(talk) == ([(f"rdp: {identity()}", [frame])] if port == 102 else [])
    octets = talk.pipeline.counters.octets
    assert (octets.framed, octets.skipped, octets.delivered) == (
        len(RDP_CONNECT), len(HELLO), len(RDP_CONNECT) + len(HELLO),
    )  # fmt: skip


def identity() -> str:
    return "cookie mstshash=op, asks for TLS or CredSSP"


def test_rdp_in_the_same_segment_as_its_request_is_counted() -> None:
    talk = Talk()
    talk.hello()
    talk.packet(CLIENT, RDP_CONNECT + HELLO)
    talk.finish()
    octets = talk.pipeline.counters.octets
    assert (octets.framed, octets.skipped) == (len(RDP_CONNECT), len(HELLO))
    assert FOREIGN_ON_102 in talk.slugs()


def test_a_connect_request_of_rdp_on_an_established_connection_is_judged_as_any() -> None:
    talk = begun()
    talk.ask(setup(0))
    talk.tell(granted(0))
    talk.packet(CLIENT, RDP_CONNECT)
    talk.close()
    assert talk.connections[0].protocol == "s7comm"
    assert FOREIGN_ON_102 not in talk.slugs()


@each(
    ("tsdu", "name"),
    [
        (b"what is this", "unknown: begins with 77 68 61 74 20 69 73 20"),
        (b"\x01\x00\x01\x00\x61\x00", "mms: DATA TRANSFER"),
        (b"\xa3\x04\xa0\x02\xa0\x00", "mms: unconfirmed PDU without a session"),
        (b"", ""),
    ],
)
def test_what_a_tsdu_holds_is_named_once_on_port_102_and_nowhere_else(tsdu: bytes, name: str) -> None:
    for port in (102, 1102):
        talk = begun(port)
        first = talk.packet(CLIENT, dt(tsdu))
        talk.packet(CLIENT, dt(tsdu))
        talk.packet(SERVER, dt(tsdu))
        talk.close()
        assert said(talk) == ([(name, [first])] if name and port == 102 else [])
        protocol, _, what = name.partition(": ")
        (connection,) = talk.connections
        assert (connection.protocol, connection.identified_by) == (protocol, what)


def test_a_known_protocol_takes_the_place_of_an_unknown_one_as_its_name() -> None:
    talk = begun()
    one = talk.packet(CLIENT, dt(b"what is this"))
    other = talk.packet(CLIENT, dt(b"\x01\x00\x01\x00\x61\x00"))
    talk.packet(CLIENT, dt(b"what is this"))
    talk.packet(CLIENT, dt(b"\x01\x00\x01\x00\x61\x00"))
    talk.close()
    assert [frames for _, frames in said(talk)] == [[one], [other]]
    assert (talk.connections[0].protocol, talk.connections[0].identified_by) == ("mms", "DATA TRANSFER")


def test_s7_takes_the_place_of_an_unknown_protocol_and_keeps_its_own_name() -> None:
    talk = begun()
    talk.packet(CLIENT, dt(b"what is this"))
    talk.ask(setup(0))
    talk.tell(granted(0))
    talk.packet(CLIENT, dt(b"\x01\x00\x01\x00\x61\x00"))
    talk.close()
    assert talk.connections[0].protocol == "s7comm"


def test_two_connections_are_named_each() -> None:
    talk = begun()
    other = Talk(client_port=50001, beside=talk)
    other.hello()
    other.connect()
    frames = [one.packet(CLIENT, dt(b"what is this")) for one in (talk, other)]
    assert [found for _, found in said(talk)] == [[frame] for frame in frames]
    assert [one.connection for one in talk.findings] == [1, 2]


def test_a_connection_that_takes_the_addresses_of_another_is_named_anew() -> None:
    talk = begun()
    talk.packet(CLIENT, dt(b"what is this"))
    talk.ask(setup(0))
    talk.packet(CLIENT, dt(b"what is this"))
    talk.packet(CLIENT, CONNECT)  # another transport connection on the same TCP connection
    talk.packet(CLIENT, dt(b"what is this"))
    talk.close()
    assert [one.connection for one in talk.findings if one.slug == FOREIGN_ON_102] == [1, 2]


def test_the_rest_of_a_message_behind_a_gap_is_not_named() -> None:
    talk = begun()
    talk.lose(CLIENT, b"what")
    talk.packet(SERVER)
    talk.packet(CLIENT, dt(b"its rest"))
    talk.packet(SERVER, dt(b"what is this"))
    talk.packet(CLIENT, dt(b"\x01\x00\x01\x00\x61\x00"))
    talk.close()
    assert [detail for detail, _ in said(talk)] == [
        "unknown: begins with 77 68 61 74 20 69 73 20",  # nothing of this side is missing
        "mms: DATA TRANSFER",
    ]


def test_tls_inside_tls_is_unknown() -> None:
    found = wire([(0, HELLO), (0, HELLO), (1, b"\x17\x03\x03\x00\x01a")])
    talk = Talk()
    talk.unlock(found.key_log)
    talk.hello()
    talk.connect()
    for side, octets in found.flights:
        talk.packet(side, dt(octets))
    talk.close()
    details = [detail for detail, _ in said(talk)]
    assert details[1:] == ["unknown in TLS: begins with 16 03 01 00 2f 01 00 00"]
    assert talk.pipeline.tls.other == 3


@pytest.mark.parametrize("ssl", [False, True])
def test_tls_after_s7comm_plus_is_an_encrypted_session(ssl: bool) -> None:
    talk = begun()
    talk.ask(framed(asked(1, INIT_SSL, 0, 0x30, bytes(4)), 1) if ssl else framed(asked(1)))
    frame = talk.ask(HELLO)
    talk.ask(HELLO)
    talk.close()
    after = "InitSSL" if ssl else "S7comm-plus"
    assert said(talk, "session.encrypted") == [(f"TLS 1.2 ClientHello, after {after}", [frame])]
    assert talk.connections[0].identified_by == f"{after}, then TLS 1.2 ClientHello"
    assert said(talk) == []


@each("at_start", [True, False])
def test_a_connection_on_port_102_is_watched_long_before_it_is_another_protocol(at_start: bool) -> None:
    """64 segments; the finding names the first one."""
    talk = Talk()
    if at_start:
        talk.hello()
    frames = [talk.packet(CLIENT, b"GET / HTTP/1.0\r\n") for _ in range(63)]
    assert (said(talk), side_of(talk).connection._state) == ([], PROBING)
    talk.packet(CLIENT, b"GET / HTTP/1.0\r\n")
    assert said(talk) == [("unknown: begins with 47 45 54 20 2f 20 48 54", [frames[0]])]
    assert talk.findings[0].time_ns == 1_600_000_000 * SECOND + frames[0] * MS
    assert side_of(talk).connection._state == FOREIGN
    talk.finish()
    assert len(talk.findings) == 1


@each(("count", "known", "told"), [(7, False, 0), (8, False, 1), (1, True, 1)])
def test_at_its_end_a_connection_is_reported_where_enough_of_it_was_captured(
    count: int, known: bool, told: int
) -> None:
    talk = Talk()
    if known:
        talk.hello()
    for _ in range(count):
        talk.packet(CLIENT, b"GET / HTTP/1.0\r\n")
    talk.finish()
    assert len(said(talk)) == told


def test_a_connection_that_is_recognised_late_speaks_s7_from_there_on() -> None:
    """On another port, met in its midst: the eighth segment would have decided against it."""
    for before, connections in ((7, 1), (8, 0)):
        talk = Talk(server_port=2000)
        for _ in range(before):
            talk.packet(CLIENT, b"\x01\x02\x03\x04")
        talk.packet(CLIENT, dt(b"what is this"))
        assert talk.pipeline.connections.count == connections


def test_a_sound_tpkt_on_a_connection_of_another_protocol_begins_a_new_one() -> None:
    """What came before must not hide S7."""
    talk = Talk(server_port=2000)
    talk.hello()
    talk.packet(CLIENT, b"GET / HTTP/1.0\r\n")
    assert side_of(talk).connection._state == FOREIGN
    talk.packet(CLIENT, dt(b"no PDU"))
    talk.packet(CLIENT, build.tpkt(b"\x02\xf0\x80"))
    assert side_of(talk).connection._state == FOREIGN
    first = talk.ask(read(1, dbw(1, 0)))
    answer = talk.tell(words(1, 1))
    talk.close()
    assert talk.pairs() == [(first, answer)]
    (connection,) = talk.connections
    assert connection.number == 1


# ---- left out by the user -------------------------------------------------------------------------------------------


def selecting(only: Callable[[Connection], bool], port: int = 102) -> Talk:
    talk = Talk(server_port=port)
    talk.pipeline = Pipeline(talk, Options(strict=True, only=only))
    return talk


def no_connection(connection: Connection) -> bool:
    return False


def test_nothing_is_said_of_a_connection_that_is_left_out() -> None:
    talk = selecting(no_connection)
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(CLIENT, b"garbage")
    talk.packet(CLIENT, flags=RST, seq=talk.seq[CLIENT] + 5_000_000)
    talk.ask(read(2, dbw(1, 0)))
    talk.close()
    assert (talk.transactions, talk.findings, talk.connections, talk.operations) == ([], [], [], [])
    assert (talk.pipeline.connections.count, talk.pipeline.connections.left_out) == (1, 1)
    counts = {name: count for name, count in talk.pipeline.counters.packet_counts().items() if count}
    assert counts == {"left_out": 7, "no_payload": 3 + 1 + 3}
    octets = talk.pipeline.counters.octets
    assert (octets.delivered, octets.framed, octets.skipped) == (0, 0, 0)


def second_connect(confirmed: bool, data: bytes = b"", first: bytes = CONNECT) -> int:
    """Return how many connections there are when a connect request follows on one that is left out."""
    talk = selecting(no_connection)
    talk.hello()
    talk.packet(CLIENT, first)
    if confirmed:
        talk.packet(SERVER, CONFIRM)
    if data:
        talk.packet(CLIENT, data)
    talk.packet(CLIENT, CONNECT)
    return int(talk.pipeline.connections.count)


PLAIN_CONNECT = build.tpdu(b"\xe0\x00\x00\x00\x01\x00")


def test_a_connect_request_begins_another_connection_once_the_first_is_established() -> None:
    """By a CC, or by data of S7; the same request again is only repeated."""
    assert second_connect(False) == 1
    assert second_connect(True) == 2
    assert second_connect(False, dt(read(1, dbw(1, 0)))) == 2
    assert second_connect(False, dt(framed(asked(1)))) == 2
    assert second_connect(False, dt(b"what is this")) == 1
    assert second_connect(False, dt(b"")) == 1
    assert second_connect(False, dt(b"\x32")) == second_connect(False, dt(b"\x72")) == 2  # the beginning of one will do
    assert second_connect(False, b"\x03\x00\x00\x07\x02\xf0") == 1  # cut short before its data
    assert second_connect(False, b"\x13\x00\x00\x19\x02\xf0\x80" + read(1, dbw(1, 0))) == 1  # no TPKT


@each(("size", "connections"), [(4, 1), (5, 1), (6, 1), (7, 2), (len(CONNECT), 2)])
def test_of_a_connect_request_in_pieces_the_first_has_to_reach_beyond_its_type(size: int, connections: int) -> None:
    """With it and a CC, the next connect request is that of another connection."""
    talk = selecting(no_connection)
    talk.hello()
    talk.packet(CLIENT, CONNECT[:size])
    if CONNECT[size:]:
        talk.packet(CLIENT, CONNECT[size:])
    talk.packet(SERVER, CONFIRM)
    talk.packet(CLIENT, CONNECT)
    assert talk.pipeline.connections.count == connections


def numbers_read(*segments: tuple[int, bytes]) -> list[tuple[int, int]]:
    """Return number and transactions of each connection, of which only later ones are read, after these segments."""
    talk = selecting(lambda one: one.number > 1)
    talk.hello()
    for side, octets in segments:
        talk.packet(side, octets)
    talk.close()
    return [(int(one.number), one.answered) for one in talk.connections]


ASKED, ANSWERED = dt(read(1, dbw(1, 0))), dt(words(1, 1))
WHOLE = [(CLIENT, CONNECT), (SERVER, CONFIRM), (CLIENT, ASKED), (SERVER, ANSWERED)]


def test_the_connection_in_its_place_may_be_read() -> None:
    assert numbers_read(*WHOLE) == []
    assert numbers_read(*WHOLE, *WHOLE) == [(2, 1)]
    assert numbers_read(*WHOLE, *WHOLE, *WHOLE) == [(2, 1), (3, 1)]
    # A damaged request begins nothing; a CC without a size is one all the same.
    damaged = CONNECT[:4] + bytes((CONNECT[4] + 9,)) + CONNECT[5:]
    assert numbers_read(*WHOLE, (CLIENT, damaged), (CLIENT, ASKED)) == []
    plain = build.tpdu(b"\xd0\x00\x01\x00\x02\x00")
    assert numbers_read((CLIENT, CONNECT), (SERVER, plain), *WHOLE) == [(2, 1)]
    # A disconnect says nothing of a beginning.
    disconnect = build.tpdu(b"\x80\x00\x01\x00\x02\x00")
    assert numbers_read((CLIENT, CONNECT), (SERVER, disconnect), *WHOLE) == []


def test_a_connect_request_on_a_connection_met_in_its_midst() -> None:
    """Behind a CC it may belong to the same one, captured in the wrong order; behind data it begins another."""
    for octets, connections in ((CONFIRM, 1), (ASKED, 2), (ANSWERED, 2)):
        talk = selecting(lambda one: one.number > 1)
        talk.packet(SERVER, octets)
        talk.packet(CLIENT, CONNECT)
        assert talk.pipeline.connections.count == connections
        talk.packet(CLIENT, CONNECT)
        assert talk.pipeline.connections.count == 2  # repeated where the first one began it


@each("distance", [1, 7, 100_000])
def test_what_is_missing_or_sent_again_of_a_connection_that_is_left_out_changes_nothing(distance: int) -> None:
    talk = selecting(no_connection)
    talk.open()
    at = talk.seq[CLIENT]
    talk.packet(CLIENT, ASKED, seq=at + distance)
    talk.packet(CLIENT, CONNECT, seq=at - len(CONNECT))  # old octets are not looked at again
    assert talk.pipeline.connections.count == 1
    talk.seq[CLIENT] = at + distance + len(ASKED)
    talk.packet(CLIENT, CONNECT)
    assert talk.pipeline.connections.count == 2
    counts = talk.pipeline.counters.packet_counts()
    assert (counts["left_out"], counts["retransmission"], counts["failed"]) == (7, 0, 0)


def test_a_connection_that_is_left_out_ends_and_another_may_take_its_addresses() -> None:
    talk = selecting(lambda one: one.number > 1)
    talk.open()
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.packet(SERVER, flags=FIN | ACK)
    talk.seq = [5_000_000, 7_000_000]
    talk.open()
    talk.close()
    assert [(one.number, one.tcp.ended) for one in talk.connections] == [(2, "fin")]
    assert talk.slugs() == []


def test_a_reset_of_any_number_ends_a_connection_that_is_not_followed() -> None:
    """Its octets are not counted, so that no number is expected."""
    for talk in (selecting(no_connection), Talk(server_port=2000)):
        if talk.ports[SERVER] == 102:
            talk.open()
        else:
            talk.hello()
            talk.packet(CLIENT, b"GET / HTTP/1.0\r\n")
        for octets in (b"more", b"and more"):
            talk.packet(CLIENT, octets)
        talk.packet(CLIENT, flags=RST, seq=talk.seq[CLIENT] + 500)
        side = side_of(talk)
        assert (side.tcp.ended, side.tcp.doubt, side.tcp.closed) == ("reset", None, True)


# ---- numbers and names ----------------------------------------------------------------------------------------------


def test_a_replaced_connection_keeps_what_belongs_to_the_tcp_connection() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(CLIENT, CONNECT)
    talk.packet(SERVER, CONFIRM)
    talk.ask(setup(0))
    talk.tell(granted(0))
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.close()
    first, second = talk.connections
    assert (first.number, first.closed_reason, first.unanswered) == (1, "replaced", 1)
    assert (second.number, second.closed_reason, second.answered, second._state) == (2, "", 2, ISO)
    assert first.tcp is second.tcp
    lost = [one for one in talk.transactions if one.outcome == "unanswered"]
    assert [(one.connection.number, one.reason) for one in lost] == [(1, "connection_closed")]
    assert second.pdus == 4


def test_a_connection_in_a_vlan_and_over_another_link_is_recognised_alike() -> None:
    talk = Talk()
    talk.vlan = 9
    talk.packet(CLIENT, flags=SYN)
    talk.packet(SERVER, flags=SYN | ACK)
    talk.connect()
    talk.close()
    assert [one.tcp.vlan for one in talk.connections] == [9]
