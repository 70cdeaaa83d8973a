"""SCD in traffic, from packets to transactions: what is found where, how it is paired, and that nothing received raises."""

from __future__ import annotations

import struct
from itertools import pairwise
from typing import Any, Final

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect import scd
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.bindings.binding import Binding, Bindings
from dissect.meaning.bindings.bindings_file import find_content
from dissect.meaning.bindings.engine import MAX_JOINERS, ScdCarrier
from dissect.scd.codec import Codec
from dissect.scd.records import CrcRecord, EnvelopeField, EnvelopeRecord
from tests.engine.transactions.talk import (
    CLIENT,
    SERVER,
    Talk,
    ack_data,
    dt,
    good,
    head,
    item,
    read,
    tpkt,
    userdata,
    write,
    written,
)
from tests.meaning.bindings import plant
from tests.scd.making import dictionary as made
from tests.scd.making import variable

PUMP: Final = bytes.fromhex("01C805")  # runs, no fault, 1480
STATE: Final = bytes.fromhex("370218FCFFFF08")  # 0237h, -1000, 8: the worked TPDU 1 of the profile
MESSAGE: Final = bytes.fromhex("DC102A00001A0000 0700 370218FCFFFF08 BB4D")
DATA_BLOCK: Final = 0x84
BYTE: Final = 2


def listening(port: int = 102) -> Talk:
    talk = Talk(server_port=port)
    talk.carry(plant.carrier())
    return talk


def carrier_of(talk: Talk) -> ScdCarrier:
    carrier = talk.pipeline.exchange.decoder
    assert isinstance(carrier, ScdCarrier)
    return carrier


def end(talk: Talk) -> Talk:
    """The capture ends; every packet and octet has to be accounted for."""
    talk.pipeline.finish()
    assert talk.pipeline.counters.octets.failed == 0
    assert sum(talk.pipeline.counters.packet_counts().values()) == talk.pipeline.frames
    return talk


def values(transaction: Transaction) -> list[dict[Any, object]]:
    return [dict(found.message.values) for found in transaction.scd]


def told(talk: Talk) -> list[tuple[str, str, list[dict[Any, object]]]]:
    return [(one.function_name, one.outcome, values(one)) for one in talk.transactions]


# ---- UDP ------------------------------------------------------------------------------------------------------------


def test_a_read_over_udp() -> None:
    """Profile 3.3: read 6041h:00 and its response, to the octet."""
    talk = listening()
    talk.datagram(CLIENT, bytes.fromhex("DC02070041600000 0000D5D2"))
    talk.datagram(SERVER, bytes.fromhex("DC820700416000000200 3702 1F30"))
    (transaction,) = talk.transactions
    assert (transaction.function_name, transaction.outcome) == ("SCD read", "answered")
    assert (transaction.request_frame, transaction.response_frame, transaction.latency_ns) == (1, 2, 1_000_000)
    assert (transaction.is_scd, transaction.pdu_ref, transaction.asked_by) == (True, 7, CLIENT)
    asked, answer = transaction.scd
    assert (asked.subject, asked.values, asked.binding) == ("read 0x6041:0 Слово состояния 1", [], "обмен")
    assert [(row.address, row.value) for row in answer.values] == [("0x6041:0", 0x0237)]
    assert answer.octets == bytes.fromhex("DC820700416000000200 3702 1F30")
    assert (transaction.request, transaction.response, transaction.s7_results) == (None, None, [])
    connection = transaction.connection
    assert (connection.udp, connection.protocol, connection.identified_by) == (True, "scd", "обмен")
    assert [str(end) for end in (connection.client, connection.server)] == ["10.0.0.1:49200", "10.0.0.2:5600"]
    assert talk.findings == []


@pytest.mark.parametrize("err", [-5, -1, -128])
def test_an_abort_is_an_error(err: int) -> None:
    talk = listening()
    talk.datagram(CLIENT, plant.ask("Расход 1"))
    talk.datagram(SERVER, plant.refuse("Расход 1", err))
    (transaction,) = talk.transactions
    (error,) = transaction.errors
    assert (error.where, error.code, error.name) == ("message", err, "abort")
    assert error.text == plant.dictionary().error_text(err)
    assert transaction.failed
    assert [finding.slug for finding in talk.findings] == ["transaction.refused"]


