"""Parts of every capture there is: Wireshark reads them, they hold what was asked for, and what was cut out says the same."""

from __future__ import annotations

import subprocess
from collections import Counter
from pathlib import Path
from typing import Final

import pytest

import dissect
from dissect.engine.pipeline import Options
from dissect.engine.transactions.transaction import ANSWERED, PUSH, Transaction
from dissect.files.recording.cutter import Cutter
from dissect.files.session import Run
from dissect.meaning.select.selection import Selection, Wanted
from dissect.packets.source.files import open_capture
from dissect.packets.source.pcapng_writer import PcapngWriter
from tests.meaning.report.support import OWN, ROOT
from tests.packets.source.craft import Frame, drain

#: Captures of what goes wrong in TCP. Alone, packets that came out of order, sent again or in slivers do not say which octets
#: come first; with the whole connection they do.
DISORDER: Final = frozenset((
    "conflicts.pcapng", "disorder.pcapng", "holes.pcapng", "retransmissions.pcapng", "segments.pcapng",
    "sequence-wrap.pcapng", "snaplen.pcapng", "tpkt-faults.pcapng",
))  # fmt: skip
#: What a record holds cannot be opened without those before it.
ENCRYPTED: Final = frozenset(("s7commplus-tls.pcapng",))
ALWAYS: Final = (-(2**63), 2**63)


def cut(source: Path, out: Path, wanted: Wanted, times: tuple[int, int] = ALWAYS, context: bool = False) -> Cutter:
    selection = Selection(wanted, context=context)
    run = Run([str(source)], selection, Options(strict=True))
    while run.step():
        pass
    assert selection.missing == ""
    writer = PcapngWriter(str(out), overwrite=True)
    cutter = Cutter(selection.choice(*times), writer)
    reader = open_capture(str(source))
    cutter.read_all(reader)
    reader.close()
    writer.close()
    return cutter


def frames(path: Path) -> list[Frame]:
    return drain(open_capture(str(path))).frames


def transactions(path: Path) -> list[Transaction]:
    return [event for event in dissect.open(str(path), pdus=False) if isinstance(event, Transaction)]


def told(event: Transaction) -> tuple[object, ...]:
    return (
        event.function_name,
        int(event.pdu_ref),
        event.outcome,
        event.reason,
        # Without the packets around it a pair may be only likely, so that it has no `latency_ns`.
        event.response_ns - event.request_ns if event._outcome == ANSWERED else None,
        event.request_octets,
        event.response_octets,
        # What a push is about says the request that began its job, which need not be in the cut.
        [
            (result.item and result.item.label, int(result.return_code), result.data)
            for result in event.s7_results
            if event._outcome != PUSH
        ],
        [(error.where, error.code) for error in event.errors],
    )


def counted(paths: list[Path]) -> list[int]:
    """Return how many packets capinfos finds in files, all of which it has to read without a complaint."""
    ran = subprocess.run(
        ["capinfos", "-c", "-M", "-T", "-r", *map(str, paths)], capture_output=True, text=True, check=True
    )
    assert [line for line in ran.stderr.splitlines() if "Running as user" not in line] == []
    return [int(line.rsplit("\t", 1)[1]) for line in ran.stdout.splitlines()]


@pytest.fixture(scope="module")
def captures() -> list[Path]:
    public = ROOT.parent / "shared" / "captures"
    more = [path for path in public.iterdir() if "pcap" in path.suffix] if public.is_dir() else []
    return [*OWN, *sorted(more)]


