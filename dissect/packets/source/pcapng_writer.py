"""Writes pcapng (draft-ietf-opsawg-pcapng): one section, little-endian, times in nanoseconds, any number of link types.

A file only grows, by whole blocks; what was written is never changed. So the file is readable up to its last whole block,
however the writing ends, even with kill -9. When the disk is full, the part of the last block that did fit is removed again
before the error is raised.
"""

from __future__ import annotations

import errno
import os
import struct
from collections.abc import Callable, Iterable, Sequence
from typing import Final

from dissect.packets.source.packet_blocks import MAX_COUNT, InterfaceStatistics, PacketBlocks, plain_block
from dissect.packets.source.pcapng import (
    DECRYPTION_SECRETS,
    IF_FILTER,
    IF_NAME,
    IF_TSRESOL,
    INTERFACE,
    MAX_BLOCK,
    MAX_INTERFACES,
    OPT_COMMENT,
    OPT_END,
    SECTION,
    TLS_KEY_LOG,
)
from dissect.wire.config.saving import is_special
from dissect.wire.text import printable

_STATISTICS: Final = 5

# Options of a section and of the statistics of an interface.
_SHB_HARDWARE: Final = 2
_SHB_OS: Final = 3
_SHB_USERAPPL: Final = 4
_ISB_START: Final = 2
_ISB_END: Final = 3
_ISB_RECEIVED: Final = 4
_ISB_DROPPED: Final = 5
_ISB_DELIVERED: Final = 8

_NANOSECONDS: Final = b"\x09"
#: How the filter of an interface is written: as a text of libpcap's.
_LIBPCAP: Final = b"\0"
_MAX_OPTION: Final = 65_535
#: Octets that all comments of one packet may take together; a last comment says how many more were dropped.
MAX_COMMENTS: Final = 262_144

_BYTE_ORDER: Final = 0x1A2B3C4D
_OPTION: Final = struct.Struct("<HH")
_SECTION_HEAD: Final = struct.Struct("<IHHq")
_INTERFACE_HEAD: Final = struct.Struct("<HxxI")
_PAIR: Final = struct.Struct("<II")
_TIME_HALVES: Final = struct.Struct("<III")
_U32: Final = struct.Struct("<I")
_MASK: Final = 0xFFFFFFFF

#: The errors of a full disk: no room at all, or none for this user.
FULL: Final = frozenset((errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)))

#: Mode of a new capture file: other users of the machine cannot read it, because captures hold passwords.
CAPTURE_MODE: Final = 0o640


# ---- blocks ---------------------------------------------------------------------------------------------------------


def section_block(hardware: str = "", os_name: str = "", application: str = "", comment: str = "") -> bytes:
    """Return a Section Header Block of unknown length; empty texts are left out."""
    options = [(OPT_COMMENT, comment_octets(comment))] if comment else []
    for code, text in ((_SHB_HARDWARE, hardware), (_SHB_OS, os_name), (_SHB_USERAPPL, application)):
        if text:
            options.append((code, _cut(printable(text).encode())))
    return _block(SECTION, _SECTION_HEAD.pack(_BYTE_ORDER, 1, 0, -1) + _options(options))


def section_mark(head: bytes) -> str:
    """Return the comment of a section header written by `section_block`, which begins a file; empty for other beginnings."""
    fixed = 8 + _SECTION_HEAD.size
    if len(head) < fixed + _OPTION.size or head[:4] != _U32.pack(SECTION) or head[8:12] != _U32.pack(_BYTE_ORDER):
        return ""
    code, size = _OPTION.unpack_from(head, fixed)
    text = head[fixed + _OPTION.size : fixed + _OPTION.size + size]
    return text.decode("utf-8", "replace") if code == OPT_COMMENT and len(text) == size else ""


