"""Short phrases that all outputs share: packets, durations, sizes, values, protocols.

`Places` names a packet: by its number if there is a single file, by file and number in the file if there are several. The
pipeline counts packets over the whole run, but users look for them in a file. So every output gives the number in the file, and
also the file if there are several.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.packets.source.packet import SourceFile
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.ibh.tables import IBH_NETLINK
from dissect.protocols.iso.cotp import Tpdu
from dissect.protocols.iso.tsap import Tsap
from dissect.protocols.iso.upper import EMPTY, S7COMM, S7COMM_PLUS, UPPER_NAMES, classify
from dissect.protocols.s7.values import Value, spelled
from dissect.wire.text import Clock, decimal, duration_text, encodable, printable, shortened, some
from dissect.wire.text import count as count  # noqa: PLC0414 - it is one of the words of reports as well


class Places:
    """Finds packets of a run in its files.

    ``files`` may grow during the run. ``several`` says whether outputs name files; it does not depend on how many were
    read so far. ``hosts`` are names of hosts by address.
    """

    def __init__(self, files: Sequence[SourceFile], several: bool, hosts: Mapping[str, str] | None = None) -> None:
        self._files = files
        self._latest: int = -1  # index of the file that `locate` returned last, and its name as text
        self._name: str = ""
        self.several = several
        self._hosts: dict[str, str] = {address: printable(name) for address, name in (hosts or {}).items()}
        self._in_text: re.Pattern[str] = re.compile("|".join([_in_text(address) for address in self._hosts]))

    def end(self, end: Endpoint) -> str:
        """Return an end of a connection as text: address and port; the name of the host instead of a known address."""
        if self._hosts:
            name = self._hosts.get(end.host)
            if name is not None:
                return f"{name}:{end.port}"
        return str(end)

    def host(self, end: Endpoint) -> str:
        """Return the name of the host at an end of a connection, or its address if it has no name."""
        return self.name(end.host)

    def name(self, host: str) -> str:
        """Return the name of the host with an address, or the address if it has no name."""
        return self._hosts.get(host, host)

    def named(self, text: str) -> str:
        """Return a text, such as the detail of a finding, with the names of hosts for their addresses."""
        if not self._hosts:
            return text
        return self._in_text.sub(self._name_of, text)

    def _name_of(self, found: re.Match[str]) -> str:
        return self._hosts[found[0].strip("[]")]

    def locate(self, frame: int) -> tuple[str, int]:
        """Return (file name, number within that file) of the packet that is number ``frame`` of the run."""
        files = self._files
        index = self._latest
        behind = index + 1
        # Packets are mostly looked up in the order of the run; a file may have been added after the latest one.
        is_behind = behind < len(files) and frame >= files[behind].first_frame
        if index < 0 or is_behind or frame < files[index].first_frame:
            self._latest = index = max(bisect_right(files, frame, key=lambda file: int(file.first_frame)) - 1, 0)
            self._name = encodable(files[index].name)
        return self._name, frame - int(files[index].first_frame) + 1

    def number(self, frame: int) -> int:
        """Return the number of a packet within its file."""
        return self.locate(frame)[1] if self.several else frame

    def mark(self, frame: int) -> str:
        """Return a packet for the beginning of a line: ``12``, or ``NAME:12`` if there are several files."""
        if not self.several:
            return str(frame)
        name, number = self.locate(frame)
        return f"{printable(name)}:{number}"

    def pair(self, request_frame: int, response_frame: int) -> str:
        """Return the packets of a request and its answer: ``8→9``, ``8→?``, ``NAME:8→9``, ``ONE:8→OTHER:1``; 0 means none."""
        asked = self.mark(request_frame) if request_frame else "?"
        if not response_frame:
            return f"{asked}→?"
        if not request_frame:
            answered = self.mark(response_frame)
            name, colon, number = answered.rpartition(":")
            return f"{name}{colon}?→{number}"
        if not self.several:
            return f"{decimal(request_frame)}→{decimal(response_frame)}"
        same = self.locate(request_frame)[0] == self.locate(response_frame)[0]
        return f"{asked}→{self.number(response_frame) if same else self.mark(response_frame)}"

    def phrase(self, frames: Sequence[int]) -> str:
        """Return packets in words: ``packet 8``, ``packets 8, 9``, ``packets 8, 9 of NAME``; ``the capture`` for none."""
        if not frames:
            return "the capture"
        if not self.several:
            return _numbered(frames)
        by_file: dict[str, list[int]] = {}
        for frame in frames:
            name, number = self.locate(frame)
            by_file.setdefault(name, []).append(number)
        return ", ".join([f"{_numbered(numbers)} of {printable(name)}" for name, numbers in by_file.items()])


def _in_text(address: str) -> str:
    """Return a pattern that finds an address in a text: 10.0.0.1 is part of neither 10.0.0.10 nor 10.0.0.1.2."""
    alone = rf"(?<![\w.:\[]){re.escape(address)}(?!\w|\.\w)"
    # Before a port, an IPv6 address is in brackets; without a port, a colon after it belongs to a longer address.
    return rf"\[{re.escape(address)}\](?=:)|{alone}(?!:)" if ":" in address else alone


def _numbered(numbers: Sequence[int]) -> str:
    return f"packet{'s' if len(numbers) > 1 else ''} {', '.join([str(number) for number in numbers])}"


#: Names of the protocols in TSDUs for people; those of `UPPER_NAMES` are for programs.
PROTOCOLS: Final = {
    "s7comm": "S7comm",
    "s7comm_plus": "S7comm-plus",
    "mms": "MMS",
    "tls": "TLS",
    "rdp": "RDP",
    "scd": "SCD",
    "unknown": "unknown protocol",
    IBH_NETLINK: "IBH-NetLink",
}

#: Width of columns in lines: number of a transaction or operation, its packets, its answer time. Longer ones shift the line.
NUMBER_WIDTH: Final = 5
FRAMES_WIDTH: Final = 12
LATENCY_WIDTH: Final = 8
#: Maximum number of elements of an array, characters of a text and octets that a line shows. Times are not cut: an LTIME has up
#: to 35 characters.
SHOWN: Final = 8
SHOWN_TEXT: Final = 36
SHOWN_OCTETS: Final = 16
#: Maximum number of items or notes in a summary, and of characters of a note.
NAMED: Final = 3
NOTE: Final = 100


def duration(ns: int | None) -> str:
    """Return a duration in a fitting unit, for example ``412 µs``, ``3.21 ms``, ``1.54 s``; ``-`` for None."""
    if ns is None:
        return "-"
    return duration_text(ns)


def answer_time(ns: int | None) -> str:
    """Return the answer time; ``?`` if the answer was captured before its request, so that the time is unknown."""
    return "?" if ns is not None and ns < 0 else duration(ns)


def span(clock: Clock, first_ns: int, last_ns: int) -> str:
    """Return the times of the first and the last packet, with a remark if the last one is earlier."""
    if last_ns >= first_ns:
        return f"{clock.moment(first_ns)} to {clock.moment(last_ns)}"
    return f"{clock.moment(first_ns)} back to {clock.moment(last_ns)} (packets are not in order of time)"


def size(octets: int) -> str:
    """Return a size as text: ``512 B``, ``5.4 kB``, ``118.2 MB``."""
    for unit, factor in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if octets >= factor:
            return f"{octets / factor:.1f} {unit}"
    return f"{octets} B"


def percent(part: int, whole: int) -> str:
    """Return a share as text: ``4.5 %``; below a twentieth of a percent ``less than 0.1 %``."""
    share = part / whole * 100 if whole else 0.0
    return "less than 0.1 %" if part and share < 0.05 else f"{share:.1f} %"


def tsaps(calling: Tsap | None, called: Tsap | None, protocol: str) -> str:
    """Return the TSAPs of a connection that speaks ``protocol``; ``?`` for a TSAP that was not captured."""
    one = "?" if calling is None else printable(calling.means(protocol, False))
    other = "?" if called is None else printable(called.means(protocol))
    return f"TSAP {one} → {other}"


def value(shown: Value, data: bytes = b"") -> str:
    """Return a decoded value on one line; long arrays and texts are cut, with their length.

    ``data``: the bytes of the value, which are shown for elements that do not fit their type.
    """
    if isinstance(shown, bool):
        return "true" if shown else "false"
    if isinstance(shown, str):
        if len(shown) > SHOWN_TEXT:
            return f"'{printable(shown[:SHOWN_TEXT])}'… ({len(shown)} characters)"
        return f"'{printable(shown)}'"
    if isinstance(shown, list):
        size = len(data) // len(shown) if shown else 0
        body = ", ".join(
            [
                data[at * size : (at + 1) * size].hex(" ") if element is None and size else value(element)
                for at, element in enumerate(shown[:SHOWN])
            ]
        )
        return f"[{body}]" if len(shown) <= SHOWN else f"[{body}, … {len(shown)} in all]"
    return "-" if shown is None else str(shown)


def octets(data: bytes) -> str:
    """Return octets in hexadecimal, after `SHOWN_OCTETS` only their number, and the text that they spell, if any."""
    text = spelled(data)
    said = f" '{_cut(text)}'" if text else ""
    if len(data) <= SHOWN_OCTETS:
        return (data.hex(" ") or "(empty)") + said
    return f"{data[:SHOWN_OCTETS].hex(' ')} … {len(data)} bytes{said}"


def _cut(text: str) -> str:
    """Return a text cut after `SHOWN_TEXT` characters."""
    return printable(text if len(text) <= SHOWN_TEXT else f"{text[:SHOWN_TEXT]}…")


def some_notes(found: list[str], most: int = NAMED) -> str:
    """Return the first few notes, and the number of the others."""
    return some([shortened(note, NOTE) for note in found], most)


def explained(counts: Mapping[str, int]) -> str:
    """Return the findings that a cause explains, in words: ``transaction.unanswered (3 times), session.cut``."""
    return ", ".join([f"{slug} ({times} times)" if times > 1 else slug for slug, times in counts.items()])


def loss_of(octets: int) -> str:
    """Return a text for a file that is incomplete after this many octets."""
    return "damaged" if octets else "not read"


def carried(tpdu: Tpdu) -> str:
    """Return the name of the protocol in the user data of a DT or ED; empty as for `message_name`."""
    return message_name(tpdu.data)


def message_name(octets: bytes) -> str:
    """Return the name of the protocol of a message; empty for no data, and for protocols whose PDUs have their own lines."""
    upper = classify(octets, 0, len(octets))
    return "" if upper in {S7COMM, S7COMM_PLUS, EMPTY} else PROTOCOLS[UPPER_NAMES[upper]]


def named(connection: Connection) -> str:
    """Return the name of a connection's protocol, and how it was identified; empty if no data was seen."""
    name = PROTOCOLS.get(connection.protocol, printable(connection.protocol))
    return f"{name} ({connection.identified_by})" if connection.identified_by else name
