"""The types of values of fields: one class for each, which parses literals and makes tests.

A test is a function that returns whether one value of a field matches. It is made once for an expression, and called for every
result.
"""

from __future__ import annotations

import ipaddress
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from dissect.meaning.select.errors import SelectError, range_hint
from dissect.meaning.select.grammar import Literal
from dissect.meaning.select.patterns import searching
from dissect.meaning.select.window import UNITS, Moment, parse_moment, parse_window
from dissect.protocols.s7.address import Address, address_text, parse_address
from dissect.protocols.s7.tables import AREA_LETTERS, DB_AREAS, NUMBERED_AREAS, RECORD_AREA
from dissect.wire.config.hints import close_names

Test = Callable[[Any], bool]
#: Returns the time of the first packet, nanoseconds since 1970.
Start = Callable[[], int]

EQUAL: Final = "=="
IN: Final = "in"
CONTAINS: Final = "contains"
MATCHES: Final = "matches"
OVERLAPS: Final = "overlaps"
_ORDER: Final[dict[str, Callable[[Any, Any], bool]]] = {
    "<": lambda a, b: bool(a < b),
    "<=": lambda a, b: bool(a <= b),
    ">": lambda a, b: bool(a > b),
    ">=": lambda a, b: bool(a >= b),
}
#: Maximum number of expected names that an error lists.
_MOST_LISTED: Final = 12


class CodeValue(NamedTuple):
    """A number with names: a function, an area, an error. ``number`` is None if there are only names."""

    number: int | None
    names: tuple[str, ...]


class ItemPlace(NamedTuple):
    """An address of an item, as text and for S7ANY in numbers: ``area``, ``db``, first bit ``start``, ``size`` in bits.

    In the areas of timers and counters, ``start`` and ``size`` count timers or counters. ``area`` is -1 for addresses that are
    not S7ANY.
    """

    text: str
    label: str
    area: int = -1
    db: int = 0
    start: int = 0
    size: int = 0

    @property
    def whole(self) -> bool:
        """True for a whole data block."""
        return self.size == _WHOLE

    def overlaps(self, other: ItemPlace) -> bool:
        """Return whether both addresses have a bit in common."""
        return (
            self.area == other.area >= 0
            and self.db == other.db
            and self.start < other.start + other.size
            and other.start < self.start + self.size
        )


class Kind(ABC):
    """A type of values. ``name`` is its name in `s7dissect fields`; ``operators`` are the operators that it takes."""

    name = ""
    operators: tuple[str, ...] = (EQUAL, "!=", "===", "!==", IN)
    #: True if a field alone, without a comparison, is a condition: its value must be true.
    truth = False

    def test(self, operator: str, literals: Sequence[Literal], start: Start) -> Test:
        """Return the test for an operator; not for != and !==, which `dissect.meaning.select.where` turns into others.

        Raises `SelectError` for a literal that is not of this type.
        """
        if operator == IN:
            tests = [self._member(literal, start) for literal in literals]
            return lambda value: any([test(value) for test in tests])
        return self.compare(operator, literals[0], start)

    def _member(self, literal: Literal, start: Start) -> Test:
        """Return the test for an element of a set: a value or, for types with an order, a range such as ``1..5``."""
        low, dots, high = literal.text.partition("..")
        if "<=" not in self.operators or not dots or literal.quoted:
            return self.compare(EQUAL, literal, start)
        if not low and not high:
            raise self.unfit(literal, "a range has an end, such as 1..5, 1.. or ..5")
        middle = literal.start + len(low)
        tests = []
        if low:
            tests.append(self.compare(">=", Literal(low, False, literal.start, middle), start))
        if high:
            tests.append(self.compare("<=", Literal(high, False, middle + 2, literal.end), start))
        return lambda value: all([test(value) for test in tests])

    @abstractmethod
    def compare(self, operator: str, literal: Literal, start: Start) -> Test:
        """Return the test that compares with one literal."""

    def zoned(self, local: bool) -> Kind:
        """Return this type for an expression whose times without a zone are in local time (``local``) or in UTC."""
        return self

    def shown(self, value: Any) -> str:
        """Return a value as text, for ``-T fields``."""
        return str(value)

    def unfit(self, literal: Literal, expected: str) -> SelectError:
        """Return the error for a literal that is not of this type."""
        return self.wrong(literal, f"{expected}; got {literal.text!r}")

    def wrong(self, literal: Literal, reason: str) -> SelectError:
        """Return the error for a literal; ``reason`` names the literal."""
        return SelectError(reason, "", literal.start, literal.end)


