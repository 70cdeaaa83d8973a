"""Values of SCD: who told whom, refused and unanswered requests, PDOs in both directions, SCD inside items of S7comm."""

from __future__ import annotations

from typing import Any

from dissect.engine.pipeline import Options, Pipeline
from dissect.meaning.report.words import Places
from dissect.output.variables.choosing import Known, choose, scd_names
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.model import RefusedRow, ValueRow
from dissect.output.variables.writers import ValueText, line_end, value_line
from dissect.wire.text import Clock
from tests.cases import each
from tests.engine.transactions import talk as line
from tests.engine.transactions.talk import CLIENT, SERVER, Talk
from tests.meaning.bindings import plant

_PANEL, _PLC = "10.0.0.1:49200", "10.0.0.2:5600"


def listening(*names: str, **options: Any) -> tuple[Talk, ValueCollector]:
    """A talk, and a collector of its values that decodes the SCD of the pumping station."""
    wanted = choose(names, Known(None, scd_names(plant.carrier()))) if names else None
    collector = ValueCollector(wanted, **options)
    talk = Talk()
    talk.pipeline = Pipeline(collector, Options(strict=True, decoder=plant.carrier()))
    return talk, collector


def ends(row: ValueRow) -> tuple[str, str]:
    return str(row.client), str(row.plc)


def test_a_read_is_at_its_answer_and_a_write_at_its_request() -> None:
    talk, collector = listening()
    asked = talk.datagram(CLIENT, plant.ask("Давление 1"))
    talk.datagram(SERVER, plant.tell("Давление 1", 2748))
    read_ns = talk.now_ns
    talk.datagram(CLIENT, plant.ask("Режим 1", 8))
    written_ns = talk.now_ns
    talk.datagram(SERVER, plant.tell("Режим 1"))
    read, write = collector.take()
    assert (read.how, read.address, read.tag, read.value, read.unit, read.writes) == (
        "read", "0x6001:0", "Давление 1", 1374.0, "кПа", False,
    )  # fmt: skip
    assert (write.how, write.address, write.tag, write.value, write.text, write.writes) == (
        "write", "0x6061:0", "Режим 1", 8, "автомат", True,
    )  # fmt: skip
    assert [(int(row.frame) - asked, int(row.time_ns)) for row in (read, write)] == [(1, read_ns), (2, written_ns)]
    assert {ends(row) for row in (read, write)} == {(_PANEL, _PLC)}
    assert (line_end(read, "p"), line_end(write, "m")) == ("p = 1374.0 кПа", "m = 8 (автомат)")
    assert (read.data, write.data) == (None, None)


def test_a_value_of_scd_is_compared_with_the_one_before() -> None:
    talk, collector = listening()
    for value in (8, 8, 0):
        talk.datagram(CLIENT, plant.ask("Режим 1"))
        talk.datagram(SERVER, plant.tell("Режим 1", value))
    rows = collector.take()
    assert [(row.value, row.first, row.changed, row.previous, row.previous_text) for row in rows] == [
        (8, True, True, None, ""), (8, False, False, 8, "автомат"), (0, False, True, 8, "автомат"),
    ]  # fmt: skip


@each(
    ("asked", "told", "error", "expected"),
    [
        (
            plant.ask("Давление 1", 100), plant.refuse("Давление 1", -4, service="write"), -4,
            ("write", "0x6001:0", "Давление 1", "write of a read-only object", (0, 1)),
        ),
        (
            plant.ask("Режим 1", 8), plant.tell("Режим 1", err=-19), -19,
            ("write", "0x6061:0", "Режим 1", "refused in this state of the device", (0, 1)),
        ),
        (
            plant.ask("Режим 1"), plant.tell("Режим 1", 8, err=-19), -19,
            ("read", "0x6061:0", "Режим 1", "refused in this state of the device", (1, 0)),
        ),
        # A refusal of a read has no value: what it names was refused all the same.
        (
            plant.ask("Расход 1"), plant.refuse("Расход 1", -5), -5,
            ("read", "0x6044:0", "Расход 1", "no such object", (1, 0)),
        ),
        (plant.ask("0x6fff"), plant.refuse("0x6fff", -5), -5, ("read", "0x6fff:0", "", "no such object", (1, 0))),
    ],
)  # fmt: skip
def test_what_a_device_refuses_is_no_value(asked: bytes, told: bytes, error: int, expected: tuple[object, ...]) -> None:
    talk, collector = listening(refusals=True)
    talk.datagram(CLIENT, asked)
    frame = talk.datagram(SERVER, told)
    (row,) = collector.take()
    (variable,) = collector.variables
    assert (row.how, row.address, row.tag, row.refused, (variable.refused_reads, variable.refused_writes)) == expected
    assert isinstance(row, RefusedRow)
    assert row.return_code == error
    assert (row.value, row.changed, int(row.frame), int(row.time_ns), ends(row)) == (
        None, False, frame, talk.now_ns, (_PANEL, _PLC),
    )  # fmt: skip
    assert (collector.refused, collector.unconfirmed) == (1, 0)


