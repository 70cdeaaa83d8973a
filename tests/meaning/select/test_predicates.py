"""Predicates: operators over no, one and several values, items in brackets, and what a connection alone decides."""

from __future__ import annotations

import pickle
from itertools import product
from typing import Any, Final

import pytest

from dissect.meaning.select.errors import SelectError
from dissect.meaning.select.things import (
    CONNECTION,
    FINDING,
    KINDS,
    MESSAGE,
    OPERATION,
    PACKET,
    TRANSACTION,
    Context,
    Message,
    Packet,
)
from dissect.meaning.select.where import PLURALS, Where
from tests.cases import each
from tests.engine.transactions import talk as line
from tests.engine.transactions.talk import Talk, dbw, read


def talked() -> Talk:
    """Transactions 1 to 4: a setup, a read of two words in DB1 and DB2, one of two items in DB1, a refused one."""
    talk = Talk()
    talk.hello()
    talk.connect()
    talk.ask(line.setup(0))
    talk.tell(line.granted(0))
    talk.ask(read(1, dbw(1, 0), dbw(2, 2)))
    talk.tell(line.ack_data(1, b"\x04\x02", line.good(4, b"\0\x05") + line.good(4, b"\0\x07")))
    talk.ask(read(2, dbw(1, 0), dbw(1, 2, 2)))
    talk.tell(line.ack_data(2, b"\x04\x02", line.good(4, b"\0\x05") + line.good(4, b"\0\x05\0\x09")))
    talk.ask(read(3, dbw(3, 0)))
    talk.tell(line.ack_data(3, b"\x04\x01", line.refused(0x0A)))
    talk.close()
    return talk


TALK: Final = talked()


def selected(expression: str) -> list[int]:
    where = Where(expression)
    return [int(one.number) for one in TALK.transactions if where.transaction(one)]


@each(
    ("expression", "numbers"),
    [
        ("db", [2, 3, 4]), ("not db", [1]), ("db == 1", [2, 3]), ("db != 1", [4]), ("db === 1", [3]), ("db !== 1", [2, 4]),
        ("db in {2, 3}", [2, 4]), ("db not in {2, 3}", [1, 3]), ("not db == 1", [1, 4]), ("db > 1", [2, 4]),
        ("value", [2, 3]), ("value == 5", [2, 3]), ("value != 5", []), ("value === 5", []), ("value !== 5", [2, 3]),
        ("value == 9", [3]), ("value != 7", [3]), ("number == 2", [2]), ("number != 2", [1, 3, 4]), ("number === 2", [2]),
        ("number !== 2", [1, 3, 4]), ("host == 10.0.0.1", [1, 2, 3, 4]), ("host != 10.0.0.1", []), ("host === 10.0.0.1", []),
        ("host !== 10.0.0.1", [1, 2, 3, 4]), ("host === 10.0.0.0/8", [1, 2, 3, 4]), ("failed", [4]), ("not failed", [1, 2, 3]),
        ("failed == false", [1, 2, 3]), ("failed != true", [1, 2, 3]), ("error", [4]), ("error != 5", [4]),
        ("error !== 5", [4]),
        ("vlan", []), ("vlan != 3", []), ("vlan !== 3", []), ("reason !== capture_ended", []), ("reason != capture_ended", []),
        ("reason === capture_ended", []), ("reason == capture_ended", []), ("reason", []), ("vlan === 3", []), ("slug", []),
        ("not slug", [1, 2, 3, 4]),
        ("slug == transaction.slow or number == 1", [1]), ("items > 0 and db == 1 and value == 9", [3]),
        ("number == 1 or db == 3 or value == 9", [1, 3, 4]), ("number == 1 or db == 3", [1, 4]),
        ("number > 1 and db == 1", [2, 3]),
    ],
)  # fmt: skip
def test_operators_over_no_one_and_several_values(expression: str, numbers: list[int]) -> None:
    assert selected(expression) == numbers


@each(
    ("expression", "numbers"),
    [
        ("value[DB1.DBW0] == 5", [2, 3]), ("value[DB2.DBW2] == 7", [2]), ("value[DB2.DBW2] == 5", []),
        ("value[DB2.DBW2] != 5", [2]),
        ("value[DB1] == 9", [3]), ("value[DB1] == 7", []), ("value[DB1.DBW2 x2] == 9", [3]), ("value[DB1.DBW2 x2] !== 5", [3]),
        ("value[DB1.DBW4] == 9", []), ("value[DB3]", []), ("db[DB1]", [2, 3]), ("data[DB1.DBW0] == 00:05", [2, 3]),
        ("return_code[DB3] == 0x0a", [4]), ("return_code[DB1] == 0xff", [2, 3]), ("count[DB1] == 2", [3]),
        ("count[DB1] === 2", []),
        ('count["DB1.DBW2 x2"] == 2', [3]), ("address[DB2] == DB2.DBW2", [2]), ("type[DB2] == WORD", [2]),
        ("type[DB2] == BYTE", []),
    ],
)  # fmt: skip
def test_brackets_pick_the_items_at_an_address(expression: str, numbers: list[int]) -> None:
    assert selected(expression) == numbers


