"""Mutations: one thing is changed, in the text of a golden or in the packets, and exactly that is told."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.transactions.transaction import HOLE, PERHAPS_ANSWERED, REASON_TEXTS
from dissect.protocols.s7.errors import ERROR_CODES
from dissect.testing.golden import DiffOptions, Session, diff_sessions, golden_text, parse_golden, read_session
from tests.cases import each
from tests.meaning.report.support import begun, read
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import Flow, Talk, captured
from tests.testing.golden.support import RECORDED, ROOT, WRITTEN, edited, place, reads, session, told

BASE = parse_golden(WRITTEN, "base")
SZL = "transaction 4, CPU functions: read SZL 0x0424 operating modes"
OPEN = "transaction 5, READ DB10.DBW6: was unanswered: the connection ended before an answer came"
WHO = "connection 1, TSAPs: was TSAP 01.00 (PG) → 01.%02d (PG, rack 0 slot %d)"


@pytest.mark.parametrize(
    ("old", "new", "kind", "text"),
    [
        ("INT = 1234", "INT = 1235", "values", "transaction 2, READ DB10.DBW4: was 1234, is 1235"),
        (
            "INT = 1234",
            "INT refused 0x0a",
            "codes",
            "transaction 2, READ DB10.DBW4: was 1234, is refused: Object does not exist (0x0a)",
        ),
        ("REAL = 3.5", "REAL = 3.25", "values", "transaction 2, READ DB10.DBD8: was 3.5, is 3.25"),
        ("BIT = true", "BIT = false", "values", "transaction 2, READ M20.1: was true, is false"),
        ("INT = 1234", "INT = 1234 as BYTE/WORD/DWORD", "transport",
         "transaction 2, READ DB10.DBW4: data header was INTEGER, length 16; is BYTE/WORD/DWORD, length 16"),
        ("INT = 5", "INT = 6", "values", "transaction 3, WRITE DB10.DBW4: was 5, is 6"),
        ("INT = 5", "INT = 5 refused 0x05", "codes",
         "transaction 3, WRITE DB10.DBW4: was 5, is refused: Invalid address (0x05)"),
        ("gets PDU 240, AmQ 1/1", "gets PDU 480, AmQ 1/1", "negotiation",
         "transaction 1, SETUP: granted: was PDU 240, AmQ 1/1, is PDU 480, AmQ 1/1"),
        ("asks PDU 480, AmQ 1/1", "asks PDU 480, AmQ 2/1", "negotiation",
         "transaction 1, SETUP: requested: was PDU 480, AmQ 1/1, is PDU 480, AmQ 2/1"),
        ("    refused 0xd401", "    refused 0xd402", "codes",
         f"{SZL}: was refused: Invalid SZL id (0xd401), is refused: Invalid SZL index (0xd402)"),
        ("    refused 0xd401\n", "", "codes",
         f"{SZL}: was refused: Invalid SZL id (0xd401), is refused: Object does not exist (0x0a)"),
        ("data <ff 09 00 04 04 24 00 00>", "data <ff 09 00 04 04 24 00 01>", "contents",
         f"{SZL}: request, SZL request, szl_index: was 0x0, is 0x1"),
        ("  no answer: connection_closed\n  DB10.DBW6 WORD", "  DB10.DBW6 WORD = 7", "answers",
         f"{OPEN}, is 7"),
        ("no answer: connection_closed", "no answer: hole", "answers",
         f"{OPEN}, is {REASON_TEXTS[HOLE]}"),
        ("no answer: connection_closed", "no answer: hole, perhaps", "answers",
         f"{OPEN}, is {PERHAPS_ANSWERED}"),
        ("DB10.DBW6 WORD", "DB10.DBW8 WORD", "requests",
         "transaction 5, READ DB10.DBW6: requests DB10.DBW8 instead of DB10.DBW6"),
        ("3 client WRITE\n  DB10.DBW4 INT = 5\n", "", "missing", "transaction 3, WRITE DB10.DBW4: missing (was 5)"),
        ("3 client WRITE", "3 client READ\n  MB0 BYTE = 1\n\n4 client WRITE", "added",
         "transaction 3 of the second, READ MB0: added (1)"),
        ("  ends fin by client", "  ends reset by server", "endings",
         "connection 1, end: was fin by the client, is reset by the server"),
        ("  TPDU size 1024, asked 1024", "  TPDU size 512, asked 1024", "negotiation",
         "connection 1, TPDU size: was 1024 (requested 1024), is 512 (requested 1024)"),
        ("server TSAP <01 02>", "server TSAP <01 03>", "tsaps",
         f"{WHO % (2, 2)}, is {WHO.partition('was ')[2] % (3, 3)}"),
        ("  TPDU size", "  begins before the capture\n  TPDU size", "endings",
         "connection 1, beginning: was in the capture, is before the capture"),
    ],
)  # fmt: skip
def test_one_edit_is_one_difference(old: str, new: str, kind: str, text: str) -> None:
    other = edited(WRITTEN, old, new)
    found = diff_sessions(BASE, other)
    assert [(difference.kind, difference.text) for difference in found] == [(kind, text)]
    assert told(BASE, other, kind) == []
    back = diff_sessions(other, BASE)
    assert [difference.kind for difference in back] == [{"missing": "added", "added": "missing"}.get(kind, kind)]


@each("name", RECORDED)
def test_a_capture_is_like_its_golden(name: str) -> None:
    capture = read_session(ROOT / "captures" / f"{name}.pcapng")
    golden = read_session(ROOT / "captures" / "golden" / f"{name}.s7.txt")
    assert told(capture, golden) == told(golden, capture) == []


def test_changes_in_packets() -> None:
    def made(value: bytes | int, pdu: int = 480) -> list[str]:
        talk = begun(length=pdu)
        read(talk, 1, place(0), b"\x00\x01")
        read(talk, 2, place(4), value)
        read(talk, 3, place(8), b"\x00\x02")
        return told(base, session(talk.packets()))

    talk = begun()
    for ref, (at, value) in enumerate(((0, b"\x00\x01"), (4, b"\x04\xd2"), (8, b"\x00\x02")), 1):
        read(talk, ref, place(at), value)
    base = session(talk.packets())
    assert made(b"\x04\xd2") == []
    assert made(b"\x04\xd3") == ["transaction 3, READ DB10.DBW4: was 1234, is 1235"]
    assert made(0x0A) == ["transaction 3, READ DB10.DBW4: was 1234, is refused: Object does not exist (0x0a)"]
    assert made(b"\x04\xd2", 240) == [
        "transaction 1, SETUP: requested: was PDU 480, AmQ 1/1, is PDU 240, AmQ 1/1",
        "transaction 1, SETUP: granted: was PDU 480, AmQ 1/1, is PDU 240, AmQ 1/1",
    ]


def test_a_refusal_in_the_header_is_told_once() -> None:
    talk = begun()
    talk.send(0, dt(messages.read_job(1, [place(0)])))
    talk.send(1, dt(messages.pdu(messages.ACK, 1, b"", b"", 0x8104)))
    (text,) = told(session(reads(0).packets()), session(talk.packets()))
    assert text == f"transaction 2, READ DB10.DBW0: was 0, is refused: {ERROR_CODES.name(0x8104)} (0x8104)"


def test_times_references_ports_and_addresses_are_no_difference() -> None:
    one = session(reads(0, 2, 4).packets())
    talk = reads(0, 2, 4, flow=Flow("192.0.2.1", "192.0.2.2", (1234, 102)))
    other = session(captured(talk.segments, start_ns=10**18, step_ns=77_000_000))
    assert told(one, other) == []


def test_a_request_that_stands_elsewhere_is_reordered() -> None:
    one, other = session(reads(0, 2, 4, 6, 8).packets()), session(reads(0, 8, 2, 4, 6).packets())
    assert told(one, other) == ["transaction 6, READ DB10.DBW8: moved, now transaction 3 of the second"]
    assert told(one, other, "order:READ DB10.DBW8") == []


def spoken(turns: Sequence[str], *, values: Sequence[int] = (0, 1, 2, 3, 4, 5)) -> Session:
    """A session of reads, pushes and jobs of the server, in this order; each kind counts its own."""
    counts = dict.fromkeys("rpj", 0)
    talk = begun()
    for turn in turns:
        number = counts[turn]
        counts[turn] += 1
        if turn == "r":
            read(talk, number + 1, place(2 * number), values[number].to_bytes(2, "big"))
        elif turn == "p":
            indication = b"\x00\x01\x12\x08\x12\x04\x06\x00" + bytes(4)
            talk.send(1, dt(messages.pdu(messages.USERDATA, 0, indication, bytes((0xFF, 9, 0, 1, number)))))
        else:
            talk.send(1, dt(messages.pdu(messages.JOB, 200 + number, bytes((0x1B, 0, 0, 0, 0, 0, 0, number)))))
            talk.send(0, dt(messages.pdu(messages.ACK_DATA, 200 + number, b"\x1b\x00")))
    return session(talk.packets())


@given(st.permutations("rrrrppp"), st.permutations("rrrrppp"))
def test_what_a_server_says_by_itself_may_come_at_any_time(one: list[str], other: list[str]) -> None:
    assert told(spoken(one), spoken(other)) == []


@given(st.permutations("rrrjjj"), st.permutations("rrrjjj"))
def test_what_a_server_asks_may_come_at_any_time(one: list[str], other: list[str]) -> None:
    assert told(spoken(one), spoken(other)) == []


def test_the_order_on_each_side_counts() -> None:
    assert told(spoken("rrpjr"), spoken("prjrr")) == []
    (text,) = told(spoken("rrpj"), spoken("rjrp"))
    assert text.startswith("transaction ")
    assert "moved, now transaction" in text
    assert told(spoken("rrp"), spoken("prr", values=[0, 7])) == ["transaction 3, READ DB10.DBW2: was 1, is 7"]
    (text,) = told(spoken("rrp"), spoken("pprr"))
    assert "of the second" in text
    assert "added (a message that expects no answer)" in text
    (text,) = told(spoken("pprr"), spoken("rpr"))
    assert "missing (was a message that expects no answer)" in text


def test_a_duplicate_is_one_added_request() -> None:
    one, other = session(reads(0, 2, 4).packets()), session(reads(0, 2, 2, 4).packets())
    assert told(one, other) == ["transaction 4 of the second, READ DB10.DBW2: added (2)"]
    assert told(other, one) == ["transaction 4, READ DB10.DBW2: missing (was 2)"]


@given(st.lists(st.integers(0, 4), min_size=1, max_size=25), st.data())
def test_one_lost_poll_is_one_missing_request(polls: list[int], data: st.DataObject) -> None:
    gone = data.draw(st.integers(0, len(polls) - 1))
    one = session(reads(*polls).packets())
    other = session(reads(*(polls[:gone] + polls[gone + 1 :])).packets())
    found = diff_sessions(one, other)
    assert [difference.kind for difference in found] == ["missing"]
    assert found[0].subject == f"READ DB10.DBW{polls[gone]}"


@given(st.lists(st.integers(0, 3), max_size=12), st.lists(st.integers(0, 3), max_size=12))
def test_every_transaction_is_accounted_for(a: list[int], b: list[int]) -> None:
    one, other = session(reads(*a).packets()), session(reads(*b).packets())
    found = diff_sessions(one, other)
    kinds = [difference.kind for difference in found]
    assert len(a) - kinds.count("missing") == len(b) - kinds.count("added")
    assert (found == []) == (golden_text(one) == golden_text(other))


def test_polls_of_the_same_request_are_matched_in_their_order() -> None:
    def polled(values: Sequence[int]) -> Talk:
        talk = begun()
        for ref, value in enumerate(values, 1):
            read(talk, ref, place(4), value.to_bytes(2, "big"))
        return talk

    one, other = session(polled([1, 2, 3, 4]).packets()), session(polled([1, 2, 9, 4]).packets())
    assert told(one, other) == ["transaction 4, READ DB10.DBW4: was 3, is 9"]


def test_connections_are_matched_by_who_and_what() -> None:
    def packets(*talks: Talk) -> list[str]:
        segments = [segment for talk in talks for segment in talk.segments]
        return told(base, session(captured(segments)))

    flows = [Flow(ports=(40000 + number, 102)) for number in range(3)]
    one, two, three = (
        reads(0, 2, flow=flows[0]),
        reads(10, 12, 14, flow=flows[1]),
        reads(20, 22, 24, 26, flow=flows[2]),
    )
    base = session(captured([*one.segments, *two.segments, *three.segments]))
    assert packets(three, one, two) == []
    (missing,) = packets(three, one)
    assert missing.startswith("connection 2 is missing: TSAP 01.00 (PG)")
    assert missing.endswith("4 transactions")
    (added,) = packets(one, two, three, reads(0, flow=Flow(ports=(50000, 102))))
    assert added.startswith("connection 1 of the second is added")
    assert packets(reads(0, 4, flow=flows[0]), two, three) == [
        "transaction 3, READ DB10.DBW2: requests DB10.DBW4 instead of DB10.DBW2"
    ]


def test_latency_is_compared_only_when_asked_and_known() -> None:
    one = session(reads(0, 2).packets())
    slow = session(captured(reads(0, 2).segments, step_ns=1_250_000))
    assert told(one, slow) == []
    assert told(one, slow, latency="24%")[0] == "transaction 1, SETUP: answer time was 1.00 ms, is 1.25 ms"
    assert len(told(one, slow, latency="24%")) == 3
    assert told(one, slow, latency="26%") == []
    assert told(one, slow, latency="251us") == []
    assert len(told(one, slow, latency="249us")) == 3
    assert told(one, slow, latency="10%,5ms") == []
    assert told(one, slow, "latency", latency="1%") == []
    assert told(one, parse_golden(golden_text(slow)), latency="1%") == []
    kept = parse_golden(golden_text(slow, ["latency"]))
    assert len(told(one, kept, latency="1%")) == 3


def test_ignored_values_do_not_decide_what_belongs_together() -> None:
    def written(*values: int) -> Talk:
        talk = begun()
        for ref, value in enumerate(values, 1):
            item = place(4)
            talk.send(0, dt(messages.write_job(ref, [item], [value.to_bytes(2, "big")])))
            talk.send(1, dt(messages.write_answer(ref, [0xFF])))
        return talk

    one, other = session(written(1, 2, 3).packets()), session(written(3, 1, 2).packets())
    assert [difference.kind for difference in diff_sessions(one, other)] == ["order"]
    for pattern in ("values", "values:DB10.DBW4", "values:DB10.*"):
        assert diff_sessions(one, other, DiffOptions([pattern])) == []
    assert diff_sessions(one, other, DiffOptions(["values:DB11.*"])) != []


def test_times_can_be_ignored() -> None:
    one = read_session(ROOT / "captures" / "golden" / "clock.s7.txt")
    text = golden_text(one)
    other = parse_golden(text.replace("26 11 21 01 31 26", "26 11 21 01 31 27"))
    kinds = {difference.kind for difference in diff_sessions(one, other)}
    assert kinds == {"time"}
    assert told(one, other, "time") == []


def test_scd_is_compared_by_its_values() -> None:
    lines = '\n  scd "answer plant: T1"\n  scd "answer   0x6041:0 Status = 567"\n'
    one = edited(WRITTEN, "  DB10.DBW4 INT = 5\n", f"  DB10.DBW4 INT = 5{lines}")
    other = edited(WRITTEN, "  DB10.DBW4 INT = 5\n", f"  DB10.DBW4 INT = 5{lines.replace('567', '568')}")
    assert told(one, other) == [
        "transaction 3, WRITE DB10.DBW4: answer: was 0x6041:0 Status = 567, is 0x6041:0 Status = 568"
    ]
    assert told(one, other, "scd:0x6041:*") == []


def test_tsaps_of_another_protocol_have_no_rack_and_slot() -> None:
    one = edited(WRITTEN, "protocol s7comm", "protocol mms")
    assert "# 01.00\n" in golden_text(one)
    assert "# 01.02\n" in golden_text(one)
    assert told(one, BASE) == ["connection 1, protocol: was mms, is s7comm"]


def test_another_list_or_block_is_another_request() -> None:
    """An index of the same list that changed is one difference of one request (`test_one_edit_is_one_difference`)."""
    szl = "ff 09 00 04 04 24 00 00"
    other_list = "transaction 4 of the second, CPU functions: read SZL 0x0132 communication status"
    assert told(BASE, edited(WRITTEN, szl, szl.replace("04 24", "01 32"))) == [
        f"{SZL}: missing (was refused: Invalid SZL id (0xd401))",
        f"{other_list}: added (refused: Invalid SZL id (0xd401))",
    ]
    info = WRITTEN.replace("44 01 00>", "43 03 00>").replace(szl, "ff 09 00 08 30 41 30 30 30 30 31 41")
    found = diff_sessions(parse_golden(info, "block"), edited(info, "31 41>", "32 41>"))
    assert [difference.kind for difference in found] == ["missing", "added"]


def test_long_arrays_name_what_changed() -> None:
    one = edited(WRITTEN, "DB10.DBW4 INT = 1234", "DB10.DBB0 BYTE x40 = <" + "00 " * 39 + "00>")
    other = edited(WRITTEN, "DB10.DBW4 INT = 1234", "DB10.DBB0 BYTE x40 = <" + "00 " * 19 + "07" + " 00" * 20 + ">")
    assert told(one, other) == ["transaction 2, READ DB10.DBB0 x40: byte 19 was 00, is 07"]


def test_texts_are_safe_to_show() -> None:
    one = edited(WRITTEN, "protocol s7comm", "protocol \x1b[31m")
    (text,) = told(one, BASE)
    assert "\x1b" not in text
