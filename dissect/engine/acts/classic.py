"""Recognises the acts of S7comm: PI services, PLC stop, the functions of transfers, userdata, writes to outputs.

The tables of functions, userdata subfunctions and PI services (`dissect.protocols.s7.tables`, `dissect.protocols.s7.services`)
state the effect of a request; this module states which act it is.
"""

from __future__ import annotations

from typing import Final

from dissect.engine.acts import tables as kinds
from dissect.engine.acts.act import Act, act_of
from dissect.engine.transactions.naming import items_said
from dissect.engine.transactions.operations import subject_of
from dissect.engine.transactions.results import half_captured
from dissect.engine.transactions.transaction import BEHIND_MALFORMED, ORPHAN, PUSH, Transaction
from dissect.protocols.s7.body import Body
from dissect.protocols.s7.items import ItemResult
from dissect.protocols.s7.parameters import PUSH as INDICATION
from dissect.protocols.s7.parameters import UserdataHead
from dissect.protocols.s7.services import (
    COMPRESS,
    COPY_TO_ROM,
    DELETE,
    LINK_IN,
    LINK_IN_SECOND,
    NC_PREFIX,
    PI_SERVICES,
    PROGRAM,
)
from dissect.protocols.s7.tables import (
    ALARM_CHANGE,
    CLOCK,
    DEBUG,
    FLASH,
    FORCE,
    FUNCTIONS,
    GROUP_SECURITY,
    LOGIN,
    MEMORY,
    PI_SERVICE,
    PROGRAM_CHANGE,
    PROGRAM_READ,
    READ,
    SEND_PASSWORD,
    STOP,
    SUCCESS,
    TEST,
    USERDATA,
    USERDATA_SUBFUNCTIONS,
    VARIABLE_STATUS,
)

#: Acts of functions and userdata, by the effect of the request.
_ACTS: Final[dict[str, str]] = {
    ALARM_CHANGE: kinds.ALARMS,
    CLOCK: kinds.CLOCK,
    DEBUG: kinds.TEST,
    FLASH: kinds.FLASH,
    FORCE: kinds.FORCE,
    MEMORY: kinds.RESET,
    PROGRAM_CHANGE: kinds.DOWNLOAD,
    PROGRAM_READ: kinds.UPLOAD,
    STOP: kinds.STOP,
    TEST: kinds.MONITOR,
}
#: Acts of some PI services; the acts of the others follow from their effects.
_SERVICES: Final[dict[str, str]] = {
    LINK_IN: kinds.ACTIVATE,
    LINK_IN_SECOND: kinds.ACTIVATE,
    DELETE: kinds.DELETE,
    PROGRAM: kinds.START,
    COPY_TO_ROM: kinds.TO_ROM,
    COMPRESS: kinds.COMPRESS,
    "_N_LOGIN_": kinds.PASSWORD,
    "_N_LOGOUT": kinds.PROTECTION,
    "_N_NEWPWD": kinds.PROTECTION,
    "_N_F_PROT": kinds.PROTECTION,
    "_N_F_PROR": kinds.PROTECTION,
}
#: The argument of a cold restart begins with this (reference 3.10).
_COLD: Final = b"C"
#: Maximum number of variables that a subject names.
_NAMED: Final = 8
_NC_COMMAND: Final = "security.nc_command"


def recognise(transaction: Transaction) -> Act | None:
    """Return the act that a transaction is or begins; None for all other transactions. Reads and writes are not examined."""
    head = transaction.parameters.userdata
    if head is not None and transaction.rosctr == USERDATA:
        return None if is_push(transaction, head) or not asked(transaction) else _of_userdata(transaction, head)
    if not asked(transaction):
        return None
    if transaction.function == PI_SERVICE:
        return _of_service(transaction)
    kind = _ACTS.get(FUNCTIONS.effect(transaction.function), "")
    if not kind:
        return None
    if kind == kinds.STOP:
        act = act_of(kind, transaction, transaction.function_name)
        act.text = "PLC stop"
        return act
    return act_of(kind, transaction, subject_of(transaction))


