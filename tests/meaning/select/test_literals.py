"""What each type of values takes, and which values a literal of it matches."""

from __future__ import annotations

from ipaddress import ip_address
from typing import Any, Final

import pytest

from dissect.meaning.select.errors import SelectError
from dissect.meaning.select.grammar import Literal
from dissect.meaning.select.literals import (
    AnyValue,
    Code,
    CodeValue,
    Duration,
    Host,
    ItemPlace,
    Kind,
    Number,
    Octets,
    S7Address,
    Text,
    Time,
    Truth,
    number,
    place_of,
)
from dissect.packets.tcp.stream import Endpoint
from tests.cases import each

#: 2016-02-08 12:00:00 UTC
NOON: Final = 1_454_932_800 * 10**9
SECOND: Final = 10**9
MINUTE: Final = 60 * SECOND


def literal(text: str) -> Literal:
    """Return a literal as it was typed: in double quotes or without."""
    quoted = len(text) > 1 and text[0] == text[-1] == '"'
    return Literal(text[1:-1] if quoted else text, quoted, 0, len(text))


def matched(kind: Kind, operator: str, texts: str, values: list[Any], start: int = NOON) -> list[Any]:
    """Return those of ``values`` that match; `in` takes several literals, separated by blanks."""
    some = texts.split() if operator == "in" else [texts]
    test = kind.test(operator, [literal(text) for text in some], lambda: start)
    return [value for value in values if test(value)]


def refused(kind: Kind, operator: str, *texts: str) -> SelectError:
    with pytest.raises(SelectError) as told:
        kind.test(operator, [literal(text) for text in texts], lambda: NOON)
    return told.value


# ---- numbers and durations ------------------------------------------------------------------------------------------


@each(
    ("operator", "matches"),
    [("==", [5]), ("<", [-1, 4]), ("<=", [-1, 4, 5]), (">", [6, 16]), (">=", [5, 6, 16])],
)
def test_numbers_are_compared_by_size(operator: str, matches: list[int]) -> None:
    assert matched(Number(), operator, "5", [-1, 4, 5, 6, 16]) == matches


@each(
    ("texts", "matches"),
    [
        ("2", [2]), ("2 7", [2, 7]), ("2..4", [2, 3, 4]), ("..3", [1, 2, 3]), ("6..", [6, 7]), ("4..2", []),
        ("1 3..4 7..", [1, 3, 4, 7]), ("0x2..0x3", [2, 3]),
    ],
)  # fmt: skip
def test_a_set_has_numbers_and_ranges_with_both_ends(texts: str, matches: list[int]) -> None:
    assert matched(Number(), "in", texts, [1, 2, 3, 4, 5, 6, 7]) == matches


@each(
    ("text", "expected"),
    [
        ("0", 0), ("12", 12), ("+12", 12), ("-12", -12), ("0x1f", 31), ("0X1F", 31), ("-0x10", -16), ("1.5", 1.5),
        ("-1.5", -1.5), ("2e3", 2000.0), ("1.5E-1", 0.15), ("9" * 40, 10**40 - 1), ("9" * 41, None), ("", None),
        ("x", None), ("0x", None), ("1.", None), (".5", None), ("1e", None), ("5 ", None), ("0x1.5", None), ("nan", None),
    ],
)  # fmt: skip
def test_a_number_is_decimal_or_hexadecimal(text: str, expected: float | None) -> None:
    found = number(text)
    assert (found, type(found)) == (expected, type(expected))


@each("text", ["x..55", "111..x", "111..1x"])
def test_the_end_of_a_range_that_is_wrong_is_marked(text: str) -> None:
    error = refused(Number(), "in", text)
    assert (error.start, error.end) == ((0, 1) if text[0] == "x" else (5, len(text)))
    assert error.reason.endswith(f"got {text[error.start : error.end]!r}")


def test_a_range_without_ends_is_none() -> None:
    assert "a range has an end" in refused(Number(), "in", "..").reason
    assert refused(Number(), "==", "1..5").reason.startswith("expected a number")
    assert "in` the range 1..5" in refused(Number(), "==", "1-5").reason