def interface_block(link_type: int, name: str = "", snaplen: int = 0, capture_filter: str = "") -> bytes:
    """Return an Interface Description Block with nanoseconds; ``snaplen`` 0: no limit. ValueError for a wrong link type.

    ``capture_filter`` is the filter of the capture, in libpcap's language.
    """
    if not 0 <= link_type <= 0xFFFF:
        raise ValueError(f"{link_type} is not a link type: it must fit 16 bits")
    options = [(IF_NAME, _cut(printable(name).encode()))] if name else []
    options.append((IF_TSRESOL, _NANOSECONDS))
    if capture_filter:
        options.append((IF_FILTER, _LIBPCAP + _cut(printable(capture_filter).encode())[: _MAX_OPTION - 1]))
    return _block(INTERFACE, _INTERFACE_HEAD.pack(link_type, snaplen) + _options(options))


def packet_block(
    interface: int,
    time_ns: int,
    octets: bytes,
    wire_length: int,
    comments: Sequence[str] = (),
) -> bytes:
    """Return an Enhanced Packet Block. ``time_ns`` is nanoseconds since 1970, clamped to 0 … 2**64 - 1.

    ``wire_length`` is raised to the size of ``octets`` where it is less. ValueError when the block would be larger than readers
    accept (16 MiB).
    """
    options = _options([(OPT_COMMENT, text) for text in _comments(comments)]) if comments else b""
    return plain_block(interface, time_ns, octets, wire_length, options)


def secrets_block(text: bytes) -> bytes:
    """Return a Decryption Secrets Block with a TLS key log. ValueError when it would be larger than readers accept."""
    if 20 + len(text) > MAX_BLOCK:
        raise ValueError(f"a key log of {len(text)} bytes is larger than a pcapng block may be ({MAX_BLOCK} bytes)")
    return _block(DECRYPTION_SECRETS, _PAIR.pack(TLS_KEY_LOG, len(text)) + text + bytes(-len(text) % 4))


def _statistics_block(number: int, told: InterfaceStatistics) -> bytes:
    """Return an Interface Statistics Block: first and last time, number of packets, and losses if they are known."""
    first = told.first_ns
    last = told.last_ns
    options = [
        (_ISB_START, _PAIR.pack(first >> 32, first & _MASK)),
        (_ISB_END, _PAIR.pack(last >> 32, last & _MASK)),
    ]
    for code, count in ((_ISB_RECEIVED, told.received), (_ISB_DROPPED, told.dropped)):
        if count >= 0:
            options.append((code, struct.pack("<Q", min(count, MAX_COUNT))))
    options.append((_ISB_DELIVERED, struct.pack("<Q", told.packets)))
    return _block(_STATISTICS, _TIME_HALVES.pack(number, last >> 32, last & _MASK) + _options(options))


def comment_octets(text: str) -> bytes:
    """Return a comment as the value of an option: UTF-8, control and bidi characters escaped, lines kept, cut to size."""
    lines = text.replace("\r\n", "\n").split("\n")
    return _cut("\n".join([printable(line) for line in lines]).encode())


def _cut(octets: bytes) -> bytes:
    """Return ``octets``, cut after a whole UTF-8 character if they are more than an option holds."""
    if len(octets) <= _MAX_OPTION:
        return octets
    return octets[: _MAX_OPTION - 3].decode("utf-8", "ignore").encode() + "…".encode()


def _comments(comments: Sequence[str]) -> list[bytes]:
    """Return as many comments as fit into `MAX_COMMENTS` octets; a last one says how many did not."""
    room = MAX_COMMENTS
    told: list[bytes] = []
    for index, comment in enumerate(comments):
        octets = comment_octets(comment)
        room -= len(octets) + 8
        if room < 0:
            told.append(f"{len(comments) - index} more comments were dropped".encode())
            break
        if octets:
            told.append(octets)
    return told


def _options(options: Iterable[tuple[int, bytes]]) -> bytes:
    """Return packed options with the end marker; nothing when there are none."""
    parts = [_OPTION.pack(code, len(value)) + value + bytes(-len(value) % 4) for code, value in options]
    return b"".join([*parts, _OPTION.pack(OPT_END, 0)]) if parts else b""


