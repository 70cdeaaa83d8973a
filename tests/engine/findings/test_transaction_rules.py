from __future__ import annotations

import struct
from pathlib import Path

import pytest

from dissect.engine.findings.reporter import Finding
from dissect.engine.pipeline import Options, Pipeline
from dissect.meaning.tags import load_tags
from tests import build
from tests.engine.findings import events
from tests.engine.transactions.talk import (
    CLIENT,
    MS,
    SECOND,
    SERVER,
    Talk,
    ack,
    ack_data,
    dbw,
    dt,
    good,
    head,
    item,
    job,
    read,
    refused,
    userdata,
    words,
    write,
    written,
)


@pytest.fixture
def talk() -> Talk:
    """A connection that is set up."""
    talk = Talk()
    talk.open(8, 8)
    return talk


def only(talk: Talk, slug: str) -> Finding:
    found = [finding for finding in talk.findings if finding.slug == slug]
    assert len(found) == 1, talk.slugs()
    return found[0]


def test_a_good_answer_is_worth_nothing(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1), after_ns=SECOND)  # the limit itself is not over it
    talk.close()
    assert talk.findings == []


# ---- slow -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("limit_ns", "took_ns", "detail"),
    [
        (SECOND, 1_500 * MS, "Read Var DB1.DBW0: 1.50 s, the limit is 1.00 s"),
        (SECOND, SECOND + 2_014_000, "Read Var DB1.DBW0: 2.01 ms over the limit of 1.00 s"),
        (MS // 2, MS, "Read Var DB1.DBW0: 1.00 ms, the limit is 500 µs"),
    ],
)
def test_slow_answers(limit_ns: int, took_ns: int, detail: str) -> None:
    talk = Talk(slow_ns=limit_ns)
    asked = talk.ask(read(1, dbw(1, 0)))
    answered = talk.tell(words(1, 1), after_ns=took_ns)
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(words(2, 1), after_ns=limit_ns)
    finding = only(talk, "transaction.slow")
    assert (finding.frames, finding.detail) == ([asked, answered], detail)
    assert finding.time_ns == talk.transactions[0].response_ns


def test_a_slow_answer_to_a_request_that_was_sent_again() -> None:
    """Then the network may be slow, or the device gone for a moment, not only busy."""
    talk = Talk()
    octets = dt(read(1, dbw(1, 0)))
    talk.packet(CLIENT, octets)
    frame = talk.packet(CLIENT, octets, seq=talk.seq[CLIENT] - len(octets), after_ns=300 * MS)
    talk.tell(words(1, 1), after_ns=900 * MS)
    detail = f"Read Var DB1.DBW0: 1.20 s, the limit is 1.00 s; request sent again after 300 ms (packet {frame})"
    assert only(talk, "transaction.slow").detail == detail


def test_no_answer_to_a_request_that_was_sent_again() -> None:
    talk = Talk()
    octets = dt(read(1, dbw(1, 0)))
    talk.packet(CLIENT, octets)
    talk.packet(SERVER)
    frame = talk.packet(CLIENT, octets, seq=talk.seq[CLIENT] - len(octets), after_ns=2000 * MS)
    talk.close()
    assert only(talk, "transaction.unanswered").detail.endswith(f"; request sent again after 2.00 s (packet {frame})")


# ---- refused --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "told", "detail"),
    [
        (job(1, b"\x1d" + bytes(17)), ack(1, 0xD209), "Start upload: 0xd209 Block not found"),
        (read(1, dbw(1, 0)), ack(1, 0x8104), "Read Var DB1.DBW0: 0x8104 Service not implemented or frame error"),
        (
            events.service(1, "_GARB"),
            ack_data(1, b"\x28\x02", b"", 0xD2A9),
            "PI service: 0xd2a9 CPU parameters being assigned",
        ),
        (
            userdata(1, head(1, 4, 1)),
            userdata(1, head(2, 4, 1, 0, 0xD402)),
            "CPU functions: read SZL: 0xd402 Invalid SZL index",
        ),
        # A header error weighs more than what the items say.
        (
            read(1, dbw(1, 0)),
            ack_data(1, b"\x04\x01", refused(5), 0x8404),
            "Read Var DB1.DBW0: 0x8404 Function cannot be performed",
        ),
    ],
)
def test_refused(talk: Talk, asked: bytes, told: bytes, detail: str) -> None:
    first = talk.ask(asked)
    second = talk.tell(told)
    finding = only(talk, "transaction.refused")
    assert (finding.frames, finding.detail) == ([first, second], detail)
    assert [slug for slug in talk.slugs() if not slug.startswith("security.")] == ["transaction.refused"]


