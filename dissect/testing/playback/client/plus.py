"""Adapts recorded requests of S7comm-plus to the current session, and determines their effect on a PLC."""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from typing import Final

from dissect.protocols.s7.tables import CONTROL, READ, WRITE
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.ids import AREAS, DATA_BLOCK
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.session import SERVER_SESSION, SUBSCRIPTION
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    DELETE_OBJECT,
    EXPLORE,
    GET_LINK,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    GET_VARIABLE,
    INIT_SSL,
    REQUEST,
    SET_MULTI_VARIABLES,
    SET_VAR_SUBSTREAMED,
    SET_VARIABLE,
)
from dissect.testing.golden.exchange import PLUS
from dissect.testing.golden.model import Transaction
from dissect.testing.playback.plus_octets import with_data, with_integrity, with_sequence

#: Functions that only read, whatever their object is.
_READS: Final = frozenset((EXPLORE, GET_LINK, GET_MULTI_VARIABLES, GET_VAR_SUBSTREAMED, GET_VARIABLE, INIT_SSL))
#: Requests of a session are counted in two sequences: those that change something, and all others.
_CHANGES: Final = frozenset((CREATE_OBJECT, DELETE_OBJECT, SET_MULTI_VARIABLES, SET_VAR_SUBSTREAMED, SET_VARIABLE))
#: Classes of objects that belong to the client's session: the session, its subscription container, subscriptions of values and
#: of alarms.
_OWN: Final = frozenset((SERVER_SESSION, 255, SUBSCRIPTION, 2662))
#: Attributes of these objects that a client sets to use them: the version of the session, the credit of a subscription.
_USED: Final = frozenset((306, 1053))
#: The session id before a session exists.
_NO_SESSION: Final = 0x120
_SESSION: Final = 9  # position of the session id in the data of a request
_OBJECT: Final = 14  # and of the object it refers to
_WIDTH: Final = 4
_FILL: Final = 4  # octets after an integrity id


def plus_kind(octets: bytes, own: AbstractSet[int]) -> str:
    """Return the effect of a request: `READ`, `WRITE`, or `CONTROL` for everything that is not certainly one of the others.

    ``own`` are the objects that the client's session has created.
    """
    pdu = parse_plus(octets)
    contents = parse_contents(pdu)
    if pdu.opcode != REQUEST or not pdu.readable or not pdu.whole or pdu.malformed:
        return CONTROL
    if pdu.function in _READS:
        return READ  # also with extra data: some clients fill up read requests
    if contents.malformed:
        return CONTROL
    if pdu.function == CREATE_OBJECT:
        return READ if contents.objects and all([one.class_id in _OWN for one in contents.every]) else CONTROL
    if pdu.function == DELETE_OBJECT:
        return READ if contents.object_id in own else CONTROL
    if pdu.function in {SET_VARIABLE, SET_MULTI_VARIABLES} and contents.object_id in own:
        return READ if contents.ids and _USED.issuperset(contents.ids) else CONTROL
    if pdu.function == SET_MULTI_VARIABLES:
        return WRITE if _are_variables(contents) else CONTROL
    return CONTROL


def _are_variables(contents: Contents) -> bool:
    areas = [int(address.area) for address in contents.addresses]
    variables = bool(areas) and all([area in AREAS or area >> 16 == DATA_BLOCK for area in areas])
    return variables and contents.object_id <= 0 and not contents.ids


def plus_kinds(transactions: Sequence[Transaction]) -> dict[int, str]:
    """Return the effect of each recorded request of a connection, by ``id``."""
    own: set[int] = set()
    kinds: dict[int, str] = {}
    for one in transactions:
        if one.exchange.kind == PLUS and one.request:
            kinds[id(one)] = plus_kind(one.request, own)
            own.update(made_by(one.request, one.response))
    return kinds


def made_by(request: bytes, answer: bytes) -> list[int]:
    """Return the ids of the objects that a request created for its session; empty for all others."""
    if not answer:
        return []
    request_pdu, response_pdu = parse_plus(request), parse_plus(answer)
    if (
        request_pdu.function != CREATE_OBJECT
        or response_pdu.function != CREATE_OBJECT
        or plus_kind(request, frozenset()) != READ
    ):
        return []
    return [int(number) for number in parse_contents(response_pdu).ids]


class PlusRenewal:
    """The state of one session for adapting requests: sequence number, session, integrity ids, objects by recorded ids."""

    def __init__(self) -> None:
        self.own: set[int] = set()
        self._sequence = 0
        self._session = _NO_SESSION
        self._counts = {False: 0, True: 0}
        self._objects: dict[int, int] = {}

    def renewed(self, request: bytes) -> tuple[int, bytes]:
        """Return the new sequence number of a request, and the adapted request."""
        self._sequence = self._sequence % 0xFFFF + 1
        pdu = parse_plus(request)
        contents = parse_contents(pdu)
        octets = with_sequence(request, self._sequence)
        if pdu.function != INIT_SSL:
            octets = with_data(octets, _SESSION, self._session.to_bytes(_WIDTH, "big"))
        octets = self._about(octets, pdu, contents)
        return self._sequence, self._counted(octets, pdu, contents)

    def _counted(self, octets: bytes, pdu: PlusPdu, contents: Contents) -> bytes:
        """Set the integrity id of a request. An id that is 0 in a golden looks like the fill octet after it; 1 does not."""
        if contents.integrity_id < 0:
            octets = with_data(tried := octets, len(pdu.data) - _FILL - 1, b"\x01")
            if parse_contents(parse_plus(octets)).integrity_id != 1:
                return tried
        row = pdu.function in _CHANGES
        self._counts[row] += 1
        return with_integrity(octets, self._counts[row])

    def _about(self, octets: bytes, pdu: PlusPdu, contents: Contents) -> bytes:
        """Replace the recorded object by its current counterpart."""
        now = self._objects.get(int(contents.object_id))
        stands = int.from_bytes(pdu.data[_OBJECT : _OBJECT + _WIDTH], "big") == contents.object_id
        return with_data(octets, _OBJECT, now.to_bytes(_WIDTH, "big")) if now is not None and stands else octets

    def answered(self, transaction: Transaction, answer: bytes) -> None:
        """Take the answer to the request that was sent for a recorded transaction."""
        recorded = made_by(transaction.request, transaction.response)
        now = made_by(transaction.request, answer)
        if not now:
            return
        classes = [one.class_id for one in parse_contents(parse_plus(transaction.request)).objects]
        if SERVER_SESSION in classes:
            self._session = now[0] & 0xFFFFFFFF
        self.own.update(now)
        self._objects.update(zip(recorded, now, strict=False))
