"""PDUs as blocks of octets: parameters and data behind the name of their kind, or the whole PDU where its header is odd.

An error code has a line of its own, so that it reads the same everywhere; of userdata it is taken out of the parameters, where
zeros stand instead.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.s7.build import build_pdu
from dissect.s7.layouts import USERDATA_EXTENDED
from dissect.s7.message import parse_pdu
from dissect.s7.tables import ACK, ACK_DATA, PARAMETER_EXTENDED, ROSCTR, USERDATA

_BY_NAME: Final = {code.name: code.number for code in ROSCTR}
#: Where an extended userdata head has its error code.
_ERROR: Final = slice(10, 12)


class Blocks(NamedTuple):
    """A PDU of ``kind`` (the name of its ROSCTR); ``error`` is the code by which it says no, 0 for none."""

    kind: str
    error: int
    parameters: bytes
    data: bytes


def cut_blocks(octets: bytes) -> Blocks | None:
    """Return the blocks of a masked PDU, None when they do not say all of it."""
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
    """Return the PDU. Raises ValueError when such a PDU has no place for what is to stand in it."""
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
