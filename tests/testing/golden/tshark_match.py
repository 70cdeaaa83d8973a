"""Where a golden and tshark's view of the same capture differ, transaction by transaction."""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple

from tests.testing.golden.golden_said import Said, SaidLink
from tests.testing.golden.tshark_lines import deal_lines, link_lines
from tests.testing.golden.tshark_view import Deal, Shown


class Difference(NamedTuple):
    """A statement that tshark does not confirm, or a fact that only tshark shows.

    ``place`` is the number of a transaction, ``connection N``, or empty if the golden has nothing; ``shown`` is a short form of
    tshark's view, if both have it only the lines that differ. ``said`` and ``theirs`` are all lines.
    """

    place: str
    shown: str
    said: list[str]
    theirs: list[str]


def differences(links: list[SaidLink], shown: list[Shown]) -> list[Difference]:
    """Return the differences between golden and tshark; connections are matched by their contents."""
    found: list[Difference] = []
    pairs = sorted(
        ((_likeness(link, each), -link.number, -at, link, each) for link in links for at, each in enumerate(shown)),
        key=lambda pair: pair[:3],
        reverse=True,
    )
    taken: set[int] = set()
    for likeness, _, _, link, each in pairs:
        if any(likeness) and id(link) not in taken and id(each) not in taken:
            taken |= {id(link), id(each)}
            found += _on_connection(link, each)
    for link in links:
        if id(link) not in taken:
            found.append(Difference(f"connection {link.number}", "nothing", link.lines, []))
            found += [Difference(str(said.number), "nothing", said.lines, []) for said in link.deals]
    for each in shown:
        if id(each) not in taken:
            found.append(Difference("", "connection", [], link_lines(each)))
            found += [Difference("", _short(deal), [], _like(deal, None)) for deal in each.deals]
    return sorted(found, key=lambda difference: [int(word) for word in difference.place.split() if word.isdigit()])


def _likeness(link: SaidLink, shown: Shown) -> tuple[float, int]:
    """Return how similar two connections are: the share of equal deals, and equal lines of the connection itself."""
    common, deals = len(_common(link.deals, shown.deals)), len(link.deals) + len(shown.deals)
    return common / max(deals, 1), len(set(link.lines) & set(link_lines(shown)))


def _like(deal: Deal, said: Said | None) -> list[str]:
    """Return the lines of tshark's view in the form of ``said``."""
    if said is None:
        return deal_lines(deal, True, True, frozenset())
    return deal_lines(deal, said.by_form, said.plain, said.whole)


def _short(deal: Deal) -> str:
    return ", ".join([line for line in _like(deal, None)[:2] if not line.startswith(("request ", "answer J", "says "))])


def _apart(said: list[str], theirs: list[str]) -> str:
    """Return the lines that only one side has."""
    less, more = Counter(said) - Counter(theirs), Counter(theirs) - Counter(said)
    return ", ".join([*[f"no {line}" for line in less.elements()], *more.elements()])


def _common(said: list[Said], shown: list[Deal]) -> list[tuple[int, int]]:
    """Return the longest run of places, in order, where both are the same."""
    lines: dict[tuple[bool, bool, frozenset[str], int], list[str]] = {}

    def same(one: Said, at: int) -> bool:
        key = one.by_form, one.plain, one.whole, at
        if key not in lines:
            lines[key] = _like(shown[at], one)
        return lines[key] == one.lines

    best = [[0] * (len(shown) + 1) for _ in range(len(said) + 1)]
    for at in range(len(said) - 1, -1, -1):
        for other in range(len(shown) - 1, -1, -1):
            together = best[at + 1][other + 1] + 1 if same(said[at], other) else 0
            best[at][other] = max(together, best[at + 1][other], best[at][other + 1])
    at = other = 0
    found = []
    while at < len(said) and other < len(shown):
        if same(said[at], other) and best[at][other] == best[at + 1][other + 1] + 1:
            found.append((at, other))
            at, other = at + 1, other + 1
        elif best[at + 1][other] >= best[at][other + 1]:
            at += 1
        else:
            other += 1
    return found


def _on_connection(link: SaidLink, shown: Shown) -> list[Difference]:
    found = []
    if link.lines != link_lines(shown):
        theirs = link_lines(shown)
        short = _apart(link.lines, theirs)
        found.append(Difference(f"connection {link.number}", short, link.lines, theirs))
    at = other = 0
    for end, others in [*_common(link.deals, shown.deals), (len(link.deals), len(shown.deals))]:
        while at < end or other < others:
            said = link.deals[at] if at < end else None
            deal = shown.deals[other] if other < others else None
            theirs = _like(deal, said) if deal is not None else []
            place = str(said.number) if said is not None else ""
            short = _short(deal) if deal is not None else "nothing"
            if said is not None and theirs[:1] == said.lines[:1]:
                short = _apart(said.lines, theirs)
            found.append(Difference(place, short, said.lines if said is not None else [], theirs))
            at, other = at + (said is not None), other + (deal is not None)
        at, other = end + 1, others + 1
    return found
