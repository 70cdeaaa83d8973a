"""Former names of attributes of `Transaction`, before all its names followed one rule.

They work in this version and will be removed in the next one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from dissect.wire.deprecated import warn_of

if TYPE_CHECKING:
    from dissect.engine.transactions.transaction import Transaction
    from dissect.protocols.s7.items import DataItem, ItemResult
    from dissect.protocols.s7plus.items import PlusItem


class OldNames:
    """Old names as aliases of new ones, each with a DeprecationWarning."""

    __slots__ = ()

    @property
    def outcome_name(self) -> str:
        """Old name of `outcome`."""
        warn_of("Transaction.outcome_name", "outcome")
        return cast("Transaction", self).outcome

    def results(self) -> list[ItemResult]:
        """Old name of `s7_results`, or, for all protocols, `items`."""
        warn_of("Transaction.results()", "items (or s7_results)")
        return cast("Transaction", self).s7_results

    def plus_items(self) -> list[PlusItem]:
        """Old name of `plus_results`, or, for all protocols, `items`."""
        warn_of("Transaction.plus_items()", "items (or plus_results)")
        return cast("Transaction", self).plus_results

    def answered_items(self) -> list[DataItem]:
        """Old way to the data items of a read answer, which `s7_results` has."""
        warn_of("Transaction.answered_items()", "s7_results")
        return cast("Transaction", self)._answered_items()

    def written_items(self) -> list[DataItem]:
        """Old way to the data items of a write request, which `s7_results` has."""
        warn_of("Transaction.written_items()", "s7_results")
        return cast("Transaction", self)._written_items()
