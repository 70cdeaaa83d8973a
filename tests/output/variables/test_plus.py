"""Values of S7comm-plus: reads, writes, notifications of a made conversation; what is refused, by the names of a program."""

from __future__ import annotations

from typing import Any

from dissect.engine.pipeline import Options, Pipeline
from dissect.output.variables.choosing import Known, choose
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.model import RefusedRow
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.objects import build_object
from dissect.protocols.s7plus.tables import EXPLORE, SET_MULTI_VARIABLES
from dissect.protocols.s7plus.value_tables import INT
from dissect.protocols.s7plus.values import Value
from dissect.wire.varint import VLQ64, build_varint
from tests.engine.transactions import talk as line
from tests.engine.transactions.talk import CLIENT, SERVER, Talk
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import NOTIFICATION_V3, asked, framed, told
from tests.protocols.s7plus.test_program import type_of, variable

_LEVEL = VariableAddress(0, 0x8A0E0001, 2550, [14])
_FLOW = VariableAddress(0, 0x8A0E0001, 2550, [15])
_UNKNOWN = VariableAddress(0, 0x8A0E0001, 2550, [16])


def number(value: int) -> Value:
    return Value(0, INT, value)


class Station:
    """A conversation in which the variables of a block were declared: ``level`` and ``flow``, each an Int."""

    def __init__(self, *names: str, **options: Any) -> None:
        wanted = choose(names, Known(None)) if names else None
        self.collector = ValueCollector(wanted, **options)
        self.talk = Talk()
        self.talk.pipeline = Pipeline(self.collector, Options(strict=True))
        self.talk.hello()
        self.talk.connect()
        kind = type_of(0x92000001, ("level", variable(14, 5)), ("flow", variable(15, 5)))
        block = bodies.rid(_LEVEL.area)
        self.ask(asked(1, EXPLORE, body=block + b"\0\1\1\0\0\0" + bodies.end(1) + b"\0"), 3)
        self.tell(told(1, EXPLORE, b"\0" + block + bodies.number(2) + build_object(kind) + bodies.FILL), 3)
        self.sequence = 1

    def ask(self, body: bytes, version: int = 3) -> int:
        return self.talk.packet(CLIENT, line.dt(framed(body, version)))

    def tell(self, body: bytes, version: int = 3) -> int:
        return self.talk.packet(SERVER, line.dt(framed(body, version)))

    def read(self, *wanted: VariableAddress, values: list[tuple[int, Value]], refused: list[tuple[int, int]]) -> int:
        """Read; return the packet of the answer."""
        self.sequence += 1
        self.ask(asked(self.sequence, body=bodies.get_multi(*wanted)))
        return self.tell(told(self.sequence, body=bodies.multi_got(values, refused)))

    def write(self, *pairs: tuple[VariableAddress, Value], refused: list[tuple[int, int]] | None = None) -> int:
        """Write; return the packet of the request, which has an answer unless ``refused`` is None."""
        self.sequence += 1
        frame = self.ask(asked(self.sequence, SET_MULTI_VARIABLES, body=bodies.set_multi(list(pairs))))
        if refused is not None:
            codes = b"".join([bodies.number(item) + build_varint(code, VLQ64) for item, code in refused])
            self.tell(told(self.sequence, SET_MULTI_VARIABLES, b"\0" + codes + b"\0" + bodies.end(9)))
        return frame


def test_each_item_is_a_value_or_a_refusal() -> None:
    """A value that is written is at its request, all else at the answer; who is refused has the declared type as well."""
    station = Station(refusals=True)
    read = station.read(_LEVEL, _FLOW, values=[(1, number(5))], refused=[(2, 0x8104)])
    write = station.write((_LEVEL, number(6)), (_FLOW, number(7)), refused=[(2, 0x8105)])
    rows = station.collector.take()
    assert [(row.how, row.address, row.type, row.value, row.writes, int(row.frame)) for row in rows] == [
        ("read", 'DB1."level"', "Int", 5, False, read), ("read", 'DB1."flow"', "Int", None, False, read),
        ("write", 'DB1."level"', "Int", 6, True, write), ("write", 'DB1."flow"', "Int", None, True, write + 1),
    ]  # fmt: skip
    assert [(row.return_code, row.refused) for row in rows if isinstance(row, RefusedRow)] == [
        (0x8104, "0x8104"), (0x8105, "0x8105"),
    ]  # fmt: skip
    assert [(row.data, row.first, row.previous) for row in rows if not row.refused] == [
        (b"\0\5", True, None), (b"\0\6", False, 5),
    ]  # fmt: skip
    assert {(row.host, str(row.plc)) for row in rows} == {("10.0.0.1", "10.0.0.2:102")}
    assert [(one.address, one.refused_reads, one.refused_writes) for one in station.collector.variables] == [
        ('DB1."level"', 0, 0), ('DB1."flow"', 1, 1),
    ]  # fmt: skip
    assert (station.collector.refused, station.collector.unconfirmed) == (2, 0)