def test_things_without_items_have_none_in_brackets() -> None:
    for kind, thing in (
        (CONNECTION, TALK.connections[0]),
        (OPERATION, object()),
        (FINDING, object()),
        (PACKET, object()),
    ):
        assert Where("value[DB1.DBW0] == 5").predicate(kind)(thing) is False
        assert Where("not value[DB1.DBW0]").predicate(kind)(thing) is True


def test_each_kind_of_thing_is_judged_by_its_own_fields() -> None:
    connection, transaction = TALK.connections[0], TALK.transactions[3]
    where = Where("port == 102 and frame == 12")
    where.context.opened(connection)
    finding = next(one for one in TALK.findings if 12 in [int(frame) for frame in one.frames])
    assert where.transaction(transaction)
    assert not where.transaction(TALK.transactions[2])
    assert where.finding(finding)
    assert not Where("frame == 11").finding(finding)
    assert not Where("connection == 2").finding(finding)
    assert not where.connection(connection)
    assert Where("port == 102 and frame == 1").connection(connection)
    ends = connection.tcp.ends
    for number in (11, 12):
        assert where.packet(Packet(number, 0, (ends[0], ends[1]), None)) == (number == 12)
        assert where.message(Message("s7comm", number, 0, connection, 0, read(1, dbw(1, 0)))) == (number == 12)
    assert where.predicate(PACKET) is where.predicate(PACKET)


# ---- several expressions, and what is known of one ------------------------------------------------------------------


def test_an_expression_says_what_it_names() -> None:
    where = Where(
        "value[DB1] > 5 and (db.x_ == 1 or not value['DB1'])".replace("db.x_", "items.db"), ["value[MW4]", ""]
    )
    assert where.names == {"value", "db"}
    assert where.variables == ("DB1", "MW4")
    assert where.texts == ("value[DB1] > 5 and (items.db == 1 or not value['DB1'])", "value[MW4]")
    assert where.text == f"({where.texts[0]}) and (value[MW4])"
    assert repr(where) == f"Where({where.text!r})"
    for expressions in (("db == 1", "value == 9"), ("value == 9", "db == 1"), ("db", "db == 1", "value == 9")):
        both = Where(expressions[0], expressions[1:])
        assert [int(one.number) for one in TALK.transactions if both.transaction(one)] == [3]
    assert Where("", ["failed"]).text == Where("failed").text == "failed"
    with pytest.raises(SelectError, match="the expression is empty"):
        Where("", [""])


def test_an_expression_can_be_sent_to_another_process() -> None:
    where = Where("failed", ["db == 3"], kinds=(TRANSACTION,))
    sent = pickle.loads(pickle.dumps(where))
    assert (sent.text, sent.names) == (where.text, where.names)
    assert [int(one.number) for one in TALK.transactions if sent.transaction(one)] == [4]
    with pytest.raises(SelectError, match="transactions have no field"):
        Where("slug", kinds=sent._kinds)


@each(
    ("expression", "kinds"),
    [
        ("host == 10.0.0.1", KINDS), ("failed", (TRANSACTION, OPERATION)), ("failed and db == 1", (TRANSACTION,)),
        ("failed or slug", ()), ("slug", (FINDING,)), ("kind", (OPERATION, FINDING)), ("src == 10.0.0.1", (MESSAGE, PACKET)),
    ],
)  # fmt: skip
def test_things_that_have_every_field_are_known(expression: str, kinds: tuple[str, ...]) -> None:
    where = Where(expression)
    assert tuple(kind for kind in KINDS if where.knows(kind)) == kinds


def test_a_field_that_none_of_the_kinds_has_is_a_mistake_with_its_place() -> None:
    with pytest.raises(SelectError) as told:
        Where("failed or slug", kinds=(TRANSACTION, CONNECTION))
    assert told.value.reason == "transactions and connections have no field 'slug'; findings have it"
    assert (told.value.start, told.value.end) == (10, 14)
    with pytest.raises(SelectError, match="connections have no field 'db'; transactions and messages have it"):
        Where("db", kinds=(CONNECTION,))
    assert Where("failed or slug", kinds=(TRANSACTION, FINDING)).names == {"failed", "slug"}
    assert set(PLURALS) == set(KINDS)


