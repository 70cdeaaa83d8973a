"""The protocols that reports know, by `Transaction.rosctr`, and what they say about any transaction.

A protocol whose transactions reports are to describe in its own words gets one subclass of `Facet` and one row here. S7comm
is the default; its JSON is the bulk of all output and is in `dissect.report.writers.jsonl`.
"""

from __future__ import annotations

from typing import Final

from dissect.report import words
from dissect.report.facet import Facet
from dissect.report.plus import PlusFacet
from dissect.report.scd import ScdFacet, scd_subject
from dissect.s7.tables import READ_VAR, SETUP_COMMUNICATION, USERDATA, WRITE_VAR
from dissect.s7plus.parameters import PLUS, is_plus_key
from dissect.transactions.payloads import SCD, is_scd_key
from dissect.transactions.results import UNCONFIRMED
from dissect.transactions.transaction import ANSWERED, Transaction
from dissect.wire.text import printable, shortened

#: Functions that say what they are about by their items, or by what they negotiate.
_TOLD_BY_ITEMS: Final = frozenset((READ_VAR, WRITE_VAR, SETUP_COMMUNICATION))

#: Group and subfunction that lists the blocks of a type.
_LIST_OF_TYPE: Final = (3, 2)


class S7Facet(Facet):
    """S7comm, and what stands for it in the table of facets."""

    def items(self, transaction: Transaction) -> list[str]:
        """Return every item with what became of it; those that a push says are unchanged are counted."""
        good = transaction.good_octets()
        if good is not None:  # nearly always; each item meets its own octets without an object in between
            asked = transaction.parameters.items
            return [
                f"{words.address(asked[index])} = {words.content(asked[index], good[index])}"
                for index in range(len(good))
            ]
        results = list(enumerate(transaction.results(), 1))
        unsure = transaction.flags & UNCONFIRMED != 0
        naming = transaction.connection.naming
        said = [
            f"{words.item(result, number, naming)}{': no return code' if unsure and result.return_code < 0 else ''}"
            for number, result in results
            if not result.unchanged
        ]
        same = len(results) - len(said)
        return [*said, f"{same} unchanged"] if same else said

    def subject(self, transaction: Transaction) -> str:
        """Return all items, the setup, or what request and answer say."""
        said = ", ".join(self.items(transaction)) or self.setup(transaction) or self.notes(transaction)
        if transaction.rosctr == USERDATA and transaction.results():
            said = ": ".join([text for text in (_heads(transaction), said) if text])
        if transaction.carried is not None:
            said = "; ".join([text for text in (said, scd_subject(transaction)) if text])
        return said

    def subject_whole(self, transaction: Transaction) -> str:
        """Return what a transaction without items is about, nothing left out."""
        if transaction.function in _TOLD_BY_ITEMS:
            return self.subject(transaction)
        asked, told = transaction.request, transaction.response
        said = [", ".join([printable(note) for note in pdu.body.notes]) for pdu in (asked, told) if pdu is not None]
        return _asked_and_told(said)

    def notes(self, transaction: Transaction) -> str:
        """Return what request and answer say, for functions that have no items: a few notes of each."""
        if transaction.function in _TOLD_BY_ITEMS:
            return ""
        asked, told = transaction.request, transaction.response
        said = [words.body_notes(pdu) for pdu in (asked, told) if pdu is not None]
        head = transaction.parameters.userdata
        listed = (
            head is not None and (int(head.group), int(head.subfunction)) == _LIST_OF_TYPE
        )  # the answer only goes on: SFC 0 (AWL), …
        return " ".join([text for text in said if text]) if listed else _asked_and_told(said)

    def setup(self, transaction: Transaction) -> str:
        """Return what a setup asked for, and what was granted."""
        asked = transaction.parameters.setup
        if asked is None:
            return ""
        answer = transaction.response_parameters
        granted = answer.setup if answer is not None else None
        wish = str(asked)
        if granted is None or transaction.outcome != ANSWERED:
            return f"asks {wish}"
        given = str(granted)
        return f"granted {given}" if given == wish else f"asks {wish}, granted {given}"

    def statistics(self, code: int) -> dict[str, object]:
        """Return function code, and for userdata group and subfunction."""
        if code < 0x10000:
            return {"code": f"0x{code & 0xFF:02x}" if code >= 0 else None}
        group = (code >> 8) & 0xFF
        # The mode transition is the one userdata with a function octet of its own, and stands in group 0.
        return {"code": "0x00" if group else "0x01", "group": group, "subfunction": code & 0xFF}


def _asked_and_told(said: list[str]) -> str:
    """Join what a request says and what its answer does; an answer that repeats the request goes on behind that."""
    if len(said) < 2:
        return "".join(said)
    asked, told = said
    if told == asked or told.startswith(f"{asked}, "):
        said = [asked, told[len(asked) + 2 :]]
    return " → ".join([text for text in said if text])


def _heads(transaction: Transaction) -> str:
    """Return what request and answer say in front of their items: interval, job number, block."""
    from dissect.s7.cyclic import CYCLIC_REQUEST, CYCLIC_VALUES  # late: see `Pdu.body`
    from dissect.s7.programmer_layouts import TEST_BLOCK, TEST_HEAD

    said = [
        part.note
        for pdu in (transaction.request, transaction.response)
        if pdu is not None
        for part in pdu.body.parts
        if part.note and part.layout in {CYCLIC_REQUEST, CYCLIC_VALUES, TEST_BLOCK, TEST_HEAD}
    ]
    first = said[0] if said else ""
    return ", ".join([shortened(note, words.NOTE) for note in dict.fromkeys(said) if not first.startswith(f"{note},")])


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
