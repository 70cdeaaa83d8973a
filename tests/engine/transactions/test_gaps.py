"""What acknowledgements say of octets that the capture lacks: whose answer is among them, and whom nobody blames for it."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.transaction import CAPTURE_ENDED, CONNECTION_CLOSED, HOLE, LIKELY, SURE
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    FIN,
    MS,
    RST,
    SECOND,
    SERVER,
    Talk,
    ack_data,
    dbw,
    dt,
    good,
    head,
    read,
    setup,
    userdata,
    words,
)
from tests.engine.transactions.talk import granted as grant

#: What blames a client or a device.
BLAMES = ("transaction.", "session.", "s7.", "security.")
#: Where sequence numbers begin: somewhere, and so that they wrap within the conversation.
BEGINNINGS = [(1000, 90000), (2**32 - 90, 2**32 - 70), (2**31 - 60, 2**32 - 200)]


def begun(seq: tuple[int, int] = (1000, 90000), jobs: int = 1) -> Talk:
    talk = Talk()
    talk.seq = list(seq)
    talk.open(jobs, jobs)
    return talk


def told(talk: Talk) -> list[tuple[int, int, str, str]]:
    """Packets, reason and certainty of each transaction, in the order of asking."""
    found = sorted(talk.transactions, key=lambda one: int(one.number))
    return [(int(one.request_frame), int(one.response_frame), one.reason, one.certainty) for one in found]


def blames(talk: Talk) -> list[str]:
    return [slug for slug in talk.slugs() if slug.startswith(BLAMES)]


def lost(talk: Talk, *pdus: bytes) -> None:
    """The server's PDUs are not captured, but their acknowledgement is."""
    talk.lose(SERVER, *pdus)
    talk.packet(CLIENT)


@pytest.mark.parametrize("seq", BEGINNINGS)
@pytest.mark.parametrize("end", ["fin", "reset", "open"])
def test_an_answer_that_only_its_acknowledgement_shows(end: str, seq: tuple[int, int]) -> None:
    talk = begun(seq)
    asked = talk.ask(read(1, dbw(1, 0)))
    lost(talk, words(1, 7))
    if end == "fin":
        talk.close()
    else:
        if end == "reset":
            talk.packet(CLIENT, flags=RST)
        talk.finish()
    assert told(talk) == [(asked, 0, HOLE, SURE)]
    assert talk.transactions[0].reason_text == "answered, but the answer was not captured"
    assert talk.slugs() == ["stream.hole"]


def test_no_later_segment_shows_how_many_octets_are_missing() -> None:
    talk = begun()
    talk.ask(read(1, dbw(1, 0)))
    lost(talk, words(1, 7))
    talk.finish()
    assert int(talk.pipeline.counters.octets.missing) == len(dt(words(1, 7)))


@pytest.mark.parametrize("again", [1, 3])
def test_an_acknowledgement_that_is_repeated_says_nothing_more(again: int) -> None:
    """As TCP does for each segment that it gets twice, or out of order."""
    talk = begun()
    asked = talk.ask(read(1, dbw(1, 0)))
    for _ in range(again):
        talk.packet(CLIENT)
    talk.finish()
    assert told(talk) == [(asked, 0, CAPTURE_ENDED, "")]
    assert talk.slugs() == []


def test_an_older_acknowledgement_takes_nothing_back() -> None:
    talk = begun()
    asked = talk.ask(read(1, dbw(1, 0)))
    before = talk.seq[SERVER]
    lost(talk, words(1, 7))
    talk.acked[CLIENT] = before
    talk.packet(CLIENT)
    talk.finish()
    assert told(talk) == [(asked, 0, HOLE, SURE)]


@pytest.mark.parametrize("seq", BEGINNINGS)
def test_acknowledgements_of_syn_and_fin_are_of_no_octets(seq: tuple[int, int]) -> None:
    talk = begun(seq)
    asked = talk.ask(read(1, dbw(1, 0)))
    talk.packet(SERVER, flags=FIN | ACK)
    talk.packet(CLIENT)  # acknowledges the FIN
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.packet(SERVER)
    talk.finish()
    assert told(talk) == [(asked, 0, CONNECTION_CLOSED, "")]
    assert "stream.hole" not in talk.slugs()
    assert "transaction.unanswered" in talk.slugs()


def test_a_fin_that_was_not_captured_is_no_answer() -> None:
    talk = begun()
    asked = talk.ask(read(1, dbw(1, 0)))
    talk.seq[SERVER] += 1
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.finish()
    assert told(talk) == [(asked, 0, CONNECTION_CLOSED, "")]
    assert "stream.hole" not in talk.slugs()


