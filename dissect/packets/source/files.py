"""Opens a capture from a path, standard input or another machine, and finds its reader by the first octets.

Compressed files (gzip, also of several members, and zstd, also of several frames) are decompressed while they are read, a
bounded piece at a time. A file that is compressed twice is refused.
"""

from __future__ import annotations

import os
import select
import sys
import zlib
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Final, Protocol, cast

from dissect.packets.source.packet import READING_FAILED, CaptureError, Reader
from dissect.packets.source.pcap import CHUNK, PCAP_MAGICS, OctetSource, PcapReader
from dissect.packets.source.pcapng import BYTE_ORDER_MAGICS, PCAPNG_MAGIC, PcapngReader
from dissect.packets.source.remote import is_remote, open_remote, shown
from dissect.wire.errors import MissingCaptureError

#: The largest window of a zstd frame that is decompressed, in octets: enough for all levels up to ``zstd --ultra -20``.
MAX_ZSTD_WINDOW: Final = 32 * 1024 * 1024

#: Number of octets that show the kind of a file.
_HEAD: Final = 12

_GZIP_MAGIC: Final = b"\x1f\x8b"
_ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
_ZSTD_MAX_BLOCK: Final = 128 * 1024
_ZSTD_RLE: Final = 1

#: How some files begin that are often taken for captures, with their kind and how to convert them to a capture.
_OTHER_MAGICS: Final = (
    (b"BZh", "a bzip2 file; decompress it first"),
    (b"\xfd7zXZ\x00", "an xz file; decompress it first"),
    (b"\x04\x22\x4d\x18", "an lz4 file; decompress it first"),
    (b"PK\x03\x04", "a zip archive; unpack it first"),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive; unpack it first"),
    (b"snoop\x00\x00\x00", "a snoop file; convert it first: editcap -F pcapng OLD NEW"),
    (b"GMBU", "a Network Monitor file; convert it first: editcap -F pcapng OLD NEW"),
    (b"RTSS", "a Network Monitor file; convert it first: editcap -F pcapng OLD NEW"),
    (b"\xac\x01\x00\x1c", "an lcap file; convert it first: editcap -F pcapng OLD NEW"),
    (b"\xab\x01\x00\x1c", "an lcap file; convert it first: editcap -F pcapng OLD NEW"),
)


def open_capture(path: str | os.PathLike[str]) -> Reader:
    """Open the capture at ``path`` and return its reader; ``-`` is standard input, a URL is a file on another machine.

    The first octets decide what it is, never its name: pcap or pcapng, plain or in gzip or zstd. Raises `CaptureError`, with
    one line for a person, if there is nothing to read: no such file, not a capture, an empty file, or zstd without the package
    that reads it. Damage further on raises nothing; the reader reports it.
    """
    path = os.fspath(path)
    source = _open(path)
    try:
        return find_reader(source, "standard input" if path == "-" else shown(path))
    except BaseException:
        source.close()
        raise


def _open(path: str) -> OctetSource:
    if path == "-":
        return _open_stdin()
    return open_remote(path) if is_remote(path) else _open_file(path)


def _open_file(path: str) -> PlainSource:
    if not path:  # `Path` would take it for the current folder
        raise CaptureError("the name of a file is empty; was a variable of the shell not set?")
    try:
        return PlainSource(cast(_Stream, Path(path).open("rb", buffering=0)), owned=True)
    except FileNotFoundError:
        raise MissingCaptureError(f"{path}: no such file") from None
    except IsADirectoryError:
        reason = "a directory, not a capture file"
    except PermissionError:
        reason = "no permission to read it"
    except OSError as error:
        reason = f"cannot be opened: {error.strerror}"
    except ValueError as error:
        reason = f"not a file name: {error}"
    raise CaptureError(f"{path}: {reason}")


def _open_stdin() -> PlainSource:
    if sys.stdin is None:
        raise CaptureError("standard input: closed")
    if sys.stdin.isatty():
        raise CaptureError("standard input: a terminal; pipe a capture into it")
    buffered = sys.stdin.buffer
    return PlainSource(cast(_Stream, getattr(buffered, "raw", buffered)), owned=False)


def find_reader(source: OctetSource, name: str) -> Reader:
    """Return the reader for the content of ``source``.

    Raises `CaptureError` for any other content, with ``name`` in front of the reason.
    """
    head = _read_head(source)
    packed = compression(head)
    if packed:
        try:
            source = GzipSource(source, head) if packed == "gzip" else ZstdSource(source, head)
        except ImportError:
            raise CaptureError(
                f"{name}: a zstd file, which needs one more package: pip install 's7dissect[zstd]'"
            ) from None
        head = _read_head(source)
        if compression(head):
            raise CaptureError(f"{name}: compressed twice; decompress it once first")
    if head[:4] in PCAP_MAGICS:
        return PcapReader(source, head)
    if head[:4] == PCAPNG_MAGIC and (len(head) < _HEAD or head[8:12] in BYTE_ORDER_MAGICS):
        return PcapngReader(source, head)
    if source.damage and len(head) < _HEAD:
        raise CaptureError(f"{name}: {source.damage}")
    if len(head) < 4:
        raise CaptureError(f"{name}: {f'only {len(head)} bytes, not a capture' if head else 'empty'}")
    for magic, what in _OTHER_MAGICS:
        if head.startswith(magic):
            raise CaptureError(f"{name}: {what}")
    raise CaptureError(f"{name}: not a capture file (pcap or pcapng, plain or in gzip or zstd)")


