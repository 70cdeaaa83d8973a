"""Several requests open under one reference: which of them an answer belongs to, as far as TCP and its content tell."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.open_requests import MAX_BEHIND, NEVER_NS, REPEAT_NS
from dissect.engine.transactions.transaction import REFERENCE_REUSED
from tests.engine.transactions.talk import ACK as ACK_FLAG
from tests.engine.transactions.talk import (
    CLIENT,
    MS,
    SECOND,
    SERVER,
    SYN,
    Talk,
    ack_data,
    dbw,
    dt,
    good,
    granted,
    read,
    setup,
    words,
    write,
    written,
)
from tests.growth import assert_growth


def opened(jobs: int) -> Talk:
    talk = Talk()
    talk.open(jobs, jobs)
    return talk


def values(talk: Talk) -> dict[str, object]:
    """The values by address."""
    return {
        result.item.address: result.value
        for one in talk.transactions
        for result in one.s7_results
        if result.item is not None and one.response_frame
    }


def true(*numbers: int) -> dict[str, object]:
    return {f"DB1.DBW{2 * number}": number for number in numbers}


def test_two_jobs_open_all_the_time() -> None:
    """The client always uses one reference, and sends the next but one with each answer that it gets."""
    talk = opened(2)
    talk.ask(read(0, dbw(1, 0)))
    for number in range(1, 8):
        talk.ask(read(0, dbw(1, 2 * number)))
        talk.tell(words(0, number - 1))
    talk.tell(words(0, 7))
    talk.close()
    assert values(talk) == true(*range(8))
    assert talk.slugs() == ["session.shared_reference"]
    assert {one.certainty for one in talk.transactions} == {"sure"}


def test_no_answer_is_that_of_a_request_which_came_when_it_was_on_its_way() -> None:
    """One job only is agreed, and the client sends a second one; what the first answer acknowledges shows whose it is."""
    talk = opened(1)
    first = talk.ask(read(0, dbw(1, 2)))
    known = talk.seq[CLIENT]
    second = talk.ask(read(0, dbw(1, 4)))
    talk.acked[SERVER] = known
    late = talk.tell(words(0, 1))
    talk.acked[SERVER] = None
    answered = talk.tell(words(0, 2))
    talk.close()
    assert talk.pairs() == [(first, late), (second, answered)]
    assert {one.certainty for one in talk.transactions} == {"sure"}


def test_an_acknowledgement_of_something_else_tells_nothing() -> None:
    """As in captures that a program made up, without regard to what TCP acknowledges."""
    talk = opened(1)
    talk.acked[SERVER] = talk.seq[CLIENT] - 2**24
    first = talk.ask(read(0, dbw(1, 2)))
    second = talk.ask(read(0, dbw(1, 4)))
    answered = talk.tell(words(0, 2))
    talk.close()
    assert sorted(talk.pairs())[-2:] == [(first, 0), (second, answered)]


def test_what_a_part_of_a_segment_is_acknowledged_for_may_be_answered() -> None:
    """Captured behind the sending station's own network card, one segment is several on the wire."""
    talk = opened(2)
    requests = [read(0, dbw(1, 2)), read(0, dbw(1, 4))]
    talk.ask(*requests)
    talk.acked[SERVER] = talk.seq[CLIENT] - len(dt(requests[1]))
    talk.tell(words(0, 1))
    talk.acked[SERVER] = None
    talk.tell(words(0, 2))
    talk.close()
    assert values(talk) == true(1, 2)


@pytest.mark.parametrize("what", ["function", "items"])
def test_an_answer_goes_to_the_oldest_that_it_fits(what: str) -> None:
    talk = opened(3)
    other = write(0, [dbw(1, 0)], written(4, b"\0\1")) if what == "function" else read(0, dbw(1, 0), dbw(1, 0))
    first = talk.ask(other)
    second = talk.ask(read(0, dbw(1, 2)))
    third = talk.ask(read(0, dbw(1, 4)))
    answers = [talk.tell(words(0, number)) for number in (1, 2)]
    late = talk.tell(
        ack_data(0, b"\x05\x01", b"\xff") if what == "function" else ack_data(0, b"\x04\x02", good(4, b"\0\1") * 2)
    )
    talk.close()
    assert talk.pairs() == [(second, answers[0]), (third, answers[1]), (first, late)]
    assert all(one._flags == 0 for one in talk.transactions)


def test_an_answer_that_fits_none_is_the_oldest_s() -> None:
    talk = opened(2)
    first = talk.ask(read(0, dbw(1, 0)))
    talk.ask(read(0, dbw(1, 2)))
    wrong = talk.tell(ack_data(0, b"\x05\x01", b"\xff"))
    assert talk.pairs() == [(first, wrong)]


def test_a_job_that_timed_out_is_asked_anew() -> None:
    """More jobs are agreed, but the client waits for each; what got no answer must not shift all that follow."""
    talk = opened(8)
    lost = talk.ask(read(0, dbw(1, 0)))
    talk.wait(REPEAT_NS)
    for number in range(1, 5):
        talk.ask(read(0, dbw(1, 2 * number)))
        talk.tell(words(0, number))
    talk.close()
    assert values(talk) == true(1, 2, 3, 4)
    assert [(one.request_frame, one.reason) for one in talk.transactions if one.reason] == [(lost, REFERENCE_REUSED)]


