"""Transactions stand in the order of the capture, whatever waited behind a gap."""

from __future__ import annotations

import pytest

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.formats import FORMATS, TRANSACTIONS
from dissect.meaning.report.styled import Line, Written
from dissect.meaning.report.words import Places
from dissect.meaning.report.writer import TransactionFeed, Writer
from dissect.packets.source.packet import SourceFile
from tests.engine.transactions.talk import CLIENT, Talk, dbw, read, words


class Frames(Writer):
    """A line is the packets of a transaction; ``more`` lines stand below each."""

    def __init__(self, more: int = 0) -> None:
        super().__init__()
        self.more = more

    def begin(self, places: Places) -> None:
        super().begin(places)
        self.lines.append("head")

    def transaction(self, transaction: Transaction) -> None:
        name = f"{transaction.request_frame}→{transaction.response_frame}"
        self.lines += [name, *[f"{name} below"] * self.more]


class Taken(Observer):
    """Keeps transactions in the order in which they become certain."""

    def __init__(self) -> None:
        super().__init__()
        self.got: list[Transaction] = []

    def transaction(self, transaction: Transaction) -> None:
        self.got.append(transaction)


def text_of(line: Written) -> str:
    """Return a line as it is written where there is no terminal."""
    if isinstance(line, Line):
        return line.text
    return line if isinstance(line, str) else line.decode()


class Stepwise(Talk):
    """Looks for lines after each packet, or only at the end."""

    def __init__(self, observer: Observer, every: bool) -> None:
        super().__init__()
        self.pipeline = Pipeline(observer, Options(strict=True))
        self.feed = observer
        self.every = every
        self.lines: list[str] = []
        self.most = 0

    def packet(self, *of: object, **more: object) -> int:
        number = super().packet(*of, **more)  # type: ignore[arg-type]
        if self.every:
            self.look()
        return number

    def look(self) -> None:
        if isinstance(self.feed, TransactionFeed):
            lines = self.feed.take(int(self.pipeline.timers.oldest_held()))
            self.lines += [text_of(line) for line in lines]


def gap(observer: Observer, every: bool = False, polls: int = 2) -> Stepwise:
    """Two requests wait behind a gap that the server acknowledged; another connection is polled meanwhile."""
    talk = Stepwise(observer, every)
    other = Talk(client_port=50001, beside=talk)
    talk.open()
    other.open()
    talk.lose(CLIENT, read(1, dbw(1, 0)))
    for ref in (2, 3):
        talk.ask(read(ref, dbw(1, 0)))
        talk.tell(words(ref, 1))
        for more in range(polls):
            other.ask(read(2 * ref + more, dbw(9, 0)))
            other.tell(words(2 * ref + more, 1))
            talk.look() if every else None
    for ref in range(4, 9):
        talk.ask(read(ref, dbw(1, 0)))
        talk.tell(words(ref, 1))
    talk.ask(read(9, dbw(1, 0)))  # nobody answers
    talk.pipeline.finish()
    talk.look()
    return talk


def completed(transaction: Transaction) -> int:
    return int(max(transaction.request_frame, transaction.response_frame))


EXPECTED = [f"{at}→{at + 1}" for at in (6, 13, *range(15, 37, 2))] + ["37→0"]


def test_the_gap_of_these_tests_delays_transactions() -> None:
    """Else they would show nothing."""
    taken = Taken()
    gap(taken)
    came = [completed(one) for one in taken.got]
    assert came != sorted(came)


@pytest.mark.parametrize("every", [False, True])
@pytest.mark.parametrize("more", [0, 2])
def test_lines_stand_in_the_order_of_the_capture(every: bool, more: int) -> None:
    writer = Frames(more)
    writer.begin(Places([], False))
    got = gap(TransactionFeed(writer), every).lines
    assert got[0] == "head"
    assert got[1 :: 1 + more] == EXPECTED
    for at in range(1, len(got), 1 + more):
        assert got[at : at + 1 + more] == [got[at], *[f"{got[at]} below"] * more]


@pytest.mark.parametrize("name", ["text", "jsonl", "csv"])
def test_every_format_stands_in_the_order_of_the_capture(name: str) -> None:
    lines = {}
    for every in (False, True):
        writer = FORMATS[name].writer(TRANSACTIONS)
        writer.begin(Places([SourceFile("a.pcap", 1)], False))
        lines[every] = gap(TransactionFeed(writer), every).lines
    assert lines[True] == lines[False]
    taken = Taken()
    gap(taken)
    whole = FORMATS[name].writer(TRANSACTIONS)
    whole.begin(Places([SourceFile("a.pcap", 1)], False))
    for transaction in sorted(taken.got, key=lambda one: (one.response_frame == 0, completed(one))):
        whole.transaction(transaction)
    assert lines[False] == [text_of(line) for line in whole.take()]


def test_nothing_is_kept_where_nothing_is_held_back() -> None:
    writer = Frames()
    talk = Stepwise(TransactionFeed(writer), every=True)
    talk.open()
    for ref in range(1, 5):
        talk.ask(read(ref, dbw(1, 0)))
        talk.tell(words(ref, 1))
        assert writer.lines == []
        assert len(talk.lines) == 1 + ref


@pytest.mark.parametrize("bound", [{"most_lines": 3}, {"most_characters": 20}])
def test_what_is_kept_is_bounded(bound: dict[str, int]) -> None:
    """The oldest go out; nothing is lost, and a late one stands as early as it still can."""
    writer = Frames()
    talk = gap(TransactionFeed(writer, None, **bound), every=True, polls=6)
    assert writer.lines == []
    other = gap(TransactionFeed(Frames()), every=False, polls=6)
    assert talk.lines != other.lines
    assert sorted(talk.lines) == sorted(other.lines)
