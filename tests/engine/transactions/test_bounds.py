"""What an operation keeps, at the edge of its bounds: as much as they say, and no more."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.operation import (
    MAX_CONTENT,
    MAX_CONTENTS,
    MAX_OPEN,
    UNFINISHED,
    Activation,
    OpenOperations,
    Operation,
    OperationBook,
)
from dissect.engine.transactions.transaction import Transaction
from tests.engine.transactions.talk import MS, START_NS, Talk, dbw, read, words


@pytest.fixture
def transaction() -> Transaction:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1), after_ns=3 * MS)
    return talk.transactions[0]


def begun(book: OperationBook, transaction: Transaction, key: str = "x") -> Operation:
    return book.begin("upload", key, transaction, "DB 1")


def test_an_operation_begins_with_its_first_transaction(transaction: Transaction) -> None:
    one = begun(OperationBook(), transaction)
    assert (one.begin_ns, one.end_ns, one.duration_ns) == (START_NS + 8 * MS, START_NS + 11 * MS, 3 * MS)
    assert (one.first_frame, one.last_frame, one.parts, one.transactions) == (8, 9, 1, [int(transaction.number)])
    assert (one.error_code, one.push_interval_ns, one.content_parts()) == (0, 0, [])
    assert (str(one), repr(one)) == ("upload DB 1: under way", "Operation(0, 'upload', 'DB 1', '')")
    one.octets = 5
    assert str(one) == "upload DB 1: under way, 5 bytes"


def test_pushes_have_a_mean_interval(transaction: Transaction) -> None:
    one = begun(OperationBook(), transaction)
    for count, time_ns, mean in ((1, 100, 0), (2, 300, 200), (3, 400, 150), (4, 403, 101)):
        transaction.response_ns = time_ns
        one._count_push(transaction, 7)
        assert (one.pushes, one.push_interval_ns, one.octets) == (count, mean, 7 * count)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 20])
def test_oddities_are_kept_up_to_a_bound(count: int, transaction: Transaction) -> None:
    one = begun(OperationBook(), transaction)
    for number in range(count):
        one._odd("wrong_size", str(number), number)
    assert [odd.detail for odd in one.oddities] == [str(number) for number in range(min(count, 8))]


@pytest.mark.parametrize("more", [-1, 0, 1, 3])
def test_the_oldest_operation_goes_where_there_are_too_many(more: int, transaction: Transaction) -> None:
    book = OperationBook()
    made = [begun(book, transaction, str(number)) for number in range(MAX_OPEN + more)]
    gone = max(0, more)
    assert transaction.connection.operations.these == made[gone:]
    assert (book.evicted, book.over, book.count) == (gone, made[:gone], gone)
    assert [(one.result, one.reason, one.number) for one in book.over] == [
        (UNFINISHED, "too many at once", number) for number in range(1, gone + 1)
    ]


def test_content_is_kept_up_to_a_bound_and_then_without_a_gap(transaction: Transaction) -> None:
    book = OperationBook()
    one = begun(book, transaction)
    assert book.gather(one, bytes(MAX_CONTENT - 2))
    assert not book.gather(one, b"abc")
    assert not book.gather(one, b"a")  # it would fit, and stand behind a gap
    assert (one._held, one.dropped) == (MAX_CONTENT - 2, 4)
    other = begun(book, transaction, "y")
    assert book.gather(other, bytes(MAX_CONTENT))
    assert not book.gather(other, b"a")
    assert not book.gather(other, b"a", alone=True)  # there is no room for it either
    assert (other._held, other.dropped) == (MAX_CONTENT, 2)
    last = begun(book, transaction, "z")
    last.dropped = 5
    assert not book.gather(last, b"ab")
    assert book.gather(last, b"ab", alone=True)
    book.close(last, "done")
    assert (last.content, last._pieces, last._held, last.dropped) == (b"ab", [], 0, 7)


def test_the_content_of_all_operations_has_a_bound_and_is_given_back(transaction: Transaction) -> None:
    book = OperationBook()
    piece = bytes(MAX_CONTENT)
    made = [begun(book, transaction, str(number)) for number in range(MAX_CONTENTS // MAX_CONTENT + 1)]
    assert [book.gather(one, piece) for one in made] == [True] * (len(made) - 1) + [False]
    assert not book.gather(made[-1], b"a", alone=True)
    made[0]._pieces[0] = b"content"  # what is joined need not be large here
    book.close(made[0], "done")
    assert made[0].content == b"content"
    assert book.gather(made[-1], piece, alone=True)
    assert not book.gather(made[1], b"a")


def test_an_open_operation_is_found_by_its_key_and_the_latest_by_who_asked(transaction: Transaction) -> None:
    book = OperationBook()
    first, second = begun(book, transaction, "a"), begun(book, transaction, "b")
    second.asked_by = 1 - first.asked_by
    going = transaction.connection.operations
    assert (going.find("upload", "a"), going.find("upload", "b")) == (first, second)
    assert (going.find("upload", "c"), going.find("download", "a")) == (None, None)
    for who, expected in ((-1, second), (first.asked_by, first), (second.asked_by, second)):
        assert going.latest("upload", who) is expected
    assert going.latest("download", -1) is None
    assert OpenOperations().latest("upload", -1) is None


def test_octets_of_an_answer_in_parts_have_their_packets(transaction: Transaction) -> None:
    """Of a range the packets with its first and last octet; beyond what is known the last packet."""
    one = begun(OperationBook(), transaction)
    one.places = [(100, 20), (200, 22), (300, 25)]
    one.last_frame = 30
    for start, end, frames in (
        (0, 50, [20]), (0, 100, [20]), (99, 101, [20, 22]), (100, 200, [22]), (0, 300, [20, 25]),
        (250, 400, [25, 30]), (300, 400, [30]),
    ):  # fmt: skip
        assert one.frames_of(start, end) == frames, (start, end)


def test_an_operation_has_nothing_but_its_first_transaction_at_first(transaction: Transaction) -> None:
    one = begun(OperationBook(), transaction)
    numbers = (
        one.number,
        one.likely,
        one.pushes,
        one.first_push_ns,
        one.last_push_ns,
        one.octets,
        one.dropped,
        one.lacking,
    )
    assert numbers == (0,) * 8
    assert (one.announced, one.gap, one.complete, one.begun, one.half_captured) == (-1, -1, False, True, False)
    assert (one.result, one.reason, one.error, one.content, one.places, one.steps, one.activation) == (
        "", "", None, b"", [], [], None,
    )  # fmt: skip
    going = OpenOperations()
    assert (going.these, going.halves, going.joiner, going.plus, going.set_up) == ([], [], None, None, False)
    block = Activation("DB 1, passive", [3, 4], 50)
    assert (block.due, block.frame, block.deleted) == (True, 0, False)
    assert not Activation("DB 1, active", [3, 4], 50).due
    block.deleted = True
    assert not block.due


@pytest.mark.parametrize(
    ("request_at", "response_at", "first", "last"),
    [((5, 50), (7, 70), 5, 7), ((0, 0), (7, 70), 7, 7), ((5, 50), (0, 0), 5, 5), ((9, 90), (7, 70), 9, 9)],
)
def test_an_operation_reaches_from_packet_to_packet(
    transaction: Transaction, request_at: tuple[int, int], response_at: tuple[int, int], first: int, last: int
) -> None:
    """Also if a half was not captured, or the answer was captured before the request."""
    transaction.request_frame, transaction.request_ns = request_at
    transaction.response_frame, transaction.response_ns = response_at
    one = begun(OperationBook(), transaction)
    assert (one.first_frame, one.begin_ns, one.last_frame, one.end_ns) == (first, 10 * first, last, 10 * last)
    transaction.request_frame, transaction.request_ns = 2, 20
    transaction.response_frame, transaction.response_ns = 12, 120
    one._add(transaction)
    assert (one.first_frame, one.begin_ns, one.last_frame, one.end_ns) == (first, 10 * first, 12, 120)


@pytest.mark.parametrize("count", [999, 1000, 1001])
def test_a_thousand_transactions_are_named(transaction: Transaction, count: int) -> None:
    one = begun(OperationBook(), transaction)
    for number in range(2, count + 1):
        transaction.number = number
        one._add(transaction)
    assert (one.parts, len(one.transactions), one.transactions[-1]) == (count, min(count, 1000), min(count, 1000))
