"""Fuzz target ``files``: a whole capture through the whole program, to every possible output.

The last octet chooses the output (`FACES`) and whether the octets before it are a capture file or a script of TCP events
(`tests.fuzz.scripts`), which is converted to a capture file.
"""

from __future__ import annotations

import csv
import io
import re
import struct
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from dissect.cli.baseline import _usual_rules
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.transaction import Transaction
from dissect.files.anonymize.account import Choices
from dissect.files.recording.cutter import Around, Cutter
from dissect.files.session import analyze
from dissect.files.session import open as events_of
from dissect.meaning.bindings.engine import ScdCarrier
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.contract import analysis_as_dict
from dissect.meaning.report.json_page import JsonPage
from dissect.meaning.report.styled import Line
from dissect.meaning.report.text import analysis_lines
from dissect.meaning.report.words import Places
from dissect.meaning.report.writer import PduFeed, TransactionFeed
from dissect.meaning.report.writers.csv import CSV_COLUMNS, CsvWriter
from dissect.meaning.report.writers.jsonl import JsonlWriter, TransactionLines
from dissect.meaning.report.writers.text import TextWriter
from dissect.meaning.select.selection import Selection, Wanted
from dissect.online.alerts.alert import Alert
from dissect.online.alerts.engine import AlertEngine
from dissect.online.metrics.counters import Metrics
from dissect.output.baseline.learn import Learner
from dissect.output.baseline.loading import parse_baseline
from dissect.output.baseline.writing import baseline_toml
from dissect.packets.source.files import find_reader
from dissect.packets.source.packet import CaptureError, SourceFile
from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.testing.golden.comparison import diff_sessions
from dissect.testing.golden.model import GoldenError
from dissect.testing.golden.parsing import parse_golden
from dissect.testing.golden.reading import SessionReader
from dissect.testing.golden.writing import EXTRAS, golden_text
from dissect.testing.playback.server.recording import recording_of
from tests.files.anonymize.support import anonymized
from tests.fuzz.checks import check_json, check_line, check_lines
from tests.fuzz.containers import MOST_STEPS, Packets, read
from tests.fuzz.inputs import plant, plant_bindings
from tests.fuzz.played import ServedReader, check_replayed, check_served
from tests.fuzz.scripts import Script
from tests.fuzz.watched import check_events, check_metrics, check_screens, new_watcher
from tests.meaning.report.support import tree_lines
from tests.properties.books import check_books
from tests.properties.captures import Memory
from tests.properties.packets import Packet

SCRIPT: Final = 0x80
#: The other variant of a face: with checksums verified, packets of other protocols dropped, one connection cut out.
OTHER: Final = 0x40
#: With the dictionary and the bindings of captures/scd.
SCD: Final = 0x20


class Way:
    """How a capture is read: ``other`` is the other variant of a face, ``scd`` whether SCD is looked for."""

    def __init__(self, other: bool, scd: bool) -> None:
        self.other = other
        self.scd = scd

    def carrier(self) -> ScdCarrier | None:
        """Return what looks for SCD in one run."""
        return ScdCarrier(plant(), plant_bindings()) if self.scd else None


def as_pcap(packets: Iterable[Packet]) -> bytes:
    """Return a pcap file with nanoseconds of packets of one link type; others are left out."""
    chosen = list(packets)
    link = chosen[0].link_type if chosen else 1
    octets = bytearray(struct.pack("<IHHiIII", 0xA1B23C4D, 2, 4, 0, 0, 0x40000, link))
    for packet in chosen:
        if packet.link_type == link and packet.time_ns >= 0:
            seconds, ns = divmod(packet.time_ns, 10**9)
            octets += struct.pack("<IIII", seconds & 0xFFFFFFFF, ns, len(packet.octets), packet.wire_length)
            octets += packet.octets
    return bytes(octets)


def drive(
    octets: bytes, observer: Observer, carrier: ScdCarrier | None, checksums: bool = False
) -> tuple[Pipeline, list[SourceFile]] | None:
    """Give a file to a pipeline in which our bugs raise, and check its accounts; None if it is not a capture."""
    try:
        reader = find_reader(Memory(octets), "fuzz.pcap")
    except CaptureError as error:
        check_line(str(error))
        return None
    pipeline = Pipeline(observer, Options(strict=True, decoder=carrier, checksums=checksums))
    steps = MOST_STEPS
    while steps and reader.step(pipeline):
        steps -= 1
    if reader.damage:
        pipeline.note_damage(f"fuzz.pcap: {reader.damage}")
    pipeline.finish()
    check_books(pipeline)
    file = SourceFile("fuzz.pcap", 1)
    file.packets, file.octets = reader.packets, reader.octets
    file.damage, file.rejected, file.notes = reader.damage, reader.rejected, list(reader.notes)
    assert pipeline.frames == reader.packets
    return pipeline, [file]


