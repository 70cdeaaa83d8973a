"""Which packets are cut for what is wanted: those of transactions, connections and findings, and those around them."""

from __future__ import annotations

from typing import Any, Final

import pytest

from dissect.engine.findings.catalogue import SEVERITIES
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.bindings.engine import ScdCarrier
from dissect.meaning.select import selection as selecting
from dissect.meaning.select.places import packet_key, parsed
from dissect.meaning.select.selection import Choice, ContextBook, SameKeys, Selection, Wanted
from dissect.meaning.select.spans import Span
from dissect.packets.tcp import ip
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from dissect.wire.build import COMPILED
from tests.engine.findings.test_plus_rules import explore
from tests.engine.program.transfers import carry, download
from tests.engine.transactions import talk as line
from tests.engine.transactions.talk import ACK, CLIENT, FIN, MS, RST, SECOND, SERVER, SYN, dbw, read, words
from tests.engine.transactions.test_plus_operations import log_in, notify, subscribe
from tests.meaning.bindings import plant
from tests.properties.packets import ETHERNET
from tests.protocols.ibh import packets as ibh

_EVER: Final = (0, 2**63 - 1)


class Tape:
    """Keeps the packets of a talk; they are read twice, as `cut` does."""

    def __init__(self) -> None:
        self.packets: list[tuple[int, bytes]] = []

    @property
    def frames(self) -> int:
        return len(self.packets)

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        self.packets.append((time_ns, buf[start:end]))

    def finish(self) -> None:
        pass


def taped(**about: Any) -> tuple[line.Talk, Tape]:
    """A talk that nobody has read yet."""
    talk, tape = line.Talk(**about), Tape()
    talk.pipeline = tape  # type: ignore[assignment]
    return talk, tape


def chosen(
    tape: Tape, selection: Selection, times: tuple[int, int] = _EVER, decoder: ScdCarrier | None = None
) -> tuple[list[int], Choice]:
    """Return the packets that a selection takes, and its choice."""
    pipeline = Pipeline(selection, Options(strict=True, decoder=decoder))
    for time_ns, octets in tape.packets:
        pipeline.frame(time_ns, octets, 0, len(octets), len(octets), ETHERNET)
    pipeline.finish()
    choice = selection.choice(*times)
    taken = [
        number
        for number, (time_ns, octets) in enumerate(tape.packets, 1)
        if choice.takes(number, time_ns, octets, 0, len(octets), ETHERNET)
    ]
    return taken, choice


def of(tape: Tape, *numbers: int, context: bool = False) -> list[int]:
    """Return the packets of transactions."""
    return chosen(tape, Selection(Wanted(transactions=numbers), context=context))[0]


def two_connections() -> Tape:
    """Two connections at once, each with a setup and two reads: transactions 1 to 6."""
    talk, tape = taped()
    other = line.Talk(50001, beside=talk)
    talk.hello()  # 1, 2, 3
    other.hello()  # 4, 5, 6
    for one in (talk, other):
        one.connect()
        one.ask(line.setup(0))
        one.tell(line.granted(0))  # 7 to 10, 11 to 14
    for ref in (1, 2):
        for one in (talk, other):
            one.ask(read(ref, dbw(1, 0)))
            one.tell(words(ref, ref))  # 15 to 22
    for one in (talk, other):
        one.close()  # 23 to 25, 26 to 28
    return tape


# ---- transactions ---------------------------------------------------------------------------------------------------


def test_a_transaction_is_its_request_and_its_answer() -> None:
    tape = two_connections()
    assert [of(tape, number) for number in range(1, 7)] == [
        [9, 10], [13, 14], [15, 16], [17, 18], [19, 20], [21, 22],
    ]  # fmt: skip
    assert of(tape, 3, 6) == [15, 16, 21, 22]


