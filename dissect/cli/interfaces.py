"""`s7dissect interfaces`: the network interfaces, which engine can capture on them, and what to do if none can."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.formats import format_option, write_outcome
from dissect.cli.main import EXIT_OK
from dissect.meaning.report.formats import OUTCOME, Format
from dissect.meaning.report.outcome import Outcome, plain
from dissect.meaning.report.styled import Line
from dissect.wire.text import encodable, printable

if TYPE_CHECKING:
    from dissect.packets.source.live.interfaces import NetworkInterface
    from dissect.packets.source.live.opening import EngineState

INTERFACES_SCHEMA: Final = "s7dissect.interfaces/1"

_HEADINGS: Final = ("INTERFACE", "STATE", "LINK", "CAPTURE WITH", "ADDRESSES")


@click.command(
    "interfaces",
    epilog="Exit code: 0 success, also if nothing can capture, 2 wrong use, 5 the output could not be written.",
)
@format_option(OUTCOME)
def command(format_: Format) -> int:
    """List the network interfaces: state, link type, addresses, and which engine can capture on each.

    dumpcap (part of Wireshark) has its own privileges and is preferred; the ring is the kernel's own interface and needs
    CAP_NET_RAW. If one of them cannot capture, the remedy follows the list.
    """
    from dissect.packets.source.live.opening import engine_states, listed

    write_outcome(format_, OUTCOME, _Interfaces(listed(), engine_states()))
    return EXIT_OK


class _Interfaces(Outcome):
    """The interfaces, and the abilities of the engines."""

    def __init__(self, interfaces: list[NetworkInterface], states: list[EngineState]) -> None:
        self._interfaces = interfaces
        self._states = states

    def text(self) -> Iterator[Line]:
        """Return a table, and what to do if an engine cannot capture."""
        return plain(_as_text(self._interfaces, self._states))

    def as_dict(self) -> dict[str, object]:
        """Return all their data."""
        return _as_dict(self._interfaces, self._states)


def _as_text(interfaces: list[NetworkInterface], states: list[EngineState]) -> Iterator[str]:
    from dissect.packets.source.live.opening import engines_for

    rows: list[tuple[str, ...]] = [_HEADINGS]
    for one in interfaces:
        engines = ", ".join(engines_for(one, states)) or "-"
        cells = (one.name, one.state or "?", one.link_name or "?", engines, " ".join(one.addresses) or "-")
        rows.append(tuple([printable(cell) for cell in cells]))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join([cell.ljust(width) for cell, width in zip(row, widths, strict=True)]).rstrip()
    if not interfaces:
        yield "no interfaces, or none visible to this user"
    for state in states:
        if state.reason:
            yield ""
            yield f"{state.name} cannot capture: {printable(state.reason)}"
            for line in state.advice:
                yield f"    {printable(line)}"


def _as_dict(interfaces: list[NetworkInterface], states: list[EngineState]) -> dict[str, object]:
    from dissect.packets.source.live.opening import engines_for

    return {
        "schema": INTERFACES_SCHEMA,
        "interfaces": [
            {
                "name": encodable(one.name),
                "number": one.number,
                "state": one.state or None,
                "loopback": one.loopback,
                "link_type": one.link_type if one.link_type >= 0 else None,
                "link": one.link_name or None,
                "mac": one.mac or None,
                "mtu": one.mtu or None,
                "addresses": list(one.addresses),
                "engines": engines_for(one, states),
            }
            for one in interfaces
        ],
        "engines": [
            {
                "name": state.name,
                "usable": not state.reason,
                "reason": encodable(state.reason) or None,
                "advice": [encodable(line) for line in state.advice],
            }
            for state in states
        ],
    }