_NUMBER: Final = re.compile(r"[+-]?(0x[0-9a-f]+|[0-9]+(\.[0-9]+)?(e[+-]?[0-9]{1,3})?)", re.IGNORECASE)


def number(text: str) -> int | float | None:
    """Return the number in a text, decimal or hexadecimal; None if it is not one."""
    if not _NUMBER.fullmatch(text) or len(text) > 40:
        return None
    if "x" in text.lower():
        return int(text, 16)
    return int(text) if text.lstrip("+-").isdigit() else float(text)


class Number(Kind):
    """Counts, numbers of packets, ports."""

    name = "number"
    operators = (EQUAL, "!=", "<", "<=", ">", ">=", "===", "!==", IN)

    def compare(self, operator: str, literal: Literal, start: Start) -> Test:
        """Compare with a number."""
        wanted = number(literal.text)
        if wanted is None:
            raise self.unfit(literal, f"expected a number, such as 5 or 0x05{range_hint(literal.text)}")
        return _compared(operator, wanted)


def _compared(operator: str, wanted: Any) -> Test:
    if operator == EQUAL:
        return lambda value: bool(value == wanted)
    order = _ORDER[operator]
    return lambda value: order(value, wanted)


_DURATION: Final = re.compile(r"([+-]?[0-9]+(?:\.[0-9]+)?) ?([^\d\s.]*)")


class Duration(Kind):
    """Durations in nanoseconds. ``bare``: a number without a unit means nanoseconds."""

    name = "duration"
    operators = Number.operators

    def __init__(self, bare: bool = False) -> None:
        self._bare = bare

    def compare(self, operator: str, literal: Literal, start: Start) -> Test:
        """Compare with a duration."""
        return _compared(operator, self.nanoseconds(literal))

    def nanoseconds(self, literal: Literal) -> int:
        """Return the duration of a literal, in nanoseconds. Raises `SelectError`."""
        found = _DURATION.fullmatch(literal.text)
        if found is None:
            raise self.unfit(literal, "expected a duration, such as 20ms or 1.5s")
        count, unit = found.groups()
        if not unit and not self._bare and float(count):
            raise self.unfit(literal, f"a duration needs a unit ({', '.join(_UNIT_NAMES)}), such as {count}ms")
        factor = UNITS.get(unit.lower(), 0) if unit else 1
        if not factor:
            near = close_names(unit, UNITS)
            hint = f"; did you mean {count}{near[0]}?" if near else ""
            raise self.wrong(
                literal, f"unknown unit {unit!r} of {literal.text!r}: expected {', '.join(_UNIT_NAMES)}{hint}"
            )
        whole, _, fraction = count.partition(".")
        sign = -1 if whole.startswith("-") else 1
        part = int(fraction) * factor // 10 ** len(fraction) if fraction else 0
        return int(whole) * factor + sign * part


_UNIT_NAMES: Final = ("ns", "us", "ms", "s", "min", "h", "d")


class Time(Kind):
    """Moments, nanoseconds since 1970."""

    name = "time"
    operators = Number.operators

    def __init__(self, local: bool = False) -> None:
        self._local = local

    def zoned(self, local: bool) -> Kind:
        """Return this type with the zone for times without a zone."""
        return self if local == self._local else Time(local)

    def compare(self, operator: str, literal: Literal, start: Start) -> Test:
        """Compare with a date and time, a time on the day on which the capture begins, or a duration after its start.

        A time equals a day, minute or second if it is within it.
        """
        moment = self.moment(literal)
        wanted = 0
        resolved_for: int | None = None

        def at() -> int:
            nonlocal wanted, resolved_for
            first = start()
            if first != resolved_for:
                wanted, resolved_for = moment.resolve(first, first), first
            return wanted

        if operator == EQUAL:
            span = moment.span
            return lambda value: bool(0 <= value - at() < span)
        order = _ORDER[operator]
        return lambda value: order(value, at())

    def _member(self, literal: Literal, start: Start) -> Test:
        """Return the test for a range of time, in the form of option ``--time`` of `cut`, or for a moment."""
        if ".." not in literal.text:
            return super()._member(literal, start)
        try:
            window = parse_window(literal.text, self._local)
        except ValueError as error:
            raise SelectError(str(error), "", literal.start, literal.end) from None
        ends = (0, 0)
        resolved_for: int | None = None

        def within(value: int) -> bool:
            nonlocal ends, resolved_for
            first = start()
            if first != resolved_for:
                ends, resolved_for = window.resolve_ahead(first), first
            return ends[0] <= value <= ends[1]

        return within

    def moment(self, literal: Literal) -> Moment:
        """Return the moment that a literal names. Raises `SelectError`."""
        found = _DURATION.fullmatch(literal.text)
        if found is not None and found[2]:
            return Moment.after(Duration().nanoseconds(literal))
        try:
            return parse_moment(literal.text, self._local)
        except ValueError as error:
            raise SelectError(str(error), "", literal.start, literal.end) from None

    def shown(self, value: Any) -> str:
        """Return the moment in ISO 8601."""
        from dissect.wire.text import Clock

        return Clock().iso(value)


