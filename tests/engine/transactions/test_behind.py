"""What lies behind TPDU headers that cannot hold a DT of class 0: counted apart, judged for security, paired by evidence."""

from __future__ import annotations

import struct
from collections.abc import Callable

import pytest

from dissect.engine.transactions.aside import MAX_ASIDE, MAX_OCTETS
from dissect.engine.transactions.transaction import MALFORMED_HEADER, REASON_TEXTS, Transaction
from dissect.protocols.s7plus.tables import SET_VARIABLE
from dissect.protocols.s7plus.value_tables import DINT
from dissect.protocols.s7plus.values import Value
from tests import build
from tests.cases import each
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    MS,
    SECOND,
    SERVER,
    Talk,
    ack_data,
    dbw,
    dt,
    good,
    item,
    job,
    read,
    refused,
    setup,
    words,
    write,
    written,
)
from tests.protocols.s7plus import bodies, pdus

STOP = b"\x29" + bytes(5) + b"\x09P_PROGRAM"
#: Headers that cannot hold a DT of class 0, and one that reaches beyond any TPKT here.
HEADERS = (
    b"\x00\xf0\x80",
    b"\x01\xf0\x80",
    b"\xff\xf0\x80",
    b"\xfe\xf0\x80",
    b"\x00\xf0\x00",
    b"\x00\xe0\x80",
    b"\x01\xf0",
)
MARK = "behind a malformed TPDU header"


def behind(pdu: bytes, header: bytes = HEADERS[0]) -> bytes:
    return build.tpkt(header + pdu)


def stop(pdu_ref: int) -> bytes:
    return job(pdu_ref, STOP)


def ready(jobs: int = 1) -> Talk:
    talk = Talk()
    talk.open(jobs, jobs)
    return talk


def marked(talk: Talk) -> list[tuple[str, str]]:
    """Outcome and reason of the transactions with a mark."""
    return [(one.outcome, one.reason) for one in talk.transactions if one.is_behind]


ALONE = ("behind_malformed", "malformed_header")
PAIR = ("answered", "malformed_header")


@each("header", HEADERS)
def test_a_stop_is_told_and_opens_nothing(header: bytes) -> None:
    talk = ready()
    frame = talk.packet(CLIENT, behind(stop(9), header))
    for ref in range(1, 4):
        talk.ask(read(ref, dbw(1, 0)))
        talk.tell(words(ref, 1))
    talk.close()
    assert sorted(talk.slugs()) == ["cotp.malformed", "security.plc_stop"]
    (finding,) = [one for one in talk.findings if one.slug == "security.plc_stop"]
    assert finding.frames == [frame]
    assert finding.detail == f"10.0.0.1:50000 to 10.0.0.2:102: PLC stop, not answered, {MARK}"
    assert marked(talk) == [ALONE]
    assert [one.outcome for one in talk.transactions if not one.is_behind] == ["answered"] * 3
    (connection,) = talk.connections
    assert (connection.pdus, connection.behind) == (8, 1)
    assert (connection.answered, connection.unanswered, connection.unsolicited, connection.orphans) == (4, 0, 0, 0)
    assert [one.kind for one in talk.operations] == ["connect"]
    assert (talk.pipeline.s7.pdus, talk.pipeline.s7.behind_malformed) == (8, 1)


def fed(how: str, talk: Talk, octets: bytes) -> None:
    """Let the client send octets as one segment, octet by octet, or with others before or after them."""
    if how == "whole":
        talk.packet(CLIENT, octets)
    elif how == "octet by octet":
        for at in range(len(octets)):
            talk.packet(CLIENT, octets[at : at + 1])
    elif how == "behind a read":
        talk.packet(CLIENT, dt(read(70, dbw(1, 0))) + octets)
        talk.tell(words(70, 1))
    else:
        talk.packet(CLIENT, octets + dt(read(71, dbw(1, 0))))
        talk.tell(words(71, 1))


WAYS = ("whole", "octet by octet", "behind a read", "before a read")


