from __future__ import annotations

import sys
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.scd.codec import Codec
from dissect.scd.envelope import Envelope
from dissect.scd.errors import Error
from dissect.scd.mapping import Entry
from dissect.scd.messages import Message
from dissect.scd.packing import Key
from dissect.scd.records import CrcRecord, EnvelopeField, EnvelopeRecord, ObjectRecord, StructRecord
from dissect.scd.types import Value
from tests.scd import making
from tests.scd.making import BOOL, INT8, INT16, INT32, STRING, UINT8, UINT16


def plant(envelope: EnvelopeRecord | None = None, *, access: str = "rw") -> Codec:
    """6000h:00 Boolean, 6041h:00 uint16, a constant, and T1 of the reference's §2: u16, i32, i8."""
    objects = [
        making.variable(0x6000, BOOL, access=access),
        making.variable(0x6041, UINT16, access=access),
        making.variable(0x6042, INT32),
        making.variable(0x6043, INT8),
        making.variable(0x6044, STRING, 64),
        making.variable(0x6045, UINT8, access="const"),
        making.variable(0x6046, UINT8, access="wo"),
        making.mapping(0x1A00, "T1 map", [Entry(0x6041, 0, 0, 16), Entry(0x6042, 0, 16, 32), Entry(0x6043, 0, 48, 8)]),
        making.mapping(0x1641, "R66 map", [Entry(0x6000, 0, 0, 1)] if access == "rw" else []),
    ]
    return Codec(making.dictionary(objects, envelope=envelope))


#: Reference §3.3, to the octet; the write goes to 6000h:00, as this plant's Boolean is a VAR.
WIRE: list[tuple[str, str, dict[str, Any]]] = [
    ("DC 02 07 00 41 60 00 00 00 00 D5 D2", "read request", {"tid": 7, "index": 0x6041}),
    ("DC 82 07 00 41 60 00 00 02 00 37 02 1F 30", "read response",
     {"tid": 7, "index": 0x6041, "values": {(0x6041, 0): 0x0237}}),
    ("DC C2 07 FB 41 60 00 00 00 00 09 56", "read abort", {"tid": 7, "index": 0x6041, "err": -5}),
    ("DC 81 08 00 00 60 01 00 00 00 E5 C0", "write response", {"tid": 8, "index": 0x6000, "sub": 1}),
    ("DC 10 2A 00 00 1A 00 00 07 00 37 02 18 FC FF FF 08 BB 4D", "pdo push",
     {"tid": 42, "index": 0x1A00, "pdo": "T1", "values": {(0x6041, 0): 0x0237, (0x6042, 0): -1000, (0x6043, 0): 8}}),
]  # fmt: skip
WRITE = bytes.fromhex("DC 01 08 00 00 60 01 00 01 00 01 69 FF")


@pytest.mark.parametrize(("octets", "what", "wanted"), WIRE, ids=[row[1] for row in WIRE])
def test_wire_examples(octets: str, what: str, wanted: dict[str, Any]) -> None:
    pump = making.field("run", BOOL), making.field("on", BOOL)
    codec = plant() if wanted["index"] != 0x6000 else record_plant(list(pump))
    whole = bytes.fromhex(octets)
    message = codec.decode_message(whole)
    assert f"{message.service} {message.phase}" == what
    assert message.size == len(whole)
    assert message.flags == {}
    default = Message()
    for name in ("tid", "err", "index", "sub", "port", "pdo", "values"):
        assert getattr(message, name) == wanted.get(name, getattr(default, name)), name
    again = Message(service=message.service, phase=message.phase, **wanted)
    assert codec.encode_message(again) == whole


def record_plant(fields: list[Any]) -> Codec:
    struct = StructRecord(0x40, "pump_t", fields)
    return Codec(making.dictionary([ObjectRecord(0x6000, 9, "pump", 0x40, 0, "rw", False, True)], [struct]))


def test_wire_example_of_a_write() -> None:
    codec = record_plant([making.field("run", BOOL), making.field("", 0, 7)])
    objects = codec.objects()
    message = codec.decode_message(WRITE, objects)
    assert (message.service, message.phase, message.tid, message.values) == ("write", "request", 8, {(0x6000, 1): True})
    assert objects["pump.run"] is True
    assert objects.changed == ((0x6000, 1),)
    wanted = Message(service="write", phase="request", tid=8, index=0x6000, sub=1, values={(0x6000, 1): True})
    assert codec.encode_message(wanted) == WRITE


