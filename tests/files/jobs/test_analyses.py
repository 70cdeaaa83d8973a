"""Parts of an analysis, one for each file, added up: what one run over all files finds, to the byte."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from typing import Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dissect
from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.engine.options import Options
from dissect.engine.pipeline import Pipeline
from dissect.engine.stations.facts import CLOCK, FIRMWARE, MAX_STRETCHES, ORDER_NUMBER, Book, Fact
from dissect.files.jobs.analyses import Analyses
from dissect.files.jobs.numbers import Offsets
from dissect.files.jobs.sending import Sent, receive, send
from dissect.files.jobs.sums import FilePart, part_of, unread
from dissect.files.session import Run
from dissect.meaning.report.analysis import MAX_FAILED, Analysis
from dissect.meaning.report.contract import analysis_as_dict
from dissect.meaning.report.json_page import JsonPage
from dissect.meaning.report.latencies import EXACT
from dissect.meaning.report.summary import Summary
from dissect.packets.source.packet import SourceFile
from tests.meaning.report.schemas import ROOT

CAPTURES: Final = ROOT / "captures"
#: Of all kinds, no two of them within a minute, so that one run takes each for a capture of its own.
APART: Final = [
    str(CAPTURES / name)
    for name in (
        "szl.pcapng",
        "crafted/holes.pcapng",
        "s7plus/s7commplus-tls.pcapng",
        "transfer.pcapng",
        "crafted/ip-fragments.pcapng",
        "crafted/netlink.pcapng",
        "crafted/cut-pcapng.pcapng",
        "s7plus/s7commplus.pcapng",
        "answer-lost.pcapng",
        "crafted/coverage-userdata.pcapng",
    )
]


def text(analysis: Analysis) -> str:
    """Return all that is said of an analysis."""
    lines = [*Summary(analysis).text(), *Summary(analysis, brief=True).text()]
    return "\n".join([JsonPage(1).text(analysis_as_dict(analysis)), *map(str, lines)])


@cache
def part(path: str) -> FilePart:
    """Return what a run over one file finds, as it is sent."""
    analysis = Analysis()
    run = Run([path], analysis, Options())
    while run.step():
        pass
    return part_of(analysis, run.pipeline, run.files)


def added(paths: Sequence[str]) -> Analysis:
    """Add up what runs over one file each find."""
    sums = Analyses(Options())
    for path in paths:
        sums.add(part(path))
    return sums.result


@settings(max_examples=8)
@given(st.permutations(APART), st.integers(1, len(APART)))
def test_files_by_themselves_come_to_what_one_run_finds(order: list[str], count: int) -> None:
    assert text(added(order[:count])) == text(dissect.analyze(*order[:count]))


def test_bounds_hold_for_the_sum() -> None:
    """The same file again and again: its time goes back, so that it is a capture of its own for one run, too."""
    files = [str(CAPTURES / "crafted" / "refusals.pcapng")] * 30
    sums, whole = added(files), dissect.analyze(*files)
    assert len(whole.failed) == MAX_FAILED
    assert text(sums) == text(whole)


def test_findings_of_the_whole_capture_have_their_bound() -> None:
    sums = Analyses(Options())
    for _ in range(3):
        analysis = Analysis()
        pipeline = Pipeline(analysis)
        for _ in range(60):
            pipeline.note_damage("x")
        pipeline.finish()
        sums.add(part_of(analysis, pipeline, [SourceFile("x", 1)]))
    assert sums.result.finding_counts == {"capture.damaged": 180}
    assert len(sums.result.findings) == 100


@pytest.mark.parametrize("count", [3, EXACT, EXACT + 3])
def test_answer_times_are_sent_as_they_are_and_in_buckets(count: int) -> None:
    statistics = Analysis()._statistics(_parameters())
    for time in range(count):
        statistics.latencies.add(time * 1000)
    moved = receive(send(statistics.latencies), Offsets(0, 0, 0))
    assert moved.as_dict() == statistics.latencies.as_dict()
    assert (moved.count, moved.exact) == (count, count <= EXACT)
    for latencies in (moved, statistics.latencies):
        latencies.add(7)  # one that was sent counts on
    assert moved.as_dict() == statistics.latencies.as_dict()


@settings(max_examples=12)
@given(st.lists(st.lists(st.integers(-5, 10**7), max_size=30), max_size=5), st.booleans())
def test_answer_times_are_those_of_all(parts: list[list[int]], many: bool) -> None:
    whole, sums = Analysis(), Analysis()
    more = list(range(0, 10**6, 10**6 // EXACT)) if many else []
    for times in [*parts, more]:
        each = Analysis()
        for analysis in (whole, each):
            statistics = analysis._statistics(_parameters())
            for time in times:
                statistics.latencies.add(time)
        sums.merge(each)
    assert sums.latencies.as_dict() == whole.latencies.as_dict()
    assert sums.latencies.exact == whole.latencies.exact == (whole.latencies.count <= EXACT)


def _parameters():  # type: ignore[no-untyped-def]
    from dissect.protocols.s7.parameters import Parameters

    return Parameters(b"\xf0\x00\x00\x01\x00\x01\x01\xe0", 1)


_FACTS = st.tuples(
    st.sampled_from(["10.0.0.1", "10.0.0.2"]),
    st.sampled_from([ORDER_NUMBER, FIRMWARE, CLOCK, "block"]),
    st.sampled_from(["V4", "V4.3", "V5", "V5.1.2"]),
)


@given(st.lists(_FACTS, max_size=90), st.lists(st.integers(0, 90), max_size=4))
def test_stations_are_what_one_book_has(said: list[tuple[str, str, str]], cuts: list[int]) -> None:
    facts = [
        Fact(host, "", key, value if key != ORDER_NUMBER else f"{value}{at}", "SZL", 1, [at + 1], at)
        for at, (host, key, value) in enumerate(said)
    ]
    whole, sums = Book(), Book()
    for fact in facts:
        whole.note(fact)
    borders = [0, *sorted(cuts), len(facts)]
    for begin, end in pairwise(borders):
        book = Book()
        for fact in facts[begin:end]:
            book.note(fact)
        sums.merge(book)
    assert _told(sums) == _told(whole)
    assert all(len(of) <= MAX_STRETCHES for station in sums.stations.values() for of in station.facts.values())


def _told(book: Book) -> list[object]:
    return [
        (
            host,
            station.not_kept,
            [(key, [_stretch(one) for one in of]) for key, of in station.facts.items()],
            [(key, _stretch(one)) for key, one in station.blocks.items()],
        )
        for host, station in book.stations.items()
    ]


def _stretch(one):  # type: ignore[no-untyped-def]
    return (one.value, one.source, one.count, one.first_frame, one.first_ns, one.last_frame, one.last_ns)


def test_a_file_that_could_not_be_read_stays_in_the_list() -> None:
    sums = Analyses(Options())
    for one in (part(APART[0]), unread("gone.pcap", "no such file", Analysis()), part(APART[3])):
        sums.add(one)
    assert [(file.name, file.damage) for file in sums.result.files][1] == ("gone.pcap", "no such file")
    assert sums.result.finding_counts["capture.damaged"] == 1
    told = [finding.detail for finding in sums.result.findings if finding.rule.slug == "capture.damaged"]
    assert told == ["gone.pcap: no such file"]
    assert text(sums.result).count("gone.pcap: 0 packets") == 2
    whole = dissect.analyze(APART[0], APART[3])
    assert sums.result.latencies.as_dict() == whole.latencies.as_dict()


def test_numbers_in_words_and_frames_move() -> None:
    rule = CATALOGUE["security.session_reused"]
    text = "SetVariable in session 0x00000007, which connection 3 got"
    moved = receive(send([Finding(rule, 4, [9, 10], 5, text), Finding(rule, 0, [], 5, text[:10])]), Offsets(100, 20, 7))
    assert [(one.connection, one.frames, one.detail) for one in moved] == [
        (24, [109, 110], "SetVariable in session 0x00000007, which connection 23 got"),
        (0, [], text[:10]),
    ]
    assert moved[0].rule is rule


def test_no_key_is_sent() -> None:
    """A session that was opened is described, but what opened it stays where it was read."""
    path = CAPTURES / "s7plus" / "s7commplus-tls.pcapng"
    keys = re.findall(rb"[A-Z_]+ [0-9a-f]{64} ([0-9a-f]{64,96})", path.read_bytes())
    assert keys, "the capture holds its keys"
    sent = repr(part(str(path)).sent)
    assert "dissect.protocols.tls.session" in sent
    assert not [key for key in keys if key.decode() in sent or repr(bytes.fromhex(key.decode()))[2:-1] in sent]


@pytest.mark.parametrize("module", ["os", "dissect.files.jobs.pool"])
def test_nothing_but_our_classes_is_made_of_what_comes(module: str) -> None:
    with pytest.raises(ValueError, match="is not a class of this package"):
        receive(Sent(("object", 0), [(module, "signal")], [(0, ["x"])], []), Offsets())
    with pytest.raises(TypeError, match="cannot be sent"):
        send([re.compile("x")])
