"""Write docs/s7plus-coverage.md: the decoded parts of S7comm-plus, and how often they occur in the public captures.

PYTHONPATH=. python scripts/s7plus_coverage_doc.py FOLDER > docs/s7plus-coverage.md

FOLDER contains the public captures; those in its folder ``s7plus`` are read as well.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from dissect.engine.observer import Observer
from dissect.engine.transactions.side import Side
from dissect.files.session import Run
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.id_tables import IDS, MEMBERS, MEMORY
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.tables import (
    FUNCTIONS,
    NOTIFICATION,
    NOTIFIED,
    OPCODES,
    REQUEST,
    RESPONSE,
    RESPONSE2,
    TAGS,
    V3,
)
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, ARRAY, SPARSE_ARRAY, VALUE_TYPES
from dissect.wire.codes import CodeTable
from dissect.wire.part import Part

ROOT: Final = Path(__file__).resolve().parents[1]
PAGE: Final = ROOT / "docs" / "s7plus-coverage.md"

HEAD: Final = (
    "# Coverage of S7comm-plus",
    "",
    "Made from the tables and the public captures (`scripts/s7plus_coverage_doc.py`); a test keeps it so.",
    "",
    "- *decoded as*: the structures that its PDUs are cut into, from the first byte behind the head to the last of the PDU",
    "- *seen*: PDUs, or occurrences, in the captures; `-` where there was none, so that it is known from sources only",
    "- *compared*: responses whose integrity id is that of their request plus the sequence number, where both have one; of",
    "  types, elements and ids those in such requests and responses: had one been read wrongly, the id behind it would differ",
    "",
)


class Census(Observer):
    """Counts the contents of the PDUs of captures."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_pdus = True
        self.pdus = 0
        self.whole = 0
        self.functions: Counter[tuple[int, int, int]] = Counter()  # function, opcode, version
        self.structures: dict[tuple[int, int], dict[str, None]] = {}
        self.types: Counter[tuple[int, str]] = Counter()
        self.tags: Counter[int] = Counter()
        self.notified: Counter[int] = Counter()
        self.ids: Counter[int] = Counter()
        self.memory: Counter[int] = Counter()  # members with their own name
        self.compared_types: Counter[int] = Counter()
        self.compared_tags: Counter[int] = Counter()
        self.compared_ids: Counter[int] = Counter()
        self.compared_memory: Counter[int] = Counter()
        self.pairs: Counter[int] = Counter()
        self.broken: Counter[int] = Counter()
        self._asked: dict[tuple[int, int, int], Contents] = {}

    def of(self, path: Path) -> None:
        """Read a capture."""
        self._asked = {}
        run = Run([str(path)], self)
        while run.step():
            pass
        run.finish()

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Count a PDU (`Observer`)."""
        pdu = parse_plus(octets, frame, time_ns, side.connection.number, side.index, cut)
        found = parse_contents(pdu)
        self.pdus += 1
        self.whole += not (cut or pdu.malformed or found.malformed)
        if pdu.opcode in OPCODES:
            self.functions[pdu.function, pdu.opcode, pdu.version] += 1
            names = self.structures.setdefault((pdu.function, pdu.opcode), {})
            names.update(dict.fromkeys([part.layout.name for part in found.parts]))
        self._count(found)
        self._pair(pdu, found)

    def _count(self, found: Contents) -> None:
        for part in found.parts:
            kind = part.number("type")
            if part.find("flags") is not None and kind in VALUE_TYPES:
                self.types[kind, _form(part.number("flags"))] += 1
            if part.find("tag") is not None:
                self.tags[part.number("tag")] += 1
            if part.find("reference") is not None or part.layout.name == "notified objects":
                self.notified[part.number("kind")] += 1
            self.ids.update(_ids(part))
            self.memory.update(_memory(part))

    def _compare(self, found: Contents) -> None:
        """Count the contents of a request or response whose integrity id is right."""
        for part in found.parts:
            kind = part.number("type")
            if part.find("flags") is not None and kind in VALUE_TYPES:
                self.compared_types[kind] += 1
            if part.find("tag") is not None:
                self.compared_tags[part.number("tag")] += 1
            self.compared_ids.update(_ids(part))
            self.compared_memory.update(_memory(part))

    def _pair(self, pdu: PlusPdu, found: Contents) -> None:
        key = (pdu.connection, pdu.side if pdu.opcode == REQUEST else 1 - pdu.side, pdu.sequence)
        if pdu.opcode == REQUEST and found.integrity_id >= 0:
            self._asked[key] = found
        elif pdu.opcode == RESPONSE and found.integrity_id >= 0 and key in self._asked:
            asked = self._asked.pop(key)
            if found.integrity_id == (asked.integrity_id + pdu.sequence) & 0xFFFFFFFF:
                self.pairs[pdu.function] += 1
                self._compare(asked)
                self._compare(found)
            else:
                self.broken[pdu.function] += 1


def _ids(part: Part) -> list[int]:
    values = [part.find(name) for name in ("id", "class", "sub_area")]
    found = [value.value for value in values if value is not None and value.octets is None]
    return found if not _memory(part) else []


def _memory(part: Part) -> list[int]:
    id_ = part.find("id")
    return [id_.value] if id_ is not None and id_.field.codes is MEMBERS and 0 < id_.value <= len(MEMORY) else []


def _form(flags: int) -> str:
    if flags & SPARSE_ARRAY:
        return "sparse"
    return "array" if flags & (ARRAY | ADDRESS_ARRAY) else "scalar"


def census(folder: Path) -> Census:
    """Read the public captures."""
    found = Census()
    for path in [*sorted(folder.glob("*.pc*")), *sorted((folder / "s7plus").glob("*.pc*"))]:
        found.of(path)
    return found


def document(found: Census) -> str:
    """Return the page."""
    lines = [*HEAD, f"{found.whole} of {found.pdus} PDUs are read to their last byte.", ""]
    lines += [
        "## Functions",
        "",
        "| function | PDU | decoded as | seen V1 / V2 / V3 | compared |",
        "|---|---|---|---|---|",
    ]
    for row in FUNCTIONS:
        for opcode in (REQUEST, RESPONSE):
            lines.append(_function(found, row.number, f"`0x{row.number:04x}` {row.name}", opcode))
        if any([function == row.number and opcode == RESPONSE2 for function, opcode, _ in found.functions]):
            lines.append(_function(found, row.number, f"`0x{row.number:04x}` {row.name}", RESPONSE2))
    lines.append(_function(found, -1, "none", NOTIFICATION))
    lines += [
        "",
        "## Value types",
        "",
        "| type | scalars | arrays | sparse arrays | compared |",
        "|---|---|---|---|---|",
    ]
    for row in VALUE_TYPES:
        counts = [_count(found.types[row.number, form]) for form in ("scalar", "array", "sparse")]
        counts.append(_count(found.compared_types[row.number]))
        lines.append(f"| `0x{row.number:02x}` {row.name} | {' | '.join(counts)} |")
    lines += _values("Elements of objects", "element", TAGS, found.tags, found.compared_tags)
    lines += _values(
        "Items of notifications", "item", NOTIFIED, found.notified, Counter()
    )  # which have no integrity id
    lines += _values("Ids", "id", IDS, found.ids, found.compared_ids)
    names = CodeTable("", 1, MEMORY)
    lines += _values("Members of the memory of a block or an area", "id", names, found.memory, found.compared_memory)
    unnamed = [number for number in sorted(found.ids) if number not in IDS and number]
    lines += ["", f"Seen without a name: {', '.join([str(number) for number in unnamed])}.", ""]
    return "\n".join(lines)


def _function(found: Census, function: int, name: str, opcode: int) -> str:
    counts = [found.functions[function, opcode, version] for version in range(1, V3 + 1)]
    structures = found.structures.get((function, opcode), {})
    pairs, broken = found.pairs[function], found.broken[function]
    compared = f"{pairs} of {pairs + broken}" if opcode == RESPONSE and pairs + broken else ""
    seen = " / ".join([str(count) for count in counts]) if any(counts) else "-"
    return f"| {name} | {OPCODES.name(opcode)} | {', '.join(structures)} | {seen} | {compared} |"


def _values(title: str, column: str, table: CodeTable, counts: Counter[int], compared: Counter[int]) -> Iterator[str]:
    yield from ("", f"## {title}", "", f"| {column} | seen | compared |", "|---|---|---|")
    for row in table:
        number = str(row.number) if table.digits == 1 else f"`0x{row.number:02x}`"
        yield f"| {number} {row.name} | {_count(counts[row.number])} | {_count(compared[row.number])} |"


def _count(number: int) -> str:
    return str(number) if number else "-"


if __name__ == "__main__":
    sys.stdout.write(document(census(Path(sys.argv[1]))))
