from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from dissect.protocols.iso.tables import DR_REASONS
from tests.cases import each
from tests.cli.support import halves, run, simple
from tests.meaning.report.schemas import complaints
from tests.meaning.report.support import OWN, WORD, begun, read, saved
from tests.properties import messages
from tests.properties.messages import EMPTY_DT, Item, dt, fragments
from tests.properties.packets import Talk, cut_to

Capture = pytest.CaptureFixture[bytes]


def hex_view(lines: list[str]) -> bytes:
    """Return the octets of the hex views in an output."""
    return bytes.fromhex("".join([line[11:59] for line in lines if re.match(r" {4} *\d+ {2}[0-9a-f]{2} ", line)]))


def show(capfdbinary: Capture, talk: Talk, path: Path, *options: str) -> list[str]:
    return run(capfdbinary, "show", *options, saved(path, talk.packets())).out.splitlines()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.pcapng"


def test_text_has_a_line_for_each_pdu_and_what_else_is_said(capfdbinary: Capture, path: Path) -> None:
    talk = read(begun(), 1).send(0, EMPTY_DT).send(1, dt(b"\x17\x03\x03" + bytes(19))).send(0, messages.disconnect(1))
    saved(path, talk.packets(), {8: "here it comes"})
    lines = run(capfdbinary, "show", path).out.splitlines()
    assert [int(line.split()[0]) for line in lines] == [4, 5, 6, 7, 8, 8, 9, 11, 12]
    assert [line.split("102  ")[-1].split("49152  ")[-1].split("  ")[0] for line in lines] == [
        "COTP CR",
        "COTP CC",
        "Job",
        "Ack_Data",
        "",
        "Job",
        "Ack_Data",
        "COTP DT",
        "COTP DR",
    ]
    assert lines[4] == "     8  comment: here it comes"
    assert lines[7].endswith("COTP DT  TLS, 22 bytes: TLS 1.2 or 1.3 application data")


def test_jsonl_has_a_line_for_each_pdu_and_what_else_is_said(capfdbinary: Capture, path: Path) -> None:
    talk = read(begun(), 1).send(1, dt(b"\x17\x03\x03" + bytes(20)))
    saved(path, talk.packets(), {8: "here it comes"})
    told = [json.loads(line) for line in run(capfdbinary, "show", "-T", "jsonl", path).out.splitlines()]
    assert [line["frame"] for line in told] == [4, 5, 6, 7, 8, 9, 10]
    assert [line["frame"] for line in told if line["protocol"] == "s7comm"] == [6, 7, 8, 9]
    assert [complaints("pdu", line, exact=True) for line in told] == [[]] * 7


@pytest.mark.parametrize("face", ["text", "jsonl"])
def test_one_packet(capfdbinary: Capture, path: Path, face: str) -> None:
    saved(path, read(begun(), 1).packets())
    ran = run(capfdbinary, "show", "-T", face, "--frame", "8", path)
    assert (ran.code, ran.err) == (0, "")
    (line,) = ran.out.splitlines()
    assert "DB10.DBW4" in line


def test_a_packet_that_completes_nothing_is_told(capfdbinary: Capture, path: Path) -> None:
    saved(path, read(begun(), 1).packets())
    ran = run(capfdbinary, "show", "--frame", "1", path)
    assert (ran.code, ran.out, ran.err) == (0, "", "s7dissect: packet 1 completes no message\n")
    ran = run(capfdbinary, "show", "-T", "jsonl", "--frame", "1", path)
    assert (ran.code, ran.out, ran.err) == (0, "", "s7dissect: packet 1 completes no message\n")


def test_jsonl_has_the_tpdus_that_carry_no_pdu(capfdbinary: Capture, path: Path) -> None:
    talk = begun().send(1, dt(b"\x17\x03\x03" + bytes(19))).send(0, messages.disconnect(1))
    saved(path, talk.packets())
    told = [json.loads(line) for line in run(capfdbinary, "show", "-T", "jsonl", path).out.splitlines()]
    assert [complaints("pdu", line, exact=True) for line in told] == [[]] * len(told)
    request, confirm, *_, foreign, leave = [line for line in told if line["protocol"] == "cotp"]
    assert [line["cotp"]["type"] for line in (request, confirm, foreign, leave)] == ["CR", "CC", "DT", "DR"]
    assert (request["frame"], request["rosctr"], request["function"]) == (4, None, {"code": None, "name": None})
    assert (request["cotp"]["calling_tsap"]["text"], request["cotp"]["called_tsap"]["slot"]) == ("01.00", 2)
    assert (foreign["cotp"]["carries"], foreign["cotp"]["octets"]) == ("TLS", 22)
    assert leave["cotp"]["reason"] == {"code": 1, "name": DR_REASONS.name(1)}


def test_a_packet_that_does_not_exist_is_wrong_use(capfdbinary: Capture, path: Path) -> None:
    saved(path, read(begun(), 1).packets())
    ran = run(capfdbinary, "show", "--frame", "10", path)
    assert (ran.code, ran.out, ran.err) == (2, "", "s7dissect: no packet 10; the last one is 9\n")


