"""Segments that are not the next ones in order: how their packets are counted, and requests that TCP sent again."""

from __future__ import annotations

from typing import Final

from dissect.engine.transactions.transaction import Transaction
from tests.cases import each
from tests.engine.transactions.talk import CLIENT, MS, SECOND, SERVER, Talk, dbw, dt, read, words

ASKED: Final = dt(read(1, dbw(1, 0)))
HTTP: Final = b"GET / HTTP/1.0\r\n"


def counts(talk: Talk) -> dict[str, int]:
    """The treatment of the packets with octets."""
    found = talk.pipeline.counters.packet_counts()
    return {name: count for name, count in found.items() if count and name != "no_payload"}


def opened() -> Talk:
    talk = Talk()
    talk.open(8, 8)
    return talk


# ---- how packets are counted ----------------------------------------------------------------------------------------


def test_each_packet_is_counted_by_what_is_new_in_it() -> None:
    talk = opened()  # four packets with octets
    at = talk.seq[CLIENT]
    talk.packet(CLIENT, ASKED[10:], seq=at + 10)  # held
    talk.packet(CLIENT, ASKED[10:], seq=at + 10)  # held already
    talk.packet(CLIENT, ASKED[12:20], seq=at + 12)
    talk.packet(CLIENT, ASKED[:10], seq=at)
    talk.packet(CLIENT, ASKED[:10], seq=at)
    for _ in range(3):
        talk.packet(CLIENT, b"\0", seq=at + len(ASKED) - 1)  # a keep-alive
    talk.packet(CLIENT, ASKED[-2:], seq=at + len(ASKED) - 2)
    talk.packet(CLIENT, b"old", seq=998)  # its last octet has the number of the SYN
    talk.packet(CLIENT, b"old", seq=999)
    assert counts(talk) == {"payload": 4 + 2, "retransmission": 5, "keep_alive": 3, "before_start": 1}
    talk.finish()
    assert talk.pipeline.s7.pdus == 3


@each("seq", [-1, 0])
def test_a_keep_alive_before_anything_else_was_examined_is_one_of_a_silent_connection(seq: int) -> None:
    talk = Talk()
    talk.hello()
    frames = [talk.packet(CLIENT, b"\0", seq=talk.seq[CLIENT] - 1, after_ns=SECOND) for _ in range(2)]
    talk.packet(CLIENT, seq=talk.seq[CLIENT] + seq, after_ns=SECOND)
    if seq:
        frames.append(int(talk.pipeline.frames))
    talk.finish()
    (finding,) = talk.findings
    assert (finding.slug, finding.frames) == ("session.idle", [frames[0], frames[-1]])
    assert counts(talk) == {"keep_alive": 2}


def test_packets_of_other_protocols_and_of_what_is_not_known_yet_are_unused() -> None:
    talk = Talk(server_port=2000)
    for _ in range(3):
        talk.packet(CLIENT, HTTP)
    assert counts(talk) == {"other_protocol": 3}
    talk.packet(CLIENT, HTTP, seq=talk.seq[CLIENT] + 5)  # held: it may be anything
    assert counts(talk) == {"other_protocol": 3, "payload": 1}


def test_a_conflict_is_reported_of_connections_that_are_followed() -> None:
    for port, told in ((102, True), (2000, False)):
        talk = Talk(server_port=port)
        if told:
            talk.open()
        octets = ASKED if told else HTTP
        at = talk.seq[CLIENT]
        talk.packet(CLIENT, octets)
        talk.packet(CLIENT, octets[:5] + b"\xee" + octets[6:], seq=at)
        found = [one.detail for one in talk.findings if one.slug == "stream.conflict"]
        assert found == ([f"{len(octets)} bytes at TCP sequence number {at}"] if told else [])


def test_the_first_copy_of_an_octet_counts() -> None:
    talk = opened()
    at = talk.seq[CLIENT]
    other = dt(read(1, dbw(9, 9)))
    talk.packet(CLIENT, ASKED[10:], seq=at + 10)
    talk.packet(CLIENT, other[12:], seq=at + 12)  # differs from what is held
    talk.packet(CLIENT, ASKED[:10], seq=at)
    talk.seq[CLIENT] = at + len(ASKED)
    talk.tell(words(1, 1))
    talk.finish()
    (transaction,) = talk.transactions
    assert transaction.request_octets == ASKED[7:]
    assert [one.slug for one in talk.findings] == ["stream.conflict"]


@each("side", [CLIENT, SERVER])
def test_how_far_ahead_octets_count_depends_on_whether_the_other_side_is_heard(side: int) -> None:
    """Where it is, a window; where it is not, a second segment may confirm what is far away."""
    for heard in (True, False):
        talk = Talk()
        if heard:
            talk.open()
        else:
            talk.packet(side, ASKED)
        for number in range(2):
            talk.packet(side, ASKED, seq=talk.seq[side] + 300_000 + number * len(ASKED))
        talk.silence(2 * SECOND)
        (one,) = talk.pipeline.table.all_open()
        assert one.peer is not None
        mine = one if one.index == side or not heard else one.peer
        assert (mine.stream.held is None) is not heard


def test_octets_behind_a_packet_that_the_capture_cut_are_in_order() -> None:
    talk = opened()
    talk.packet(CLIENT, ASKED, cut=5)
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(words(1, 1), words(2, 1))
    talk.finish()
    assert talk.outcomes() == ["answered"] * 2
    octets = talk.pipeline.counters.octets
    assert (octets.missing, octets.holes) == (5, 1)
    assert talk.slugs() == ["capture.cut_frames"]


