"""Compressed blobs, in which engineering tools store a block's interface, comments and code (docs/s7plus.md).

A blob is a version of four octets, which CPUs with firmware 2 omit, and a zlib stream. The stream's header often names a preset
dictionary by its Adler-32. Without the dictionary the content cannot be read, but lengths do not depend on the content of the
dictionary. So an empty dictionary is sufficient to check whether a stream ends where it should, and how large its content is.
"""

from __future__ import annotations

import zlib
from collections import OrderedDict
from collections.abc import Mapping
from typing import Final

from librt.strings import read_i64_be
from mypy_extensions import i64

#: Attributes that contain compressed blobs.
COMPRESSED: Final = frozenset((2449, 2533, 2544, 2545, 2546, 2583, 2584, 2585, 2589, 4275, 4683, 7564))
#: Elements of a sparse array from this key on are not compressed.
PLAIN_KEYS: Final = 0x80000000
#: Limits: the factor by which a blob may grow, and the total size of all inflated blobs of a PDU.
MAX_RATIO: Final = 1000
MAX_INFLATED: Final = 32 * 1024 * 1024
#: Total size of sound blobs that are remembered, and the memory that each one needs besides its octets.
MAX_KEPT: Final = 512 * 1024
_COST: Final = 128
#: A blob of this size may grow beyond `MAX_INFLATED`: deflate makes at most 1032 octets from one.
_LARGE: Final = MAX_INFLATED // 1032
#: By octet: 0 if its even bits are all equal, or its odd bits are; else 1.
_OTHERWISE: Final = bytes([not {octet & 0x55, octet & 0xAA} & {0, 0x55, 0xAA} for octet in range(256)])
#: Masks for seven octets: every other bit, all bits but the highest of each octet, the highest bit of each octet.
_EVERY_OTHER: Final = 0x55555555555555
_LOW: Final = 0x7F7F7F7F7F7F7F
_HIGH: Final = 0x80808080808080
#: Number of octets that are examined at once, and number of rounds before the counts are added up.
_SEVEN: Final = 7
_TURNS: Final = 64

# Why a blob could not be opened; the first two are also reasons of `Malformed`.
BAD: Final = "bad_compression"
TOO_LARGE: Final = "too_large"
NO_DICTIONARY: Final = "no dictionary"

_VERSION: Final = 4
_HEADER: Final = 2
_DICTIONARY: Final = 0x20  # bit of the second octet of the header: the next four octets name a dictionary
_CHECKSUM: Final = 4  # Adler-32 of the content, after the stream
_WINDOW: Final = 15  # the largest window of deflate, 32 KiB
_PIECE: Final = 1 << 18
_EMPTY: Final = bytes(1 << _WINDOW)  # an empty dictionary, as long as the longest reference back in a stream


class Opened:
    """The result of inflating a blob: ``octets`` are the kept part of its content, ``size`` is the size of the whole content.

    ``dictionary`` is the Adler-32 of the needed dictionary, -1 for none. ``fault`` is empty, or one of the reasons above.
    """

    __slots__ = ("dictionary", "fault", "octets", "size")

    def __init__(self, dictionary: int) -> None:
        self.dictionary = dictionary
        self.fault = ""
        self.octets = b""
        self.size = 0


class SoundBlobs:
    """The latest blobs that were found sound, with their inflated sizes; at most `MAX_KEPT` octets of blobs."""

    __slots__ = ("_kept", "_sizes")

    def __init__(self) -> None:
        self._sizes: OrderedDict[bytes, int] = OrderedDict()
        self._kept = 0

    def size(self, octets: bytes) -> int:
        """Return the inflated size of a blob, -1 if it is unknown."""
        return self._sizes.get(octets, -1)

    def add(self, octets: bytes, size: int) -> None:
        """Remember a blob; the oldest ones are dropped to stay within the bound."""
        if octets in self._sizes or len(octets) > MAX_KEPT // 4:
            return
        self._sizes[octets] = size
        self._kept += len(octets) + _COST
        while self._kept > MAX_KEPT:
            first = next(iter(self._sizes))
            del self._sizes[first]
            self._kept -= len(first) + _COST


_SOUND: Final = SoundBlobs()


def is_compressed(octets: bytes) -> bool:
    """Return whether a blob of one of the attributes above contains a zlib stream."""
    return _start(octets) >= 0


def _start(octets: bytes) -> int:
    """Return the offset of the zlib stream, -1 if there is none."""
    for at in (0, _VERSION):
        if len(octets) >= at + _HEADER:
            method, flags = octets[at], octets[at + 1]
            if method & 0x0F == zlib.DEFLATED and method >> 4 < 8 and (method << 8 | flags) % 31 == 0:
                return at
    return -1