class Text(Kind):
    """Texts; ``==`` and ``contains`` distinguish upper and lower case, ``matches`` does not."""

    name = "text"
    operators = (EQUAL, "!=", "===", "!==", IN, CONTAINS, MATCHES)

    def compare(self, operator: str, literal: Literal, start: Start) -> Test:
        """Compare with a text."""
        if operator == MATCHES:
            return searching(literal)
        wanted = literal.text
        if operator == CONTAINS:
            return lambda value: wanted in value
        return lambda value: bool(value == wanted)


class Truth(Kind):
    """True or false."""

    name = "boolean"
    operators = (EQUAL, "!=")
    truth = True

    def compare(self, operator: str, literal: Literal, start: Start) -> Test:
        """Compare with true or false."""
        wanted = {"true": True, "1": True, "false": False, "0": False}.get(literal.text.lower())
        if wanted is None:
            raise self.unfit(literal, "expected true or false")
        return lambda value: value is wanted

    def shown(self, value: Any) -> str:
        """Return it as JSON has it."""
        return "true" if value else "false"


def folded(name: str) -> str:
    """Return a name for comparison: without case, spaces, underscores and hyphens."""
    return re.sub(r"[\s_\-]+", "", name).casefold()


class Code(Kind):
    """Numbers with names (`CodeValue`), compared by number or by name.

    ``names`` returns the possible names; another name is an error, unless it begins with ``also``. ``ranks`` are numbers that
    give names an order.
    """

    name = "name or number"
    operators = (*Number.operators, CONTAINS, MATCHES)

    def __init__(
        self,
        names: Callable[[], Iterable[str]] = tuple,
        also: str | None = None,
        ranks: Mapping[str, int] | None = None,
    ) -> None:
        self._names = names
        self._also = also
        self._ranks = ranks or {}

    @property
    def choices(self) -> list[str]:
        """The possible names."""
        return list(dict.fromkeys(self._names()))

    def compare(self, operator: str, literal: Literal, start: Start) -> Test:
        """Compare with a number or a name."""
        if operator == MATCHES:
            found = searching(literal)
            return lambda value: any([found(name) for name in value.names])
        if operator == CONTAINS:
            part = literal.text.casefold()
            return lambda value: any([part in name.casefold() for name in value.names])
        wanted = None if literal.quoted else number(literal.text)
        if operator != EQUAL and wanted is None:
            wanted = self._ranks.get(literal.text.lower())
        if wanted is not None:
            test = _compared(operator, wanted)
            return lambda value: value.number is not None and test(value.number)
        if operator != EQUAL:
            raise self.unfit(literal, f"{operator} takes a number{_or_one_of(self._ranks)}")
        name = folded(literal.text)
        choices = {folded(choice): choice for choice in self.choices}
        if name not in choices and (self._also is None or not name.startswith(self._also)):
            raise self._unknown(literal, list(choices.values()))
        # The same few values occur again and again, so results of comparisons are remembered.
        known: dict[tuple[str, ...], bool] = {}

        def equal(value: CodeValue) -> bool:
            answer = known.get(value.names)
            if answer is None:
                if len(known) >= _MOST_KNOWN:
                    known.clear()
                answer = known[value.names] = any([folded(one) == name for one in value.names])
            return answer

        return equal

    def _unknown(self, literal: Literal, choices: list[str]) -> SelectError:
        near = close_names(literal.text, choices) or [one for one in choices if literal.text.lower() in one.lower()][:3]
        if near:
            meant = " or ".join([_quoted(one) for one in near])
            return self.wrong(literal, f"no such name {literal.text!r}; did you mean {meant}?")
        more = ", …" if len(choices) > _MOST_LISTED else ""
        listed = ", ".join([_quoted(one) for one in choices[:_MOST_LISTED]])
        return self.wrong(literal, f"no such name {literal.text!r}; expected a number or one of {listed}{more}")

    def shown(self, value: Any) -> str:
        """Return the first name of a value, or its number."""
        return str(value.names[0]) if value.names else str(value.number)


