"""Write the tables of docs/mc7.md from the table of instructions: `python scripts/mc7_doc.py > docs/mc7.md`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from dissect.protocols.mc7.block import FACTS
from dissect.protocols.mc7.checks import TAMPERED
from dissect.protocols.mc7.hazards import SYSTEM_CALLS
from dissect.protocols.mc7.instruction_tables import GERMAN, INSTRUCTIONS, MEANINGS, Row, confidence

PAGE = Path(__file__).resolve().parent.parent / "docs" / "mc7.md"
BEGIN, END = "<!-- {} -->\n", "<!-- end of {} -->\n"


def octets(row: Row) -> str:
    """Return the first word of a row in hexadecimal digits: a range of first bytes, and the second bytes."""
    first = f"{row.firsts[0]:02X}" + (f"-{row.firsts[-1]:02X}" if len(row.firsts) > 1 else "")
    return f"`{first} {seconds(sorted(row.seconds))}`"


def seconds(numbers: list[int]) -> str:
    """Return numbers as ranges: ``10-17 20-27``."""
    if len(numbers) == 256:
        return "xx"
    ranges: list[list[int]] = []
    for number in numbers:
        if ranges and ranges[-1][1] == number - 1:
            ranges[-1][1] = number
        else:
            ranges.append([number, number])
    parts = [f"{low:02X}" if low == high else f"{low:02X}-{high:02X}" for low, high in ranges]
    return " ".join(parts) if len(parts) <= 4 else f"{parts[0]} … {parts[-1]}"


def sure(row: Row) -> str:
    """Return the certainty of a row: found in real blocks, or the number of its sources; empty if all of it was found."""
    kinds = {confidence(first, second) for first in row.firsts for second in row.seconds}
    if kinds == {"C"}:
        return ""
    return "in part 2" if "C" in kinds else min(kinds)


def instructions() -> Iterator[str]:
    """Yield the table of instructions, by mnemonic."""
    yield "| STL | AWL | bytes | first word | operand | meaning | sources |"
    yield "|---|---|---|---|---|---|---|"
    for row in sorted(INSTRUCTIONS, key=lambda row: (row.name, row.firsts[0], min(row.seconds))):
        title = row.shape.title if row.shape.title != "none" else ""
        size = f"{row.size} + list" if row.list else str(row.size)
        cells = [row.name, GERMAN.get(row.name, row.name), size, octets(row), title, MEANINGS[row.name], sure(row)]
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def facts() -> Iterator[str]:
    """Yield the table of facts."""
    yield "| fact | | of `block.inconsistent` |"
    yield "|---|---|---|"
    for slug, text in FACTS.items():
        yield f"| `{slug}` | {text} | {'yes' if slug in TAMPERED else ''} |"


def system_calls() -> Iterator[str]:
    """Yield the table of system functions."""
    yield "| SFC | name | |"
    yield "|---|---|---|"
    for number, (name, _, text) in SYSTEM_CALLS.items():
        yield f"| {number} | {name} | {text} |"


def document(text: str) -> str:
    """Return the page with its tables made anew."""
    for name, lines in (("instructions", instructions()), ("facts", facts()), ("system functions", system_calls())):
        begin = text.index(BEGIN.format(name)) + len(BEGIN.format(name))
        end = text.index(END.format(name), begin)
        text = text[:begin] + "\n".join(lines) + "\n" + text[end:]
    return text


if __name__ == "__main__":
    print(document(PAGE.read_text(encoding="utf-8")), end="")