def test_a_keep_alive_with_an_octet_is_no_answer() -> None:
    talk = begun()
    asked = talk.ask(read(1, dbw(1, 0)))
    talk.packet(SERVER, b"\0", seq=talk.seq[SERVER] - 1, after_ns=2 * SECOND)
    talk.packet(CLIENT)
    talk.finish()
    assert told(talk) == [(asked, 0, CAPTURE_ENDED, "")]
    assert "stream.hole" not in talk.slugs()


@pytest.mark.parametrize("count", [1, 2])
def test_an_empty_dt_is_no_answer(count: int) -> None:
    """The early acknowledgement of some stations is not captured."""
    talk = begun()
    asked = talk.ask(read(1, dbw(1, 0)))
    talk.seq[SERVER] += 7 * count
    talk.packet(CLIENT)
    talk.finish()
    assert told(talk) == [(asked, 0, CAPTURE_ENDED, "")]
    assert talk.slugs() == ["stream.hole"]


def test_a_capture_whose_clock_steps_back() -> None:
    talk = begun()
    first = talk.ask(read(1, dbw(1, 0)))
    lost(talk, words(1, 7))
    talk.wait(-10 * SECOND)
    second = talk.ask(read(2, dbw(1, 2)))
    answered = talk.tell(words(2, 8))
    for _ in range(12):
        talk.packet(CLIENT)
    talk.close()
    assert told(talk) == [(first, 0, HOLE, SURE), (second, answered, "", SURE)]
    assert blames(talk) == []


def test_of_one_direction_nothing_more_is_said_than_before() -> None:
    talk = begun()
    talk.ask(read(1, dbw(1, 0)))
    one = Talk()
    one.seq = [1000, 90000]
    for number in range(1, 5):
        one.ask(read(number, dbw(1, 0)))
        one.lose(SERVER, words(number, 7))
        one.packet(CLIENT)
    one.finish()
    assert {transaction.outcome for transaction in one.transactions} == {"unanswered"}
    assert all(transaction.unseen for transaction in one.transactions)
    assert [slug for slug in one.slugs() if not slug.startswith("capture.")] == []


# ---- what begins with a gap -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seq", BEGINNINGS)
@pytest.mark.parametrize(("reference", "items"), [(0, 1), (0, 2), (1, 1), (1, 2)])
def test_a_stream_does_not_begin_at_its_first_captured_packet(reference: int, items: int, seq: tuple[int, int]) -> None:
    """The capture begins with a request whose answer it lacks: the next answer is that of the next request."""
    talk = Talk()
    talk.seq = list(seq)
    first = talk.ask(read(0, dbw(1, 0)))
    talk.lose(SERVER, words(0, 1))
    second = talk.ask(read(reference, *[dbw(1, 2 * number) for number in range(items)]))
    answered = talk.tell(ack_data(reference, bytes((4, items)), good(4, b"\0\1") * items))
    for _ in range(12):
        talk.packet(CLIENT)
    talk.finish()
    # A client that repeats its reference may have had another request open when the capture began.
    assert told(talk) == [(first, 0, HOLE, SURE), (second, answered, "", SURE if reference else LIKELY)]
    assert blames(talk) == []


def test_what_was_sent_before_the_first_acknowledgement_is_read_as_it_comes() -> None:
    """A segment that is captured late begins the stream, though a later acknowledgement was captured before it."""
    talk = Talk()
    late = talk.seq[SERVER]
    talk.seq[SERVER] += len(dt(words(1, 1)))
    asked = talk.ask(read(2, dbw(1, 0)))
    orphan = talk.packet(SERVER, dt(words(1, 1)), seq=late)
    answered = talk.tell(words(2, 2))
    talk.finish()
    assert talk.pairs() == [(asked, answered), (0, orphan)]
    assert "stream.hole" not in talk.slugs()


# ---- which of several ------------------------------------------------------------------------------------------------


def test_each_request_that_waited_for_the_one_before_has_a_part_of_the_gap() -> None:
    """A burst is lost: each request acknowledges the answer to the one before, so each was answered."""
    talk = begun()
    asked = []
    for number in range(1, 5):
        asked.append(talk.ask(read(number, dbw(1, 0))))
        talk.lose(SERVER, words(number, 7))
    last = talk.ask(read(9, dbw(1, 0)))
    answered = talk.tell(words(9, 7))
    talk.close()
    assert told(talk) == [*[(frame, 0, HOLE, SURE) for frame in asked], (last, answered, "", SURE)]
    assert blames(talk) == []


def test_one_missing_message_is_not_the_answer_to_several_requests() -> None:
    talk = begun(jobs=3)
    asked = [talk.ask(read(number, dbw(1, 0))) for number in (1, 2, 3)]
    lost(talk, words(2, 7))
    talk.close()
    assert told(talk) == [(frame, 0, HOLE, LIKELY) for frame in asked]
    assert talk.transactions[0].reason_text.startswith("perhaps answered: ")
    assert blames(talk) == []