@pytest.mark.parametrize("first", [0, 1, 0xFFFFFFFF, 0xFFFFFF80, 0x7FFFFFFF, 0x80000000])
def test_wherever_the_sequence_numbers_begin(first: int) -> None:
    """Those of the data of both ends begin at ``first``; the last number is followed by 0."""
    talk, tape = taped()
    talk.seq = [first - 1, first - 1]
    talk.open()
    asked, told = line.dt(read(1, dbw(1, 0))), line.dt(words(1, 1))
    for side, octets in ((CLIENT, asked), (SERVER, told)):
        talk.packet(side, octets[:5])
        talk.packet(side, octets[5:])
    assert of(tape, 1) == [6, 7]
    assert of(tape, 2) == [8, 9, 10, 11]


@pytest.mark.parametrize("noise", [b"", b"noise", bytes(40)])
def test_behind_lost_and_stray_octets_the_place_is_still_right(noise: bytes) -> None:
    talk, tape = taped()
    talk.open()  # 1 to 7
    for side in (CLIENT, SERVER):
        talk.lose(side, read(9, dbw(9, 9)), read(8, dbw(9, 9)))
    talk.packet(CLIENT)
    talk.packet(SERVER)
    talk.ask(read(1, dbw(1, 0)))  # 10
    talk.tell(words(1, 1))
    if noise:
        talk.packet(CLIENT, noise)
    at = len(tape.packets)
    for ref in (2, 3):
        asked, told = line.dt(read(ref, dbw(1, 0))), line.dt(words(ref, 1))
        for side, octets in ((CLIENT, asked), (SERVER, told)):
            talk.packet(side, octets[:20])
            talk.packet(side, octets[20:])
    talk.close()
    numbers = [int(one.number) for one in told_of(tape) if one.pdu_ref in {2, 3} and one.outcome == "answered"]
    assert len(numbers) == 2
    first, second = [of(tape, number) for number in numbers]
    assert set(first) >= {at + 1, at + 2, at + 3, at + 4}
    assert second == [at + 5, at + 6, at + 7, at + 8]
    if not noise:
        assert first == [at + 1, at + 2, at + 3, at + 4]


def told_of(tape: Tape) -> list[Transaction]:
    """Return the transactions of a tape."""
    kept = line.Talk()
    for time_ns, octets in tape.packets:
        kept.pipeline.frame(time_ns, octets, 0, len(octets), len(octets), ETHERNET)
    kept.finish()
    return kept.transactions


def test_every_segment_of_a_pdu_and_every_retransmission_is_taken() -> None:
    talk, tape = taped()
    talk.open()
    asked = line.dt(read(1, dbw(1, 0), dbw(1, 2)))
    for piece in (asked[:9], asked[9:20], asked[20:]):
        talk.packet(CLIENT, piece)
    told = line.dt(line.ack_data(1, b"\x04\x02", line.good(4, b"\0\1") + line.good(4, b"\0\2")))
    first = talk.seq[SERVER]
    talk.packet(SERVER, told)
    talk.packet(CLIENT)  # an ACK alone carries nothing of it
    talk.packet(SERVER, told, seq=first, after_ns=3 * MS)
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(words(2, 1))
    talk.packet(SERVER, told[10:14], seq=first + 10)  # a part of it once more
    base = 7
    assert of(tape, 2) == [base + at for at in (1, 2, 3, 4, 6, 9)]
    assert of(tape, 3) == [base + 7, base + 8]


@pytest.mark.parametrize(("later", "taken"), [(9 * SECOND, True), (10 * SECOND, True), (10 * SECOND + 1, False)])
def test_retransmissions_are_looked_for_some_seconds_only(later: int, taken: bool) -> None:
    """Sequence numbers come again after 4 GiB: what has them much later is something else."""
    talk, tape = taped()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    first = talk.seq[SERVER]
    talk.tell(words(1, 7))
    talk.packet(SERVER, line.dt(words(1, 7)), seq=first, after_ns=later)
    assert of(tape, 2) == [8, 9, 10] if taken else [8, 9]


