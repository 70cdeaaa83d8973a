"""Shared by the tests of the faces: synthetic captures, analyses of them, and characters that must never reach a terminal."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.text import analysis_lines
from dissect.packets.source.packet import SourceFile
from tests.packets.source.craft import Pcapng
from tests.properties import messages
from tests.properties.messages import Item, dt
from tests.properties.packets import Flow, Packet, Talk

ROOT: Final = Path(__file__).resolve().parents[3]
OWN: Final = sorted(path for path in (ROOT / "captures").rglob("*.pcap*") if path.is_file())

#: Control characters (C0, DEL, C1), marks that change the direction of text, line and paragraph separators.
UNSAFE: Final = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2028\u2029\u2066-\u2069]")

#: The beginning of every line of a tree.
_INDENTED: Final = "    "

WORD: Final = Item(0x04, 1, 10, 0x84, 4 * 8)  # DB10.DBW4


def begun(flow: Flow | None = None, amq: int = 1, length: int = 480) -> Talk:
    """Return a connection with its handshake, COTP connect and setup (packets 1 to 7)."""
    talk = Talk(flow).handshake()
    talk.send(0, messages.connect(0xE0)).send(1, messages.connect(0xD0))
    talk.send(0, dt(messages.setup(messages.JOB, 0, amq, length))).send(
        1, dt(messages.setup(messages.ACK_DATA, 0, amq, length))
    )
    return talk


def read(talk: Talk, ref: int, item: Item = WORD, content: bytes | int = b"\x04\xd2") -> Talk:
    """Let side 0 read an item and side 1 answer: two packets."""
    talk.send(0, dt(messages.read_job(ref, [item])))
    return talk.send(1, dt(messages.read_answer(ref, [item], [content])))


def saved(path: Path, packets: Iterable[Packet], comments: Mapping[int, str | bytes] | None = None) -> Path:
    """Write packets as a pcapng file with nanoseconds; ``comments`` by number of the packet, from 1."""
    file = Pcapng()
    link = -1
    for number, packet in enumerate(packets, 1):
        if packet.link_type != link:
            file.interface(packet.link_type, options=file.resolution(9))
            link = packet.link_type
        comment = (comments or {}).get(number, b"")
        text = comment.encode() if isinstance(comment, str) else comment
        options = file.option(1, text) + file.option(0, b"") if text else b""
        file.packet(
            packet.time_ns, packet.time_ns, packet.octets, len(file.link_types) - 1, packet.wire_length, options
        )
    path.write_bytes(file.octets)
    return path


def observed(observer: Observer, packets: Iterable[Packet]) -> Pipeline:
    """Drive packets through a pipeline in which our bugs raise."""
    pipeline = Pipeline(observer, Options(strict=True))
    for packet in packets:
        pipeline.frame(packet.time_ns, packet.octets, 0, len(packet.octets), packet.wire_length, packet.link_type)
    pipeline.finish()
    return pipeline


def analysed(packets: Sequence[Packet], *more: Sequence[Packet]) -> Analysis:
    """Return the analysis of packets; each further sequence is a separate file."""
    analysis = Analysis()
    pipeline = Pipeline(analysis, Options(strict=True))
    files = []
    for number, part in enumerate((packets, *more), 1):
        file = SourceFile(f"{number}.pcap", pipeline.frames + 1)
        for packet in part:
            pipeline.frame(packet.time_ns, packet.octets, 0, len(packet.octets), packet.wire_length, packet.link_type)
        file.packets = len(part)
        file.octets = sum(len(packet.octets) for packet in part)
        files.append(file)
    pipeline.finish()
    analysis.take(pipeline, files)
    return analysis


def of_files(*paths: Path, slow_ns: int = 1_000_000_000) -> Analysis:
    """Return the analysis of files; our bugs raise."""
    analysis = Analysis()
    run = Run([str(path) for path in paths], analysis, Options(slow_ns, strict=True))
    while run.step():
        pass
    analysis.take(run.pipeline, run.files)
    return analysis


def report(analysis: Analysis) -> list[str]:
    """Return the report as lines."""
    return [line.text for line in analysis_lines(analysis)]


def section(lines: Sequence[str], title: str) -> list[str]:
    """Return the lines below the heading that begins with ``title``, without indentation, down to the next blank one."""
    start = next(index for index, line in enumerate(lines) if line.startswith(title))
    end = next((index for index in range(start, len(lines)) if not lines[index]), len(lines))
    return [line.strip() for line in lines[start + 1 : end]]


class Kept(Observer):
    """Remembers transactions, and PDUs with their sides."""

    def __init__(self) -> None:
        super().__init__()
        self.transactions: list[Transaction] = []

    def transaction(self, transaction: Transaction) -> None:
        """Keep a transaction."""
        self.transactions.append(transaction)


def transactions(packets: Iterable[Packet]) -> list[Transaction]:
    """Return the transactions of packets."""
    kept = Kept()
    observed(kept, packets)
    return kept.transactions


def first_transaction(talk: Talk) -> Transaction:
    """Return the first transaction after the setup of a talk that `begun` made."""
    return transactions(talk.packets())[1]


def tree_lines(texts: list[str]) -> list[str]:
    """Return the lines that `show -V` writes: a tree is one text with several lines.

    Each line is indented, so that a line broken by a line feed from the wire would be noticed.
    """
    lines: list[str] = []
    for text in texts:
        several = text.split("\n")
        if len(several) > 1:
            assert [line for line in several if line and not line.startswith(_INDENTED)] == []
        lines += several
    return lines
