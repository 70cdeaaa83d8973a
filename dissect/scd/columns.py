"""Many equal payloads at once: one numpy array for each variable (extra "scd").

For captures with millions of PDOs. The payloads stay where they are, in one buffer; what is given is where each begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dissect.scd.errors import E_SHORT, Error
from dissect.scd.layout import Key, Slot
from dissect.scd.packing import Octets, Packing
from dissect.scd.types import Kind

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

#: What a row is longer than its payload, so that eight octets can be read at each of its octets, and a ninth.
_SPARE = 9


def decode_columns(packing: Packing, octets: Octets, offsets: ArrayLike | Sequence[int]) -> dict[Key, NDArray[Any]]:
    """Return one array for each variable, an element for each of ``offsets`` into ``octets``.

    ====================  ==============================================================
    Boolean               bool
    Integer, Unsigned N   the smallest of int8..int64, uint8..uint64 that holds N bits
    Real                  float32, float64 (an infinity is received as such: ``numpy.isinf``)
    String                ``S`` of its octets, UTF-8, without the U+0000 that fill it up
    Time, interval        records of int32 ``seconds`` and ``nanoseconds``
    Block, MAC, IP        rows of uint8
    ====================  ==============================================================

    Raises `Error` E_SHORT when a payload begins outside of the buffer or does not end in it, ImportError without numpy.
    """
    np = _numpy()
    data = np.frombuffer(octets, np.uint8)
    starts = np.asarray(offsets, np.int64)
    if not len(starts):
        rows = np.zeros((0, packing.size + _SPARE), np.uint8)
    else:
        low, high = int(starts.min()), int(starts.max())
        if low < 0 or high + packing.size > len(data):
            at = low if low < 0 else high
            raise Error(E_SHORT, packing.where, f"{packing.size} bytes at {at} of {len(data)}")
        rows = np.zeros((len(starts), packing.size + _SPARE), np.uint8)
        if packing.size:
            rows[:, : packing.size] = np.lib.stride_tricks.sliding_window_view(data, packing.size)[starts]
    return {slot.key: _column(rows, slot) for slot in packing.slots}


def _numpy() -> Any:
    try:
        import numpy as np
    except ImportError:
        raise ImportError("decoding into columns needs numpy: pip install 's7dissect[scd]'") from None
    return np


def _column(rows: NDArray[np.uint8], slot: Slot) -> NDArray[Any]:
    """Return the array of one variable."""
    np = _numpy()
    kind = slot.type.kind
    if kind is Kind.STRING:
        texts: NDArray[Any] = _octets(rows, slot).view(f"S{slot.bits // 8}").reshape(-1)
        return texts
    if kind in {Kind.NETTIME, Kind.INTERVAL}:
        times: NDArray[Any] = _octets(rows, slot).view([("seconds", "<i4"), ("nanoseconds", "<i4")]).reshape(-1)
        return times
    if kind in {Kind.BLOCK, Kind.MAC, Kind.IP}:
        return _octets(rows, slot)
    if slot.offset % 8 == 0 and slot.bits in {8, 16, 32, 64}:
        code = {Kind.INT: "i", Kind.UINT: "u", Kind.REAL: "f"}[kind]
        return _strided(rows, f"<{code}{slot.bits // 8}", slot.offset // 8).copy()
    words = _words(rows, slot)
    if kind is Kind.BOOL:
        return words.astype(np.bool_)
    if kind is Kind.REAL:
        reals: NDArray[Any] = words.astype(f"<u{slot.bits // 8}").view(f"<f{slot.bits // 8}")
        return reals
    width = next(width for width in (1, 2, 4, 8) if slot.bits <= 8 * width)
    if kind is Kind.INT:
        spare = np.int64(64 - slot.bits)
        signed: NDArray[Any] = ((words << spare.astype(np.uint64)).view("<i8") >> spare).astype(f"<i{width}")
        return signed
    return words.astype(f"<u{width}")


def _strided(rows: NDArray[np.uint8], code: str, at: int) -> NDArray[Any]:
    """Return the numbers of dtype ``code`` that begin at octet ``at`` of each row, where they are."""
    numbers: NDArray[Any] = _numpy().ndarray((len(rows),), code, buffer=rows, offset=at, strides=(rows.shape[1],))
    return numbers


def _words(rows: NDArray[np.uint8], slot: Slot) -> NDArray[Any]:
    """Return the bits of the variable as 64-bit numbers, joined from a ninth octet where it reaches into one."""
    np = _numpy()
    at, shift = divmod(slot.offset, 8)
    words: NDArray[Any] = _strided(rows, "<u8", at) >> np.uint64(shift)
    if shift + slot.bits > 64:
        words |= rows[:, at + 8].astype(np.uint64) << np.uint64(64 - shift)
    words &= np.uint64((1 << slot.bits) - 1)
    return words


def _octets(rows: NDArray[np.uint8], slot: Slot) -> NDArray[Any]:
    """Return the octets of the variable, a row each."""
    np = _numpy()
    at, shift = divmod(slot.offset, 8)
    size = slot.bits // 8
    own: NDArray[Any] = rows[:, at : at + size]
    if shift:
        own = (own >> np.uint8(shift)) | (rows[:, at + 1 : at + size + 1] << np.uint8(8 - shift))
    whole: NDArray[Any] = np.ascontiguousarray(own)
    return whole