def test_every_cut_of_every_example_is_short_and_a_tail_is_flagged() -> None:
    codec = plant()
    for row in WIRE:
        whole = bytes.fromhex(row[0])
        for size in range(len(whole)):
            message = codec.parse_message(whole[:size])
            assert message.error is not None
            assert message.error.code == "E_SHORT"
            assert message.size == 0
        if row[2]["index"] != 0x6000:
            message = codec.decode_message(whole + b"\x00")
            assert message.size == len(whole)
            assert message.flags == {"trailing": ()}


def test_a_unit_of_several_messages() -> None:
    codec = plant()
    one, two = bytes.fromhex(WIRE[0][0]), bytes.fromhex(WIRE[4][0])
    found = list(codec.parse_messages(one + two + one[:5]))
    assert [(message.service, message.size) for message in found] == [("read", 12), ("pdo", 19), ("", 0)]
    assert found[2].error is not None
    assert list(codec.parse_messages(b"")) == []


@pytest.mark.parametrize(
    ("at", "octet", "wanted"),
    [(0, 0xDD, "E_PROTOCOL"), (2, 0x08, "E_CRC"), (10, 0x38, "E_CRC"), (13, 0x31, "E_CRC"), (1, 0x42, "E_CRC")],
)
def test_damage_is_told_and_header_and_data_are_still_shown(at: int, octet: int, wanted: str) -> None:
    octets = bytearray.fromhex(WIRE[1][0])
    octets[at] = octet
    codec = plant()
    message = codec.parse_message(octets)
    assert message.error is not None
    assert (message.error.code, message.index, message.size) == (wanted, 0x6041, 14)
    assert message.data == bytes(octets[10:12])
    assert message.values == {}
    objects = codec.objects()
    with pytest.raises(Error) as error:
        codec.decode_message(octets, objects)
    assert error.value.code == wanted
    assert len(objects) == 0


VALID = {0x01, 0x81, 0xC1, 0x02, 0x82, 0xC2, 0x10}


def test_only_seven_kinds_are_valid() -> None:
    codec = plant()
    for kind in range(256):
        numbers = {"kind": kind & 0x3F, "abort": kind >> 6 & 1, "response": kind >> 7, "index": 0x6041}
        data = bytes(2) if kind in {0x82, 0x01} else b""
        if kind == 0x10:
            numbers["index"], data = 0x1A00, bytes(7)
        message = codec.parse_message(codec.envelope.build(numbers, data))
        assert (message.error is None) == (kind in VALID), hex(kind)
        if message.error is not None:
            assert message.error.code == "E_KIND"


def sent(codec: Codec, kind: int, index: int, data: bytes = b"", **more: int) -> Message:
    numbers = {"kind": kind & 0x3F, "abort": kind >> 6 & 1, "response": kind >> 7, "index": index, **more}
    return codec.parse_message(codec.envelope.build(numbers, data))


def test_r74_access_that_is_not_allowed_is_flagged() -> None:
    codec = plant()
    assert sent(codec, 0x02, 0x6046).flags == {"access": ((0x6046, 0),)}
    assert sent(codec, 0x82, 0x6046, b"\x01").flags == {"access": ((0x6046, 0),)}
    assert sent(codec, 0x01, 0x6046, b"\x01").flags == {}
    write = sent(codec, 0x01, 0x6045, b"\x01")
    assert (write.flags, write.values) == ({"access": ((0x6045, 0),)}, {(0x6045, 0): 1})
    assert sent(codec, 0x02, 0x6045).flags == {}


@pytest.mark.parametrize("index", [0x0000, 0x0001, 0x001F, 0x0060, 0x0260, 0x0401, 0xC000, 0xFFFF])
def test_r87_types_and_reserved_indices_cannot_be_addressed(index: int) -> None:
    message = sent(plant(), 0x02, index)
    assert message.error is not None
    assert message.error.code == "E_INDEX"
    assert message.flags == {"access": ((index, 0),)}


@pytest.mark.parametrize(
    ("kind", "index", "data", "more", "wanted"),
    [
        (0x02, 0x6100, b"", {}, "E_INDEX"),
        (0x02, 0x6041, b"", {"sub": 1}, "E_SUB"),
        (0x82, 0x6041, b"\x01", {}, "E_SHORT"),
        (0x82, 0x6041, b"\x01\x02\x03", {}, "E_LONG"),
        (0x82, 0x6044, b"\xff", {}, "E_UTF8"),
        (0x82, 0x6044, b"123456789", {}, "E_LENGTH"),
        (0x10, 0x1A00, b"\x01", {}, "E_SHORT"),
        (0x10, 0x1A01, b"\x01", {}, "E_PDO_NUMBER"),
        (0x10, 0x6041, b"\x01", {}, "E_PDO_NUMBER"),
    ],
)
def test_messages_that_do_not_fit_the_dictionary(
    kind: int, index: int, data: bytes, more: dict[str, int], wanted: str
) -> None:
    message = sent(plant(), kind, index, data, **more)
    assert message.error is not None
    assert message.error.code == wanted
    assert (message.data, message.values) == (data, {})