def test_a_negative_error_without_abort_is_one_and_a_status_is_none() -> None:
    talk = listening()
    for tid, err in ((1, -4), (2, 4)):
        talk.datagram(CLIENT, plant.ask("Расход 1", 1, tid))
        talk.datagram(SERVER, plant.tell("Расход 1", tid=tid, err=err))
    refused, taken = talk.transactions
    assert [(error.code, error.name) for error in refused.errors] == [(-4, "error")]
    assert (taken.errors, taken.failed, taken.outcome) == ([], False, "answered")
    assert sorted(finding.slug for finding in talk.findings) == ["scd.status", "transaction.refused"]


def test_answers_in_another_order_pair_by_their_number() -> None:
    talk = listening()
    for tid in (1, 2, 3):
        talk.datagram(CLIENT, plant.ask(f"Расход {tid % 2 + 1}", tid=tid))
    for tid in (3, 1, 2):
        talk.datagram(SERVER, plant.tell(f"Расход {tid % 2 + 1}", 10 * tid, tid))
    assert [(one.request_frame, one.response_frame) for one in talk.transactions] == [(3, 4), (1, 5), (2, 6)]
    assert [list(values(one)[1].values()) for one in talk.transactions] == [[30], [10], [20]]


def test_both_ends_may_ask_with_the_same_number() -> None:
    talk = listening()
    talk.datagram(CLIENT, plant.ask("Расход 1"))
    talk.datagram(SERVER, plant.ask("Расход 2"))
    talk.datagram(SERVER, plant.tell("Расход 1", 1))
    talk.datagram(CLIENT, plant.tell("Расход 2", 2))
    assert [(one.asked_by, one.request_frame, one.response_frame) for one in talk.transactions] == [
        (CLIENT, 1, 3),
        (SERVER, 2, 4),
    ]


def test_the_same_request_again_waits_too_another_one_is_answered_by_its_object() -> None:
    """dissect.engine.transactions.pairing: the same octets within a second are a repetition, both may be answered."""
    talk = listening()
    talk.datagram(CLIENT, plant.ask("Расход 1"))
    talk.datagram(CLIENT, plant.ask("Расход 1"))
    talk.datagram(SERVER, plant.tell("Расход 1", 1))
    talk.datagram(SERVER, plant.tell("Расход 1", 1))
    assert [(one.request_frame, one.response_frame) for one in talk.transactions] == [(1, 3), (2, 4)]
    talk = listening()
    talk.datagram(CLIENT, plant.ask("Расход 1"))
    talk.datagram(CLIENT, plant.ask("Расход 2"))
    talk.datagram(SERVER, plant.tell("Расход 2", 2))
    assert [(one.request_frame, one.outcome, one.reason) for one in talk.transactions] == [(2, "answered", "")]


def test_an_answer_about_another_object_is_told() -> None:
    talk = listening()
    talk.datagram(CLIENT, plant.ask("Расход 1"))
    talk.datagram(SERVER, plant.tell("Расход 2", 2))
    assert [(one.request_frame, one.response_frame) for one in talk.transactions] == [(1, 2)]
    (finding,) = talk.findings
    assert finding.slug == "transaction.function_mismatch"
    assert finding.detail == "SCD read 0x6044:0 Расход 1: the answer names SCD read 0x6844:0 Расход 2"


def test_what_is_not_asked_for_and_what_is_not_answered() -> None:
    talk = listening()
    talk.datagram(SERVER, plant.tell("Расход 1", 2))
    talk.datagram(CLIENT, plant.ask("Расход 2", tid=9))
    end(talk)
    assert sorted((one.function_name, one.outcome, one.reason) for one in talk.transactions) == [
        ("SCD read", "orphan_answer", ""),
        ("SCD read", "unanswered", "capture_ended"),
    ]


