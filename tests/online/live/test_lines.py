from __future__ import annotations

from dissect.engine.pipeline import Options
from dissect.online.live.events import CLOSED, FINDING, OPENED, PROBLEM, TRANSACTION, Event
from dissect.online.live.lines import TOPICS, PlainLines, kinds_of, summary_lines
from dissect.online.live.session import Session, Status
from dissect.packets.source.live.reader import Drops
from tests.meaning.report.support import UNSAFE, WORD, begun, read
from tests.online.live.support import Clock, Line, never, taken
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import EPOCH_NS, Packet


def events_of(packets: list[Packet]) -> list[Event]:
    session = Session(lambda: Line(Clock(), [packets], ends=True), Options(strict=True))
    session.start()
    return taken(session, never)


def lines_of(packets: list[Packet], *topics: str) -> list[str]:
    return PlainLines(kinds_of(topics)).lines(events_of(packets))


def conversation() -> list[Packet]:
    talk = read(begun(), 1)
    read(talk, 2, content=0x0A)
    return talk.send(0, dt(messages.read_job(3, [WORD]))).reset(1).packets()


def test_each_event_is_a_line() -> None:
    lines = lines_of(conversation())
    heads = [line[32:] for line in lines]
    assert heads[0] == "connection 1  10.0.0.1:49152 → 10.0.0.2:102  opened"
    assert "Setup communication" in heads[1]
    assert heads[3].startswith("#2     8→9 ")
    assert heads[5].startswith(
        "WARNING  transaction.item_error  connection 1, packets 10, 11: Read Var DB10.DBW4: 0x0a "
    )
    assert heads[-2].startswith(
        "connection 1  10.0.0.1:49152 → 10.0.0.2:102  reset by the server at packet 13 with 1 request pending"
    )
    assert heads[-2].endswith("(3 answered, 1 UNANSWERED, 1 with errors)")
    assert all("\n" not in line for line in lines)


def test_only_what_is_wanted() -> None:
    packets = conversation()
    assert sorted(line for topic in TOPICS for line in lines_of(packets, topic)) == sorted(lines_of(packets))
    assert all("connection 1  10.0.0.1" in line for line in lines_of(packets, "connections"))
    assert len(lines_of(packets, "connections")) == 2
    assert len(lines_of(packets, "connections", "transactions")) == 6


def test_topics_are_kinds_and_problems_are_never_left_out() -> None:
    assert kinds_of(["findings"]) == {FINDING, PROBLEM}
    assert kinds_of(["connections", "transactions"]) == {OPENED, CLOSED, TRANSACTION, PROBLEM}
    assert kinds_of([]) == {PROBLEM, *[kind for kinds in TOPICS.values() for kind in kinds]}


def test_what_the_wire_says_is_harmless() -> None:
    line = PlainLines(kinds_of([])).line(Event(PROBLEM, EPOCH_NS, "evil\x1b[2J\u202e\nname"))
    assert not UNSAFE.search(line)
    assert "name" in line


def test_what_is_not_shown_is_counted() -> None:
    line = PlainLines(kinds_of([])).lost(EPOCH_NS, {TRANSACTION: 1200, OPENED: 1})
    assert line.endswith("NOT SHOWN  1 connection opened, 1200 transactions: this output is not taken fast enough")


def status(**more: object) -> Status:
    values: dict[str, object] = dict.fromkeys(Status._fields, 0)
    values["drops"] = Drops(None, None)
    return Status(**{**values, **more})  # type: ignore[arg-type]


def test_the_summary_says_what_was_lost() -> None:
    assert summary_lines(status(packets=1, connections=2, transactions=3), "file") == [
        "1 packet, 2 connections, 3 transactions, 0 findings"
    ]
    told = summary_lines(
        status(
            packets=9, transactions=3, unanswered=1, with_errors=2, findings=1, drops=Drops(12, None), lost_events=5
        ),
        "dumpcap",
    )
    assert told == [
        "9 packets, 0 connections, 3 transactions (1 unanswered, 2 with errors), 1 finding",
        "packets lost while capturing: 12 by the kernel, an unknown number by the interface",
        "events not shown because the output was too slow: 5",
    ]
    assert "does not report it here" in summary_lines(status(), "pipe")[1]
