"""PDUs as blocks of octets: parameters and data after the name of their ROSCTR, or the whole PDU if its header is irregular.

An error code has its own line and looks the same everywhere; in userdata it is cut out of the parameters and replaced by zeros.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.protocols.s7.build import build_pdu
from dissect.protocols.s7.layouts import USERDATA_EXTENDED
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.tables import ACK, ACK_DATA, PARAMETER_EXTENDED, ROSCTR, USERDATA

_BY_NAME: Final = {code.name: code.number for code in ROSCTR}
#: Position of the error code in an extended userdata head.
_ERROR: Final = slice(10, 12)


class Blocks(NamedTuple):
    """The blocks of a PDU. ``kind`` is the name of its ROSCTR, ``error`` its error code, 0 for none."""

    kind: str
    error: int
    parameters: bytes
    data: bytes


def cut_blocks(octets: bytes) -> Blocks | None:
    """Return the blocks of a masked PDU, None if they cannot represent it completely."""
    pdu = parse_pdu(octets)
    if pdu.rosctr not in ROSCTR:
        return None
    error = max(pdu.error_class, 0) << 8 | max(pdu.error_code, 0)
    parameters = pdu.parameters.octets
    if pdu.rosctr == USERDATA and _has_error(parameters):
        error = int.from_bytes(parameters[_ERROR], "big")
        parameters = _with_error(parameters, 0)
    blocks = Blocks(ROSCTR.name(pdu.rosctr), error, parameters, pdu.data)
    return blocks if join_blocks(blocks) == octets else None


def join_blocks(blocks: Blocks) -> bytes:
    """Return the PDU. Raises ValueError if such a PDU has no room for an error code that is given."""
    rosctr = _BY_NAME.get(blocks.kind)
    if rosctr is None:
        raise ValueError(f"{blocks.kind} is not a kind of PDU; known kinds: {', '.join(_BY_NAME)} and octets")
    parameters = blocks.parameters
    if len(parameters) > 0xFFFF or len(blocks.data) > 0xFFFF:
        raise ValueError("a block holds at most 65535 bytes")
    if blocks.error and rosctr == USERDATA:
        if not _has_error(parameters):
            raise ValueError("only userdata with twelve bytes of parameters has an error code")
        parameters = _with_error(parameters, blocks.error)
    elif blocks.error and rosctr not in {ACK, ACK_DATA}:
        raise ValueError(f"a {blocks.kind} has no error code")
    return build_pdu(rosctr, parameters, blocks.data, blocks.error)


def _has_error(parameters: bytes) -> bool:
    return len(parameters) >= USERDATA_EXTENDED.size and parameters[4] == PARAMETER_EXTENDED


def _with_error(parameters: bytes, error: int) -> bytes:
    return parameters[: _ERROR.start] + error.to_bytes(2, "big") + parameters[_ERROR.stop :]
