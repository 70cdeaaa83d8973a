"""Tables of figures, as text and as Markdown."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.measure import Cost

HEADS = ("engine", "packets", "CPU s", "k packets/s", "µs/packet", "peak MB", "x tshark -T fields")


class Row:
    """The cost of one engine on one file; ``ratio`` is how many times faster than the yardstick (0: not measured)."""

    __slots__ = ("cost", "label", "packets", "ratio")

    def __init__(self, label: str, packets: int, cost: Cost, ratio: float) -> None:
        self.label = label
        self.packets = packets
        self.cost = cost
        self.ratio = ratio

    def cells(self) -> tuple[str, ...]:
        """Return the texts of the line."""
        rate = self.packets / self.cost.cpu_s / 1000
        return (
            self.label,
            f"{self.packets:,}",
            f"{self.cost.cpu_s:.2f}",
            f"{rate:,.1f}" if rate < 100 else f"{rate:,.0f}",
            f"{self.cost.cpu_s / self.packets * 1e6:.2f}",
            f"{self.cost.peak_mb:.0f}",
            f"{self.ratio:.1f}" if self.ratio else "-",
        )

    def as_dict(self) -> dict[str, object]:
        """Return the figures as JSON-ready values."""
        return {
            "engine": self.label,
            "packets": self.packets,
            "cpu_s": self.cost.cpu_s,
            "wall_s": self.cost.wall_s,
            "peak_mb": self.cost.peak_mb,
            "ratio": self.ratio,
        }


def columns(heads: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return lines in columns, the first aligned left, the others right."""
    widths = [max(len(line[at]) for line in (heads, *lines)) for at in range(len(heads))]
    shown: list[str] = []
    for line in (heads, *lines):
        padded = [line[0].ljust(widths[0])]
        padded += [cell.rjust(width) for cell, width in zip(line[1:], widths[1:], strict=True)]
        shown.append("  ".join(padded).rstrip())
    return "\n".join(shown)


def piped(heads: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return lines as a Markdown table, the first column aligned left, the others right."""
    marks = ["---", *["---:"] * (len(heads) - 1)]
    return "".join("| " + " | ".join(line) + " |\n" for line in (heads, marks, *lines))


def text(rows: Sequence[Row]) -> str:
    """Return the comparison as text."""
    return columns(HEADS, [row.cells() for row in rows])


def markdown(rows: Sequence[Row]) -> str:
    """Return the comparison as Markdown."""
    return piped(HEADS, [row.cells() for row in rows])