@each("li", range(256))
def test_every_length_indicator_over_every_way_it_comes(li: int) -> None:
    """The same PDU, of which 29 octets of TPDU remain: it is told once, apart where the header holds no DT, else as ever."""
    for eot in (0x80, 0x00):
        octets = behind(stop(9), bytes((li, 0xF0, eot)))
        holds = 2 <= li < len(octets) - 4
        said = []
        for way in WAYS if li in (0, 1, 2, 3, 28, 29, 255) else WAYS[:1]:
            talk = ready()
            fed(way, talk, octets)
            talk.ask(read(1, dbw(1, 0)))
            talk.tell(words(1, 1))
            talk.close()
            stops = [one for one in talk.transactions if one.function_name == "PLC stop"]
            told = [one for one in talk.findings if one.slug == "security.plc_stop"]
            limits = [slug for slug in talk.slugs() if slug.startswith(("session.", "transaction."))]
            said.append(([one.outcome for one in stops], len(told), limits))
            others = [one.outcome for one in talk.transactions if one not in stops]
            assert set(others) == {"answered"}, (li, way)
        if not holds:
            assert said[0] == (["behind_malformed"], 1, [])
        elif eot:
            assert said[0][:2] == (["unanswered"], 1)
        else:
            assert len(said[0][0]) <= 1
        if eot or not holds:
            assert all(one[:2] == said[0][:2] for one in said), (li, said)


@each(("header", "shape"), [(header, shape) for header in HEADERS for shape in range(4)])
def test_one_that_is_answered_is_a_marked_transaction(header: bytes, shape: int) -> None:
    requests = (read(9, dbw(1, 0)), read(9, dbw(1, 0)), write(9, [dbw(1, 0)], written(4, b"\0\1")), stop(9))
    answers = (
        words(9, 7),
        ack_data(9, b"\x04\x01", refused(0x0A)),
        ack_data(9, b"\x05\x01", b"\xff"),
        ack_data(9, b"\x29"),
    )
    talk = ready()
    asked = talk.packet(CLIENT, behind(requests[shape], header))
    told = talk.tell(answers[shape])
    talk.close()
    (one,) = talk.transactions
    assert (one.outcome, one.reason, one.frames) == (*PAIR, [asked, told])
    assert one.certainty == "sure"
    (connection,) = talk.connections
    assert (connection.answered, connection.orphans, connection.behind) == (2, 0, 1)
    security = [finding.detail for finding in talk.findings if finding.slug.startswith("security.")]
    assert all(detail.endswith(MARK) for detail in security)
    assert len(security) == (shape >= 2)
    if shape == 3:
        assert ", accepted, " in security[0]
        assert [operation.kind for operation in talk.operations] == ["connect", "control"]


def test_an_ordinary_request_of_that_reference_goes_first() -> None:
    """Before or after the one behind a malformed header, and once it is answered, the other one has its turn."""
    for order in ((True, False), (False, True)):
        talk = ready()
        for ordinary in order:
            talk.packet(CLIENT, dt(read(9, dbw(1, 0))) if ordinary else behind(read(9, dbw(1, 2))))
        talk.tell(words(9, 7))
        talk.close()
        assert sorted([(one.outcome, one.is_behind) for one in talk.transactions]) == [
            ("answered", False), ("behind_malformed", True),
        ]  # fmt: skip
        talk = ready()
        for ordinary in order:
            talk.packet(CLIENT, dt(read(9, dbw(1, 0))) if ordinary else behind(read(9, dbw(1, 2))))
        talk.tell(words(9, 7))
        talk.tell(words(9, 8))
        talk.close()
        assert [(one.outcome, one.is_behind) for one in talk.transactions] == [
            ("answered", False),
            ("answered", True),
        ]
        assert talk.slugs().count("transaction.orphan") == 0


