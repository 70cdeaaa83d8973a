"""Requests and answers of S7comm for a conversation written by hand (`dissect.testing.talk`).

A request is an `Ask`, an answer a `Tell`, which may depend on the request. Neither has a reference: the conversation sets it.
Wrong input raises ValueError.
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Final

from dissect.protocols.s7.address import parse_address
from dissect.protocols.s7.build import build_payload, build_pdu, build_setup, build_userdata_head
from dissect.protocols.s7.items import Item
from dissect.protocols.s7.message import Pdu
from dissect.protocols.s7.parameters import HEADER_SIZE, PUSH, REQUEST, RESPONSE, Setup
from dissect.protocols.s7.tables import (
    ACK_DATA,
    GROUP_CPU,
    JOB,
    OBJECT_DOES_NOT_EXIST,
    READ_SZL,
    READ_VAR,
    SUCCESS,
    USERDATA,
    WRITE_VAR,
)
from dissect.testing.golden.forms import (
    ItemLine,
    build_answer,
    build_request,
    parse_item_text,
    usual_size,
)
from dissect.testing.golden.values import value_octets
from dissect.testing.playback.server.answers import NOT_AVAILABLE, refuse

#: Possible types of an element of an item.
Scalar = bool | int | float | str

#: The default type for the width letter of an address.
_TYPES: Final = {"": "BIT", "X": "BIT", "B": "BYTE", "W": "WORD", "D": "DWORD"}
_NUMBERED: Final = {0x1C: "COUNTER", 0x1D: "TIMER", 0x1E: "COUNTER", 0x1F: "TIMER"}


class Ask:
    """A request: its PDU, with any reference. Raises ValueError if it is shorter than a header."""

    def __init__(self, octets: bytes) -> None:
        if len(octets) < HEADER_SIZE:
            raise ValueError(f"{octets.hex(' ')}: a PDU has at least {HEADER_SIZE} bytes")
        self.octets = octets


class Tell(ABC):
    """An answer: `build` makes its PDU for a request."""

    @abstractmethod
    def build(self, request: Pdu) -> bytes:
        """Return the PDU."""


class _Octets(Tell):
    def __init__(self, octets: bytes) -> None:
        self._octets = octets

    def build(self, request: Pdu) -> bytes:
        return self._octets


# ---- requests -------------------------------------------------------------------------------------------------------


def _line(text: str) -> ItemLine:
    """Parse ``DB10.DBW4``, ``DB10.DBD4 REAL x3`` or ``DB10.DBW4 INT = 5``; the width letter gives the default type."""
    address, _, rest = text.strip().partition(" ")
    parsed = parse_address(address)
    if parsed is not None and (not rest or rest[0] in "=x"):
        kind = _NUMBERED.get(parsed.area) or _TYPES.get(parsed.width, "")
        rest = f"{kind} {rest}".strip()
    return parse_item_text(f"{address} {rest}".rstrip())


def read(*items: str) -> Ask:
    """Read variables: ``read("DB10.DBW4", "DB10.DBD8 REAL", "MB20 x4")``. Raises ValueError for an invalid item."""
    lines = [_line(item) for item in items]
    if any([line.data is not None for line in lines]):
        raise ValueError("a read has no values")
    return Ask(build_request(READ_VAR, lines))


def write(*items: str) -> Ask:
    """Write variables: ``write("DB10.DBW4 INT = -5", "M0.0 = true", "DB10.DBB0 x2 = <01 02>")``.

    Raises ValueError for an invalid item or one without a value.
    """
    lines = [_line(item) for item in items]
    if any([line.data is None for line in lines]):
        raise ValueError("each item of a write needs a value: DB10.DBW4 INT = 5")
    return Ask(build_request(WRITE_VAR, lines))


def setup(pdu: int = 480, calling: int = 1, called: int = 1) -> Ask:
    """Request a PDU length and a number of parallel jobs in each direction."""
    return Ask(build_setup(JOB, Setup(calling, called, pdu)))


def job(parameters: bytes, data: bytes = b"") -> Ask:
    """Send a job with these octets after the header."""
    return Ask(build_pdu(JOB, parameters, data))


def userdata(group: int, subfunction: int, payload: bytes = b"", sequence: int = 0) -> Ask:
    """Send a userdata request; without ``payload`` the data are the four octets of an empty payload."""
    head = build_userdata_head(REQUEST, group, subfunction, sequence, extended=False)
    return Ask(build_pdu(USERDATA, head, build_payload(payload)))


def szl(szl_id: int, index: int = 0) -> Ask:
    """Read a system status list."""
    return userdata(GROUP_CPU, READ_SZL, struct.pack(">HH", szl_id, index))


def push(group: int, subfunction: int, payload: bytes) -> Ask:
    """Send an unsolicited message: cyclic data, a message."""
    return Ask(build_pdu(USERDATA, build_userdata_head(PUSH, group, subfunction), build_payload(payload)))


def pdu(octets: bytes) -> Ask:
    """Send a PDU; only its reference is replaced."""
    return Ask(octets)


# ---- answers --------------------------------------------------------------------------------------------------------


class Piece(Tell):
    """The result of one item; alone it is the answer to a read of one item.

    ``data`` are the octets that are read, None if the item is refused with ``code``; ``elements`` are packed by the requested
    type.
    """

    def __init__(self, data: bytes | None = None, elements: Sequence[Scalar] = (), code: int = SUCCESS) -> None:
        self._data = data
        self._elements = list(elements)
        self.code = code

    def line(self, item: Item) -> ItemLine:
        """Return the result of ``item``. Raises ValueError if the answer has a different length from the item."""
        if self.code != SUCCESS:
            return ItemLine(item.octets, None, self.code, 0)
        data = self._data
        if data is None:
            texts = [_text(element) for element in self._elements]
            data = b"".join([value_octets(text, int(item.transport_size)) for text in texts])
        if item.size >= 0 and len(data) != item.size:
            raise ValueError(f"{item.label} has {item.size} bytes, the answer {len(data)}")
        return ItemLine(item.octets, data, SUCCESS, usual_size(item))

    def build(self, request: Pdu) -> bytes:
        """Return the answer to a request of one item."""
        return items(self).build(request)


class _Items(Tell):
    def __init__(self, pieces: Sequence[Piece]) -> None:
        self._pieces = pieces

    def build(self, request: Pdu) -> bytes:
        wanted = request.parameters.items
        if request.function not in {READ_VAR, WRITE_VAR}:
            raise ValueError(f"only a read or a write has items, not {request.function_name}")
        if len(wanted) != len(self._pieces):
            raise ValueError(f"{len(wanted)} items were requested, the answer has {len(self._pieces)}")
        pairs = zip(self._pieces, wanted, strict=True)
        if request.function == WRITE_VAR:
            return build_answer(WRITE_VAR, [ItemLine(item.octets, None, piece.code, 0) for piece, item in pairs])
        return build_answer(READ_VAR, [piece.line(item) for piece, item in pairs])


class _Done(Tell):
    def build(self, request: Pdu) -> bytes:
        wanted = request.parameters.items
        if request.function == WRITE_VAR:
            return build_answer(WRITE_VAR, [ItemLine(item.octets, None, SUCCESS, 0) for item in wanted])
        return build_pdu(ACK_DATA, bytes((request.function & 0xFF,)))


class _Refusal(Tell):
    def __init__(self, code: int) -> None:
        self._code = code

    def build(self, request: Pdu) -> bytes:
        return refuse(request, self._code)


class _Userdata(Tell):
    def __init__(self, payload: bytes, code: int) -> None:
        self._payload = payload
        self._code = code

    def build(self, request: Pdu) -> bytes:
        head = request.parameters.userdata
        if head is None:
            raise ValueError(f"{request.function_name} is not userdata")
        parameters = build_userdata_head(RESPONSE, head.group, head.subfunction, head.sequence, error=self._code)
        return build_pdu(USERDATA, parameters, build_payload(self._payload))


def _text(element: Scalar) -> str:
    if isinstance(element, bool):
        return "true" if element else "false"
    return f'"{element}"' if isinstance(element, str) else str(element)


def values(*elements: Scalar) -> Piece:
    """The elements of an item, in the requested type: ``values(1.5, 2.5)``, ``values(True)``, ``values("OK")``."""
    return Piece(None, elements)


def _packed(form: str, numbers: Sequence[float]) -> Piece:
    try:
        return Piece(b"".join([struct.pack(f">{form}", number) for number in numbers]))
    except (struct.error, OverflowError):
        raise ValueError(f"{numbers}: out of range for the type") from None


def words(*numbers: int) -> Piece:
    """Words: unsigned, 16 bits."""
    return _packed("H", numbers)


def ints(*numbers: int) -> Piece:
    """Integers: signed, 16 bits."""
    return _packed("h", numbers)


def dwords(*numbers: int) -> Piece:
    """Double words: unsigned, 32 bits."""
    return _packed("I", numbers)


def dints(*numbers: int) -> Piece:
    """Double integers: signed, 32 bits."""
    return _packed("i", numbers)


def reals(*numbers: float) -> Piece:
    """Floating point numbers: 32 bits."""
    return _packed("f", numbers)


def octets(content: bytes) -> Piece:
    """The octets of an item, unchanged."""
    return Piece(content)


def refused(code: int = OBJECT_DOES_NOT_EXIST) -> Piece:
    """An item that is refused with a return code. Raises ValueError for a code that means success."""
    if not 0 <= code <= 0xFF or code == SUCCESS:
        raise ValueError(f"0x{code:02x} is not a return code for a refusal")
    return Piece(code=code)


def items(*pieces: Piece) -> Tell:
    """The results of several items, in the order of the request; for a write `refused` and `done_item`."""
    return _Items(pieces)


def done_item() -> Piece:
    """An item that was written."""
    return Piece()


def done() -> Tell:
    """Success: each item is written; for other jobs the answer has only the function."""
    return _Done()


def error(code: int = NOT_AVAILABLE) -> Tell:
    """The whole request is refused, with an error code in the header or of userdata."""
    return _Refusal(code)


def granted(pdu: int = 480, calling: int = 1, called: int = 1) -> Tell:
    """The answer to `setup`."""
    return _Octets(build_setup(ACK_DATA, Setup(calling, called, pdu)))


def data(payload: bytes = b"", code: int = 0) -> Tell:
    """The answer to `userdata` and `szl`: the payload after the four octets of its data head, and an error code."""
    return _Userdata(payload, code)


def answer(octets: bytes) -> Tell:
    """Answer with a PDU; only its reference is replaced."""
    return _Octets(octets)
