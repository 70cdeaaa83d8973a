"""Finds the files of a catalogue from which an expression can select something.

A file is ruled out only if its ends, times and findings show that nothing in it can be selected; all other files are left to
the reader. Things that belong to the capture as a whole have no ends, so `not host == …` rules nothing out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.engine.findings.transaction_rules import DISORDER_NS
from dissect.files.index.facts import FileFacts, Pair
from dissect.meaning.select.fields import FIELDS, NAMES
from dissect.meaning.select.grammar import Comparison, Literal, Presence
from dissect.meaning.select.literals import IN, Time
from dissect.meaning.select.things import FINDING, PACKET, Context, Found, Packet
from dissect.meaning.select.where import Judge, Where, comparison_test, predicate_of
from dissect.meaning.select.window import parse_window
from dissect.packets.tcp.stream import Endpoint

#: Fields whose values for everything on a connection follow from its ends.
_ENDS: Final = frozenset(("host", "port"))
#: Fields that are one of the two ends; the catalogue does not know which one.
_ONE_END: Final = frozenset(("client", "server", "asked_by", "answered_by", "src", "dst"))
#: Fields that only findings have, and whose values follow from the slug.
_OF_SLUG: Final = frozenset(("slug", "severity", "technique"))
_ANY: Final = frozenset(("==", "===", IN, "contains", "matches"))


class Possible:
    """Judges files by an expression, whose times may be ``local``. Raises `SelectError` for an invalid one."""

    def __init__(self, text: str, local: bool = False) -> None:
        self._context = Context(local)
        self.where = Where(text, context=self._context)
        self._judges = self.where.judges(self._leaf)
        self._facts = FileFacts("", 0, 0)
        self._context.start = lambda: self._facts.first_ns

    def __call__(self, facts: FileFacts) -> bool:
        """Return whether anything in a file can be selected; True when in doubt."""
        self._facts = facts
        pairs: list[Pair | None] = [None, *facts.pairs]
        return any([self._may(pair) for pair in pairs]) or not facts.all_pairs

    def _may(self, pair: Pair | None) -> bool:
        thing = _Candidate(pair)
        return all([judge(thing) is not False for judge in self._judges])

    def _leaf(self, condition: Presence | Comparison) -> Judge:
        name = NAMES[condition.field.name].name
        if isinstance(condition, Comparison):
            if name in _ENDS:
                holds = predicate_of(PACKET, condition, self._context)
                return lambda thing: holds(thing.packet)
            if name in _ONE_END and condition.operator in _ANY:
                fits = comparison_test(condition, FIELDS[name], self._context)
                return lambda thing: None if any([fits(end) for end in thing.packet.ends or ()]) else False
            if name == "time":
                overlaps = self._overlaps(condition)
                return lambda _thing: None if overlaps() else False
        if name in _OF_SLUG:
            judged = predicate_of(FINDING, condition, self._context)
            return lambda _thing: None if any([judged(_example(slug)) for slug in self._facts.findings]) else False
        return lambda _thing: None

    # ---- times ------------------------------------------------------------------------------------------------------

    def _overlaps(self, condition: Comparison) -> Callable[[], bool]:
        """Return a function that returns whether a packet of the current file can have a matching time."""
        if condition.operator not in {"==", "===", "<", "<=", ">", ">=", IN}:
            return lambda: True
        kind = Time(self._context.local)

        def order(operator: str, literal: Literal) -> Callable[[int], bool]:
            return kind.compare(operator, literal, lambda: self._facts.first_ns)

        def fits(literal: Literal) -> Callable[[], bool]:
            if condition.operator == IN and ".." in literal.text:
                window = parse_window(literal.text, self._context.local)

                def within() -> bool:
                    begin, end = window.resolve_ahead(self._facts.first_ns)
                    first, last = self._times()
                    return begin <= last and end >= first

                return within
            if condition.operator in {"<", "<="}:
                before = order(condition.operator, literal)
                return lambda: before(self._times()[0])
            if condition.operator in {">", ">="}:
                after = order(condition.operator, literal)
                return lambda: after(self._times()[1])
            moment = kind.moment(literal)

            def around() -> bool:
                at = moment.resolve(self._facts.first_ns, self._facts.first_ns)
                first, last = self._times()
                return first < at + moment.span and last >= at

            return around

        tests = [fits(literal) for literal in condition.literals]
        return lambda: self._facts.backwards or any([test() for test in tests])

    def _times(self) -> tuple[int, int]:
        return self._facts.first_ns - DISORDER_NS, self._facts.last_ns + DISORDER_NS


class _Candidate:
    """A possible content of a file: something on a connection or, if there is none, about the capture as a whole."""

    __slots__ = ("packet",)

    def __init__(self, pair: Pair | None) -> None:
        ends = None
        if pair is not None:
            ends = (Endpoint(pair[0], pair[1]), Endpoint(pair[2], pair[3]))
        self.packet = Packet(0, 0, ends, None)


def _example(slug: str) -> Found:
    """Return a finding with this slug; its other attributes are not used."""
    rule = CATALOGUE.get(slug)
    return Found(Finding(rule, 0, [], 0, "") if rule is not None else _UNKNOWN, None)


_UNKNOWN: Final = Finding(next(iter(CATALOGUE.values())), 0, [], 0, "")
