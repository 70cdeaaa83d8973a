"""TPKT, COTP and S7 octets for made traffic. Written independently of the package, so that it can check the package.

Layouts: RFC 1006 (TPKT), ISO 8073 class 0 (COTP); S7comm as in public dissectors and captures.
"""

from __future__ import annotations

import struct
from random import Random
from typing import Final

JOB: Final = 1
ACK: Final = 2
ACK_DATA: Final = 3
USERDATA: Final = 7

READ: Final = 0x04
WRITE: Final = 0x05
SETUP: Final = 0xF0

#: Empty DT without end of TSDU: Siemens stacks send it after each received PDU.
EMPTY_DT: Final = b"\x03\x00\x00\x07\x02\xf0\x00"

_REQUEST_HEAD: Final = struct.Struct(">BBHHHH")
_ANSWER_HEAD: Final = struct.Struct(">BBHHHHBB")

#: Request size code -> (octets of an element, size code of the data, length counts bits).
ELEMENTS: Final = {
    0x01: (1, 0x03, True),
    0x02: (1, 0x04, True),
    0x03: (1, 0x09, False),
    0x04: (2, 0x04, True),
    0x05: (2, 0x05, True),
    0x06: (4, 0x04, True),
    0x07: (4, 0x05, True),
    0x08: (4, 0x07, False),
    0x13: (2, 0x09, False),
    0x1C: (2, 0x09, False),
    0x1D: (2, 0x09, False),
}
#: Date and time sizes: CPUs refuse them with 0x06.
REFUSED_SIZES: Final = (0x09, 0x0A, 0x0B, 0x0C, 0x0F)

_TAPE: Final = 4096


def tapes(rng: Random) -> dict[int, bytes]:
    """Return for each element size code 4096 plausible values in a row, to cut the values of items from."""
    made: dict[int, bytes] = {}
    for code, (octets, _, _) in ELEMENTS.items():
        if code == 0x01:
            made[code] = bytes(rng.getrandbits(1) for _ in range(_TAPE))
        elif code == 0x03:
            made[code] = bytes(rng.choice(b"ABCDEFGHIJKLMNOPQRSTUVWXYZ 0123456789-_") for _ in range(_TAPE))
        elif code == 0x08:
            made[code] = b"".join(struct.pack(">f", rng.uniform(-50, 1500)) for _ in range(_TAPE))
        elif octets == 4:
            made[code] = b"".join(struct.pack(">i", int(rng.gauss(0, 60_000))) for _ in range(_TAPE))
        elif code == 0x1C:
            made[code] = b"".join(int(f"{rng.randrange(1000):03d}", 16).to_bytes(2, "big") for _ in range(_TAPE))
        elif code == 0x1D:
            # S5TIME: time base in bits 13-12, three BCD digits below.
            made[code] = b"".join(
                (rng.randrange(4) << 12 | int(f"{rng.randrange(1000):03d}", 16)).to_bytes(2, "big")
                for _ in range(_TAPE)
            )
        elif octets == 2:
            made[code] = b"".join(
                struct.pack(">h", max(-32768, min(32767, int(rng.gauss(0, 4000))))) for _ in range(_TAPE)
            )
        else:
            made[code] = rng.randbytes(_TAPE)
    return made


def tpkt(pdu: bytes, number: int = 0x80) -> bytes:
    """Return ``pdu`` in one DT of class 0 in one TPKT; ``number`` is the octet of EOT and TPDU-NR."""
    return b"\x03\x00" + (len(pdu) + 7).to_bytes(2, "big") + b"\x02\xf0" + bytes((number,)) + pdu


def connect_tpdu(code: int, dest_ref: int, source_ref: int, size_code: int, calling: bytes, called: bytes) -> bytes:
    """Return a CR (0xE0) or CC (0xD0) in its TPKT."""
    variable = b"\xc0\x01" + bytes((size_code,))
    variable += b"\xc1" + bytes((len(calling),)) + calling + b"\xc2" + bytes((len(called),)) + called
    body = bytes((6 + len(variable), code)) + struct.pack(">HHB", dest_ref, source_ref, 0) + variable
    return b"\x03\x00" + (len(body) + 4).to_bytes(2, "big") + body


def disconnect_tpdu(dest_ref: int, reason: int) -> bytes:
    """Return a DR in its TPKT."""
    return b"\x03\x00\x00\x0b\x06\x80" + struct.pack(">HHB", dest_ref, 0, reason)


def request(rosctr: int, pdu_ref: int, param: bytes, data: bytes = b"") -> bytes:
    """Return a Job or Userdata PDU."""
    return _REQUEST_HEAD.pack(0x32, rosctr, 0, pdu_ref, len(param), len(data)) + param + data