def _analysis(octets: bytes, way: Way) -> None:
    analysis = Analysis()
    driven = drive(octets, analysis, way.carrier(), way.other)
    if driven is None:
        return
    analysis.take(*driven)
    check_lines([line.text for line in analysis_lines(analysis)])
    for line in analysis_lines(analysis):
        check_lines(line.wrapped(60))
    found = check_json(JsonPage(1).text(analysis_as_dict(analysis)))
    assert isinstance(found, dict)


def _transactions(octets: bytes, way: Way) -> None:
    objects = TransactionLines()
    if drive(octets, objects, way.carrier(), way.other) is None:
        return
    lines = objects.take()
    for line in lines:
        check_json(line)
    places = Places([SourceFile("fuzz.pcap", 1)], False)
    texts = TextWriter()
    texts.begin(places)
    drive(octets, TransactionFeed(texts), way.carrier(), way.other)
    told = [line.text for line in texts.take() if isinstance(line, Line)]
    assert len(told) == len(lines)
    check_lines(told)
    plain = TextWriter()
    plain.plain = True
    plain.begin(places)
    drive(octets, TransactionFeed(plain), way.carrier(), way.other)
    assert [line.decode() for line in plain.take() if isinstance(line, bytes)] == told
    rows = CsvWriter()
    rows.begin(places)
    drive(octets, TransactionFeed(rows), way.carrier(), way.other)
    table = [row for line in rows.take() if isinstance(line, bytes) for row in line.decode().split("\n")]
    assert len(table) > len(lines)
    check_lines(table)
    for cells in csv.reader(io.StringIO("\n".join(table))):
        assert len(cells) == len(CSV_COLUMNS)
        assert not any(cell.startswith(("=", "+", "@")) for cell in cells)


def _tree(octets: bytes, way: Way) -> None:
    writer = TextWriter(verbose=True)
    writer.begin(Places([SourceFile("fuzz.pcap", 1)], False))
    drive(octets, PduFeed(writer, decoder=way.carrier()), way.carrier(), way.other)
    check_lines(tree_lines([line.text for line in writer.take() if isinstance(line, Line)]))


def _pdu_lines(octets: bytes, way: Way) -> None:
    writer = JsonlWriter()
    writer.begin(Places([SourceFile("fuzz.pcap", 1)], True))
    drive(octets, PduFeed(writer, decoder=way.carrier()), way.carrier(), way.other)
    for line in writer.take():
        check_json(str(line))


def _golden(octets: bytes, way: Way) -> None:
    reader = SessionReader("fuzz")
    if drive(octets, reader, way.carrier(), way.other) is None:
        return
    session = reader.finish()
    for extras in ((), EXTRAS):
        text = golden_text(session, extras)
        check_lines(text.split("\n"))
        parsed = parse_golden(text)
        assert golden_text(parsed, extras) == text
        told = diff_sessions(session, parsed)
        assert not told, told[0].text


def _renewed(octets: bytes, make: Callable[[Path, Path], object]) -> tuple[Packets, Packets] | None:
    """Return the packets of a file, and of the file that ``make`` writes from it; None if it is not a capture."""
    with tempfile.TemporaryDirectory(prefix="s7dissect-fuzz-") as folder:
        source, out = Path(folder, "in"), Path(folder, "out")
        source.write_bytes(octets)
        try:
            made = make(source, out)
        except CaptureError as error:
            check_line(str(error).replace(folder, ""))
            return None
        before, _, ended = read(Memory(octets))
        if not ended or made is False:
            return None
        after, said, _ = read(Memory(out.read_bytes()), 1 << 20)
        assert said == ["", "0"], said
        return before, after


#: With any of these findings the octets contradict themselves, and zeros may change the interpretation of the rest.
_DAMAGE: Final = ("tpkt.", "cotp.", "ibh.", "s7.", "stream.", "ip.", "capture.", "session.foreign", "transaction.size")


def _outcomes(path: Path) -> list[tuple[object, ...]]:
    """Return the outcome of each transaction, without the texts and values that are replaced."""
    return [
        (
            int(one.connection.number),
            int(one.function),
            one.function_name,
            int(one.pdu_ref),
            one.outcome,
            one.reason,
            one.latency_ns,
            [int(result.return_code) for result in one.s7_results],
            [error.code for error in one.errors],
        )
        for one in events_of(str(path), pdus=False)
        if isinstance(one, Transaction)
    ]