def test_a_push_may_account_for_what_is_missing() -> None:
    talk = begun()
    talk.tell(userdata(0, head(0, 4, 3, 0, 0)))
    talk.transactions.clear()
    asked = talk.ask(read(1, dbw(1, 0)))
    lost(talk, words(1, 7))
    talk.finish()
    assert told(talk) == [(asked, 0, HOLE, LIKELY)]


def test_nobody_had_too_many_requests_open() -> None:
    """One job is agreed; the acknowledgement of the second request shows that the first was answered."""
    talk = begun()
    first = talk.ask(read(1, dbw(1, 0)))
    talk.lose(SERVER, words(1, 7))
    second = talk.ask(read(2, dbw(1, 0)))
    answered = talk.tell(words(2, 7))
    talk.close()
    assert told(talk) == [(first, 0, HOLE, SURE), (second, answered, "", SURE)]
    assert blames(talk) == []


def test_who_sends_too_many_requests_is_told_of_all_the_same() -> None:
    talk = begun()
    for number in (1, 2):
        talk.ask(read(number, dbw(1, 0)))
    talk.close()
    assert "session.too_many_jobs" in talk.slugs()


@pytest.mark.parametrize("pushed", [False, True])
def test_an_answer_after_gaps_of_both_sides_is_only_likely(pushed: bool) -> None:
    """Its own request may be missing, and the answer to the one that is open; or a push is (``pushed``)."""
    talk = begun(jobs=2)
    if pushed:
        talk.tell(userdata(0, head(0, 4, 3, 0, 0)))
        talk.transactions.clear()
    asked = talk.ask(read(5, dbw(1, 0)))
    talk.lose(SERVER, words(5, 1))
    talk.packet(CLIENT)
    talk.lose(CLIENT, read(5, dbw(1, 2)))
    answered = talk.tell(words(5, 2))
    for _ in range(12):
        talk.packet(CLIENT)
        talk.packet(SERVER, after_ns=60 * MS)
    talk.close()
    assert told(talk) == [(asked, answered, "", LIKELY)]
    assert talk.transactions[0].doubt == "gaps"
    assert blames(talk) == []


def test_a_gap_of_one_side_leaves_the_answer_sure() -> None:
    talk = begun(jobs=2)
    asked = talk.ask(read(5, dbw(1, 0)))
    talk.lose(CLIENT, read(6, dbw(1, 2)))
    answered = talk.tell(words(5, 2))
    for _ in range(12):
        talk.packet(CLIENT)
        talk.packet(SERVER, after_ns=60 * MS)
    talk.close()
    assert told(talk)[0] == (asked, answered, "", SURE)


def test_a_setup_whose_answer_is_missing() -> None:
    talk = Talk()
    talk.hello()
    talk.connect()
    asked = talk.ask(setup(0))
    talk.lose(SERVER, grant(0))
    second = talk.ask(read(1, dbw(1, 0)))
    answered = talk.tell(words(1, 1))
    talk.close()
    assert told(talk) == [(asked, 0, HOLE, SURE), (second, answered, "", SURE)]
    assert blames(talk) == []


@pytest.mark.parametrize("end", [FIN | ACK, RST, RST | ACK, ACK])
@pytest.mark.parametrize("seq", BEGINNINGS)
def test_the_first_captured_packet_of_a_side_is_behind_its_answer(seq: tuple[int, int], end: int) -> None:
    talk = Talk()
    talk.seq = list(seq)
    asked = talk.ask(setup(1))
    talk.lose(SERVER, grant(1))
    talk.packet(SERVER, flags=end)
    talk.finish()
    assert told(talk)[0][:3] == (asked, 0, HOLE)
    assert blames(talk) == []


@pytest.mark.parametrize("size", [7, 14])
@pytest.mark.parametrize("later", [0, 1])
def test_a_message_that_begins_in_a_gap_of_a_few_octets(size: int, later: int) -> None:
    """Devices that send the heads, or every few octets, in a segment of their own: the gap is no empty DT."""
    talk = begun(jobs=8)
    if later:
        talk.ask(read(7, dbw(1, 0)))
        talk.tell(words(7, 1))
    asked = talk.ask(read(1, dbw(1, 0)))
    octets = dt(words(1, 7))
    talk.seq[SERVER] += size
    talk.packet(SERVER, octets[size:])
    talk.packet(CLIENT)
    talk.finish()
    assert told(talk)[-1][:3] == (asked, 0, HOLE)
    assert blames(talk) == []
