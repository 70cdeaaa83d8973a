"""Reads from Interface Statistics Blocks (draft-ietf-opsawg-pcapng 4.6) how many packets a capture lost."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal, NamedTuple

from dissect.packets.source.pcapng import STATISTICS
from dissect.wire.text import count

#: Where the options of the block begin; then the options about losses: in the interface, and in the operating system.
_OPTIONS_AT: Final = 20
_IFDROP: Final = 5
_OSDROP: Final = 7


class Lost(NamedTuple):
    """How many packets one interface lost; None where the block does not say."""

    interface: int | None
    kernel: int | None


def read_lost(block: bytes) -> Lost:
    """Return the losses that an Interface Statistics Block states; an option that does not fit into the block ends reading."""
    order: Literal["little", "big"] = "little" if block[:4] == STATISTICS.to_bytes(4, "little") else "big"
    found: dict[int, int] = {}
    at = _OPTIONS_AT
    end = len(block) - 4
    while at + 4 <= end:
        code = int.from_bytes(block[at : at + 2], order)
        size = int.from_bytes(block[at + 2 : at + 4], order)
        if not code or at + 4 + size > end:
            break
        if code in {_IFDROP, _OSDROP} and size == 8:
            found[code] = int.from_bytes(block[at + 4 : at + 12], order)
        at += 4 + ((size + 3) & ~3)
    return Lost(found.get(_IFDROP), found.get(_OSDROP))


def loss_in(blocks: Iterable[bytes]) -> str:
    """Return in words how many packets were lost according to Interface Statistics Blocks; empty for none."""
    lost = [read_lost(block) for block in blocks]
    sums = {
        "interface": sum([one.interface or 0 for one in lost]),
        "operating system": sum([one.kernel or 0 for one in lost]),
    }
    return ", ".join([f"{count(number, 'packet')} dropped by the {who}" for who, number in sums.items() if number])
