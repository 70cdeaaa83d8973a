from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.testing.golden import GoldenError, Session, golden_text, parse_golden, read_session
from dissect.testing.golden.writing import EXTRAS
from tests.cases import each
from tests.meaning.report.support import OWN, ROOT
from tests.testing.golden.support import WRITTEN

PLANT = ROOT / "captures" / "scd"


def test_a_name_that_cannot_be_shown_reads_back_to_itself() -> None:
    for name in ("\x1b[31m", "\ud7fc", "a\\b"):
        text = golden_text(parse_golden(f"s7dissect golden 1\n\nconnection 1\n  protocol {name}\n  carrier {name}\n"))
        assert golden_text(parse_golden(text)) == text
        assert facts(parse_golden(text)) == facts(parse_golden(text.replace("\\x1b", "\x1b")))


@pytest.mark.parametrize("said", [r"two\nlines", r"\u001b[31m", r"a back\\slash", r"\u0023 no comment"])
def test_what_was_said_at_the_end_reads_back_to_itself(said: str) -> None:
    lines = f'  refused "{said}"\n  ends error_tpdu by server "{said}"\n'
    session = parse_golden(f"s7dissect golden 1\n\nconnection 1\n{lines}")
    text = golden_text(session)
    assert lines in text
    assert facts(parse_golden(text)) == facts(session)


def facts(session: Session) -> list[object]:
    """Return everything that a golden keeps of a session."""
    links = [
        (
            link.number,
            link.who,
            link.begun,
            link.tpdu_size,
            link.tpdu_size_asked,
            link.ended,
            link.ended_by,
            link.farewell,
            link.refused,
        )
        for link in session.links
    ]
    transactions = [
        (
            each.number,
            each.connection.number,
            each.asked_by,
            each.outcome,
            each.reason,
            each.request,
            each.response,
            each.scd,
        )
        for each in session.transactions
    ]
    return [*links, *transactions]


@each("path", [path for path in OWN if path.suffix != ".zst"])
def test_a_golden_reads_back_to_the_session_of_its_capture(path: Path) -> None:
    session = read_session(path)
    again = parse_golden(golden_text(session), path.name)
    assert facts(again) == facts(session)
    assert golden_text(again) == golden_text(session)
    whole = golden_text(session, EXTRAS)
    kept = parse_golden(whole)
    assert golden_text(kept, EXTRAS) == whole
    assert [(each.time_ns, each.latency_ns) for each in kept.transactions] == [
        (each.time_ns, each.latency_ns) for each in session.transactions
    ]


def test_answer_times_of_a_clock_that_jumps_read_back() -> None:
    session = read_session(ROOT / "captures" / "nodes7-poll-missing.pcapng")
    times = [2**63 - 1, 1 - 2**63, 10**18]
    for transaction, time_ns in zip(session.transactions, times, strict=True):
        transaction.latency_ns = time_ns
    kept = parse_golden(golden_text(session, EXTRAS))
    assert [each.latency_ns for each in kept.transactions] == times


def test_scd_reads_back_too() -> None:
    from dissect.meaning.bindings import load_carrier

    carrier = load_carrier(str(PLANT / "plant.toml"), str(PLANT / "plant.bind.toml"))
    session = read_session(PLANT / "plant.pcapng", decoder=carrier)
    said = [line for each in session.transactions for line in each.scd]
    assert "answer   0x6061:0 Режим 1 = 8 (автомат)" in said
    text = golden_text(session)
    assert 'scd "answer   0x6061:0 Режим 1 = 8 (автомат)"' in text
    assert facts(parse_golden(text)) == facts(session)


def test_a_golden_written_by_hand_is_read() -> None:
    session = parse_golden(WRITTEN)
    assert [each.outcome for each in session.transactions] == ["answered"] * 4 + ["unanswered"]
    assert [item.value for item in session.transactions[1].items] == [1234, 3.5, True]
    assert session.transactions[3].error_code == 0xD401
    assert "SETUP\n  asks PDU 480, AmQ 1/1\n  gets PDU 240" in golden_text(session)