def test_a_refused_read_is_of_the_variable_that_has_values() -> None:
    talk, collector = listening(sums=True)
    talk.datagram(CLIENT, plant.ask("Давление 1"))
    talk.datagram(SERVER, plant.tell("Давление 1", 2748))
    talk.datagram(CLIENT, plant.ask("Давление 1"))
    talk.datagram(SERVER, plant.refuse("Давление 1", -19))
    (variable,) = collector.variables
    assert variable.statistics is not None
    assert (variable.statistics.count, variable.refused_reads, variable.unit) == (1, 1, "кПа")


def test_values_without_bytes_are_distinct_by_what_they_are() -> None:
    talk, collector = listening(sums=True)
    for value in (8, 8, 0, 8, 1):
        talk.datagram(CLIENT, plant.ask("Режим 1"))
        talk.datagram(SERVER, plant.tell("Режим 1", value))
    (variable,) = collector.variables
    found = variable.statistics
    assert found is not None
    assert (found.count, found.changes, found.distinct_count, found.distinct) == (5, 3, 3, {b"8", b"0", b"1"})
    assert (found.first, found.last, found.least, found.most) == (8, 1, 0, 8)


def test_a_write_without_an_answer_is_unconfirmed_and_a_read_is_nothing() -> None:
    talk, collector = listening(refusals=True)
    talk.datagram(CLIENT, plant.ask("Режим 1", 8))
    talk.datagram(CLIENT, plant.ask("Расход 1", tid=2))
    talk.finish()
    assert collector.take() == []
    assert [(one.address, one.unconfirmed) for one in collector.variables] == [("0x6061:0", 1)]
    assert (collector.refused, collector.unconfirmed) == (0, 1)


@each("side", (CLIENT, SERVER))
@each("name", ("T1", "T65", "R1"))
def test_a_pdo_is_of_the_device_whoever_sends_it(side: int, name: str) -> None:
    """The device sends its TPDOs to the other end; it gets its RPDOs from the other end, which gives the values."""
    talk, collector = listening()
    frame = talk.datagram(side, plant.pdo(name, run=False))
    talk.finish()
    rows = collector.take()
    assert len(rows) == len(plant.codec().pdo(name).map)
    sender, receiver = (_PANEL, _PLC) if side == CLIENT else (_PLC, _PANEL)
    expected = (sender, receiver) if name == "R1" else (receiver, sender)
    for row in rows:
        assert (row.how, ends(row), row.writes, int(row.frame)) == ("pdo", expected, name == "R1", frame)
    assert collector.plcs == [expected[1]]


_ITEM = bytes.fromhex("01C8050000000000 37020000000008")  # pump_t in the first 3 bytes, PDO T1 from byte 8 on


def test_scd_inside_an_item_is_beside_its_bytes() -> None:
    talk, collector = listening()
    talk.open()
    talk.ask(line.read(1, line.item(0x84, 10, 0, 2, 15)))
    talk.tell(line.ack_data(1, b"\x04\x01", line.good(4, _ITEM)))
    talk.ask(line.write(2, [line.item(0x84, 10, 0, 2, 15)], line.written(4, _ITEM)))
    talk.tell(line.ack_data(2, b"\x05\x01", b"\xff"))
    rows = collector.take()
    told = [
        ("DB10.DBB0", list(_ITEM)), ("pump_t.run", True), ("pump_t.fault", False), ("pump_t.speed", 1480),
        ("0x6041:0", 0x237), ("0x6044:0", 0), ("0x6061:0", 8),
    ]  # fmt: skip
    assert [(row.address, row.value) for row in rows] == [*told, *told]
    assert [row.how for row in rows] == ["read"] * 4 + ["pdo"] * 3 + ["write"] * 4 + ["pdo"] * 3
    assert [row.writes for row in rows] == [False] * 7 + [True] * 7
    assert {ends(row) for row in rows} == {("10.0.0.1:50000", "10.0.0.2:102")}


