"""Short phrases that all outputs share: packets, durations, sizes, values, items, how a transaction ended.

`Places` names a packet: by its number in a single file, by file and number within it in several. The pipeline counts packets
over the whole run, but a person looks for them in a file, and so may a program, so every output gives the number within the
file, and names the file as soon as there is more than one.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Final

from mypy_extensions import i64

from dissect.ibh.tables import IBH_NETLINK
from dissect.iso.cotp import Tpdu
from dissect.iso.tsap import Tsap
from dissect.iso.upper import EMPTY, S7COMM, S7COMM_PLUS, UPPER_NAMES, classify
from dissect.s7.blocks import BLOCK_COUNT
from dissect.s7.items import Item
from dissect.s7.message import Pdu
from dissect.s7.tables import BIT, BYTE, ELEMENT_OCTETS, RETURN_CODES
from dissect.s7.values import Value, decode_value, number_texts, spelled
from dissect.s7plus.tables import PARTIAL_ERROR
from dissect.source.packet import SourceFile
from dissect.tcp.stream import Endpoint
from dissect.transactions.connection import Connection
from dissect.transactions.naming import NamedValue, Naming
from dissect.transactions.results import ItemResult
from dissect.transactions.transaction import (
    ANSWERED,
    CAPTURE_ENDED,
    CONNECTION_CLOSED,
    CONNECTION_EVICTED,
    HOLE,
    ITEM,
    MESSAGE,
    NO_CODE,
    ORPHAN,
    PUSH,
    REFERENCE_REUSED,
    TABLE_FULL,
    Transaction,
    TransactionError,
)
from dissect.wire.codes import coded
from dissect.wire.text import Clock, decimal, duration_text, encodable, printable, shortened


class Places:
    """Finds packets of a run in its files.

    ``files`` may still grow while it is asked. ``several`` says whether file names are told, whatever was read so far.
    ``hosts`` are names of hosts by their address.
    """

    def __init__(self, files: Sequence[SourceFile], several: bool, hosts: Mapping[str, str] | None = None) -> None:
        self._files = files
        self.several = several
        self._hosts: dict[str, str] = {address: printable(name) for address, name in (hosts or {}).items()}

    def end(self, end: Endpoint) -> str:
        """Return an end of a connection as text for a person has it: address and port, the name of the host for its address."""
        if self._hosts:
            name = self._hosts.get(end.host)
            if name is not None:
                return f"{name}:{end.port}"
        return str(end)

    def host(self, end: Endpoint) -> str:
        """Return the address of an end of a connection as text for a person has it, or the name of the host."""
        return self.name(end.host)

    def name(self, host: str) -> str:
        """Return the name of a host by its address, or else the address."""
        return self._hosts.get(host, host)

    def locate(self, frame: int) -> tuple[str, int]:
        """Return (file name, number within that file) of the packet that is number ``frame`` of the run."""
        index = bisect_right(self._files, frame, key=lambda file: int(file.first_frame)) - 1
        file = self._files[max(index, 0)]
        return encodable(file.name), frame - int(file.first_frame) + 1

    def number(self, frame: int) -> int:
        """Return the number of a packet within its file."""
        return self.locate(frame)[1] if self.several else frame

    def mark(self, frame: int) -> str:
        """Return a packet as a line begins with it: ``12``, or ``NAME:12`` in several files."""
        if not self.several:
            return str(frame)
        name, number = self.locate(frame)
        return f"{printable(name)}:{number}"

    def pair(self, request_frame: int, response_frame: int) -> str:
        """Return the packets of a request and its answer, 0 for none: ``8→9``, ``8→?``, ``NAME:8→9``, ``ONE:8→OTHER:1``."""
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


def _numbered(numbers: Sequence[int]) -> str:
    return f"packet{'s' if len(numbers) > 1 else ''} {', '.join([str(number) for number in numbers])}"


#: What people call the protocols that TSDUs speak; the names of `UPPER_NAMES` are for programs.
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

#: Elements of an array, characters of a text and octets that are shown on a line.
_SHOWN: Final = 8
_SHOWN_TEXT: Final = 32
_SHOWN_OCTETS: Final = 16
#: Tags of one item that a line names.
_SHOWN_TAGS: Final = 16
#: Items or notes that a summary names, and characters of a note.
_NAMED: Final = 3
NOTE: Final = 100
REASONS: Final = {
    CONNECTION_CLOSED: "connection closed",
    CAPTURE_ENDED: "capture ends",
    HOLE: "gap in the capture",
    REFERENCE_REUSED: "reference used again",
    TABLE_FULL: "too many open",
    CONNECTION_EVICTED: "too many connections",
}


def duration(ns: int | None) -> str:
    """Return a duration in the unit that suits it, for example ``412 µs``, ``3.21 ms``, ``1.54 s``; ``-`` for none."""
    if ns is None:
        return "-"
    return duration_text(ns)


def span(clock: Clock, first_ns: int, last_ns: int) -> str:
    """Return the times of the first and the last packet; said where the last is earlier, as with captures in another order."""
    if last_ns >= first_ns:
        return f"{clock.moment(first_ns)} to {clock.moment(last_ns)}"
    return f"{clock.moment(first_ns)} back to {clock.moment(last_ns)} (packets are not in order of time)"


def size(octets: int) -> str:
    """Return a size for a person: ``512 B``, ``5.4 kB``, ``118.2 MB``."""
    for unit, factor in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if octets >= factor:
            return f"{octets / factor:.1f} {unit}"
    return f"{octets} B"


def count(number: int, one: str, many: str = "") -> str:
    """Return a number with its noun: ``1 packet``, ``31 packets``."""
    return f"{number} {one if number == 1 else many or one + 's'}"


def vlans(key: int) -> list[int]:
    """Return the VLAN ids of a connection, the outer tag first, from the number that holds them in twelve bits each."""
    vids: list[int] = []
    while key:
        key, vid = divmod(key, 4096)
        vids.append(vid)
    vids.reverse()
    return vids


def tsaps(calling: Tsap | None, called: Tsap | None, siemens: bool) -> str:
    """Return the TSAPs of a connection, ``?`` for one not captured; with rack and slot when it is ``siemens`` that speaks."""
    one = "?" if calling is None else printable(calling.describe(False) if siemens else _plain(calling))
    other = "?" if called is None else printable(called.describe() if siemens else _plain(called))
    return f"TSAP {one} → {other}"


def _plain(tsap: Tsap) -> str:
    return tsap.describe() if tsap.connection_type < 0 else str(tsap)


def value(shown: Value) -> str:
    """Return a decoded value on one line; long arrays and texts are cut with a note of how much there is."""
    if isinstance(shown, bool):
        return "true" if shown else "false"
    if isinstance(shown, str):
        if len(shown) > _SHOWN_TEXT:
            return f"'{printable(shown[:_SHOWN_TEXT])}'… ({len(shown)} characters)"
        return f"'{printable(shown)}'"
    if isinstance(shown, list):
        body = ", ".join([value(element) for element in shown[:_SHOWN]])
        return f"[{body}]" if len(shown) <= _SHOWN else f"[{body}, … {len(shown)} in all]"
    return "-" if shown is None else str(shown)


def octets(data: bytes) -> str:
    """Return octets as hexadecimal on one line, cut after 16 with a note of how many there are, and the text in them if any."""
    text = spelled(data)
    said = f" '{_cut(text)}'" if text else ""
    if len(data) <= _SHOWN_OCTETS:
        return (data.hex(" ") or "(empty)") + said
    return f"{data[:_SHOWN_OCTETS].hex(' ')} … {len(data)} bytes{said}"


def _cut(text: str) -> str:
    """Return a text cut to a line."""
    return printable(text if len(text) <= _SHOWN_TEXT else f"{text[:_SHOWN_TEXT]}…")


def address(item: Item) -> str:
    """Return the address of an item with its count where that is not one, for example ``DB10.DBW4 x3``."""
    if not item.shown:
        item.shown = shortened(item.label, 100)
    return item.shown


def item(result: ItemResult, number: int, naming: Naming | None = None) -> str:
    """Return one item with what became of it: ``DB10.DBW4 = 1234``, ``DB99.DBW0: Object does not exist``.

    With ``naming`` the tags it covers stand for its value: ``DB10.DBB0 x6: Tank.Level = 3.5 m, Tank.Pump = true``.
    """
    asked = result.item
    name = f"item {number}" if asked is None else address(asked)
    known = naming.named(result) if naming is not None else []
    if known:
        name = _with_names(name, known)
    elif result.data is not None:
        name += f" = {content(asked, result.data) if asked is not None else octets(result.data)}"
    if result.unchanged:
        return f"{name}: unchanged"
    return f"{name}: {RETURN_CODES.name(result.return_code)}" if result.refused else name


def _with_names(place: str, known: list[NamedValue]) -> str:
    """Return an item with its tags: one that is all of it stands in front of the address, several behind it."""
    if len(known) == 1:
        only = named_value(known[0])
        name, equals, content = only.partition(" = ")
        return f"{name} ({place}){equals}{content}"
    shown = [named_value(value) for value in known[:_SHOWN_TAGS]]
    more = f", … {len(known)} in all" if len(known) > _SHOWN_TAGS else ""
    return f"{place} {{{', '.join(shown)}{more}}}"


def named_value(known: NamedValue) -> str:
    """Return a value with its name and unit: ``Tank.Level = 3.5 m``; octets without a name by their address."""
    size = len(known.data)
    if not known.name:
        place = f"{known.address} x{size}" if size > 1 else known.address
        return f"{place}{f' ({known.remark})' if known.remark else ''} = {octets(known.data)}"
    name = shortened(known.name, 100)
    if known.value is None:
        why = f" ({printable(known.remark)})" if known.remark else ""
        return f"{name}{why} = {octets(known.data)}" if size else name
    unit = f" {shortened(known.unit, 20)}" if known.unit else ""
    return f"{name} = {value(known.value)}{unit}"


def content(asked: Item, data: bytes) -> str:
    """Return what was read or written: the value, and octets as such, with the text they spell where they spell one."""
    size: i64 = len(data)
    kind: i64 = asked.transport_size
    if (kind == BYTE and size != 1) or (asked.size != size and not asked.fits(size)):
        return octets(data)
    if kind == BIT and size == 1:
        return "true" if data[0] & 1 else "false"
    texts = number_texts(kind, data, False, _SHOWN)
    if not texts:
        decoded = decode_value(kind, data)
        return octets(data) if decoded is None else value(decoded)
    if len(texts) == 1:
        return texts[0]
    body = ", ".join(texts)
    count: i64 = size // ELEMENT_OCTETS[kind]
    return f"[{body}]" if count <= _SHOWN else f"[{body}, … {count} in all]"


def body_notes(pdu: Pdu) -> str:
    """Return what the parts of a PDU are about: the first few notes, and how many more there are.

    Of the numbers of blocks in a CPU, the types of which it has none are left out.
    """
    body = pdu.body
    counts = [part for part in body.parts if part.layout is BLOCK_COUNT]
    if not counts:
        return some_notes(body.notes)
    return some_notes([part.note for part in counts if part.number("block_count")]) or "no blocks"


def some_notes(found: list[str]) -> str:
    """Return the first few notes, and how many more there are."""
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    return ", ".join([shortened(note, NOTE) for note in found[:_NAMED]]) + more


def items_in_short(results: list[ItemResult], naming: Naming | None = None) -> str:
    """Return the items that failed, or else the first few of all, without values; empty when there are none."""
    numbered = list(enumerate(results, 1))
    refused = [(number, result) for number, result in numbered if result.refused]
    if refused:
        some = [item(result, number, naming) for number, result in refused[:_NAMED]]
        total = f"{len(refused)} of {count(len(results), 'item')} refused: " if len(results) > 1 else ""
        return total + ", ".join(some) + (", …" if len(refused) > _NAMED else "")
    names = [_short_name(result, number, naming) for number, result in numbered]
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


def _short_name(result: ItemResult, number: int, naming: Naming | None) -> str:
    """Return the address of an item, and the tags that it covers: ``Tank.Level (DB1.DBD0)``, ``DB1.DBB0 x10 (3 tags)``."""
    if result.item is None:
        return f"item {number}"
    known = [value.name for value in naming.named(result) if value.name] if naming is not None else []
    if not known:
        return address(result.item)
    place = address(result.item)
    return f"{shortened(known[0], 100)} ({place})" if len(known) == 1 else f"{place} ({len(known)} tags)"


def error_text(error: TransactionError) -> str:
    """Return an error: a code of S7 as it stands on the wire with its name, one of SCD with what it means."""
    if error.part == MESSAGE:
        return f"{error.name} {error.code}: {printable(error.text)}"
    if error.code == NO_CODE:
        return error.name
    return coded(f"0x{error.code:02x}" if error.part == ITEM else f"0x{error.code:04x}", error.name)


def outcome(transaction: Transaction) -> str:
    """Return how a transaction ended, empty when all went well."""
    why = f" ({REASONS.get(transaction.reason, transaction.reason)})" if transaction.reason else ""
    if transaction.outcome == ORPHAN:
        said = f"answer without request{why}"
    elif transaction.outcome == PUSH:
        said = "one way" if transaction.request_frame else "push"
    elif transaction.outcome == ANSWERED:
        said = ""
    else:
        said = f"NO ANSWER{why}"
    if transaction.error_code and transaction.has_errors:
        error = transaction.errors[0]
        word = "PARTLY REFUSED" if transaction.is_plus and error.code == PARTIAL_ERROR else "REFUSED"
        refused = f"{word} {error_text(error)}"
        said = f"{said}, {refused}" if said else refused
    return said


def carried(tpdu: Tpdu) -> str:
    """Return what people call the protocol of the user data of a DT or ED; empty when there is no data, or S7comm."""
    return message_name(tpdu.data)


def message_name(octets: bytes) -> str:
    """Return what people call the protocol of a message; empty when there is none, or one whose PDUs have own lines."""
    upper = classify(octets, 0, len(octets))
    return "" if upper in {S7COMM, S7COMM_PLUS, EMPTY} else PROTOCOLS[UPPER_NAMES[upper]]


def named(connection: Connection) -> str:
    """Return what people call the protocol of a connection and what identifies it, empty when nothing was said on it."""
    name = PROTOCOLS.get(connection.protocol, printable(connection.protocol))
    return f"{name} ({connection.identified_by})" if connection.identified_by else name
