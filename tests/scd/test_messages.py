from __future__ import annotations

from binascii import crc_hqx

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect.scd.codec import Codec
from dissect.scd.errors import Error
from dissect.scd.layout import Key
from dissect.scd.messages import MOST_HEADS, Message
from dissect.scd.records import EnvelopeField, EnvelopeRecord, FieldRecord, ObjectRecord
from dissect.scd.types import Value
from tests.scd import making
from tests.scd.making import INT16, REFERENCE, WIRE, plant


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


@pytest.mark.requirement("R74")
def test_r74_access_that_is_not_allowed_is_flagged() -> None:
    codec = plant()
    assert sent(codec, 0x02, 0x6046).flags == {"access": ((0x6046, 0),)}
    assert sent(codec, 0x82, 0x6046, b"\x01").flags == {"access": ((0x6046, 0),)}
    assert sent(codec, 0x01, 0x6046, b"\x01").flags == {}
    write = sent(codec, 0x01, 0x6045, b"\x01")
    assert (write.flags, write.values) == ({"access": ((0x6045, 0),)}, {(0x6045, 0): 1})
    assert sent(codec, 0x02, 0x6045).flags == {}


@pytest.mark.requirement("R87")
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


@pytest.mark.requirement("R95", "R107")
def test_r95_r107_the_mapping_index_gives_direction_and_number() -> None:
    message = sent(plant(), 0x10, 0x1641, b"\x01")
    assert (message.pdo, message.values) == ("R66", {(0x6000, 0): True})


def test_another_version_of_the_mapping_is_flagged() -> None:
    comm = ObjectRecord(
        0x1800, 9, "T1 comm", 0, 0, "rw", False, False,
        fields=[FieldRecord("node", making.UINT8, 0, default=0), FieldRecord("version", making.UINT8, 0, default=0x21)],
        values=[0, 0x21],
    )  # fmt: skip
    objects, mapped = making.entries([making.UINT8])
    codec = Codec(making.dictionary([comm, making.mapping(0x1A00, "T1 map", mapped), *objects]))
    assert codec.pdo("T1").version == 0x21
    assert sent(codec, 0x10, 0x1A00, b"\x01", sub=0x21).flags == {}
    assert sent(codec, 0x10, 0x1A00, b"\x01", sub=0).flags == {}
    other = sent(codec, 0x10, 0x1A00, b"\x01", sub=0x22)
    assert (other.flags, other.values) == ({"version": ()}, {(0x6000, 0): 1})


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
@example(0x01, 0, 0x6000, 0, b"\x01")
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


_WIRE_OCTETS = [bytes.fromhex(row[0]) for row in WIRE]


@given(
    st.lists(
        st.tuples(
            st.sampled_from(_WIRE_OCTETS),
            st.integers(0, 20),
            st.integers(0, 255),
            st.sampled_from(("as is", "sealed", "cut")),
        ),
        min_size=1,
        max_size=6,
    )
)
def test_what_was_read_before_changes_nothing(changes: list[tuple[bytes, int, int, str]]) -> None:
    """A header that is known is a shorter way to the same message: its number, data and checksum are looked at each time."""
    warm = plant()
    for octets in _WIRE_OCTETS:
        known = warm.parse_message(octets)
        known.numbers.clear()  # what somebody does with a message is not remembered
        known.values.clear()
        known.flags["trailing"] = ()
    for octets, at, octet, what in changes:
        damaged = bytearray(octets)
        damaged[at % len(damaged)] = octet
        if what == "sealed":
            damaged[-2:] = crc_hqx(bytes(damaged[:-2]), 0).to_bytes(2, "little")
        elif what == "cut":
            del damaged[at:]
        cold = plant()
        found, wanted = warm.parse_message(b"\x01" + damaged, 1), cold.parse_message(damaged)
        assert str(found) == str(wanted)
        assert found.numbers == wanted.numbers
    assert 0 < len(warm.heads) <= MOST_HEADS


def test_headers_that_are_remembered_are_bounded() -> None:
    codec = plant()
    for err in range(1, 3 * MOST_HEADS):
        octets = codec.encode_message(
            Message(
                service="pdo",
                phase="push",
                pdo="T1",
                tid=err & 255,
                err=err % 100,
                port=err & 255,
                values=codec.parse_message(_WIRE_OCTETS[4]).values,
            )
        )
        message = codec.parse_message(octets)
        assert (message.tid, message.err, message.port) == (err & 255, err % 100, err & 255)
    assert len(codec.heads) <= MOST_HEADS
