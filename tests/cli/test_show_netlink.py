"""`show` on what went through an IBH-NetLink gateway."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.cli.support import run
from tests.meaning.report.schemas import complaints

Capture = pytest.CaptureFixture[bytes]

CRAFTED = Path(__file__).resolve().parents[2] / "captures" / "crafted"
PLAIN, FAULTS = CRAFTED / "netlink.pcapng", CRAFTED / "netlink-faults.pcapng"


def said(lines: list[str]) -> list[str]:
    """Return what lines say, without number, time and addresses."""
    return [re.sub(r"^.*:\d+ → \S+  ", "", line) for line in lines]


def test_a_line_for_each_packet_and_one_for_each_pdu(capfdbinary: Capture) -> None:
    lines = said(run(capfdbinary, "show", PLAIN).out.splitlines())
    assert lines[:5] == [
        "IBH connection asked",
        "IBH connection answered",
        "IBH MPI connect request  station 2, connection 20/0",
        "IBH receipt",
        "IBH MPI connect confirm  station 2, connection 20/20",
    ]
    assert lines[8:12] == [
        "Job       ref 0x0001  Setup communication  PDU 240, AmQ 1/1",
        "IBH receipt",
        "IBH MPI acknowledge  station 2, connection 20/20  of packet 1",
        "Ack_Data  ref 0x0001  Setup communication  PDU 240, AmQ 1/1",
    ]
    assert lines[-1] == "IBH MPI disconnect  station 2, connection 20/20"
    assert len(lines) == 9 + 25


def test_fragments_have_no_line_of_their_own(capfdbinary: Capture) -> None:
    lines = said(run(capfdbinary, "show", FAULTS).out.splitlines())
    assert [line for line in lines if "more to come" in line] == []
    assert sum(line.startswith(("Job", "Ack_Data")) for line in lines) == 23


def test_the_tree_has_both_headers_octet_by_octet(capfdbinary: Capture) -> None:
    lines = run(capfdbinary, "show", "-V", "--frame", "18", PLAIN).out.splitlines()
    rows = [re.fullmatch(r" {6} *(\d+)(?:-(\d+))? {2}(\S+) +(.*)", line) for line in lines[: lines.index("")]]
    fields = [(int(row[1]), int(row[2] or row[1]), row[3], row[4]) for row in rows if row]
    assert fields[:15] == [
        (0, 0, "channel1", "0xff"),
        (1, 1, "channel2", "0x07"),
        (2, 2, "length", "37"),
        (3, 3, "number", "0x00"),
        (4, 5, "s_flags", "0x0000 none"),
        (6, 7, "r_flags", "0x02c2 MPI indication"),
        (8, 8, "src_conn", "0x14"),
        (9, 9, "dst_conn", "0x14"),
        (10, 10, "mpi", "0x02"),
        (11, 11, "unknown1", "0x00"),
        (12, 12, "unknown2", "0x00"),
        (13, 13, "unknown3", "0x22"),
        (14, 14, "length", "30"),
        (15, 15, "function", "0xf1 data"),
        (16, 16, "number", "0x02"),
    ]
    assert [first for first, *_ in fields[1:]] == [last + 1 for _, last, *_ in fields[:-1]]
    assert fields[15][2] == "protocol_id"
    assert fields[-1][1] == 8 + 37 - 1


def test_the_tree_of_a_packet_without_pdu(capfdbinary: Capture) -> None:
    told = run(capfdbinary, "show", "-V", "--frame", "12", PLAIN).out
    assert "0xb0 acknowledge" in told
    assert re.search(r" 17 +octets +01\n", told)
    whole = run(capfdbinary, "show", "-V", "--frame", "5", PLAIN).out
    assert re.search(r" 8-9 +octets +14 00\n", whole)


def test_the_tree_says_what_is_wrong_and_what_came_in_fragments(capfdbinary: Capture) -> None:
    told = run(capfdbinary, "show", "-V", FAULTS).out
    assert told.count("MALFORMED  MPI: length at byte 12 claims") == 1
    assert told.count("reassembled from several MPI packets") == 2  # the other has an octet behind its PDU


def test_jsonl_has_the_pdus(capfdbinary: Capture) -> None:
    told = [json.loads(line) for line in run(capfdbinary, "show", "-T", "jsonl", PLAIN).out.splitlines()]
    assert len(told) == 9
    assert [complaints("pdu", line, exact=True) for line in told] == [[]] * 9


def test_analyze_names_the_protocol_and_counts_the_packets(capfdbinary: Capture) -> None:
    told = run(capfdbinary, "analyze", PLAIN).out
    assert "1  192.0.2.10:49152 → 192.0.2.20:1099, IBH-NetLink\n" in told
    assert re.sub(r"\s+", " ", told).count("IBH-NetLink packets: 9 mpi data, 9 mpi ack, 1 mpi connect") == 1
    as_json = json.loads(run(capfdbinary, "analyze", "-T", "json", PLAIN).out)
    assert complaints("analysis", as_json, exact=True) == []
    assert as_json["connections"][0]["protocol"] == "ibh_netlink"
    assert sum(as_json["ibh"].values()) == 34