def test_what_the_capture_cut_off_a_packet_that_waits_is_missing_with_its_turn() -> None:
    talk = opened()
    at = talk.seq[CLIENT]
    first, second = ASKED, dt(read(2, dbw(1, 0)))
    talk.packet(CLIENT, second, seq=at + len(first), cut=5)
    talk.packet(CLIENT, first, seq=at)
    talk.seq[CLIENT] = at + len(first) + len(second)
    talk.ask(read(3, dbw(1, 0)))
    talk.tell(words(1, 1), words(2, 1), words(3, 1))
    talk.finish()
    assert talk.pipeline.counters.octets.missing == 5
    assert talk.outcomes().count("answered") >= 2


# ---- sent again -----------------------------------------------------------------------------------------------------


def again(talk: Talk) -> tuple[int, int, int] | None:
    """How often the only transaction was sent again, in which packet at last, and when, in ms after the request."""
    talk.close()
    transaction: Transaction = talk.transactions[-1]
    found = transaction.again
    if found is None:
        return None
    return int(found.times), int(found.frame), (int(found.time_ns) - int(transaction.request_ns)) // MS


@each(
    ("pauses_ms", "times", "last_ms"),
    [
        ((9,), 0, 0),
        ((10,), 1, 10),
        ((200,), 1, 200),
        ((200, 5), 1, 200),  # captured twice
        ((200, 10), 2, 210),
        ((5, 5), 1, 10),  # measured from the request
        ((200, 400, 800), 3, 1400),
    ],
)
def test_a_request_is_sent_again_after_a_while(pauses_ms: tuple[int, ...], times: int, last_ms: int) -> None:
    """TCP waits 100 ms or more; a copy that comes at once was captured twice."""
    talk = opened()
    at = talk.seq[CLIENT]
    talk.packet(CLIENT, ASKED)
    frames = {}
    passed = 0
    for pause in pauses_ms:
        passed += pause
        frames[passed] = talk.packet(CLIENT, ASKED, seq=at, after_ns=pause * MS)
    assert again(talk) == ((times, frames[last_ms], last_ms) if times else None)


def test_only_the_latest_octets_sent_again_are_a_request_sent_again() -> None:
    """What is before them was received; what is beyond them is new."""
    for begin, end, counts_ in ((0, -1, False), (0, len(ASKED), True), (5, len(ASKED), True), (-20, len(ASKED), True)):
        talk = opened()
        at = talk.seq[CLIENT]
        talk.packet(CLIENT, ASKED)
        octets = (bytes(20) + ASKED)[begin + 20 : end + 20 if end > 0 else len(ASKED) + 20 + end]
        talk.packet(CLIENT, octets, seq=at + begin, after_ns=SECOND)
        assert (again(talk) is not None) is counts_, (begin, end)


def test_a_request_that_was_answered_is_not_sent_again() -> None:
    talk = opened()
    at = talk.seq[CLIENT]
    talk.packet(CLIENT, ASKED)
    talk.tell(words(1, 1))
    talk.packet(CLIENT, ASKED, seq=at, after_ns=SECOND)
    assert again(talk) is None


def test_of_several_open_requests_the_latest_is_the_one_that_is_sent_again() -> None:
    talk = opened()
    talk.packet(CLIENT, ASKED)
    at = talk.seq[CLIENT]
    second = dt(read(2, dbw(1, 0)))
    talk.packet(CLIENT, second)
    frame = talk.packet(CLIENT, second, seq=at, after_ns=SECOND)
    talk.close()
    assert [one.again is not None for one in talk.transactions] == [False, True]
    found = talk.transactions[1].again
    assert found is not None
    assert (found.times, found.frame) == (1, frame)


def test_octets_amid_a_message_are_no_request() -> None:
    """A request, and the begin of the next one, of which only that is sent again."""
    talk = opened()
    talk.packet(CLIENT, ASKED)
    at = talk.seq[CLIENT]
    talk.packet(CLIENT, ASKED[:20])
    talk.packet(CLIENT, ASKED[:20], seq=at, after_ns=SECOND)
    talk.packet(CLIENT, ASKED[20:])
    talk.finish()
    assert [one.again for one in talk.transactions] == [None, None]


def test_an_answer_sent_again_is_no_request() -> None:
    talk = opened()
    talk.packet(CLIENT, ASKED)
    at = talk.seq[SERVER]
    talk.tell(words(9, 1))
    talk.packet(SERVER, dt(words(9, 1)), seq=at, after_ns=SECOND)
    talk.finish()
    assert [one.again for one in talk.transactions] == [None, None]


@each(("held", "given_up"), [(63, False), (64, True)])
def test_a_gap_is_given_up_when_too_much_waits_behind_it(held: int, given_up: bool) -> None:
    """It is reported as one of the capture, like any other."""
    talk = opened()
    talk.acked[SERVER] = talk.seq[CLIENT]
    talk.seq[CLIENT] += 31
    for ref in range(held):
        talk.ask(read(ref, dbw(1, 0)), after_ns=MS // 10)
    found = [one.detail for one in talk.findings if one.slug == "stream.hole"]
    assert found == (["31 bytes from 10.0.0.1:50000, between TPKTs"] if given_up else [])
