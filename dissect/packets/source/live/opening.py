"""Opens a live source: chooses the engine that captures, and finds out whether it may."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from dissect.packets.source.live import BUFFER_MIB, MAX_BUFFER_MIB, advice, dumpcap, ring
from dissect.packets.source.live.interfaces import NetworkInterface, ask, list_interfaces
from dissect.packets.source.live.pipe import open_stdin
from dissect.packets.source.live.reader import WAIT_MS, LiveError, LiveReader, UnavailableError
from dissect.packets.source.live.several import SeveralReader

#: Ways to capture, the preferred one first.
ENGINES: Final = ("dumpcap", "ring")
#: The largest snap length, in octets.
MAX_SNAPLEN: Final = 262_144


class EngineState(NamedTuple):
    """Whether an engine can capture here: ``reason`` is empty if it can; otherwise ``advice`` says how to make it work."""

    name: str
    reason: str
    advice: tuple[str, ...]


def open_live(
    interface: str,
    expression: str = "",
    engine: str = "auto",
    *,
    wait_ms: int = WAIT_MS,
    snaplen: int = 0,
    buffer_mib: int = BUFFER_MIB,
    promiscuous: bool = True,
) -> LiveReader:
    """Return a reader of the packets on ``interface`` that pass the capture filter ``expression`` (empty: all).

    ``engine`` is ``dumpcap``, ``ring``, or ``auto``: dumpcap, or the ring where dumpcap is missing or may not capture. ``-`` as
    ``interface`` is a capture on standard input. ``snaplen`` cuts packets (0: not at all; dumpcap only), ``buffer_mib`` is the
    size of the kernel's buffer. `LiveError`, with advice, when the source cannot be opened.
    """
    if engine not in {"auto", *ENGINES}:
        raise LiveError(f"{engine!r} is not an engine: choose auto, {', '.join(ENGINES)}")
    if not 0 <= snaplen <= MAX_SNAPLEN or not 1 <= buffer_mib <= MAX_BUFFER_MIB:
        raise LiveError(f"a snap length is 0 to {MAX_SNAPLEN} bytes, a buffer 1 to {MAX_BUFFER_MIB} MiB")
    if "\0" in interface + expression:
        raise LiveError("an interface or capture filter must not contain a NUL")
    if interface == "-":
        return open_stdin(wait_ms)
    known = _find(interface)
    if engine == "ring":
        return _open_ring(interface, known, expression, wait_ms, buffer_mib, promiscuous)
    try:
        return dumpcap.open_dumpcap(
            interface, expression, wait_ms, snaplen=snaplen, buffer_mib=buffer_mib, promiscuous=promiscuous
        )
    except UnavailableError:
        if engine != "auto" or known is None or ring.trouble() is not None:
            raise
    return _open_ring(interface, known, expression, wait_ms, buffer_mib, promiscuous)


def open_all(interfaces: Sequence[str], expression: str, engine: str, *, buffer_mib: int = BUFFER_MIB) -> LiveReader:
    """Return a reader of one interface, or of all of several. `LiveError` when one of them cannot be opened."""
    if len(interfaces) == 1:
        return open_live(interfaces[0], expression, engine, buffer_mib=buffer_mib)
    readers: list[LiveReader] = []
    try:
        for name in interfaces:  # one by one: open ones are closed if a later one cannot be opened
            reader = open_live(name, expression, engine, buffer_mib=buffer_mib)
            readers.append(reader)
    except BaseException:
        for reader in readers:
            reader.close()
        raise
    return SeveralReader(readers)


def engine_states() -> list[EngineState]:
    """Return which engines can capture here. dumpcap is tried on the loopback interface, or else on the first interface."""
    interfaces = list_interfaces(_program())
    tried = next((one.name for one in interfaces if one.loopback), interfaces[0].name if interfaces else "")
    states = []
    for name, error in ((ENGINES[0], dumpcap.trouble(tried)), (ENGINES[1], ring.trouble())):
        states.append(EngineState(name, str(error) if error else "", error.advice if error else ()))
    return states


def engines_for(interface: NetworkInterface, states: list[EngineState]) -> list[str]:
    """Return the engines that can capture on ``interface``."""
    usable = [state.name for state in states if not state.reason]
    return [name for name in usable if name != "ring" or interface.link_type >= 0]


def listed() -> list[NetworkInterface]:
    """Return the interfaces, as the kernel or dumpcap lists them."""
    return list_interfaces(_program())


def _program() -> str:
    try:
        return dumpcap.find_program()
    except LiveError:
        return ""


def _find(name: str) -> NetworkInterface | None:
    """Return the interface, None for one that only dumpcap knows (such as ``any``); `LiveError` when there is none.

    dumpcap also accepts a number, a named pipe or a remote machine as an interface; these are refused.
    """
    program = _program()
    interfaces = list_interfaces(program)
    found = next((one for one in interfaces if one.name == name), None)
    if found is None and name not in _special(program):
        raise LiveError(f"there is no interface {name!r}", advice.unknown_interface([one.name for one in interfaces]))
    return found


def _special(program: str) -> list[str]:
    """Return the names of all interfaces that dumpcap lists, also those that Windows shows: dumpcap accepts both."""
    if not program:
        return []
    lines = ask(program, "-D", "-M").stdout.decode("utf-8", "backslashreplace").splitlines()
    fields = [line.split("\t") for line in lines]
    return [name for row in fields for name in (row[0].partition(". ")[2], *row[2:3]) if name]


def _open_ring(
    name: str, known: NetworkInterface | None, expression: str, wait_ms: int, buffer_mib: int, promiscuous: bool
) -> LiveReader:
    if known is None:
        raise LiveError(f"{name}: only dumpcap can capture on it")
    return ring.open_ring(known, expression, wait_ms, buffer_mib=buffer_mib, promiscuous=promiscuous)