def test_several_messages_of_a_datagram_have_their_offsets() -> None:
    talk = listening()
    talk.pipeline.exchange.observer.wants_pdus = True
    talk.datagram(SERVER, plant.pdo(counter=1) + plant.pdo("T65", counter=1) + plant.ask("Расход 1"))
    assert [(found.offset, found.subject, found.frame) for found in talk.messages] == [
        (0, "PDO T1 Состояние 1", 1),
        (19, "PDO T65 Состояние 2", 1),
        (38, "read 0x6044:0 Расход 1", 1),
    ]
    (connection,) = end(talk).connections
    assert {str(connection.tcp.ends[found.side]) for found in talk.messages} == {"10.0.0.2:5600"}
    assert connection.pdus == 3


def test_a_bare_pdo_goes_by_its_port() -> None:
    talk = listening()
    talk.datagram(SERVER, bytes.fromhex("C1AB24FA"), (49200, plant.BARE))
    assert told(talk) == [
        ("SCD PDO T2", "unsolicited", [{(0x6000, 1): True, (0x6000, 2): False, (0x6001, 0): 0xABC, (0x6000, 4): -1500}])
    ]
    assert talk.transactions[0].connection.identified_by == "насос и давление"


def test_datagrams_of_other_ports_and_cut_ones_are_counted_only() -> None:
    talk = listening()
    talk.datagram(CLIENT, plant.ask("Расход 1"), (49200, 5699))
    talk.datagram(CLIENT, plant.ask("Расход 1"), cut=3)
    end(talk)
    assert talk.transactions == []
    assert talk.pipeline.counters.packet_counts()["not_tcp"] == 1
    (row,) = [row for row in carrier_of(talk).as_dict()["bindings"] if row["name"] == "обмен"]
    assert (row["cut"], row["messages"]) == (1, 0)


def test_hosts_choose_among_bindings_of_a_port() -> None:
    from ipaddress import ip_network

    made_up = [
        Binding("all", "udp", "messages", port=5600),
        Binding("one", "udp", "pdo", "T2", port=5600, network=ip_network("10.0.0.7")),
        Binding("net", "udp", "messages", port=5605, network=ip_network("10.1.0.0/16")),
    ]
    talk = Talk()
    talk.carry(ScdCarrier(plant.dictionary(), Bindings(made_up)))
    talk.datagram(CLIENT, plant.ask("Расход 1"))
    talk.datagram(CLIENT, plant.ask("Расход 1"), (49200, 5605))
    talk.hosts = [1, 7]
    talk.datagram(SERVER, bytes.fromhex("C1AB24FA"))
    end(talk)
    assert [connection.identified_by for connection in talk.connections] == ["all", "one"]
    assert talk.pipeline.counters.packet_counts()["not_tcp"] == 1


# ---- TSAP, S7 areas, BSEND ------------------------------------------------------------------------------------------


def connected(talk: Talk, calling: str = "0100", called: str = "53434431") -> Talk:
    """A COTP connection between two TSAPs."""
    talk.hello()
    names = b"".join(
        bytes((code, len(octets))) + octets
        for code, octets in ((0xC1, bytes.fromhex(calling)), (0xC2, bytes.fromhex(called)))
    )
    for side, code in ((CLIENT, 0xE0), (SERVER, 0xD0)):
        fixed = bytes((code, 0, side, 0, 1 + side, 0)) + names
        talk.packet(side, tpkt(bytes((len(fixed),)) + fixed))
    return talk


@pytest.mark.parametrize("tsaps", [("0100", "53434431"), ("53434431", "0102")])
def test_messages_in_tsdus_go_by_a_tsap(tsaps: tuple[str, str]) -> None:
    talk = connected(listening(), *tsaps)
    talk.packet(CLIENT, dt(plant.ask("Режим 1")))
    talk.packet(SERVER, dt(plant.tell("Режим 1", 8)))
    assert told(talk) == [("SCD read", "answered", [{}, {(0x6061, 0): 8}])]
    talk.close()
    connection = end(talk).connections[0]
    assert (connection.protocol, connection.identified_by, connection.pdus) == ("scd", "канал", 2)
    assert talk.findings == []
    assert talk.pipeline.s7.pdus == 0


def test_a_tsdu_of_other_tsaps_is_none_even_when_it_looks_like_one() -> None:
    talk = connected(listening(), "0100", "0102")
    talk.packet(CLIENT, dt(plant.ask("Режим 1")))
    assert talk.transactions == []
    assert [finding.slug for finding in talk.findings] == ["session.foreign_on_102"]