def _read_head(source: OctetSource) -> bytes:
    """Return the first octets of ``source``: at least `_HEAD`, unless it has fewer."""
    pieces: list[bytes] = []
    size = 0
    while size < _HEAD:
        piece = source.read(CHUNK)
        if not piece:
            break
        pieces.append(piece)
        size += len(piece)
    return b"".join(pieces)


def compression(head: bytes) -> str:
    """Return how a file that begins with ``head`` is compressed: ``gzip``, ``zstd`` or nothing."""
    if head.startswith(_GZIP_MAGIC):
        return "gzip"
    return "zstd" if head.startswith(_ZSTD_MAGIC) or _is_skippable(head[:4]) else ""


def _is_skippable(magic: bytes) -> bool:
    """Return whether this is the magic number of a zstd frame without content, such as pzstd writes at the beginning."""
    return len(magic) == 4 and 0x50 <= magic[0] <= 0x5F and magic[1:] == b"\x2a\x4d\x18"


class _Stream(Protocol):
    """The used methods of a raw binary file. ``read`` returns None when a non-blocking file has no data yet."""

    def read(self, size: int, /) -> bytes | None: ...

    def fileno(self) -> int: ...

    def close(self) -> None: ...


class PlainSource:
    """A file or pipe, read without decompression. A file that is ``owned`` is closed together with the source."""

    def __init__(self, stream: _Stream, owned: bool) -> None:
        self.damage = ""
        self._stream = stream
        self._owned = owned
        self._taken = 0

    def read(self, size: int) -> bytes:
        """Return up to ``size`` octets, waiting for them if need be; none at the end."""
        if self.damage:
            return b""
        try:
            piece = self._stream.read(size)
            while piece is None:
                select.select([self._stream], [], [])
                piece = self._stream.read(size)
        except OSError as error:
            self.damage = f"{READING_FAILED} {self._taken}: {error.strerror or error}"
            return b""
        self._taken += len(piece)
        return piece

    def close(self) -> None:
        """Release the file. May be called twice."""
        if self._owned:
            self._stream.close()


class _DamagedError(Exception):
    """The compressed data cannot be read further; the message is for a person."""


class _CompressedSource(ABC):
    """The base class of both decompressors: keeps compressed octets that were not used yet, and reports damage."""

    def __init__(self, source: OctetSource, head: bytes) -> None:
        self.damage = ""
        self._source = source
        self._pending = head
        self._taken = len(head)
        self._ended = False

    def read(self, size: int) -> bytes:
        """Return some decompressed octets, waiting for them if need be; none at the end."""
        octets = b""
        try:
            while not octets and not self._ended:
                octets = self._decompress(size)
        except _DamagedError as error:
            self._ended = True
            self.damage = str(error)
        return octets

    def close(self) -> None:
        """Release the file. May be called twice."""
        self._ended = True
        self._source.close()

    @abstractmethod
    def _decompress(self, size: int) -> bytes:
        """Return some octets, or none after some progress; set ``_ended`` at the end. `_DamagedError` for damaged data."""

    def _more(self) -> bytes:
        """Return some more compressed octets; none at the end."""
        piece = self._source.read(CHUNK)
        self._taken += len(piece)
        return piece

    def _cut(self, what: str) -> _DamagedError:
        return _DamagedError(self._source.damage or f"the {what} data is cut off at byte {self._taken}")


class GzipSource(_CompressedSource):
    """The content of a gzip file (RFC 1952): all its members in order. Zero octets after the last one are padding."""

    def __init__(self, source: OctetSource, head: bytes) -> None:
        super().__init__(source, head)
        self._member = zlib.decompressobj(wbits=31)
        self._between = False
        self._corrupt = ""

    def _decompress(self, size: int) -> bytes:
        if self._corrupt:
            raise _DamagedError(self._corrupt)
        if self._between:
            self._begin_member()
            return b""
        if not self._pending:
            self._pending = self._more()
        before = self._member.copy()
        try:
            octets = self._member.decompress(self._pending, size)
        except zlib.error as error:
            return self._salvage(before, str(error).rpartition(": ")[2])
        if self._member.eof:
            self._pending = self._member.unused_data
            self._between = True
        elif not octets and not self._pending:
            # The source has ended, and the decompressor has nothing left.
            raise self._cut("gzip")
        else:
            self._pending = self._member.unconsumed_tail
        return octets

    def _salvage(self, before: zlib._Decompress, why: str) -> bytes:
        """Return the content before the corrupt octet, which the failed call did not return; the next call raises the error."""
        octets = bytearray()
        start = self._taken - len(self._pending)
        for at in range(len(self._pending)):
            try:
                octets += before.decompress(self._pending[at : at + 1])
            except zlib.error:
                self._corrupt = f"the gzip data is corrupt at byte {start + at} ({why})"
                break
        return bytes(octets)

    def _begin_member(self) -> None:
        """Begin the next member, if there is one."""
        self._pending = self._pending.lstrip(b"\0")
        if not self._pending:
            self._pending = self._more()
            self._ended = not self._pending
            if self._source.damage:
                raise self._cut("gzip")
        elif self._pending.startswith(_GZIP_MAGIC[:1]):
            self._member = zlib.decompressobj(wbits=31)
            self._between = False
        else:
            end = self._taken - len(self._pending)
            raise _DamagedError(
                f"the gzip data ends at byte {end}; the data after it is not compressed data and was ignored"
            )


