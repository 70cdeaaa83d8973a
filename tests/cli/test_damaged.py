"""Whatever octets a capture holds, every face has something to say about each PDU and transaction, and says it safely."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from random import Random

import pytest
from mypy_extensions import i64

from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.contract import analysis_as_dict
from dissect.meaning.report.json_page import JsonPage
from dissect.meaning.report.styled import Line
from dissect.meaning.report.text import analysis_lines
from dissect.meaning.report.words import Places
from dissect.meaning.report.writer import PduFeed, TransactionFeed
from dissect.meaning.report.writers.csv import CsvWriter
from dissect.meaning.report.writers.jsonl import JsonlWriter, TransactionLines
from dissect.meaning.report.writers.text import TextWriter
from dissect.packets.source.files import open_capture
from dissect.packets.source.packet import PacketSink, SourceFile
from tests.cli.support import run, simple
from tests.meaning.report.schemas import complaints
from tests.meaning.report.support import OWN, UNSAFE, observed, tree_lines
from tests.properties.packets import Packet

Capture = pytest.CaptureFixture[bytes]
FILES = [SourceFile("damaged.pcap", 1)]
PLACES = Places(FILES, False)
#: Ethernet, IP and TCP headers, which are not what this is about.
HEADERS = 54
SEEDS = range(20)


class Packets(PacketSink):
    """Keeps packets."""

    def __init__(self) -> None:
        self.packets: list[Packet] = []

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        """Keep a packet."""
        self.packets.append(Packet(time_ns, buf[start:end], wire_length, link_type))


def packets_of(path: Path) -> list[Packet]:
    sink = Packets()
    reader = open_capture(str(path))
    while reader.step(sink):
        pass
    return sink.packets


def damaged(rng: Random, packets: list[Packet]) -> list[Packet]:
    """Return packets with some octets behind their headers changed, and some cut."""
    share = rng.choice((0.05, 0.3, 1.0))
    changed = []
    for packet in packets:
        octets = bytearray(packet.octets)
        if len(octets) > HEADERS and rng.random() < share:
            for _ in range(rng.randint(1, 3)):
                at = rng.randrange(HEADERS, len(octets))
                octets[at] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, octets[at] ^ 1, octets[at] ^ 0x80, rng.randrange(256)))
            if rng.random() < 0.1:
                octets = octets[: rng.randrange(HEADERS, len(octets))]
        changed.append(packet._replace(octets=bytes(octets)))
    return changed


def holds(packets: list[Packet]) -> None:
    """Drive packets through every face; a bug of ours raises."""
    analysis = Analysis()
    pipeline = observed(analysis, packets)
    analysis.take(pipeline, FILES)
    shown = [line.text for line in analysis_lines(analysis)]
    assert complaints("analysis", json.loads(JsonPage(1).text(analysis_as_dict(analysis))), exact=True) == []
    lines = TransactionLines()
    observed(lines, packets)
    transactions = lines.take()
    assert len(transactions) == analysis.total
    texts = TextWriter()
    texts.begin(PLACES)
    observed(TransactionFeed(texts), packets)
    told = [line.text for line in texts.take() if isinstance(line, Line)]
    assert len(told) == analysis.total
    plain = TextWriter()
    plain.plain = True
    plain.begin(PLACES)
    observed(TransactionFeed(plain), packets)
    assert [line.decode() for line in plain.take() if isinstance(line, bytes)] == told
    rows = CsvWriter()
    rows.begin(PLACES)
    observed(TransactionFeed(rows), packets)
    table = [row for line in rows.take() if isinstance(line, bytes) for row in line.decode().split("\n")]
    assert {int(line.partition(",")[0]) for line in table[1:]} == set(range(1, int(analysis.total) + 1))
    shown += told + table
    pdus = JsonlWriter()
    observed(PduFeed(pdus), packets)
    pdu_lines = [str(line) for line in pdus.take()]
    behind = pipeline.s7.behind_malformed + pipeline.plus.behind_malformed
    shown_pdus = [line for line in pdu_lines if json.loads(line)["protocol"] != "cotp"]
    assert len(shown_pdus) == pipeline.s7.pdus + pipeline.plus.pdus + behind
    trees = TextWriter(verbose=True)
    observed(PduFeed(trees), packets)
    shown += tree_lines([line.text for line in trees.take() if isinstance(line, Line)])
    assert [line for line in (*shown, *transactions, *pdu_lines) if UNSAFE.search(line)] == []
    for name, each in (("transaction", transactions), ("pdu", pdu_lines)):
        for line in each[:10]:  # checking against the schema takes longer than all else
            assert complaints(name, json.loads(line), exact=True) == []


@pytest.mark.parametrize("seed", SEEDS)
def test_no_damage_silences_a_face(seed: int) -> None:
    rng = Random(seed)
    small = [path for path in OWN if path.stat().st_size < 12_000]
    for path in rng.sample(small, 5):
        holds(damaged(rng, packets_of(path)))


@pytest.fixture
def rejected(tmp_path: Path) -> Path:
    """A capture with a block that contradicts itself between two that are sound."""
    path = simple(tmp_path / "rejected.pcapng")
    octets = path.read_bytes()
    bad = struct.pack("<III", 6, 12, 12)  # an Enhanced Packet Block with no room for a packet
    path.write_bytes(octets + bad)
    return path


@pytest.mark.parametrize(
    "call", ["analyze", "transactions", "operations", "show", "golden", "monitor", "baseline", "verify"]
)
def test_blocks_given_up_are_damage(capfdbinary: Capture, rejected: Path, call: str) -> None:
    ran = run(capfdbinary, call, rejected)
    assert ran.code == 3, ran
    assert "rejected.pcapng: 1 damaged block skipped, the contents are missing\n" in ran.err


def test_verify_on_a_cut_capture(capfdbinary: Capture, tmp_path: Path) -> None:
    path = simple(tmp_path / "cut.pcapng")
    path.write_bytes(path.read_bytes()[:-5])
    ran = run(capfdbinary, "verify", path)
    assert ran.code == 3, ran
    assert "cut.pcapng: cut off" in ran.err