@pytest.mark.parametrize(("earlier", "taken"), [(9 * SECOND, True), (10 * SECOND, True), (10 * SECOND + 1, False)])
def test_the_beginning_of_a_request_is_looked_for_some_seconds_only(earlier: int, taken: bool) -> None:
    talk, tape = taped()
    talk.open()
    request = line.dt(read(1, dbw(1, 0)))
    talk.packet(CLIENT, request[:9])
    talk.packet(CLIENT, request[9:], after_ns=earlier)
    talk.tell(words(1, 7))
    assert of(tape, 2) == ([8, 9, 10] if taken else [9, 10])


def test_a_setup_is_looked_for_up_to_the_transaction_of_which_it_is_the_context() -> None:
    """Octets with its sequence numbers that come after the answer are not its own."""
    for behind, extra in ((False, [10]), (True, [])):
        talk, tape = taped()
        talk.hello()
        talk.connect()
        first = talk.seq[CLIENT]
        talk.ask(line.setup(0))  # 6
        talk.tell(line.granted(0))
        talk.ask(read(1, dbw(1, 0)))  # 8
        if behind:
            talk.tell(words(1, 1))  # 9
        else:
            talk.packet(CLIENT)
        talk.packet(CLIENT, line.dt(line.setup(0)), seq=first)  # 10
        if not behind:
            talk.tell(words(1, 1))  # 11
        answered = [9] if behind else [11]
        assert of(tape, 2, context=True) == sorted([1, 2, 4, 5, 6, 7, 8, *extra, *answered])


def test_of_an_unanswered_request_the_end_of_its_connection_is_taken() -> None:
    """It says why nobody answered; the beginning does not."""
    for ending, ends in ((FIN | ACK, True), (RST, True), (ACK, False)):
        talk, tape = taped()
        talk.open()
        talk.ask(read(1, dbw(1, 0)))  # 8
        talk.packet(CLIENT)
        talk.packet(SERVER, flags=ending)  # 10
        assert of(tape, 2) == ([8, 10] if ends else [8]), ending
    talk, tape = taped()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.packet(SERVER, flags=RST)
    assert of(tape, 2) == [8, 9]  # it is answered: the end is no part of it


def test_with_context_the_beginning_and_end_of_a_connection_are_taken() -> None:
    tape = two_connections()
    taken, choice = chosen(tape, Selection(Wanted(transactions=[6]), context=True))
    # SYN and SYN+ACK, CR and CC, the setup, request and answer, both FINs: of the second connection.
    assert taken == [4, 5, 11, 12, 13, 14, 21, 22, 26, 27]
    assert choice.context == 8
    assert chosen(tape, Selection(Wanted(transactions=[6])))[1].context == 0
    assert of(tape, 5, 6, context=True) == [1, 2, 4, 5, 7, 8, 9, 10, 11, 12, 13, 14, 19, 20, 21, 22, 23, 24, 26, 27]


def test_with_context_a_setup_that_was_sent_again_is_taken_again() -> None:
    talk, tape = taped()
    talk.hello()
    talk.connect()
    first = talk.seq[CLIENT]
    talk.ask(line.setup(0))  # 6
    talk.packet(CLIENT, line.dt(line.setup(0)), seq=first)  # 7
    talk.tell(line.granted(0))  # 8
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    assert of(tape, 2, context=True) == [1, 2, 4, 5, 6, 7, 8, 9, 10]