@pytest.mark.parametrize("same", [False, True])
@pytest.mark.parametrize("pause_ms", [300, 900])
def test_a_client_that_does_not_wait_for_long_shifts_nothing_either(pause_ms: int, same: bool) -> None:
    """More jobs are agreed, but the client waits for each, and the PLC drops one; what follows is polled quickly."""
    talk = opened(3)
    talk.ask(read(0, dbw(1, 2 if same else 0)))
    talk.wait(pause_ms * MS)
    for number in range(1, 20):
        talk.ask(read(0, dbw(1, 2 * number)))
        talk.tell(words(0, number))
        talk.packet(CLIENT)
        talk.wait(50 * MS)
    talk.close()
    assert values(talk) == true(*range(1, 20))
    assert talk.outcomes().count("unanswered") == 1


def test_two_jobs_of_a_slow_plc() -> None:
    """The client sends another one as soon as one is answered, though the one beside it has been waiting for a while."""
    talk = opened(2)
    talk.ask(read(0, dbw(1, 2)))
    talk.ask(read(0, dbw(1, 4)))
    for number in range(1, 8):
        talk.wait(400 * MS)
        talk.tell(words(0, number))
        talk.ask(read(0, dbw(1, 2 * number + 4)))
    talk.tell(words(0, 8), words(0, 9))
    talk.close()
    assert values(talk) == true(*range(1, 10))


def test_what_no_answer_fitted_is_given_up_in_time() -> None:
    talk = opened(8)
    lost = talk.ask(write(0, [dbw(1, 0)], written(4, b"\0\1")))
    for number in range(1, 12):
        talk.ask(read(0, dbw(1, 2 * number)))
        talk.ask(read(0, dbw(1, 2 * number + 100)))
        talk.tell(words(0, number), words(0, number + 50))
        talk.wait(NEVER_NS // 10)
    talk.close()
    assert values(talk) == true(*range(1, 12), *range(51, 62))
    assert [(one.request_frame, one.reason) for one in talk.transactions if one.reason] == [(lost, REFERENCE_REUSED)]


def test_no_more_wait_than_were_agreed() -> None:
    talk = opened(2)
    frames = [talk.ask(read(0, dbw(1, 2 * number))) for number in range(3)]
    answered = talk.tell(words(0, 2))
    talk.close()
    assert sorted(talk.pairs()) == [(frames[0], 0), (frames[1], 0), (frames[2], answered)]


def test_after_a_gap_the_latest_is_answered() -> None:
    """The first answer is in the gap, and which ones are is unknown."""
    talk = opened(3)
    lost = talk.ask(read(0, dbw(1, 0)))
    talk.lose(SERVER, words(0, 0))
    talk.packet(CLIENT)
    talk.tell(words(9, 9))
    talk.packet(CLIENT, after_ns=2 * SECOND)
    talk.packet(SERVER, after_ns=60 * MS)
    asked = talk.ask(read(0, dbw(1, 2)))
    answered = talk.tell(words(0, 1))
    talk.close()
    assert (lost, 0) in talk.pairs()
    assert (asked, answered) in talk.pairs()


# ---- the packets of one end come before those of the other ------------------------------------------------------------


class Apart(Talk):
    """A connection whose packets are captured end by end: those of the client, then those of the server."""

    def __init__(self) -> None:
        super().__init__()
        self.kept: dict[int, list[tuple[bytes, int, int, int]]] = {CLIENT: [], SERVER: []}

    def packet(
        self,
        side: int,
        payload: bytes = b"",
        flags: int = ACK_FLAG,
        seq: int | None = None,
        after_ns: int = MS,
        cut: int = 0,
    ) -> int:
        self.now_ns += after_ns
        self.kept[side].append((payload, flags, self.seq[side], self.seq[1 - side]))
        self.seq[side] += len(payload) + (1 if flags & SYN else 0)
        return 0

    def play(self) -> None:
        """Capture what was kept."""
        for side, packets in self.kept.items():
            for payload, flags, seq, acked in packets:
                self.acked[side] = acked
                super().packet(side, payload, flags, seq)
        self.finish()


def test_one_tap_after_the_other() -> None:
    talk = Apart()
    talk.hello()
    talk.connect()
    talk.ask(setup(0))
    talk.tell(granted(0))
    for number in range(1, 40):
        talk.ask(read(0, dbw(1, 2 * number)))
        talk.tell(words(0, number))
    talk.play()
    assert talk.outcomes() == ["answered"] * 40
    assert values(talk) == true(*range(1, 40))


def ask_only(count: int) -> Talk:
    """A client that gets answers which nobody captured, under one reference."""
    talk = Talk()
    for number in range(count):
        talk.ask(read(0, dbw(1, number & 0xFF)))
        talk.seq[SERVER] += 25
    return talk


def test_one_direction_alone_is_bounded_and_told_of() -> None:
    talk = ask_only(3 * MAX_BEHIND)
    assert talk.pipeline.exchange.dialogue.open <= MAX_BEHIND + 1
    talk.finish()
    assert talk.outcomes() == ["unanswered"] * 3 * MAX_BEHIND
    assert talk.pipeline.exchange.dialogue.open == 0
    assert "transaction.table_full" not in talk.slugs()


def test_one_direction_alone_takes_work_in_proportion() -> None:
    assert_growth(lambda: ask_only(1_000), lambda: ask_only(8_000), 16)


def test_a_reference_open_among_thousands_takes_work_in_proportion() -> None:
    """As many jobs as a program wrote into the setup are open, and each reference is used again."""

    def flood(jobs: int) -> None:
        talk = opened(jobs)
        for number in range(2 * jobs):
            talk.ask(read(number % jobs, dbw(1, number)), after_ns=10_000)

    assert_growth(lambda: flood(500), lambda: flood(2_000), 6)
