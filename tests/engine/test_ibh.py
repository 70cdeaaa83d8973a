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


# ---- what ends or damages messages ----------------------------------------------------------------------------------


def details(link: Link, slug: str) -> list[str]:
    return [finding.detail for finding in link.findings if finding.slug == slug]


@each("side", [CLIENT, SERVER])
def test_a_packet_that_is_begun_and_never_ends_is_reported(side: int) -> None:
    link = Link()
    link.begin()
    octets = ASK if side == CLIENT else TELL
    link.packet(side, octets[:-3])
    link.end()
    who = ("10.0.0.1:50000", "10.0.0.2:1099")[side]
    assert details(link, "ibh.unfinished") == [f"{len(octets) - 3} bytes from {who}"]
    assert link.pipeline.counters.octets.buffered == len(octets) - 3


def test_a_message_whose_rest_never_comes_is_reported() -> None:
    link = Link()
    link.begin()
    link.packet(SERVER, long(0xF0, words(1, 42)[:9]))
    link.end()
    assert details(link, "ibh.unfinished") == ["a message from 10.0.0.2:1099: the rest was not captured"]


def test_a_whole_message_behind_parts_is_one_by_itself() -> None:
    """As a DT without its end mark: the parts before it are a message where they are a sound one."""
    for first, asks in ((read(1, dbw(1, 0)), [1, 2]), (read(1, dbw(1, 0))[:9], [2])):
        link = Link()
        link.begin()
        link.both((CLIENT, short(0xF0, first)), (CLIENT, short(0xF1, read(2, dbw(1, 0)))))
        link.end()
        assert sorted(one.pdu_ref for one in link.transactions) == asks
        assert details(link, "ibh.unfinished") == ["from 10.0.0.1:50000: a complete PDU follows it"]


@each("how", ["gap", "cut"])
def test_what_cost_the_rest_of_a_message_is_said(how: str) -> None:
    link = Link()
    link.begin()
    link.packet(SERVER, long(0xF0, words(1, 42)[:9]))
    if how == "gap":
        link.seq[SERVER] += 300
        link.packet(SERVER, RECEIPT)
        link.packet(CLIENT, ACK)
    else:
        link.packet(SERVER, long(0xF1, words(1, 42)[9:]), cut=5)
    link.end()
    why = "bytes were lost" if how == "gap" else "the capture truncated one of its packets"
    assert details(link, "ibh.unfinished") == [f"a message from 10.0.0.2:1099: {why}"]
    assert details(link, "stream.hole") == (["300 bytes from 10.0.0.2:1099, between packets"] if how == "gap" else [])


def test_a_gap_inside_a_packet_is_said_to_be_there() -> None:
    link = Link()
    link.begin()
    link.packet(SERVER, TELL[:9])
    link.seq[SERVER] += 5
    link.packet(SERVER, TELL[14:])
    link.packet(CLIENT, ACK)
    link.end()
    assert details(link, "stream.hole") == ["5 bytes from 10.0.0.2:1099, inside a packet"]


@each(
    ("packet", "paired"),
    [(ASK, True), (short(0xF0, read(1, dbw(1, 0))), False), (short(0xB0, read(1, dbw(1, 0))), False),
     (short(0xF1, b"\x31" + read(1, dbw(1, 0))[1:]), False)],
)  # fmt: skip
def test_of_a_packet_that_the_capture_cut_only_data_of_s7_are_paired(packet: bytes, paired: bool) -> None:
    for amid in (False, True):
        link = Link()
        link.begin()
        if amid:
            link.packet(CLIENT, short(0xF0, b"what"))
        before = link.kinds()
        link.packet(CLIENT, packet, cut=4)
        link.packet(SERVER, TELL)
        link.end()
        assert ("answered" in link.outcomes()) is (paired and not amid), (packet, amid)
        assert link.kinds()["mpi_data"] == before["mpi_data"] + 1 + (paired and not amid)


