"""``-T fields``: a line for each result, a cell for each field; what a cell says may be asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from dissect.engine.pipeline import Options, Pipeline
from dissect.files.session import Run
from dissect.meaning.bindings.engine import ScdCarrier
from dissect.meaning.report.formats import FORMATS
from dissect.meaning.report.writer import PduFeed
from dissect.meaning.select import SelectError, Where
from dissect.meaning.select.columns import FieldsWriter
from dissect.meaning.select.fields import FIELDS, Field
from dissect.meaning.select.getters import items
from dissect.meaning.select.things import CONNECTION, MESSAGE, OPERATION, TRANSACTION, Context
from tests.engine.transactions import talk as crafted
from tests.engine.transactions.talk import CLIENT, Talk, dbw, read, words
from tests.meaning.bindings import plant
from tests.meaning.select.support import CAPTURES, NAMES, Gathered, gathered
from tests.protocols.s7plus.pdus import asked, framed

_GATHERED: Final = (NAMES, ("crafted/plus-plant",), ("crafted/coverage-userdata",))


def written(name: str, kind: str, *names: str) -> list[list[str]]:
    """Return the cells of all transactions, operations or messages of a capture."""
    writer = FieldsWriter()
    found = Gathered()
    run = Run([CAPTURES / f"{name}.pcapng"], found)
    while run.step():
        pass
    writer.write_fields(names, found.context)
    for thing in found.things[kind]:
        if kind == TRANSACTION:
            writer.transaction(thing)
        elif kind == OPERATION:
            writer.operation(thing)
    return [str(line).split("\t") for line in writer.take()]


def test_a_line_for_each_transaction() -> None:
    lines = written(
        "item-errors", TRANSACTION, "number", "Function", "outcome", "frame", "latency", "address", "pushes"
    )
    assert [line[0] for line in lines] == [str(number) for number in range(1, 9)]
    assert lines[2][:4] == ["3", "Read Var", "answered", "12,13"]
    assert [line[1] for line in lines] == ["Setup communication", *["Read Var"] * 4, *["Write Var"] * 3]
    assert all(line[4].isdigit() for line in lines)
    assert {line[6] for line in lines} == {
        ""
    }  # no field of transactions: empty, and those behind it stay in their places
    lines = written("item-errors", TRANSACTION, "pushes", "number")
    assert [line for line in lines if line[0] == ""] == lines
    assert lines[0] == ["", "1"]


def test_items_keep_their_places() -> None:
    """A place for each item in every list, empty where it has no value."""
    lines = written("item-errors", TRANSACTION, "address", "value", "return_code", "error")
    several = [line for line in lines if "," in line[0]]
    assert several
    for line in several:
        count = line[0].count(",")
        assert line[2].count(",") == count, line
    assert any(cell == "" for line in several for cell in line[1].split(","))


def test_a_line_for_each_operation() -> None:
    lines = written("transfer", OPERATION, "kind", "result", "subject", "latency")
    assert lines
    assert all(len(line) == 4 and line[0] and line[1] and line[3] == "" for line in lines)


def test_it_is_a_format_of_commands() -> None:
    assert any(getattr(row, "name", row) == "fields" for row in FORMATS)


def every_cell() -> Any:
    """Give each thing that the captures hold with each of its fields that has a value, as it is shown."""
    for names in _GATHERED:
        found = gathered(*names)
        for kind, things in found.things.items():
            for field in FIELDS.values():
                get = field.getters.get(kind)
                if get is None:
                    continue
                for thing in things[::5]:
                    for one in as_list(get(thing, found.context)):
                        yield kind, field, thing, field.kind.shown(one)


def as_list(value: Any) -> list[Any]:
    """Return the values of a field, none for None."""
    return [*value] if type(value) in (list, tuple) else [] if value is None else [value]


def test_what_a_cell_says_may_be_asked_for() -> None:
    """``FIELD == CELL`` selects what the cell is of: numbers and names as they are, texts in quotes, durations in ns."""
    seen: dict[tuple[str, str], int] = {}
    for kind, field, thing, cell in every_cell():
        forms = (
            f"{field.name} == {cell}",
            f'{field.name} == "{cell}"',
            f"{field.name} == '{cell}'",
            f"{field.name} == {cell}ns",
        )
        assert any(selects(form, kind, thing) for form in forms), (kind, field.name, cell)
        seen[kind, field.name] = seen.get((kind, field.name), 0) + 1
    assert len(seen) > 80
    assert {kind for kind, _ in seen} >= {TRANSACTION, OPERATION, MESSAGE, CONNECTION}


def selects(expression: str, kind: str, thing: object) -> bool:
    try:
        predicate = Where(expression).predicate(kind)
    except SelectError:
        return False
    return bool(predicate(thing))


def of_items(field: Field, thing: Any, context: Context) -> list[object]:
    assert field.of_item is not None
    return [field.of_item(item, context) for item in items(thing, context)]


def test_each_item_has_what_the_list_of_its_transaction_has() -> None:
    """Fields of items: what single items have is what the whole has, in their order, without those that have none."""
    seen = 0
    for names in _GATHERED:
        found = gathered(*names)
        for field in FIELDS.values():
            get = field.getters.get(TRANSACTION)
            if field.of_item is None or get is None or TRANSACTION not in field.with_items:
                continue
            for thing in found.things[TRANSACTION][::7]:
                flat: list[str] = []
                for value in of_items(field, thing, found.context):
                    flat += [field.kind.shown(one) for one in as_list(value)]
                assert [field.kind.shown(one) for one in as_list(get(thing, found.context))] == flat, field.name
                seen += len(flat)
    assert seen > 100


# ---- lines of crafted talks -----------------------------------------------------------------------------------------


def lines_of(say: Callable[[Talk], None], *names: str, decoder: ScdCarrier | None = None) -> list[list[str]]:
    """Return the cells of each message of a talk, as `show` has them."""
    writer, talk = FieldsWriter(), Talk()
    writer.write_fields(names, Context())
    talk.pipeline = Pipeline(PduFeed(writer, decoder=decoder), Options(strict=True, decoder=decoder))
    say(talk)
    return [str(row).split("\t") for row in writer.take()]


def test_a_line_for_each_message_says_whether_it_is_behind_a_malformed_header() -> None:
    def say(talk: Talk) -> None:
        talk.open()
        talk.packet(CLIENT, crafted.tpkt(b"\x01\xf0" + read(42, dbw(1, 0))))  # 8: one octet is missing in its header
        talk.tell(words(42, 7))
        talk.close()

    assert lines_of(say, "frame", "protocol", "behind_malformed", "cut", "dst", "time", "address") == [
        [str(frame), protocol, behind, "false", receiver, f"2020-09-13T12:26:40.{frame:03}000000Z", address]
        for frame, protocol, behind, receiver, address in (
            (4, "cotp", "false", "10.0.0.2:102", ""),
            (5, "cotp", "false", "10.0.0.1:50000", ""),
            (6, "s7comm", "false", "10.0.0.2:102", ""),
            (7, "s7comm", "false", "10.0.0.1:50000", ""),
            (8, "s7comm", "true", "10.0.0.2:102", "DB1.DBW0"),
            (9, "s7comm", "false", "10.0.0.1:50000", ""),
        )
    ]


def test_a_tpdu_without_a_pdu_is_behind_nothing() -> None:
    """It is itself what is malformed."""

    def say(talk: Talk) -> None:
        talk.open()
        talk.packet(CLIENT, crafted.tpkt(b"\x01\xf0" + b"\x80"))
        talk.close()

    assert lines_of(say, "frame", "protocol", "behind_malformed")[-1] == ["8", "cotp", "false"]


def test_a_message_that_the_capture_cut_off_says_so() -> None:
    def say(talk: Talk) -> None:
        talk.open()
        talk.packet(CLIENT, crafted.dt(read(1, dbw(1, 0))), cut=4)
        talk.close()

    assert lines_of(say, "frame", "cut")[-1] == ["8", "true"]


def test_a_line_for_each_message_of_scd() -> None:
    def say(talk: Talk) -> None:
        talk.datagram(0, plant.ask("0x6001:0", tid=7))
        talk.datagram(1, plant.tell("0x6001:0", 50, tid=7))
        talk.finish()

    names = ("frame", "protocol", "src", "scd.tid", "scd.value", "cut", "address", "value")
    assert lines_of(say, *names, decoder=plant.carrier()) == [
        ["1", "scd", "10.0.0.1:49200", "7", "", "false", "", ""],
        ["2", "scd", "10.0.0.2:5600", "7", "25.0", "false", "0x6001:0", ""],
    ]


def test_a_line_for_each_pdu_of_s7comm_plus() -> None:
    def say(talk: Talk) -> None:
        talk.hello()
        talk.connect()
        talk.ask(framed(asked(1)))
        talk.finish()

    assert lines_of(say, "frame", "protocol", "s7plus.version", "pdu_ref") == [
        ["4", "cotp", "", ""], ["5", "cotp", "", ""], ["6", "s7comm_plus", "2", "1"],
    ]  # fmt: skip


def test_cells_have_a_place_for_each_item_and_each_value_of_one() -> None:
    """Commas between items, semicolons between the values of one; what comes from the wire is escaped."""
    writer, talk = FieldsWriter(), Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0, 2), dbw(9, 0), dbw(2, 0)))
    refused, three = crafted.refused(0x0A), b"\x04\x03"
    talk.tell(crafted.ack_data(1, three, crafted.good(4, b"\0\5\0\6") + refused + crafted.good(4, b"\0\7")))
    writer.write_fields(["Value", "address", "host", "VLAN", "slug", "items.db", "error"], Context())
    writer.transaction(talk.transactions[0])
    (cells,) = [str(one).split("\t") for one in writer.take()]
    assert cells == [
        "5;6,,7", "DB1.DBW0 x2,DB9.DBW0,DB2.DBW0", "10.0.0.1:50000,10.0.0.2:102", "", "", "1,9,2", "Object does not exist",
    ]  # fmt: skip


def test_values_of_scd_have_their_names_and_units() -> None:
    found = gathered(*NAMES)
    seen = []
    for message in found.things[MESSAGE]:
        if message.scd is None:
            continue
        rows, facts = message.scd.values, list(items(message, found.context))
        assert [(fact.name, fact.unit) for fact in facts] == [(row.name or None, row.unit or None) for row in rows]
        seen += facts
    assert any(fact.name and fact.unit for fact in seen)
    assert any(fact.unit is None for fact in seen)
