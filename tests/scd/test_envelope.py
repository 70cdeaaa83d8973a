from __future__ import annotations

import sys
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.scd.envelope import Envelope
from dissect.scd.envelope_rules import check_envelope
from dissect.scd.errors import Error
from dissect.scd.messages import Message
from dissect.scd.records import CrcRecord, EnvelopeField, EnvelopeRecord
from tests.scd.making import REFERENCE, WIRE, plant


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


def test_reserved_bits_are_sent_as_described_and_not_looked_at() -> None:
    fields = [EnvelopeField("reserved", 3, value=5), EnvelopeField("tid", 5), EnvelopeField("data")]
    envelope = Envelope(EnvelopeRecord(fields, []))
    assert envelope.build({"tid": 1}, b"A") == b"\x0dA"
    found = envelope.parse(b"\x0aA")
    assert (found.numbers, found.error) == ({"tid": 1}, None)


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
    assert sizes == [12, 14, 12, 12, 19, 13]


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


ROLES = [
    "protocol",
    "kind",
    "response",
    "abort",
    "tid",
    "seq",
    "err",
    "index",
    "sub",
    "pdo",
    "port",
    "src",
    "dst",
    "size",
    "crc",
]


@st.composite
def described(draw: st.DrawFn) -> EnvelopeRecord:
    """An envelope by the rules of a dictionary: any roles in any order, bits filled up around the data."""
    fields: list[EnvelopeField] = []
    roles: list[Any] = draw(st.permutations(draw(st.lists(st.sampled_from(ROLES), unique=True, max_size=8))))
    at = 0
    before = draw(st.integers(0, len(roles)))
    for number in range(len(roles) + 1):
        role: Any = roles[number] if number < len(roles) else ""
        big = draw(st.booleans()) or role in {"crc", "size"}
        if at % 8 and (number == before or number == len(roles) or big):
            fields.append(EnvelopeField("reserved", -at % 8, value=draw(st.sampled_from([None, 1]))))
            at += -at % 8
        if number == before:
            fields.append(EnvelopeField("data"))
        if not role or (role == "size" and number >= before):
            continue
        if role == "crc":
            fields.append(EnvelopeField(role, 16, big=draw(st.booleans())))
        elif role == "size":
            counts: Any = draw(st.sampled_from(["data", "data+crc", "rest", "total"]))
            fields.append(
                EnvelopeField(role, draw(st.sampled_from([8, 16, 32])), big=draw(st.booleans()), counts=counts)
            )
        elif role in {"response", "abort"}:
            fields.append(EnvelopeField(role, 1))
        else:
            bits = 8 * draw(st.integers(1, 4)) if big else draw(st.integers(1, 40))
            value = draw(st.integers(0, (1 << bits) - 1)) if role == "protocol" else None
            fields.append(EnvelopeField(role, bits, signed=role == "err" and draw(st.booleans()), big=big, value=value))
        at += fields[-1].bits
    crc = CrcRecord(init=draw(st.sampled_from([0, 0xFFFF])), covers=draw(st.sampled_from(["before", "data"])))
    kinds: Any = [(1, "read")] if "kind" in roles else []
    return EnvelopeRecord(fields, kinds, crc if "crc" in roles else None)


@pytest.mark.parametrize(
    "fields",
    [
        [EnvelopeField("data"), EnvelopeField("size", 16, counts="data")],
        [EnvelopeField("size", 4, counts="rest"), EnvelopeField("tid", 4), EnvelopeField("data")],
    ],
)
def test_what_no_envelope_can_do_no_dictionary_may_describe(fields: list[EnvelopeField]) -> None:
    with pytest.raises(Error) as error:
        check_envelope(EnvelopeRecord(fields, []))
    assert error.value.code == "E_DICTIONARY"


@given(described(), st.data())
def test_parse_after_build_is_the_same_for_any_description(record: EnvelopeRecord, data: st.DataObject) -> None:
    check_envelope(record)
    envelope = Envelope(record)
    numbers: dict[str, int] = {}
    for field in record.fields:
        if field.role in {"data", "crc", "size", "reserved"}:
            continue
        low, high = (-(1 << field.bits - 1), (1 << field.bits - 1) - 1) if field.signed else (0, (1 << field.bits) - 1)
        numbers[field.role] = data.draw(st.integers(low, high)) if field.value is None else field.value
    content = data.draw(st.binary(max_size=100))
    octets = envelope.build(numbers, content)
    assert envelope.parse(octets) == (numbers, content, len(octets), None)
    if envelope.framed:
        assert envelope.parse(octets + b"more") == (numbers, content, len(octets), None)
        assert envelope.frame_size(octets) == len(octets)
        for size in range(len(octets)):
            short = envelope.parse(octets[:size]).error
            assert short is not None
            assert short.code == "E_SHORT"
