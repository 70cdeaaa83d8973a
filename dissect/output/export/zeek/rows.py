"""The rows for one PDU by the rules of ICSNPP, read from the octets in the way ICSNPP does (exports reference 1.2 to 1.5)."""

from __future__ import annotations

from typing import Any, Final

from dissect.output.export.zeek.word_tables import (
    BLOCK_TYPES,
    COTP,
    ERROR_CLASSES,
    FILE_SYSTEMS,
    FUNCTIONS,
    GROUPS,
    METHODS,
    PLUS_FUNCTIONS,
    PLUS_OPCODES,
    RETURN_CODES,
    ROSCTRS,
    SERVICES,
    SUBFUNCTIONS,
    SZL_IDS,
)
from dissect.protocols.s7.tables import (
    ACK,
    ACK_DATA,
    DOWNLOAD_BLOCK,
    END_UPLOAD,
    GROUP_CPU,
    JOB,
    PI_SERVICE,
    READ_SZL,
    REQUEST_DOWNLOAD,
    START_UPLOAD,
    UPLOAD,
    USERDATA,
)
from dissect.protocols.s7plus.message import PlusPdu
from dissect.protocols.s7plus.tables import REQUEST, RESPONSE

_NONE: Final = 0xFF
_LONG_NONE: Final = 0xFFFFFFFF
#: Userdata groups whose subfunctions have no names.
_NAMELESS: Final = frozenset((0x6, 0xF))
_KINDS: Final = {4: "Request", 8: "Response", 0: "Push"}
#: The SZL id of names and serial numbers, and the size of its records.
IDENTIFICATION: Final = 0x001C
_RECORD: Final = 34
#: By index of the record, the number of its octets that are the name: of system, module, plant, and the serial number.
NAMES: Final = {1: 24, 2: 24, 3: 32, 5: 24}


def cotp_row(octets: bytes) -> tuple[str, str] | None:
    """Return code and name of the TPDU in a TPKT, None if there is no TPDU."""
    if len(octets) < 6:
        return None
    code = octets[5] >> 4
    return f"0x{code:02x}", COTP.get(code, f"Unknown COTP PDU-0x{code:02x}")


#: Octets of the shortest header of an S7 PDU.
_HEADER_SIZE: Final = 10


def swapped_reference(octets: bytes) -> int | None:
    """Return the PDU reference with its octets swapped, as ICSNPP logs it; None if the PDU ends inside its header."""
    return int.from_bytes(octets[4:6], "little") if len(octets) >= _HEADER_SIZE else None


