"""Which end has a variable: the one that is asked, whichever of both opened the connection; connections that end."""

from __future__ import annotations

import pytest

from dissect.engine.pipeline import Options, Pipeline
from dissect.meaning.report.words import Places
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.model import ValueRow
from dissect.output.variables.writers import RowWriter, ValueCsv, ValueJsonl, ValueText, value_line
from dissect.wire.text import Clock
from tests.engine.transactions import talk as line
from tests.engine.transactions.talk import CLIENT, SERVER, Talk
from tests.engine.transactions.test_results import PUSH as PUSHED
from tests.engine.transactions.test_results import (
    RESPONSE,
    TRANSFER,
    VARIABLES,
    asked_by_test,
    pushed_by_test,
    sent,
    subscribe,
)

_ENDS = ("10.0.0.1:50000", "10.0.0.2:102")


class Pair:
    """A connection on which one side asks and the other one answers."""

    def __init__(self, talk: Talk, asker: int) -> None:
        self.talk = talk
        self.asker = asker

    def ask(self, *pdus: bytes) -> int:
        return self.talk.packet(self.asker, line.dt(*pdus))

    def tell(self, *pdus: bytes) -> int:
        return self.talk.packet(1 - self.asker, line.dt(*pdus))


def everything(pair: Pair) -> None:
    """A read, one that is refused, a write, one that is refused, pushes, and values that are modified."""
    pair.ask(line.read(1, line.dbw(1, 0)))
    pair.tell(line.words(1, 5))
    pair.ask(line.read(2, line.dbw(1, 2)))
    pair.tell(line.ack_data(2, b"\x04\x01", line.refused(0x0A)))
    pair.ask(line.write(3, [line.dbw(1, 4)], line.written(4, b"\0\1")))
    pair.tell(line.ack_data(3, b"\x05\x01", b"\xff"))
    pair.ask(line.write(4, [line.dbw(1, 6)], line.written(4, b"\0\1")))
    pair.tell(line.ack_data(4, b"\x05\x01", b"\x05"))
    pair.ask(subscribe(5, TRANSFER, line.dbw(1, 8)))
    pair.tell(sent(RESPONSE, TRANSFER, 1, b"\xff\x04\x00\x10\x00\x07", reference=5))
    pair.tell(sent(PUSHED, TRANSFER, 1, b"\xff\x04\x00\x10\x00\x08"))
    pair.ask(asked_by_test(6, 8, VARIABLES[:1], b"\x00\x09\x00\x04\x41\x33\x85\x1f"))
    pair.tell(line.userdata(6, line.head(2, 1, 8, 2, 0)))
    pair.tell(pushed_by_test(8, 2, b"\x00\x01\xff"))


def listening(collector: ValueCollector) -> Talk:
    talk = Talk()
    talk.pipeline = Pipeline(collector, Options(strict=True))
    talk.open(8, 8)
    return talk


def test_a_variable_is_of_the_end_that_is_asked() -> None:
    """The connections one after another: neither is taken for the other, and both ends ask on the last one."""
    collector = ValueCollector(refusals=True)
    first = listening(collector)
    rows: list[ValueRow] = []
    for number, askers in enumerate(((CLIENT,), (SERVER,), (CLIENT, SERVER))):
        talk = first if not number else Talk(50000, beside=first)
        talk.hosts = [1 + 2 * number, 2 + 2 * number]
        if number:
            talk.open(8, 8)
        for asker in askers:
            everything(Pair(talk, asker))
            found = collector.take()
            ends = (f"10.0.0.{1 + 2 * number}:50000", f"10.0.0.{2 + 2 * number}:102")
            assert {(str(row.client), str(row.plc)) for row in found} == {(ends[asker], ends[1 - asker])}
            assert {row.host for row in found} == {ends[asker].partition(":")[0]}
            told = [
                ("read", "DB1.DBW0", False, False), ("read", "DB1.DBW2", False, True), ("write", "DB1.DBW4", True, False),
                ("write", "DB1.DBW6", True, True), ("push", "DB1.DBW8", False, False), ("push", "DB1.DBW8", False, False),
                ("modify", "MD0", True, False),
            ]  # fmt: skip
            # What the end that opened the connection sends unasked is no push.
            expected = told if asker == CLIENT else told[:5]
            assert [(row.how, row.address, row.writes, bool(row.refused)) for row in found] == expected
            rows += found
    # Each end has variables of its own.
    assert collector.plcs == ["10.0.0.2:102", "10.0.0.3:50000", "10.0.0.6:102", "10.0.0.5:50000"]
    assert len({id(row.variable) for row in rows}) == 2 * 6 + 2 * 5
    said_alike(rows)


def said_alike(rows: list[ValueRow]) -> None:
    """Each writer names the ends of each row, whatever row came before it."""
    lines = [value_line(row, Clock(), Places([], False)) for row in rows]
    writers: tuple[RowWriter, ...] = (ValueText(), ValueJsonl(), ValueCsv())
    for writer in writers:
        writer.values(rows)
        told = [str(getattr(one, "text", one.decode() if isinstance(one, bytes) else one)) for one in writer.take()]
        if isinstance(writer, ValueText):
            assert told == lines
            continue
        for row, text in zip(rows, told[-len(rows) :], strict=True):
            at, end = text.index(f"{row.host}"), text.index(str(row.plc))
            assert at < end
            assert f"{row.connection}" in text[:at]


def test_rows_in_any_order_are_written_alike() -> None:
    """Rows of one packet are rows of one connection; others have a beginning of their own."""
    collector = ValueCollector(refusals=True)
    talk = listening(collector)
    everything(Pair(talk, CLIENT))
    everything(Pair(talk, SERVER))
    rows = collector.take()
    said_alike([*rows[::2], *rows[1::2], *rows[::-1]])


@pytest.mark.parametrize("asker", [CLIENT, SERVER])
def test_what_is_known_of_a_connection_is_forgotten_at_its_end(asker: int) -> None:
    """The variables stay: the next connection to the same end goes on with them."""
    collector = ValueCollector()
    first = listening(collector)
    for number, value in enumerate((5, 6)):
        talk = first if not number else Talk(50000, beside=first)
        if number:
            talk.open(8, 8)
        pair = Pair(talk, asker)
        pair.ask(line.read(1, line.dbw(1, 0)))
        pair.tell(line.words(1, value))
        assert len(collector._store._ends) == 1
        talk.packet(CLIENT, flags=line.FIN | line.ACK)
        talk.packet(SERVER, flags=line.FIN | line.ACK)
        talk.packet(CLIENT)
        talk.silence(600 * line.SECOND)
    first.pipeline.finish()
    assert collector._store._ends == {}
    assert [(row.value, row.previous) for row in collector.take()] == [(5, None), (6, 5)]