def test_an_answer_to_something_else_belongs_to_none() -> None:
    """Another reference, another function, another number of items; and one that came before it."""
    for answer in (words(8, 1), ack_data(9, b"\x05\x01", b"\xff"), ack_data(9, b"\x04\x02", good(4, b"\0\1") * 2)):
        talk = ready()
        talk.packet(CLIENT, behind(read(9, dbw(1, 0))))
        talk.tell(answer)
        talk.close()
        assert sorted(talk.outcomes()) == ["behind_malformed", "orphan_answer"]
    talk = ready()
    talk.acked[SERVER] = talk.seq[CLIENT]  # the server had nothing of it yet
    talk.packet(CLIENT, behind(read(9, dbw(1, 0))))
    talk.tell(words(9, 1))
    talk.close()
    assert sorted(talk.outcomes()) == ["behind_malformed", "orphan_answer"]


def test_no_limit_is_broken() -> None:
    """Longer than the granted PDU, more than the granted jobs, an answer too long, before the setup: nothing is told of it."""
    talk = Talk()
    talk.hello()
    talk.connect()
    talk.packet(CLIENT, behind(read(1, dbw(1, 0))))
    talk.packet(CLIENT, behind(setup(2, 8, 8, 960)))
    talk.ask(setup(0, 1, 1, 240))
    talk.tell(build.pdu(build.ACK_DATA, 0, build.setup_block(1, 1, 240)))
    talk.packet(CLIENT, behind(write(3, [dbw(1, 0, 300)], written(4, bytes(600)))))
    talk.packet(CLIENT, behind(read(4, dbw(1, 0, 300))))
    for ref in range(10, 16):
        talk.packet(CLIENT, behind(read(ref, dbw(1, 0))))
        talk.ask(read(ref + 20, dbw(1, 0)))
        talk.tell(words(ref + 20, 1))
    talk.close()
    assert set(talk.slugs()) == {"cotp.malformed", "security.write"}
    assert marked(talk) == [ALONE] * 10
    (connection,) = talk.connections
    assert connection.pdu_length == 240
    assert connection.open_at_end == 0


def test_what_waits_is_bounded() -> None:
    talk = ready()
    for ref in range(1, 50):
        talk.packet(CLIENT, behind(read(ref, dbw(1, 0))))
    assert len(marked(talk)) == 49 - MAX_ASIDE
    talk.tell(words(49, 1))
    talk.tell(words(1, 1))  # was given up: too many came after it
    talk.close()
    assert marked(talk) == [*[ALONE] * (49 - MAX_ASIDE), PAIR, *[ALONE] * (MAX_ASIDE - 1)]
    talk = ready()
    large = write(1, [item(0x84, 1, 0, 2, 28_000)], written(9, bytes(28_000)))
    for _ in range(5):
        talk.packet(CLIENT, behind(large))
    aside = talk.transactions[0].connection._aside
    assert aside is not None
    assert aside.octets <= MAX_OCTETS
    assert len(marked(talk)) == 3
    talk.close()


def test_time_ends_the_wait() -> None:
    for seconds, ends in ((9, False), (11, True)):
        talk = ready()
        talk.packet(CLIENT, behind(read(9, dbw(1, 0))))
        talk.silence(seconds * SECOND)
        assert (marked(talk) == [ALONE]) is ends
        talk.tell(words(9, 1))
        talk.close()
        assert marked(talk) == [ALONE if ends else PAIR]


@pytest.mark.parametrize("header", HEADERS)
def test_an_answer_completes_a_request_when_nothing_better_comes(header: bytes) -> None:
    talk = ready()
    asked = talk.ask(read(9, dbw(1, 0)))
    told = talk.packet(SERVER, behind(words(9, 7), header))
    talk.silence(2 * SECOND)
    (one,) = talk.transactions
    assert (one.outcome, one.reason, one.frames) == (*PAIR, [asked, told])
    assert one.latency_ns == MS
    talk.close()
    assert talk.slugs() == ["cotp.malformed"]