def test_answers_without_a_value() -> None:
    codec = plant()
    abort = sent(codec, 0xC2, 0x6100, err=-5)  # that there is no such object is what it says
    assert (abort.phase, abort.err, abort.error) == ("abort", -5, None)
    failed = sent(codec, 0x82, 0x6041, err=-1)
    assert (failed.phase, failed.values, failed.error) == ("response", {}, None)
    assert sent(codec, 0x82, 0x6041, b"\x01\x00", err=5).values == {(0x6041, 0): 1}
    assert sent(codec, 0x02, 0x6041, b"\x01").flags == {"trailing": ()}
    assert sent(codec, 0x10, 0x1A00, bytes(8)).flags == {"trailing": ()}


def test_r95_r107_the_mapping_index_gives_direction_and_number() -> None:
    message = sent(plant(), 0x10, 0x1641, b"\x01")
    assert (message.pdo, message.values) == ("R66", {(0x6000, 0): True})


def test_messages_that_cannot_be_built() -> None:
    codec = plant()
    value: dict[Key, Value] = {(0x6041, 0): 1}
    wrong = [
        (Message(service="pdo", phase="request"), "E_KIND"),
        (Message(service="read", phase="push"), "E_KIND"),
        (Message(service="", phase="request"), "E_KIND"),
        (Message(service="read", phase="response", index=0x6041), "E_COUNT"),
        (Message(service="read", phase="request", index=0x6041, values=value), "E_COUNT"),
        (Message(service="write", phase="request", index=0x6042, values=value), "E_VALUE"),
        (Message(service="read", phase="request", index=0x6041, tid=256), "E_RANGE"),
        (Message(service="read", phase="request", index=0x6041, err=-129), "E_RANGE"),
        (Message(service="read", phase="request", index=0x6041, src=1), "E_VALUE"),
        (Message(service="pdo", phase="push"), "E_PDO_NUMBER"),
        (Message(service="pdo", phase="push", pdo="T1"), "E_COUNT"),
        (Message(service="write", phase="request", index=0x6041, data=bytes(65536)), "E_LENGTH"),
    ]
    for message, wanted in wrong:
        with pytest.raises(Error) as error:
            codec.encode_message(message)
        assert error.value.code == wanted, message


# Envelopes of others

#: The example of the reference's §3.3.
REFERENCE = EnvelopeRecord(
    fields=[
        EnvelopeField("src", 8), EnvelopeField("dst", 8),
        EnvelopeField("kind", 6), EnvelopeField("response", 1), EnvelopeField("abort", 1),
        EnvelopeField("size", 16, counts="rest"),
        EnvelopeField("index", 16, big=True), EnvelopeField("sub", 8),
        EnvelopeField("err", 8, signed=True), EnvelopeField("data"), EnvelopeField("crc", 16),
    ],
    kinds=[(1, "write"), (2, "read"), (16, "pdo")],
    crc=CrcRecord(init=0xFFFF),
)  # fmt: skip


def test_a_described_envelope_to_the_octet() -> None:
    codec = plant(REFERENCE)
    octets = codec.encode_message(
        Message(service="read", phase="response", src=1, dst=2, index=0x6041, err=-1, values={(0x6041, 0): 0x0237})
    )
    # 2 | response at bit 6; the rest after size: 2 index, sub, err, 2 data, 2 crc
    assert octets[:-2] == bytes.fromhex("01 02 42 08 00 60 41 00 FF 37 02")
    assert int.from_bytes(octets[-2:], "little") == slow_crc(octets[:-2], 0x1021, 0xFFFF)
    message = codec.decode_message(octets)
    assert (message.src, message.dst, message.err, message.values) == (1, 2, -1, {(0x6041, 0): 0x0237})
    assert codec.envelope.frame_size(octets) == len(octets)


