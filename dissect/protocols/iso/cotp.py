"""COTP (X.224, reference section 2): `parse_tpdu` reads the TPDU in a TPKT, `Assembler` joins DTs to TSDUs."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.iso import layouts
from dissect.protocols.iso.tables import AK, CC, CR, DC, DR, DT, EA, ED, ER, PARAMETERS, RJ, TPDU_TYPES
from dissect.protocols.iso.tsap import Tsap
from dissect.wire.layout import FieldValue, Layout
from dissect.wire.malformed import Malformed

TPDU_SIZE: Final = 0xC0
CALLING_TSAP: Final = 0xC1
CALLED_TSAP: Final = 0xC2
PREFERRED_SIZE: Final = 0xF0

#: Maximum number of octets of user data in an ED, in all classes (RFC 1006 and X.224, reference 2.2).
MAX_EXPEDITED: Final = 16

#: Maximum number of octets of a TSDU that are kept until its end arrives.
MAX_TSDU: Final = 65536


class Parameter:
    """A parameter of the variable part; ``offset`` is the position of its code octet in the TPDU."""

    __slots__ = ("code", "offset", "value")

    def __init__(self, code: int, value: bytes, offset: int) -> None:
        self.code = code
        self.value = value
        self.offset = offset

    @property
    def name(self) -> str:
        """The parameter's name, or its number if it is unknown."""
        return PARAMETERS.name(self.code)


class Tpdu:
    """A parsed TPDU.

    ``fields`` are the fixed part in wire order (offsets within the TPDU), ``parameters`` the variable part, ``data`` the user
    data. ``head`` has the octets of the fixed and variable part, ``variable`` only those of the variable part, which are kept
    because RDP uses them for something else than parameters. ``calling`` and ``called`` are the octets of the TSAPs, None if
    there is none. ``tpdu_size`` is the offered or chosen size in octets, 0 if none is stated (RFC 1006 then means 65531).
    """

    __slots__ = (
        "_fields",
        "_parameters",
        "called",
        "calling",
        "data",
        "head",
        "layout",
        "malformed",
        "tpdu_size",
        "type",
        "variable",
    )

    def __init__(self, type_: int, layout: Layout) -> None:
        self.type = type_
        self.layout = layout
        self.head = b""
        self._fields: list[FieldValue] | None = None  # these two are made on demand
        self._parameters: list[Parameter] | None = None
        self.variable = b""
        self.calling: bytes | None = None
        self.called: bytes | None = None
        self.tpdu_size = 0
        self.data = b""
        self.malformed: list[Malformed] = []

    @property
    def name(self) -> str:
        """``CR``, ``DT`` … or the number of an unknown type; ``TPDU`` if it is too short for a type."""
        return TPDU_TYPES.name(self.type) if self.type >= 0 else "TPDU"

    @property
    def fields(self) -> list[FieldValue]:
        """The complete fixed fields of the TPDU, in wire order."""
        if self._fields is None:
            self._fields = self.layout.read(self.head)
        return self._fields

    def field(self, name: str) -> int:
        """Return the value of a fixed field, -1 if the TPDU has no such field or is too short for it."""
        found = self.layout.numbers.get(name)
        if found is None:
            return -1
        start, field = found
        return field.read(self.head, start) if start + field.size <= len(self.head) else -1

    def take_variable(self, variable: bytes) -> i64:
        """Read the TSAPs and the TPDU size from the variable part; return where the last complete parameter ends.

        As in `parameter`, the last one counts if a code occurs twice.
        """
        self.variable = variable
        power: i64 = 0
        preferred: i64 = -1
        at: i64 = 0
        behind: i64 = _behind(variable, at)
        while behind > 0:
            code: i64 = variable[at]
            if code == CALLING_TSAP:
                self.calling = variable[at + 2 : behind]
            elif code == CALLED_TSAP:
                self.called = variable[at + 2 : behind]
            elif code == TPDU_SIZE:
                power = variable[at + 2] if behind - at == 3 else 0
            elif code == PREFERRED_SIZE:
                preferred = int.from_bytes(variable[at + 2 : behind], "big") if 3 <= behind - at <= 6 else -1
            at = behind
            behind = _behind(variable, at)
        if preferred >= 0:
            self.tpdu_size = int(preferred * 128)
        elif 7 <= power <= 16:
            self.tpdu_size = 65531 if power == 16 else int(1 << power)
        return at

    @property
    def parameters(self) -> list[Parameter]:
        """The complete parameters of the variable part, in wire order."""
        found = self._parameters
        if found is None:
            found = []
            variable = self.variable
            at: i64 = 0
            behind: i64 = _behind(variable, at)
            while behind > 0:
                found.append(Parameter(variable[at], variable[at + 2 : behind], self.layout.size + at))
                at = behind
                behind = _behind(variable, at)
            self._parameters = found
        return found

    def parameter(self, code: int) -> bytes | None:
        """Return the value of a parameter, None if it is missing; of several the last one counts (X.224 13.2.3)."""
        found: bytes | None = None
        for parameter in self.parameters:
            if parameter.code == code:
                found = parameter.value
        return found

    def tsap(self, code: int) -> Tsap | None:
        """Return the calling (0xC1) or called (0xC2) TSAP, None if it is missing."""
        value: bytes | None = None
        if code == CALLING_TSAP:
            value = self.calling
        elif code == CALLED_TSAP:
            value = self.called
        return Tsap(value) if value is not None else None