@each(
    ("text", "ns"),
    [
        ("0", 0), ("7ns", 7), ("7us", 7_000), ("7\u00b5s", 7_000), ("7\u03bcs", 7_000), ("7ms", 7_000_000), ("7s", 7 * SECOND),
        ("7min", 420 * SECOND), ("7h", 25_200 * SECOND), ("7d", 604_800 * SECOND), ("7 MS", 7_000_000),
        ("1.5s", 1_500_000_000), ("0.25us", 250), ("1.05ms", 1_050_000), ("-1.5s", -1_500_000_000), ("-0.5s", -500_000_000),
        ("+2s", 2 * SECOND), ("0.0", 0), ("1.0000000019s", 1_000_000_001),
    ],
)  # fmt: skip
def test_a_duration_is_a_number_with_a_unit(text: str, ns: int) -> None:
    assert matched(Duration(), "==", text, [ns - 1, ns, ns + 1]) == [ns]
    assert matched(Duration(bare=True), ">", text, [ns - 1, ns, ns + 1]) == [ns + 1]


def test_only_where_nanoseconds_are_meant_a_duration_needs_no_unit() -> None:
    assert matched(Duration(bare=True), "<=", "20", [19, 20, 21]) == [19, 20]
    assert refused(Duration(), "<=", "20").reason.startswith(
        "a duration needs a unit (ns, us, ms, s, min, h, d), such as 20ms"
    )
    assert refused(Duration(), "<=", "0.5").reason.startswith("a duration needs a unit")
    assert refused(Duration(), "==", "soon").reason == "expected a duration, such as 20ms or 1.5s; got 'soon'"


@each(
    ("text", "reason"),
    [
        ("5mim", "unknown unit 'mim' of '5mim': expected ns, us, ms, s, min, h, d; did you mean 5min?"),
        ("5mins", "unknown unit 'mins' of '5mins': expected ns, us, ms, s, min, h, d; did you mean 5min?"),
        ("5y", "unknown unit 'y' of '5y': expected ns, us, ms, s, min, h, d"),
    ],
)
def test_a_unit_that_does_not_exist_is_named(text: str, reason: str) -> None:
    error = refused(Duration(), "==", text)
    assert (error.reason, error.start, error.end) == (reason, 0, len(text))


# ---- times ----------------------------------------------------------------------------------------------------------


@each(
    ("operator", "text", "matches"),
    [
        ("==", "12:00:01", [NOON + SECOND, NOON + 2 * SECOND - 1]),
        ("==", "12:01", [NOON + MINUTE, NOON + MINUTE + 1]),
        ("==", "1s", [NOON + SECOND]),
        ("<", "1s", [NOON, NOON + SECOND - 1]),
        ("<=", "1s", [NOON, NOON + SECOND - 1, NOON + SECOND]),
        (">", "60", [NOON + MINUTE + 1]),
        (">=", "1min", [NOON + MINUTE, NOON + MINUTE + 1]),
        ("in", "1s 60", [NOON + SECOND, NOON + MINUTE]),
        ("in", "1..2", [NOON + SECOND, NOON + 2 * SECOND - 1, NOON + 2 * SECOND]),
        ("in", "12:00:02..12:01", [NOON + 2 * SECOND, NOON + MINUTE]),
        ("in", "..0", [NOON]),
        ("in", "60..", [NOON + MINUTE, NOON + MINUTE + 1]),
    ],
)
def test_times_are_moments_of_a_day_or_counted_from_the_start(operator: str, text: str, matches: list[int]) -> None:
    """A time that names a second or a minute equals all of it, but is compared by its begin."""
    moments = [
        NOON, NOON + SECOND - 1, NOON + SECOND, NOON + 2 * SECOND - 1, NOON + 2 * SECOND, NOON + MINUTE, NOON + MINUTE + 1,
    ]  # fmt: skip
    assert matched(Time(), operator, text, moments) == matches


@each("texts", [("==", "1s"), ("in", "1..1")])
def test_the_start_of_the_capture_may_become_known_later(texts: tuple[str, str]) -> None:
    starts = [0, NOON, 0]
    test = Time().test(texts[0], [literal(texts[1])], lambda: starts[0])
    for start in (0, NOON, 5, NOON):
        starts[0] = start
        assert [value - start for value in (start, start + SECOND, start + 2 * SECOND) if test(value)] == [SECOND]


