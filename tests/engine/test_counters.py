"""The accounts of a run: times, packets that are not opened or damaged, and connection attempts."""

from __future__ import annotations

import struct
from typing import Final

import pytest

from dissect.engine.counters import Counters
from dissect.engine.findings.reporter import Reporter
from dissect.engine.transactions.table import endpoints
from tests.cases import each
from tests.engine.test_udp import Heard
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    FIN,
    MS,
    RST,
    SECOND,
    SERVER,
    START_NS,
    SYN,
    Talk,
    dbw,
    read,
    words,
)

US: Final = 1000
HOSTS: Final = bytes((10, 0, 0, 1, 10, 0, 0, 2))


def details(talk: Talk, slug: str) -> list[tuple[str, list[int]]]:
    return [(one.detail, list(one.frames)) for one in talk.findings if one.slug == slug]


def ip(protocol: int, content: bytes, word: int = 0, ident: int = 1) -> bytes:
    """An Ethernet frame with an IPv4 packet; ``word`` has its fragment flags and offset."""
    head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(content), ident, word, 64, protocol, 0)
    return bytes(12) + b"\x08\x00" + head + HOSTS + content


# ---- times ----------------------------------------------------------------------------------------------------------


def at(*times_ns: int) -> Counters:
    """Return the counters after packets at these times, from the start on."""
    talk = Talk()
    for time_ns in times_ns:
        talk.pipeline.frame(START_NS + time_ns, ip(1, bytes(8)), 0, 42, 42, 1)
    return talk.pipeline.counters


@each(
    ("times", "first", "now", "earliest", "latest"),
    [
        ((0,), 0, 0, 0, 0),
        ((0, 5, 9), 0, 9, 0, 9),
        ((5, 9, 3), 5, 3, 3, 9),
        ((5, 3, 9), 5, 9, 3, 9),
        ((5, 9, 7), 5, 7, 5, 9),
        ((5, 20, 3, 8), 5, 8, 3, 20),
    ],
)
def test_the_span_of_a_capture_is_that_of_all_its_packets(
    times: tuple[int, ...], first: int, now: int, earliest: int, latest: int
) -> None:
    counters = at(*[time * SECOND for time in times])
    found = (counters.first_ns, counters.now_ns, counters.earliest_ns, counters.latest_ns)
    assert found == tuple(START_NS + one * SECOND for one in (first, now, earliest, latest))


def test_before_the_first_packet_there_is_no_time() -> None:
    counters = at()
    assert (counters.first_ns, counters.now_ns, counters.earliest_ns, counters.latest_ns) == (0, 0, 0, 0)
    assert not counters.disordered


@each(
    ("times", "disordered"),
    [
        ((0, 1000 * US), False),
        ((1000 * US, 0), False),  # a millisecond is what two queues do
        ((1001 * US, 0), True),  # older than the first one
        ((0, 5000 * US, 3999 * US), True),  # newer than the last one
        ((0, 5000 * US, 4000 * US), False),
        ((0, 5000 * US, 10 * US, 6000 * US), False),  # both ends are where they belong
    ],
)
def test_a_capture_is_out_of_order_when_its_ends_are(times: tuple[int, ...], disordered: bool) -> None:
    assert at(*times).disordered is disordered


@each(
    ("times_us", "steps"),
    [
        ((0, -1000), []),
        ((0, -1001), ["by 1.00 ms"]),
        ((0, 4000, 2500), ["by 1.50 ms"]),
        ((0, 4000, 2500, 2400), ["by 1.50 ms"]),  # the step that was reported is where it is compared with now
        ((0, 4000, 2500, 1400), ["by 1.50 ms", "by 1.10 ms"]),
        ((0, 4000, 3500, 2900), ["by 1.10 ms"]),  # two small steps are one great one
        ((0, 4000, 3500, 4500, 3600), []),
        ((0, 4000, 3500, 4500, 3400), ["by 1.10 ms"]),
    ],
)
def test_steps_back_are_reported_by_how_far_they_go(times_us: tuple[int, ...], steps: list[str]) -> None:
    talk = Talk()
    for time_us in times_us:
        talk.pipeline.frame(START_NS + time_us * US, ip(1, bytes(8)), 0, 42, 42, 1)
    talk.finish()
    assert [detail for detail, _ in details(talk, "capture.time_backwards")] == steps
    assert talk.pipeline.frames == len(times_us)


