"""The protocols that reports know, by `Transaction.rosctr`, and what they say of any transaction.

A protocol whose transactions reports are to describe in its own words gets one subclass of `Facet` and one row here.
"""

from __future__ import annotations

from typing import Final

from dissect.report import words
from dissect.report.facet import Facet
from dissect.report.plus import PlusFacet
from dissect.report.s7 import S7Facet
from dissect.report.scd import ScdFacet
from dissect.s7plus.parameters import PLUS, is_plus_key
from dissect.transactions.payloads import SCD, is_scd_key
from dissect.transactions.transaction import Transaction

S7: Final = S7Facet()
_PLUS: Final = PlusFacet()
_SCD: Final = ScdFacet()

#: Of protocols that have no ROSCTR, by what stands in its place; all else is S7comm.
FACETS: Final[dict[int, Facet]] = {PLUS: _PLUS, SCD: _SCD}


def facet_of(transaction: Transaction) -> Facet:
    """Return how reports see a transaction."""
    return FACETS.get(transaction.rosctr, S7)


def facet_of_row(code: int) -> Facet:
    """Return whose row of statistics this is."""
    if is_scd_key(code):
        return _SCD
    return _PLUS if is_plus_key(code) else S7


def items(transaction: Transaction) -> list[str]:
    """Return every item with what became of it, in wire order."""
    return facet_of(transaction).items(transaction)


def subject(transaction: Transaction) -> str:
    """Return what a transaction is about: all its items, the setup, or what request and answer say."""
    return facet_of(transaction).subject(transaction)


def gist(transaction: Transaction) -> str:
    """Return what a transaction is about, as a summary: the items that failed, or else what was asked for, but never all."""
    facet = facet_of(transaction)
    return (
        words.items_in_short(transaction.results(), transaction.connection.naming)
        or facet.setup(transaction)
        or facet.notes(transaction)
    )