def test_in_several_files_a_packet_is_that_of_each(capfdbinary: Capture, tmp_path: Path) -> None:
    first, second = halves(tmp_path)
    lines = run(capfdbinary, "show", "--frame", "1", first, second).out.splitlines()
    assert [line.split("  ")[0] for line in lines] == [f"{second}:1"]
    lines = run(capfdbinary, "show", "-T", "jsonl", first, second).out.splitlines()
    told = [json.loads(line) for line in lines]
    assert [(Path(line["file"]).name, line["frame"]) for line in told] == [
        *[("first.pcapng", number) for number in (4, 5, 6, 7, 8, 9, 10)],
        *[("second.pcapng", number) for number in (1, 2)],
    ]
    assert [complaints("pdu", line, exact=True) for line in told] == [[]] * len(told)
    assert run(capfdbinary, "show", "--frame", "11", first, second).code == 2


def test_verbose_and_jsonl_do_not_go_together(capfdbinary: Capture, path: Path) -> None:
    saved(path, begun().packets())
    ran = run(capfdbinary, "show", "-V", "-T", "jsonl", path)
    assert (ran.code, ran.out) == (2, "")
    assert "-V applies to text" in ran.err


# ---- the tree on real ways to travel --------------------------------------------------------------------------------


def test_verbose_shows_connects_too(capfdbinary: Capture, path: Path) -> None:
    lines = show(capfdbinary, begun(), path, "-V", "--frame", "4")
    assert lines[0].endswith("COTP CR  TSAP 01.00 (PG) → 01.02 (PG, rack 0 slot 2), TPDU size 1024")
    assert [line for line in lines if line.endswith("called TSAP      01 02")]
    assert hex_view(lines) == messages.connect(0xE0)


def test_several_pdus_in_a_segment_have_a_tree_each(capfdbinary: Capture, path: Path) -> None:
    one, two = messages.read_job(1, [WORD]), messages.read_job(2, [Item(0x02, 1, 7, 0x84, 0)])
    lines = show(capfdbinary, begun(amq=2).send(0, dt(one) + dt(two)), path, "-V", "--frame", "8")
    assert [line.split("  ")[-1] for line in lines if line.startswith("     8 ")] == ["DB10.DBW4", "DB7.DBB0"]
    assert hex_view(lines) == dt(one) + dt(two)
    assert len([line for line in lines if line.split()[:2] == ["7", "protocol_id"]]) == 2


def test_a_pdu_over_several_segments_is_whole(capfdbinary: Capture, path: Path) -> None:
    octets = dt(messages.read_job(1, [WORD]))
    lines = show(capfdbinary, begun().send(0, octets[:5], octets[5:20], octets[20:]), path, "-V", "--frame", "10")
    assert hex_view(lines) == octets


def test_a_pdu_in_fragments_counts_from_its_own_beginning(capfdbinary: Capture, path: Path) -> None:
    pdu = messages.read_job(1, [WORD])
    lines = show(capfdbinary, begun().send(0, fragments(pdu, [5, 12])), path, "-V", "--frame", "8")
    assert "reassembled from several COTP fragments" in lines[1]
    assert hex_view(lines) == pdu


def test_an_empty_dt_before_a_pdu_does_not_make_it_fragments(capfdbinary: Capture, path: Path) -> None:
    pdu = messages.read_job(1, [WORD])
    lines = show(capfdbinary, begun().send(0, EMPTY_DT + dt(pdu)), path, "-V", "--frame", "8")
    assert hex_view(lines) == dt(pdu)


def test_a_cut_pdu(capfdbinary: Capture, path: Path) -> None:
    packets = begun().send(0, dt(messages.read_job(1, [WORD]))).packets()
    packets[-1] = cut_to(packets[-1], 54 + 7 + 15)
    lines = run(capfdbinary, "show", "-V", "--frame", "8", saved(path, packets)).out.splitlines()
    assert "TRUNCATED by the capture" in lines[0]
    assert "truncated by the capture; offsets count from the start of the S7 PDU" in lines[1]
    assert hex_view(lines) == messages.read_job(1, [WORD])[:15]


@each("capture", OWN)
def test_every_pdu_of_our_captures_has_a_tree_with_its_octets(capfdbinary: Capture, capture: Path) -> None:
    ran = run(capfdbinary, "show", "-V", capture)
    lines = ran.out.splitlines()
    every = [json.loads(line) for line in run(capfdbinary, "show", "-T", "jsonl", capture).out.splitlines()]
    told = [line for line in every if line["protocol"] != "cotp"]
    plus = [line for line in told if line["protocol"] == "s7comm_plus"]
    assert len([line for line in lines if re.search(r"  ref (0x[0-9a-f]{4}|\?)", line)]) == len(told) - len(plus)
    assert len([line for line in lines if line == "    S7 header"]) == len(told) - len(plus)
    assert len([line for line in lines if line.startswith("    S7comm-plus header")]) == len(plus)


def test_help_says_what_a_person_needs(capfdbinary: Capture) -> None:
    told = run(capfdbinary, "show", "--help").out
    for word in ("FILE", "UTC", "--frame N", "-V, --verbose", "jsonl", "Exit code:"):
        assert word in told