def test_a_further_capture_that_is_older_widens_the_span_and_is_no_step_back() -> None:
    talk = Talk()
    talk.raw(ip(1, bytes(8)))
    talk.finish()
    talk.pipeline.restart_clock(START_NS - 5 * SECOND)
    talk.pipeline.frame(START_NS - 4 * SECOND, ip(1, bytes(8)), 0, 42, 42, 1)
    counters = talk.pipeline.counters
    assert (counters.first_ns, counters.now_ns) == (START_NS + MS, START_NS - 4 * SECOND)
    assert (counters.earliest_ns, counters.latest_ns) == (START_NS - 5 * SECOND, START_NS + MS)
    # A step back within it is measured from its own times.
    talk.pipeline.frame(START_NS - 4 * SECOND - 3 * MS, ip(1, bytes(8)), 0, 42, 42, 1)
    assert [detail for detail, _ in details(talk, "capture.time_backwards")] == ["by 3.00 ms"]


# ---- fragments ------------------------------------------------------------------------------------------------------


def test_a_further_capture_forgets_fragments_and_keeps_their_counts() -> None:
    talk = Talk()
    talk.raw(ip(6, bytes(16), 0x2000, 1))  # waits for the rest
    talk.raw(ip(6, bytes(15), 0x2000, 2))  # no multiple of eight octets, though more follow
    for octets in (bytes(16), b"\1" * 16):
        talk.raw(ip(6, octets, 0x2000, 3))
    talk.raw(ip(6, bytes(16), 0x2000, 4))
    talk.wait(31 * SECOND)
    talk.raw(ip(6, bytes(16), 0x2000, 5))  # by now those before it are too old
    counters = talk.pipeline.counters
    before = counters.packet_counts()
    assert (before["fragment_waiting"], before["fragment_used"], before["fragment_dropped"]) == (1, 0, 5)
    talk.finish()
    talk.pipeline.restart_clock(talk.now_ns)
    after = counters.packet_counts()
    assert (after["fragment_waiting"], after["fragment_used"], after["fragment_dropped"]) == (0, 0, 6)
    store = counters.fragments
    assert (store.invalid, store.conflicts, store.evicted, store.expired) == (1, 1, 0, 3)


@pytest.mark.parametrize("decoder", [False, True])
def test_fragments_that_can_be_part_of_nothing_are_reported_once(decoder: bool) -> None:
    talk = Talk()
    if decoder:
        talk.carry(Heard())
    for ident in range(3):
        talk.raw(ip(6, bytes(15), 0x2000, ident))
    for octets in (bytes(16), b"\1" * 16):
        talk.raw(ip(6, octets, 0x2000, 9))
    assert details(talk, "ip.fragment_invalid") == [("first seen here", [1])]
    assert talk.pipeline.finding_counts == {"ip.fragment_invalid": 3, "ip.fragment_conflict": 1}
    holds = "TCP, UDP" if decoder else "TCP"
    assert details(talk, "ip.fragment_conflict") == [(f"in a datagram that holds {holds} or a tunnel", [5])]


def test_bad_headers_are_reported_once() -> None:
    talk = Talk()
    for _ in range(3):
        talk.raw(bytes(12) + b"\x08\x00" + b"\x41" + bytes(60))
    assert details(talk, "ip.bad_header") == [("first seen here", [1])]
    assert talk.pipeline.finding_counts == {"ip.bad_header": 3}


# ---- what is not opened ---------------------------------------------------------------------------------------------


def test_what_is_not_opened_is_reported_once_for_each_kind_of_it() -> None:
    talk = Talk()
    for protocol in (50, 115, 50, 115, 50):
        talk.raw(ip(protocol, bytes(20)))
    assert details(talk, "capture.not_opened") == [
        ("ESP (IPsec), first seen here", [1]),
        ("L2TP, first seen here", [2]),
    ]
    assert talk.pipeline.finding_counts == {"capture.not_opened": 5}


def test_of_very_many_kinds_only_some_are_detailed() -> None:
    """32; each link type that is not supported is a kind."""
    talk = Talk()
    for link in range(1000, 1040):
        talk.pipeline.frame(START_NS, bytes(60), 0, 60, 60, link)
    found = details(talk, "capture.not_opened")
    assert len(found) == 32
    assert found[-1] == ("link type 1031, first seen here", [32])
    assert talk.pipeline.finding_counts == {"capture.not_opened": 40}


