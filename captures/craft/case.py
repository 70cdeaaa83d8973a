"""A crafted capture: its packets, and the expected results of a reader, stated where the packets are made."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable
from typing import NamedTuple

from captures.craft.container import ETHERNET, Packet, write_pcapng

START_NS = 1_700_000_000_000_000_000
"""2023-11-14 22:13:20 UTC: when every crafted capture begins."""
STEP_NS = 500_000
"""From one packet to the next, where nothing else is said."""

COUNTS = (
    "packets",
    "truncated",
    "connections",
    "s7_pdus",
    "answered",
    "unanswered",
    "orphan_answers",
    "unsolicited",
    "item_errors",
    "header_errors",
)
"""The keys of ``[expected]`` that are there in every file; captures/README.md says what each counts."""


class TsharkCount(NamedTuple):
    """The number of S7 PDUs that tshark 4.0.17 shows, if it differs from the real number, and why."""

    s7_pdus: int
    why: str


class Case:
    """Packets in the order of the file, and the expectations that grow with them.

    ``write`` makes the file of the packets; ``link_types`` are those of its interfaces. ``exit_code`` is the expected exit code
    of the command line.
    """

    def __init__(self, name: str, purpose: str) -> None:
        self.name = name
        self.purpose = purpose
        self.suffix = "pcapng"
        self.ports = [102]
        self.exit_code = 0
        self.now_ns = START_NS
        self.packets: list[Packet] = []
        self.link_types: list[int] = [ETHERNET]
        self.write: Callable[[Case], bytes] = lambda case: write_pcapng(case.packets, case.link_types)
        self.counts: Counter[str] = Counter()
        self.functions: Counter[int] = Counter()
        self.findings: Counter[str] = Counter()
        self.reasons: Counter[str] = Counter()
        self.loss: Counter[str] = Counter()
        self.tables: dict[str, Counter[str]] = {}
        self.tshark: TsharkCount | None = None

    # ---- packets ----------------------------------------------------------------------------------------------------

    def put(self, *frames: bytes, wire: int = 0, interface: int = 0, comment: str = "") -> None:
        """Capture frames, one `STEP_NS` after the other; ``wire`` is their size on the wire when they are cut."""
        for octets in frames:
            self.packets.append(Packet(self.now_ns, octets, wire or len(octets), interface, comment))
            self.counts["packets"] += 1
            self.now_ns += STEP_NS

    def pause(self, milliseconds: float) -> None:
        """Let time pass."""
        self.now_ns += int(milliseconds * 1_000_000)

    # ---- expectations -----------------------------------------------------------------------------------------------

    def pair(self, *functions: int) -> None:
        """A request and its answer for each function."""
        for function in functions:
            self.pdu(function, function)
            self.counts["answered"] += 1

    def pdu(self, *functions: int) -> None:
        """Number of PDUs by function; -1 for PDUs without parameters, which have no function."""
        for function in functions:
            self.counts["s7_pdus"] += 1
            if function >= 0:
                self.functions[function] += 1

    def unanswered(self, function: int, reason: str) -> None:
        """A request without an answer, and the reason."""
        self.pdu(function)
        self.counts["unanswered"] += 1
        self.reasons[reason] += 1

    def orphan(self, function: int) -> None:
        """An answer without a captured request."""
        self.pdu(function)
        self.counts["orphan_answers"] += 1

    def push(self, function: int) -> None:
        """An unsolicited message."""
        self.pdu(function)
        self.counts["unsolicited"] += 1

    def count(self, **counts: int) -> None:
        """Other counts: ``truncated``, ``connections``, ``item_errors``, ``header_errors``."""
        self.counts.update(counts)

    def find(self, slug: str, times: int = 1) -> None:
        """A finding."""
        self.findings[slug] += times

    def lose(self, octets: int, gaps: int = 1) -> None:
        """Octets of a connection that are missing from the capture, in this many gaps."""
        self.loss["gaps"] += gaps
        self.loss["octets_missing"] += octets

    def skip(self, octets: int) -> None:
        """Captured octets that belong to no complete TPKT."""
        self.loss["octets_skipped"] += octets

    def table(self, name: str, **counts: int) -> None:
        """Counts by name: ``tpdus``, ``tsdus``, ``ignored`` (packets not used, by reason)."""
        self.tables.setdefault(name, Counter()).update(counts)

    def tshark_shows(self, s7_pdus: int, why: str) -> None:
        """Note that tshark shows a different number of S7 PDUs from those that are there."""
        self.tshark = TsharkCount(s7_pdus, why)

    # ---- files ------------------------------------------------------------------------------------------------------

    @property
    def file(self) -> str:
        """The name of the capture."""
        return f"{self.name}.{self.suffix}"

    def toml(self) -> str:
        """The text of ``NAME.toml``."""
        lines = [
            f"purpose = {quoted(self.purpose)}",
            f"how = [{quoted(f'python -m captures.craft {self.name}')}]",
            "crafted = true",
            f"file = {quoted(self.file)}",
            f"ports = {self.ports}",
            f"exit_code = {self.exit_code}",
        ]
        lines += section("expected", {name: self.counts[name] for name in COUNTS})
        lines += section("expected.functions", {f"0x{code:02x}": self.functions[code] for code in self.functions})
        lines += section("expected.findings", self.findings)
        lines += section("expected.unanswered_reasons", self.reasons)
        lines += section(
            "expected.loss", {name: self.loss[name] for name in ("gaps", "octets_missing", "octets_skipped")}
        )
        for name, counts in self.tables.items():
            lines += section(f"expected.{name}", counts)
        if self.tshark is not None:
            lines += ["", "[tshark]", f"s7_pdus = {self.tshark.s7_pdus}", f"why = {quoted(self.tshark.why)}"]
        return "\n".join(lines) + "\n"


def quoted(text: str) -> str:
    """A TOML string."""
    return json.dumps(text, ensure_ascii=False)


def section(name: str, values: dict[str, int]) -> list[str]:
    """The lines of a TOML table, the keys in the order of `COUNTS` or of the alphabet."""
    keys: Iterable[str] = values if name == "expected" else sorted(values)
    return ["", f"[{name}]", *(f"{quoted(key) if not key.isidentifier() else key} = {values[key]}" for key in keys)]


Recipe = Callable[[Case], None]
RECIPES: dict[str, tuple[str, Recipe]] = {}
"""Purpose and recipe of every case by name, in the order they are told of."""


def crafts(purpose: str) -> Callable[[Recipe], Recipe]:
    """Register a function that fills a case as a recipe; the case gets its name, with hyphens."""

    def register(recipe: Recipe) -> Recipe:
        RECIPES[recipe.__name__.replace("_", "-")] = (purpose, recipe)
        return recipe

    return register


def craft(name: str) -> Case:
    """Follow a recipe."""
    purpose, recipe = RECIPES[name]
    case = Case(name, purpose)
    recipe(case)
    return case