def test_a_proper_answer_is_better() -> None:
    """The one behind the malformed header may be there to mislead; it is listed by itself."""
    talk = ready()
    talk.ask(read(9, dbw(1, 0)))
    talk.packet(SERVER, behind(words(9, 7)))
    talk.tell(words(9, 8))
    talk.close()
    assert [(one.outcome, one.is_behind) for one in talk.transactions] == [
        ("answered", False), ("behind_malformed", True),
    ]  # fmt: skip
    assert talk.transactions[0].s7_results[0].value == 8
    assert talk.slugs() == ["cotp.malformed"]


def test_a_client_that_goes_on_took_the_answer() -> None:
    """A server all of whose headers are wrong is read as its client reads it; no limit of jobs is broken."""
    talk = ready()
    for ref in range(1, 8):
        talk.ask(read(ref, dbw(1, 0)))
        talk.packet(SERVER, behind(words(ref, ref)))
    talk.close()
    assert [(one.outcome, one.is_behind) for one in talk.transactions] == [("answered", True)] * 7
    assert [one.s7_results[0].value for one in talk.transactions] == list(range(1, 8))
    assert set(talk.slugs()) == {"cotp.malformed"}
    (connection,) = talk.connections
    assert (connection.unanswered, connection.open_at_end) == (0, 0)


def test_both_halves_behind_malformed_headers() -> None:
    talk = ready()
    for ref in range(1, 4):
        talk.packet(CLIENT, behind(read(ref, dbw(1, 0))))
        talk.packet(SERVER, behind(words(ref, ref)))
    talk.close()
    assert marked(talk) == [PAIR] * 3
    assert set(talk.slugs()) == {"cotp.malformed"}


def test_a_push_is_judged_and_counted_apart() -> None:
    talk = ready()
    mode = build.userdata_head(0, 0, 0, 0)  # a PLC reports STOP
    talk.packet(SERVER, behind(build.pdu(build.USERDATA, 0, mode, build.payload(b""))))
    talk.close()
    assert marked(talk) == [ALONE]
    (connection,) = talk.connections
    assert connection.unsolicited == 0
    (finding,) = [one for one in talk.findings if one.slug == "security.stopped"]
    assert finding.detail.startswith("10.0.0.2:102 reports to 10.0.0.1:50000: mode STOP")
    assert finding.detail.endswith(MARK)


def test_a_write_says_nothing_of_later_ones() -> None:
    """One that nobody answered is told, and the first one that is certain is told after it."""
    talk = ready()
    outputs = item(0x82, 0, 0, 4)
    talk.packet(CLIENT, behind(write(1, [outputs], written(4, b"\0\1"))))
    talk.silence(20 * SECOND)
    talk.ask(write(2, [outputs], written(4, b"\0\2")))
    talk.tell(ack_data(2, b"\x05\x01", b"\xff"))
    talk.close()
    told = [one.detail.partition(": ")[2] for one in talk.findings if one.slug == "security.write_outputs"]
    assert told == [f"Write Var QW0 = 1, not answered, {MARK}", "Write Var QW0 = 2"]


def test_octets_behind_it_hide_nothing() -> None:
    for header in HEADERS[:4]:
        for more in (b"\0", bytes(100), dt(read(1, dbw(1, 0)))[:20]):
            talk = ready()
            talk.packet(CLIENT, behind(stop(9) + more, header))
            talk.ask(read(1, dbw(1, 0)))
            talk.tell(words(1, 1))
            talk.close()
            assert sorted(set(talk.slugs())) == ["cotp.malformed", "s7.malformed", "security.plc_stop"]
            assert sorted(talk.outcomes()) == ["answered", "behind_malformed"]


def test_an_unknown_rosctr_is_counted() -> None:
    talk = ready()
    talk.packet(CLIENT, behind(struct.pack(">BBHHHH", 0x32, 5, 0, 1, 0, 0)))
    talk.close()
    assert sorted(talk.slugs()) == ["cotp.malformed", "s7.unknown_rosctr"]
    assert talk.transactions == []
    assert talk.pipeline.s7.behind_malformed == 1