def answer(rosctr: int, pdu_ref: int, param: bytes = b"", data: bytes = b"", error: int = 0) -> bytes:
    """Return an Ack or Ack_Data PDU; ``error`` is class << 8 | code."""
    return _ANSWER_HEAD.pack(0x32, rosctr, 0, pdu_ref, len(param), len(data), error >> 8, error & 0xFF) + param + data


def setup_param(calling: int, called: int, pdu_length: int) -> bytes:
    """Return the parameters of a Setup communication request or answer."""
    return struct.pack(">BBHHH", SETUP, 0, calling, called, pdu_length)


class Item:
    """One S7ANY item: its form in a request, and how its values are made."""

    __slots__ = ("code", "octets", "refusal", "size", "spec", "value_head")

    def __init__(self, code: int, count: int, db: int, area: int, address: int, refusal: int = 0) -> None:
        self.spec = b"\x12\x0a\x10" + struct.pack(">BHHI", code, count, db, area << 24 | address)
        self.code = code
        #: Return code the PLC always gives, or 0 for success.
        self.refusal = refusal
        octets, data_code, in_bits = ELEMENTS.get(code, (1, 0x04, True))
        self.octets = octets
        self.size = octets * count
        length = 1 if code == 0x01 else self.size * 8 if in_bits else self.size
        self.value_head = bytes((data_code,)) + length.to_bytes(2, "big")

    @property
    def answer_octets(self) -> int:
        """Octets the item takes in an answer, fill octet included."""
        return 4 if self.refusal else 4 + self.size + (self.size & 1)


class Variables:
    """A Read Var or Write Var request that a program repeats: a fixed parameter block, and values that change."""

    __slots__ = ("_tapes", "function", "items", "param", "refused")

    def __init__(self, function: int, items: list[Item], value_tapes: dict[int, bytes]) -> None:
        self.function = function
        self.items = items
        self.param = bytes((function, len(items))) + b"".join(item.spec for item in items)
        self.refused = any(item.refusal for item in items)
        self._tapes = value_tapes

    def values(self, seed: int, success: int, also_refused: int = -1) -> bytes:
        """Return the data items: of a read answer (``success`` 0xFF) or of a write request (0x00).

        ``seed`` picks the values; the item number ``also_refused`` is answered with 0x0A this once.
        """
        parts: list[bytes] = []
        last = len(self.items) - 1
        for number, item in enumerate(self.items):
            refusal = item.refusal or (0x0A if number == also_refused else 0)
            if success and refusal:
                parts.append(bytes((refusal, 0, 0, 0)))
                continue
            tape = self._tapes[item.code]
            start = (seed * (2 * number + 1)) % (len(tape) // item.octets - item.size // item.octets) * item.octets
            parts.append(bytes((success,)) + item.value_head + tape[start : start + item.size])
            if item.size & 1 and number != last:
                parts.append(b"\x00")
        return b"".join(parts)

    def codes(self, also_refused: int = -1) -> bytes:
        """Return the return codes of a write answer."""
        return bytes(
            item.refusal or (0x0A if number == also_refused else 0xFF) for number, item in enumerate(self.items)
        )


def userdata_request(group: int, subfunction: int, payload: bytes, sequence: int = -1) -> tuple[bytes, bytes]:
    """Return parameters and data of a userdata request; ``sequence`` >= 0 makes it the follow-up of a long answer."""
    if sequence < 0:
        param = bytes((0, 1, 0x12, 4, 0x11, 0x40 | group, subfunction, 0))
    else:
        param = bytes((0, 1, 0x12, 8, 0x12, 0x40 | group, subfunction, sequence, 0, 0, 0, 0))
    data = b"\xff\x09" + len(payload).to_bytes(2, "big") + payload if payload else b"\x0a\x00\x00\x00"
    return param, data


def userdata_answer(
    group: int, subfunction: int, sequence: int, payload: bytes, error: int = 0, unit: int = 0, more: bool = False
) -> tuple[bytes, bytes]:
    """Return parameters and data of a userdata answer; ``unit`` is the data unit reference of an answer in parts."""
    param = bytes((0, 1, 0x12, 8, 0x12, 0x80 | group, subfunction, sequence, unit, int(more))) + error.to_bytes(
        2, "big"
    )
    data = b"\xff\x09" + len(payload).to_bytes(2, "big") + payload if payload else b"\x0a\x00\x00\x00"
    return param, data


def diagnostic_push(rng: Random) -> bytes:
    """Return a diagnostic message as the PLC sends it unasked (20 octets of record)."""
    record = bytes((0x43, 0x02, 0xFF, 0x68)) + rng.randbytes(8) + bytes.fromhex("2311142215306213")
    param = bytes((0, 1, 0x12, 4, 0x11, 0x04, 0x03, 0))
    return request(USERDATA, 0, param, b"\xff\x09" + len(record).to_bytes(2, "big") + record)