def test_a_message_in_cotp_fragments() -> None:
    talk = connected(listening())
    octets = plant.ask("Режим 1")
    talk.packet(CLIENT, tpkt(b"\x02\xf0\x00" + octets[:5]))
    talk.packet(CLIENT, tpkt(b"\x02\xf0\x80" + octets[5:]))
    talk.packet(SERVER, dt(plant.tell("Режим 1", 8)))
    (transaction,) = talk.transactions
    assert (transaction.outcome, transaction.request_frame) == ("answered", 7)


def polled(octets: bytes, area: int = DATA_BLOCK, db: int = 10, at: int = 0) -> Transaction:
    talk = listening()
    talk.open()
    talk.ask(read(1, item(area, db, at * 8, BYTE, len(octets))))
    talk.tell(ack_data(1, b"\x04\x01", good(4, octets)))
    assert end(talk).findings == []
    return talk.transactions[-1]


def test_contents_of_a_data_block_that_is_read() -> None:
    """DB10 has a pump at 0 and the PDO T1 at 8, between them nothing."""
    transaction = polled(PUMP + bytes(5) + STATE)
    assert (transaction.function_name, transaction.is_scd, transaction.latency_ns) == ("Read Var", False, 1_000_000)
    pump, state = transaction.scd
    assert (pump.binding, pump.place, pump.offset) == ("насос в DB10", "DB10.DBB0", 0)
    assert pump.message.values == {"run": True, "fault": False, "speed": 1480}
    assert (state.subject, state.offset, state.side) == ("PDO T1 Состояние 1", 8, SERVER)
    assert list(state.message.values.values()) == [0x0237, -1000, 8]
    assert (pump.frame, pump.time_ns) == (transaction.response_frame, transaction.response_ns)


@pytest.mark.parametrize(
    ("octets", "at", "found"),
    [
        (PUMP, 0, ["насос в DB10"]),
        (PUMP[:2], 0, []),
        (PUMP[1:] + bytes(5) + STATE, 1, ["состояние в DB10"]),
        (STATE, 8, ["состояние в DB10"]),
        (STATE[:-1], 8, []),
        (bytes(20), 100, []),
    ],
)
def test_only_contents_that_are_there_whole(octets: bytes, at: int, found: list[str]) -> None:
    assert [one.binding for one in polled(octets, at=at).scd] == found


def test_the_db_number_counts_only_where_it_is_used() -> None:
    """Clients leave anything in the field of an item in the flags; another DB is another place."""
    flags = Binding("flags", "s7", "struct", "pump_t", "pump_t", (0x0040, 0), 3, area=0x83)
    for db in (0, 1, 10):
        talk = Talk()
        talk.carry(ScdCarrier(plant.dictionary(), Bindings([flags])))
        talk.open()
        talk.ask(read(1, item(0x83, db, 0, BYTE, 3)))
        talk.tell(ack_data(1, b"\x04\x01", good(4, PUMP)))
        assert [one.binding for one in talk.transactions[-1].scd] == ["flags"]
    assert polled(PUMP, db=11).scd == []
    assert polled(PUMP, area=0x83, db=0).scd == []


@pytest.mark.parametrize("code", [0xFF, 0x05])
def test_contents_that_are_written(code: int) -> None:
    talk = listening()
    talk.open()
    talk.ask(write(1, [item(DATA_BLOCK, 10, 0, BYTE, 3)], written(4, PUMP)))
    talk.tell(ack_data(1, b"\x05\x01", bytes((code,))))
    (pump,) = talk.transactions[-1].scd
    assert (pump.side, pump.frame) == (CLIENT, talk.transactions[-1].request_frame)
    assert pump.message.values == {"run": True, "fault": False, "speed": 1480}


def test_a_write_without_answer_still_shows_what_was_written() -> None:
    talk = listening()
    talk.open()
    talk.ask(write(1, [item(DATA_BLOCK, 10, 0, BYTE, 3)], written(4, PUMP)))
    (transaction,) = [one for one in end(talk).transactions if one.function_name == "Write Var"]
    assert (transaction.outcome, len(transaction.scd)) == ("unanswered", 1)