def test_a_write_that_was_refused_hides_none_that_is_carried_out_later(talk: Talk) -> None:
    for reference, code, answer in ((1, 0x8404, b""), (2, 0, b"\xff"), (3, 0, b"\xff")):
        talk.ask(write(reference, [dbw(1, 0)], written(4, b"\0\1")))
        talk.tell(ack_data(reference, b"\x05\x01", answer, code))
    finding = only(talk, "security.write")
    assert ", refused" not in finding.detail


def test_item_errors(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0), dbw(1, 2), dbw(99, 4)))
    talk.tell(ack_data(1, b"\x04\x03", refused(0x05) + good(4, b"\0\1") + refused(0x0A)))
    assert [(finding.slug, finding.detail) for finding in talk.findings] == [
        ("transaction.item_error", "Read Var DB1.DBW0: 0x05 Invalid address"),
        ("transaction.item_error", "Read Var DB99.DBW4: 0x0a Object does not exist"),
    ]


def test_item_errors_of_a_write(talk: Talk) -> None:
    talk.ask(write(1, [dbw(1, 0)], written(4, b"\0\1")))
    talk.tell(ack_data(1, b"\x05\x01", b"\x07"))
    assert only(talk, "transaction.item_error").detail == "Write Var DB1.DBW0 = 1: 0x07 Data type inconsistent"


def test_many_items_are_named_in_part(talk: Talk) -> None:
    talk.ask(read(1, *(dbw(1, 2 * number) for number in range(5))))
    talk.tell(ack(1, 0x8104))
    detail = only(talk, "transaction.refused").detail
    assert detail.startswith("Read Var DB1.DBW0, DB1.DBW2, DB1.DBW4 and 2 more: 0x8104 ")


def test_a_push_with_an_error_refuses_nothing(talk: Talk) -> None:
    talk.tell(userdata(0, head(0, 2, 1, 4, 0xD807)))
    assert talk.slugs() == ["operation.stray_push"]
    assert talk.transactions[0].has_errors


def test_a_usend_needs_no_subscription(talk: Talk) -> None:
    """A program sends on its own to the one that waits with URCV."""
    block = bytes.fromhex("00011206130000000001")
    talk.tell(userdata(0, block, bytes.fromhex("ff0000010009000201020000")[:10]))
    assert talk.slugs() == []


# ---- unanswered and orphans -----------------------------------------------------------------------------------------


def test_unanswered_at_the_end_of_a_connection(talk: Talk) -> None:
    asked = talk.ask(read(1, dbw(1, 0)))
    talk.close()
    finding = only(talk, "transaction.unanswered")
    assert (finding.frames, finding.detail) == (
        [asked],
        "Read Var DB1.DBW0: the client closed the connection 1.00 ms later",
    )


@pytest.mark.parametrize(("left_ns", "count"), [(SECOND, 0), (SECOND + MS, 1)])
def test_at_the_end_of_a_capture_the_answer_may_just_be_late(talk: Talk, left_ns: int, count: int) -> None:
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(SERVER, after_ns=left_ns)
    talk.finish()
    assert talk.slugs() == ["transaction.unanswered"] * count


def test_a_hole_is_to_blame_not_the_device(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0)))
    talk.lose(SERVER, words(1, 1))
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(words(2, 1))
    talk.wait(2 * SECOND)
    talk.close()
    assert talk.slugs() == ["stream.hole"]
    assert sorted(talk.outcomes()) == ["answered", "unanswered"]


def test_a_reference_used_again() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.ask(read(1, dbw(1, 2)))
    talk.tell(words(1, 1))
    talk.close()
    assert only(talk, "transaction.unanswered").detail.startswith(
        "Read Var DB1.DBW0: the requesting side reused the reference"
    )


def test_orphans(talk: Talk) -> None:
    frame = talk.tell(words(0x1234, 1))
    talk.close()
    finding = only(talk, "transaction.orphan")
    assert (finding.frames, finding.detail) == ([frame], "Read Var: reference 0x1234")
    assert finding.time_ns == talk.transactions[0].response_ns


def test_an_orphan_s_errors_are_told_too(talk: Talk) -> None:
    talk.tell(ack(5, 0xD209))
    talk.close()
    assert talk.slugs() == ["transaction.orphan", "transaction.refused"]