_MOST_KNOWN: Final = 1024


def _or_one_of(names: Iterable[str]) -> str:
    listed = ", ".join(names)
    return f" or one of {listed}" if listed else ""


def _quoted(name: str) -> str:
    return f'"{name}"' if re.search(r"[^\w.:/]", name) else name


class Host(Kind):
    """Ends of connections (`Endpoint`): compared with an address, a network, or an address with its port."""

    name = "address"
    operators = (EQUAL, "!=", "===", "!==", IN, CONTAINS, MATCHES)

    def compare(self, operator: str, literal: Literal, start: Start) -> Test:
        """Compare with an address or network, or the text of one."""
        if operator == MATCHES:
            found = searching(literal)
            return lambda value: found(str(value))
        if operator == CONTAINS:
            part = literal.text
            return lambda value: part in str(value)
        network, port = self.network(literal)
        if network.prefixlen == network.max_prefixlen:
            address = network.network_address.packed
            if port < 0:
                return lambda value: bool(value.address == address)
            return lambda value: bool(value.port == port and value.address == address)
        size, mask = network.max_prefixlen // 8, int(network.netmask)
        first = int(network.network_address)
        return lambda value: len(value.address) == size and int.from_bytes(value.address, "big") & mask == first

    def network(self, literal: Literal) -> tuple[ipaddress.IPv4Network | ipaddress.IPv6Network, int]:
        """Return the network that a literal names (an address is a network of one), and the port, -1 for none."""
        text, port = literal.text, -1
        if found := _WITH_PORT.fullmatch(text):
            text, port = found[1] or found[2], int(found[3])
            if port > 65535:
                raise self.unfit(literal, "a port is at most 65535")
        try:
            return ipaddress.ip_network(text.strip("[]"), strict=False), port
        except ValueError as error:
            why = f" ({error})" if "/" in text else ""
            expected = "expected an address or a network, such as 192.168.0.1, 192.168.0.0/24, fe80::1, 192.168.0.1:102"
            raise self.unfit(literal, expected + why) from None


_WITH_PORT: Final = re.compile(r"(?:\[([0-9a-fA-F:.]+)\]|([0-9]+(?:\.[0-9]+){3})):([0-9]{1,5})")


class S7Address(Kind):
    """Addresses of items (`ItemPlace`): equal, or with a bit in common (``overlaps``)."""

    name = "S7 address"
    operators = (EQUAL, "!=", "===", "!==", IN, CONTAINS, MATCHES, OVERLAPS)

    def compare(self, operator: str, literal: Literal, start: Start) -> Test:
        """Compare with an address, or its text."""
        if operator == MATCHES:
            found = searching(literal)
            return lambda value: found(value.label)
        if operator == CONTAINS:
            part = literal.text.casefold()
            return lambda value: part in value.label.casefold()
        place = place_of(literal.text)
        if operator == OVERLAPS:
            if place is None or place.area < 0:
                raise self.unfit(literal, _EXPECTED)
            return place.overlaps
        if place is None and not literal.quoted:
            raise self.unfit(literal, f"{_EXPECTED}; a name stands in quotes")
        wanted = place.label if place is not None else literal.text
        counted = place is not None and place.label != place.text
        return lambda value: wanted == (value.label if counted else value.text)

    def shown(self, value: Any) -> str:
        """Return an address with its count."""
        return str(value.label)


