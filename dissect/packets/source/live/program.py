"""Programs of the kernel's packet filter (classic BPF, linux/filter.h): assembled from labels, or compiled by libpcap."""

from __future__ import annotations

import ctypes
import ctypes.util
from typing import Final, NamedTuple

from dissect.packets.source.live.advice import shown
from dissect.packets.source.live.reader import LiveError
from dissect.packets.source.pcap import LINKTYPE_ETHERNET

#: The most instructions that the kernel accepts.
MAX_INSTRUCTIONS: Final = 4096
#: Result of a filter for an accepted packet: the number of octets to keep, more than any packet has.
WHOLE: Final = 0x40000

LOAD_WORD, LOAD_HALF, LOAD_OCTET = 0x20, 0x28, 0x30  # at an absolute offset
LOAD_WORD_X, LOAD_HALF_X, LOAD_OCTET_X = 0x40, 0x48, 0x50  # at X plus an offset
LOAD_NUMBER, LOAD_MEMORY, LOAD_X_MEMORY, STORE = 0x00, 0x60, 0x61, 0x02
AND, ADD, ADD_X, SHIFT_LEFT, X_TO_A = 0x54, 0x04, 0x0C, 0x64, 0x87
JUMP, EQUAL, GREATER, AT_LEAST, ANY_BIT, RETURN = 0x05, 0x15, 0x25, 0x35, 0x45, 0x06


class Instruction(NamedTuple):
    """One instruction: a ``sock_filter``."""

    code: int
    yes: int
    no: int
    k: int


class TooLongError(Exception):
    """The program has more instructions than the kernel accepts."""


class Assembler:
    """Assembles instructions whose jumps go to labels. Labels are numbers from `label`; jumps only go forward."""

    def __init__(self) -> None:
        # Code, k, label if yes, label if no (-1: the next instruction).
        self._items: list[tuple[int, int, int, int]] = []
        self._places: dict[int, int] = {}
        self._labels = 0

    def label(self) -> int:
        """Return a new label, to be placed later."""
        self._labels += 1
        return self._labels

    def place(self, label: int) -> None:
        """Place ``label`` before the next instruction."""
        self._places[label] = len(self._items)

    def do(self, code: int, k: int = 0) -> None:
        """Add an instruction that does not jump."""
        self._items.append((code, k, -1, -1))

    def jump(self, label: int) -> None:
        """Add an unconditional jump."""
        self._items.append((JUMP, 0, label, -1))

    def test(self, code: int, k: int, yes: int, no: int) -> None:
        """Add a comparison of A with ``k`` that jumps to label ``yes`` or ``no``; -1 is the next instruction."""
        self._items.append((code, k, yes, no))

    def assemble(self) -> list[Instruction]:
        """Return the program. A comparison can only jump over 255 instructions; farther jumps get their own instructions.

        Raises `TooLongError`.
        """
        far: set[int] = set()
        while True:
            starts, size = [], 0
            for number, item in enumerate(self._items):
                starts.append(size)
                size += 1 + 2 * (number in far and item[0] != JUMP)
            if size > MAX_INSTRUCTIONS:
                raise TooLongError
            starts.append(size)
            grown = {number for number in range(len(self._items)) if number not in far and self._is_far(number, starts)}
            if not grown:
                return [
                    part for number in range(len(self._items)) for part in self._emit(number, starts, number in far)
                ]
            far |= grown

    def _is_far(self, number: int, starts: list[int]) -> bool:
        code, _k, yes, no = self._items[number]
        return code != JUMP and max(self._distance(number, label, starts) for label in (yes, no)) > 255

    def _distance(self, number: int, label: int, starts: list[int]) -> int:
        return 0 if label < 0 else starts[self._places[label]] - starts[number] - 1

    def _emit(self, number: int, starts: list[int], far: bool) -> list[Instruction]:
        code, k, yes, no = self._items[number]
        if yes < 0 and no < 0:
            return [Instruction(code, 0, 0, k)]
        if code == JUMP:
            return [Instruction(JUMP, 0, 0, self._distance(number, yes, starts))]
        to_yes, to_no = (self._distance(number, label, starts) for label in (yes, no))
        if not far:
            return [Instruction(code, to_yes, to_no, k)]
        # The comparison goes to one of two jumps; "the next instruction" is the one after both.
        return [
            Instruction(code, 0, 1, k),
            Instruction(JUMP, 0, 0, to_yes - 1 if yes >= 0 else 1),
            Instruction(JUMP, 0, 0, to_no - 2 if no >= 0 else 0),
        ]