def test_orphans_that_are_no_wonder() -> None:
    talk = Talk()
    talk.tell(words(1, 1))
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(words(2, 1))
    talk.close()
    assert talk.outcomes() == ["orphan_answer", "answered"]
    assert talk.findings == []


def test_a_full_table_is_told_with_what_it_costs(talk: Talk) -> None:
    talk.flood(4100)
    counts = talk.pipeline.finding_counts
    assert counts["transaction.table_full"] == counts["transaction.unanswered"] == 4
    first = next(finding for finding in talk.findings if finding.slug == "transaction.table_full")
    assert first.frames == [talk.transactions[0].request_frame]


# ---- answers that do not fit ----------------------------------------------------------------------------------------


def test_another_function(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(ack_data(1, b"\x05\x01", b"\xff"))
    assert only(talk, "transaction.function_mismatch").detail == "Read Var DB1.DBW0: the answer names Write Var"
    assert talk.slugs() == ["transaction.function_mismatch"]


def test_another_subfunction(talk: Talk) -> None:
    talk.ask(userdata(1, head(1, 3, 3)))
    talk.tell(userdata(1, head(2, 3, 2, 0, 0)))
    detail = only(talk, "transaction.function_mismatch").detail
    assert detail == "block functions: get block info: the answer names block functions: list blocks of type"


def test_another_number_of_items(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0), dbw(1, 2)))
    talk.tell(words(1, 1))
    assert only(talk, "transaction.count_mismatch").detail.endswith("requested 2 items, got 1")


def test_another_size(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0), dbw(1, 2)))
    talk.tell(ack_data(1, b"\x04\x02", good(4, b"\0\1") + good(4, b"\0\1\2\3")))
    assert only(talk, "transaction.size_mismatch").detail.endswith("item 2 (DB1.DBW2) requested 2 bytes, got 4")


@pytest.mark.parametrize(
    ("told", "detail"),
    [
        (
            ack_data(1, b"\x04\x01", good(4, b"\0\1") + b"\0\0"),
            "2 bytes too many behind data items at byte 20, in the data part",
        ),
        (
            ack_data(1, b"\x04\x01", b"\xff\x04\x00\x10\x00"),
            "data.length at byte 14 claims 2 bytes, the data part has 1",
        ),
        (ack_data(1, b"\x04\x01"), "data items at byte 14: 1 announced, 0 there"),
    ],
)
def test_a_read_answer_that_contradicts_itself(talk: Talk, told: bytes, detail: str) -> None:
    talk.ask(read(1, dbw(1, 0)))
    frame = talk.tell(told)
    finding = only(talk, "s7.malformed")
    assert (finding.frames, finding.detail) == ([frame], f"Ack_Data from 10.0.0.2:102, Read Var DB1.DBW0: s7: {detail}")


#: A PI service as python-snap7 3.3 asks for the deletion of a block: an octet is missing before the length of its block.
SHIFTED = bytes.fromhex("28 00000000000805 0034") + b"100001P_DELE"


#: The answer to start upload, with a text of seven digits that is said to have nine.
LONGER = bytes.fromhex("1d00 0100 00000007 09") + b"0000300"


def test_a_command_that_contradicts_itself(talk: Talk) -> None:
    asked = talk.ask(job(2, SHIFTED))
    talk.tell(ack_data(2, b"\x28", code=0x8104))
    talk.ask(events.start_upload(3))
    told = talk.tell(ack_data(3, LONGER))
    talk.ask(events.start_upload(4))
    talk.tell(ack_data(4, LONGER.replace(b"\x09", b"\x00")))  # as some servers do: octets that nothing announces
    assert [(one.frames, one.detail) for one in talk.findings if one.slug == "s7.malformed"] == [
        (
            [asked],
            "Job from 10.0.0.1:50000, PI service: s7: block_length at byte 20 claims 52 bytes, the parameter part has 12",
        ),
        (
            [told],
            "Ack_Data from 10.0.0.2:102, Start upload: s7: length_length at byte 20 claims 9 bytes, the parameter part has 7",
        ),
    ]


def test_a_write_answer_that_contradicts_itself(talk: Talk) -> None:
    talk.ask(write(1, [dbw(1, 0)], written(4, b"\0\1")))
    talk.tell(ack_data(1, b"\x05\x01", b"\xff\xff"))
    assert "return codes at byte 14: 1 announced, 2 there" in only(talk, "s7.malformed").detail