@pytest.mark.parametrize("size", [1, 7, 21])
def test_with_context_every_segment_of_what_opens_and_closes_a_connection_is_taken(size: int) -> None:
    """Octets that close it are one TPDU in segments, too; a part without the first of them would hold no TPDU."""
    talk, tape = taped()
    talk.hello()  # 1 to 3

    def sliced(side: int, octets: bytes) -> list[int]:
        before = tape.frames
        for at in range(0, len(octets), size):
            talk.packet(side, octets[at : at + size])
        return list(range(before + 1, tape.frames + 1))

    opening = sliced(CLIENT, line.CONNECT) + sliced(SERVER, line.CONFIRM)
    talk.ask(line.setup(0))
    talk.tell(line.granted(0))
    setup = tape.frames
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(words(2, 1))
    closing = sliced(CLIENT, line.tpkt(bytes.fromhex("06800001000200")))
    wanted = [1, 2, *opening, setup - 1, setup, setup + 3, setup + 4, *closing]
    assert of(tape, 3, context=True) == wanted


def test_of_two_setups_the_latest_before_a_transaction_is_its_context() -> None:
    talk, tape = taped()
    talk.open()  # 1 to 7
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.ask(line.setup(9))
    talk.tell(line.granted(9))
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(words(2, 1))
    assert of(tape, 2, context=True) == [1, 2, 4, 5, 6, 7, 8, 9]
    assert of(tape, 4, context=True) == [1, 2, 4, 5, 10, 11, 12, 13]


def test_context_of_a_connection_that_says_good_bye_in_cotp() -> None:
    talk, tape = taped()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.packet(CLIENT, line.tpkt(bytes.fromhex("06800001000200")))  # DR: disconnect request
    assert of(tape, 2, context=True)[-1] == 10
    assert of(tape, 2) == [8, 9]


def opened_ibh(talk: line.Talk) -> None:
    """An IBH-NetLink session up to the setup: packets 1 to 9."""
    talk.hello()
    talk.packet(CLIENT, ibh.CLAIM)  # 4
    talk.packet(SERVER, ibh.CLAIMED)
    talk.packet(CLIENT, ibh.short(0xE0, bytes.fromhex("00800002000201000100")))
    talk.packet(SERVER, ibh.RECEIPT + ibh.long(0xD0))
    talk.packet(CLIENT, ibh.short(0xF1, line.setup(0)))  # 8
    talk.packet(SERVER, ibh.RECEIPT + ibh.long(0xB0, b"\x01") + ibh.long(0xF1, line.granted(0)))


def test_context_of_a_session_of_ibh_netlink() -> None:
    """What claims, opens and closes it is its context; acknowledgements and receipts are not."""
    talk, tape = taped(server_port=1099)
    opened_ibh(talk)
    asked, answer = ibh.short(0xF1, read(1, dbw(1, 0))), ibh.long(0xF1, words(1, 7))
    talk.packet(CLIENT, asked[:9])  # 10
    talk.packet(CLIENT, asked[9:])
    talk.packet(SERVER, answer[:20])
    talk.packet(SERVER, answer[20:])  # 13
    talk.packet(CLIENT, ibh.ACK)
    talk.packet(SERVER, ibh.RECEIPT)
    talk.packet(CLIENT, ibh.short(0xF1, read(2, dbw(1, 0))))  # 16
    talk.packet(SERVER, ibh.long(0xF1, words(2, 7)))
    talk.packet(CLIENT, ibh.DISCONNECT)  # 18
    assert of(tape, 2) == [10, 11, 12, 13]
    assert of(tape, 2, context=True) == [1, 2, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 18]
    selection = Selection(Wanted(transactions=[2]))
    chosen(tape, selection)
    assert selection.uncertain == 0