def slow_crc(octets: bytes, poly: int, init: int, refin: bool = False, refout: bool = False, xorout: int = 0) -> int:
    register = init
    for octet in octets:
        register ^= (int(f"{octet:08b}"[::-1], 2) if refin else octet) << 8
        for _ in range(8):
            register = (register << 1 ^ (poly if register & 0x8000 else 0)) & 0xFFFF
    return (int(f"{register:016b}"[::-1], 2) if refout else register) ^ xorout


@pytest.mark.parametrize(
    ("crc", "check"),
    [
        (CrcRecord(), 0x31C3),
        (CrcRecord(init=0xFFFF), 0x29B1),
        (CrcRecord(init=0xFFFF, xorout=0xFFFF), 0xD64E),
        (CrcRecord(poly=0x8005, init=0xFFFF, refin=True, refout=True), 0x4B37),
        (CrcRecord(poly=0x1021, init=0xFFFF, refin=True, refout=True, xorout=0xFFFF), 0x906E),
        (CrcRecord(poly=0x3D65, xorout=0xFFFF), 0xC2B7),
    ],
    ids=["XMODEM", "IBM-3740", "GENIBUS", "MODBUS", "IBM-SDLC", "EN-13757"],
)
def test_checksums_with_parameters(crc: CrcRecord, check: int) -> None:
    if crc.refin or crc.poly != 0x1021:
        pytest.importorskip("anycrc")
    record = EnvelopeRecord([EnvelopeField("data"), EnvelopeField("crc", 16)], [], crc)
    assert slow_crc(b"123456789", crc.poly, crc.init, crc.refin, crc.refout, crc.xorout) == check
    octets = Envelope(record).build({}, b"123456789")
    assert octets == b"123456789" + check.to_bytes(2, "little")
    assert Envelope(record).parse(octets).error is None


def test_a_crc_that_covers_only_the_data_and_one_before_it() -> None:
    fields = [EnvelopeField("tid", 8), EnvelopeField("crc", 16, big=True), EnvelopeField("data")]
    for covers, covered in (("data", b"AB"), ("before", b"\x07")):
        envelope = Envelope(EnvelopeRecord(fields, [], CrcRecord(covers=covers)))  # type: ignore[arg-type]
        octets = envelope.build({"tid": 7}, b"AB")
        assert octets == b"\x07" + slow_crc(covered, 0x1021, 0).to_bytes(2, "big") + b"AB"
        assert envelope.parse(octets).error is None
        damaged = envelope.parse(octets[:1] + b"\x00\x00" + octets[3:]).error
        assert damaged is not None
        assert damaged.code == "E_CRC"


def test_without_anycrc_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "anycrc", None)
    with pytest.raises(Error, match=r"pip install 's7dissect\[scd\]'"):
        Envelope(EnvelopeRecord([EnvelopeField("data"), EnvelopeField("crc", 16)], [], CrcRecord(poly=0x8005)))
    Envelope()  # the default needs nothing


@pytest.mark.parametrize(
    ("counts", "told"), [("data", 3), ("data+crc", 5), ("rest", 1 + 3 + 2 + 1), ("total", 3 + 3 + 3)]
)
def test_what_a_size_counts(counts: Any, told: int) -> None:
    fields = [
        EnvelopeField("size", 16, big=True, counts=counts), EnvelopeField("tid", 8), EnvelopeField("data"),
        EnvelopeField("crc", 16), EnvelopeField("const", 8, value=0x7E),
    ]  # fmt: skip
    envelope = Envelope(EnvelopeRecord(fields, [], CrcRecord()))
    octets = envelope.build({"tid": 9}, b"abc")
    assert int.from_bytes(octets[:2], "big") == told
    assert octets[-1] == 0x7E
    assert envelope.frame_size(octets + b"more") == len(octets) == 9
    found = envelope.parse(octets + b"more")
    assert (found.data, found.numbers, found.error) == (b"abc", {"tid": 9}, None)
    end = envelope.parse(octets[:-1] + b"\x7f").error
    assert end is not None
    assert end.code == "E_PROTOCOL"
    if counts != "data":
        size, error = envelope.frame(b"\0\0" + octets[2:])
        assert error is not None
        assert (size, error.code) == (0, "E_LENGTH")


def test_a_stream_is_cut_by_the_size_field() -> None:
    codec, envelope = plant(), Envelope()
    stream = b"".join(bytes.fromhex(row[0]) for row in WIRE)
    at, sizes = 0, []
    while at < len(stream):
        whole = envelope.frame_size(stream, at)
        for there in range(10):
            assert envelope.frame(stream[at : at + there]) == (0, None)
        assert codec.parse_message(stream, at).size == whole
        sizes.append(whole)
        at += whole
    assert sizes == [12, 14, 12, 12, 19]