def test_packets_that_the_capture_cut_say_how_much_of_them_is_there() -> None:
    talk = Talk()
    talk.packet(CLIENT, b"0123456789", cut=4)
    talk.packet(CLIENT, b"0123456789")
    assert details(talk, "capture.cut_frames") == [("60 of 64 bytes kept", [1])]
    assert talk.pipeline.counters.cut_frames == 1


# ---- checksums ------------------------------------------------------------------------------------------------------


def damaged(ports: tuple[int, int], hosts: tuple[int, int] = (1, 2)) -> Talk:
    """One packet with a wrong checksum, of no known connection."""
    talk = Talk(*ports)
    talk.verify()
    talk.hosts = list(hosts)
    talk.sums = False
    talk.packet(CLIENT, b"x")
    return talk


@each("client", [True, False])
def test_a_damaged_packet_without_connection_is_reported_on_port_102(client: bool) -> None:
    talk = damaged((50000, 102) if client else (102, 50000))
    sender, receiver = ("50000", "102") if client else ("102", "50000")
    assert details(talk, "stream.bad_checksum") == [(f"10.0.0.1:{sender} -> 10.0.0.2:{receiver}", [1])]
    (finding,) = talk.findings
    assert (finding.client, finding.server) == (("10.0.0.1", "10.0.0.2") if client else ("10.0.0.2", "10.0.0.1"))
    assert finding.connection == 0
    assert damaged((50000, 80)).findings == []
    assert talk.pipeline.counters.packet_counts()["bad_checksum"] == 1


def test_damaged_packets_of_connections_that_are_not_followed_are_only_counted() -> None:
    talk = Talk(server_port=80)
    talk.verify()
    talk.hello()
    talk.packet(CLIENT, b"GET / HTTP/1.0\r\n")
    talk.sums = False
    talk.packet(CLIENT, b"more")
    assert talk.findings == []
    assert talk.pipeline.counters.packet_counts()["bad_checksum"] == 1


def test_a_damaged_datagram_is_only_counted() -> None:
    talk = Talk()
    talk.carry(Heard())
    talk.pipeline._checksums = True
    udp = struct.pack(">HHHH", 1, 102, 9, 0x1234) + b"x"
    talk.raw(ip(17, udp))
    assert talk.findings == []
    assert talk.pipeline.counters.packet_counts()["bad_checksum"] == 1


# ---- resets that do not fit -----------------------------------------------------------------------------------------


@each("flags", [RST, FIN | ACK])
def test_an_end_that_is_ignored_is_reported_only_of_connections_that_are_followed(flags: int) -> None:
    for port, told in ((102, 1), (80, 0)):
        talk = Talk(server_port=port)
        talk.hello()
        if port == 102:
            talk.open()
        else:
            talk.packet(CLIENT, b"GET / HTTP/1.0\r\n")
        frame = talk.packet(SERVER, flags=flags, seq=talk.seq[SERVER] + 5_000_000)
        what = "FIN" if flags & FIN else "reset"
        expected = [(f"{what} from 10.0.0.2:{port}", [frame])] if told else []
        assert details(talk, "stream.reset_ignored") == expected


def test_what_is_found_in_packets_without_connection_counts_for_none() -> None:
    talk = Talk()
    for _ in range(3):
        talk.raw(bytes(12) + b"\x08\x00" + b"\x41" + bytes(60))
        talk.raw(ip(50, bytes(20)))
        talk.raw(ip(6, bytes(15), 0x2000, 1))
        talk.packet(CLIENT, b"0123456789", cut=4)
    slugs = ("ip.bad_header", "capture.not_opened", "ip.fragment_invalid", "capture.cut_frames")
    rules = talk.pipeline.exchange.ledger.rules
    assert [(rules[slug].events, rules[slug].connections) for slug in slugs] == [(3, 0)] * 4
    assert [(rules[slug].first_frame, rules[slug].last_frame) for slug in slugs] == [(1, 9), (2, 10), (3, 11), (4, 12)]


# ---- attempts -------------------------------------------------------------------------------------------------------


def attempted(talk: Talk, times: int, seq: int = 77) -> None:
    """SYNs of the client with the same number, a second apart."""
    for _ in range(times):
        talk.packet(CLIENT, flags=SYN, seq=seq, after_ns=SECOND)


UNANSWERED: Final = "10.0.0.2:102 does not answer 10.0.0.1:50000 within"