def test_the_zone_of_times_is_that_of_the_expression() -> None:
    plain = Time()
    assert plain.zoned(False) is plain
    assert plain.zoned(True) is not plain
    assert plain.zoned(True).zoned(True).zoned(False) is not plain
    assert "(local time without a zone" in refused(plain.zoned(True), "==", "noon").reason
    assert "(UTC without a zone" in refused(plain, "==", "noon").reason
    assert Number().zoned(True).name == "number"
    assert Time().shown(NOON) == "2016-02-08T12:00:00.000000000Z"


@each("text", ["5 ", "noon..", "..noon"])
def test_a_range_of_times_that_is_wrong_is_marked_as_a_whole(text: str) -> None:
    error = refused(Time(), "in", text)
    assert (error.start, error.end) == (0, len(text))
    assert "is not a time" in error.reason


# ---- texts, truth, names --------------------------------------------------------------------------------------------


@each(
    ("operator", "text", "matches"),
    [
        ("==", "Tank", ["Tank"]), ("contains", "ank", ["Tank", "tank", "Tank 2"]), ("contains", "Ta", ["Tank", "Tank 2"]),
        ("matches", "^t", ["Tank", "tank", "Tank 2"]), ("in", '"tank" "Pump"', ["tank", "Pump"]), ("in", "P..t", ["P..t"]),
    ],
)  # fmt: skip
def test_texts(operator: str, text: str, matches: list[str]) -> None:
    assert matched(Text(), operator, text, ["Tank", "tank", "Tank 2", "Pump", "P..t"]) == matches


def test_true_and_false() -> None:
    for text, matches in (("true", [True]), ("FALSE", [False]), ("1", [True]), ("0", [False])):
        assert matched(Truth(), "==", text, [True, False]) == matches
    assert refused(Truth(), "==", "2").reason == "expected true or false; got '2'"
    assert [Truth().shown(value) for value in (True, False)] == ["true", "false"]
    assert [kind.name for kind in (Truth(), Number(), Text(), Code(), AnyValue()) if kind.truth] == ["boolean"]


NAMED: Final = [
    CodeValue(4, ("Read Var", "read")),
    CodeValue(5, ("Write Var", "write")),
    CodeValue(None, ("none",)),
    CodeValue(6, ()),
]


@each(
    ("operator", "text", "matches"),
    [
        ("==", "4", [0]), ("==", "0x05", [1]), ("==", "read", [0]), ("==", "READ_VAR", [0]), ("==", '"read-var"', [0]),
        ("<", "5", [0]), ("<=", "5", [0, 1]), (">", "4", [1, 3]), (">=", "middle", [1, 3]), ("contains", "VAR", [0, 1]),
        ("contains", "ne", [2]), ("matches", "^w", [1]), ("in", "read 6", [0, 3]), ("in", "4..5", [0, 1]), ("==", "other", []),
    ],
)  # fmt: skip
def test_names_are_compared_by_number_or_by_name(operator: str, text: str, matches: list[int]) -> None:
    kind = Code(lambda: ["Read Var", "read", "Write Var", "write", "none", "read"], also="oth", ranks={"middle": 5})
    for _ in range(2):  # the second time from memory
        assert matched(kind, operator, text, NAMED) == [NAMED[at] for at in matches]


def test_a_number_in_quotes_is_a_name() -> None:
    assert matched(Code(lambda: ["5"]), "==", '"5"', [CodeValue(5, ("five",)), CodeValue(1, ("5",))]) == [
        CodeValue(1, ("5",))
    ]


def test_what_a_name_may_be_is_listed() -> None:
    kind = Code(lambda: ["stop", "start", "stop", "P_PROGRAM"])
    assert kind.choices == ["stop", "start", "P_PROGRAM"]
    assert refused(kind, "==", "stpo").reason == "no such name 'stpo'; did you mean stop?"
    assert refused(kind, "==", "prog").reason == "no such name 'prog'; did you mean P_PROGRAM?"
    assert refused(kind, "==", "x").reason == "no such name 'x'; expected a number or one of stop, start, P_PROGRAM"
    assert refused(kind, ">", "stop").reason == "> takes a number; got 'stop'"
    assert (
        refused(Code(ranks={"low": 1, "high": 2}), ">", "no").reason == "> takes a number or one of low, high; got 'no'"
    )
    assert Code(lambda: ["a b", "a.b:c/d"]).compare("==", literal('"a b"'), lambda: 0)(CodeValue(1, ("A B",)))
    assert refused(Code(lambda: ["a b", "a.b:c/d"]), "==", "zzz").reason.endswith('one of "a b", a.b:c/d')