def test_several_packets_may_be_named(capfdbinary: Capture, tmp_path: Path) -> None:
    path = simple(tmp_path / "x.pcapng")
    ran = run(capfdbinary, "show", "-T", "jsonl", "--frame", "8", "--frame", "6")
    assert ran.code == 2  # no file
    ran = run(capfdbinary, "show", "-T", "jsonl", "--frame", "8", "--frame", "6", path)
    assert [json.loads(line)["frame"] for line in ran.out.splitlines()] == [6, 8]
    ran = run(capfdbinary, "show", "-T", "jsonl", "--frame", "8", "--frame", "1", path)
    assert [json.loads(line)["frame"] for line in ran.out.splitlines()] == [8]
    assert ran.err == "s7dissect: packet 1 completes no message\n"


@pytest.mark.parametrize("face", ["text", "jsonl"])
def test_frames_may_be_several_and_each_is_shown(capfdbinary: Capture, tmp_path: Path, face: str) -> None:
    path = saved(tmp_path / "a.pcapng", read(read(begun(), 1), 2).packets())
    lines = [run(capfdbinary, "show", "-T", face, "--frame", str(number), path).out for number in (8, 9, 11)]
    assert all(lines)
    asked = ["--frame", "11", "--frame", "8", "--frame", "9"]
    assert run(capfdbinary, "show", "-T", face, *asked, path).out == "".join(lines)


def test_the_line_and_the_tree_of_s7comm_plus_give_a_fault_the_same_place(capfdbinary: Capture) -> None:
    """Six zeros too many in a request of s7commplus: at byte 69 of its PDU, which is byte 76 of its TPKT."""
    capture = Path(__file__).parents[2] / "captures" / "s7plus" / "s7commplus.pcapng"
    lines = run(capfdbinary, "show", "-V", "--frame", "14", capture).out.splitlines()
    fault = "MALFORMED {}s7plus: 6 bytes too many at byte 69, in the PDU{}"
    assert [line[line.find("MALFORMED") :] for line in lines if "MALFORMED" in line] == [
        fault.format("", ""),
        fault.format(" ", " (byte 76 here)"),
    ]
    assert [line.split() for line in lines if line.startswith("          76-81 ")] == [
        ["76-81", "octets", *["00"] * 6],
    ]
    told = run(capfdbinary, "transactions", "-Y", "frame == 14", capture).out
    assert told.rstrip().endswith(fault.format("request: ", ""))


def test_every_tpdu_has_a_line_if_asked_for(capfdbinary: Capture, path: Path) -> None:
    """A request in three fragments, an empty DT before its answer, one behind it, and an empty TSDU."""
    job, told = messages.read_job(1, [WORD]), messages.read_answer(1, [WORD], [b"\0\7"])
    talk = begun()
    for at in (0, 11, 22):
        talk.send(0, dt(job[at : at + 11], eot=at == 22))
    talk.send(1, EMPTY_DT).send(1, dt(told)).send(0, EMPTY_DT).send(0, dt(b""))
    saved(path, talk.packets())
    lines = run(capfdbinary, "show", "--tpdus", path).out.splitlines()
    assert [line[line.index("COTP") :] for line in lines if "COTP" in line][4:] == [
        "COTP DT  first part of a message, 11 bytes",
        "COTP DT  part of a message, 11 bytes",
        f"COTP DT  last part of a message, {len(job) - 22} bytes",
        "COTP DT  empty, acknowledges Read Var of packet 10 after 1.00 ms",
        f"COTP DT  S7comm, {len(told)} bytes",
        "COTP DT  empty",
        "COTP DT  empty",
    ]
    assert [line for line in lines if "COTP DT" not in line] == run(capfdbinary, "show", path).out.splitlines()
    objects = [json.loads(line) for line in run(capfdbinary, "show", "--tpdus", "-T", "jsonl", path).out.splitlines()]
    sizes = [one["cotp"]["octets"] for one in objects if one["protocol"] == "cotp" and one["cotp"]["type"] == "DT"]
    assert sizes[2:] == [11, 11, len(job) - 22, 0, len(told), 0, 0]
    assert [complaints("pdu", one, exact=True) for one in objects] == [[]] * len(objects)


def test_a_tree_of_each_tpdu_has_its_headers_alone(capfdbinary: Capture, path: Path) -> None:
    """The content of a fragment is shown with its message, which may be hidden."""
    job = messages.read_job(1, [WORD])
    talk = begun().send(0, dt(job[:11], eot=False)).send(0, dt(job[11:])).send(1, EMPTY_DT)
    saved(path, talk.packets())
    for frame, ends in (("8", "0"), ("10", "0")):
        shown = run(capfdbinary, "show", "--tpdus", "-V", "--frame", frame, path).out.splitlines()
        assert "COTP DT" in shown[0]
        assert [line.split()[1:] for line in shown if line.split()[1:2] == ["eot"]] == [["eot", ends]]
        assert shown[-2].split()[1] == "tpdu_nr"
    whole = run(capfdbinary, "show", "--tpdus", "-V", "--frame", "9", path).out.splitlines()
    assert hex_view(whole) == job
