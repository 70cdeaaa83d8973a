"""With a push its subscription is cut out: what it is about stands in the part as in the whole."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import dissect
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.select import subscriptions
from dissect.meaning.select.selection import Selection, Wanted
from dissect.meaning.select.subscriptions import Asked, SubscriptionBook
from tests.cli.support import run
from tests.engine.transactions.talk import dbw
from tests.engine.transactions.test_results import MODIFY, ON_CHANGE, PUSH, RESPONSE, TRANSFER, sent, subscribe
from tests.meaning.report.support import begun, read, saved
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import Talk

Capfd = pytest.CaptureFixture[bytes]

VALUE = b"\xff\x04\x00\x10\x00\x07"


def subscribed() -> Talk:
    """Two jobs, the first of them modified; a push of each, and reads between all of it. The last push has no job."""
    talk = begun(amq=8)
    talk.send(0, dt(subscribe(1, TRANSFER, dbw(1, 0)))).send(1, dt(sent(RESPONSE, TRANSFER, 1, VALUE, reference=1)))
    read(talk, 2)
    talk.send(0, dt(subscribe(3, ON_CHANGE, dbw(2, 0)))).send(1, dt(sent(RESPONSE, ON_CHANGE, 2, VALUE, reference=3)))
    read(talk, 4)
    talk.send(1, dt(sent(PUSH, TRANSFER, 1, VALUE)))
    talk.send(0, dt(subscribe(5, MODIFY, dbw(3, 0), sequence=2)))
    talk.send(1, dt(sent(RESPONSE, MODIFY, 2, VALUE, reference=5)))
    talk.send(1, dt(sent(PUSH, ON_CHANGE, 2, VALUE))).send(1, dt(sent(PUSH, TRANSFER, 9, VALUE)))
    return read(talk, 6)


def told(path: Path) -> list[Transaction]:
    return [event for event in dissect.open(path, pdus=False) if isinstance(event, Transaction)]


def about(push: Transaction) -> list[tuple[str, bytes | None]]:
    return [(result.item.label if result.item is not None else "?", result.data) for result in push.s7_results]


def cut_each_push(capfdbinary: Capfd, path: Path, out: Path) -> list[list[Transaction]]:
    """Cut out each push alone; what it is about must not have changed."""
    parts = []
    for push in told(path):
        if push.outcome == "unsolicited":
            assert run(capfdbinary, "cut", path, "--transaction", str(push.number), "-o", out, "--force").code == 0
            parts.append(told(out))
            assert about(parts[-1][-1]) == about(push)
            assert [one.outcome for one in parts[-1][:-1]] == ["answered"] * (len(parts[-1]) - 1)
    return parts


def test_a_push_brings_the_requests_of_its_job(tmp_path: Path, capfdbinary: Capfd) -> None:
    path = saved(tmp_path / "in.pcapng", subscribed().packets())
    first, second, lone = cut_each_push(capfdbinary, path, tmp_path / "out.pcapng")
    assert [about(one) for one in first] == [[("DB1.DBW0", b"\0\7")]] * 2
    assert [about(one)[0][0] for one in second] == ["DB2.DBW0", "DB3.DBW0", "DB3.DBW0"]
    assert [about(one)[0][0] for one in lone] == ["?"]


def test_a_message_brings_its_subscription(tmp_path: Path, capfdbinary: Capfd, corpus: Path) -> None:
    path = corpus / "faults" / "wincc_s400_first_part.pcapng"
    out = tmp_path / "out.pcapng"
    message = next(one for one in told(path) if one.function_name == "CPU functions: ALARM_8 indication")
    assert run(capfdbinary, "cut", path, "--transaction", str(message.number), "-o", out).code == 0
    names = [one.function_name for one in told(out)]
    assert names[-1] == message.function_name
    assert names[:-1] == ["CPU functions: message service"] * 2


def test_a_notification_of_s7plus_brings_its_subscription(tmp_path: Path, capfdbinary: Capfd, corpus: Path) -> None:
    path, out = corpus / "s7plus" / "S71200_StartupGoOnline.pcapng", tmp_path / "out.pcapng"
    message = [one for one in told(path) if one.is_plus and one.outcome == "unsolicited"][-1]
    assert run(capfdbinary, "cut", path, "--transaction", str(message.number), "-o", out).code == 0
    assert [one.function_name.split()[-1] for one in told(out)] == ["CreateObject", "notification"]


class Noting(Observer):
    """Notes every transaction, as `cut` does."""

    def __init__(self) -> None:
        super().__init__()
        self.book = SubscriptionBook()
        self.pushes: list[Transaction] = []

    def transaction(self, transaction: Transaction) -> None:
        self.book.note(transaction, [int(transaction.request_frame)], [])
        if transaction.outcome == "unsolicited":
            self.pushes.append(transaction)


def noted(jobs: int, refused: int) -> Noting:
    """So many jobs that go on, then requests that are refused and begin nothing, and a push of the first job."""
    noting = Noting()
    talk = begun(amq=8)
    for number in range(jobs + refused):
        answer = messages.userdata(number, 2, 2, TRANSFER, error=0x8104)
        if number < jobs:
            answer = sent(RESPONSE, TRANSFER, number, VALUE, reference=number)
        talk.send(0, dt(subscribe(number, TRANSFER, dbw(1, number)))).send(1, dt(answer))
    talk.send(1, dt(sent(PUSH, TRANSFER, 0, VALUE)))
    pipeline = Pipeline(noting, Options(strict=True))
    for packet in talk.packets():  # without the end of the capture, which ends all jobs
        pipeline.frame(packet.time_ns, packet.octets, 0, len(packet.octets), packet.wire_length, packet.link_type)
    return noting


def test_requests_that_began_nothing_leave_and_those_of_jobs_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subscriptions, "_MANY", 8)
    noting = noted(jobs=3, refused=100)
    assert len(noting.book._asked) <= 8
    assert [asked.frames for asked in noting.book.of(noting.pushes[0])] == [[8]]
    assert noting.book.forgotten == 0


def test_with_too_many_jobs_the_oldest_leave_and_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subscriptions, "_MANY", 8)
    monkeypatch.setattr(subscriptions, "MAX_KEPT", 10)
    noting = noted(jobs=14, refused=0)
    assert len(noting.book._asked) <= 10
    assert noting.book.of(noting.pushes[0]) == []
    assert noting.book.forgotten == 1


def test_a_subscription_that_was_forgotten_is_uncertain(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a push its subscription is cut out; where that was dropped the part is not complete, and says so."""
    talk = begun(amq=8)
    for number in range(14):
        answer = sent(RESPONSE, TRANSFER, number, VALUE, reference=number)
        talk.send(0, dt(subscribe(number, TRANSFER, dbw(1, number)))).send(1, dt(answer))
    for job in (0, 13):
        talk.send(1, dt(sent(PUSH, TRANSFER, job, VALUE)))

    def cut(*pushes: int) -> tuple[int, int]:
        selection = Selection(Wanted(transactions=pushes))
        pipeline = Pipeline(selection, Options(strict=True))
        for packet in talk.packets():
            pipeline.frame(packet.time_ns, packet.octets, 0, len(packet.octets), packet.wire_length, packet.link_type)
        pipeline.finish()
        choice = selection.choice(0, 2**63 - 1)
        taken = [
            choice.takes(at, packet.time_ns, packet.octets, 0, len(packet.octets), packet.link_type)
            for at, packet in enumerate(talk.packets(), 1)
        ]
        return selection.uncertain, sum(taken)

    assert [cut(16), cut(17), cut(16, 17)] == [(0, 3), (0, 3), (0, 6)]
    monkeypatch.setattr(subscriptions, "_MANY", 8)
    monkeypatch.setattr(subscriptions, "MAX_KEPT", 10)
    assert [cut(16), cut(17), cut(16, 17)] == [(1, 1), (0, 3), (1, 4)]