@each("count", [11, 12, 13, 14])
def test_of_many_names_twelve_are_listed(count: int) -> None:
    reason = refused(Code(lambda: [f"{at:04}" for at in range(count)]), "==", "x").reason
    listed = reason.partition(" one of ")[2].removesuffix(", \u2026").split(", ")
    assert listed == [f"{at:04}" for at in range(min(count, 12))]
    assert reason.endswith(", \u2026") == (count > 12)


def test_of_names_with_the_text_in_them_three_are_suggested() -> None:
    kind = Code(lambda: [f"a rather long name {at} with OB in it" for at in range(5)])
    reason = refused(kind, "==", "ob").reason
    assert [at for at in range(5) if f"name {at} " in reason] == [0, 1, 2]
    assert kind.shown(CodeValue(7, ("first", "second"))) == "first"
    assert kind.shown(CodeValue(7, ())) == "7"


# ---- addresses of hosts ---------------------------------------------------------------------------------------------

ENDS: Final = [
    Endpoint(ip_address(address).packed, port)
    for address, port in (
        ("10.0.0.1", 102),
        ("10.0.0.1", 50_000),
        ("10.0.1.1", 102),
        ("fe80::1", 102),
        ("fe80::2:1", 65_535),
    )
]


@each(
    ("operator", "text", "matches"),
    [
        ("==", "10.0.0.1", [0, 1]), ("==", "10.0.0.1:102", [0]), ("==", "10.0.0.1:0", []), ("==", "10.0.0.0/24", [0, 1]),
        ("==", "10.0.0.7/24", [0, 1]), ("==", "10.0.0.0/23", [0, 1, 2]), ("==", "0.0.0.0/0", [0, 1, 2]), ("==", "::/0", [3, 4]),
        ("==", "fe80::1", [3]), ("==", "[fe80::1]", [3]), ("==", "[fe80::1]:102", [3]), ("==", "[fe80::2:1]:65535", [4]),
        ("==", "fe80::/112", [3]), ("in", "10.0.1.0/24 fe80::1", [2, 3]), ("contains", "10.0.0", [0, 1]),
        ("matches", "^.FE80", [3, 4]),
        ("contains", "102", [0, 2, 3]), ("==", "10.0.0.1/32", [0, 1]), ("==", "a00::/8", []),
    ],
)  # fmt: skip
def test_hosts_are_addresses_networks_and_ports(operator: str, text: str, matches: list[int]) -> None:
    assert matched(Host(), operator, text, ENDS) == [ENDS[at] for at in matches]


def test_hosts_that_do_not_exist() -> None:
    expected = "expected an address or a network, such as 192.168.0.1, 192.168.0.0/24, fe80::1, 192.168.0.1:102"
    assert refused(Host(), "==", "plc").reason == f"{expected}; got 'plc'"
    assert refused(Host(), "==", "10.0.0.1/33").reason.startswith(f"{expected} (")
    assert refused(Host(), "==", "10.0.0.1:65536").reason == "a port is at most 65535; got '10.0.0.1:65536'"


# ---- addresses of items ---------------------------------------------------------------------------------------------


