"""What an expression selects: conditions one by one on a known capture, and what holds for all of them."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, Final

from hypothesis import given, settings
from hypothesis import strategies as st

import dissect
from dissect.meaning.select import Where
from dissect.meaning.select.fields import FIELDS, Field
from dissect.meaning.select.items import ItemFacts
from dissect.meaning.select.literals import AnyValue, Code, Duration, Host, Number, Octets, S7Address, Text, Time, Truth
from dissect.meaning.select.things import FINDING, TRANSACTION
from tests.cases import each
from tests.meaning.report.support import begun, read, saved
from tests.meaning.select.support import CAPTURES, NAMES, gathered
from tests.properties.messages import Item


def numbers(expression: str) -> list[int]:
    """Return the numbers of the transactions of item-errors.pcapng that an expression selects."""
    found = gathered("item-errors")
    where = Where(expression, context=found.context)
    return [int(one.number) for one in found.things[TRANSACTION] if where.transaction(one)]


#: Of eight transactions: 1 Setup, 2 to 5 Read Var, 6 to 8 Write Var (captures/golden has them in words).
SELECTED: Final[list[tuple[str, list[int]]]] = [
    ("number == 3", [3]),
    ("number != 3 and number < 0x6", [1, 2, 4, 5]),
    ("number in {1, 3..4, 7..}", [1, 3, 4, 7, 8]),
    ("number not in {1..7}", [8]),
    ("function == 'Read Var'", [2, 3, 4, 5]),
    ("function == read_var", [2, 3, 4, 5]),
    ("function == READ", [2, 3, 4, 5]),
    ("function == 5", [6, 7, 8]),
    ("function >= 5", [1, 6, 7, 8]),
    ("function contains setup", [1]),
    ('function matches "^write"', [6, 7, 8]),
    ('function matches "[[w]rite"', [6, 7, 8]),  # Python warns of it
    ("function.name eq write", [6, 7, 8]),
    ("failed", [2, 3, 4, 5, 6, 7, 8]),
    ("not failed", [1]),
    ("failed == false", [1]),
    ("error", [2, 3, 4, 5, 6, 7, 8]),
    ('error == "Object does not exist"', [2, 5, 6, 8]),
    ("error == 0x0a", [2, 5, 6, 8]),
    ("errors.code == 0x0a && !(function == write)", [2, 5]),
    ("error === 0x0a", [2, 6]),
    ("error !== 0x0a", [3, 4, 5, 7, 8]),
    ("error != 0x0a", [3, 4, 7]),
    ("not error == 0x0a", [1, 3, 4, 7]),
    ("db == 99", [2, 5, 6, 8]),
    ("db == 0", []),
    ("area == M", [4, 5, 8]),
    ("area == 'data block' and not area == M", [2, 3, 6, 7]),
    ("area == E", [5, 8]),
    ("address == DB2.DBD16", [5, 8]),
    ("address == db2.dbd16", [5, 8]),
    ("address == EB500", [5, 8]),
    ("address == DB99.DBB0 x4", [2, 5, 8]),
    ("address == DB99.DBB0", [2, 5, 6, 8]),
    ("address overlaps DB99.DBX1.7", [2, 5, 6, 8]),
    ("address overlaps DB99.DBX2.0", [2, 5, 8]),
    ("address overlaps DB99", [2, 5, 6, 8]),
    ("address overlaps MW139", [4]),
    ("address overlaps MB140", []),
    ("address overlaps DB10.DBW2", [5, 8]),
    ("address overlaps DB10.DBW4", []),
    ("address contains db2", [3, 5, 7, 8]),
    ("value == 3.5", [5]),
    ("value[DB2.DBD16] == 3.5", [5]),
    ("value[DB10.DBW0] == 3.5", []),
    ("value[DB10.DBW0] == 515", [5]),
    ("value[DB10] > 500", [5]),
    ("value == true", [8]),
    ("value == false", [5]),
    ("value == 1", [5, 6, 7, 8]),
    ("data contains 01:02:03", [5, 7]),
    ("data contains 010203", [5, 7]),
    ("data == 01-02", [6]),
    ("type == REAL", [5, 8]),
    ("count == 10", [3]),
    ("items > 1", [5, 8]),
    ("return_code[DB99] == 0xff", []),
    ("return_code[DB1] == 0xff", [5, 8]),
    ("return_code != 0xff", [2, 3, 4, 6, 7]),
    ("outcome == answered", [1, 2, 3, 4, 5, 6, 7, 8]),
    ("latency > 79 us", [2]),
    ("latency > 79.5us and latency < 0.08 ms", [2]),
    ("latency_ns > 79000", [2]),
    ("latency in {44us..45us}", [3]),
    ("time >= 9ms", [8]),
    ("time > 2026-11-21T01:31:05.701", [7, 8]),
    ("time < 01:31:05.694", []),
    ("time in {01:31:05.699..01:31:05.7007}", [5, 6]),
    ("time in {..0.0025}", [1, 2]),
    ("frame == 10", [2]),
    ("frame in {9..12}", [1, 2, 3]),
    ("host == 127.0.0.0/8 and port == 102", [1, 2, 3, 4, 5, 6, 7, 8]),
    ("server == 127.0.0.1:102 and client != 127.0.0.1:102", [1, 2, 3, 4, 5, 6, 7, 8]),
    ("client == 127.0.0.1:102", []),
    ("host == ::1", []),
    ("server == 127.0.0.2 or slot == 3", []),
    ("slot == 2 and rack == 0 and called_tsap == '01.02'", [1, 2, 3, 4, 5, 6, 7, 8]),
    ("tag", []),
    ('tag == "Tank"', []),
    ('tag != "Tank"', []),
    ("s7plus.version == 3 or scd.index > 0", []),
    ("rosctr == job and pdu_ref == 0x0100", [2]),
]


@each("case", SELECTED)
def test_a_condition_selects(case: tuple[str, list[int]]) -> None:
    assert numbers(case[0]) == case[1]


@each(
    "case",
    [
        ('tag == "Valve.pressure"', [2]),
        ("tag matches Valve", [2, 3, 4, 5, 7]),
        ("value[Valve.pressure] == 12.5", [2]),
        ("value[Valve.balance] < 0", [5]),  # scaled, one of three items
        ("value[Valve.cycles] == 4711 and value[Heartbeat] == 99", [5]),
        ("value[Valve.cycles] == 99", []),  # the value of another tag of the same request
        ("type[Valve.position] == INT", [3]),
        ('value[Valve.name] contains "alv"', [7]),
        ("tag", [2, 3, 4, 5, 6, 7]),
        ("value[Nothing] > 0", []),
    ],
)
def test_tags_are_selected_by_name_and_by_their_own_value(case: tuple[str, list[int]]) -> None:
    events = dissect.open(
        CAPTURES / "nodes7-write.pcapng", where=case[0], tags=CAPTURES / "tags" / "valve.csv", pdus=False
    )
    assert [int(one.number) for one in events if isinstance(one, dissect.Transaction)] == case[1]


@each(
    "case",
    [
        ("value[Motors[2].Speed] == 7", [2]),
        ("value[Motors[1].Speed] == 7", []),
        ('value["Motors[2].Speed"] == 7', [2]),
        ("value[Speed [rpm]] == 5", [2]),
        ("value[Curve] == 3", [3]),
        ("value[Curve[1]] == 3", [3]),  # of all that are read
        ("value[Curve[2]] == 3", []),
        ("value[Curve[2]] == 4", [3, 4]),  # of some, and alone
        ("value[Curve[3]] < 100", []),
        ("value[Curve[x]] < 100", []),
    ],
)
def test_names_with_brackets_and_elements_of_arrays_are_selected(case: tuple[str, list[int]], tmp_path: Path) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text(
        "address,type,name\nDB1.DBW0,INT,Motors[1].Speed\nDB1.DBW2,INT,Motors[2].Speed\nDB1.DBW4,INT,Speed [rpm]\n"
        "DB1.DBW8,Array[0..2] of INT,Curve\n",
        encoding="utf-8",
    )
    talk = read(begun(), 2, Item(2, 6, 1, 0x84, 0), struct.pack(">3h", 6, 7, 5))
    read(talk, 3, Item(2, 6, 1, 0x84, 64), struct.pack(">3h", 2, 3, 4))
    read(talk, 4, Item(2, 2, 1, 0x84, 96), struct.pack(">h", 4))
    capture = saved(tmp_path / "arrays.pcapng", talk.packets())
    events = dissect.open(capture, where=case[0], tags=tags, pdus=False)
    assert [int(one.number) for one in events if isinstance(one, dissect.Transaction)] == case[1]


@each("name", ['DB1."level"', """'DB1."level"'"""])
def test_a_variable_of_s7comm_plus_ends_with_a_quote_of_its_own(name: str) -> None:
    def selected(expression: str) -> list[int]:
        events = dissect.open(CAPTURES / "crafted" / "plus-plant.pcapng", where=expression, pdus=False)
        return [int(one.number) for one in events if isinstance(one, dissect.Transaction)]

    assert selected(f"value[{name}] == 45.5") == selected("value == 45.5") != []


def test_a_request_alone_has_its_tags_too() -> None:
    events = dissect.open(
        CAPTURES / "nodes7-write.pcapng", where='tag == "Remote"', tags=CAPTURES / "tags" / "valve.csv"
    )
    assert [int(one.frame) for one in events if isinstance(one, dissect.Pdu)] == [22]


def test_findings_are_selected_by_their_own_fields_and_those_of_their_connection() -> None:
    found = gathered("item-errors")
    for expression, count in (
        ("slug == transaction.item_error", 13),
        ("severity >= warning and host == 127.0.0.1", 15),
        ("severity > warning", 0),
        ("detail contains 'Read Var' and frame == 11", 1),
        ("kind == function", 13),
        ("not host == 127.0.0.1", 0),
    ):
        where = Where(expression, context=found.context)
        assert len([one for one in found.things[FINDING] if where.predicate(FINDING)(one)]) == count, expression


def test_a_finding_about_no_connection_has_its_hosts() -> None:
    """A refused connection is none: the finding still says between which hosts, for expressions as well."""
    found = gathered("refused-port")
    for expression, count in (
        ("client == 127.0.0.1", 1),
        ("server == 127.0.0.0/8 and host == 127.0.0.1", 1),
        ("client == 127.0.0.2", 0),
        ("server == 127.0.0.1:102", 0),  # its port is not known
        ('client matches "^127.0.0.1$"', 1),
    ):
        where = Where(expression, context=found.context)
        assert len([one for one in found.things[FINDING] if where.predicate(FINDING)(one)]) == count, expression


def test_several_expressions_hold_together() -> None:
    found = gathered("item-errors")
    where = Where("failed", ["number in {2..4}", "function == read"], context=found.context)
    assert [int(one.number) for one in found.things[TRANSACTION] if where.transaction(one)] == [2, 3, 4]
    assert where.text == "(failed) and (number in {2..4}) and (function == read)"


# ---- what holds for every expression --------------------------------------------------------------------------------

LITERALS: Final[dict[type, list[str]]] = {
    Number: ["0", "1", "102", "0x64", "5.5", "-1"],
    Duration: ["50us", "1ms", "0", "2 s"],
    Time: ["2026-11-21T01:31:05.7", "1s", "01:31:30", "0.5"],
    Host: ["127.0.0.1", "192.0.2.0/24", "127.0.0.1:102", "::1"],
    S7Address: ["DB1.DBB0", "DB10.DBW0 x2", "M10.0", "DB2", '"DB1.DBB0 x3"'],
    Text: ['"01.02"', "T1", '"a"', "''"],
    Truth: ["true", "false"],
    Octets: ["00", "01:02", '"a"'],
    AnyValue: ["0", "3.5", "true", '"x"', "-1"],
}


def conditions(field: Field) -> list[str]:
    """Return conditions with a field: alone, and with each operator and a few values."""
    literals = field.kind.choices[:6] if isinstance(field.kind, Code) else LITERALS[type(field.kind)]
    found = [field.name, field.example]
    for operator in field.kind.operators:
        for literal in literals:
            value = f'"{literal}"' if isinstance(field.kind, Code) else literal
            if operator == "overlaps" and literal.startswith('"'):
                continue
            if isinstance(field.kind, (Code, AnyValue)) and operator in {"<", "<=", ">", ">="}:
                value = "3"
            found.append(
                f"{field.name} {operator} {{{value}}}" if operator == "in" else f"{field.name} {operator} {value}"
            )
    return found


SIMPLE: Final = [condition for field in FIELDS.values() for condition in conditions(field)]
EXPRESSIONS: Final = st.recursive(
    st.sampled_from(SIMPLE),
    lambda inner: st.one_of(
        st.builds("not ({})".format, inner),
        st.builds("({}) and ({})".format, inner, inner),
        st.builds("({}) or ({})".format, inner, inner),
    ),
    max_leaves=6,
)


def chosen(expression: str) -> dict[str, set[int]]:
    """Return the places of the things that an expression selects, by kind."""
    found = gathered(*NAMES)
    where = Where(expression, context=found.context)
    return {
        kind: {at for at, thing in enumerate(things) if where.predicate(kind)(thing)}
        for kind, things in found.things.items()
    }


def everything() -> dict[str, set[int]]:
    return {kind: set(range(len(things))) for kind, things in gathered(*NAMES).things.items()}


@settings(max_examples=60, deadline=None)
@given(EXPRESSIONS)
def test_what_is_selected_and_what_is_not_are_everything(expression: str) -> None:
    those, others = chosen(expression), chosen(f"not ({expression})")
    for kind, whole in everything().items():
        assert those[kind] | others[kind] == whole
        assert not those[kind] & others[kind]


@settings(max_examples=40, deadline=None)
@given(EXPRESSIONS, EXPRESSIONS)
def test_and_or_are_those_of_sets(first: str, second: str) -> None:
    a, b = chosen(first), chosen(second)
    both, either = chosen(f"({first}) and ({second})"), chosen(f"({first}) or ({second})")
    for kind in a:
        assert both[kind] == a[kind] & b[kind]
        assert either[kind] == a[kind] | b[kind]


def test_every_condition_can_be_asked_of_everything() -> None:
    """Each of some thousand conditions compiles, and is asked of every kind of thing; most of them select something."""
    selecting = {field.name for field in FIELDS.values() for one in conditions(field) if any(chosen_few(one).values())}
    silent = {"tag", "vlan", "technique", "subscription_id"}  # no capture of those here has them
    assert {name for name in FIELDS if name not in selecting} <= {
        name for name in FIELDS if name.startswith("s7plus.") or name in silent
    }


def chosen_few(expression: str) -> dict[str, int]:
    found = gathered(*NAMES)
    where = Where(expression, context=found.context)
    return {
        kind: sum([where.predicate(kind)(thing) for thing in things[:: max(1, len(things) // 400)]])
        for kind, things in found.things.items()
    }


def test_the_facts_of_an_item_are_made_once() -> None:
    found = gathered("item-errors")
    one: Any = found.things[TRANSACTION][4]
    first = found.context.reader.items(one)
    assert found.context.reader.items(one) is first
    assert all(isinstance(item, ItemFacts) for item in first)


@each(
    ("literal", "wanted"),
    [("true", True), ("TRUE", True), ("1", True), ("false", False), ("False", False), ("0", False)],
)
def test_true_and_false_in_every_spelling(literal: str, wanted: bool) -> None:
    found = gathered(*NAMES)
    things = found.things[TRANSACTION]
    failed = [one for one in things if Where("failed").predicate(TRANSACTION)(one)]
    assert 0 < len(failed) < len(things)
    for operator, expected in (("==", wanted), ("!=", not wanted)):
        chosen = [one for one in things if Where(f"failed {operator} {literal}").predicate(TRANSACTION)(one)]
        assert chosen == (failed if expected else [one for one in things if one not in failed])
