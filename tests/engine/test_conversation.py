"""The upper half of the path, case by case: octets in order to transactions and findings."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.side import Side
from tests.engine.transactions import talk as lines
from tests.properties.books import Result, check_books
from tests.properties.messages import (
    ACK,
    ACK_DATA,
    EMPTY_DT,
    JOB,
    Item,
    connect,
    disconnect,
    dt,
    fragments,
    pdu,
    read_answer,
    read_job,
    setup,
    tpkt,
    userdata,
    write_job,
)
from tests.properties.packets import Flow, Talk, captured

WORD: Final = Item(0x04, 1, 10, 0x84, 4 * 8)


def ready(amq: int = 8, length: int = 480, flow: Flow | None = None) -> Talk:
    """Return a connection that is set up."""
    talk = Talk(flow).handshake()
    talk.send(0, connect(0xE0)).send(1, connect(0xD0))
    return talk.send(0, dt(setup(JOB, 0, amq, length))).send(1, dt(setup(ACK_DATA, 0, amq, length)))


def asked(ref: int) -> bytes:
    return dt(read_job(ref, [WORD]))


def answered(ref: int) -> bytes:
    return dt(read_answer(ref, [WORD], [b"\x00\x2a"]))


def poll(talk: Talk, *refs: int) -> Talk:
    for ref in refs:
        talk.send(0, asked(ref)).send(1, answered(ref))
    return talk


def run(talk: Talk) -> Result:
    result = Result(captured(talk.segments))
    check_books(result.pipeline, result.record)
    return result


def only(result: Result) -> Connection:
    (connection,) = result.record.closed
    return connection


# ---- what an observer is told ---------------------------------------------------------------------------------------


class Watcher(Observer):
    """Writes down what it is told, in order."""

    def __init__(self, *, wants_pdus: bool = True, wants_tpdus: bool = True) -> None:
        super().__init__()
        self.wants_pdus = wants_pdus
        self.wants_tpdus = wants_tpdus
        self.told: list[tuple[object, ...]] = []

    def connection_opened(self, connection: Connection) -> None:
        self.told.append(("opened", connection.number))

    def connection_closed(self, connection: Connection) -> None:
        self.told.append(("closed", connection.number))

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        self.told.append(("tpdu", frame, int(side.index), octets))

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        self.told.append(("pdu", frame, int(side.index), octets, cut))

    def transaction(self, transaction: object) -> None:
        self.told.append(("transaction", repr(transaction)))

    def finding(self, finding: object) -> None:
        self.told.append(("finding", repr(finding)))

    def comment(self, frame: int, text: str) -> None:
        self.told.append(("comment", frame, text))


def watch(talk: Talk, watcher: Watcher) -> list[tuple[object, ...]]:
    pipeline = Pipeline(watcher, Options(strict=True))
    for packet in talk.packets():
        pipeline.frame(packet.time_ns, packet.octets, 0, len(packet.octets), packet.wire_length, packet.link_type)
    pipeline.finish()
    return watcher.told


def test_an_observer_is_told_everything_in_order() -> None:
    job, answer = read_job(1, [WORD]), read_answer(1, [WORD], [b"\x00\x2a"])
    talk = Talk().handshake().send(0, connect(0xE0)).send(1, connect(0xD0)).send(0, dt(job)).send(1, dt(answer)).close()
    data_before_setup = "Finding('session.data_before_setup', connection=1, frames=[6])"
    assert watch(talk, Watcher()) == [
        ("opened", 1),
        ("tpdu", 4, 0, connect(0xE0)),
        ("tpdu", 5, 1, connect(0xD0)),
        ("tpdu", 6, 0, dt(job)),
        ("pdu", 6, 0, job, False),
        ("finding", data_before_setup),
        ("tpdu", 7, 1, dt(answer)),
        ("pdu", 7, 1, answer, False),
        ("transaction", "Transaction(1, Read Var, answered)"),
        ("closed", 1),
    ]
    kinds = {told[0] for told in watch(talk, Watcher(wants_pdus=False, wants_tpdus=False))}
    assert kinds == {"opened", "finding", "transaction", "closed"}


def test_a_comment_belongs_to_the_packet_that_comes_next() -> None:
    watcher = Watcher()
    pipeline = Pipeline(watcher, Options(strict=True))
    pipeline.comment("before the first")
    for packet in Talk().handshake().packets():
        pipeline.frame(packet.time_ns, packet.octets, 0, len(packet.octets), packet.wire_length, packet.link_type)
    pipeline.comment("behind the last")
    assert watcher.told == [("comment", 1, "before the first"), ("comment", 4, "behind the last")]


# ---- TPKT -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("length", range(7))
def test_a_tpkt_length_that_holds_nothing(length: int) -> None:
    talk = poll(ready(), 1)
    talk.send(0, b"\x03\x00" + length.to_bytes(2, "big") + bytes(max(0, length - 4)))
    result = run(poll(talk, 2, 3))
    assert result.outcomes == ["answered"] * 4
    assert result.details("tpkt.bad_length") == [f"length {length} from 10.0.0.1:49152"]
    assert result.pipeline.counters.octets.skipped == max(4, length)


@pytest.mark.parametrize(
    "garbage", [b"\xff", b"GET / HTTP/1.0\r\n\r\n", b"\x04\x00\x00\x1f", bytes(2000), b"\x02\x00" * 30]
)
def test_garbage_between_tpkts(garbage: bytes) -> None:
    talk = poll(ready(), 1)
    talk.send(0, asked(2) + garbage + asked(3)).send(1, answered(2), answered(3))
    result = run(poll(talk, 4, 5))
    assert result.outcomes == ["answered"] * 6
    assert result.pipeline.counters.octets.skipped == len(garbage)
    faults = result.counts.get("tpkt.garbage", 0) + result.counts.get("tpkt.bad_length", 0)
    assert faults >= 1


def test_each_stretch_of_garbage_is_told_once() -> None:
    talk = poll(ready(), 1)
    for _ in range(3):
        talk.send(0, b"\xff" * 50, b"\xfe" * 50)
        poll(talk, 2)
    result = run(talk)
    assert len(result.details("tpkt.garbage")) == result.counts["tpkt.garbage"] == 3
    assert result.pipeline.counters.octets.skipped == 300


def test_a_connection_that_ends_inside_a_tpkt() -> None:
    talk = poll(ready(), 1)
    talk.send(0, asked(2)[:20]).close()
    result = run(talk)
    assert result.details("tpkt.unfinished") == ["20 bytes from 10.0.0.1:49152"]
    assert result.pipeline.counters.octets.buffered == 20


def test_a_tpkt_over_thousands_of_segments() -> None:
    job = write_job(1, [Item(0x03, 60_000, 1, 0x84, 0)], [bytes(60_000)])
    talk = ready(length=65_000)
    octets = dt(job)
    talk.send(0, *[octets[at : at + 5] for at in range(0, len(octets), 5)])
    result = run(talk)
    (one,) = [one for one in result.transactions if one.pdu_ref == 1]
    assert one.request_octets == job


# ---- COTP -----------------------------------------------------------------------------------------------------------


def test_a_refused_connection() -> None:
    talk = Talk().handshake().send(0, connect(0xE0, called=b"\x01\x05")).send(1, disconnect(3)).close(1)
    result = run(talk)
    assert only(result).refused != ""
    assert "rack 0" in result.details("cotp.refused")[0]
    assert result.transactions == []


def test_a_disconnect_ends_what_was_established() -> None:
    result = run(poll(ready(), 1).send(1, disconnect(0x80)).close())
    assert result.counts == {"cotp.disconnected": 1}
    assert only(result).refused == ""


def test_empty_dts_are_everyday() -> None:
    for before in (b"", EMPTY_DT):
        talk = ready()
        for ref in range(1, 6):
            talk.send(0, EMPTY_DT + asked(ref)).send(1, before, answered(ref) + EMPTY_DT)
        result = run(talk)
        assert result.outcomes == ["answered"] * 6
        assert result.counts == ({"cotp.empty_dt": 1} if before else {})


def test_a_message_in_fragments_of_both_sides_at_once() -> None:
    job, answer = read_job(1, [WORD] * 3), read_answer(1, [WORD] * 3, [b"\x00\x01"] * 3)
    late = read_answer(2, [WORD], [b"\x00\x02"])
    talk = ready()
    talk.send(0, asked(2), fragments(job, [10, 20])[:30]).send(1, dt(late[:5], eot=False), EMPTY_DT)
    talk.send(0, fragments(job, [10, 20])[30:]).send(1, dt(late[5:])).send(1, fragments(answer, [1, 2, 30]))
    result = run(talk)
    assert result.outcomes == ["answered"] * 3
    assert [found.value for found in result.transactions[2].s7_results] == [1, 1, 1]
    assert result.counts == {}


@pytest.mark.parametrize("size", [65_536, 65_537, 200_000])
def test_an_end_bit_that_never_comes(size: int) -> None:
    talk = poll(ready(), 1)
    for at in range(0, size, 1000):
        talk.send(0, dt(bytes(min(1000, size - at)), eot=False))
    result = run(talk)
    assert ("cotp.tsdu_too_long" in result.counts) is (size > 65_536)
    # Up to its end bit the message is dropped; then all is well.
    talk.send(0, dt(b"\x00"))
    result = run(poll(talk, 2))
    if size > 65_536:
        assert result.outcomes == ["answered"] * 3
        assert result.counts == {"cotp.tsdu_too_long": 1}


def test_a_message_whose_last_fragment_never_comes() -> None:
    talk = poll(ready(), 1)
    talk.send(0, dt(b"\x32\x01", eot=False)).close()
    result = run(talk)
    assert result.details("cotp.unfinished_tsdu") == ["from 10.0.0.1:49152"]


def test_fragments_with_a_hole_are_given_up() -> None:
    job = write_job(9, [Item(0x02, 40, 1, 0x84, 0)], [bytes(40)])
    talk = poll(ready(), 1)
    talk.send(0, dt(job[:20], eot=False)).skip(0, len(dt(job[20:40]))).send(0, dt(job[40:])).ack(1)
    for ref in range(2, 12):
        poll(talk, ref)
    result = run(talk)
    assert result.outcomes == ["answered"] * 12
    assert result.counts == {"stream.hole": 1, "cotp.unfinished_tsdu": 1}


@pytest.mark.parametrize(
    ("tpdu", "detail"),
    [
        (b"\x00\xf0\x80", "DT: cotp: length indicator at byte 0 is 0, expected 1 to 254"),
        (b"\xff\xf0\x80", "DT: cotp: length indicator at byte 0 is 255, expected 1 to 254"),
        (b"\x20\xf0\x80\x00", "DT: cotp: length indicator at byte 0 claims 33 bytes, the TPKT has 4"),
        (b"\x04\xf0\x80\xc0\x00", "DT: length indicator 4, class 0 has 2"),
        (b"\x04\x30\x00\x00\x00", "0x3: cotp: type at byte 1 is 3, which is unknown"),
        (b"\x03\xe0\x00\x00", "CR: cotp: CR at byte 0 needs 7 bytes, the TPDU header has 4"),
        (b"\x06\xe0\x00\x00\x00\x01", "CR: cotp: length indicator at byte 0 claims 7 bytes, the TPKT has 6"),
    ],
)
def test_a_cotp_header_that_contradicts_itself(tpdu: bytes, detail: str) -> None:
    talk = poll(ready(), 1).send(0, tpkt(tpdu))
    result = run(poll(talk, 2))
    assert result.outcomes == ["answered"] * 3
    assert result.counts == {"cotp.malformed": 1}
    assert result.details("cotp.malformed") == [detail]
    assert len(result.record.closed) == 1


def test_who_connects_to_whom() -> None:
    talk = (
        Talk().handshake().send(0, EMPTY_DT).send(1, connect(0xD0)).send(0, dt(setup(JOB, 0))).send(1, dt(setup(3, 0)))
    )
    assert run(talk).counts == {"cotp.answer_without_request": 1, "cotp.bad_start": 1}
    talk = Talk().handshake().send(0, connect(), connect()).send(1, connect(0xD0))
    assert run(talk).counts == {"cotp.repeated_request": 1}
    # Captured out of order, or with its CR lost, a CC says nothing of the kind.
    talk = Talk().handshake().send(0, connect(0xE0)).send(1, connect(0xD0))
    talk.segments[3], talk.segments[4] = talk.segments[4], talk.segments[3]
    assert run(poll(talk, 1)).counts == {"session.data_before_setup": 1}
    talk = Talk().handshake().skip(0, 22).send(1, connect(0xD0)).send(0, dt(setup(JOB, 0))).send(1, dt(setup(3, 0)))
    assert run(poll(talk, 1)).counts == {"stream.hole": 1}


def test_a_tpdu_beyond_what_was_negotiated() -> None:
    talk = Talk().handshake().send(0, connect(0xE0, size=7)).send(1, connect(0xD0, size=7))
    talk.send(0, dt(setup(JOB, 0))).send(1, dt(setup(3, 0)))
    for size in (128 - 3 - 28, 128 - 3 - 27):
        talk.send(0, dt(write_job(size, [Item(0x02, size, 1, 0x84, 0)], [bytes(size)])))
    assert run(talk).details("cotp.size_exceeded") == ["129 bytes, 128 negotiated"]


# ---- S7 -------------------------------------------------------------------------------------------------------------


def test_several_protocols_in_one_connection_are_told_once_each() -> None:
    talk = poll(ready(), 1)
    for _ in range(3):
        talk.send(0, dt(b"\x72\xff\x01\x00")).send(1, dt(b"\x16\x03\x01")).send(0, dt(b"what is this"))
    result = run(talk)
    told = ["tls", "unknown: begins with 77 68 61 74 20 69 73 20"]
    assert result.details("session.foreign_on_102") == told
    assert result.pipeline.plus.pdus == 3
    assert only(result).protocol == "s7comm"


def test_a_pdu_whose_lengths_lie_is_paired_and_told() -> None:
    job = read_job(1, [WORD])
    lies = [job[:6] + b"\x00\x0d" + job[8:], job[:8] + b"\x00\x01" + job[10:], job + b"\x00"]
    talk = ready()
    for number, lie in enumerate(lies, 1):
        talk.send(0, dt(lie[:4] + number.to_bytes(2, "big") + lie[6:])).send(1, answered(number))
    result = run(talk)
    assert result.outcomes == ["answered"] * 4
    assert result.counts["s7.malformed"] == 3
    assert result.details("s7.malformed") == [
        "Job from 10.0.0.1:49152: s7: 1 byte too many behind pdu at byte 23, in the TSDU",
        "Job from 10.0.0.1:49152: s7: data_length at byte 8 claims 25 bytes, the TSDU has 24",
        "Job from 10.0.0.1:49152: s7: 1 byte too many behind pdu at byte 24, in the TSDU",
    ]
    answer = read_answer(5, [WORD], [b"\x00\x01"])
    talk.send(0, asked(5)).send(1, dt(answer[:8] + b"\x00\x40" + answer[10:]))
    result = run(talk)
    assert result.outcomes == ["answered"] * 5
    assert result.counts["s7.malformed"] == 4


@pytest.mark.parametrize("size", range(2, 12))
def test_a_pdu_shorter_than_its_header(size: int) -> None:
    talk = ready()
    talk.send(0, asked(1)).send(1, dt(read_answer(1, [WORD], [b"\x00\x01"])[:size]))
    result = run(poll(talk, 2))
    assert sorted(result.outcomes) == ["answered", "answered", "unanswered"]
    assert result.pipeline.s7.unpaired == 1
    assert result.counts["s7.malformed"] == 1
    needed = f"header at byte 0 needs {10 if size < 10 else 12} bytes"
    assert result.details("s7.malformed") == [f"Ack_Data from 10.0.0.2:102: s7: {needed}, the TSDU has {size}"]


@pytest.mark.parametrize("rosctr", [4, 5, 6])
def test_a_kind_of_pdu_that_nobody_knows(rosctr: int) -> None:
    result = run(poll(ready().send(0, dt(pdu(rosctr, 1, b"\x04\x00"))), 1))
    assert result.outcomes == ["answered"] * 2
    assert result.counts == {"s7.unknown_rosctr": 1}
    assert result.pipeline.s7.unpaired == 1


def test_userdata_of_every_kind() -> None:
    talk = ready()
    talk.send(0, dt(userdata(1, 1, 4, 1, b"\x00\x11\x00\x00"))).send(1, dt(userdata(1, 2, 4, 1, b"\x00\x11\x00\x00")))
    talk.send(1, dt(userdata(0, 0, 4, 3, bytes(20))))
    talk.send(0, dt(userdata(2, 3, 4, 1)))  # type 3 is not used
    talk.send(0, dt(userdata(3, 1, 7, 1))).send(1, dt(userdata(3, 2, 7, 1, b"", 0x8104)))
    result = run(talk)
    assert result.outcomes == ["answered", "answered", "unsolicited", "answered"]
    assert result.pipeline.s7.unpaired == 1
    assert result.transactions[3].errors[0].code == 0x8104
    assert result.counts["transaction.refused"] == 1


def test_a_job_and_userdata_may_share_a_reference() -> None:
    talk = ready()
    talk.send(0, asked(5), dt(userdata(5, 1, 7, 1))).send(1, dt(userdata(5, 2, 7, 1, bytes(10))), answered(5))
    result = run(talk)
    assert result.outcomes == ["answered"] * 3
    assert [one.function for one in result.transactions[1:]] == [0x00, 0x04]


def test_either_end_asks_under_the_same_reference() -> None:
    block = pdu(JOB, 5, b"\x1b\x00\x00\x00\x00\x00\x00\x09_0A00001P")
    piece = pdu(ACK_DATA, 5, b"\x1b\x00", b"\x00\x02\x00\xfb\x01\x02")
    talk = ready()
    talk.send(0, asked(5)).send(1, dt(block)).send(0, dt(piece)).send(1, answered(5))
    result = run(talk)
    assert result.outcomes == ["answered"] * 3
    assert [(one.function, one.asked_by) for one in result.transactions[1:]] == [(0x1B, 1), (0x04, 0)]
    assert str(only(result).client) == "10.0.0.1:49152"


def test_more_requests_open_than_granted() -> None:
    talk = ready(amq=2)
    talk.send(0, asked(1), asked(2), asked(3), asked(4)).send(1, *[answered(ref) for ref in (1, 2, 3, 4)])
    assert run(poll(talk, 5, 6)).counts == {"session.too_many_jobs": 2}


def test_a_lost_answer_does_not_count_as_an_open_request() -> None:
    talk = ready(amq=1)
    talk.send(0, asked(1)).skip(1, len(answered(1)))
    for ref in range(2, 60):
        poll(talk, ref)
    result = run(talk)
    assert result.outcomes.count("unanswered") == 1
    assert result.counts == {"stream.hole": 1}
    # An answer that never was is another thing: its request stays open beside the next ones, as long as clients wait.
    talk = ready(amq=1)
    talk.send(0, asked(1)).ack(1)
    for ref in range(2, 12):
        poll(talk, ref)
    assert run(talk).counts["session.too_many_jobs"] == 10


def test_a_pdu_longer_than_negotiated() -> None:
    item = Item(0x02, 240 - 28 + 1, 1, 0x84, 0)
    talk = ready(length=240).send(0, dt(write_job(1, [item], [bytes(item.octets)])))
    assert run(talk).details("session.pdu_too_long") == ["241 bytes, 240 negotiated"]


def test_answers_that_say_no() -> None:
    talk = ready()
    talk.send(0, asked(1)).send(1, dt(pdu(ACK, 1, b"", b"", 0x8104)))
    talk.send(0, asked(2)).send(1, dt(read_answer(2, [WORD], [0x0A])))
    result = run(talk)
    assert result.counts == {"transaction.refused": 1, "transaction.item_error": 1, "security.protected": 1}
    refused, failed = result.transactions[1:]
    assert [(error.where, error.code) for error in refused.errors] == [("header", 0x8104)]
    assert [(error.where, error.code, error.address) for error in failed.errors] == [("item 1", 0x0A, "DB10.DBW4")]
    assert only(result).errors == 2


def test_a_late_answer_is_slow() -> None:
    talk = poll(ready(), 1)
    packets = talk.packets()
    late = packets[-1]._replace(time_ns=packets[-2].time_ns + 250_000_000)
    result = Result([*packets[:-1], late], Options(200_000_000, strict=True))
    assert result.counts == {"transaction.slow": 1}
    assert Result([*packets[:-1], late]).counts == {}


def test_many_orphans_are_bounded_and_all_told() -> None:
    talk = ready()
    talk.send(1, b"".join([answered(ref) for ref in range(1, 201)]))
    result = run(talk)
    assert result.outcomes.count("orphan_answer") == 200
    assert result.counts == {"transaction.orphan": 200}


def test_a_reference_flood_is_bounded_and_adds_up() -> None:
    count = 70_000
    talk = Talk().send(0, connect(0xE0)).send(1, connect(0xD0))
    octets = [asked(ref & 0xFFFF) for ref in range(count)]
    talk.send(0, *[b"".join(octets[at : at + 40]) for at in range(0, count, 40)])
    result = Result(captured(talk.segments, step_ns=1000), finish=False)
    opened = result.record.opened[0].open_requests[0]
    assert opened.count <= 4096
    result.pipeline.finish()
    check_books(result.pipeline, result.record)
    assert result.outcomes == ["unanswered"] * count
    reasons = [one.reason for one in result.transactions]
    assert reasons.count("table_full") == count - 4096
    assert result.counts["transaction.table_full"] == count - 4096


def test_a_shared_reference_is_counted_once_and_the_requests_behind_it_are_judged_as_ever() -> None:
    """The one request with the reference of an open one; others of their own, too many of them included, are not that."""
    talk = ready(amq=2)
    talk.send(0, asked(1), dt(read_job(1, [Item(0x04, 1, 10, 0x84, 8 * 8)])))
    for ref in (2, 3, 4):
        talk.send(0, asked(ref))
    counts = run(talk).pipeline.finding_counts
    assert (counts["session.shared_reference"], counts["session.too_many_jobs"]) == (1, 3)


@pytest.mark.parametrize("seconds", [0, 2])
@pytest.mark.parametrize("code", [0, 0x8104])
def test_a_command_whose_content_is_short_is_judged_once(code: int, seconds: int) -> None:
    """Before its outcome where it failed, because the content may explain that; else behind it."""
    talk = lines.Talk()
    talk.open()
    talk.ask(lines.job(3, b"\x29" + bytes(5) + b"\x20P_PROGRAM"))  # its name is said to be longer than what is there
    talk.tell(lines.ack_data(3, b"\x29", code=code), after_ns=seconds * lines.SECOND + lines.MS)
    talk.close()
    assert talk.pipeline.finding_counts["s7.malformed"] == 1
    assert len(talk.transactions) == 1