class S7:
    """One S7 PDU, read at the offsets that ICSNPP uses."""

    def __init__(self, octets: bytes) -> None:
        self.octets = octets
        self.rosctr = octets[1] if len(octets) > 1 else -1
        head = 12 if self.rosctr in {ACK, ACK_DATA} else 10
        size = int.from_bytes(octets[6:8], "big") if len(octets) >= 8 else 0
        self.parameters = octets[head : head + size]
        self.data = octets[head + size :]
        self.userdata = self.rosctr == USERDATA and len(self.parameters) >= 7
        self.group = self.parameters[5] & 0x0F if self.userdata else -1
        self.kind = self.parameters[5] >> 4 if self.userdata else -1
        self.subfunction = self.parameters[6] if self.userdata else -1

    @property
    def is_szl(self) -> bool:
        """True for a request or response of Read SZL."""
        return self.group == GROUP_CPU and self.subfunction == READ_SZL

    def row(self) -> tuple[Any, ...]:
        """Return the columns of s7comm.log."""
        code, name = self._function()
        subcode, subname = self._subfunction()
        return (
            self.rosctr if self.rosctr >= 0 else None,
            ROSCTRS.get(self.rosctr, "unknown"),
            swapped_reference(self.octets),
            code,
            name,
            subcode,
            subname,
            *self._error(),
        )

    def _function(self) -> tuple[str | None, str | None]:
        if self.userdata:
            kind, group = _KINDS.get(self.kind, "Unknown"), GROUPS.get(self.group, "unknown")
            return f"0x{self.parameters[5]:02x}", f"{kind}: {group}"
        if not self.parameters:
            return None, None
        function = self.parameters[0]
        return f"0x{function:02x}", FUNCTIONS.get(function, "unknown")

    def _subfunction(self) -> tuple[str | None, str | None]:
        if self.userdata:
            if self.subfunction == _NONE:
                return None, None
            names = SUBFUNCTIONS.get(self.group)
            name = None if self.group in _NAMELESS or names is None else names.get(self.subfunction, "unknown")
            return f"0x{self.subfunction:02x}", name
        service = self.service()
        return (service, SERVICES.get(service, "unknown")) if service is not None else (None, None)

    def service(self) -> str | None:
        """Return the PI service of a PLC Control job, its octets as text; None for other PDUs."""
        octets = self.octets
        if self.rosctr != JOB or self.parameters[:1] != bytes((PI_SERVICE,)) or len(octets) < 21:
            return None
        at = 20 + int.from_bytes(octets[18:20], "big")
        return text(octets[at + 1 : at + 1 + octets[at]]) if at < len(octets) else None

    def _error(self) -> tuple[str | None, str | None]:
        if self.rosctr in {ACK, ACK_DATA} and len(self.octets) >= 12:
            class_, code = self.octets[10], self.octets[11]
            if code == _NONE:
                return None, None
            return ERROR_CLASSES.get(class_, f"Unknown error class-0x{class_:02x}"), f"0x{code:02x}"
        if self.userdata and self.kind == 8 and len(self.parameters) >= 12:
            code = int.from_bytes(self.parameters[10:12], "big")
            if code in {0x00FF, 0xFFFF}:
                return None, None
            return ("No error", "0x00") if not code else ("Parameter Error", f"0x{code:02x}")
        return None, None

    # ---- SZL --------------------------------------------------------------------------------------------------------

    @property
    def unit(self) -> tuple[int, int]:
        """The data unit reference and "last data unit" of a response; zeros if it has none."""
        return (self.parameters[8], self.parameters[9]) if len(self.parameters) >= 10 else (0, 0)

    def szl_row(self) -> tuple[Any, ...]:
        """Return the columns of s7comm_read_szl.log; id and index are unset if the data has none."""
        data = self.data
        id_ = int.from_bytes(data[4:6], "big") if len(data) >= 8 else None
        code = data[0] if data else None
        return (
            swapped_reference(self.octets),
            METHODS.get(self.parameters[4], "Unknown"),
            f"0x{id_:04x}" if id_ is not None else None,
            SZL_IDS.get(id_ & 0xFF, "Unknown") if id_ is not None else None,
            f"0x{int.from_bytes(data[6:8], 'big'):04x}" if id_ is not None else None,
            f"0x{code:02x}" if code is not None else None,
            RETURN_CODES.get(code, "Unknown") if code is not None else None,
        )

    def szl_bounded(self, from_server: bool) -> bool:
        """Return whether ICSNPP can parse the data of a Read SZL within its limits; it drops all rows of other PDUs."""
        data = self.data
        if len(data) < 8 or len(data) < 4 + int.from_bytes(data[2:4], "big"):
            return False
        if not from_server or int.from_bytes(data[4:6], "big") != IDENTIFICATION:
            return True
        return len(data) >= 12 and len(data) >= 12 + _RECORD * int.from_bytes(data[10:12], "big")

    # ---- upload and download ----------------------------------------------------------------------------------------

    @property
    def is_transfer(self) -> bool:
        """True for the functions of upload and download, in requests and responses."""
        function = self.parameters[:1]
        return self.rosctr in {JOB, ACK_DATA} and bool(function) and REQUEST_DOWNLOAD <= function[0] <= END_UPLOAD

    def transfer_row(self) -> tuple[Any, ...]:
        """Return the columns of s7comm_upload_download.log."""
        function = self.parameters[0]
        asked = self.rosctr == JOB
        values = self._asked(function) if asked else self._answered(function)
        return (
            ROSCTRS[self.rosctr],
            swapped_reference(self.octets),
            FUNCTIONS.get(function, "unknown"),
            *values,
        )

    def _asked(self, function: int) -> tuple[Any, ...]:
        octets = self.octets
        status = f"0x{octets[11]:02x}" if len(octets) > 11 else None
        session = int.from_bytes(octets[14:18], "big") if len(octets) >= 18 else None
        if function in {UPLOAD, END_UPLOAD} or len(octets) < 19:
            return status, session, None, None, None, None, None
        name = text(octets[19 : 19 + octets[18]])
        return (
            status,
            session,
            None,
            name,
            BLOCK_TYPES.get(name[1:3], "Unknown"),
            name[3:8],
            FILE_SYSTEMS.get(name[8:9], "Unknown"),
        )

    def _answered(self, function: int) -> tuple[Any, ...]:
        octets = self.octets
        status = session = length = None
        if function in {START_UPLOAD, UPLOAD} and len(octets) > 13:
            status = f"0x{octets[13]:02x}"
        if function == START_UPLOAD and len(octets) >= 21:
            session = int.from_bytes(octets[16:20], "big")
            digits = octets[21 : 21 + octets[20]]
            length = int(digits) if digits.isdigit() else None
        elif function in {UPLOAD, DOWNLOAD_BLOCK} and len(octets) >= 16:
            length = int.from_bytes(octets[14:16], "big")
        if length == 0xFFFF:
            length = None
        return status, session if session != _LONG_NONE else None, length, None, None, None, None


def identification(content: bytes) -> dict[int, str]:
    """Return the names in SZL 0x001c by the index of their record; ``content`` begins with the SZL id."""
    found: dict[int, str] = {}
    if len(content) < 8 or int.from_bytes(content[:2], "big") != IDENTIFICATION:
        return found
    size = int.from_bytes(content[4:6], "big")
    count = int.from_bytes(content[6:8], "big")
    for number in range(count if size == _RECORD else 0):
        record = content[8 + number * _RECORD : 8 + (number + 1) * _RECORD]
        if len(record) < _RECORD:
            break
        index = int.from_bytes(record[:2], "big")
        if index in NAMES:
            found[index] = text(record[2 : 2 + NAMES[index]].rstrip(b"\0"))
    return found


def plus_row(pdu: PlusPdu) -> tuple[Any, ...] | None:
    """Return the columns of s7comm_plus.log, None for a PDU without an operation."""
    opcode = pdu.opcode
    if opcode < 0:
        return None
    function = pdu.function if opcode in {REQUEST, RESPONSE} and pdu.function >= 0 else None
    return (
        pdu.version,
        f"0x{opcode:02x}",
        PLUS_OPCODES.get(opcode, f"Unknown s7comm-plus opcode-0x{opcode:02x}"),
        f"0x{function:04x}" if function is not None else None,
        PLUS_FUNCTIONS.get(function, f"Unknown s7comm-plus function-0x{function:04x}")
        if function is not None
        else None,
    )


def text(octets: bytes) -> str:
    """Return octets as text; octets that are not UTF-8 become surrogate escapes, so that they are not lost."""
    return octets.decode("utf-8", "surrogateescape")