@each(
    ("text", "place"),
    [
        ("DB10.DBX4.1", ("DB10.DBX4.1", 0x84, 10, 33, 1)),
        ("db10.dbx4.1", ("DB10.DBX4.1", 0x84, 10, 33, 1)),
        ("DB10.DBB4", ("DB10.DBB4", 0x84, 10, 32, 8)),
        ("DB10.DBW4", ("DB10.DBW4", 0x84, 10, 32, 16)),
        ("DB10.DBD4", ("DB10.DBD4", 0x84, 10, 32, 32)),
        ("DB10.DBL4", ("DB10.DBL4", 0x84, 10, 32, 64)),
        ("DI10.DIW4", ("DI10.DIW4", 0x85, 10, 32, 16)),
        ("MW20", ("MW20", 0x83, 0, 160, 16)),
        ("M20.3", ("M20.3", 0x83, 0, 163, 1)),
        ("E0.1", ("I0.1", 0x81, 0, 1, 1)),
        ("AB7", ("QB7", 0x82, 0, 56, 8)),
        ("T5", ("T5", 0x1D, 0, 5, 1)),
        ("C3", ("C3", 0x1C, 0, 3, 1)),
        ("Z3", ("C3", 0x1C, 0, 3, 1)),
        ("area0x8a:B4", ("area0x8a:B4", 0x8A, 0, 32, 8)),
        ("RECORD5@7", ("RECORD5@7", 0x01, 5, 7, 1)),
        ("AREA0X8A:w4", ("area0x8a:W4", 0x8A, 0, 32, 16)),
    ],
)
def test_an_address_in_numbers(text: str, place: tuple[str, int, int, int, int]) -> None:
    written, area, db, start, size = place
    assert place_of(text) == ItemPlace(written, written, area, db, start, size)
    for count in (2, 10):
        for blank in ("", " "):
            many = ItemPlace(written, f"{written} x{count}", area, db, start, size * count)
            assert place_of(f"{text}{blank}x{count}") == many
    assert place_of(f"{text} x1") == place_of(text)
    assert not place_of(text).whole  # type: ignore[union-attr]


@each(("text", "area"), [("DB7", 0x84), ("di7", 0x85)])
def test_a_whole_block(text: str, area: int) -> None:
    """It has all bits that an address of 24 bits reaches, so it overlaps the last one of its block, and none of others."""
    block = place_of(text)
    assert block is not None
    assert block.whole
    assert (block.text, block.area, block.db, block.start) == (text.upper(), area, 7, 0)
    letters = text[:2].upper()
    last = place_of(f"{letters}7.{letters}X2097151.7")
    other = place_of(f"{letters}8.{letters}X0.0")
    assert last is not None
    assert other is not None
    assert block.overlaps(last)
    assert last.overlaps(block)
    assert not block.overlaps(other)
    assert place_of(f"{text} x2") is None


@each("text", ["", "x", "DB", "DB1.DBQ4", "Tank.Level", "0x", "0x123456789", "DB10.DBW4 x", "x2", "area0xzz:B1"])
def test_no_address(text: str) -> None:
    assert place_of(text) is None


def test_an_object_of_scd_is_only_a_text() -> None:
    assert place_of("0x6001:2") == place_of("0X6001:2") == ItemPlace("0x6001:2", "0x6001:2")
    assert place_of("0x6001:2") == ItemPlace("0x6001:2", "0x6001:2", -1, 0, 0, 0)


PLACES: Final = [
    ItemPlace("DB1.DBW4", "DB1.DBW4", 0x84, 1, 32, 16),
    ItemPlace("DB1.DBW4", "DB1.DBW4 x2", 0x84, 1, 32, 32),
    ItemPlace("DB1.DBB6", "DB1.DBB6", 0x84, 1, 48, 8),
    ItemPlace("DB2.DBW4", "DB2.DBW4", 0x84, 2, 32, 16),
    ItemPlace("MW4", "MW4", 0x83, 0, 32, 16),
    ItemPlace("0x6001:2", "0x6001:2"),
    ItemPlace('DB1."level"', 'DB1."level"'),
    ItemPlace("C32", "C32", 0, 0, 32, 1),
]


