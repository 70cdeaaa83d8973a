"""S7comm PDUs, from any transport, to requests and answers: their counts, their limits, and those that are damaged or odd."""

from __future__ import annotations

import pytest

from dissect.engine.findings.security_rules import PACE
from dissect.engine.transactions.side import Side
from tests import build
from tests.cases import each
from tests.engine.transactions.talk import (
    CLIENT,
    MS,
    SECOND,
    SERVER,
    START_NS,
    Talk,
    ack,
    ack_data,
    dbw,
    dt,
    good,
    granted,
    head,
    item,
    job,
    read,
    setup,
    userdata,
    words,
    write,
    written,
)

#: Kinds of userdata.
PUSH, REQUEST, RESPONSE = 0, 1, 2
BLOCKS, CPU, TIME = 3, 4, 7


class Seen(Talk):
    """Writes down the PDUs that it gets."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_pdus = True
        self.seen: list[tuple[int, int, bytes, bool]] = []

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        assert time_ns == START_NS + frame * MS  # the time of its packet
        self.seen.append((frame, int(side.index), octets, cut))


def opened(jobs: int = 8, size: int = 480) -> Talk:
    talk = Talk()
    talk.open(jobs, jobs, size)
    return talk


def details(talk: Talk, slug: str) -> list[str]:
    return [one.detail for one in talk.findings if one.slug == slug]


def behind(pdu: bytes) -> bytes:
    """A PDU behind the header of a DT whose length indicator is impossible."""
    return build.tpkt(b"\x00\xf0\x80" + pdu)


def section(talk: Talk) -> object:
    return talk.pipeline.s7.describe()["s7"]


# ---- what an observer gets, and what is counted ---------------------------------------------------------------------


def test_an_observer_gets_each_pdu_once_whatever_it_is() -> None:
    talk = Seen()
    talk.open()
    talk.seen.clear()
    told: list[tuple[int, bytes, bool]] = []
    for side, pdu in (
        (CLIENT, read(1, dbw(1, 0))),
        (SERVER, words(1, 1)),
        (CLIENT, userdata(2, head(REQUEST, TIME, 1))),
        (SERVER, build.pdu(9 % 7 + 2, 1, b"\x04\x00")),  # ROSCTR 4, which nobody knows
        (CLIENT, read(3, dbw(1, 0)) + b"more"),
        (CLIENT, read(4, dbw(1, 0))[:10]),
    ):
        talk.packet(side, dt(pdu))
        told.append((side, pdu, False))
    aside = read(5, dbw(1, 0))
    talk.packet(CLIENT, behind(aside))
    told.append((CLIENT, aside, False))
    whole = read(6, dbw(1, 0))
    talk.packet(CLIENT, dt(whole), cut=9)
    told.append((CLIENT, whole[:-9], True))
    assert [one[1:] for one in talk.seen] == told


def test_the_section_counts_each_pdu_by_kind_and_function() -> None:
    talk = opened()
    assert talk.pipeline.s7.counted() == [(2, "S7 PDU")]
    talk.ask(
        read(1, dbw(1, 0)), write(2, [dbw(1, 0)], written(4, b"\0\1")), job(3, b"\x29" + bytes(5) + b"\x09P_PROGRAM")
    )
    talk.tell(words(1, 1), ack_data(2, b"\x05\x01", b"\xff"), ack(3, 0x8104))
    talk.ask(userdata(4, head(REQUEST, TIME, 1)), userdata(5, head(3, TIME, 1)))
    talk.tell(build.pdu(6, 1, b"\x04\x00"))
    talk.packet(CLIENT, dt(read(6, dbw(1, 0))), cut=4)
    talk.finish()
    assert section(talk) == {
        "pdus": 12,
        "cut": 1,
        "unpaired": 2,  # userdata of a kind that is not used, and a ROSCTR that nobody knows
        "rosctr": {"1": 5, "2": 1, "3": 3, "6": 1, "7": 2},
        "functions": {"0x00": 2, "0x04": 3, "0x05": 2, "0x29": 1, "0xf0": 2},
    }
    assert talk.pipeline.s7.counted() == [(12, "S7 PDU")]
    assert talk.connections[0].pdus == 12


def test_a_pdu_that_is_cut_before_its_parameters_counts_for_no_function() -> None:
    talk = opened()
    talk.packet(CLIENT, dt(read(1, dbw(1, 0))), cut=14)  # its header is left
    talk.finish()
    assert section(talk) == {
        "pdus": 3, "cut": 1, "unpaired": 0, "rosctr": {"1": 2, "3": 1}, "functions": {"0xf0": 2},
    }  # fmt: skip
    assert [(one.function, one.outcome) for one in talk.transactions] == [(-1, "unanswered")]


@pytest.mark.parametrize("cut", [0, 4])
def test_the_first_pdu_names_the_protocol_and_is_judged_by_its_port(cut: int) -> None:
    talk = Talk(server_port=2000)
    talk.hello()
    talk.connect()
    frame = talk.packet(CLIENT, dt(read(1, dbw(1, 0))), cut=cut)
    talk.ask(read(2, dbw(1, 0)))
    talk.finish()
    assert talk.connections[0].protocol == "s7comm"
    found = [(one.detail, one.frames) for one in talk.findings if one.slug == "session.unusual_port"]
    assert found == [("server 10.0.0.2:2000", [frame])]


@each(("first_ms", "second_ms", "floods"), [(999, 2000, True), (1000, 1000, False), (1000, 999, True)])
def test_a_flood_is_2048_pdus_within_a_second(first_ms: int, second_ms: int, floods: bool) -> None:
    """Of both sides together: the first 2048 from the begin of the connection on, and each 2048 after them."""
    talk = opened(64)
    begin_ns = START_NS + MS  # the first packet
    done = 1  # the setup
    for until_ms in (first_ms, second_ms):
        for begin in range(0, PACE // 2, 64):
            if begin + 64 == PACE // 2:
                talk.now_ns = begin_ns + until_ms * MS
            refs = range(begin + done, begin + 64)
            talk.ask(*[read(ref, dbw(1, 0)) for ref in refs], after_ns=0)
            talk.tell(*[words(ref, 1) for ref in refs], after_ns=0)
            done = 0
        begin_ns = talk.now_ns
    assert talk.transactions[0].connection.pdus == 2 * PACE
    within = min(first_ms, second_ms)
    assert (
        details(talk, "security.flood")
        == [f"2048 messages within {within} ms between 10.0.0.1:50000 and 10.0.0.2:102, both directions together"]
        * floods
    )


# ---- limits ---------------------------------------------------------------------------------------------------------


def write_of(size: int, pdu_ref: int = 1) -> bytes:
    """A write request of this size: 28 octets are head, parameters and item head."""
    return write(pdu_ref, [item(0x84, 1, 0, 2, size - 28)], written(4, bytes(size - 28)))


@each("limit", [240, 480])
def test_a_pdu_may_be_as_long_as_negotiated(limit: int) -> None:
    talk = opened(size=limit)
    for size in (limit - 1, limit, limit + 1):
        talk.ask(write_of(size, size))
        talk.tell(ack_data(size, b"\x05\x01", b"\xff"))
    assert details(talk, "session.pdu_too_long") == [f"{limit + 1} bytes, {limit} negotiated"]
    talk.tell(words(7, *range((limit - 18) // 2 + 1)))  # an answer of two octets more
    assert details(talk, "session.pdu_too_long")[1:] == [f"{limit + 2} bytes, {limit} negotiated"]


@each("limit", [240, 480])
def test_an_answer_has_to_fit_as_well(limit: int) -> None:
    """14 octets are its head and parameters, four the head of its item."""
    talk = opened(size=limit)
    for size in (limit - 18, limit - 17):
        talk.ask(read(size, item(0x84, 1, 0, 2, size)))
    assert details(talk, "session.read_too_long") == [
        f"Read Var DB1.DBB0 x{limit - 17}: the answer needs {limit + 1} bytes, {limit} negotiated"
    ]
    assert details(talk, "session.pdu_too_long") == []


def test_without_a_setup_there_is_no_limit() -> None:
    talk = Talk()
    talk.hello()
    talk.connect()
    talk.ask(write_of(900))
    assert {"session.pdu_too_long", "session.read_too_long"}.isdisjoint(talk.slugs())


@each("what", ["s7.malformed", "session.pdu_too_long", "session.read_too_long"])
def test_a_fault_of_a_request_may_be_why_it_has_no_answer(what: str) -> None:
    faulty = {
        "s7.malformed": read(1, dbw(1, 0)) + b"more",
        "session.pdu_too_long": write_of(481),
        "session.read_too_long": read(1, item(0x84, 1, 0, 2, 600)),
    }[what]
    for pdu, explained in ((faulty, True), (read(1, dbw(1, 0)), False)):
        talk = opened()
        talk.ask(pdu)
        talk.wait(20 * SECOND)
        for number in range(5):
            talk.ask(read(10 + number, dbw(1, 0)))
            talk.tell(words(10 + number, 1))
        talk.close()
        (finding,) = [one for one in talk.findings if one.slug == "transaction.unanswered"]
        assert finding.because == (what if explained else "")


@each("limit", [1, 2, 5])
def test_as_many_requests_may_be_open_as_were_granted(limit: int) -> None:
    talk = opened(limit)
    for number in range(limit):
        talk.ask(read(number, dbw(1, 0)))
    assert talk.findings == []
    frame = talk.ask(read(limit, dbw(1, 0)), read(limit + 1, dbw(1, 0)))
    found = [one for one in talk.findings if one.slug == "session.too_many_jobs"]
    assert [(one.detail, one.frames) for one in found] == [
        (f"more requests pending than the {limit} granted (AmQ)", [frame])
    ]
    assert talk.pipeline.finding_counts["session.too_many_jobs"] == 2  # one for each request of the packet


def test_either_side_has_a_limit_of_its_own() -> None:
    """The side that sent the setup calls: as many of its requests may be open as the other side takes."""
    for side, allowed in ((CLIENT, 4), (SERVER, 2)):
        talk = Talk()
        talk.open(calling=2, called=4)
        for number in range(allowed):
            talk.packet(side, dt(read(number, dbw(1, 0))))
        assert "session.too_many_jobs" not in talk.slugs(), side
        talk.packet(side, dt(read(99, dbw(1, 0))))
        assert talk.slugs().count("session.too_many_jobs") == 1


def test_answers_that_may_be_on_their_way_excuse_open_requests() -> None:
    """The client has acknowledged an answer that is not captured so far, or half of one is there."""
    octets = dt(words(1, 1))
    for seen, told in ((b"", False), (octets[:9], False), (None, True)):
        talk = opened(1)
        talk.ask(read(1, dbw(1, 0)))
        talk.acked[CLIENT] = talk.seq[SERVER]
        if seen:
            talk.packet(SERVER, seen)
        elif seen is not None:
            talk.acked[CLIENT] = talk.seq[SERVER] + len(octets)
        talk.ask(read(2, dbw(1, 0)))
        assert ("session.too_many_jobs" in talk.slugs()) is told, seen


def test_a_setup_that_is_not_answered_yet_grants_nothing_new() -> None:
    talk = opened(2)
    talk.ask(setup(7, 8, 8))
    for number in range(2):
        talk.ask(read(number, dbw(1, 0)))
    assert talk.slugs().count("session.too_many_jobs") == 1  # the setup is the third
    talk.tell(granted(7, 8, 8))
    for number in range(2, 8):
        talk.ask(read(number, dbw(1, 0)))
    assert talk.slugs().count("session.too_many_jobs") == 1


# ---- odd headers ----------------------------------------------------------------------------------------------------


@each("redundancy", [0x0001, 0x0100, 0xFFFF])
def test_a_redundancy_id_is_reported_once_for_each_side(redundancy: int) -> None:
    talk = opened()
    for number in range(2):
        talk.ask(build.pdu(build.JOB, number, b"\x04\x01" + dbw(1, 0), redundancy=redundancy))
        talk.tell(build.pdu(build.ACK_DATA, number, b"\x04\x01", good(4, b"\0\1"), redundancy=redundancy))
    assert details(talk, "s7.redundancy_id") == [
        f"0x{redundancy:04x} from 10.0.0.1:50000",
        f"0x{redundancy:04x} from 10.0.0.2:102",
    ]
    assert talk.outcomes() == ["answered"] * 2


@each(
    ("rosctr", "extra"),
    [(build.ACK, b"\x29"), (build.ACK, b"\x29\x00\x00"), (build.ACK, b""), (build.ACK_DATA, b"\x29")],
)
def test_an_ack_has_a_header_and_nothing_else(rosctr: int, extra: bytes) -> None:
    talk = opened()
    talk.ask(job(1, b"\x29" + bytes(5) + b"\x09P_PROGRAM"))
    talk.tell(build.pdu(rosctr, 1, extra))
    expected = [f"{len(extra)} bytes from 10.0.0.2:102"] if rosctr == build.ACK and extra else []
    assert details(talk, "s7.ack_content") == expected


def test_lengths_that_do_not_add_up_are_reported_whatever_the_kind() -> None:
    talk = opened()
    for number, pdu in enumerate((read(1, dbw(1, 0)), userdata(2, head(REQUEST, TIME, 1))), 1):
        talk.ask(pdu + b"x")
        assert len(details(talk, "s7.malformed")) == number
    assert [said.split(": ")[0] for said in details(talk, "s7.malformed")] == [
        "Job from 10.0.0.1:50000",
        "Userdata from 10.0.0.1:50000",
    ]
    talk.ask(read(3, dbw(1, 0)))
    assert len(details(talk, "s7.malformed")) == 2


@each("rosctr", [0, 4, 5, 6, 8, 200])
def test_a_pdu_of_an_unknown_kind_is_reported_by_its_number(rosctr: int) -> None:
    """From 1 to 7 it may be of S7comm; other numbers are those of anything."""
    talk = opened()
    frame = talk.tell(build.pdu(rosctr, 1, b"\x04\x00"))
    known = 1 <= rosctr <= 7
    found = [(one.detail, one.frames) for one in talk.findings if one.slug == "s7.unknown_rosctr"]
    assert found == ([(f"ROSCTR {rosctr}", [frame])] if known else [])
    assert talk.pipeline.s7.unpaired == known
    assert ("session.foreign_on_102" in talk.slugs()) is not known


# ---- userdata -------------------------------------------------------------------------------------------------------


def test_a_push_that_only_plcs_send_is_a_request_of_a_client_all_the_same() -> None:
    talk = opened()
    asked = talk.ask(userdata(1, head(PUSH, TIME, 1)))
    answered = talk.tell(userdata(1, head(RESPONSE, TIME, 1), build.payload(bytes(10))))
    push = talk.tell(userdata(2, head(PUSH, CPU, 3), build.payload(bytes(20))))
    talk.close()
    assert talk.pairs() == [(asked, answered), (0, push)]
    assert talk.outcomes() == ["answered", "unsolicited"]
    found = [(one.detail, one.frames) for one in talk.findings if one.slug == "s7.client_push"]
    assert found == [(talk.transactions[0].function_name, [asked])]


def test_a_push_before_anyone_is_known_as_the_client_is_one() -> None:
    talk = Talk(4000, 4102)
    talk.ask(userdata(1, head(PUSH, TIME, 1)))
    talk.finish()
    assert talk.outcomes() == ["unsolicited"]
    assert "s7.client_push" not in talk.slugs()


@each("cut", [0, 1])
def test_userdata_is_paired_by_its_kind_also_where_it_is_damaged(cut: int) -> None:
    for kind, outcome in ((PUSH, "unsolicited"), (REQUEST, "unanswered"), (RESPONSE, "orphan_answer"), (3, "")):
        talk = opened()
        pdu = userdata(1, head(kind, CPU, 3), build.payload(bytes(20)))
        side = CLIENT if kind == REQUEST else SERVER
        talk.packet(side, dt(pdu), cut=cut)
        talk.close()
        assert talk.outcomes() == ([outcome] if outcome else []), kind
        assert talk.pipeline.s7.unpaired == (kind == 3)


# ---- damaged and cut ------------------------------------------------------------------------------------------------


def test_a_damaged_answer_is_reported_once() -> None:
    """Its contents do not fit either; that is no further finding."""
    talk = opened()
    talk.ask(read(1, dbw(1, 0)))
    octets = words(1, 1)
    talk.tell(octets[:8] + b"\x00\x09" + octets[10:])
    talk.close()
    assert talk.slugs() == ["s7.malformed"]
    (one,) = talk.transactions
    assert (one.outcome, one.certainty, one._flags) == ("answered", "sure", 0)


@each("claimed", [0, 2, 14, 15, 200, 0xFFFF])
def test_a_parameter_length_beyond_the_pdu_ends_with_it(claimed: int) -> None:
    """Of a job with 14 octets of parameters as many are read as are there."""
    talk = opened()
    octets = read(1, dbw(1, 0))
    talk.ask(octets[:6] + claimed.to_bytes(2, "big") + octets[8:])
    talk.tell(words(1, 1))
    talk.close()
    (one,) = talk.transactions
    assert one.outcome == "answered"
    assert one.function == (-1 if claimed == 0 else 4)
    read_all = claimed >= 14
    assert [found.item.address for found in one.s7_results if found.item is not None] == (
        ["DB1.DBW0"] if read_all else []
    )


@each("size", range(2, 12))
def test_a_pdu_without_a_whole_header_is_paired_with_nothing(size: int) -> None:
    """Of userdata nothing is known either before its parameters say whether it asks or answers."""
    for pdu, needs in ((read(1, dbw(1, 0)), 10), (words(1, 1), 12), (userdata(1, head(REQUEST, TIME, 1)), 18)):
        talk = opened()
        talk.ask(pdu[:size])
        talk.close()
        assert talk.pipeline.s7.unpaired == (size < needs)
        assert len(talk.transactions) == (size >= needs)


# ---- behind malformed headers ---------------------------------------------------------------------------------------


@each(
    ("pdu", "outcome"),
    [
        (read(1, dbw(1, 0)), "behind_malformed"),
        (userdata(1, head(REQUEST, TIME, 1)), "behind_malformed"),
        (words(1, 1), "behind_malformed"),
        (ack(1, 0), "behind_malformed"),
        (userdata(1, head(RESPONSE, TIME, 1)), "behind_malformed"),
        (userdata(1, head(PUSH, CPU, 3)), "behind_malformed"),
    ],
)
def test_what_stands_behind_a_malformed_header_is_counted_apart(pdu: bytes, outcome: str) -> None:
    talk = opened()
    frame = talk.packet(CLIENT, behind(pdu))
    talk.close()
    assert [(one.outcome, one.is_behind) for one in talk.transactions] == [(outcome, True)]
    asks = pdu[1] == build.JOB or (pdu[1] == build.USERDATA and pdu[15] >> 6 == REQUEST)
    assert talk.pairs() == [(frame, 0) if asks else (0, frame)]
    s7 = talk.pipeline.s7
    assert (s7.behind_malformed, s7.pdus, s7.unpaired) == (1, 2, 0)
    assert "s7.malformed" not in talk.slugs()
    assert list(s7.describe()["s7"])[:2] == ["pdus", "behind_malformed"]  # type: ignore[call-overload]


@each("rosctr", [4, 5, 6])
def test_an_unknown_kind_behind_a_malformed_header_is_reported(rosctr: int) -> None:
    talk = opened()
    frame = talk.packet(CLIENT, behind(build.pdu(rosctr, 1, b"\x04\x00")))
    talk.close()
    assert [(one.detail, one.frames) for one in talk.findings if one.slug == "s7.unknown_rosctr"] == [
        (f"ROSCTR {rosctr}", [frame])
    ]
    assert (talk.pipeline.s7.unpaired, talk.pipeline.s7.behind_malformed, talk.transactions) == (1, 1, [])


@each("more", [0, 1])
def test_the_contents_behind_a_malformed_header_are_judged_as_well(more: int) -> None:
    """A count of items that are not there is a fault; so is an address that cannot be meant."""
    talk = opened()
    pdu = job(1, bytes((4, 1 + more)) + dbw(1, 0))
    talk.packet(CLIENT, behind(pdu))
    talk.close()
    assert len(details(talk, "s7.malformed")) == more


@each(
    ("request", "answer"),
    [
        (read(1, dbw(1, 0)), words(1, 1)),
        (job(1, b"\x29" + bytes(5) + b"\x09P_PROGRAM"), ack(1, 0)),
        (userdata(1, head(REQUEST, TIME, 1)), userdata(1, head(RESPONSE, TIME, 1), build.payload(bytes(10)))),
    ],
)
def test_an_answer_behind_a_malformed_header_waits_for_a_better_one(request: bytes, answer: bytes) -> None:
    for better in (False, True):
        talk = opened()
        asks = talk.ask(request)
        aside = talk.packet(SERVER, behind(answer))
        assert talk.transactions == []
        if better:
            talk.tell(answer)
        talk.close()
        assert sorted(talk.pairs()) == ([(0, aside), (asks, aside + 1)] if better else [(asks, aside)])


def test_what_is_pushed_behind_a_malformed_header_answers_nothing() -> None:
    talk = opened()
    talk.ask(userdata(1, head(REQUEST, CPU, 3)))
    aside = talk.packet(SERVER, behind(userdata(1, head(PUSH, CPU, 3))))
    assert talk.pairs() == [(0, aside)]


def test_a_setup_is_due_once_and_before_anything_else() -> None:
    talk = opened()
    for number, size in ((1, 480), (2, 960)):
        frame = talk.ask(setup(number, 8, 8, size))
        talk.tell(granted(number, 8, 8, size))
        assert talk.findings[-1].slug == "session.repeated_setup"
        assert talk.findings[-1].frames == [frame]
    assert details(talk, "session.repeated_setup") == [
        "asks for the same values",
        "asks for PDU length 960, before 480",
    ]
    early = Talk()
    early.hello()
    early.connect()
    frame = early.ask(read(1, dbw(1, 0)))
    early.ask(read(2, dbw(1, 0)))
    assert [(one.slug, one.frames) for one in early.findings] == [("session.data_before_setup", [frame])]


def test_a_request_with_the_reference_of_an_open_one_is_counted_and_the_next_one_is_not() -> None:
    talk = opened()
    for pdu in (read(1, dbw(1, 0)), read(1, dbw(2, 0)), read(2, dbw(1, 0)), read(1, dbw(3, 0)), read(3, dbw(1, 0))):
        talk.ask(pdu)
    rule = talk.pipeline.exchange.ledger.rules["session.shared_reference"]
    assert (rule.events, len(details(talk, "session.shared_reference"))) == (2, 1)
