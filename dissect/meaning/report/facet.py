"""`Facet`: the knowledge of reports about the transactions of a protocol.

The table of all facets is in `dissect.meaning.report.facets`.
"""

from __future__ import annotations

from collections.abc import Callable

from mypy_extensions import mypyc_attr

from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.s7.parameters import Parameters

#: Returns the file and the number in the file of a packet, given its number in the run.
Locate = Callable[[int], tuple[str, int]]


@mypyc_attr(allow_interpreted_subclasses=True)
class Facet:
    """How reports show the transactions of one protocol.

    A subclass overrides the methods for which its protocol has something to show. All texts that are returned are escaped.
    Methods that end in ``_json`` return a piece of a line of JSON (docs/json.md). A comma precedes each key of it, except in
    `function_json`, which begins with the value of ``function``.
    """

    def reference(self, transaction: Transaction) -> str:
        """Return the number that request and answer share, empty if there is none."""
        return str(transaction.pdu_ref)

    def function_number(self, transaction: Transaction) -> str:
        """Return the function code in decimal, empty if there is none."""
        return str(transaction.function) if transaction.function >= 0 else ""

    def items(self, transaction: Transaction) -> list[str]:
        """Return each item with its value or error, in wire order."""
        return []

    def subject(self, transaction: Transaction) -> str:
        """Return the subject of a transaction: its items, or notes on request and answer; shortened to fit a line."""
        return ""

    def subject_whole(self, transaction: Transaction) -> str:
        """Return the subject of a transaction without items, not shortened."""
        return self.subject(transaction)

    def notes(self, transaction: Transaction) -> str:
        """Return a few notes on request and answer, for functions that have no items."""
        return self.subject(transaction)

    def setup(self, transaction: Transaction) -> str:
        """Return the values negotiated by a setup, empty for any other function."""
        return ""

    def function_json(self, parameters: Parameters) -> str:
        """Return the ``function`` object, and the keys that follow it."""
        return '{"code":null,"name":null}'

    def body_json(self, transaction: Transaction) -> str:
        """Return the keys from the notes to the items, both included."""
        return ',"items":[]'

    def tail_json(self, transaction: Transaction, locate: Locate | None) -> str:
        """Return the keys that follow the errors."""
        return ""

    def statistics(self, code: int) -> dict[str, object]:
        """Return the JSON keys of a row of statistics that name its function and its protocol.

        ``code`` is the key of the row in `Analysis.functions`.
        """
        return {"code": None}