def test_framing_is_bounded_and_stops_at_what_is_no_message() -> None:
    envelope = Envelope()
    with pytest.raises(Error) as error:
        envelope.frame_size(b"\x03\x00")
    assert error.value.code == "E_PROTOCOL"
    assert envelope.frame_size(b"\xdc" + bytes(7) + b"\xff\xff") == 10 + 65535 + 2
    wide = Envelope(EnvelopeRecord([EnvelopeField("size", 32, counts="data"), EnvelopeField("data")], []))
    size, found = wide.frame(b"\x00\x00\x01\x00")
    assert found is not None
    assert (size, found.code) == (0, "E_LENGTH")
    unframed = Envelope(EnvelopeRecord([EnvelopeField("tid", 8), EnvelopeField("data")], []))
    assert not unframed.framed
    with pytest.raises(Error) as error:
        unframed.frame_size(b"\x01")
    assert error.value.code == "E_DICTIONARY"
    assert unframed.parse(b"\x01\x02\x03").data == b"\x02\x03"


@pytest.mark.parametrize(
    "fields",
    [
        [EnvelopeField("tid", 8)],
        [EnvelopeField("tid", 7), EnvelopeField("data")],
        [
            EnvelopeField("abort", 1),
            EnvelopeField("index", 16, big=True),
            EnvelopeField("sub", 7),
            EnvelopeField("data"),
        ],
        [EnvelopeField("data"), EnvelopeField("size", 16, counts="data")],
        [EnvelopeField("data"), EnvelopeField("crc", 8)],
        [EnvelopeField("tid", 0), EnvelopeField("data")],
    ],
)
def test_envelopes_that_cannot_work(fields: list[EnvelopeField]) -> None:
    with pytest.raises(Error) as error:
        Envelope(EnvelopeRecord(fields, []))
    assert error.value.code == "E_DICTIONARY"


def test_an_envelope_of_pdo_numbers_without_kinds() -> None:
    record = EnvelopeRecord([EnvelopeField("seq", 32), EnvelopeField("pdo", 16, big=True), EnvelopeField("data")], [])
    codec = plant(record)
    octets = codec.encode_message(Message(service="pdo", phase="push", pdo="R66", seq=5, values={(0x6000, 0): True}))
    assert octets.hex(" ") == "05 00 00 00 00 42 01"
    message = codec.decode_message(octets)
    assert (message.service, message.phase, message.pdo, message.seq) == ("pdo", "push", "R66", 5)


@given(st.binary(max_size=60), st.integers(0, 70), st.sampled_from([None, REFERENCE]))
def test_never_raises_on_what_is_received(octets: bytes, at: int, record: EnvelopeRecord | None) -> None:
    codec = plant(record)
    codec.parse_message(octets, at)
    codec.envelope.frame(octets, at)
    for message in codec.parse_messages(octets):
        assert message.size or message.error


_CODEC = plant()


@given(
    st.sampled_from([0x01, 0x02, 0x81, 0x82, 0xC1, 0xC2, 0x10]), st.integers(-128, 127),
    st.sampled_from([0x6000, 0x6041, 0x6044, 0x1A00, 0x1641, 0x0001, 0x6045]), st.integers(0, 255), st.binary(max_size=12),
)  # fmt: skip
def test_never_raises_on_messages_with_a_right_checksum(kind: int, err: int, index: int, sub: int, data: bytes) -> None:
    message = sent(_CODEC, kind, index, data, err=err, sub=sub)
    assert (message.data, message.index, message.sub, message.err) == (data, index, sub, err)
    if message.error is None and message.values and message.phase != "abort" and not message.flags:
        # What it says, said again, says the same: the octets may differ in undefined bits only.
        again = _CODEC.decode_message(
            _CODEC.encode_message(
                Message(
                    service=message.service, phase=message.phase, index=index, sub=sub, err=err, pdo=message.pdo,
                    values=message.values,
                )
            )
        )  # fmt: skip
        assert again.values == message.values


def test_values_of_a_message_may_go_by_name() -> None:
    codec = Codec(making.dictionary([making.variable(0x6000, INT16)]))
    octets = codec.encode_message(Message(service="write", phase="request", index=0x6000, values={"v6000": -2}))
    assert octets[10:12] == b"\xfe\xff"
    assert codec.decode_message(octets).values == {(0x6000, 0): -2}