# ---- S7comm-plus ----------------------------------------------------------------------------------------------------


def begun() -> Talk:
    talk = Talk()
    talk.hello()
    talk.connect()
    return talk


def plus_stop(sequence: int) -> bytes:
    body = bodies.set_variable(52, [2167], Value(0, DINT, 1))
    return pdus.framed(pdus.asked(sequence, SET_VARIABLE, body=body), 3)


@each("header", HEADERS)
def test_a_stop_of_an_s7_1500(header: bytes) -> None:
    for answers in (False, True):
        talk = begun()
        talk.packet(CLIENT, behind(plus_stop(5), header))
        if answers:
            talk.tell(pdus.framed(pdus.told(5, SET_VARIABLE, b"\0" + bodies.end(9)), 3))
        talk.close()
        assert marked(talk) == [PAIR if answers else ALONE]
        (finding,) = [one for one in talk.findings if one.slug == "security.plc_stop"]
        result = "accepted" if answers else "not answered"
        assert finding.detail.endswith(f"operating state request 1 STOP, {result}, {MARK}")
        assert set(talk.slugs()) == {"cotp.malformed", "security.plc_stop"}
        assert talk.pipeline.plus.behind_malformed == 1


def test_frames_of_a_pdu_are_not_joined_with_what_is_behind_a_malformed_header() -> None:
    data = pdus.asked(1, pdus.GET_MULTI, body=bytes(40))
    talk = begun()
    talk.packet(CLIENT, dt(pdus.framed(data[:30], 2, trailer=False)))
    talk.packet(CLIENT, behind(pdus.framed(data[30:], 2)))
    talk.packet(CLIENT, dt(pdus.framed(data[30:], 2)))
    talk.close()
    assert [
        one.plus_request.frames for one in talk.transactions if one.plus_request is not None and not one.is_behind
    ] == [2]


# ---- captures with gaps and other surroundings ----------------------------------------------------------------------


def test_behind_a_gap_and_before_one() -> None:
    talk = ready()
    talk.lose(CLIENT, read(1, dbw(1, 0)))
    talk.packet(CLIENT, dt(read(2, dbw(1, 0))) + behind(stop(9)))
    talk.packet(SERVER, flags=ACK)
    for _ in range(12):
        talk.packet(CLIENT, flags=ACK)
        talk.packet(SERVER, flags=ACK)
    talk.lose(SERVER, words(1, 1))
    talk.ask(read(3, dbw(1, 0)))
    talk.tell(words(3, 3))
    talk.close()
    assert marked(talk) == [ALONE]
    assert "security.plc_stop" in talk.slugs()


def test_a_connection_with_nothing_else() -> None:
    talk = begun()
    talk.packet(CLIENT, behind(stop(9)))
    talk.finish()
    (connection,) = talk.connections
    assert (connection.pdus, connection.behind, connection.protocol) == (0, 1, "s7comm")
    assert marked(talk) == [ALONE]


@pytest.mark.parametrize("reset", [True, False])
def test_each_pdu_ends_in_one_transaction(reset: bool) -> None:
    """Whatever waits when the connection ends."""
    talk = ready(3)
    talk.packet(CLIENT, behind(stop(9)))
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(SERVER, behind(words(1, 1)))
    talk.packet(SERVER, behind(words(2, 1)))
    if reset:
        talk.packet(SERVER, flags=4)
        talk.finish()
    else:
        talk.close()
    halves = sum(bool(one.request_frame) + bool(one.response_frame) for one in talk.transactions)
    assert halves == 4
    assert sorted(talk.outcomes()) == ["answered", "behind_malformed", "behind_malformed"]
    assert len({one.number for one in talk.transactions}) == 3


CHECKS: tuple[Callable[[Transaction], object], ...] = (
    lambda one: one.missed,
    lambda one: one.failed,
    lambda one: one.unseen,
    lambda one: one.latency_ns,
    lambda one: one.certainty,
)