@each(
    ("text", "marked", "reason"),
    [
        ("failed and port > x", "x", "expected a number"),
        ("failed and port[MW4] > 5", "port[MW4]", "port is not of an item, so that no brackets can follow"),
        (
            "host < 10.0.0.1",
            "host < 10.0.0.1",
            "host (address) cannot be compared with <; it takes ==, !=, ===, !==, in",
        ),
        ("frame.number == 5", "frame.number", "no field 'frame.number'; did you mean frame?"),
        ("prot == 5", "prot", "no field 'prot'; did you mean port"),
        ("qqqq == 5", "qqqq", "no field 'qqqq'; `s7dissect fields` lists the fields"),
    ],
)
def test_a_wrong_condition_is_marked(text: str, marked: str, reason: str) -> None:
    with pytest.raises(SelectError) as told:
        Where(text)
    assert told.value.reason.startswith(reason)
    assert (told.value.text, text[told.value.start : told.value.end]) == (text, marked)


# ---- what a connection alone decides --------------------------------------------------------------------------------


@each(
    ("expression", "may"),
    [
        ("host == 10.0.0.1", True), ("host == 10.0.0.9", False), ("not host == 10.0.0.1", False),
        ("not host == 10.0.0.9", True),
        ("host != 10.0.0.1", False), ("host", True), ("port == 50000", True), ("port == 50001", False),
        ("connection == 1", True),
        ("connection > 1", False), ("failed", True), ("not failed", True), ("failed and host == 10.0.0.9", False),
        ("failed or host == 10.0.0.9", True), ("host == 10.0.0.8 or host == 10.0.0.9", False),
        ("client == 10.0.0.9", False), ("client == 10.0.0.2", True), ("client != 10.0.0.9", True),
        ("client !== 10.0.0.9", True),
        ("client === 10.0.0.9", False), ("server in {10.0.0.8, 10.0.0.9}", False), ("server in {10.0.0.9, 10.0.0.1}", True),
        ("not client == 10.0.0.9", True), ("client contains 9", True), ("client", True), ("asked_by == 10.0.0.9", False),
        ("answered_by == 10.0.0.9", False), ("answered_by == 10.0.0.1", True), ("slot == 9", True), ("src == 10.0.0.9", True),
        ("failed and (db == 1 or host == 10.0.0.9) and port == 1", False),
    ],
)  # fmt: skip
def test_a_connection_is_read_unless_its_ends_rule_it_out(expression: str, may: bool) -> None:
    assert Where(expression).may_hold(TALK.connections[0]) is may
    assert Where("failed", [expression]).may_hold(TALK.connections[0]) is may
    assert Where(expression, ["connection == 2"]).may_hold(TALK.connections[0]) is False


@each(
    ("expression", "narrows"),
    [
        ("host == 10.0.0.1", True), ("port == 1", True), ("connection == 1", True), ("client == 10.0.0.1", True),
        ("server == 10.0.0.1", True), ("asked_by == 10.0.0.1", True), ("answered_by == 10.0.0.1", True), ("slot == 1", False),
        ("failed or db == 1", False), ("failed or host == 10.0.0.1", True), ("src == 10.0.0.1", False),
    ],
)  # fmt: skip
def test_only_ends_and_numbers_of_connections_narrow_what_is_read(expression: str, narrows: bool) -> None:
    assert Where(expression).narrows is narrows


def of_three(values: list[bool | None], both: bool) -> bool | None:
    """Return `and` (``both``) or `or` of three truths: unknown unless one of the others decides."""
    decides = not both
    return decides if decides in values else None if None in values else both


def test_judges_know_what_is_unknown() -> None:
    names = ("failed", "cut", "malformed")
    for values in product((True, False, None), repeat=3):
        known: dict[str, bool | None] = dict(zip(names, values, strict=True))

        def judged(expression: str, known: Any = known) -> bool | None:
            (judge,) = Where(expression).judges(lambda condition: lambda _thing: known[condition.field.name])
            return judge(object())

        assert judged(" and ".join(names)) is of_three(list(values), True)
        assert judged(" or ".join(names)) is of_three(list(values), False)
        assert judged("not failed") is (None if values[0] is None else not values[0])
        assert judged("failed and cut") is of_three(list(values[:2]), True)
        inner = of_three(list(values[:2]), True)
        assert judged("malformed or not (failed and cut)") is of_three(
            [values[2], None if inner is None else not inner], False
        )


def test_times_without_a_zone_are_those_of_the_context() -> None:
    for local in (False, True):
        assert Where("time == 12:00", context=Context(local)).context.local is local
        with pytest.raises(SelectError, match="local time without a zone" if local else "UTC without a zone"):
            Where("time == noon", context=Context(local))