def test_scd_inside_items_of_which_one_is_refused() -> None:
    """It does not show which SCD values were refused: there are none."""
    talk, collector = listening()
    talk.open()
    talk.ask(line.read(1, line.item(0x84, 10, 0, 2, 15), line.dbw(7, 0)))
    talk.tell(line.ack_data(1, b"\x04\x02", line.good(4, _ITEM) + b"\0" + line.refused(0x0A)))
    talk.ask(line.write(2, [line.item(0x84, 10, 0, 2, 3)], line.written(4, _ITEM[:3])))
    talk.tell(line.ack_data(2, b"\x05\x01", b"\x05"))
    assert [row.address for row in collector.take()] == ["DB10.DBB0"]
    assert (collector.refused, [one.address for one in collector.variables if one.tag]) == (2, [])


def test_the_names_of_a_dictionary_are_those_of_its_variables() -> None:
    names = scd_names(plant.carrier())
    assert scd_names(None) == []
    assert len(names) == len(set(names))
    pump = plant.dictionary()[0x6000]
    run = pump[1].label
    for name in ("Режим 1", run, "Пороги давления.2", "Журнал"):
        assert name in names
        assert plant.dictionary().variable(name).label == name
    # Neither what only fills up nor an object of several variables is one.
    assert not [name for name in names if name.endswith(".") or name == pump.name]
    (wanted,) = choose([run.upper()], Known(None, names)).all
    assert (wanted.text, wanted.word, wanted.area) == (run.upper(), run.lower(), -1)


def test_objects_are_named_by_address_or_name() -> None:
    """In any order of the message, whatever their case; others are left out."""
    for name in ("0x6061:0", "Режим 1", "режим 1"):
        talk, collector = listening(name)
        talk.datagram(SERVER, plant.pdo("T1", **{"Режим 1": 8, "Расход 1": 5}))
        talk.datagram(CLIENT, plant.ask("Давление 1"))
        talk.datagram(SERVER, plant.tell("Давление 1", 2748))
        talk.datagram(CLIENT, plant.ask("Режим 1"))
        talk.datagram(SERVER, plant.tell("Режим 1", 0))
        assert [(row.address, row.value) for row in collector.take()] == [("0x6061:0", 8), ("0x6061:0", 0)]
        assert collector.found == {name}
        assert [one.address for one in collector.variables] == ["0x6061:0"]
    talk, collector = listening("Режим 1", "Расход 1", "Расход 2")
    talk.datagram(SERVER, plant.pdo("T1", **{"Режим 1": 8, "Расход 1": 5}))
    assert [(row.address, row.value) for row in collector.take()] == [("0x6044:0", 5), ("0x6061:0", 8)]
    assert collector.found == {"Режим 1", "Расход 1"}


def test_a_line_tells_how_each_value_came_and_between_whom() -> None:
    """In one packet: values of an item and of the PDO inside, PDOs of both ends."""
    talk, collector = listening()
    talk.open()
    talk.ask(line.read(1, line.item(0x84, 10, 0, 2, 15)))
    talk.tell(line.ack_data(1, b"\x04\x01", line.good(4, _ITEM)))
    talk.ports = [50000, plant.STREAM]
    talk.hello()
    talk.packet(SERVER, plant.pdo("T1") + plant.pdo("R1", run=False) + plant.pdo("T1", 1))
    rows = collector.take()
    assert len({int(row.frame) for row in rows[-8:]}) == 1
    assert {ends(row) for row in rows[-8:]} == {
        ("10.0.0.1:50000", f"10.0.0.2:{plant.STREAM}"), (f"10.0.0.2:{plant.STREAM}", "10.0.0.1:50000"),
    }  # fmt: skip
    writer = ValueText()
    writer.values(rows)
    assert [str(getattr(one, "text", one)) for one in writer.take()] == [
        value_line(row, Clock(), Places([], False)) for row in rows
    ]
    assert [row.how for row in rows] == ["read"] * 4 + ["pdo"] * (3 + 3 + 2 + 3)