def bsend(talk: Talk, r_id: int, octets: bytes) -> Transaction:
    payload = b"\x12\x06\x13\x00" + r_id.to_bytes(4, "big") + len(octets).to_bytes(2, "big") + octets
    talk.ask(userdata(3, head(1, 6, 1), b"\xff\x09" + len(payload).to_bytes(2, "big") + payload))
    talk.tell(userdata(3, head(2, 6, 1, 1, 0)))
    return talk.transactions[-1]


def test_a_block_goes_by_its_r_id() -> None:
    talk = listening()
    talk.open()
    transaction = bsend(talk, 0x5CD, MESSAGE)
    (found,) = transaction.scd
    assert (found.binding, found.place, found.message.tid) == ("блоки", "BSEND 0x000005cd", 42)
    assert (found.octets, found.frame) == (MESSAGE, transaction.request_frame)
    assert bsend(talk, 0x5CE, MESSAGE).scd == []


def test_messages_inside_s7_are_not_paired() -> None:
    """A block is one transaction, whatever its messages ask: the next block may or may not answer them."""
    talk = listening()
    talk.open()
    transaction = bsend(talk, 0x5CD, plant.ask("Расход 1") + plant.ask("Расход 2"))
    assert [found.subject for found in transaction.scd] == ["read 0x6044:0 Расход 1", "read 0x6844:0 Расход 2"]
    assert end(talk).transactions == [transaction]


# ---- TCP ------------------------------------------------------------------------------------------------------------

EXCHANGES: Final = [
    (plant.ask("Расход 1", tid=1), plant.tell("Расход 1", -1000, 1)),
    (plant.ask("Имя станции", tid=2), plant.tell("Имя станции", "Насосная", 2)),
    (plant.ask("Режим 2", 8, 3), plant.tell("Режим 2", tid=3)),
    (plant.ask("Давление 1", 5, 4), plant.refuse("Давление 1", -4, 4, "write")),
]


def streamed(cuts: list[list[int]], *, hello: bool = True, junk: tuple[bytes, bytes] = (b"", b"")) -> Talk:
    """The exchanges over TCP, requests and then answers, each direction cut into segments at ``cuts``."""
    talk = Talk(server_port=plant.STREAM)
    talk.carry(plant.carrier())
    if hello:
        talk.hello()
    for side in (CLIENT, SERVER):
        octets = junk[side] + b"".join(pair[side] for pair in EXCHANGES)
        places = sorted({0, len(octets), *(cut % len(octets) for cut in cuts[side])})
        for begin, stop in pairwise(places):
            talk.packet(side, octets[begin:stop])
    talk.close()
    return end(talk)


def content(talk: Talk) -> list[tuple[str, str, list[bytes]]]:
    return [(one.function_name, one.outcome, [found.octets for found in one.scd]) for one in talk.transactions]


ALL: Final = [
    ("SCD read", "answered", list(EXCHANGES[0])),
    ("SCD read", "answered", list(EXCHANGES[1])),
    ("SCD write", "answered", list(EXCHANGES[2])),
    ("SCD write", "answered", list(EXCHANGES[3])),
]
CUTS: Final = st.lists(st.lists(st.integers(0, 200), max_size=12), min_size=2, max_size=2)
#: What may stand before a message: anything without its first octet, and begins of messages that never end.
JUNK: Final = st.one_of(
    st.binary(max_size=20),
    st.sampled_from(
        [b"\xdc", b"\xdc\xdc", bytes.fromhex("DC0207004160000000F0"), b"GET /\xdc\x02", EXCHANGES[0][0][:-1]]
    ),
)


@given(CUTS, st.booleans())
def test_any_segmentation_gives_the_same_transactions(cuts: list[list[int]], hello: bool) -> None:
    talk = streamed(cuts, hello=hello)
    assert content(talk) == ALL
    assert (
        talk.pipeline.counters.octets.skipped,
        talk.pipeline.counters.octets.buffered,
        carrier_of(talk).skipped,
    ) == (0, 0, 0)