def test_every_part_is_what_was_asked_for_and_wireshark_reads_it(captures: list[Path], tmp_path: Path) -> None:
    """All of it, one connection, half of the time, packets with findings."""
    made: list[tuple[Path, int]] = []
    for number, source in enumerate(captures):
        before = frames(source)
        analysis = dissect.analyze(str(source))
        middle = before[len(before) // 2].time_ns
        shown = {int(frame) for finding in analysis.findings for frame in finding.frames if frame}
        parts: list[tuple[Wanted, tuple[int, int], list[Frame] | None]] = [
            (Wanted(), ALWAYS, before),
            (Wanted(), (middle, 2**63), [frame for frame in before if frame.time_ns >= middle]),
        ]
        if analysis.findings:
            slugs = {finding.slug for finding in analysis.findings}
            parts.append((Wanted(slugs=slugs), ALWAYS, [before[frame - 1] for frame in sorted(shown)]))
        if analysis.connections:
            parts.append((Wanted(connections=[int(analysis.connections[0].number)]), ALWAYS, None))
        for at, (wanted, times, expected) in enumerate(parts):
            out = tmp_path / f"{number}-{at}.pcapng"
            cutter = cut(source, out, wanted, times)
            written = frames(out)
            if expected is None:
                assert 0 < len(written) <= len(before), source
                assert not Counter(written) - Counter(before), source
            else:
                assert written == expected, (source, at)
            assert len(written) == cutter.chosen
            made.append((out, cutter.chosen))
    assert counted([path for path, _ in made]) == [count for _, count in made]


def test_a_transaction_alone_says_the_same(captures: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "out.pcapng"
    seen = 0
    for source in captures:
        events = transactions(source)
        if source.name in DISORDER or source.name in ENCRYPTED:
            continue
        for event in events[:: max(1, len(events) // 3)]:
            if event.reason == "reference_reused" or event.connection.tcp.ended == "reused":
                continue  # that is what another transaction or connection did
            cut(source, out, Wanted(transactions=[int(event.number)]))
            said = [told(other) for other in transactions(out)]
            # What `cut` leaves out is a gap of the part, or a whole direction: there a request was perhaps answered.
            lost = [(*told(event)[:3], reason, *told(event)[4:]) for reason in ("hole", "one_sided")]
            found = told(event) in said or (event.outcome == "unanswered" and any(one in said for one in lost))
            assert found, (source, int(event.number))
            seen += 1
    assert seen > 150


@pytest.mark.parametrize("name", ["read-areas", "szl", "write-areas", "transfer"])
def test_with_context_it_is_known_what_was_negotiated(name: str, tmp_path: Path) -> None:
    source, out = ROOT / f"captures/{name}.pcapng", tmp_path / "out.pcapng"
    event = transactions(source)[2]
    assert event.function_name != "Setup communication"
    cut(source, out, Wanted(transactions=[int(event.number)]))
    (bare,) = transactions(out)
    assert int(bare.connection.pdu_length) <= 0
    cut(source, out, Wanted(transactions=[int(event.number)]), context=True)
    found = transactions(out)
    assert [one.function_name for one in found] == ["Setup communication", event.function_name]
    assert told(found[1]) == told(event)
    whole, alone = event.connection, found[1].connection
    assert (int(alone.pdu_length), alone.tsap_called, alone.tcp.ended) != (0, None, "")
    assert int(alone.pdu_length) == int(whole.pdu_length)
    assert alone.tsap_called is not None
    assert whole.tsap_called is not None
    assert alone.tsap_called.octets == whole.tsap_called.octets
    assert alone.tcp.ended == whole.tcp.ended


@pytest.mark.parametrize(
    ("name", "ending"), [("cut-with-fin", 0x11), ("cut-with-reset", 0x04), ("client-killed", 0x01)]
)
def test_why_there_is_no_answer_goes_along(name: str, ending: int, tmp_path: Path) -> None:
    source, out = ROOT / f"captures/{name}.pcapng", tmp_path / "out.pcapng"
    (event,) = [event for event in transactions(source) if not event.response_frame]
    cutter = cut(source, out, Wanted(transactions=[int(event.number)]))
    assert [told(one) for one in transactions(out)] == [told(event)]
    assert cutter.chosen > 1
    (_, *rest) = frames(out)
    assert all(frame.octets[47] & ending for frame in rest[:1])


def test_findings_are_comments_that_tshark_shows(tmp_path: Path) -> None:
    source, out = ROOT / "captures/plc-control.pcapng", tmp_path / "out.pcapng"
    cutter = cut(source, out, Wanted())
    ran = subprocess.run(
        ["tshark", "-r", str(out), "-Y", "frame.comment", "-T", "fields", "-e", "frame.number", "-e", "frame.comment"],
        capture_output=True,
        text=True,
        check=True,
    )
    shown = dict(line.split("\t", 1) for line in ran.stdout.splitlines())
    findings = dissect.analyze(str(source)).findings
    assert len(shown) == cutter.commented == len({frame for finding in findings for frame in finding.frames})
    for finding in findings:
        for frame in finding.frames:
            assert f"s7dissect: {finding.severity} {finding.slug}: " in shown[str(frame)]