class Book:
    """Notes requests of jobs that go on, by hand."""

    def __init__(self) -> None:
        self.book = SubscriptionBook()
        self.running = SimpleNamespace(transactions=[])
        self.connection = SimpleNamespace(operations=SimpleNamespace(these=[self.running]))

    def note(self, number: int, going: bool) -> None:
        if going:
            self.running.transactions.append(number)
        request: Any = SimpleNamespace(
            number=number, connection=self.connection, request_ns=5, response_ns=9, is_plus=True
        )
        request.parameters, request._outcome = SimpleNamespace(userdata=None), -1
        self.book.note(request, [number], [])

    def kept(self) -> list[int]:
        return list(self.book._asked)


def test_requests_are_looked_at_when_their_number_has_doubled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subscriptions, "_MANY", 8)
    book = Book()
    for number in range(8):
        book.note(number, number < 6)
    assert book.kept() == list(range(8))  # the next one makes them too many
    book.note(8, False)
    assert book.kept() == [0, 1, 2, 3, 4, 5, 8]
    for number in range(9, 14):
        book.note(number, False)
    assert len(book.kept()) == 12  # two times the six that stayed
    book.note(14, True)
    assert book.kept() == [0, 1, 2, 3, 4, 5, 14]


def test_at_the_bound_the_oldest_quarter_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subscriptions, "_MANY", 8)
    monkeypatch.setattr(subscriptions, "MAX_KEPT", 12)
    book = Book()
    for number in range(12):
        book.note(number, True)
    assert book.kept() == list(range(12))
    book.note(12, True)
    assert book.kept() == list(range(3, 13))
    for number in range(13, 16):
        book.note(number, True)
    assert book.kept() == list(range(6, 16))


def test_a_request_is_remembered_with_its_times() -> None:
    for request_ns, response_ns, expected in ((5, 9, (5, 9)), (9, 5, (5, 9)), (5, 0, (5, 5)), (0, 9, (9, 9))):
        one: Any = SimpleNamespace(number=3, connection=None, request_ns=request_ns, response_ns=response_ns)
        asked = Asked(one, [1], [])
        assert (asked.from_ns, asked.to_ns, asked.number, asked.frames) == (*expected, 3, [1])


def test_at_the_bound_all_are_looked_at_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each look goes over all that is kept: at one for each request, a long capture would take the square of its length."""
    monkeypatch.setattr(subscriptions, "MAX_KEPT", 64)
    looks: list[int] = []
    drop = SubscriptionBook._drop

    def counted(book: SubscriptionBook) -> None:
        looks.append(len(book._asked))
        drop(book)

    monkeypatch.setattr(SubscriptionBook, "_drop", counted)
    running = SimpleNamespace(transactions=range(10_000))  # one operation to which all requests belong
    connection = SimpleNamespace(operations=SimpleNamespace(these=[running]))
    book = SubscriptionBook()
    of_plus = SimpleNamespace(userdata=None)
    for number in range(1, 641):
        request: Any = SimpleNamespace(number=number, connection=connection, request_ns=number, response_ns=0)
        request.is_plus, request.parameters, request._outcome = True, of_plus, -1
        book.note(request, [number], [])
    assert len(looks) <= 640 // 16 + 1
    assert len(book._asked) > 32