def test_nobody_misses_an_answer() -> None:
    talk = ready()
    talk.packet(CLIENT, behind(read(9, dbw(1, 0))))
    talk.close()
    (one,) = talk.transactions
    assert not any(check(one) for check in CHECKS)
    assert one.reason == "malformed_header"


@pytest.mark.parametrize(("jobs", "taken"), [(0, 1), (1, 1), (2, 2), (3, 3)])
def test_a_client_takes_such_answers_when_it_has_more_open_than_it_may(jobs: int, taken: int) -> None:
    """One, where it is not known how many that are (0). Each answer waits while the client may still get a better one."""
    talk = ready(jobs) if jobs else Talk()
    if not jobs:
        talk.hello()
        talk.connect()
    pairs = []
    for ref in range(1, 5):
        talk.ask(read(ref, dbw(1, 0)))
        pairs.append(len([one for one in talk.transactions if one.is_behind]))
        if ref == 1:
            talk.packet(SERVER, behind(words(1, 1)))
    assert pairs.index(1) == taken


def test_a_request_whose_answer_was_captured_before_it() -> None:
    """The answer acknowledges it, and is ordinary."""
    talk = ready(8)
    request = behind(read(9, dbw(1, 0)))
    talk.acked[SERVER] = talk.seq[CLIENT] + len(request)
    answered = talk.tell(words(9, 5))
    talk.acked[SERVER] = None
    asked = talk.packet(CLIENT, request)
    talk.close()
    assert [pair for pair in talk.pairs() if asked in pair] == [(asked, answered)]
    assert marked(talk) == [PAIR]


def test_a_request_that_wants_no_answer_waits_for_none() -> None:
    talk = Talk()
    talk.open()
    frame = pdus.framed(
        pdus.asked(1, SET_VARIABLE, flags=0x74, body=bodies.set_variable(52, [1], Value(0, DINT, 1))), 1
    )
    talk.packet(CLIENT, behind(frame))
    assert marked(talk) == [ALONE]
    (one,) = [one for one in talk.transactions if one.is_behind]
    assert (one.missed, one.reason_text) == (False, REASON_TEXTS[MALFORMED_HEADER])
    talk.close()
    assert marked(talk) == [ALONE]


def test_what_waits_on_one_connection_is_not_that_of_another() -> None:
    talk = ready()
    other = Talk(50001, beside=talk)
    other.open()
    talk.packet(CLIENT, behind(read(9, dbw(1, 0))))
    other.packet(SERVER, behind(words(9, 1)))
    other.tell(words(9, 2))
    talk.tell(words(9, 3))
    talk.close()
    assert [one.response_frame > 0 for one in talk.transactions if one.is_behind and one.request_frame] == [True]
    pair = next(one for one in talk.transactions if one.is_behind and one.request_frame)
    assert pair.s7_results[0].value == 3


@pytest.mark.parametrize(
    ("packets", "pause_ms", "waits"), [(49, 0, True), (52, 0, False), (1, 900, True), (1, 1100, False)]
)
def test_an_answer_waits_a_second_or_fifty_packets_for_a_better_one(packets: int, pause_ms: int, waits: bool) -> None:
    talk = ready(8)
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(SERVER, behind(words(1, 1)))
    talk.wait(pause_ms * MS)
    for _ in range(packets):
        talk.packet(CLIENT, after_ns=1000)
    talk.pipeline.tick(talk.now_ns)
    assert bool(marked(talk)) is not waits


def test_a_request_of_the_other_side_with_that_reference_changes_nothing() -> None:
    """References of both sides are independent."""
    talk = ready(8)
    talk.tell(job(9, b"\x1b" + bytes(17)))  # the server asks for a piece of a block
    asked = talk.packet(CLIENT, behind(read(9, dbw(1, 0))))
    answered = talk.tell(words(9, 1))
    assert talk.pairs() == [(asked, answered)]
    assert marked(talk) == [PAIR]