# ---- libpcap --------------------------------------------------------------------------------------------------------


class _Instruction(ctypes.Structure):
    _fields_ = (("code", ctypes.c_ushort), ("yes", ctypes.c_ubyte), ("no", ctypes.c_ubyte), ("k", ctypes.c_uint))


class _Program(ctypes.Structure):
    _fields_ = (("size", ctypes.c_uint), ("instructions", ctypes.POINTER(_Instruction)))


def _load() -> ctypes.CDLL | None:
    name = ctypes.util.find_library("pcap")
    try:
        library = ctypes.CDLL(name) if name else None
    except OSError:
        return None
    if library is not None:
        library.pcap_create.restype = ctypes.c_void_p
        library.pcap_create.argtypes = (ctypes.c_char_p, ctypes.c_char_p)
        library.pcap_geterr.restype = ctypes.c_char_p
        for function in (library.pcap_activate, library.pcap_geterr, library.pcap_close):
            function.argtypes = (ctypes.c_void_p,)
        library.pcap_compile.argtypes = (
            ctypes.c_void_p,
            ctypes.POINTER(_Program),
            ctypes.c_char_p,
            *[ctypes.c_uint] * 2,
        )
        library.pcap_freecode.argtypes = (ctypes.POINTER(_Program),)
        library.pcap_open_dead.restype = ctypes.c_void_p
    return library


def compile_with_libpcap(expression: str, interface: str) -> list[Instruction]:
    """Return the program that libpcap compiles from ``expression`` for ``interface``.

    For this the interface is opened and closed again: only then libpcap knows that the kernel keeps VLAN tags outside of the
    frame. `LiveError` when libpcap refuses, `LookupError` when there is no libpcap.
    """
    library = _load()
    if library is None:
        raise LookupError
    errors = ctypes.create_string_buffer(256)
    handle = library.pcap_create(interface.encode(), errors)
    if not handle:
        raise LiveError(f"libpcap: {errors.value.decode('utf-8', 'backslashreplace')}")
    program = _Program()
    try:
        if library.pcap_activate(handle) < 0:
            raise LiveError(f"libpcap: {library.pcap_geterr(handle).decode('utf-8', 'backslashreplace')}")
        octets = expression.encode("utf-8", "surrogateescape")
        if library.pcap_compile(handle, ctypes.byref(program), octets, 1, 0xFFFFFFFF):
            why = library.pcap_geterr(handle).decode("utf-8", "backslashreplace")
            raise LiveError(f"the capture filter {shown(expression)} is not valid: {why}")
        parts = [program.instructions[number] for number in range(program.size)]
        made = [Instruction(part.code, part.yes, part.no, part.k) for part in parts]
        library.pcap_freecode(ctypes.byref(program))
    finally:
        library.pcap_close(handle)
    return made


def complaint_of_libpcap(expression: str) -> str:
    """Return libpcap's error for ``expression`` on Ethernet, empty when it is valid. `LookupError` without libpcap."""
    library = _load()
    if library is None:
        raise LookupError
    handle = library.pcap_open_dead(LINKTYPE_ETHERNET, 0xFFFF)
    program = _Program()
    try:
        octets = expression.encode("utf-8", "surrogateescape")
        if library.pcap_compile(handle, ctypes.byref(program), octets, 1, 0xFFFFFFFF):
            return str(library.pcap_geterr(handle).decode("utf-8", "backslashreplace"))
        library.pcap_freecode(ctypes.byref(program))
    finally:
        library.pcap_close(handle)
    return ""
