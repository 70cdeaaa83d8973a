"""Connections of which only keep-alive probes were captured are listed; what only looks like them is not."""

from __future__ import annotations

from dissect.engine.counters import Counters
from dissect.engine.findings.reporter import Reporter
from dissect.engine.silent import MAX_SILENT, SilentConnections
from dissect.engine.transactions.table import reverse_key
from tests.cases import each
from tests.engine.transactions.talk import ACK, CLIENT, FIN, MS, RST, SECOND, SERVER, SYN, Talk, dbw, dt, read

PAUSE = 30 * SECOND


def probe(talk: Talk, side: int = CLIENT, octets: bytes = b"", after_ns: int = PAUSE) -> None:
    """One probe of ``side`` and its acknowledgement."""
    talk.packet(side, octets, seq=talk.seq[side] - 1, after_ns=after_ns)
    talk.packet(1 - side)


def idle(talk: Talk) -> list[str]:
    talk.finish()
    assert talk.pipeline.counters.octets.skipped == 0
    assert talk.pipeline.counters.octets.failed == 0
    return [finding.detail for finding in talk.findings if finding.slug == "session.idle"]


def test_one_probe_is_not_all() -> None:
    talk = Talk()
    probe(talk, CLIENT, b"\0")
    assert idle(talk) == ["10.0.0.1:50000 and 10.0.0.2:102: 1 probe, with a byte"]


def said(probes: int, filled: str = "none") -> list[str]:
    return [f"10.0.0.1:50000 and 10.0.0.2:102: {probes} probes, {filled} with a byte"]


@each("octets", [b"", b"\0", b"\x27", b"\x03"])
@each("prober", [CLIENT, SERVER])
def test_probes_of_one_side(octets: bytes, prober: int) -> None:
    talk = Talk()
    for _ in range(3):
        probe(talk, prober, octets)
    assert idle(talk) == said(3, "all" if octets else "none")


