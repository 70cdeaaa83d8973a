"""What a payload decoder gets of TCP connections: octets in order, gaps, TSDUs and transactions, and what its bugs cost."""

from __future__ import annotations

from typing import Any

import pytest

from dissect.engine.exchange import PayloadDecoder
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.iso.upper import SCD, UPPER_NAMES
from tests.engine.transactions.talk import CLIENT, MS, SERVER, START_NS, Talk, ack_data, dbw, dt, read, refused, words

PORT = 7000


class Heard(PayloadDecoder):
    """Claims TCP connections to a port and TSDUs that begin with a mark, and writes down what it gets."""

    def __init__(self, *, fails: bool = False) -> None:
        super().__init__()
        self.fails = fails
        self.heard: list[tuple[Any, ...]] = []

    def claims_port(self, transport: str, connection: Connection) -> bool:
        return transport == "tcp" and PORT in {end.port for end in connection.tcp.ends}

    def stream(self, side: Side, octets: bytes, frame: int, time_ns: int) -> None:
        self.heard.append((int(side.index), octets, frame, (time_ns - START_NS) // MS))
        if self.fails:
            raise ValueError("broken")

    def hole(self, side: Side, size: int, frame: int, time_ns: int) -> None:
        self.heard.append((int(side.index), size, frame, (time_ns - START_NS) // MS))

    def tsdu(self, side: Side, octets: bytes, frame: int, time_ns: int) -> bool:
        if not octets.startswith(b"mark"):
            return False
        self.heard.append((int(side.index), octets, frame))
        return True

    def transaction(self, transaction: Transaction) -> None:
        self.heard.append((transaction.outcome, int(transaction.number)))
        if self.fails:
            raise ValueError("broken")

    def end(self, side: Side, frame: int, time_ns: int) -> None:
        self.heard.append(("end", frame, (time_ns - START_NS) // MS))

    def message_count(self) -> int:
        return len(self.heard)

    def as_dict(self) -> dict[str, Any]:
        return {"heard": len(self.heard)}


def hearing(decoder: PayloadDecoder, server_port: int = PORT, *, strict: bool = True) -> Talk:
    talk = Talk(server_port=server_port)
    talk.pipeline = Pipeline(talk, Options(strict=strict, decoder=decoder))
    return talk


def test_octets_come_in_order_with_the_packet_that_completed_them() -> None:
    decoder = Heard()
    talk = hearing(decoder)
    talk.hello()
    at = talk.seq[CLIENT]
    talk.packet(CLIENT, b"ab")
    talk.packet(CLIENT, b"ef", seq=at + 4)
    talk.packet(CLIENT, b"cd")
    talk.seq[CLIENT] = at + 6
    talk.packet(SERVER, b"x")
    talk.finish()
    # Packet 5 waits until packet 6 brings what was before it.
    assert decoder.heard == [
        (0, b"ab", 4, 4),
        (0, b"cd", 6, 6),
        (0, b"ef", 6, 6),
        (1, b"x", 7, 7),
        ("end", 7, 7),
    ]
    assert talk.findings == []
    assert talk.pipeline.counters.packet_counts()["payload"] == 4


@pytest.mark.parametrize("cut", [0, 3])
def test_a_gap_is_passed_on_and_reported_unless_the_capture_cut_a_packet(cut: int) -> None:
    decoder = Heard()
    talk = hearing(decoder)
    talk.hello()
    if cut:
        talk.packet(CLIENT, b"abcde", cut=cut)
    else:
        talk.packet(CLIENT, b"ab")
        talk.seq[CLIENT] += 3
        talk.packet(CLIENT, b"fg")
    talk.finish()
    assert decoder.heard[0] == (0, b"ab", 4, 4)
    assert decoder.heard[1] == (0, 3, 4, 4) if cut else (0, 3, 5, 5)
    assert decoder.heard[2:] == ([("end", 4, 4)] if cut else [(0, b"fg", 5, 5), ("end", 5, 5)])
    assert [(one.slug, one.detail, one.frames, one.connection) for one in talk.findings] == (
        [("capture.cut_frames", "56 of 59 bytes kept", [4], 0)]
        if cut
        else [("stream.hole", "3 bytes from 10.0.0.1:50000", [5], 1)]
    )


@pytest.mark.parametrize("known", [False, True])
def test_it_says_of_each_side_whether_its_octets_begin_a_message(known: bool) -> None:
    """Of the side that speaks first it is known from its SYN; of the other only while it has sent nothing."""
    talk = hearing(Heard())
    if known:
        talk.hello()
    talk.packet(CLIENT, b"ab")
    (side,) = talk.pipeline.table.all_open()
    assert side.peer is not None
    assert (side.framer.synced, side.peer.framer.synced) == (known, known)
    assert (side.kept is not None, side.peer.kept is not None) == (True, True)
    assert side.kept is not side.peer.kept


def test_octets_that_were_lost_before_the_first_captured_ones_leave_nothing_known() -> None:
    talk = hearing(Heard())
    talk.hello()
    talk.seq[SERVER] += 10
    talk.packet(SERVER, b"ab")
    talk.packet(CLIENT)
    talk.silence(2000 * MS)
    (side,) = talk.pipeline.table.all_open()
    assert side.peer is not None
    assert (side.framer.synced, side.peer.framer.synced) == (True, False)


def test_a_bug_of_a_decoder_costs_what_it_was_given() -> None:
    decoder = Heard(fails=True)
    talk = hearing(decoder, strict=False)
    talk.hello()
    for octets in (b"ab", b"cd"):
        talk.packet(CLIENT, octets)
    talk.finish()
    assert [told[1] for told in decoder.heard[:2]] == [b"ab", b"cd"]
    assert [(one.slug, one.detail, one.frames) for one in talk.findings] == [
        ("internal.bug", "ValueError: broken", [4]),
        ("internal.bug", "ValueError: broken", [5]),
    ]
    assert talk.pipeline.finding_counts == {"internal.bug": 2}
    assert talk.pipeline.counters.packet_counts()["failed"] == 0


def test_its_section_is_the_last_and_its_messages_count() -> None:
    decoder = Heard()
    talk = hearing(decoder)
    talk.hello()
    talk.packet(CLIENT, b"ab")
    last = talk.pipeline.protocols[-1]
    assert last.describe() == {"scd": {"heard": 1}}
    assert last.counted() == [(1, "SCD message")]


def test_what_it_takes_of_tsdus_is_counted_as_its_own() -> None:
    decoder = Heard()
    talk = hearing(decoder, 102)
    talk.open()
    talk.packet(CLIENT, dt(b"mark and more"))
    talk.packet(SERVER, dt(b"nothing of it"))
    assert (0, b"mark and more", 6 + 2) in decoder.heard
    tsdus = dict(zip(UPPER_NAMES, talk.pipeline.iso.tsdus.counts(), strict=True))
    assert {name: count for name, count in tsdus.items() if count} == {"s7comm": 2, "unknown": 1, "scd": 1}
    assert talk.pipeline.iso.tsdus.counts()[SCD] == 1


class Counting(Talk):
    """Counts what its decoder had got before each transaction was reported."""

    def __init__(self, decoder: Heard) -> None:
        super().__init__()
        self.pipeline = Pipeline(self, Options(strict=True, decoder=decoder))
        self.decoder = decoder
        self.before: list[int] = []

    def transaction(self, transaction: Transaction) -> None:
        super().transaction(transaction)
        self.before.append(len(self.decoder.heard))


def test_it_gets_each_transaction_before_the_observer() -> None:
    """An answer, a refusal, one without an answer, and one without a request."""
    decoder = Heard()
    talk = Counting(decoder)
    talk.open(4, 4)
    talk.before.clear()
    decoder.heard.clear()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(ack_data(2, b"\x04\x01", refused(5)))
    talk.ask(read(3, dbw(1, 0)))
    talk.tell(words(9, 1))
    talk.close()
    told = [(one.outcome, int(one.number)) for one in talk.transactions]
    assert [one for one in decoder.heard if one[0] != "end"] == told
    assert [outcome for outcome, _ in told] == ["answered", "answered", "unanswered", "orphan_answer"]
    assert talk.before == [1, 2, 3, 4]


def test_a_bug_of_a_decoder_costs_no_transaction() -> None:
    decoder = Heard(fails=True)
    talk = hearing(decoder, 102, strict=False)
    talk.open()
    asked = talk.ask(read(1, dbw(1, 0)))
    answered = talk.tell(words(1, 1))
    talk.close()
    assert talk.pairs() == [(asked, answered)]
    bugs = [one.frames for one in talk.findings if one.slug == "internal.bug"]
    assert bugs == [[7], [answered]]  # of the setup and of the read: the later of the two packets


def test_a_decoder_that_finds_nothing_changes_nothing() -> None:
    """The base class: S7 is read as ever, on its port and on that of another decoder."""
    plain, beside = Talk(), hearing(PayloadDecoder(), 102)
    for talk in (plain, beside):
        talk.open()
        talk.ask(read(1, dbw(1, 0)))
        talk.tell(words(1, 7))
        talk.packet(CLIENT, dt(b"something else"))
        talk.datagram(CLIENT, b"x", (1, PORT))
        talk.close()
    assert [repr(one) for one in beside.transactions] == [repr(one) for one in plain.transactions]
    assert [(one.slug, one.detail, one.frames) for one in beside.findings] == [
        (one.slug, one.detail, one.frames) for one in plain.findings
    ]
    assert beside.pipeline.counters.packet_counts() == plain.pipeline.counters.packet_counts()
    assert not PayloadDecoder().claims_tsdus(beside.connections[0])
    last = beside.pipeline.protocols[-1]
    assert (last.describe(), last.counted()) == ({"scd": {}}, [(0, "SCD message")])
    assert [one.describe() for one in beside.pipeline.protocols[:-1]] == [
        one.describe() for one in plain.pipeline.protocols
    ]