def _block(kind: int, body: bytes) -> bytes:
    total = 12 + len(body)
    return _PAIR.pack(kind, total) + body + _U32.pack(total)


# ---- the file -------------------------------------------------------------------------------------------------------


class PcapngWriter:
    """A pcapng file being written, block by block.

    Each block goes to the file in one write. With ``batch``, whole blocks are gathered up to that many octets; gathered blocks
    are lost if the process is killed. ``packets`` and ``octets`` count everything added so far, `unwritten` how much of that is
    not in the file. ``make_room`` is called when the disk is full, and returns whether it freed space, so that another try
    makes sense. An `OSError` names ``path``. ``capture_filter`` is written to the interfaces that begin after it was set.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        hardware: str = "",
        os_name: str = "",
        application: str = "",
        comment: str = "",
        batch: int = 0,
        overwrite: bool = False,
        make_room: Callable[[], bool] | None = None,
    ) -> None:
        """Create the file at ``path`` (FileExistsError when there is one, unless ``overwrite``); ``-`` is standard output.

        A device or a FIFO at ``path`` is written to.
        """
        self.path = path = os.fspath(path)
        self.packets = 0
        self.octets = 0
        self.capture_filter = ""
        self._given = 0  # number of packets added, and their octets
        self._captured = 0
        self._safe = (0, 0)  # packets and octets of packets that are in the file
        self._make_room = make_room
        self._batch = batch
        self._gathered: list[bytes] = []
        self._held = 0
        self._interfaces: dict[tuple[int, str], int] = {}
        self._told: list[InterfaceStatistics] = []
        self._secrets: list[bytes] = []  # blocks that wait for the first interface
        self._owned = path != "-"
        self._whole = 0  # octets of the file up to the last whole block
        self._failed = False
        self._taken_back = True  # the file ends with a whole block
        if self._owned:
            flags = os.O_WRONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
            if not is_special(path):  # a device or a FIFO is only opened: it has no content to overwrite
                flags |= os.O_CREAT | (os.O_TRUNC if overwrite else os.O_EXCL)
            self._descriptor = os.open(path, flags, CAPTURE_MODE)
        else:
            self._descriptor = 1
        try:
            self._put(section_block(hardware, os_name, application, comment))
            self.flush()
        except BaseException:
            self._release()
            raise

    @property
    def closed(self) -> bool:
        """True when nothing more can be written."""
        return self._descriptor < 0

    @property
    def unwritten(self) -> tuple[int, int]:
        """How many packets were added and are not in the file, and their octets."""
        return self._given - self._safe[0], self._captured - self._safe[1]

    def fileno(self) -> int:
        """Return the file descriptor, -1 when it is closed."""
        return self._descriptor

    def interface(self, link_type: int, name: str = "") -> int:
        """Return the number of the interface with this link type and name; write its description if it is new."""
        number = self._interfaces.get((link_type, name))
        if number is None:
            if name and len(self._told) >= MAX_INTERFACES:
                return self.interface(link_type)  # more than readers keep: use the interface without a name
            block = interface_block(link_type, name, capture_filter=self.capture_filter)
            number = len(self._told)
            self._interfaces[link_type, name] = number
            self._told.append(InterfaceStatistics())
            self._put(block)
            for secrets in self._secrets:
                self._put(secrets)
            self._secrets = []
        return number

    def packet(
        self,
        time_ns: int,
        octets: bytes,
        wire_length: int,
        link_type: int,
        comments: Sequence[str] = (),
        name: str = "",
    ) -> None:
        """Add a packet that interface ``name`` captured (empty if that is not known). See `packet_block`."""
        number = self._interfaces.get((link_type, name), -1)
        if number < 0:
            number = self.interface(link_type, name)
        block = packet_block(number, time_ns, octets, wire_length, comments)
        self._given += 1  # counted first, so that a packet that cannot be written counts as unwritten
        self._captured += len(octets)
        self._put(block)
        self._told[number].count(time_ns)
        self.packets += 1

    def blocks(self, link_type: int, name: str = "") -> PacketBlocks:
        """Return a `PacketBlocks` that gathers packets of the interface with this link type and name, for `put`."""
        number = self.interface(link_type, name)
        return PacketBlocks(number, self._told[number])

    def put(self, blocks: PacketBlocks) -> None:
        """Add the gathered packets; the caller must have added all earlier packets."""
        if blocks.packets:
            self.packets += blocks.packets
            self._given += blocks.packets
            self._put(blocks.take())

    def secrets(self, text: bytes) -> None:
        """Add a TLS key log for the packets that follow. Whoever has the file can decrypt these packets.

        It is written after the first interface, because tshark 4.0 cannot rewrite a file that has it before.
        """
        block = secrets_block(text)
        if self._told:
            self._put(block)
        else:
            self._secrets.append(block)

    def statistics(self, link_type: int, name: str, received: int, dropped: int) -> None:
        """Set how many packets the interface received and dropped, -1 if not known; that is written at the end."""
        told = self._told[self.interface(link_type, name)]
        told.received = received
        told.dropped = dropped

    def flush(self) -> None:
        """Write the gathered blocks."""
        if self._held:
            octets = b"".join(self._gathered)
            self._gathered.clear()
            self._held = 0
            self._write(octets)

    def close(self) -> None:
        """Write the statistics of each interface, and end the file. May be called twice."""
        if self.closed:
            return
        try:
            if not self._failed:
                for number, told in enumerate(self._told):
                    if told.packets or told.received >= 0:
                        self._put(_statistics_block(number, told))
                self.flush()
        finally:
            self._release()

    def resume(self) -> bool:
        """Write to the file again after a failure; return False if it no longer ends with a whole block.

        Packets that were unwritten before are lost, so count them first.
        """
        if self.closed or not self._taken_back:
            return False
        self._failed = False
        self._safe = (self._given, self._captured)
        return True

    def abandon(self) -> None:
        """End the file as it is, without the gathered blocks and without statistics. May be called twice."""
        self._gathered.clear()
        self._held = 0
        self._release()

    def _release(self) -> None:
        descriptor = self._descriptor
        self._descriptor = -1
        if self._owned and descriptor >= 0:
            os.close(descriptor)

    def _put(self, block: bytes) -> None:
        self.octets += len(block)
        if not self._batch and not self._held:
            self._write(block)
            return
        self._gathered.append(block)
        self._held += len(block)
        if self._held >= self._batch:
            self.flush()

    def _write(self, octets: bytes) -> None:
        """Write whole blocks; if that fails, remove the part that was written."""
        if self.closed or self._failed:
            raise ValueError(f"{self.path} was closed, or writing to it failed before")
        try:
            self._write_all(octets)
        except OSError as error:
            self._failed = True
            self._take_back()
            if not self._owned:
                raise
            raise OSError(error.errno, error.strerror, self.path) from None
        self._whole += len(octets)
        self._safe = (self._given, self._captured)

    def _write_all(self, octets: bytes) -> None:
        """Write all octets; on a full disk, try again as long as space can be freed."""
        rest = memoryview(octets)
        while rest:
            try:
                rest = rest[os.write(self._descriptor, rest) :]
            except OSError as error:
                if error.errno not in FULL or self._make_room is None or not self._make_room():
                    raise

    def _take_back(self) -> None:
        """Cut the file after its last whole block."""
        self._taken_back = self._owned
        if self._owned:
            try:
                os.ftruncate(self._descriptor, self._whole)
                os.lseek(self._descriptor, 0, os.SEEK_END)
            except OSError:
                self._taken_back = (
                    False  # a pipe or a device keeps the written part, and readers report where it is cut
                )