class ZstdSource(_CompressedSource):
    """The content of a zstd file (RFC 8878): all its frames in order. ImportError without the zstandard package.

    The frames are given to the decompressor block by block. A block has at most 128 KiB of content, so a small input cannot
    make the decompressor return more at once. And the end of the last block is known, so a cut is reported.
    """

    def __init__(self, source: OctetSource, head: bytes) -> None:
        super().__init__(source, head)
        import zstandard

        self._decompressor = zstandard.ZstdDecompressor(max_window_size=MAX_ZSTD_WINDOW)
        self._error = zstandard.ZstdError
        self._frame = self._decompressor.decompressobj()
        self._at = 0
        self._next = self._begin_frame
        self._checksum = False

    def _decompress(self, size: int) -> bytes:
        start = self._offset()
        try:
            return self._next()
        except self._error as error:
            why = str(error).rpartition(": ")[2]
            raise _DamagedError(
                f"the zstd data is corrupt between bytes {start} and {self._offset()} ({why})"
            ) from None

    def _offset(self) -> int:
        """Return how many compressed octets were used."""
        return self._taken - len(self._pending) + self._at

    def _begin_frame(self) -> bytes:
        """Read the header of a frame, or skip a frame without content, or end where there is none."""
        if not self._have(1):
            self._ended = True
            if self._source.damage:
                raise self._cut("zstd")
            return b""
        start = self._offset()
        magic = self._take(4)
        if _is_skippable(magic):
            self._skip(int.from_bytes(self._take(4), "little"))
            return b""
        if magic != _ZSTD_MAGIC:
            raise _DamagedError(
                f"the zstd data ends at byte {start}; the data after it is not compressed data and was ignored"
            )
        descriptor = self._take(1)
        flags = descriptor[0]
        single = flags >> 5 & 1
        window = self._take(1 - single)
        dictionary = self._take((0, 1, 2, 4)[flags & 3])
        content = self._take((single, 2, 4, 8)[flags >> 6])
        if single:
            needed = int.from_bytes(content, "little")
        else:
            unit = 1 << (10 + (window[0] >> 3))
            needed = unit + (unit >> 3) * (window[0] & 7)
        if needed > MAX_ZSTD_WINDOW:
            raise _DamagedError(
                f"the zstd data needs a window of {needed >> 20} MiB, more than the {MAX_ZSTD_WINDOW >> 20} allowed; "
                "decompress it first: zstd -d --long=31"
            )
        self._checksum = flags & 4 != 0
        self._frame = self._decompressor.decompressobj()
        self._next = self._block
        return self._frame.decompress(magic + descriptor + window + dictionary + content)

    def _block(self) -> bytes:
        """Return the content of the next block of a frame."""
        header = self._take(3)
        word = int.from_bytes(header, "little")
        size = 1 if word >> 1 & 3 == _ZSTD_RLE else word >> 3
        if size > _ZSTD_MAX_BLOCK:
            raise _DamagedError(f"the zstd data is corrupt at byte {self._offset() - 3} (a block of {size} bytes)")
        body = self._take(size)
        if word & 1:
            self._next = self._end_frame if self._checksum else self._begin_frame
        return self._frame.decompress(header + body)

    def _end_frame(self) -> bytes:
        """Check the checksum.

        That is a step of its own, so that the content of the last block is kept if the end of the frame is wrong.
        """
        self._next = self._begin_frame
        return self._frame.decompress(self._take(4))

    def _have(self, size: int) -> bool:
        """Make sure that at least ``size`` octets are pending; return False when the source ends before."""
        have = len(self._pending) - self._at
        if have >= size:
            return True
        pieces = [self._pending[self._at :]]
        while have < size:
            piece = self._more()
            if not piece:
                break
            pieces.append(piece)
            have += len(piece)
        self._pending = b"".join(pieces)
        self._at = 0
        return have >= size

    def _take(self, size: int) -> bytes:
        """Return the next ``size`` compressed octets."""
        if not self._have(size):
            raise self._cut("zstd")
        self._at += size
        return self._pending[self._at - size : self._at]

    def _skip(self, size: int) -> None:
        """Skip ``size`` compressed octets without keeping them."""
        while size and self._have(1):
            step = min(size, len(self._pending) - self._at)
            self._at += step
            size -= step
        if size:
            raise self._cut("zstd")
