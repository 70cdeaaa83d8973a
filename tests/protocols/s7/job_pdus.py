"""Jobs and their answers from their blocks, and the conditions for every parser of a block (reference section 3.1)."""

from __future__ import annotations

from tests.build import ACK_DATA, JOB, pdu
from tests.protocols.s7.userdata_pdus import body

Rows = list[tuple[str, int | str]]


def job(parameters: str, data: str = "", rosctr: int = JOB) -> bytes:
    """Return a PDU with these blocks (hexadecimal digits, blanks do not matter)."""
    return pdu(rosctr, 1, bytes.fromhex(parameters), bytes.fromhex(data))


def answer(parameters: str, data: str = "") -> bytes:
    """Return an Ack_Data with these blocks."""
    return job(parameters, data, ACK_DATA)


def stands_cuts(parameters: str, data: str = "", rosctr: int = JOB) -> None:
    """Check that a PDU is parsed correctly when it ends after each octet, and when each of its blocks does."""
    whole = job(parameters, data, rosctr)
    for size in range(len(whole)):
        body(whole[:size])
    first, second = bytes.fromhex(parameters), bytes.fromhex(data)
    for size in range(len(first)):
        body(job(first[:size].hex(), data, rosctr))
    for size in range(len(second)):
        body(job(parameters, second[:size].hex(), rosctr))


def said(octets: bytes) -> Rows:
    """Return the content of each field of a body: a name, and the meaning if there is one, else the number or the octets."""
    rows: Rows = []
    for part in body(octets).parts:
        for value in part.values:
            number: int | str = value.value if value.octets is None else value.octets.hex()
            rows.append((value.field.name, value.meaning or number))
    return rows