def test_an_attempt_that_is_repeated_twice_is_reported_at_once() -> None:
    talk = Talk()
    attempted(talk, 2)
    assert talk.findings == []
    attempted(talk, 1)
    assert details(talk, "stream.unanswered") == [(f"{UNANSWERED} 2.00 s", [1, 3])]
    (finding,) = talk.findings
    assert (finding.client, finding.server, finding.time_ns) == ("10.0.0.1", "10.0.0.2", talk.now_ns)
    assert finding.connection == 0
    fact = talk.pipeline.exchange.ledger.rules["stream.unanswered"]
    assert (fact.first_frame, fact.last_frame, fact.last_ns) == (1, 3, talk.now_ns)
    attempted(talk, 3)
    talk.finish()
    assert len(talk.findings) == 1


@each(("times", "told"), [(1, []), (2, [(f"{UNANSWERED} 1.00 s", [1, 2])])])
def test_an_attempt_that_is_repeated_once_is_reported_when_nothing_more_can_come(
    times: int, told: list[tuple[str, list[int]]]
) -> None:
    """At the end of the capture, or when another attempt takes its place."""
    talk = Talk()
    attempted(talk, times)
    talk.finish()
    assert details(talk, "stream.unanswered") == told
    talk = Talk()
    attempted(talk, times)
    attempted(talk, 1, seq=78)
    assert details(talk, "stream.unanswered") == told
    if told:
        assert talk.findings[0].time_ns == START_NS + 2 * SECOND  # of the packets that show it


def test_attempts_on_other_ports_are_nobodys_concern() -> None:
    talk = Talk(server_port=80)
    attempted(talk, 3)
    talk.packet(SERVER, flags=RST | ACK)
    talk.finish()
    assert talk.findings == []


def test_what_is_answered_or_refused_is_not_unanswered() -> None:
    talk = Talk()
    attempted(talk, 2)
    frame = talk.packet(SERVER, flags=RST | ACK)
    talk.finish()
    assert [(one.slug, one.frames) for one in talk.findings] == [("stream.refused", [frame])]
    assert details(talk, "stream.refused") == [("10.0.0.2:102 refuses 10.0.0.1:50000", [frame])]
    (finding,) = talk.findings
    assert (finding.client, finding.server, finding.connection) == ("10.0.0.1", "10.0.0.2", 0)
    # Another reset refuses nothing any longer.
    talk.packet(SERVER, flags=RST | ACK)
    assert len(talk.findings) == 1


def test_stations_in_a_vlan_are_named_with_it() -> None:
    for vlan in (0, 9):
        talk = Talk()
        talk.vlan = vlan
        attempted(talk, 3)
        talk.packet(SERVER, flags=RST | ACK)
        where = " in VLAN 9" if vlan else ""
        assert [(one.slug, one.client, one.server) for one in talk.findings] == [
            ("stream.unanswered", f"10.0.0.1{where}", f"10.0.0.2{where}"),
            ("stream.refused", f"10.0.0.1{where}", f"10.0.0.2{where}"),
        ]


def test_a_refusal_counts_the_connections_that_are_open_beside_it() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    other = Talk(client_port=50001, beside=talk)
    other.packet(CLIENT, flags=SYN)
    other.packet(SERVER, flags=RST | ACK)
    (detail,) = [detail for detail, _ in details(talk, "stream.refused")]
    assert detail == "10.0.0.2:102 refuses 10.0.0.1:50001; 1 connection of 10.0.0.1 was open to it"


# ---- findings about packets and hosts -------------------------------------------------------------------------------


def test_a_finding_names_the_packet_at_hand_unless_there_is_none() -> None:
    reporter = Reporter()
    counters = Counters(reporter)
    counters.note("capture.damaged", "before any packet")
    counters.frames, counters.now_ns = 7, START_NS
    counters.note("capture.damaged", "at the seventh", 3)
    counters.note_of("stream.reused", [2, 3], 5, "earlier", 4)
    counters.note_of("stream.reused", [4], 6, "of no connection")
    told = [(one.detail, one.frames, one.time_ns, one.connection) for one in reporter.fresh]
    assert told == [
        ("before any packet", [], 0, 0),
        ("at the seventh", [7], START_NS, 3),
        ("earlier", [2, 3], 5, 4),
        ("of no connection", [4], 6, 0),
    ]


def test_the_ends_of_a_key_are_sender_and_receiver() -> None:
    sender, receiver = endpoints(HOSTS + struct.pack(">HH", 50000, 102))
    assert (str(sender), str(receiver)) == ("10.0.0.1:50000", "10.0.0.2:102")