def _anonymize(octets: bytes, way: Way) -> None:
    def make(source: Path, out: Path) -> None:
        size = len(octets)
        values = ("mask", "scramble", "keep")[size % 3]
        choices = Choices(values, size & 4 != 0, not way.other, size & 8 != 0)
        account = anonymized(source, out, choices, carrier=way.carrier())
        check_lines(account.lines())
        assert 0 <= account.written <= account.packets
        counts = analyze(str(source)).as_dict()["findings"]
        assert isinstance(counts, dict)
        if not (way.other or way.scd) and not any(slug.startswith(_DAMAGE) for slug in counts):
            assert _outcomes(out) == _outcomes(source)

    renewed = _renewed(octets, make)
    if renewed is not None:
        before, after = renewed
        assert len(after.told) <= len(before.told)


def _cut(octets: bytes, way: Way) -> None:
    """All packets are cut out, or those of the first connection."""

    def make(source: Path, out: Path) -> bool:
        selection = Selection(Wanted((1,)) if way.other else Wanted())
        content = source.read_bytes()
        if drive(content, selection, way.carrier()) is None:
            return False
        writer = PcapngWriter(str(out), overwrite=True)
        around = Around(2) if len(content) & 1 and not way.other else Around()
        cutter = Cutter(selection.choice(-(2**63), 2**63), writer, around)
        cutter.read_all(find_reader(Memory(content), "fuzz.pcap"))
        writer.close()
        return True

    renewed = _renewed(octets, make)
    if renewed is None:
        return
    before, after = renewed
    if way.other:
        rest = iter(before.told)
        assert all(packet in rest for packet in after.told)
    else:
        assert after.told == before.told


def _played(octets: bytes, way: Way) -> None:
    served = ServedReader("fuzz")
    if drive(octets, served, way.carrier()) is None:
        return
    try:
        session = served.finish()
    except GoldenError as error:
        check_line(str(error))
        return
    try:
        recording = recording_of(session)
    except CaptureError as error:
        check_line(str(error))
    else:
        check_served(recording, list(served.sent.values()), octets[-200:])
    try:
        check_replayed(session)
    except CaptureError as error:
        check_line(str(error))


_MEAN: Final = re.compile(r"mean = [^,]*")


def _learned(octets: bytes, way: Way) -> None:
    """A baseline learned from a capture is written, read back the same, and finds nothing new in that capture."""
    learner = Learner()
    if drive(octets, learner, way.carrier()) is None:
        return
    baseline = learner.baseline(("fuzz.pcap",))
    # Entries that are never learned, as allowed by a user who removes the comment marks
    for norm in baseline.pairs.values():
        norm.acts = frozenset(norm.acts_seen)
        if norm.functions is not None:
            norm.functions |= norm.functions_seen
    text = baseline_toml(baseline)
    check_lines(text.split("\n"))
    parsed = parse_baseline(text)
    # The mean is for people, and is computed from the seconds, which the file rounds.
    assert _MEAN.sub("", baseline_toml(parsed)) == _MEAN.sub("", text)
    told: list[Alert] = []
    # Silence is learned between transactions; that of the end may be longer.
    engine = AlertEngine(_usual_rules(1.0, 0), parsed, told.append)
    drive(octets, engine, way.carrier())
    engine.finish()
    for alert in told:
        check_line(alert.line())
        check_json(alert.as_json())
    assert not told, told[0].line()


def _watched(octets: bytes, way: Way) -> None:
    watcher, metrics = new_watcher(), Metrics()
    driven = drive(octets, watcher, way.carrier())
    counted = drive(octets, metrics, way.carrier())
    if driven is None or counted is None:
        return
    check_events(watcher.fresh)
    check_screens(watcher.fresh, driven[0])
    check_metrics(metrics, counted[0])


FACES: Final = (
    _analysis, _transactions, _tree, _pdu_lines, _golden, _anonymize, _cut, _played, _learned, _watched,
)  # fmt: skip


def files(octets: bytes) -> None:
    """Any capture: all outputs are complete and safe, and can be read back."""
    if not octets:
        return
    mode = octets[-1]
    content = octets[:-1]
    if mode & SCRIPT:
        content = as_pcap(Script(content).packets)
    FACES[(mode & 0x1F) % len(FACES)](content, Way(bool(mode & OTHER), bool(mode & SCD)))