def test_a_packet_whose_length_covers_others_hides_none_of_them() -> None:
    """Its own length says more than there is: the next segment begins with another packet."""
    link = Link()
    link.begin()
    frame = 0
    for ref in (1, 2):
        link.packet(CLIENT, short(0xF1, b"what")[:-1])
        frame = link.packet(CLIENT, short(0xF1, read(ref, dbw(1, 0))))
        link.packet(SERVER, long(0xF1, words(ref, 42)))
    link.end()
    assert (
        details(link, "ibh.malformed")
        == ["a length that covers other packets from 10.0.0.1:50000; they were decoded as well"] * 2
    )
    assert link.findings[-1].frames == [frame]
    assert link.outcomes() == ["answered"] * 2


def test_octets_that_begin_no_packet_are_reported_for_each_stretch() -> None:
    link = Link()
    link.begin()
    for first in (0x55, 0x66):
        link.packet(CLIENT, bytes((first,)) * 9 + ASK)
        link.packet(SERVER, TELL)
    link.end()
    assert details(link, "ibh.malformed") == [
        f"bytes that begin no packet from 10.0.0.1:50000, first 0x{first:02x}" for first in (0x55, 0x66)
    ]
    assert link.pipeline.counters.octets.skipped == 18


def test_a_message_without_end_says_who_sent_it() -> None:
    link = Link()
    link.begin()
    for _ in range(274):  # one octet of 241 is the number of the packet
        link.packet(CLIENT, short(0xF0, bytes(240)))
    assert details(link, "ibh.malformed") == [
        "a message in parts from 10.0.0.1:50000 exceeded 65536 bytes and was dropped"
    ]


# ---- connections ----------------------------------------------------------------------------------------------------


@each("server", [1099, 4711])
@each("swapped", [False, True])
def test_the_port_of_a_gateway_is_known_on_either_side(server: int, swapped: bool) -> None:
    """There a receipt is enough."""
    link = Link(server)
    if swapped:
        link.ports.reverse()
    link.hello()
    link.packet(SERVER, RECEIPT)
    assert (link.pipeline.connections.count == 1) is (server == 1099)


def test_a_connection_of_the_gateway_begins_and_ends_with_its_packets() -> None:
    link = Link()
    link.packet(CLIENT, ASK)
    (side,) = link.pipeline.table.all_open()
    connection = side.connection
    assert (connection.mid_stream, connection.iso_ended) == (True, "")
    link.packet(CLIENT, DISCONNECT)
    assert connection.iso_ended == "MPI disconnect from 10.0.0.1:50000"
    link.packet(CLIENT, CONNECT)
    assert (connection.mid_stream, connection.iso_ended, connection.client.port) == (False, "", 50000)


def test_who_connects_is_the_client() -> None:
    link = Link(1099)
    link.packet(SERVER, CLAIMED)
    link.packet(SERVER, CONNECT)
    (side,) = link.pipeline.table.all_open()
    assert (side.connection.client_known, side.connection.client.port) == (True, 1099)


def test_what_is_kept_is_known_to_the_octet() -> None:
    """A packet that is begun, and a message in parts."""
    link = Link()
    link.begin()
    (side,) = link.pipeline.table.all_open()
    assert side.peer is not None
    ibh = link.pipeline.ibh
    link.packet(CLIENT, short(0xF0, b"0123456789"))
    assert (ibh.held(side), ibh.held(side.peer)) == (10, 0)
    link.packet(CLIENT, ASK[:9])
    assert (ibh.held(side), ibh.held(side.peer)) == (10 + 9, 0)
    link.packet(SERVER, TELL[:5])
    assert (ibh.held(side), ibh.held(side.peer)) == (10 + 9, 5)


@each("known", [False, True])
def test_the_other_side_is_in_step_where_it_has_sent_nothing_yet(known: bool) -> None:
    link = Link()
    if known:
        link.hello()
    link.packet(CLIENT, CLAIM)
    (side,) = link.pipeline.table.all_open()
    assert side.peer is not None
    assert side.ibh is not None
    assert side.peer.ibh is not None
    assert (side.ibh.synced, side.peer.ibh.synced) == (True, known)


def test_the_section_counts_packets_by_kind() -> None:
    link = Link()
    assert link.pipeline.ibh.describe() == {"ibh": {}}
    link.begin()
    link.both((CLIENT, ACK + ASK), (SERVER, RECEIPT + TELL))
    assert link.pipeline.ibh.describe() == {"ibh": {"mpi_data": 4, "mpi_ack": 1, "receipt": 1, "service": 1}}
    assert link.pipeline.ibh.counted() == []