def asked(transaction: Transaction) -> bool:
    """Return whether a client made the request: it was captured, or the capture explains why it is missing."""
    return transaction.request_frame > 0 or (transaction._outcome == ORPHAN and half_captured(transaction))


def is_push(transaction: Transaction, head: UserdataHead) -> bool:
    """Return whether a PLC sent a userdata message without being asked."""
    if transaction._outcome == BEHIND_MALFORMED:
        return transaction.request_frame == 0 and head.type == INDICATION
    return transaction._outcome == PUSH


def _of_userdata(transaction: Transaction, head: UserdataHead) -> Act | None:
    table = USERDATA_SUBFUNCTIONS.get(head.group)
    effect = table.effect(head.subfunction) if table is not None else ""
    if effect == LOGIN and head.group == GROUP_SECURITY:
        kind = kinds.PASSWORD if head.subfunction == SEND_PASSWORD else kinds.PROTECTION
        act = act_of(kind, transaction, head.subfunction_name)
        if kind == kinds.PROTECTION:
            act.slug = ""  # a session gives its rights back
        return act
    kind = _ACTS.get(effect, "")
    if not kind or (kind == kinds.MONITOR and head.subfunction != VARIABLE_STATUS):
        return None
    forced = _forced(transaction) if kind == kinds.FORCE else ""
    body = transaction.request_body
    subject = subject_of(transaction) if body is not None and body.notes else head.subfunction_name
    act = act_of(kind, transaction, forced or subject)
    act.text = forced
    return act


def _forced(transaction: Transaction) -> str:
    """Return the function name, and the variables with their new values; empty if the request does not name them."""
    said = items_said(transaction.connection.naming, transaction.s7_results, True, _NAMED)
    return f"{transaction.function_name} {said}" if said else ""


def _of_service(transaction: Transaction) -> Act | None:
    """Return the act of a PI service; None if the service only reads, has no name, or its name was only partly captured."""
    body = transaction.request_body
    name = body.text("service") if body is not None else ""
    row = PI_SERVICES.get(name)
    if not name or (row is not None and row.effect == READ):
        return None
    kind = _SERVICES.get(name, "")
    if kind == kinds.START and _is_cold(body):
        kind = kinds.RESTART
    if not kind:
        kind = kinds.NC if row is not None or name.startswith(NC_PREFIX) else kinds.UNKNOWN
    if kind == kinds.UNKNOWN and _is_cut_short(transaction, name):
        return None
    act = act_of(kind, transaction, subject_of(transaction))
    if name.startswith(NC_PREFIX):
        act.slug = _NC_COMMAND
        act.command = ""
    return act


def _is_cold(body: Body | None) -> bool:
    """Return whether the argument of a start requests a cold restart."""
    from dissect.protocols.s7.control import PI_ARGUMENT  # late, as bodies are parsed: few captures have PI services

    argument = body.find(PI_ARGUMENT) if body is not None else None
    return argument is not None and argument.octets("argument").startswith(_COLD)


def _is_cut_short(transaction: Transaction, name: str) -> bool:
    """Return whether only part of a request was captured, and ``name`` is the beginning of the name of a known PI service."""
    request = transaction.request
    return request is not None and bool(request.malformed) and any([row.startswith(name) for row in PI_SERVICES])


class Became:
    """The items of a write by their result: written, refused, or unsure (no return code)."""

    __slots__ = ("refused", "unsure", "written")

    def __init__(self, transaction: Transaction) -> None:
        self.written: list[ItemResult] = []
        self.refused: list[ItemResult] = []
        self.unsure: list[ItemResult] = []
        for result in transaction.s7_results:
            if result.item is None:
                continue  # a return code without an item
            if transaction.refused or result.refused:
                self.refused.append(result)
            elif result.return_code == SUCCESS:
                self.written.append(result)
            else:
                self.unsure.append(result)