_EXPECTED: Final = 'expected an S7 address, such as DB10.DBW4, DB10.DBX4.1, MW20, I0.0, T5, DB10 or "DB10.DBB0 x10"'
_COUNTED: Final = re.compile(r"(.+?) ?x([0-9]{1,5})", re.IGNORECASE)
_BLOCK: Final = re.compile(r"(DB|DI)([0-9]{1,5})")
_OBJECT: Final = re.compile(r"0x[0-9a-f]{1,8}(:[0-9]{1,3})?")
#: Size in bits of an `ItemPlace` that is a whole block: more than any block can have.
_WHOLE: Final = 1 << 27
_BITS: Final = {"X": 1, "B": 8, "W": 16, "D": 32, "L": 64, "": 1}


def place_of(text: str) -> ItemPlace | None:
    """Return the place that a text names: an address with or without a count, a block, an SCD object; None for others."""
    if _OBJECT.fullmatch(text.lower()):
        return ItemPlace(text.lower(), text.lower())
    counted = _COUNTED.fullmatch(text)
    bare = (counted[1] if counted else text).upper()
    if block := _BLOCK.fullmatch(bare):
        area = next(number for number, letters in AREA_LETTERS.items() if letters == block[1])
        return ItemPlace(bare, bare, area, int(block[2]), 0, _WHOLE) if not counted else None
    if bare.startswith("AREA0X"):
        bare = f"area0x{bare[6:8].lower()}{bare[8:]}"
    address = parse_address(bare)
    if address is None:
        return None
    count = int(counted[2]) if counted else 1
    written = _written(address)
    return ItemPlace(
        written,
        f"{written} x{count}" if count != 1 else written,
        address.area,
        address.db if address.area in DB_AREAS or address.area == RECORD_AREA else 0,
        address.field,
        count if address.area in NUMBERED_AREAS else count * _BITS[address.width],
    )


def _written(address: Address) -> str:
    """Return an address in the form of `dissect.protocols.s7.address.address_text`: with English letters."""
    sizes = {"X": 0x01, "": 0x01, "B": 0x02, "W": 0x04, "D": 0x06, "L": 0x30}
    return address_text(address.area, address.db, address.field, sizes[address.width])


class Octets(Kind):
    """Bytes: compared with hexadecimal digits, or with the bytes of a quoted text."""

    name = "bytes"
    operators = (EQUAL, "!=", "===", "!==", IN, CONTAINS)

    def compare(self, operator: str, literal: Literal, start: Start) -> Test:
        """Compare with bytes."""
        if literal.quoted:
            wanted = literal.text.encode("utf-8", "surrogateescape")
        else:
            try:
                wanted = bytes.fromhex(re.sub(r"[:.\-]", "", literal.text))
            except ValueError:
                raise self.unfit(literal, 'expected bytes, such as 00:01:ff, 0001ff or "text"') from None
        if operator == CONTAINS:
            return lambda value: wanted in value
        return lambda value: bool(value == wanted)

    def shown(self, value: Any) -> str:
        """Return hexadecimal digits."""
        return str(bytes(value).hex())


class AnyValue(Kind):
    """Values of variables: numbers, texts, true or false. A literal matches only values of its own sort."""

    name = "value"
    operators = (*Number.operators, CONTAINS, MATCHES)

    def compare(self, operator: str, literal: Literal, start: Start) -> Test:
        """Compare with a number, a text, or true or false."""
        if operator == MATCHES:
            found = searching(literal)
            return lambda value: isinstance(value, str) and found(value)
        if operator == CONTAINS:
            part = literal.text
            return lambda value: isinstance(value, str) and part in value
        wanted = None if literal.quoted else number(literal.text)
        if wanted is not None:
            test = _compared(operator, wanted)
            if operator == EQUAL:
                return lambda value: isinstance(value, (int, float)) and test(value)
            return lambda value: isinstance(value, (int, float)) and not isinstance(value, bool) and test(value)
        if operator != EQUAL:
            raise self.unfit(literal, f"{operator} takes a number")
        truth = {"true": True, "false": False}.get(literal.text.lower()) if not literal.quoted else None
        if truth is not None:
            return lambda value: value is truth
        text = literal.text
        return lambda value: isinstance(value, str) and value == text

    def shown(self, value: Any) -> str:
        """Return it in the form of JSON, but a text without quotes."""
        if isinstance(value, bool):
            return "true" if value else "false"
        return str(value)