@pytest.mark.parametrize("asks", [CLIENT, SERVER])
def test_a_transaction_has_its_packets_whoever_asks(asks: int) -> None:
    """Of a download the PLC requests the pieces, or the client sends them; each PDU is in two segments."""
    talk, tape = taped()
    talk.open()  # 1 to 7
    said = download(bytes(range(30)), "_0800001P", 20, asks=asks)
    carry(talk, said, 9)
    talk.close()
    for number in range(len(said) // 2):
        assert of(tape, 2 + number) == [8 + 4 * number + at for at in range(4)]


def test_with_a_notification_of_s7comm_plus_its_subscription_is_taken() -> None:
    talk, tape = taped()
    talk.hello()
    talk.connect()
    log_in(talk)  # 6, 7
    subscribe(talk)  # 8, 9
    explore(talk, 3)  # 10, 11
    notify(talk, 1)
    notify(talk, 2, 0x70009999)
    assert [of(tape, number) for number in (2, 4, 5)] == [[8, 9], [8, 9, 12], [13]]
    assert of(tape, 4, 1) == [6, 7, 8, 9, 12]


def test_transactions_of_datagrams_are_their_packets() -> None:
    """A datagram is one packet: nothing about it is uncertain, and it opens and closes nothing."""
    talk, tape = taped()
    talk.datagram(0, plant.ask("0x6001:0", tid=1))
    talk.datagram(1, plant.tell("0x6001:0", 50, tid=1))
    talk.datagram(0, plant.ask("0x6001:0", tid=2))
    talk.datagram(0, plant.ask("0x6001:0", tid=3), ports=(49201, 5600))
    for context in (False, True):
        for number, taken in ((1, [1, 2]), (2, [3]), (3, [4])):
            selection = Selection(Wanted(transactions=[number]), context=context)
            assert chosen(tape, selection, decoder=plant.carrier())[0] == taken
            assert (selection.uncertain, selection.missing) == (0, "")
    for number, taken in ((1, [1, 2, 3]), (2, [4])):
        assert chosen(tape, Selection(Wanted(connections=[number])), decoder=plant.carrier())[0] == taken


@pytest.mark.parametrize("numbers", [{7, 3, 5}, set(range(3, 15))])
def test_what_is_not_there_is_named(numbers: set[int]) -> None:
    tape = two_connections()
    for kind, there in (("transactions", range(1, 7)), ("connections", range(1, 3)), ("findings", range(1, 1))):
        selection = Selection(Wanted(**{kind: numbers}))  # type: ignore[arg-type]
        chosen(tape, selection)
        gone = [str(number) for number in sorted(numbers - set(there))][:10]
        assert selection.missing == f"no {kind[:-1]} {', '.join(gone)}"
    selection = Selection(Wanted(connections=[1, 9], transactions=[2, 8]))
    chosen(tape, selection)
    assert selection.missing == "no connection 9; no transaction 8"
    selection = Selection(Wanted(connections=[1], transactions=[2]))
    chosen(tape, selection)
    assert selection.missing == ""


def test_pdus_whose_place_is_not_known_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """More wait for their transactions than may be remembered: the packet that completed such a PDU is all that is known."""
    for count in (1, 3):
        talk, tape = taped()
        talk.open(8, 8)
        talk.ask(*[read(ref, dbw(1, 0)) for ref in range(1, count + 1)])
        for ref in range(1, count + 1):
            talk.tell(words(ref, 1))
        selection = Selection(Wanted(transactions=range(2, 2 + count)))
        monkeypatch.setattr(selection._book, "pop", lambda *_: None)
        taken, _ = chosen(tape, selection)
        assert selection.uncertain == 2 * count
        assert taken == list(range(8, 9 + count))


# ---- connections ----------------------------------------------------------------------------------------------------


def test_a_connection_is_all_its_packets() -> None:
    tape = two_connections()
    first = [1, 2, 3, 7, 8, 9, 10, 15, 16, 19, 20, 23, 24, 25]
    for number, expected in ((1, first), (2, sorted(set(range(1, 29)) - set(first)))):
        taken, choice = chosen(tape, Selection(Wanted(connections=[number])))
        assert taken == expected
        assert not choice.everything


def test_of_two_connections_on_the_same_ports_only_the_one_is_taken() -> None:
    talk, tape = taped()
    for _ in range(2):
        talk.open()
        talk.ask(read(1, dbw(1, 0)))
        talk.tell(words(1, 1))
        talk.close()
        talk.seq = [talk.seq[0] + 100_000, talk.seq[1] + 100_000]
    half = len(tape.packets) // 2
    assert chosen(tape, Selection(Wanted(connections=[1])))[0] == list(range(1, half + 1))
    assert chosen(tape, Selection(Wanted(connections=[2])))[0] == list(range(half + 1, 2 * half + 1))


def test_a_connection_whose_packets_change_their_vlan() -> None:
    """As a mirror of two ports shows it: each direction has a tag of its own, and is the same connection."""
    talk, tape = taped()
    for side, payload, flags in (
        (CLIENT, b"", SYN), (SERVER, b"", SYN | ACK), (CLIENT, b"", ACK), (CLIENT, line.CONNECT, ACK),
        (SERVER, line.CONFIRM, ACK), (CLIENT, line.dt(line.setup(0)), ACK), (SERVER, line.dt(line.granted(0)), ACK),
        (CLIENT, line.dt(read(1, dbw(1, 0))), ACK), (SERVER, line.dt(words(1, 1)), ACK),
    ):  # fmt: skip
        talk.vlan = 10 + side
        talk.packet(side, payload, flags)
    assert chosen(tape, Selection(Wanted(connections=[1])))[0] == list(range(1, 10))
    assert of(tape, 2) == [8, 9]
    assert of(tape, 2, context=True) == [1, 2, 4, 5, 6, 7, 8, 9]


def test_connections_in_several_vlans_are_remembered_up_to_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(selecting, "MAX_CONNECTIONS", 4)
    ends = [Endpoint(bytes((10, 0, 0, host)), 100 + host) for host in (1, 2)]
    same = SameKeys()
    for vlan in range(1, 9, 2):
        tcp = TcpConnection(ends[0], ends[1], vlan, 1, 0)
        same.note(tcp)
        assert len(same.found) == min(4, vlan - 1)
        tcp.note_vlan(vlan + 1)
        same.note(tcp)
        assert len(same.found) == min(4, vlan + 1)
    there, back = [bytes((10, 0, 0, host, 10, 0, 0, 3 - host, 0, 100 + host, 0, 103 - host)) for host in (1, 2)]
    tags = [vlan.to_bytes(8, "big") for vlan in range(5)]
    assert same.found == {
        there + tags[2]: there + tags[1], back + tags[2]: back + tags[1], there + tags[4]: there + tags[3],
        back + tags[4]: back + tags[3],
    }  # fmt: skip


def test_connections_that_share_a_vlan_are_found_by_the_first_key() -> None:
    ends = [Endpoint(bytes((10, 0, 0, host)), 100 + host) for host in (1, 2)]
    same = SameKeys()
    for vlan, other in ((1, 2), (2, 3), (1, 3)):
        tcp = TcpConnection(ends[0], ends[1], vlan, 1, 0)
        tcp.note_vlan(other)
        same.note(tcp)
    assert {(int.from_bytes(key[12:], "big"), int.from_bytes(first[12:], "big")) for key, first in same.found.items()} == {
        (2, 1), (3, 1),
    }  # fmt: skip


# ---- findings -------------------------------------------------------------------------------------------------------


def refused() -> Tape:
    talk, tape = taped()
    talk.open()
    for ref in (1, 2):
        talk.ask(read(ref, dbw(ref, 0)))
        talk.tell(line.ack_data(ref, b"\x04\x01", line.refused(0x0A)))
    talk.ask(line.job(3, b"\x29" + bytes(5) + b"\x09P_PROGRAM"))  # stop
    talk.tell(line.ack_data(3, b"\x29"))
    talk.close()
    return tape


def test_packets_of_findings_and_what_they_are_about() -> None:
    tape = refused()
    whole = Selection(Wanted())
    every, choice = chosen(tape, whole)
    assert every == list(range(1, len(tape.packets) + 1))
    assert choice.everything
    slugs = {finding.slug: finding for finding in whole._findings}
    stop = slugs["security.plc_stop"]
    assert chosen(tape, Selection(Wanted(slugs=["security.plc_stop"])))[0] == sorted(map(int, stop.frames))
    assert chosen(tape, Selection(Wanted(findings=[int(stop.number)])))[0] == sorted(map(int, stop.frames))
    assert chosen(tape, Selection(Wanted(slugs=["transaction.item_error"])))[0] == [8, 9, 10, 11]
    assert set(choice.comments) == {int(frame) for finding in whole._findings for frame in finding.frames}
    for frame in stop.frames:
        assert any("security.plc_stop" in text for text in choice.comments[int(frame)])
    assert chosen(tape, Selection(Wanted(), comments=False))[1].comments == {}


def test_the_heaviest_finding_of_a_packet_comes_first() -> None:
    talk, tape = taped()
    talk.open()
    talk.ask(line.job(3, b"\x29" + bytes(5) + b"\x09P_PROGRAM"))  # 8: a stop, which is refused
    talk.tell(line.ack_data(3, b"\x29", code=0x8104))
    _, choice = chosen(tape, Selection(Wanted()))
    weights = [[SEVERITIES.index(text.split()[1]) for text in texts] for texts in choice.comments.values()]
    assert any(len(set(some)) > 1 for some in weights)
    assert weights == [sorted(some) for some in weights]


# ---- times and further conditions -----------------------------------------------------------------------------------


def test_both_ends_of_a_time_are_within() -> None:
    tape = two_connections()
    times = [time_ns for time_ns, _ in tape.packets]
    for begin, end in ((0, 3), (5, 5), (20, 27)):
        within = (times[begin], times[end])
        assert chosen(tape, Selection(Wanted()), within)[0] == list(range(begin + 1, end + 2))
    assert chosen(tape, Selection(Wanted()), (times[5] + 1, times[6] - 1))[0] == []
    assert chosen(tape, Selection(Wanted(connections=[1])), (times[7], times[14]))[0] == [8, 9, 10, 15]


def test_a_further_condition_narrows_what_is_taken() -> None:
    tape = two_connections()
    for wanted, expected in ((Wanted(), [2, 4, 6]), (Wanted(connections=[1]), [2]), (Wanted(connections=[2]), [4, 6])):
        selection = Selection(wanted)
        _, choice = chosen(tape, selection)
        choice.narrow(lambda frame, *_: frame in {2, 4, 6})
        assert not choice.everything
        assert [
            at
            for at, (time_ns, octets) in enumerate(tape.packets, 1)
            if choice.takes(at, time_ns, octets, 0, len(octets), ETHERNET)
        ] == expected


def test_only_transactions_need_all_messages() -> None:
    for wanted, needs, everything in (
        (Wanted(), False, True), (Wanted(connections=[1]), False, False), (Wanted(transactions=[1]), True, False),
        (Wanted(findings=[1]), False, False), (Wanted(slugs=["x"]), False, False),
    ):  # fmt: skip
        selection = Selection(wanted)
        assert (selection.wants_tpdus, selection.wants_pdus, wanted.everything) == (needs, needs, everything)


# ---- bounds ---------------------------------------------------------------------------------------------------------


def test_no_more_packets_of_a_beginning_than_the_bound_are_kept() -> None:
    book = ContextBook()
    for frame in range(1, 40):
        book.opened(5, frame, 0, Span(b"", frame, 1))
    assert book.of(5).frames == list(range(1, 17))
    assert [timed.span.seq for timed in book.of(5).opening] == book.of(5).frames
    book.negotiated(5, [50, 51], [])
    assert book.of(5).setup == [50, 51]
    book.negotiated(5, [60], [])
    assert book.of(5).setup == [60]
    assert book.of(6).frames == []


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_the_connections_that_were_used_least_recently_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(selecting, "MAX_CONNECTIONS", 3)
    book = ContextBook()
    for number in (1, 2, 3):
        book.opened(number, number, 0, None)
    book.opened(1, 11, 0, None)
    book.opened(4, 4, 0, None)
    assert [book.of(number).frames for number in (1, 3, 4)] == [[1, 11], [3], [4]]
    assert book.of(2).frames == []  # it had to go, and is new


def test_the_beginnings_of_sixteen_thousand_connections_are_remembered() -> None:
    book = ContextBook()
    for number in range(1, 16_385):
        book.opened(number, number, 0, None)
    assert book.of(1).frames == [1]  # used now, so that the second is the one to go
    book.opened(20_000, 7, 0, None)
    assert [book.of(number).frames for number in (3, 1, 20_000)] == [[3], [1], [7]]
    assert book.of(2).frames == []


# ---- fragments, and what has no ports -------------------------------------------------------------------------------


def fragment(octets: bytes, offset: int, more: bool, payload: bytes, protocol: int = 6) -> bytes:
    """Return an Ethernet frame with a fragment between the hosts of another one."""
    header = bytearray(octets[14:34])
    header[2:4] = (20 + len(payload)).to_bytes(2, "big")
    header[6:8] = (offset // 8 | (0x2000 if more else 0)).to_bytes(2, "big")
    header[9] = protocol
    return octets[:14] + bytes(header) + payload


def test_fragments_between_the_hosts_at_that_time_are_taken() -> None:
    """They have no ports: between these hosts one may be a part of what is wanted, at another time or elsewhere it is not."""
    talk, tape = taped()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    _, frame = tape.packets[-1]
    elsewhere = frame[:26] + bytes((10, 0, 0, 9)) + frame[30:]
    for octets in (frame, elsewhere):
        for protocol in (6, 17, 47):
            talk.raw(fragment(octets, 1480, False, bytes(40), protocol))
    talk.packet(SERVER, flags=RST)  # 16
    talk.raw(fragment(frame, 1480, False, bytes(40)), after_ns=100 * SECOND)
    talk.raw(fragment(frame, 1480, False, bytes(40), 47))
    # Of a tunnel (GRE) nobody sees whose packet is in it.
    assert of(tape, 2) == [8, 9, 10, 11, 12, 15]
    assert chosen(tape, Selection(Wanted(connections=[1])))[0] == [*range(1, 13), 15, 16]


def test_the_key_of_a_packet() -> None:
    """Addresses, then ports, then the VLAN; without ports it has none."""
    _, tape = talk = taped()
    talk[0].packet(CLIENT, b"x")
    talk[0].vlan = 7
    talk[0].packet(SERVER, b"x")
    addresses = bytes((10, 0, 0, 1, 10, 0, 0, 2))
    back = addresses[4:] + addresses[:4]
    plain, tagged = [octets for _, octets in tape.packets]
    assert packet_key(plain, 0, len(plain), ETHERNET) == (addresses + bytes.fromhex("c3500066"), addresses)
    assert packet_key(tagged, 0, len(tagged), ETHERNET) == (
        back + bytes.fromhex("0066c350") + (7).to_bytes(8, "big"),
        back,
    )
    icmp = fragment(plain, 0, False, bytes(40), 1)
    assert packet_key(icmp, 0, len(icmp), ETHERNET) == (b"", addresses)
    part = fragment(plain, 64, True, bytes(40))
    found = parsed(part, 0, len(part), ETHERNET)
    assert found is not None
    assert (found[1], bool(found[0].fragment_key), found[0].protocol) == (b"", True, ip.TCP)
    for short in (3, 4):
        made = fragment(plain, 0, False, plain[34 : 34 + short])
        key = packet_key(made, 0, len(made), ETHERNET)[0]
        assert key == (addresses + plain[34:38] if short == 4 else b"")
    for octets in (b"", plain[:20], b"\xff" * 60, bytes(60)):
        assert packet_key(octets, 0, len(octets), ETHERNET) == (b"", b"")
