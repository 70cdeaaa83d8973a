from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scapy.layers.inet import IP, TCP, UDP
from scapy.layers.l2 import Ether
from scapy.packet import NoPayload, Packet, Raw
from scapy.sendrecv import sniff
from scapy.sessions import TCPSession
from scapy.supersocket import StreamSocket
from scapy.utils import wrpcap

from dissect.layers import SCD, bind_scd, unbind_scd
from dissect.layers.scd import CHAIN_LIMIT
from dissect.layers.scd_fields import ENVELOPE, KINDS
from dissect.scd.codec import Codec
from dissect.scd.dictionary import Dictionary
from dissect.scd.envelope import DEFAULT
from dissect.scd.errors import E_COUNT, E_CRC, E_INDEX, E_KIND, E_RANGE, E_SHORT, ERROR_TEXTS, Error
from dissect.scd.loading import load
from dissect.scd.messages import Message
from dissect.scd.source import parse_toml
from tests.layers.support import forget, shown, survives
from tests.scd.making import REFERENCE, dictionary, plant

PLANT: Final = Path(__file__).resolve().parents[2] / "captures" / "scd" / "plant.toml"
#: Reference 3.3, to the octet, and what the plant's dictionary makes of it.
WIRE: Final = [
    ("DC 02 07 00 41 60 00 00 00 00 D5 D2", "SCD read tid=7 0x6041:0 Слово состояния 1", {}),
    ("DC 82 07 00 41 60 00 00 02 00 37 02 1F 30", "SCD read response tid=7 0x6041:0 Слово состояния 1 = 567",
     {"Слово состояния 1": 567}),
    ("DC C2 07 FB 41 60 00 00 00 00 09 56", "SCD read abort tid=7 0x6041:0 Слово состояния 1: no such object (-5)", {}),
    ("DC 01 08 00 00 60 01 00 01 00 01 69 FF", "SCD write tid=8 0x6000:1 Насос 1.run = True", {"Насос 1.run": True}),
    ("DC 81 08 00 00 60 01 00 00 00 E5 C0", "SCD write response tid=8 0x6000:1 Насос 1.run", {}),
    ("DC 10 2A 00 00 1A 00 00 07 00 37 02 18 FC FF FF 08 BB 4D",
     "SCD pdo tid=42 T1 Состояние 1: Слово состояния 1 = 567, Расход 1 = -1000, Режим 1 = автомат (8)",
     {"Слово состояния 1": 567, "Расход 1": -1000, "Режим 1": 8}),
]  # fmt: skip
OCTETS: Final = [bytes.fromhex(row[0]) for row in WIRE]
READ, ANSWER, ABORT, WRITE, ACK, PUSH = OCTETS


@pytest.fixture(scope="module")
def od() -> Dictionary:
    return load(PLANT)


@pytest.fixture(autouse=True)
def _nothing_stays_bound() -> Iterator[None]:
    before = UDP.payload_guess, TCP.payload_guess
    yield
    UDP.payload_guess, TCP.payload_guess = before


def datagram(octets: bytes, sport: int = 40000, dport: int = 5000) -> Packet:
    """A UDP datagram as a capture has it."""
    return UDP(bytes(UDP(sport=sport, dport=dport, len=8 + len(octets))) + octets)


def segment(octets: bytes, dport: int = 5000) -> Packet:
    """A TCP segment as a capture has it."""
    return TCP(bytes(TCP(sport=40000, dport=dport)) + octets)


def same(one: Message | None, other: Message) -> bool:
    """Whether two messages say the same; errors are compared by what they say."""
    pairs = [(getattr(one, name), getattr(other, name)) for name in other.__struct_fields__]
    return all(str(left) == str(right) if isinstance(left, Error) else left == right for left, right in pairs)


def code(packet: SCD) -> str:
    """What is wrong with a message."""
    assert packet.message is not None
    assert packet.message.error is not None
    return packet.message.error.code


