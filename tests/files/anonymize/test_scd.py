"""SCD made anonymous: headers, pairing and checksums stay, values as chosen, texts replaced, with a dictionary and without."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import dissect
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.transaction import Transaction
from dissect.files.anonymize import account
from dissect.files.anonymize.account import KEEP, MASK, SCRAMBLE, Account, Choices
from dissect.files.anonymize.addresses import AddressMap
from dissect.files.anonymize.scd import ScdRules, bindings_of
from dissect.meaning.bindings import load_bindings, load_carrier
from dissect.meaning.bindings.contents import decode
from dissect.meaning.bindings.engine import ScdCarrier
from dissect.packets.source.files import open_capture
from dissect.scd.codec import Codec
from dissect.scd.loading import load
from dissect.scd.messages import Message
from dissect.scd.packing import LIMITS, Flags
from dissect.scd.values import NetTime
from tests.files.anonymize.support import KEY, anonymized
from tests.meaning.report.support import ROOT, saved
from tests.packets.source.craft import Frame, drain
from tests.properties.packets import MS, Flow, Packet, Talk

PLANT = ROOT / "captures/scd/plant.pcapng"
DICTIONARY = ROOT / "captures/scd/plant.toml"
BINDINGS = ROOT / "captures/scd/plant.bind.toml"
NAME = "Насосная №1"


def carrier(bindings: Path = BINDINGS) -> ScdCarrier:
    return load_carrier(DICTIONARY, bindings)


def frames(path: Path) -> list[Frame]:
    return drain(open_capture(str(path))).frames


def fitting(directory: Path) -> Path:
    """Return the bindings as they have to be for what is written."""
    text = BINDINGS.read_text()
    for entry in bindings_of(carrier().bindings, KEY, AddressMap(KEY)):
        assert entry.keys() == {"name", "tsap"}
        text = text.replace('tsap = "SCD1"', f'tsap = "{entry["tsap"]}"')
    path = directory / "fitting.toml"
    path.write_text(text)
    return path


def _flags(found: ScdMessage) -> Flags:
    """What is flagged. Values of S7 items are scrambled octet by octet, so a content in one may leave the limits."""
    return {name: keys for name, keys in found.message.flags.items() if name != LIMITS or not found.place}


def told(path: Path, bindings: Path) -> list[tuple[object, ...]]:
    """Return what every transaction and message of SCD is, but for its values."""
    return [
        (
            event.function_name,
            int(event.pdu_ref),
            event.outcome,
            event.reason,
            event.latency_ns,
            [
                (found.message.service, found.message.phase, found.message.numbers, list(found.message.values),
                 found.message.error and found.message.error.code, _flags(found), len(found.octets), found.place)
                for found in event.scd
            ],
        )
        for event in dissect.open(str(path), scd=DICTIONARY, bind=bindings)
        if isinstance(event, Transaction)
    ]  # fmt: skip


def numbers(path: Path, bindings: Path) -> list[object]:
    return [
        value
        for event in dissect.open(str(path), scd=DICTIONARY, bind=bindings)
        if isinstance(event, Transaction)
        for found in event.scd
        for value in found.message.values.values()
    ]


@pytest.mark.parametrize("values", [KEEP, MASK, SCRAMBLE])
def test_a_plant_by_its_dictionary(values: str, tmp_path: Path) -> None:
    out, bindings = tmp_path / "out.pcapng", fitting(tmp_path)
    made = anonymized(PLANT, out, Choices(values), carrier=carrier())
    assert made.written == made.packets == len(frames(out))
    assert made.caveats == made.dropped == {}
    assert told(out, bindings) == told(PLANT, BINDINGS)
    slugs = [
        sorted(
            one.slug
            for one in dissect.analyze(str(path), scd=DICTIONARY, bind=bind).findings
            if one.slug != "scd.limits"  # of contents in S7 items, see `_flags`
        )
        for path, bind in ((PLANT, BINDINGS), (out, bindings))
    ]
    assert slugs[0] == slugs[1]
    before, after = numbers(PLANT, BINDINGS), numbers(out, bindings)
    texts = [(one, other) for one, other in zip(before, after, strict=True) if isinstance(one, str)]
    assert texts
    assert all(len(one.encode()) == len(str(other)) and one != other for one, other in texts)
    plain = [(one, other) for one, other in zip(before, after, strict=True) if isinstance(one, int)]
    if values == KEEP:
        assert all(one == other for one, other in plain)
    else:
        changed = [(one, other) for one, other in plain if one != other]
        assert len(changed) > 50
        assert {other for _, other in changed} <= {0} if values == MASK else len({other for _, other in changed}) > 20
    assert NAME.encode()[:8] not in out.read_bytes()


def test_without_a_dictionary_headers_stay_and_data_go(tmp_path: Path) -> None:
    out = tmp_path / "out.pcapng"
    made = anonymized(PLANT, out, Choices(keep_others=True))
    assert made.masked[account.SCD_UNKNOWN][0] > 20
    assert len(frames(out)) == len(frames(PLANT))
    bindings = fitting(tmp_path)
    before, after = told(PLANT, BINDINGS), told(out, bindings)
    headed = [row for row in before if row[0] != "SCD PDO T2" and not str(row[0]).startswith(("Read", "PBC"))]
    assert len(headed) > 25
    assert [row[:5] for row in after if row[0] != "SCD PDO T2" and not str(row[0]).startswith(("Read", "PBC"))][
        :10
    ] == [row[:5] for row in headed][:10]
    assert not any(numbers(out, bindings)[:9])
    account_dropped = anonymized(PLANT, out)
    assert account_dropped.dropped == {"other_protocol": 58}


def test_pieces_of_a_datagram_and_of_a_stream(tmp_path: Path) -> None:
    """IP fragments of a datagram are put together; messages of a stream are found however it is cut."""
    packets = [Packet(frame.time_ns, frame.octets, len(frame.octets)) for frame in frames(PLANT)]
    bound = next(packet for packet in packets if packet.octets[23:24] == b"\x11")
    first = bytearray(bound.octets[:34] + bound.octets[34:50])
    second = bytearray(bound.octets[:34] + bound.octets[50:])
    for piece, more, at in ((first, 0x20, 0), (second, 0, 2)):
        piece[16:18] = (len(piece) - 14).to_bytes(2, "big")
        piece[20:22] = bytes((more, at))
    cut = [Packet(bound.time_ns + at * MS, bytes(piece), len(piece)) for at, piece in enumerate((first, second))]
    source, out = saved(tmp_path / "in.pcapng", cut), tmp_path / "out.pcapng"
    made = anonymized(source, out, carrier=carrier())
    assert (made.written, made.dropped) == (2, {})
    assert told(out, BINDINGS) == told(source, BINDINGS) != []
    assert not any(numbers(out, BINDINGS))
    assert any(numbers(source, BINDINGS))


def message(codec: Codec, octets: bytes, binding: str = "обмен") -> ScdMessage:
    return ScdMessage(codec.parse_message(octets), codec.dictionary, binding, octets)


def rules(values: str = MASK) -> tuple[ScdRules, Codec, Account]:
    made, told_of = carrier(), Account()
    return ScdRules(KEY, AddressMap(KEY), Choices(values), made, told_of), made.devices.codec, told_of


def response(codec: Codec, index: int, sub: int, data: bytes) -> bytes:
    return codec.encode_message(Message(service="read", phase="response", tid=9, index=index, sub=sub, data=data))


RULES = {values: rules(values) for values in (KEEP, MASK, SCRAMBLE)}
SEEDS = [
    found.octets
    for event in dissect.open(str(PLANT), scd=DICTIONARY, bind=BINDINGS)
    if isinstance(event, Transaction)
    for found in event.scd
]
PLACES = carrier().bindings.all


def test_a_wrong_checksum_stays_as_wrong() -> None:
    made, codec, _ = rules()
    octets = bytearray(response(codec, 0x6044, 0, b"\x11\x22\x33\x44"))
    octets[-1] ^= 0x5A
    new = bytearray(made.message(message(codec, bytes(octets))))
    assert codec.parse_message(bytes(new)).error is not None
    new[-1] ^= 0x5A
    found = codec.parse_message(bytes(new))
    assert (found.error, found.data, found.tid) == (None, bytes(4), 9)


def test_a_text_that_is_none_stays_none_and_an_unknown_object_is_blank() -> None:
    made, codec, told_of = rules(KEEP)
    broken = response(codec, 0x2002, 0, b"Pumpe \xff\xfe 17")
    found = codec.parse_message(made.message(message(codec, broken)))
    assert found.error is not None
    assert found.error.code == "E_UTF8"
    assert b"Pumpe" not in found.data
    unknown = codec.parse_message(made.message(message(codec, response(codec, 0x2FFF, 0, b"who knows"))))
    assert unknown.data == bytes(9)
    assert told_of.masked["unknown_octets"][1] == 9


def test_what_the_dictionary_says_itself_stays() -> None:
    made, codec, _ = rules()
    for index, sub, data in (
        (0x1000, 0, bytes.fromhex("02000100")),  # a constant with its default
        (0x1020, 3, codec.dictionary.wire_id[:4]),
        (0x1A00, 1, bytes(range(8))),
        (0x6000, 255, bytes.fromhex("09400000")),
    ):
        octets = response(codec, index, sub, data)
        assert made.message(message(codec, octets)) == octets
    other = response(codec, 0x1000, 0, bytes.fromhex("02000200"))
    assert codec.parse_message(made.message(message(codec, other))).data == bytes(4)


def test_times_keep_to_their_range() -> None:
    made, codec, _ = rules(SCRAMBLE)
    octets = response(codec, 0x2000, 1, codec.encode_value((0x2000, 1), NetTime(1_700_000_000, 999_999_999)))
    found = codec.parse_message(made.message(message(codec, octets)))
    assert found.error is None
    assert found.flags == {}
    assert found.values[0x2000, 1] != NetTime(1_700_000_000, 999_999_999)


def test_what_is_no_message_is_not_believed() -> None:
    made, codec, _ = rules()
    octets = response(codec, 0x6044, 0, b"\x11\x22\x33\x44")
    whole = octets + octets
    assert made.inside(whole + bytes(6)) is not None
    for wrong in (b"", b"\0" * 9, octets[:-1], whole[:-1], whole + b"\1", b"x" + octets, octets[:-1] + b"x"):
        assert made.headers(wrong) is None, wrong
        assert made.inside(wrong) is None


@given(st.data())
def test_damaged_messages_never_raise_and_keep_their_size(data: st.DataObject) -> None:
    made, codec, _ = RULES[data.draw(st.sampled_from(sorted(RULES)))]
    octets = bytearray(data.draw(st.sampled_from(SEEDS)))
    for _ in range(data.draw(st.integers(0, 4))):
        octets[data.draw(st.integers(0, len(octets) - 1))] = data.draw(st.integers(0, 255))
    octets = octets[: data.draw(st.integers(0, len(octets)))] + data.draw(st.binary(max_size=9))
    if data.draw(st.booleans()) and len(octets) > 13:  # with a checksum that is right
        wrapped = codec.envelope.parse(bytes(octets))
        numbers = wrapped.numbers if wrapped.numbers.get("protocol") == 0xDC else {}
        octets = bytearray(codec.envelope.build(numbers, wrapped.data or b"x"))
    for binding in ("обмен", "насос и давление", "насос в DB10", "состояние в DB10"):
        rule = next(one for one in PLACES if one.name == binding)
        for decoded in decode(codec, rule, bytes(octets)):
            found = ScdMessage(decoded, codec.dictionary, binding, bytes(octets)[: decoded.size or len(octets)])
            assert len(made.message(found)) == len(found.octets)
    inside = made.inside(bytes(octets))
    assert inside is None or len(inside) == len(octets)


def test_a_stream_in_pieces_with_something_else_in_it(tmp_path: Path) -> None:
    codec = carrier().devices.codec
    flow = Flow(ports=(49200, 5601))
    messages = [response(codec, 0x6044, 0, bytes((at, 1, 2, 3))) for at in range(1, 9)]
    stream = b"".join(messages[:4]) + b"WHO IS THERE?" + b"".join(messages[4:])
    talk = Talk(flow).handshake()
    for at in range(0, len(stream), 7):
        talk.send(1, stream[at : at + 7])
    source, out = saved(tmp_path / "in.pcapng", talk.close().packets()), tmp_path / "out.pcapng"
    made = anonymized(source, out, carrier=carrier())
    assert made.written == made.packets
    assert made.masked["scd_values"] == (8, 32)
    written = b"".join(frame.octets[54:] for frame in frames(out))
    assert [message in written for message in messages] == [False] * 8
    assert b"WHO" not in written
    assert [row[:5] for row in told(out, BINDINGS)] == [row[:5] for row in told(source, BINDINGS)]
    assert len(told(out, BINDINGS)) == 8


def test_bindings_are_told_as_they_have_to_be(tmp_path: Path) -> None:
    path = tmp_path / "bind.toml"
    path.write_text('[[binding]]\nname = "a"\nudp = 5600\nhost = "203.0.113.0/24"\nholds = "messages"\n')
    (entry,) = bindings_of(load_bindings(path, load(DICTIONARY)), KEY, AddressMap(KEY))
    mapped = AddressMap(KEY).ip(bytes((203, 0, 113, 77)))
    assert entry == {"name": "a", "host": ".".join(map(str, mapped[:3])) + ".0/24"}
