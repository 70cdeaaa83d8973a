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