def made(text: str) -> Dictionary:
    """The dictionary of these tables."""
    return parse_toml(f'[dictionary]\nname = "made"\n{text}')


def built(od: Dictionary) -> list[SCD]:
    """The messages of `WIRE`, made by name."""
    read, write = SCD.read(od, "Слово состояния 1", tid=7), SCD.write(od, "Насос 1.run", True, tid=8)
    pdo = SCD.pdo(od, "T1", {"Слово состояния 1": 567, "Расход 1": -1000, "Режим 1": 8}, tid=42)
    return [read, read.respond(567), read.refuse(-5), write, write.respond(), pdo]


# Fields


def test_the_fields_are_those_of_the_envelope() -> None:
    assert {field.name for field in SCD.fields_desc} == {field.role for field in DEFAULT.fields}
    octets = bytes(SCD())
    assert octets == ENVELOPE.build({"kind": 2}, b"")
    for field in DEFAULT.fields:
        if field.role in {"protocol", "size", "data", "crc"}:
            continue
        low, high = (-(1 << field.bits - 1), (1 << field.bits - 1) - 1) if field.signed else (0, (1 << field.bits) - 1)
        for number in (low, high, high // 3):
            given: dict[str, Any] = {"kind": 2, field.role: number}
            assert bytes(SCD(**given, data=b"ab")) == ENVELOPE.build(given, b"ab"), field.role
            assert SCD(ENVELOPE.build(given, b"ab")).getfieldval(field.role) == number


def test_kinds_and_errors_have_names() -> None:
    for number, service in KINDS.items():
        assert SCD(kind=service).kind == number
        assert f"kind      = {service}\n" in shown(SCD(kind=number))
    assert SCD(kind=5).summary() == "SCD kind 0x05 tid=0 0x0000:0"
    for number, text in ERROR_TEXTS.items():
        assert SCD(err=text).err == number
        assert f"err       = {text} ({number})\n" in shown(SCD(err=number))
    assert "err       = 17\n" in shown(SCD(err=17))


@pytest.mark.parametrize("octets", OCTETS, ids=[row[1] for row in WIRE])
def test_wire_examples_survive_and_are_built_without_size_and_crc(octets: bytes) -> None:
    blank = forget(survives(SCD, octets))
    assert blank.payload == NoPayload()
    blank.delfieldval("size")
    blank.delfieldval("crc")
    assert bytes(blank) == octets


def test_what_is_set_is_sent() -> None:
    assert bytes(SCD(size=3, crc=0x1234, data=b"a", protocol=0))[8:] == b"\x03\x00a\x34\x12"
    assert bytes(SCD())[0] == 0xDC
    with pytest.raises(ValueError, match="size would be 65536"):
        bytes(SCD(data=bytes(65536)))


# With a dictionary


@pytest.mark.parametrize(("octets", "summary", "values"), WIRE, ids=[row[1] for row in WIRE])
def test_names_and_values(od: Dictionary, octets: str, summary: str, values: dict[str, Any]) -> None:
    packet = survives(SCD.using(od), bytes.fromhex(octets))
    assert packet.summary() == summary
    assert packet.values == values
    assert same(packet.message, Codec(od).parse_message(bytes.fromhex(octets)))
    for name, value in values.items():
        assert name in shown(packet)
        assert str(value) in shown(packet)
    bare = SCD(bytes.fromhex(octets))
    assert (bare.values, bare.message) == ({}, None)


def test_without_a_dictionary_octets_are_told() -> None:
    assert [SCD(octets).summary() for octets in (READ, ANSWER, PUSH)] == [
        "SCD read tid=7 0x6041:0",
        "SCD read response tid=7 0x6041:0 data=3702",
        "SCD pdo tid=42 T1 data=370218fcffff08",
    ]
    assert SCD(kind="pdo", data=bytes(17)).summary() == "SCD pdo tid=0 0x0000 data=17 bytes"


def test_building_by_name_gives_the_octets_of_the_reference(od: Dictionary) -> None:
    assert [bytes(packet) for packet in built(od)] == OCTETS
    assert [bytes(packet) for packet in built(od)] == OCTETS  # building changes nothing
    read = SCD.read(Codec(od), (0x6041, 0), tid=7)
    assert bytes(read) == READ
    assert bytes(read.respond(data=b"\x37\x02")) == ANSWER
    assert bytes(read.refuse("no such object")) == ABORT
    assert bytes(SCD(READ).refuse("no such object")) == ABORT


@given(
    st.sampled_from(("read", "write")),
    st.sampled_from(("request", "response", "abort")),
    st.integers(0, 255),
    st.integers(-128, 127),
    st.integers(0, 255),
    st.integers(0, 65535),
)
def test_the_codec_builds_the_same(service: Any, phase: Any, tid: int, err: int, port: int, value: int) -> None:
    codec = CODEC
    request = SCD.read(codec, "v6041") if service == "read" else SCD.write(codec, "v6041", value)
    request.tid, request.port = tid, port
    carries = phase == ("response" if service == "read" else "request")
    values: dict[Any, Any] = {(0x6041, 0): value} if carries else {}
    if phase == "request":
        packet, err = request, 0
    elif phase == "response":
        packet = request.respond(value if carries else None, err=err)
    else:
        packet = request.refuse(err)
    message = Message(service=service, phase=phase, tid=tid, err=err, index=0x6041, port=port, values=values)
    octets = codec.encode_message(message)
    assert bytes(packet) == octets
    assert same(SCD.using(codec)(octets).message, codec.parse_message(octets))


CODEC: Final = plant()


@given(st.integers(0, 65535), st.integers(-(1 << 31), (1 << 31) - 1), st.integers(-128, 127), st.integers(0, 255))
def test_pdos_go_round(word: int, long: int, short: int, tid: int) -> None:
    values: dict[Any, Any] = {"v6041": word, "v6042": long, "v6043": short}
    packet = SCD.pdo(CODEC, "T1", values, tid=tid)
    octets = CODEC.encode_message(Message(service="pdo", phase="push", pdo="T1", tid=tid, values={**values}))
    assert bytes(packet) == octets
    again = SCD.using(CODEC)(octets)
    assert again.values == values
    assert bytes(SCD.pdo(CODEC, "T1", again.values, tid=tid)) == octets
    assert again == packet.__class__(bytes(packet))


def test_defaults_stand_in_when_asked(od: Dictionary) -> None:
    packet = SCD.pdo(od, "Состояние 2", {"Режим 2": 8}, partial=True)
    assert packet.values == {"Слово состояния 2": 0x0237, "Расход 2": 0, "Режим 2": 8}
    with pytest.raises(Error) as error:
        SCD.pdo(od, "T1", {"Режим 1": 8})
    assert error.value.code == E_COUNT


def test_what_the_dictionary_does_not_have_is_an_error(od: Dictionary) -> None:
    for make, code in (
        (lambda: SCD.read(od, "Насос 9"), E_INDEX),
        (lambda: SCD.write(od, "Режим 1", 128), E_RANGE),
        (lambda: SCD.read(od, "Режим 1").respond(-129), E_RANGE),
    ):
        with pytest.raises(Error) as error:
            make()
        assert error.value.code == code


@pytest.mark.parametrize("field", [{"tid": 300}, {"data": bytes(65536)}, {"size": -1}, {"err": 200, "crc": 0}])
def test_what_cannot_be_sent_is_shown_all_the_same(od: Dictionary, field: dict[str, Any]) -> None:
    for layer in (SCD, SCD.using(od)):
        packet = layer(**{"index": 0x6041, **field})
        packet.summary()
        shown(packet)
        repr(packet)
        with pytest.raises((ValueError, struct.error)):
            bytes(packet)


def test_only_requests_have_answers(od: Dictionary) -> None:
    for packet in (SCD(ANSWER), SCD(ABORT), SCD(PUSH)):
        for answer in (packet.respond, packet.refuse):
            with pytest.raises(ValueError, match="only a request"):
                answer()
    for packet in (SCD(READ), SCD.using(od)(WRITE)):
        with pytest.raises(ValueError, match="give data="):
            packet.respond(1)


def test_values_are_told_for_people(od: Dictionary) -> None:
    def told(name: str, value: object) -> str:
        return SCD.write(od, name, value).summary().partition(name)[2]

    assert told("Давление 1", 0x123) == " = 145.5 кПа"
    assert told("Насос 2.speed", -1500) == " = -1500 об/мин"
    assert told("Имя станции", "a = \x1b[31m") == ' = "a = \\x1b[31m"'
    assert told("Журнал", b"\x01\x02") == " = 0102"
    assert told("Журнал", bytes(70)) == " = 70 bytes"
    assert told("Последняя авария.code", 2) == " = перегрев (2)"
    assert told("Последняя авария.time", (0, 5)) == " = 1970-01-01T00:00:00.000000005Z"


def test_class_and_type_of_an_object_go_by_address(od: Dictionary) -> None:
    packet = SCD.using(od)(bytes(SCD(kind="read", response=1, index=0x6000, sub=255, data=b"\x09\x40\0\0")))
    assert packet.values == {"0x6000:255": 0x4009}
    assert packet.summary() == "SCD read response tid=0 0x6000:255 = 16393"


def test_a_summary_tells_eight_values() -> None:
    lines = "".join(f'[[object]]\nindex = {0x6000 + at}\nname = "v{at}"\ntype = "bool"\n' for at in range(9))
    od = made(f'{lines}[[pdo]]\ndir = "T"\nnumber = 1\nmap = {[f"v{at}" for at in range(9)]}\n')
    packet = SCD.pdo(od, "T1", {f"v{at}": False for at in range(9)})
    assert packet.summary().endswith("v6 = False, v7 = False, … (9 values)")
    assert "v8 = False" in shown(packet)


def test_the_dictionary_has_texts_for_errors_of_its_own() -> None:
    od = made('[errors]\n"-5" = "нет такого"\n')
    assert SCD.using(od)(ABORT).summary().endswith(": нет такого (-5)")
    assert "err       = нет такого (-5)" in shown(SCD.using(od)(ABORT))


def test_what_is_wrong_is_told(od: Dictionary) -> None:
    layer = SCD.using(od)
    damaged = layer(ANSWER[:-1] + b"\x31")
    assert (code(damaged), damaged.values) == (E_CRC, {})
    assert "crc       = 0x311f (wrong: 0x301f computed)" in shown(damaged)
    assert "crc       = 0x301f\n" in shown(layer(ANSWER))
    assert "E_CRC" in damaged.summary()
    strange = layer(bytes(SCD(kind=5, data=b"\x01")))
    assert code(strange) == E_KIND
    assert "data      = 01 (E_KIND: " in shown(strange)
    cut = layer(ANSWER[:11])
    assert code(cut) == E_SHORT
    assert "E_SHORT" in cut.summary()


def test_a_dictionary_with_an_envelope_of_its_own_is_refused() -> None:
    with pytest.raises(Error, match="its own envelope"):
        SCD.using(dictionary(envelope=REFERENCE))
    assert SCD.using(dictionary(envelope=DEFAULT))(READ).tid == 7


def test_a_changed_message_counts_again(od: Dictionary) -> None:
    packet = SCD.using(od)(ANSWER)
    packet.tid = 9
    assert code(packet) == E_CRC
    del packet.crc
    assert packet.values == {"Слово состояния 1": 567}
    assert packet.copy().values == packet.values
    assert (IP() / UDP() / packet)[SCD].values == packet.values


# Cut, several, followed by something else


@pytest.mark.parametrize("octets", OCTETS, ids=[row[1] for row in WIRE])
def test_every_cut_survives(od: Dictionary, octets: bytes) -> None:
    for size in range(1, len(octets)):
        packet = survives(SCD.using(od), octets[:size])
        assert isinstance(packet, SCD) == (size >= 10)
        if isinstance(packet, SCD):
            data = len(octets) - 12
            assert packet.data == octets[10:size][:data]
            assert packet.crc == octets[10 + data : size]
            assert "(cut)" in shown(packet)
        on_port = bind_scd(5000, dictionary=od)
        assert datagram(octets[:size]).payload.__class__ is (on_port if size >= 10 else Raw)
        assert type(segment(octets[:size]).payload) is Raw


def test_a_datagram_of_several_messages_is_a_chain(od: Dictionary) -> None:
    bind_scd(5000, dictionary=od)
    packet: Any = datagram(ANSWER + PUSH + WRITE + b"rest")
    assert packet.getlayer(SCD, 1).values == {"Слово состояния 1": 567}
    assert packet.getlayer(SCD, 2).values["Расход 1"] == -1000
    assert packet.getlayer(SCD, 3).values == {"Насос 1.run": True}
    assert type(packet.lastlayer()) is Raw
    assert packet.lastlayer().load == b"rest"
    assert packet.summary() == "UDP / " + " / ".join([WIRE[1][1], WIRE[5][1], WIRE[3][1]]) + " / Raw"
    packet.clear_cache()
    assert bytes(packet)[8:] == ANSWER + PUSH + WRITE + b"rest"
    assert type(datagram(ANSWER + PUSH[:-1])[SCD].payload) is type(packet[SCD])
    assert datagram(ANSWER + b"\xdc" + bytes(8))[SCD].payload == Raw(b"\xdc" + bytes(8))


def test_under_tcp_only_whole_messages_are_layers() -> None:
    bind_scd(5000, "tcp")
    packet = segment(ANSWER + PUSH[:-1])
    assert bytes(packet[SCD])[: len(ANSWER)] == ANSWER
    assert packet[SCD].payload == Raw(PUSH[:-1])
    assert type(segment(PUSH[:-1]).payload) is Raw
    assert datagram(ANSWER + PUSH[:-1]).payload == Raw(ANSWER + PUSH[:-1])


def test_a_long_chain_ends_in_octets() -> None:
    for count in (CHAIN_LIMIT, CHAIN_LIMIT + 1, 5000):
        packet = survives(SCD, READ * count)
        chain = [layer for layer in packet.iterpayloads() if isinstance(layer, SCD)]
        assert len(chain) == CHAIN_LIMIT
        assert bytes(packet.lastlayer())[: len(READ)] == READ
        assert (type(packet.lastlayer()) is Raw) == (count > CHAIN_LIMIT)


def mutated() -> st.SearchStrategy[bytes]:
    """Wire examples one after the other, with octets changed and cut off; and any octets."""
    units = st.lists(st.sampled_from(OCTETS), min_size=1, max_size=4).map(b"".join)
    changes = st.lists(st.tuples(st.integers(0, 60), st.integers(0, 255)), max_size=3)
    return st.one_of(st.binary(min_size=1), st.builds(_mutate, units, changes, st.integers(1, 80)))


def _mutate(octets: bytes, changes: list[tuple[int, int]], cut: int) -> bytes:
    changed = bytearray(octets)
    for at, value in changes:
        changed[at % len(changed)] = value
    return bytes(changed[:cut])


@given(mutated())
def test_anything_survives(octets: bytes) -> None:
    survives(SCD, octets)
    survives(SCD.using(PUMPS), octets)
    bind_scd(5000, dictionary=PUMPS)
    bind_scd(5000, "tcp", PUMPS)
    for packet in (datagram(octets), segment(octets)):
        packet.summary()
        shown(packet)
        packet.clear_cache()
        assert bytes(packet).endswith(octets)


PUMPS: Final = load(PLANT)


@given(
    st.integers(0, 63), st.integers(0, 3), st.integers(0, 255), st.integers(0, 65535), st.integers(0, 255),
    st.binary(max_size=40),
)  # fmt: skip
def test_any_message_with_a_right_checksum_survives(
    kind: int, flags: int, tid: int, index: int, sub: int, data: bytes
) -> None:
    numbers: dict[str, Any] = {
        "kind": kind,
        "abort": flags & 1,
        "response": flags >> 1,
        "tid": tid,
        "index": index,
        "sub": sub,
    }
    octets = ENVELOPE.build(numbers, data)
    packet = survives(SCD.using(PUMPS), octets)
    assert {role: packet.getfieldval(role) for role in numbers} == numbers
    assert same(packet.message, Codec(PUMPS).parse_message(octets))
    assert len(packet.values) == len(packet.message.values)
    assert bytes(SCD(**numbers, data=data)) == octets


# Ports


def test_nothing_is_bound_until_asked_and_after_it_is_undone(od: Dictionary) -> None:
    assert SCD not in datagram(READ)
    before = UDP.payload_guess, TCP.payload_guess
    layer = bind_scd(5000, dictionary=od)
    assert issubclass(layer, SCD)
    assert layer is SCD.using(od)
    for packet in (datagram(READ), datagram(READ, 5000, 40000)):
        assert type(packet[SCD]) is layer
    assert SCD not in segment(READ)
    bind_scd(5000, "tcp")
    assert type(segment(READ)[SCD]) is SCD
    unbind_scd(5000, "tcp")
    assert SCD not in segment(READ)
    assert SCD in datagram(READ)
    bind_scd(5000, "tcp")
    unbind_scd(5000)
    unbind_scd(5000)
    assert (UDP.payload_guess, TCP.payload_guess) == before


def test_dictionaries_on_different_ports_do_not_mix(od: Dictionary) -> None:
    other = made('[[object]]\nindex = 0x6041\nname = "Счётчик"\ntype = "int16"\n')
    bind_scd(5000, dictionary=od)
    bind_scd(5001, dictionary=Codec(other))
    bind_scd(5002)
    named = [datagram(ANSWER, 40000, port)[SCD].values for port in (5000, 5001, 5002)]
    assert named == [{"Слово состояния 1": 567}, {"Счётчик": 567}, {}]
    bind_scd(5000, dictionary=other)
    assert datagram(ANSWER)[SCD].values == {"Счётчик": 567}
    unbind_scd(5001)
    assert SCD not in datagram(ANSWER, 40000, 5001)
    assert SCD in datagram(ANSWER, 40000, 5002)


def test_a_port_that_scapy_gives_to_another_layer(od: Dictionary) -> None:
    taken = next(values["dport"] for values, _ in UDP.payload_guess if list(values) == ["dport"])
    before = type(datagram(READ, 40000, taken).payload)
    bind_scd(taken, dictionary=od)
    assert datagram(READ, 40000, taken)[SCD].tid == 7
    unbind_scd(taken)
    assert type(datagram(READ, 40000, taken).payload) is before


def test_a_file_may_be_named(od: Dictionary, tmp_path: Path) -> None:
    od.save(tmp_path / "plant.scd")
    for path in (PLANT, str(PLANT), tmp_path / "plant.scd"):
        bind_scd(5000, dictionary=path)
        assert datagram(ANSWER)[SCD].values == {"Слово состояния 1": 567}
    with pytest.raises(OSError, match="nowhere"):
        bind_scd(5000, dictionary=tmp_path / "nowhere.scd")
    assert datagram(ANSWER)[SCD].values  # the last one stays


@pytest.mark.parametrize("port", [0, -1, 65536])
def test_no_port(port: int) -> None:
    with pytest.raises(ValueError, match="is not a port: give one of 1 to 65535"):
        bind_scd(port)


def test_no_transport() -> None:
    with pytest.raises(ValueError, match="udp, tcp"):
        bind_scd(5000, "sctp")
    with pytest.raises(ValueError, match="udp, tcp"):
        unbind_scd(5000, "sctp")


# Requests and answers


def test_answers_have_kind_tid_index_and_sub_of_their_request() -> None:
    read, write = SCD(READ), SCD(WRITE)
    assert SCD(ANSWER).answers(read)
    assert SCD(ABORT).answers(read)
    assert SCD(ACK).answers(write)
    assert [SCD(octets).hashret() == read.hashret() for octets in (ANSWER, ABORT, ACK)] == [True, True, False]
    assert not read.answers(SCD(ANSWER))
    assert not read.answers(read)
    assert not SCD(ABORT).answers(SCD(ANSWER))
    assert not SCD(PUSH).answers(SCD(PUSH))
    assert not SCD(ANSWER).answers(Raw(READ))
    for field, value in (("tid", 8), ("index", 0x6042), ("sub", 1), ("kind", "write")):
        other = SCD(ANSWER)
        setattr(other, field, value)
        assert not other.answers(read), field
    assert not SCD(kind="pdo", response=1).answers(SCD(kind="pdo"))


def test_datagrams_pair(od: Dictionary) -> None:
    bind_scd(5000, dictionary=od)
    asked = IP(src="10.0.0.1", dst="10.0.0.2") / UDP(sport=40000, dport=5000) / SCD.read(od, "Режим 1", tid=3)
    told = IP(src="10.0.0.2", dst="10.0.0.1") / UDP(sport=5000, dport=40000) / asked[SCD].respond(8)
    heard = IP(bytes(told))
    assert heard.answers(asked)
    assert heard.hashret() == asked.hashret()
    assert heard[SCD].values == {"Режим 1": 8}


def test_a_stream_socket_cuts_messages_and_finds_the_answer(od: Dictionary) -> None:
    ours, theirs = socket.socketpair()
    theirs.sendall(PUSH + ACK + ANSWER[:5])
    stream: Any = StreamSocket(ours, SCD.using(od))
    try:
        assert bytes(stream.recv()) == PUSH
        theirs.sendall(ANSWER[5:])
        found = stream.sr1(SCD.read(od, "Слово состояния 1", tid=7), timeout=5, verbose=False)
        assert found.values == {"Слово состояния 1": 567}
        assert theirs.recv(100) == READ
    finally:
        stream.close()
        theirs.close()


def test_what_begins_no_message_ends_the_cutting() -> None:
    assert SCD.tcp_reassemble(b"", {}, {}) is None
    assert SCD.tcp_reassemble(ANSWER[:-1], {}, {}) is None
    whole = SCD.tcp_reassemble(ANSWER + READ, {}, {})
    assert whole is not None
    assert bytes(whole[SCD]) == ANSWER + READ
    assert SCD.tcp_reassemble(b"GET /", {}, {}) == Raw(b"GET /")


def test_scapys_tcp_session_cuts_messages(od: Dictionary, tmp_path: Path) -> None:
    bind_scd(5000, "tcp", od)
    octets = PUSH + ANSWER + READ
    lower = Ether(src="02:00:00:00:00:01", dst="02:00:00:00:00:02") / IP(src="10.0.0.1", dst="10.0.0.2")
    path = str(tmp_path / "talk.pcap")
    cuts = [0, 7, 19, 40, len(octets)]
    wrpcap(
        path,
        [
            lower / TCP(sport=40000, dport=5000, flags="A", seq=100 + begin) / Raw(octets[begin:end])
            for begin, end in pairwise(cuts)
        ],
    )
    found = [layer for packet in sniff(offline=path, session=TCPSession) for layer in packet.iterpayloads()]
    messages = [layer for layer in found if isinstance(layer, SCD)]
    assert [message.message and message.message.service for message in messages] == ["pdo", "read", "read"]
    assert messages[1].values == {"Слово состояния 1": 567}