@each("octets", [(b"", b""), (b"", b"\0"), (b"\x72", b""), (b"\x03", b"\x29")])
def test_probes_of_both_sides(octets: tuple[bytes, bytes]) -> None:
    talk = Talk()
    for _ in range(2):
        probe(talk, CLIENT, octets[0])
        probe(talk, SERVER, octets[1], after_ns=SECOND // 10)
    assert idle(talk) == said(4, {0: "none", 2: "2 of them", 4: "all"}[sum(2 for one in octets if one)])


def test_a_capture_that_begins_with_the_answer() -> None:
    talk = Talk()
    talk.packet(SERVER)
    for _ in range(2):
        probe(talk)
    assert idle(talk) == said(2)


def test_numbers_at_their_limit() -> None:
    talk = Talk()
    talk.seq[CLIENT] = 0  # the number before it is the highest there is
    for _ in range(2):
        probe(talk)
    assert idle(talk) == said(2)


def test_a_packet_captured_twice_is_one_probe() -> None:
    talk = Talk()
    for _ in range(2):
        talk.packet(CLIENT, seq=talk.seq[CLIENT] - 1, after_ns=PAUSE)
        talk.packet(CLIENT, seq=talk.seq[CLIENT] - 1)
        talk.packet(SERVER)
    assert idle(talk) == said(2)


@each("octets", [b"", b"\0", b"\x42"])
def test_probes_behind_a_handshake(octets: bytes) -> None:
    talk = Talk()
    talk.hello()
    for _ in range(2):
        probe(talk, CLIENT, octets)
    assert idle(talk) == said(2, "all" if octets else "none")


@each("octets", [b"", b"\0"])
@each("hello", [False, True])
def test_it_names_the_first_and_the_last_probe_of_the_connection(octets: bytes, hello: bool) -> None:
    talk = Talk()
    if hello:
        talk.hello()
    first = int(talk.pipeline.frames) + 1
    for _ in range(3):
        probe(talk, CLIENT, octets)
    last, last_ns = int(talk.pipeline.frames) - 1, talk.now_ns - MS
    other = Talk(client_port=50001, beside=talk)
    other.open()
    other.ask(read(1, dbw(1, 0)))
    assert idle(talk) == said(3, "all" if octets else "none")
    (finding,) = [finding for finding in talk.findings if finding.slug == "session.idle"]
    assert finding.frames == [first, last]
    assert finding.time_ns == last_ns


def test_it_ends_with_the_connection() -> None:
    for flags in (FIN | ACK, RST, SYN):
        talk = Talk()
        for _ in range(2):
            probe(talk)
        assert talk.slugs() == []
        talk.packet(CLIENT, flags=flags)
        assert talk.slugs() == ["session.idle"]
        assert idle(talk) == said(2)


# ---- what is no silent connection -----------------------------------------------------------------------------------


def once(talk: Talk) -> None:
    probe(talk)  # may be what is left of a FIN that was not captured


def acknowledgements(talk: Talk) -> None:
    for _ in range(3):
        talk.packet(CLIENT, after_ns=PAUSE)
        talk.packet(SERVER)


def one_direction(talk: Talk) -> None:
    for _ in range(3):
        talk.packet(CLIENT, seq=talk.seq[CLIENT] - 1, after_ns=PAUSE)


def too_fast(talk: Talk) -> None:
    for _ in range(3):
        probe(talk, after_ns=SECOND // 100)


def what_was_sent_is_not_in_the_capture(talk: Talk) -> None:
    for _ in range(3):
        talk.seq[CLIENT] += 100  # as the other side says
        probe(talk)


def far_from_what_is_acknowledged(talk: Talk) -> None:
    for _ in range(3):
        talk.packet(CLIENT, seq=talk.seq[CLIENT] - 2, after_ns=PAUSE)
        talk.packet(SERVER)


def a_handshake_and_nothing_else(talk: Talk) -> None:
    talk.hello()
    talk.packet(CLIENT)
    talk.packet(SERVER)


@each(
    "scene",
    [
        once,
        acknowledgements,
        one_direction,
        too_fast,
        what_was_sent_is_not_in_the_capture,
        far_from_what_is_acknowledged,
        a_handshake_and_nothing_else,
    ],
)
def test_no_silent_connection(scene) -> None:  # type: ignore[no-untyped-def]
    talk = Talk()
    scene(talk)
    assert idle(talk) == []


def test_other_ports_are_not_watched() -> None:
    talk = Talk(server_port=1102)
    for _ in range(3):
        probe(talk)
    assert idle(talk) == []


@each("octets", [b"", b"\0", b"\x27"])
def test_what_speaks_after_all_is_read(octets: bytes) -> None:
    talk = Talk()
    for _ in range(2):
        probe(talk, CLIENT, octets)
    for number in range(1, 4):
        talk.packet(CLIENT, dt(read(number, dbw(1, 0))))
    assert idle(talk) == []
    assert [transaction.function for transaction in talk.transactions] == [4, 4, 4]


# ---- the bound ------------------------------------------------------------------------------------------------------


def test_at_most_so_many_are_watched() -> None:
    talk = Talk()
    for _ in range(2):
        probe(talk)
    for port in range(1, MAX_SILENT + 3):
        talk.ports[CLIENT] = port + (port > 101)
        talk.packet(CLIENT)
    # The first one had sent probes, so it is told; of the next two nothing is known.
    assert talk.slugs() == ["session.idle", "stream.evicted"]
    assert talk.pipeline.finding_counts == {"session.idle": 1, "stream.evicted": 2}


@each("size", [4, 16])
@each("vlan", [b"", bytes(7) + b"\x05"])
def test_keys_of_every_form(size: int, vlan: bytes) -> None:
    reporter = Reporter()
    counters = Counters(reporter)
    watch = SilentConnections(counters)
    key = bytes(range(size)) + bytes(range(size, 0, -1)) + (50000).to_bytes(2, "big") + (102).to_bytes(2, "big") + vlan
    other = key.replace((102).to_bytes(2, "big") + vlan, (103).to_bytes(2, "big") + vlan)
    for _ in range(2):
        counters.now_ns += PAUSE
        for one in (key, other):
            watch.take(one, 99, 500)
            watch.take(reverse_key(one), 500, 100)
    watch.finish()
    assert reporter.counts == {"session.idle": 1}


# ---- numbers that change --------------------------------------------------------------------------------------------


@each("side", [CLIENT, SERVER])
@each("before", [1, 2])
def test_an_acknowledgement_that_changes_shows_that_something_was_sent(side: int, before: int) -> None:
    """By either side: the connection is not silent, however many probes follow or came before."""
    talk = Talk()
    for _ in range(before):
        probe(talk)
    talk.acked[side] = talk.seq[1 - side] + 1
    for _ in range(3):
        probe(talk)
    assert idle(talk) == []


@each(("distance", "silent"), [(-1, True), (-2, False), (1, False), (-100, False), (5000, False)])
def test_a_probe_has_the_number_before_the_next_one(distance: int, silent: bool) -> None:
    """As the other side acknowledges it, before or behind."""
    for answer_first in (False, True):
        talk = Talk()
        if answer_first:
            talk.packet(SERVER)
        for _ in range(3):
            talk.packet(CLIENT, seq=talk.seq[CLIENT] + distance, after_ns=PAUSE)
            talk.packet(SERVER)
        assert idle(talk) == (said(3) if silent else [])


@each("sent", [1, 5, 100])
def test_octets_that_were_sent_before_the_first_acknowledgement_are_no_silence(sent: int) -> None:
    """The first packet of one side, and what the other side acknowledges behind it, do not fit each other."""
    talk = Talk()
    talk.packet(CLIENT, seq=talk.seq[CLIENT] - 1 - sent)
    for _ in range(3):
        talk.packet(SERVER)
        talk.packet(CLIENT, seq=talk.seq[CLIENT] - 1, after_ns=PAUSE)
    assert idle(talk) == []
    talk = Talk()
    talk.packet(CLIENT, seq=talk.seq[CLIENT] - 1)
    for _ in range(3):
        talk.packet(SERVER)
        talk.packet(CLIENT, seq=talk.seq[CLIENT] - 1, after_ns=PAUSE)
    assert idle(talk) == said(4)


def test_an_acknowledgement_between_probes_is_no_probe() -> None:
    talk = Talk()
    for _ in range(3):
        probe(talk)
        talk.packet(CLIENT)
    assert idle(talk) == said(3)


def test_packets_before_the_other_side_is_seen_have_to_be_alike() -> None:
    """What was counted as probes were acknowledgements, when the other side acknowledges just this number."""
    talk = Talk()
    talk.acked[CLIENT] = talk.seq[SERVER]
    for _ in range(3):
        talk.packet(CLIENT, after_ns=PAUSE)
    for _ in range(2):
        probe(talk, SERVER)
    assert idle(talk) == said(2)
    talk = Talk()
    for seq in (-1, 0):
        talk.packet(CLIENT, seq=talk.seq[CLIENT] + seq, after_ns=PAUSE)
    for _ in range(3):
        probe(talk)
    assert idle(talk) == []


@each(("pause_ms", "count"), [(899, 2), (900, 4), (901, 4)])
def test_probes_are_a_second_apart_or_a_little_less(pause_ms: int, count: int) -> None:
    talk = Talk()
    for _ in range(4):
        talk.packet(CLIENT, seq=talk.seq[CLIENT] - 1, after_ns=pause_ms * MS)
        talk.packet(SERVER, after_ns=0)
    assert idle(talk) == said(count)


def test_one_probe_of_each_side_is_not_enough() -> None:
    """Each may be what is left of a FIN."""
    talk = Talk()
    probe(talk, CLIENT)
    probe(talk, SERVER)
    assert idle(talk) == []
    for sides in ((CLIENT, CLIENT, SERVER), (CLIENT, SERVER, SERVER)):
        talk = Talk()
        for side in sides:
            probe(talk, side)
        assert idle(talk) == said(3)


@each("port", [102, 103])
@each("swapped", [False, True])
def test_a_connection_of_port_102_is_watched_whichever_side_is_captured_first(port: int, swapped: bool) -> None:
    talk = Talk(port, 50000) if swapped else Talk(50000, port)
    for _ in range(2):
        probe(talk)
    talk.finish()
    assert talk.slugs() == (["session.idle"] if port == 102 else [])
    if port == 102:
        (finding,) = talk.findings
        client, server = ("10.0.0.2", "10.0.0.1") if swapped else ("10.0.0.1", "10.0.0.2")
        assert (finding.client, finding.server) == (client, server)
        assert finding.detail.startswith(f"{client}:50000 and {server}:102: 2 probes")


def test_probes_before_a_connection_speaks_are_told_where_it_says_nothing_after_all() -> None:
    """The probes that were empty and those with a byte are of one connection."""
    talk = Talk()
    for octets in (b"", b"", b"\0", b"\0"):
        probe(talk, CLIENT, octets)
    assert idle(talk) == said(4, "2 of them")
    # Where empty ones are not certain to be probes, those with a byte count with them all the same.
    talk = Talk()
    for octets in (b"", b"\0"):
        probe(talk, CLIENT, octets)
    assert idle(talk) == said(2, "1 of them")


def test_numbers_that_changed_before_leave_no_probes_to_a_connection_that_speaks() -> None:
    talk = Talk()
    probe(talk)
    talk.acked[SERVER] = talk.seq[CLIENT] + 9
    probe(talk)
    talk.acked[SERVER] = None
    probe(talk, CLIENT, b"\0")
    assert idle(talk) == ["10.0.0.1:50000 and 10.0.0.2:102: 1 probe, with a byte"]


def test_the_connection_whose_last_packet_is_oldest_is_forgotten_first() -> None:
    talk = Talk()
    for port in (50000, 50001):
        talk.ports[CLIENT] = port
        for _ in range(2):
            probe(talk)
    talk.ports[CLIENT] = 50000
    probe(talk)  # now the other one is the oldest
    for port in range(1, MAX_SILENT + 1):
        talk.ports[CLIENT] = port + (port > 101)
        talk.packet(CLIENT, after_ns=0)
        if talk.findings:
            break
    assert port == MAX_SILENT - 1
    (finding,) = talk.findings
    assert finding.detail == "10.0.0.1:50001 and 10.0.0.2:102: 2 probes, none with a byte"


def test_a_forgotten_connection_of_which_something_is_known_is_no_loss() -> None:
    """Its numbers moved, so that it would not have been reported."""
    talk = Talk()
    talk.packet(CLIENT)
    talk.packet(SERVER)
    talk.packet(CLIENT, seq=talk.seq[CLIENT] - 9)
    for port in range(1, MAX_SILENT + 2):
        talk.ports[CLIENT] = port + (port > 101)
        talk.packet(CLIENT, after_ns=0)
    assert talk.pipeline.finding_counts == {"stream.evicted": 1}  # of the two that are forgotten


def test_a_probe_with_any_octet_is_one_only_where_nothing_else_is_known() -> None:
    """Behind other octets of its connection only a zero octet is a keep-alive; on other ports it is never counted."""
    for port, octet, kept in ((102, b"\x27", True), (102, b"\0", True), (80, b"\x27", False), (80, b"\0", True)):
        talk = Talk(server_port=port)
        talk.packet(CLIENT, octet, seq=talk.seq[CLIENT] - 1)
        assert talk.pipeline.counters.packet_counts()["keep_alive"] == kept, (port, octet)
    for octet, kept in ((b"\x27", False), (b"\0", True)):
        talk = Talk()
        talk.packet(SERVER, b"GET / HTTP/1.0\r\n")
        talk.packet(CLIENT, octet, seq=talk.seq[CLIENT] - 1)
        assert talk.pipeline.counters.packet_counts()["keep_alive"] == kept


def test_two_octets_are_no_probe() -> None:
    talk = Talk()
    talk.packet(CLIENT, b"\0\0", seq=talk.seq[CLIENT] - 1)
    assert talk.pipeline.counters.packet_counts()["keep_alive"] == 0
