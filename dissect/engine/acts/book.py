"""`ActBook`: the list of acts. It checks what may be an act, makes an operation of each command, and numbers the acts."""

from __future__ import annotations

from typing import Final

from dissect.engine.acts import tables as kinds
from dissect.engine.acts.act import Act, act_of, act_of_operation
from dissect.engine.acts.classic import recognise
from dissect.engine.acts.plus import act_of_event
from dissect.engine.acts.tables import ACCEPTED
from dissect.engine.acts.tables import REFUSED as REFUSED_ACT
from dissect.engine.transactions.operation import (
    DELETE,
    DONE,
    MAX_SUBJECT,
    PASSWORD,
    REFUSED,
    TRANSFERS,
    Operation,
    OperationBook,
)
from dissect.engine.transactions.results import item_error
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.s7.services import BLOCK_SERVICES
from dissect.protocols.s7.tables import PI_SERVICE, REQUEST_DOWNLOAD, START_UPLOAD
from dissect.protocols.s7plus.event import Event

#: Jobs that begin a transfer. A transfer is an operation, and becomes one act when it is over.
_BEGINNINGS: Final = frozenset((REQUEST_DOWNLOAD, START_UPLOAD))
_BLOCK: Final = "block "


class ActBook:
    """Collects acts. ``fresh`` are the finished acts that are not reported yet; ``count`` is the number of all acts."""

    def __init__(self, operations: OperationBook) -> None:
        self.fresh: list[Act] = []
        self.count = 0
        self._operations = operations

    def take(self, transaction: Transaction, alone: bool = False) -> Act | None:
        """Return the act that a transaction of S7comm is or begins; make the operation if it is a command.

        With ``alone`` it belongs to no operation, because it followed a malformed header.
        """
        if transaction.function == PI_SERVICE and not alone:
            self._follow_blocks(transaction)
        act = recognise(transaction)
        if act is None:
            return None
        if act.command and not alone:
            self._operate(act, transaction)
        if alone or not (act.row.lasts and transaction.function in _BEGINNINGS):
            self.add(act)
        return act

    def event(self, event: Event, transaction: Transaction, code: int, alone: bool = False) -> Act | None:
        """Return the act of an event of S7comm-plus, None if there is none; ``code`` is its error, 0 for none.

        ``alone`` as for `take`. The operations of such events are made in `dissect.engine.transactions.plus_operations`; writes
        to outputs become acts where they are reported (`wrote`).
        """
        act = act_of_event(event, transaction, code)
        if act is not None and (alone or not act.row.lasts):
            self.add(act)
        return act

    def wrote(
        self, transaction: Transaction, what: str, code: int, refused: bool = False, return_code: int = -1
    ) -> None:
        """Take the first write to outputs on a connection, or the first one that was ``refused``.

        ``code`` as for `dissect.engine.acts.act.act_of`. The device may refuse items of a request that it answers without an
        error: ``return_code`` is that of the first of them, -1 for none.
        """
        act = act_of(kinds.OUTPUTS, transaction, what, code)
        if refused and act.outcome == ACCEPTED:
            act.outcome = REFUSED_ACT
            if return_code >= 0:
                act.error = item_error(return_code, 0, "")
        self.add(act)

    def over(self, operation: Operation) -> Act | None:
        """Return the act of a finished operation; None for all operations but transfers of blocks."""
        if operation.kind not in TRANSFERS:
            return None
        act = act_of_operation(operation.kind, operation)
        self.add(act)
        return act

    def add(self, act: Act) -> None:
        """Number an act that is over."""
        self.count += 1
        act.number = self.count
        self.fresh.append(act)

    def _follow_blocks(self, transaction: Transaction) -> None:
        """Note on the loaded blocks that a service activates or deletes them."""
        body = transaction.request_body
        if body is not None and body.text("service") in BLOCK_SERVICES:
            from dissect.engine.transactions.transfers import follow_blocks  # late, because few captures have transfers

            follow_blocks(transaction, body)

    def _operate(self, act: Act, transaction: Transaction) -> None:
        """Make the operation of an act that is a single transaction."""
        subject = act.subject
        if act.command == PASSWORD:
            if not transaction.request_frame:
                return
            subject = ""
        body = transaction.request_body
        if act.command == DELETE and body is not None:
            blocks = [note.removeprefix(_BLOCK) for note in body.notes if note.startswith(_BLOCK)]
            subject = ", ".join(blocks)[:MAX_SUBJECT] or subject
        act.subject = subject or act.subject
        operation = self._operations.begin(act.command, "", transaction, subject)
        self._operations.settle(operation, transaction, DONE, REFUSED)
