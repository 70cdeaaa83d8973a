"""S7 through an IBH-NetLink gateway, packet by packet, into the pipeline."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dissect.engine.transactions.connection import FOLLOWED, FOREIGN, ISO
from dissect.engine.transactions.side import Side
from dissect.protocols.ibh.tables import IBH_NETLINK, KINDS
from tests.cases import each
from tests.engine.transactions.talk import ACK as ACK_FLAG
from tests.engine.transactions.talk import CLIENT, RST, SERVER, Talk, dbw, dt, granted, read, setup, words
from tests.protocols.ibh.packets import ACK, ASK, CLAIM, CLAIMED, DISCONNECT, RECEIPT, TELL, long, short

CONNECT = short(0xE0, bytes.fromhex("00800002000201000100"))


class Link(Talk):
    """A talk through a gateway that remembers the packets it was told of."""

    def __init__(self, port: int = 1099, strict: bool = True) -> None:
        super().__init__(50000, port, strict=strict)
        self.wants_tpdus = True
        self.wants_pdus = True
        self.packets: list[bytes] = []
        self.tpkts: list[bytes] = []
        self.pdus: list[tuple[bytes, bool]] = []

    def ibh_packet(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        self.packets.append(octets)

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        self.tpkts.append(octets)

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        self.pdus.append((octets, cut))

    def both(self, *packets: tuple[int, bytes]) -> None:
        for side, octets in packets:
            self.packet(side, octets)

    def begin(self) -> None:
        """Everything up to the setup; forgets what was told of it."""
        self.hello()
        self.both((CLIENT, CLAIM), (CLIENT, short(0xF1, setup(0, 4, 4))), (SERVER, long(0xF1, granted(0, 4, 4))))
        for told in (self.transactions, self.findings, self.packets, self.pdus):
            told.clear()

    def kinds(self) -> dict[str, int]:
        counts = self.pipeline.ibh.packets
        return {kind: count for kind, count in zip(KINDS, counts, strict=True) if count}

    def end(self) -> None:
        """Close, and see that every octet is accounted for."""
        self.close()
        account = self.pipeline.counters.octets
        assert account.failed == 0
        assert account.delivered > 0


def test_a_session() -> None:
    link = Link()
    link.hello()
    link.both((CLIENT, CLAIM), (SERVER, CLAIMED), (CLIENT, CONNECT), (SERVER, RECEIPT + long(0xD0)))
    link.both((CLIENT, short(0xF1, setup(0))), (SERVER, RECEIPT + long(0xB0, b"\x01") + long(0xF1, granted(0))))
    link.both((CLIENT, ACK + ASK), (SERVER, RECEIPT + TELL), (CLIENT, DISCONNECT))
    link.end()
    assert link.outcomes() == ["answered", "answered"]
    assert link.findings == []
    told = {"mpi_data": 4, "mpi_ack": 2, "mpi_connect": 1, "mpi_confirm": 1, "mpi_disconnect": 1}
    assert link.kinds() == {**told, "receipt": 3, "service": 2}
    [connection] = link.connections
    assert (connection.protocol, connection._state, connection.number, connection.pdus) == (IBH_NETLINK, FOLLOWED, 1, 4)
    assert (connection.pdu_length, connection.client.port, connection.client_known) == (240, 50000, True)
    assert connection.iso_ended.startswith("MPI disconnect from 10.0.0.1")
    assert link.transactions[1].s7_results[0].value == 42
    assert len(link.packets) == 14
    assert link.tpkts == []
    assert link.pipeline.iso.tsdus.counts()[0] == len(link.pdus) == 4
    assert link.pipeline.counters.octets.framed == link.pipeline.counters.octets.delivered


def test_octet_by_octet() -> None:
    link = Link()
    link.begin()
    for side, octets in ((CLIENT, ACK + ASK), (SERVER, CLAIMED + RECEIPT + TELL)):
        for octet in octets:
            link.packet(side, bytes((octet,)))
    link.end()
    assert link.outcomes() == ["answered"]
    assert link.findings == []
    assert link.pipeline.counters.octets.skipped == 0


def test_an_answer_in_fragments() -> None:
    link = Link()
    link.begin()
    link.both((CLIENT, ASK), (SERVER, long(0xF0, words(1, 42)[:9])), (CLIENT, short(0x05)))
    link.both((SERVER, RECEIPT + long(0xF1, words(1, 42)[9:])))
    link.end()
    assert link.outcomes() == ["answered"]
    assert [octets for octets, _ in link.pdus][1] == words(1, 42)


def test_ordinary_s7_on_the_same_port() -> None:
    talk = Talk(50000, 1099)
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.close()
    assert talk.outcomes() == ["answered"]
    assert talk.slugs() == ["session.unusual_port"]
    assert talk.connections[0].protocol == "s7comm"
    assert talk.connections[0]._state == ISO


@pytest.mark.parametrize("first", [CLAIM, ASK])
def test_on_any_port_when_it_is_certain(first: bytes) -> None:
    link = Link(4711)
    link.hello()
    link.both((CLIENT, first), (CLIENT, short(0xF1, read(2, dbw(1, 0)))), (SERVER, RECEIPT + long(0xF1, words(2, 1))))
    link.end()
    assert "answered" in link.outcomes()
    link.findings = [finding for finding in link.findings if finding.slug != "transaction.unanswered"]
    assert [slug for slug in link.slugs() if slug != "session.data_before_setup"] == ["session.unusual_port"]


def test_on_another_port_a_receipt_is_not_enough() -> None:
    link = Link(4711)
    link.hello()
    link.both((CLIENT, RECEIPT))
    link.both((CLIENT, ASK), (SERVER, TELL))
    link.close()
    assert link.transactions == []
    assert link.connections == []


def test_something_else_on_the_port() -> None:
    link = Link()
    link.hello()
    link.packet(CLIENT, b"JRMI\x00\x02K")
    sides = link.pipeline.table.all_open()
    assert [side.connection._state for side in sides] == [FOREIGN]
    link.close()
    assert (link.packets, link.findings) == ([], [])


def test_begun_in_its_midst_by_the_answering_side() -> None:
    link = Link()
    link.both((SERVER, RECEIPT), (SERVER, long(0xB0, b"\x01")), (CLIENT, ASK), (SERVER, RECEIPT + TELL))
    link.end()
    assert link.outcomes() == ["answered"]
    assert link.slugs() == []
    assert link.connections[0].mid_stream
    assert link.connections[0].client.port == 50000


def test_a_lost_answer() -> None:
    link = Link()
    link.begin()
    link.packet(CLIENT, ASK)
    link.seq[SERVER] += len(TELL)
    link.packet(CLIENT, ACK)
    link.packet(CLIENT, short(0xF1, read(2, dbw(1, 0))))
    link.packet(SERVER, long(0xF1, words(2, 43)))
    link.end()
    assert sorted(transaction.reason for transaction in link.transactions) == ["", "hole"]
    assert link.slugs() == ["stream.hole"]
    assert link.pipeline.counters.octets.missing == len(TELL)


def test_a_hole_inside_a_message() -> None:
    link = Link()
    link.begin()
    link.both((CLIENT, ASK), (SERVER, long(0xF0, words(1, 42)[:9])))
    link.seq[SERVER] += 5
    link.packet(CLIENT, ACK)
    link.packet(SERVER, RECEIPT)
    link.end()
    assert link.slugs() == ["stream.hole", "ibh.unfinished"]


@each("kept", range(1, len(ASK)))
def test_what_the_capture_cut_says_as_much_as_it_does_of_a_tpkt(kept: int) -> None:
    link = Link()
    link.begin()
    link.packet(CLIENT, ASK, cut=len(ASK) - kept)
    link.packet(SERVER, TELL)
    link.end()
    talk = Talk()
    talk.open()
    pdu = kept - 15
    talk.packet(CLIENT, dt(ASK[15:]), cut=len(ASK) - 15 - max(pdu, 0))
    talk.tell(TELL[17:])
    talk.close()
    assert link.outcomes() == talk.outcomes()
    assert link.slugs() == talk.slugs()
    assert [cut for _, cut in link.pdus] == ([True, False] if pdu >= 10 else [False])


def test_octets_that_are_no_packet_cost_nothing_else() -> None:
    link = Link()
    link.begin()
    link.both((CLIENT, b"\x55" * 7 + ASK), (SERVER, TELL))
    link.end()
    assert link.outcomes() == ["answered"]
    assert [finding.detail for finding in link.findings] == [
        "bytes that begin no packet from 10.0.0.1:50000, first 0x55"
    ]
    assert link.pipeline.counters.octets.skipped == 7


@pytest.mark.parametrize(
    ("wrong", "detail"),
    [
        (1, "length at byte 12 claims 27 bytes, the packet has 26"),
        (-1, "1 byte too many behind length at byte 12, in the packet"),
    ],
)
def test_a_packet_that_contradicts_itself_says_how_and_who_sent_it(wrong: int, detail: str) -> None:
    octets = bytearray(ASK)
    octets[12] += wrong
    link = Link()
    link.begin()
    link.packet(CLIENT, bytes(octets))
    said = [one.detail for one in link.findings if one.slug == "ibh.malformed"]
    assert said == [f"MPI data from 10.0.0.1:50000: MPI: {detail}"]


def test_a_message_without_end_is_dropped() -> None:
    link = Link()
    link.begin()
    for _ in range(300):
        link.packet(CLIENT, short(0xF0, bytes(240)))
    assert link.slugs() == ["ibh.malformed"]
    assert sum(len(side.assembler.parts or b"") for side in link.pipeline.table.all_open()) <= 65536
    link.packet(CLIENT, short(0xF1, bytes(3)) + ASK)
    link.packet(SERVER, TELL)
    link.end()
    assert link.outcomes() == ["answered"]


def test_a_message_of_another_protocol_is_counted() -> None:
    link = Link()
    link.hello()
    link.both((CLIENT, short(0xF1, b"\x72\x01\x00\x00")), (CLIENT, short(0xF1)))
    link.end()
    tsdus = link.pipeline.iso.tsdus.counts()
    assert (tsdus[0], tsdus[1], sum(tsdus)) == (0, 1, 2)
    assert link.connections[0].protocol == IBH_NETLINK


def test_oddities_of_tcp_are_told_as_of_any_connection() -> None:
    link = Link()
    link.hello()
    link.packet(CLIENT, CLAIM)
    link.packet(SERVER, flags=RST | ACK_FLAG, seq=link.seq[SERVER] + 1_000_000)
    link.seq = [5_000_000, 7_000_000]
    link.hello()
    assert link.slugs() == ["stream.reset_ignored", "stream.reused"]


def test_retransmissions_and_disorder() -> None:
    link = Link()
    link.begin()
    link.packet(CLIENT, CLAIM)
    at = link.seq[CLIENT]
    link.packet(CLIENT, ASK[20:], seq=at + 20)
    link.packet(CLIENT, ASK[:20])
    link.seq[CLIENT] = at + len(ASK)
    link.packet(CLIENT, ASK, seq=at)
    link.packet(SERVER, TELL)
    link.end()
    assert link.outcomes() == ["answered"]
    assert link.pipeline.counters.packet_counts()["retransmission"] == 1


PIECES = st.lists(
    st.tuples(
        st.sampled_from([CLIENT, SERVER]),
        st.one_of(
            st.binary(min_size=1, max_size=40),
            st.sampled_from([ASK, TELL, ACK, CLAIM, RECEIPT, dt(read(1)), DISCONNECT]),
        ),
        st.integers(0, 30),
        st.integers(0, 50),
    ),
    max_size=12,
)


@settings(deadline=None)
@given(PIECES)
def test_nothing_raises_and_every_octet_is_accounted_for(pieces: list[tuple[int, bytes, int, int]]) -> None:
    link = Link()
    link.hello()
    link.packet(CLIENT, CLAIM)
    for side, octets, cut, lost in pieces:
        link.packet(side, octets, cut=min(cut, len(octets)) if cut > 20 else 0)
        link.seq[side] += lost if lost > 40 else 0
    link.end()
    assert "internal.bug" not in link.slugs()


def test_a_bug_costs_what_was_at_hand() -> None:
    class Failing(Link):
        def ibh_packet(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
            if octets == ACK:
                raise RuntimeError("broken")

    link = Failing(strict=False)
    link.begin()
    link.both((CLIENT, ASK + ACK), (SERVER, TELL))
    link.end()
    assert link.outcomes() == ["answered"]
    assert link.slugs() == ["internal.bug"]