def test_a_write_without_an_answer_is_unconfirmed() -> None:
    station = Station(refusals=True)
    station.write((_LEVEL, number(8)), (_UNKNOWN, number(9)))
    station.talk.finish()
    assert station.collector.take() == []
    assert [(one.address, one.type, one.unconfirmed) for one in station.collector.variables] == [
        ('DB1."level"', "Int", 1), ("DB1 LID 16", "Int", 1),
    ]  # fmt: skip
    assert (station.collector.refused, station.collector.unconfirmed) == (0, 2)


def test_a_read_of_which_an_item_has_no_answer() -> None:
    """It is neither a value nor refused."""
    station = Station(refusals=True)
    station.read(_LEVEL, _FLOW, values=[(2, number(5))], refused=[])
    assert [(row.address, row.value) for row in station.collector.take()] == [('DB1."flow"', 5)]
    assert (station.collector.refused, station.collector.unconfirmed) == (0, 0)


def test_the_type_is_that_of_the_value_where_none_is_declared() -> None:
    station = Station()
    station.read(_FLOW, values=[], refused=[(1, 0x8104)])
    assert [(one.address, one.type) for one in station.collector.variables] == [('DB1."flow"', "Int")]
    station = Station()
    station.read(_UNKNOWN, values=[], refused=[(1, 0x8104)])
    (one,) = station.collector.variables
    assert (one.address, one.type) == ("DB1 LID 16", "")
    station.read(_UNKNOWN, values=[(1, number(5))], refused=[])
    assert (one.type, one.value) == ("Int", 5)


def test_a_notification_of_a_subscription_that_was_not_captured() -> None:
    station = Station()
    frame = station.talk.packet(SERVER, line.dt(NOTIFICATION_V3))
    rows = station.collector.take()
    assert [(row.how, row.address, row.type, row.writes, int(row.frame)) for row in rows] == [
        ("notification", "item 25", "Real", False, frame), ("notification", "item 27", "Real", False, frame),
    ]  # fmt: skip
    assert {(row.host, str(row.plc)) for row in rows} == {("10.0.0.1", "10.0.0.2:102")}


def test_names_that_are_wanted() -> None:
    """Whatever their case, and in any order; others are left out and not remembered."""
    station = Station('DB1."FLOW"', "db1 LID 16", "DB1 LID 17", refusals=True)
    station.read(_LEVEL, _FLOW, _UNKNOWN, values=[(1, number(5)), (2, number(6))], refused=[(3, 0x8104)])
    assert [(row.address, row.value, row.refused) for row in station.collector.take()] == [
        ('DB1."flow"', 6, ""), ("DB1 LID 16", None, "0x8104"),
    ]  # fmt: skip
    assert station.collector.found == {'DB1."FLOW"', "db1 LID 16"}
    assert [one.address for one in station.collector.variables] == ['DB1."flow"', "DB1 LID 16"]


def test_the_end_that_is_asked_has_the_variable() -> None:
    """Also where it opened the connection."""
    station = Station()
    station.talk.packet(SERVER, line.dt(framed(asked(2, body=bodies.get_multi(_UNKNOWN)), 3)))
    station.talk.packet(CLIENT, line.dt(framed(told(2, body=bodies.multi_got([(1, number(5))], [])), 3)))
    (row,) = station.collector.take()
    assert (str(row.client), str(row.plc), row.host) == ("10.0.0.2:102", "10.0.0.1:50000", "10.0.0.2")


def test_an_answer_without_its_request_has_no_values() -> None:
    station = Station()
    station.tell(told(77, body=bodies.multi_got([(1, number(5))], [])))
    station.talk.finish()
    assert (station.collector.take(), station.collector.variables) == ([], [])