def test_remarks_blanks_and_wrapped_lines_say_nothing() -> None:
    changed = WRITTEN.replace("\n\n", "\n\n# a remark\n\n\n").replace("INT = 5", "INT\n            = 5   # new")
    assert facts(parse_golden(changed)) == facts(parse_golden(WRITTEN))


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("golden 1", "golden 2", "format '2' is unknown; this version reads 's7dissect golden 1'"),
        ("s7dissect golden 1", "something", "not a golden: the first line is not 's7dissect golden 1'"),
        ("connection 1", "connexion 1", "line 3: 'connexion 1' starts neither a connection nor a transaction"),
        ("  protocol s7comm", "  speaks s7comm", "line 4: 'speaks s7comm' does not apply to a connection"),
        ("INT = 1234", "INT = 123456", "line 15: 123456 is out of range for the type"),
        ("INT = 1234", "INT", "line 14: an item of an answered READ has neither a value nor 'refused'"),
        ("gets PDU 240, AmQ 1/1", "gets 240", "line 12: 240 is not of the form"),
        ("request Userdata", "request Nothing", "Nothing is not a kind of PDU"),
        ("    refused 0xd401", "    refuses 0xd401", "line 27: 'refuses 0xd401' is neither"),
        ("    refused 0xd401", "   refused 0xd401", "line 27: indented by 3"),
        ("no answer: connection_closed", "no answer: tired", "tired is not a reason; known reasons: connection_closed"),
        ("  gets PDU 240, AmQ 1/1\n", "", "line 10: request or answer is missing"),
        ("data <0a 00 00 00>", "data <0a 00 00 0>", "not hexadecimal"),
        ("data <0a 00 00 00>", "data 0a 00 00 00", "angle brackets"),
        (
            "DB10.DBD8 REAL",
            "DB10.DBX8 REAL",
            "DB10.DBX8 REAL: the address does not fit the type, it would be DB10.DBD8",
        ),
        ("1 client SETUP", "  1 client SETUP", "line 10: '1 client SETUP' does not apply to a connection"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(old: str, new: str, why: str) -> None:
    assert WRITTEN.count(old) == 1
    with pytest.raises(GoldenError, match=why):
        parse_golden(WRITTEN.replace(old, new))


@given(st.data())
def test_an_edited_golden_is_read_or_refused_and_nothing_else(data: st.DataObject) -> None:
    lines = WRITTEN.split("\n")
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(lines) - 1))
        line = lines[at]
        cut = data.draw(st.integers(0, len(line)))
        lines[at] = line[:cut] + data.draw(st.text(max_size=4)) + line[cut + data.draw(st.integers(0, 3)) :]
    text = "\n".join(lines)
    try:
        session = parse_golden(text)
    except GoldenError:
        return
    written = golden_text(session)
    assert facts(parse_golden(written)) == facts(session)


@given(st.text())
def test_any_text_is_read_or_refused(text: str) -> None:
    for beginning in ("", "s7dissect golden 1\n", "s7dissect golden 1\nconnection 1\n1 client READ\n  "):
        try:
            parse_golden(beginning + text)
        except GoldenError:
            continue


@pytest.mark.parametrize("line", ["DB1.DBW0 WORD = 1", "DB1.DBB0 BYTE x9000 = <" + "00 " * 8999 + "00>"])
def test_a_pdu_larger_than_any_is_told_with_its_line(line: str) -> None:
    text = "s7dissect golden 1\n\nconnection 1\n\n1 client WRITE\n" + f"  {line}\n" * 6000
    with pytest.raises(GoldenError, match=r"line 5: .*no PDU has more than 65535"):
        parse_golden(text)


@pytest.mark.parametrize(
    ("below", "why"),
    [
        (b"\0" * 3_000_000, "a line is longer than 512 KiB"),
        (b"connection 1\n" + b"\0" * 300, "byte 32 is NUL: not a golden"),
        (b"connection 1\n" + b"        word\n" * 200_000, "line 2: longer than 512 KiB"),
    ],
)
def test_what_is_no_golden_is_refused_before_it_fills_the_memory(tmp_path: Path, below: bytes, why: str) -> None:
    path = tmp_path / "a.s7.txt"
    path.write_bytes(b"s7dissect golden 1\n" + below)
    with pytest.raises(GoldenError, match=why):
        read_session(path)


def test_how_certain_a_pair_is_is_read_and_written() -> None:
    doubtful = WRITTEN.replace("3 client WRITE\n", "3 client WRITE\n  likely: alike  # why\n", 1)
    doubtful = doubtful.replace("no answer: connection_closed", "no answer: hole, perhaps")
    found = parse_golden(doubtful)
    told = [(one.certainty, one.doubt) for one in found.transactions]
    assert told == [("sure", ""), ("sure", ""), ("likely", "alike"), ("sure", ""), ("likely", "")]
    assert golden_text(parse_golden(golden_text(found))) == golden_text(found)
    assert "  likely: alike  # the answer fits several pending requests with the same reference\n" in golden_text(found)
    sure = parse_golden(WRITTEN.replace("no answer: connection_closed", "no answer: hole"))
    assert [(one.certainty, one.doubt) for one in sure.transactions] == [("sure", "")] * 5
    assert "likely" not in golden_text(sure)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("no answer: connection_closed", "no answer: connection_closed, perhaps", "is not a reason"),
        (
            "no answer: connection_closed",
            "no answer: connection_closed\n  likely: gaps",
            "belongs to a request with its answer",
        ),
        ("3 client WRITE", "3 client WRITE\n  likely: so", "so is not a doubt; known doubts: gaps, alike"),
    ],
)
def test_what_is_wrong_with_a_certainty(old: str, new: str, why: str) -> None:
    with pytest.raises(GoldenError, match=re.escape(why)):
        parse_golden(WRITTEN.replace(old, new))