@given(CUTS, JUNK, JUNK)
def test_any_segmentation_with_something_else_in_front(cuts: list[list[int]], asked: bytes, answered: bytes) -> None:
    whole = streamed([[], []], hello=False, junk=(asked, answered))
    talk = streamed(cuts, hello=False, junk=(asked, answered))
    assert content(whole) == content(talk) == ALL
    assert talk.pipeline.counters.octets.skipped == carrier_of(talk).skipped == len(asked) + len(answered)


def test_a_false_begin_does_not_hide_what_comes_behind_it() -> None:
    """A head that promises 61440 octets: what follows is found at once, not when so many have come."""
    talk = streamed([[], []], hello=False, junk=(bytes.fromhex("DC0207004160000000F0"), b""))
    assert [one.request_frame for one in talk.transactions] == [1, 1, 1, 1]


def test_a_wrong_checksum_at_a_known_begin_is_a_message_with_an_error() -> None:
    talk = listening(plant.STREAM)
    talk.hello()
    broken = bytearray(plant.ask("Расход 1"))
    broken[-1] ^= 1
    talk.packet(CLIENT, bytes(broken) + plant.ask("Расход 2", tid=2))
    assert [finding.slug for finding in talk.findings] == ["scd.crc"]
    assert carrier_of(talk).skipped == 0


