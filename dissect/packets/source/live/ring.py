"""`RingReader`: reads the kernel's own packet ring (AF_PACKET, TPACKET_V3), using only the standard library.

The kernel writes packets into blocks of shared memory, and hands a block over when it is full or `_RETIRE_MS` old. Each block
is copied once and given back; its packets are then read from the copy, which the kernel cannot change (linux/if_packet.h).

The socket is created without a protocol, then gets its filter, and only then is bound to the interface. So no packet that the
filter excludes arrives before the filter is set.
"""

from __future__ import annotations

import ctypes
import errno
import mmap
import select
import socket
import struct
import sys
import time
from contextlib import suppress
from typing import Final

from dissect.packets.source.live import advice
from dissect.packets.source.live import program as bpf
from dissect.packets.source.live.advice import shown
from dissect.packets.source.live.filter import NotBuiltInError, compile_filter
from dissect.packets.source.live.interfaces import NetworkInterface, find_interface
from dissect.packets.source.live.program import Instruction, compile_with_libpcap
from dissect.packets.source.live.reader import Drops, LiveError, LiveReader, UnavailableError
from dissect.packets.source.packet import PacketSink
from dissect.packets.source.ring_blocks import deliver_block

#: The header of a block from `STATUS_AT` on: status, number of packets, offset of the first one, octets used.
BLOCK: Final = struct.Struct("=IIII")
STATUS_AT: Final = 8

_SOL_PACKET: Final = 263
_ADD_MEMBERSHIP: Final = 1
_RX_RING: Final = 5
_STATISTICS: Final = 6
_VERSION: Final = 10
_IGNORE_OUTGOING: Final = 23
_TPACKET_V3: Final = 2
_PROMISCUOUS: Final = 1
_ALL_PROTOCOLS: Final = 3
_SO_ATTACH_FILTER: Final = 26

#: A block holds the largest packet that the kernel hands over (up to 64 KiB with offloading), and fits the CPU's caches.
BLOCK_SIZE: Final = 256 * 1024
#: The kernel wants a frame size, though blocks of this version hold packets of any size.
_FRAME_SIZE: Final = 2048
#: How long a block with packets in it is held back, in milliseconds.
_RETIRE_MS: Final = 20
_STATUS_USER: Final = 1
_GIVE_BACK: Final = struct.pack("=I", 0)

_NEEDS: Final = "the ring needs Linux"
_INSTEAD: Final = ("let dumpcap capture: --engine dumpcap",)


def trouble() -> LiveError | None:
    """Return why no ring can be opened here, None when one can be."""
    try:
        _new_socket().close()
    except LiveError as error:
        return error
    return None


def _new_socket() -> socket.socket:
    if sys.platform != "linux":
        raise UnavailableError(_NEEDS, _INSTEAD)
    try:
        return socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0)
    except PermissionError:
        raise UnavailableError("the ring: no permission to capture", advice.ring_permission()) from None
    except OSError as error:
        raise LiveError(f"the ring: the system refuses a packet socket: {error.strerror}") from None


def _mapped(packets: socket.socket, blocks: int) -> mmap.mmap:
    if sys.platform == "win32":
        raise UnavailableError(_NEEDS)
    return mmap.mmap(packets.fileno(), blocks * BLOCK_SIZE, mmap.MAP_SHARED)


def _reports_error(packets: socket.socket, wait_ms: int) -> bool:
    """Wait up to ``wait_ms`` for packets; return whether the socket reports an error instead."""
    if sys.platform == "win32":
        return True
    poll = select.poll()
    poll.register(packets.fileno(), select.POLLIN)
    return any([events & ~select.POLLIN for _descriptor, events in poll.poll(wait_ms)])


