"""The verdict: what broke, since when, who; and what a capture without S7 holds instead."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.output.page.verdict import heaviest_rules, verdict
from tests.meaning.report.schemas import ROOT
from tests.meaning.report.support import WORD, begun, read, saved
from tests.output.page.support import gathered_of
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import EPOCH_NS, Flow, Talk, capture

OWN = ROOT / "captures"
#: The beginning of a session of MMS.
MMS = bytes.fromhex("0db205061302010016010214020002330200013402")


def test_what_broke_since_when_and_who() -> None:
    said = verdict(gathered_of([OWN / "nodes7-poll-missing.pcapng"]))
    assert said.severity == "warning"
    what, since, who = said.sentences
    refused = "An item of a read, write or subscription was refused"
    assert what == f"{refused}: Read Var DB2.DBB400 x4: 0x05 Invalid address (packets 10, 11)."
    assert since.startswith("It happened 4 times: the first time at 2026-11-21 01:31:15.5")
    assert who == "It concerns 127.0.0.1 → 127.0.0.1; there is no other error or warning."
    assert said.finding is not None
    assert said.finding.frames == [10, 11]


def test_since_when_counts_from_the_first_packet_of_the_capture(tmp_path: Path) -> None:
    """Not from the first thing that the report draws: an hour of other traffic may come before."""
    talk = begun()
    read(talk, 1, WORD, 0x0A)
    web = Talk(Flow(ports=(40000, 80))).handshake().packets()
    later = talk.packets(start_ns=EPOCH_NS + 3600 * 10**9)
    gathered = gathered_of([saved(tmp_path / "a.pcapng", [*web, *later])])
    assert gathered.start_ns == EPOCH_NS
    assert ", 1 h 0 min 0 s after the capture began" in verdict(gathered).sentences[1]


def test_nothing_broke(tmp_path: Path) -> None:
    talk = begun()
    read(talk, 1, WORD)
    said = verdict(gathered_of([saved(tmp_path / "a.pcapng", talk.close().packets())]))
    assert (said.severity, said.finding) == ("", None)
    assert said.sentences[0] == "Nothing broke: 2 requests answered, no errors, no warnings."


def test_without_a_failure_what_stands_out_is_no_breakdown() -> None:
    said = verdict(gathered_of([OWN / "crafted" / "plus-plant.pcapng"]))
    assert said.severity == "error"
    assert said.sentences[0].startswith(
        "No request failed; 16 answers arrived. What stands out: A client sent a PLC stop"
    )


def test_a_capture_without_s7_says_what_was_there(tmp_path: Path) -> None:
    web = Talk(Flow(ports=(40000, 80))).handshake()
    web.send(0, b"GET / HTTP/1.1\r\n\r\n").send(1, b"HTTP/1.1 204 No Content\r\n\r\n")
    said = verdict(gathered_of([saved(tmp_path / "a.pcapng", web.close().packets())]))
    assert said.sentences[0].startswith("There is no S7 communication in this capture of ")
    assert "of TCP connections without ISO-on-TCP" in said.sentences[1]
    talk = Talk().handshake()
    talk.send(0, messages.connect(0xE0)).send(1, messages.connect(0xD0))
    talk.send(0, dt(MMS)).send(1, dt(MMS))
    said = verdict(gathered_of([saved(tmp_path / "b.pcapng", talk.packets())]))
    assert said.sentences[0].startswith("There is no S7 communication")
    assert "2 unknown protocol" in said.sentences[1] or "2 MMS" in said.sentences[1]


def test_a_capture_whose_packets_are_not_opened_says_so(tmp_path: Path) -> None:
    esp = [Flow().wrap(0, 50, bytes(40))] * 3
    said = verdict(gathered_of([saved(tmp_path / "a.pcapng", capture(esp))]))
    assert said.sentences[2] == (
        "3 packets are wrapped in something that is not opened, where S7 may be: capture.not_opened names it."
    )


def test_an_empty_capture(tmp_path: Path) -> None:
    said = verdict(gathered_of([saved(tmp_path / "a.pcapng", [])]))
    assert said.sentences[0] == "The capture holds no packets."


def test_the_heaviest_finding_comes_first() -> None:
    rules = heaviest_rules(gathered_of([OWN / "crafted" / "plus-plant.pcapng"]).analysis)
    assert [rule.severity for rule in rules] == sorted(
        [rule.severity for rule in rules], key=["error", "warning", "note"].index
    )
    assert rules[0].slug == "security.plc_stop"


def test_what_was_seen_goes_on_where_the_sentence_ends_and_notes_are_not_counted() -> None:
    gathered = gathered_of([OWN / "crafted" / "reference-examples.pcapng"])
    what, _, who = verdict(gathered).sentences
    assert (
        what
        == "A client sent a PLC stop command: 192.0.2.10:49152 to 192.0.2.20:102: PLC stop, accepted (packets 46, 47)."
    )
    left = [rule.severity for rule in heaviest_rules(gathered.analysis)[1:]]
    errors, warnings = left.count("error"), left.count("warning")
    assert "note" in left
    assert who.endswith(f"; there are {errors} more kinds of errors and {warnings} more kinds of warnings below.")


def test_one_more_kind_is_not_several(tmp_path: Path) -> None:
    talk = begun()
    read(talk, 1, WORD, 0x0A)
    talk.send(1, dt(messages.read_answer(9, [WORD], [0x0A])))
    gathered = gathered_of([saved(tmp_path / "a.pcapng", talk.packets())])
    left = [rule.severity for rule in heaviest_rules(gathered.analysis)[1:] if rule.severity != "note"]
    assert left == ["warning"]
    assert verdict(gathered).sentences[2].endswith("; there is 1 more kind of warning below.")


def test_a_flood_comes_before_the_first_write(tmp_path: Path) -> None:
    """Every plant with a panel has writes."""
    talk = begun()
    for number in range(1, 600):
        talk.send(0, dt(messages.write_job(number, [WORD], [number.to_bytes(2, "big")])))
        talk.send(1, dt(messages.write_answer(number, [0xFF])))
    gathered = gathered_of([saved(tmp_path / "a.pcapng", talk.packets())])
    assert [rule.slug for rule in heaviest_rules(gathered.analysis)] == ["security.flood", "security.write"]
    assert "What stands out: A connection floods a PLC" in verdict(gathered).sentences[0]


def lost(*sizes: int, inside: bool = False, after: bytes = b"") -> Talk:
    """Reads, with so many bytes of the server missing before one after the other."""
    talk = begun()
    for number, size in enumerate(sizes, 1):
        if inside:
            talk.send(1, dt(messages.read_answer(number, [WORD], [b"\0\1"]))[:9])
        talk.skip(1, size)
        if after:
            talk.send(1, after)
        read(talk, number, WORD)
    return talk


@pytest.mark.parametrize(
    ("talk", "said"),
    [
        (lost(400), "1 gap, 400 B, {} %, between messages."),
        (lost(400, 30), "2 gaps, 430 B, {} %, all between messages."),
        (lost(*[7] * 7), "7 gaps, 49 B, {} %, all between messages."),
        (lost(*[7] * 8), "8 gaps, 56 B, {} %, all between messages: a filtered capture."),
        (lost(400, inside=True), "1 gap, 400 B, {} %, inside a message: packets were lost."),
        (lost(*[400] * 9, inside=True), "9 gaps, 3.6 kB, {} %, 9 of them inside messages: packets were lost."),
        (lost(400, after=b"\x77" * 5), "1 gap, 400 B, {} %, begins between messages."),
    ],
)
def test_the_verdict_names_gaps(tmp_path: Path, talk: Talk, said: str) -> None:
    gathered = gathered_of([saved(tmp_path / "a.pcapng", talk.close().packets())])
    pipeline = gathered.analysis.pipeline
    assert pipeline is not None
    octets = pipeline.counters.octets
    share = f"{100 * int(octets.missing) / int(octets.missing + octets.delivered):.1f}"
    assert verdict(gathered).sentences[-1] == said.format(share)
    assert len(verdict(gathered_of([saved(tmp_path / "b.pcapng", begun().close().packets())])).sentences) == 3
