"""Two Snap7 partners over one connection: ``python talk_partner.py PORT``. BSEND from either end (python-snap7 2, C++)."""

from __future__ import annotations

import ctypes
import logging
import sys
import time

from snap7.partner import Partner
from snap7.type import Parameter

LINKED = 3
"""Status of a partner that has its connection."""


def wait_linked(partner: Partner) -> None:
    """Wait until a partner has its connection."""
    for _ in range(100):
        if partner.get_status().value == LINKED:
            return
        time.sleep(0.05)
    raise AssertionError("the partners did not find each other")


def send(partner: Partner, r_id: int, octets: bytes) -> None:
    """BSEND; the Python wrapper can set neither R_ID nor the data."""
    room = (ctypes.c_uint8 * len(octets))(*octets)
    result = partner._library.Par_BSend(partner._pointer, r_id, ctypes.byref(room), len(octets))  # noqa: SLF001
    if result:
        raise RuntimeError(f"BSEND: 0x{result:08x}")


def main() -> None:
    """Three BSENDs: short, back, long."""
    port = int(sys.argv[1])  # 102: the passive partner only listens there
    passive, active = Partner(active=False), Partner(active=True)
    active.set_param(Parameter.RemotePort, port)
    passive.start_to("127.0.0.1", "127.0.0.1", 0x2002, 0x1002)
    active.start_to("127.0.0.1", "127.0.0.1", 0x1002, 0x2002)
    wait_linked(passive)
    wait_linked(active)
    send(active, 1, b"level 17")
    send(passive, 2, bytes(range(200)))
    send(active, 1, bytes(n % 256 for n in range(1500)))  # longer than a PDU: several parts
    active.stop()
    passive.stop()


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    main()