@pytest.mark.parametrize("answered", [True, False])
def test_a_write_request_that_contradicts_itself(talk: Talk, answered: bool) -> None:
    asked = talk.ask(write(1, [dbw(1, 0), dbw(1, 2)], written(4, b"\0\1")))
    if answered:
        talk.tell(ack_data(1, b"\x05\x02", b"\xff\xff"))
    talk.close()
    finding = only(talk, "s7.malformed")
    assert finding.frames == [asked]
    assert finding.detail == (
        "Job from 10.0.0.1:50000, Write Var DB1.DBW0 = 1, DB1.DBW2: s7: data items at byte 42: 2 announced, 1 there"
    )


def test_a_write_request_that_contradicts_itself_and_found_its_answer_waiting(talk: Talk) -> None:
    request = write(1, [dbw(1, 0)], b"")
    talk.acked[SERVER] = talk.seq[CLIENT] + len(dt(request))
    talk.tell(ack_data(1, b"\x05\x01", b"\xff"))
    talk.ask(request)
    assert sorted(talk.slugs()) == ["s7.malformed", "security.write", "transaction.reordered"]


@pytest.mark.parametrize(
    ("group", "subfunction", "said"),
    [
        (7, 2, "time functions: set clock: s7: clock at byte 22 needs 10 bytes, the item has 3"),
        (5, 1, "security: PLC password: s7: password at byte 22 needs 8 bytes, the item has 3"),
    ],
)
def test_a_service_with_too_few_bytes(talk: Talk, group: int, subfunction: int, said: str) -> None:
    asked = talk.ask(userdata(1, head(1, group, subfunction), build.payload(b"\0\x20\x24")))
    talk.tell(userdata(1, head(2, group, subfunction, code=0)))
    finding = only(talk, "s7.malformed")
    assert (finding.frames, finding.detail) == ([asked], f"Userdata from 10.0.0.1:50000, {said}")


def test_a_bsend_that_states_more_than_it_has(talk: Talk) -> None:
    asked = talk.ask(userdata(1, head(1, 6, 1, code=0), build.payload(b"\x12\x06\x13\0\0\0\0\x15\0\x28abc")))
    talk.tell(userdata(1, head(2, 6, 1, code=0)))
    finding = only(talk, "s7.malformed")
    said = "PBC (programmable block communication): BSEND: s7: total_length at byte 36 claims 40 bytes, the item has 3"
    assert (finding.frames, finding.detail) == ([asked], f"Userdata from 10.0.0.1:50000, {said}")


def test_an_answer_before_its_request(talk: Talk) -> None:
    request = read(1, dbw(1, 0))
    talk.acked[SERVER] = talk.seq[CLIENT] + len(dt(request))
    answered = talk.tell(words(1, 1))
    asked = talk.ask(request, after_ns=2 * MS)
    finding = only(talk, "transaction.reordered")
    assert (finding.frames, finding.time_ns) == ([asked, answered], talk.transactions[0].request_ns)
    assert finding.detail == "Read Var DB1.DBW0: the answer precedes the request by 2.00 ms"


def test_an_item_error_names_the_tag_and_what_was_to_be_written(tmp_path: Path) -> None:
    tags = tmp_path / "tank.csv"
    tags.write_text(
        "address,type,name,unit\nDB1.DBD4,REAL,Tank.Setpoint,°C\nDB1.DBW0,INT,Tank.Mode,\n", encoding="utf-8"
    )
    talk = Talk()
    talk.pipeline = Pipeline(talk, Options(strict=True, naming=load_tags([tags]).naming()))
    talk.open()
    setpoint = item(0x84, 1, 32, 8)
    talk.ask(write(1, [setpoint], written(7, struct.pack(">f", 80.0))))
    talk.tell(ack_data(1, b"\x05\x01", b"\x05"))
    talk.ask(read(2, setpoint, dbw(1, 0), dbw(9, 0)))
    talk.tell(ack_data(2, b"\x04\x03", refused(5) + refused(5) + refused(10)))
    assert [finding.detail for finding in talk.findings if finding.slug == "transaction.item_error"] == [
        "Write Var Tank.Setpoint = 80.0 °C (DB1.DBD4): 0x05 Invalid address",
        "Read Var Tank.Setpoint (DB1.DBD4): 0x05 Invalid address",
        "Read Var Tank.Mode (DB1.DBW0): 0x05 Invalid address",
        "Read Var DB9.DBW0: 0x0a Object does not exist",
    ]
