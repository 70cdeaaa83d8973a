"""What reports ask of a protocol about its transactions; `dissect.report.facets` has the table of those that answer."""

from __future__ import annotations

from collections.abc import Callable

from mypy_extensions import mypyc_attr

from dissect.s7.parameters import Parameters
from dissect.transactions.transaction import Transaction

#: Tells the file of a packet and its number within it.
Locate = Callable[[int], tuple[str, int]]


@mypyc_attr(allow_interpreted_subclasses=True)
class Facet:
    """The view of reports on the transactions of one protocol; what is not overridden has nothing to say.

    Texts are safe to show. What ends in ``_json`` is a piece of a line of JSON (docs/json.md), a comma before each key.
    """

    def pushes_both_ways(self) -> bool:
        """Return whether what is sent without a request goes either way, so that it is shown as it went."""
        return False

    def reference(self, transaction: Transaction) -> str:
        """Return the number by which request and answer belong together, empty where there is none."""
        return str(transaction.pdu_ref)

    def function_number(self, transaction: Transaction) -> str:
        """Return the function code in decimal, empty where there is none."""
        return str(transaction.function) if transaction.function >= 0 else ""

    def items(self, transaction: Transaction) -> list[str]:
        """Return every item with what became of it, in wire order."""
        return []

    def subject(self, transaction: Transaction) -> str:
        """Return what a transaction is about: its items, or what request and answer say, in a length for one line."""
        return ""

    def subject_whole(self, transaction: Transaction) -> str:
        """Return what a transaction without items is about, nothing left out."""
        return self.subject(transaction)

    def notes(self, transaction: Transaction) -> str:
        """Return what request and answer say, for functions that have no items: a few notes of each."""
        return self.subject(transaction)

    def setup(self, transaction: Transaction) -> str:
        """Return what a setup negotiated, empty for any other function."""
        return ""

    def function_json(self, parameters: Parameters) -> str:
        """Return the ``function`` object, and keys that stand behind it."""
        return '{"code":null,"name":null}'

    def body_json(self, transaction: Transaction) -> str:
        """Return the keys from the notes to the items, those included."""
        return ',"items":[]'

    def tail_json(self, transaction: Transaction, locate: Locate | None) -> str:
        """Return the keys behind the errors."""
        return ""

    def statistics(self, code: int) -> dict[str, object]:
        """Return the code of a row of statistics (`Parameters.function` or what counts for it) and the protocol."""
        return {"code": None}