def _behind(variable: bytes, at: i64) -> i64:
    """Return the end of the parameter at ``at`` of a variable part, 0 if there is no complete one."""
    size: i64 = len(variable)
    if at + 2 > size:
        return 0
    behind: i64 = at + 2 + variable[at + 1]
    return behind if behind <= size else 0


def _by_size(type_: int, li: int) -> Layout:
    """Choose, by its length indicator, the layout of a type that has several forms (reference 2.2).

    No parameter has only one octet. So a length one octet above that of the extended form means the normal form with
    parameters: LI 8 is a normal form with a checksum.
    """
    normal = li < 9 or li == 10
    if type_ == AK:
        return layouts.AK if normal else layouts.AK_EXTENDED
    if type_ == RJ:
        return layouts.RJ if normal else layouts.RJ_EXTENDED
    normal = li < 7 or li == 8
    if type_ == EA:
        return layouts.EA if normal else layouts.EA_EXTENDED
    if type_ == ED:
        return layouts.ED if li < 4 else (layouts.ED_NORMAL if normal else layouts.ED_EXTENDED)
    return layouts.DT if li < 4 else (layouts.DT_NORMAL if normal else layouts.DT_EXTENDED)


_ONE_FORM: Final[dict[int, Layout]] = {
    CR: layouts.CR,
    CC: layouts.CC,
    DR: layouts.DR,
    DC: layouts.DC,
    ER: layouts.ER,
}
_SEVERAL_FORMS: Final = frozenset((DT, ED, AK, EA, RJ))
_UNKNOWN: Final[Layout] = layouts.UNKNOWN


def parse_tpdu(octets: bytes) -> Tpdu:
    """Read one TPDU, which is the content of a TPKT after its header. Never raises; faults are in ``malformed``."""
    if len(octets) < 2:
        tpdu = Tpdu(-1, _UNKNOWN)
        tpdu.malformed.append(Malformed("cotp", "too_short", "type", 0, 2, len(octets), "tpkt"))
        return tpdu
    li = octets[0]
    type_ = octets[1] >> 4
    layout = _ONE_FORM.get(type_)
    if layout is None:
        layout = _by_size(type_, li) if type_ in _SEVERAL_FORMS else _UNKNOWN
    tpdu = Tpdu(type_, layout)
    end = li + 1
    if li == 0 or li == 255:
        tpdu.malformed.append(Malformed("cotp", "bad_value", "li", 0, 1, li, "li"))
        return tpdu
    if end > len(octets):
        tpdu.malformed.append(Malformed("cotp", "length_beyond", "li", 0, end, len(octets), "tpkt"))
        end = len(octets)
    tpdu.head = octets[:end]
    if layout is _UNKNOWN:
        tpdu.malformed.append(Malformed("cotp", "unknown_type", "type", 1, 0, type_, "li"))
    elif layout.size > end:
        tpdu.malformed.append(Malformed("cotp", "too_short", layout.name, 0, layout.size, end, "li"))
    else:
        _judge_rest(tpdu, tpdu.take_variable(octets[layout.size : end]))
    tpdu.data = octets[end:]
    return tpdu


def _judge_rest(tpdu: Tpdu, at: i64) -> None:
    """Report a parameter at ``at`` that is incomplete in the variable part; parameters after it cannot be found."""
    variable = tpdu.variable
    size: i64 = len(variable)
    if at == size:
        return
    here = tpdu.layout.size + at
    if at + 2 > size:
        tpdu.malformed.append(Malformed("cotp", "too_short", "parameter", here, 2, size - at, "li"))
    else:
        tpdu.malformed.append(
            Malformed("cotp", "length_beyond", "parameter", here, variable[at + 1], size - at - 2, "li")
        )


class Assembler:
    """Joins the DTs of one direction to TSDUs.

    ``parts`` is None between TSDUs. A TSDU that grows past `MAX_TSDU` is dropped up to its end and counted in ``overflows``. An
    empty DT without EOT, the frequent acknowledgement of Siemens stacks, does not begin a TSDU (reference 2.5).
    """

    __slots__ = ("_dropping", "clear", "dropped", "overflows", "parts")

    def __init__(self) -> None:
        self.parts: bytearray | None = None
        self.clear: bool = True  # the next DT begins a TSDU
        self.overflows: i64 = 0
        self.dropped: i64 = 0  # number of octets of TSDUs that were not passed on
        self._dropping: bool = False

    def push(self, data: bytes, eot: bool) -> bytes | None:
        """Take the user data of one DT; return the TSDU if the DT ends it, else None."""
        if self._dropping:
            self.dropped += len(data)
            self._dropping = not eot
            self.clear = eot
            return None
        parts = self.parts
        if parts is None:
            if eot:
                return data
            if data:
                self.parts = bytearray(data)
                self.clear = False
            return None
        if len(parts) + len(data) > MAX_TSDU:
            self.overflows += 1
            self.dropped += len(parts) + len(data)
            self.parts = None
            self._dropping = not eot
            self.clear = eot
            return None
        parts += data
        if not eot:
            return None
        self.parts = None
        self.clear = True
        return bytes(parts)

    def abandon(self) -> int:
        """Drop an unfinished TSDU (a gap took part of it, or the stream ended); return its size in octets."""
        size = len(self.parts) if self.parts is not None else 0
        self.dropped += size
        self.parts = None
        self._dropping = False
        self.clear = True
        return size