@each(
    ("operator", "text", "matches"),
    [
        ("==", "DB1.DBW4", [0, 1]), ("==", "db1.dbw4 x2", [1]), ("==", "MW4", [4]), ("==", "0x6001:2", [5]),
        ("==", "\"DB1.\"level\"\"", [6]), ("contains", "dbw4", [0, 1, 3]), ("contains", "X2", [1]),
        ("matches", "^db1", [0, 1, 2, 6]),
        ("overlaps", "DB1.DBW4", [0, 1]), ("overlaps", "DB1.DBX5.7", [0, 1]), ("overlaps", "DB1.DBX6.0", [1, 2]),
        ("overlaps", "DB1.DBX3.7", []), ("overlaps", "DB1.DBX7.0", [1]), ("overlaps", "DB1.DBX8.0", []),
        ("overlaps", "DB1", [0, 1, 2]),
        ("overlaps", "DB1.DBB0 x5", [0, 1]), ("overlaps", "DB1.DBB0 x4", []), ("overlaps", "MD3", [4]),
        ("in", "MW4 DB2.DBW4", [3, 4]),
    ],
)  # fmt: skip
def test_addresses_are_equal_or_have_a_bit_in_common(operator: str, text: str, matches: list[int]) -> None:
    if operator == "in":
        assert matched(S7Address(), operator, text, PLACES) == [PLACES[at] for at in matches]
        return
    test = S7Address().test(operator, [literal(text)], lambda: 0)
    assert [at for at, place in enumerate(PLACES) if test(place)] == matches


def test_area_0_is_an_area_and_places_without_one_overlap_nothing() -> None:
    counter, objects = PLACES[-1], PLACES[5]
    assert counter.overlaps(counter)
    assert not objects._replace(size=8).overlaps(objects._replace(size=8))
    area = place_of("area0x00:B4")
    assert area is not None
    assert S7Address().test("overlaps", [literal("area0x00:B4")], lambda: 0)(counter)


def test_addresses_that_are_none() -> None:
    expected = "expected an S7 address, such as DB10.DBW4"
    for operator, text in (("==", "Tank"), ("overlaps", "Tank"), ("overlaps", '"Tank"'), ("overlaps", "0x6001:2")):
        assert refused(S7Address(), operator, text).reason.startswith(expected)
    assert refused(S7Address(), "==", "Tank").reason.endswith("; a name stands in quotes; got 'Tank'")
    assert [S7Address().shown(place) for place in PLACES[:2]] == ["DB1.DBW4", "DB1.DBW4 x2"]


# ---- bytes and values -----------------------------------------------------------------------------------------------


@each(
    ("operator", "text", "matches"),
    [
        ("==", "0001ff", [0]), ("==", "00:01:ff", [0]), ("==", "00-01.FF", [0]), ("==", '"ab"', [1]), ("contains", "01", [0]),
        ("contains", '"b"', [1]), ("in", '00:01:ff "ab"', [0, 1]), ("==", '"\u00e9"', [2]), ("==", '"0001ff"', []),
    ],
)  # fmt: skip
def test_bytes_are_digits_or_a_text(operator: str, text: str, matches: list[int]) -> None:
    octets = [b"\0\x01\xff", b"ab", "\u00e9".encode()]
    assert matched(Octets(), operator, text, octets) == [octets[at] for at in matches]
    assert Octets().shown(b"\0\x01\xff") == "0001ff"


VALUES: Final[list[Any]] = [0, 1, 2.5, -3, True, False, "1", "true", "Tank", "tank"]


@each(
    ("operator", "text", "matches"),
    [
        ("==", "1", [1, 4]), ("==", "0", [0, 5]), ("==", "2.5", [2]), ("==", '"1"', [6]), ("==", "true", [4]),
        ("==", "FALSE", [5]),
        ("==", '"true"', [7]), ("==", "Tank", [8]), (">", "0", [1, 2]), (">=", "0", [0, 1, 2]), ("<", "0", [3]),
        ("<=", "0", [0, 3]),
        ("contains", "an", [8, 9]), ("matches", "^t", [7, 8, 9]), ("in", "1..3", [1, 2]), ("in", "0x1 tank", [1, 4, 9]),
    ],
)  # fmt: skip
def test_values_are_compared_with_their_own_sort(operator: str, text: str, matches: list[int]) -> None:
    """A bit equals 1 and 0, but is neither greater nor less than a number."""
    some = [literal(one) for one in text.split()] if operator == "in" else [literal(text)]
    test = AnyValue().test(operator, some, lambda: 0)
    assert [at for at, value in enumerate(VALUES) if test(value)] == matches


def test_values_as_text() -> None:
    assert [AnyValue().shown(value) for value in VALUES[:8]] == ["0", "1", "2.5", "-3", "true", "false", "1", "true"]
    assert refused(AnyValue(), ">", '"5"').reason == "> takes a number; got '5'"
    assert Number().shown(5) == "5"