@given(st.integers(1, 40), st.integers(1, 60))
def test_a_hole_costs_no_more_than_what_it_touches(begin: int, size: int) -> None:
    """Requests of 12 octets, of which a segment is missing: every one that is there whole is found."""
    requests = [plant.ask("Расход 1", tid=tid) for tid in range(20)]
    octets = b"".join(requests)
    talk = listening(plant.STREAM)
    talk.hello()
    talk.packet(CLIENT, octets[:begin])
    talk.seq[CLIENT] += size
    talk.packet(CLIENT, octets[begin + size :])
    talk.packet(SERVER)  # acknowledges what was not captured
    talk.close()
    end(talk)
    touched = {at // 12 for at in range(begin, begin + size)}
    asked = sorted(one.scd[0].message.tid for one in talk.transactions)
    assert asked == [tid for tid in range(20) if tid not in touched]
    assert talk.pipeline.counters.octets.missing == size


@given(st.integers(1, 30), st.integers(1, 40), st.booleans())
def test_bare_contents_keep_their_step_behind_a_hole(begin: int, size: int, hello: bool) -> None:
    bound = Binding("pumps", "tcp", "struct", "pump_t", "pump_t", (0x0040, 0), 3, port=plant.STREAM)
    talk = Talk(server_port=plant.STREAM)
    talk.carry(ScdCarrier(plant.dictionary(), Bindings([bound])))
    if hello:
        talk.hello()
    pumps = [plant.codec().encode_type("pump_t", {"run": True, "fault": False, "speed": n}) for n in range(30)]
    octets = b"".join(pumps)
    talk.packet(SERVER, octets[:begin])
    talk.seq[SERVER] += size
    talk.packet(SERVER, octets[begin + size :])
    talk.packet(CLIENT)
    talk.close()
    end(talk)
    touched = {at // 3 for at in range(begin, begin + size)}
    assert [one.scd[0].message.values["speed"] for one in talk.transactions] == [
        number for number in range(30) if number not in touched
    ]


# ---- other envelopes ------------------------------------------------------------------------------------------------


def wide_envelope(*, crc: bool = False) -> EnvelopeRecord:
    """Every number as wide as can be, behind an opening of two octets."""
    fields = [
        EnvelopeField("protocol", 16, value=0x55AA),
        EnvelopeField("kind", 6),
        EnvelopeField("abort", 1),
        EnvelopeField("response", 1),
        *[EnvelopeField(role, 64) for role in ("tid", "err", "index", "sub")],
        EnvelopeField("size", 16, counts="data"),
        EnvelopeField("data"),
        *([EnvelopeField("crc", 16)] if crc else []),
    ]
    return EnvelopeRecord(fields, [(1, "write"), (2, "read"), (16, "pdo")], CrcRecord() if crc else None)


def with_envelope(envelope: EnvelopeRecord, *carriers: Binding) -> tuple[Talk, Codec]:
    dictionary = made([variable(0x6000, 3), variable(0x6001, 3)], envelope=envelope)
    talk = Talk(server_port=plant.STREAM)
    talk.carry(ScdCarrier(dictionary, Bindings(carriers)))
    return talk, Codec(dictionary)


UDP: Final = Binding("udp", "udp", "messages", port=5600)
TCP: Final = Binding("tcp", "tcp", "messages", port=plant.STREAM)


def test_pairing_by_the_object_where_there_is_no_number() -> None:
    record = wide_envelope()
    narrow = EnvelopeRecord([field for field in record.fields if field.role != "tid"], record.kinds, None)
    talk, codec = with_envelope(narrow, UDP)

    def message(phase: Any, index: int, value: int | None = None) -> bytes:
        made_up = scd.Message(service="read", phase=phase, index=index)
        made_up.values = {} if value is None else {(index, 0): value}
        return codec.encode_message(made_up)

    talk.datagram(CLIENT, message("request", 0x6000))
    talk.datagram(CLIENT, message("request", 0x6001))
    talk.datagram(SERVER, message("response", 0x6001, 7))
    talk.datagram(SERVER, message("response", 0x6000, 5))
    assert [(one.request_frame, one.response_frame) for one in talk.transactions] == [(2, 3), (1, 4)]


def test_numbers_of_64_bits_are_taken_as_they_are() -> None:
    talk, codec = with_envelope(wide_envelope(), UDP)
    most = (1 << 64) - 1
    for tid in (most, most - (1 << 30), 1 << 30, 0):
        numbers = {"kind": 2, "tid": tid, "index": 0x6000}
        talk.datagram(CLIENT, codec.envelope.build(numbers, b""))
        talk.datagram(SERVER, codec.envelope.build({**numbers, "response": 1, "err": most}, b""))
    talk.datagram(CLIENT, codec.envelope.build({"kind": 2, "tid": most, "index": most, "sub": most, "err": most}, b""))
    end(talk)
    assert [one.scd[0].message.tid for one in talk.transactions] == [most, most - (1 << 30), 1 << 30, 0, most]
    assert [one.outcome for one in talk.transactions] == ["answered"] * 4 + ["unanswered"]
    assert [one.scd[1].message.err for one in talk.transactions[:4]] == [most] * 4


@pytest.mark.parametrize("crc", [True, False])
@given(st.lists(st.integers(0, 200), max_size=8))
def test_an_opening_of_several_octets_is_found_across_segments(crc: bool, cuts: list[int]) -> None:
    talk, codec = with_envelope(wide_envelope(crc=crc), TCP)
    octets = b"\x55\x55\xaa" + b"".join(
        codec.envelope.build({"kind": 2, "tid": tid, "index": 0x6000}, b"") for tid in range(3)
    )
    places = sorted({0, len(octets), *(cut % len(octets) for cut in cuts)})
    for begin, stop in pairwise(places):
        talk.packet(CLIENT, octets[begin:stop])
    talk.close()
    end(talk)
    assert [one.scd[0].message.tid for one in talk.transactions] == [0, 1, 2]
    assert carrier_of(talk).skipped == 3


# ---- whatever comes -------------------------------------------------------------------------------------------------

REMAP: Final = plant.entry("Режим 1", 8, 0)


def _changed(octets: bytes, at: int, bit: int) -> bytes:
    """One bit of them is another one."""
    made_up = bytearray(octets)
    made_up[at % len(octets)] ^= 1 << bit
    return bytes(made_up)


OCTETS: Final = st.one_of(
    st.binary(max_size=60),
    st.builds(
        _changed,
        st.sampled_from([MESSAGE, STATE, PUMP, EXCHANGES[1][1], EXCHANGES[3][1], plant.ask("0x1a00:1", REMAP)]),
        st.integers(0, 100),
        st.integers(0, 7),
    ),
)


@given(st.lists(st.tuples(st.booleans(), st.sampled_from([plant.MESSAGES, plant.BARE]), OCTETS), max_size=6))
def test_any_datagrams(packets: list[tuple[bool, int, bytes]]) -> None:
    talk = listening()
    for side, port, octets in packets:
        talk.datagram(int(side), octets, (49200, port))
    end(talk)
    assert talk.pipeline.counters.packet_counts()["payload"] == len(packets)


@given(st.lists(st.tuples(st.booleans(), OCTETS), max_size=6), st.booleans())
@example([(False, b"\0")], False)
def test_any_octets_of_a_stream(packets: list[tuple[bool, bytes]], hello: bool) -> None:
    talk = listening(plant.STREAM)
    if hello:
        talk.hello()
    for side, octets in packets:
        talk.packet(int(side), octets)
    talk.close()
    end(talk)
    counters = talk.pipeline.counters
    probes = counters.packet_counts()[
        "keep_alive"
    ]  # where the beginning was not captured, a first zero octet alone is one
    assert probes == 0 or not hello
    assert counters.octets.delivered + probes == sum(len(octets) for _, octets in packets)


@given(st.lists(st.tuples(st.booleans(), OCTETS), max_size=6))
def test_any_tsdus(packets: list[tuple[bool, bytes]]) -> None:
    talk = connected(listening())
    for side, octets in packets:
        talk.packet(int(side), dt(octets))
    talk.close()
    end(talk)


@given(OCTETS, st.integers(0, 12), st.booleans())
def test_any_octets_of_items_and_blocks(octets: bytes, at: int, wrote: bool) -> None:
    talk = listening()
    talk.open()
    where = item(DATA_BLOCK, 10, at * 8, BYTE, len(octets))
    if wrote:
        talk.ask(write(1, [where], written(4, octets)))
        talk.tell(ack_data(1, b"\x05\x01", b"\xff"))
    else:
        talk.ask(read(1, where))
        talk.tell(ack_data(1, b"\x04\x01", good(4, octets)))
    bsend(talk, 0x5CD, octets)
    end(talk)


@given(st.binary(max_size=200), st.sampled_from(["messages", "T2", "pump_t", "alarm_t", "Насос 1", "Имя станции"]))
def test_any_envelope_and_content(octets: bytes, holds: str) -> None:
    talk, _ = with_envelope(wide_envelope(), UDP)
    opened = struct.pack("<H", 0x55AA) + octets
    talk.datagram(CLIENT, opened)
    talk.datagram(SERVER, opened)
    end(talk)
    found = find_content(plant.dictionary(), holds)
    bound = Binding("x", "udp", found.holds, found.key, found.title, found.address, found.size, port=5600)
    talk = Talk()
    talk.carry(ScdCarrier(plant.dictionary(), Bindings([bound])))
    talk.datagram(SERVER, octets)
    end(talk)
    count = carrier_of(talk).counts["x"]
    assert (count.messages, count.cut) == (1 if octets or holds != "messages" else 0, 0)


# ---- bounds ---------------------------------------------------------------------------------------------------------


def test_blocks_of_many_connections_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dissect.meaning.bindings.engine.MAX_JOINERS", 2)
    assert MAX_JOINERS == 1024
    talk = listening()
    for port in range(50000, 50003):
        talk.ports[0] = port
        talk.seq = [1000, 90000]
        talk.open()
        bsend(talk, 0x5CD, MESSAGE)
    carrier = carrier_of(talk)
    assert (len(carrier._joiners), carrier.blocks_forgotten) == (2, 1)
    assert carrier.as_dict()["blocks_forgotten"] == 1
    end(talk)
    assert carrier._joiners == {}


def test_what_was_found_where() -> None:
    talk = listening()
    talk.datagram(SERVER, plant.pdo() + plant.pdo("T65") + b"\xdc\x00")
    talk.datagram(SERVER, bytes.fromhex("C1AB24FA"), (49200, plant.BARE))
    told_ = carrier_of(end(talk)).as_dict()
    assert {row["name"]: (row["messages"], row["values"], row["not_decoded"]) for row in told_["bindings"]} == {
        "обмен": (3, 6, 1), "насос и давление": (1, 4, 0), "поток": (0, 0, 0), "канал": (0, 0, 0),
        "насос в DB10": (0, 0, 0), "состояние в DB10": (0, 0, 0), "блоки": (0, 0, 0),
    }  # fmt: skip
    assert (told_["dictionary"], told_["version"], told_["unpaired"]) == ("Насосная", "1.0.0", 1)
    assert told_["wire_id"] == plant.dictionary().wire_id.hex()