def may_swell(octets: bytes) -> bool:
    """Return False if a blob cannot grow to `MAX_RATIO` times its size, nor to `MAX_INFLATED`, with any dictionary.

    Deflate comes near its limit of 1032 only with matches of 258 octets in two bits each. One of these two bits is always the
    same, so every other bit is constant in such a run. Anything else between two runs makes at most two octets differ from that
    pattern, and costs at least 129 octets of output. So if half of the octets differ, at least one part in 32 is lost.
    """
    size: i64 = len(octets)
    if size >= _LARGE:
        return True
    otherwise: i64 = 0
    last: i64 = size - _SEVEN - 1
    at: i64 = 0
    while at <= last:
        stop: i64 = min(at + _SEVEN * _TURNS, last + 1)
        counts: i64 = 0  # counts for the seven octets, side by side
        while at < stop:
            word: i64 = read_i64_be(octets, at) >> 8  # eight octets are read; the last one belongs to the next round
            even: i64 = word & _EVERY_OTHER
            odd: i64 = word >> 1 & _EVERY_OTHER
            # The highest bit of an octet becomes set if any of its other bits is set.
            differs: i64 = (even + _LOW) & ((even ^ _EVERY_OTHER) + _LOW) & (odd + _LOW) & ((odd ^ _EVERY_OTHER) + _LOW)
            counts += (differs & _HIGH) >> 7
            at += _SEVEN
        while counts:
            otherwise += counts & 0xFF
            counts >>= 8
        if 2 * otherwise >= size:
            return False
    while at < size:
        octet: i64 = octets[at]
        otherwise += _OTHERWISE[octet]
        at += 1
    return 2 * otherwise < size


def check_blob(octets: bytes, allowed: int = MAX_INFLATED) -> Opened:
    """Inflate a compressed blob to check it; its content is not kept. Never raises.

    ``allowed`` is the maximum size, besides the limit `MAX_RATIO`. A blob that was sound is not inflated again, because
    engineering tools read the same blobs again and again.
    """
    opened = Opened(-1)
    opened.size = _SOUND.size(octets)
    if 0 <= opened.size <= allowed:
        opened.dictionary = _named(octets, _start(octets))
        return opened
    opened = _inflate(octets, _EMPTY, allowed, kept=0)
    if not opened.fault:
        _SOUND.add(octets, opened.size)
    return opened


def open_blob(octets: bytes, dictionaries: Mapping[int, bytes], kept: int = MAX_INFLATED) -> Opened:
    """Inflate a compressed blob, keeping the first ``kept`` octets of its content. Never raises.

    ``dictionaries`` are preset dictionaries by their Adler-32.
    """
    start = _start(octets)
    named = _named(octets, start)
    dictionary = b"" if named < 0 else dictionaries.get(named, b"")
    if named >= 0 and not dictionary:
        opened = check_blob(octets)
        opened.fault = opened.fault or NO_DICTIONARY
        return opened
    return _inflate(octets, dictionary, MAX_INFLATED, kept)


def _named(octets: bytes, start: int) -> int:
    """Return the Adler-32 of the dictionary that a stream needs, -1 if it needs none."""
    at = start + _HEADER
    if start < 0 or not octets[start + 1] & _DICTIONARY or at + _CHECKSUM > len(octets):
        return -1
    return int.from_bytes(octets[at : at + _CHECKSUM], "big")


def _inflate(octets: bytes, dictionary: bytes, allowed: int, kept: int) -> Opened:
    start = _start(octets)
    opened = Opened(_named(octets, start))
    if start < 0:
        opened.fault = BAD
        return opened
    most = min(allowed, MAX_RATIO * len(octets))
    checks = opened.dictionary < 0 or dictionary is not _EMPTY
    if checks:
        stream = zlib.decompressobj(zdict=dictionary) if dictionary and opened.dictionary >= 0 else zlib.decompressobj()
        rest = octets[start:]
    else:
        stream = zlib.decompressobj(-_WINDOW, zdict=dictionary)
        rest = octets[start + _HEADER + _CHECKSUM :]
    parts: list[bytes] = []
    try:
        while not stream.eof:
            piece = stream.decompress(rest, _PIECE)
            rest = stream.unconsumed_tail
            opened.size += len(piece)
            if opened.size > most:
                opened.fault = TOO_LARGE
                break
            if kept > 0:
                parts.append(piece[:kept])
                kept -= len(piece)
            if not piece and not rest:
                break  # the stream is over, or continues after the last octet
    except zlib.error:
        opened.fault = BAD
    if not opened.fault and (not stream.eof or len(stream.unused_data) != (0 if checks else _CHECKSUM)):
        opened.fault = BAD
    opened.octets = b"".join(parts)
    return opened