class RingReader(LiveReader):
    """Reads packets of an interface from a ring of ``blocks`` blocks. `open_ring` makes one."""

    def __init__(self, packets: socket.socket, interface: NetworkInterface, blocks: int, wait_ms: int) -> None:
        super().__init__(interface.name, "ring", wait_ms)
        self._socket = packets
        self._index = interface.number
        self._link_type = interface.link_type
        self._skip_outgoing = interface.loopback
        self._ring = _mapped(packets, blocks)
        self._blocks = blocks
        self._next = 0
        self._stop_at: float | None = None
        self._closed = False
        self._dropped = 0
        self._lost_before = interface.lost
        self._last = Drops(0, 0 if interface.lost is not None else None)
        #: How often the kernel found the whole ring full.
        self.freezes = 0

    @property
    def drops(self) -> Drops:
        """The losses so far, by the kernel and by the interface."""
        if not self._closed:
            self._count()
        return self._last

    def step(self, sink: PacketSink) -> bool:
        """Deliver one block (256 KiB at most), waiting up to ``wait_ms``; return False at the end."""
        if self._closed:
            return False
        at = self._next * BLOCK_SIZE + STATUS_AT
        status, count, first, used = BLOCK.unpack_from(self._ring, at)
        if not status & _STATUS_USER:
            if not self._wait():
                self.close()
                return False
            status, count, first, used = BLOCK.unpack_from(self._ring, at)
            if not status & _STATUS_USER:
                return True
        if self._down_at is not None:
            self.is_up()
        start = self._next * BLOCK_SIZE
        block = self._ring[start : start + used]
        self._ring[at : at + 4] = _GIVE_BACK
        self._next = (self._next + 1) % self._blocks
        self.octets += used
        self.packets += deliver_block(block, first, count, sink, self._link_type, self._skip_outgoing)
        return True

    def stop(self) -> None:
        """Admit no further packets; `step` still delivers what the ring holds. May be called twice."""
        if self._stop_at is None and not self._closed:
            _attach(self._socket, [Instruction(bpf.RETURN, 0, 0, 0)])
            self._stop_at = time.monotonic() + 3 * _RETIRE_MS / 1000

    def close(self) -> None:
        """Release the ring. May be called twice."""
        if not self._closed:
            self._count()
            self._last = Drops(self._dropped + self._left(), self._last.interface)
            self._closed = True
            self._ring.close()
            self._socket.close()

    def _left(self) -> int:
        """Return how many unread packets the ring holds: closing it early loses them."""
        count = 0
        for ahead in range(self._blocks):
            at = (self._next + ahead) % self._blocks * BLOCK_SIZE + STATUS_AT
            status, packets, _, _ = BLOCK.unpack_from(self._ring, at)
            if not status & _STATUS_USER:
                break
            count += packets
        return count // 2 if self._skip_outgoing else count  # loopback shows each packet twice

    def _wait(self) -> bool:
        """Wait for a block; return False when no further ones will come."""
        wait_ms = self.wait_ms
        if self._stop_at is not None:
            left = self._stop_at - time.monotonic()
            if left <= 0:
                return False
            wait_ms = min(wait_ms, int(left * 1000) + 1)
        return self._disturbed() if _reports_error(self._socket, wait_ms) else True

    def _disturbed(self) -> bool:
        """Handle an error of the socket: return True if the interface just went down and may come back; otherwise end."""
        number = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        described = find_interface(self.interface)
        if described is None or described.number != self._index:
            self.damage = f"the interface {self.interface} is gone"
            return False
        if number not in {0, errno.ENETDOWN}:
            self.damage = f"reading {self.interface} failed: {errno.errorcode.get(number, number)}"
            return False
        if number:
            self.went_down()
        return True

    def _count(self) -> None:
        """Bring the counts up to date; the kernel resets its counts to zero with each query."""
        counts = self._socket.getsockopt(_SOL_PACKET, _STATISTICS, 12)
        _packets, dropped, freezes = struct.unpack("=III", counts)
        self._dropped += dropped
        self.freezes += freezes
        lost = self._last.interface
        described = None
        if self._lost_before is not None or self._down_at is not None:
            described = find_interface(self.interface)
        if self._down_at is not None and described is not None and described.state != "down":
            self.is_up()
        if described is not None and described.lost is not None and self._lost_before is not None:
            lost = max(described.lost - self._lost_before, 0)
        self._last = Drops(self._dropped, lost)


def open_ring(
    interface: NetworkInterface, expression: str, wait_ms: int, *, buffer_mib: int, promiscuous: bool
) -> RingReader:
    """Open a ring on ``interface``; `LiveError` with advice when that is not allowed or the filter is not usable."""
    if sys.platform != "linux":  # where the link type is unknown as well
        raise UnavailableError(_NEEDS, _INSTEAD)
    if interface.link_type < 0:
        raise LiveError(
            f"{interface.name}: the ring reads Ethernet and raw IP, not {interface.link_name}; let dumpcap capture"
        )
    packets = _new_socket()
    if interface.state == "down":
        packets.close()
        raise LiveError(f"{interface.name}: it is down", advice.interface_down(interface.name))
    try:
        program = _program(expression, interface)
        blocks = max(buffer_mib * 1024 * 1024 // BLOCK_SIZE, 2)
        ring = struct.pack(
            "=7I", BLOCK_SIZE, blocks, _FRAME_SIZE, blocks * (BLOCK_SIZE // _FRAME_SIZE), _RETIRE_MS, 0, 0
        )
        packets.setsockopt(_SOL_PACKET, _VERSION, _TPACKET_V3)
        if program:
            _attach(packets, program)
        packets.setsockopt(_SOL_PACKET, _RX_RING, ring)
        if promiscuous and not interface.loopback:
            membership = struct.pack("=iHH8x", interface.number, _PROMISCUOUS, 0)
            packets.setsockopt(_SOL_PACKET, _ADD_MEMBERSHIP, membership)
        if interface.loopback:
            with suppress(OSError):  # since Linux 4.20; `deliver_block` skips outgoing packets as well
                packets.setsockopt(_SOL_PACKET, _IGNORE_OUTGOING, 1)
        reader = RingReader(packets, interface, blocks, wait_ms)
        packets.bind((interface.name, _ALL_PROTOCOLS))
    except OSError as error:
        packets.close()
        raise LiveError(f"{interface.name}: the ring cannot be set up: {error.strerror or error}") from None
    except BaseException:
        packets.close()
        raise
    return reader


def _program(expression: str, interface: NetworkInterface) -> list[Instruction]:
    if not expression.strip():
        return []
    try:
        return compile_filter(expression, interface.link_type)
    except NotBuiltInError:
        pass
    try:
        return compile_with_libpcap(expression, interface.name)
    except LookupError:
        raise LiveError(
            f"the capture filter {shown(expression)} is more than the ring supports without libpcap",
            (
                "install libpcap, or use only tcp, udp, port N, host ADDRESS, net, vlan, and, or, not",
                "more: s7dissect help live",
            ),
        ) from None


def _attach(packets: socket.socket, program: list[Instruction]) -> None:
    octets = b"".join([struct.pack("=HBBI", *instruction) for instruction in program])
    held = ctypes.create_string_buffer(octets, len(octets))
    packets.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, struct.pack("HP", len(program), ctypes.addressof(held)))
