"""Usual reads and writes are masked and written as the modules say that know all others."""

from __future__ import annotations

from random import Random

import pytest

from dissect.protocols.s7.build import build_data_item, build_item, build_items, build_variables
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.tables import ACK_DATA, ANSWER_TRANSPORT_SIZE, DATA_BYTES, JOB, READ_VAR, SUCCESS, WRITE_VAR
from dissect.testing.golden import usual
from dissect.testing.golden.forms import form_lines
from dissect.testing.golden.masking import mask_s7
from dissect.testing.golden.values import shown_value

#: Octets of an element, by transport size; 0x77 is none.
_ELEMENTS = {0x01: 1, 0x02: 1, 0x03: 1, 0x04: 2, 0x05: 2, 0x06: 4, 0x07: 4, 0x08: 4, 0x0C: 2, 0x13: 2, 0x1C: 2, 0x1D: 2}
_SINGLES = (0x7FC00000, 0xFFC00001, 0x7F800000, 0xFF800000, 0x80000000, 0x00000001, 0x7F7FFFFF)
_SPECIAL = [number.to_bytes(4, "big") for number in _SINGLES]


def _item(rng: Random) -> tuple[bytes, int, bytes]:
    """Return a request item, the data transport size of its answer, and an answer's content."""
    kind = rng.choice(list(_ELEMENTS))
    count = rng.choice((1, 1, 1, 2, 5))
    content = rng.randbytes(_ELEMENTS[kind] * count)
    if kind == 0x01:
        content = bytes(rng.choices((0, 1, 1, 0, 2), k=count))
    if kind == 0x03 and rng.random() < 0.7:
        content = bytes(rng.choices(b'abc XYZ"#\\~\x7f', k=count))
    if kind == 0x08 and rng.random() < 0.5:
        content = b"".join(rng.choices(_SPECIAL, k=count))
    if rng.random() < 0.05:
        content = content[:-1]
    item = build_item(kind, count, rng.choice((0, 1, 300)), rng.choice((0x81, 0x83, 0x84)), rng.randrange(0, 80000))
    size = ANSWER_TRANSPORT_SIZE.get(kind, DATA_BYTES) if rng.random() < 0.9 else rng.choice((0x03, 0x04, 0x07, 0x09))
    return item, size, content


def _damaged(rng: Random, octets: bytes) -> bytes:
    """Return a message as it is, or with another octet, one less or one more."""
    at = rng.randrange(len(octets))
    which = rng.random()
    if which < 0.6:
        return octets
    if which < 0.8:
        return octets[:at] + rng.randbytes(1) + octets[at + 1 :]
    return octets[:at] if which < 0.9 else octets + b"\0"


def _exchange(rng: Random) -> tuple[bytes, bytes]:
    """Return a read or a write and an answer to it, either of which may be damaged."""
    items = [_item(rng) for _ in range(rng.randrange(1, 5))]
    codes = [rng.choice((SUCCESS, SUCCESS, SUCCESS, SUCCESS, 0x0A, 0x05)) for _ in items]
    asked = build_items([item for item, _, _ in items])
    if rng.random() < 0.3:
        data = build_items([build_data_item(0, size, content) for _, size, content in items])
        request = build_variables(JOB, WRITE_VAR, len(items), asked, data)
        return request, _damaged(rng, build_variables(ACK_DATA, WRITE_VAR, len(items), b"", bytes(codes)))
    told = [
        build_data_item(code, size, content) if code == SUCCESS else bytes((code, rng.choice((0, 0, 4)), 0, 0))
        for code, (_, size, content) in zip(codes, items, strict=True)
    ]
    answer = build_variables(ACK_DATA, READ_VAR, len(items), b"", build_items(told))
    return build_variables(JOB, READ_VAR, len(items), asked), _damaged(rng, answer)


def test_values_are_written_as_any_others_are() -> None:
    rng = Random(16)
    for kind in (*_ELEMENTS, 0x09, 0x0A, 0x0B, 0x0F, 0x30, 0x77):
        for size in (0, 1, 2, 3, 4, 8, 12):
            for content in (rng.randbytes(size), bytes(size), b"\xff" * size, b"\1" * size, *_SPECIAL):
                for fits in (True, False):
                    assert usual.fast_shown_value(kind, content, fits) == shown_value(kind, content, fits), (
                        kind,
                        content,
                    )


def test_lines_are_those_of_the_form_where_there_are_any() -> None:
    rng = Random(17)
    written = {READ_VAR: 0, WRITE_VAR: 0}
    for _ in range(3000):
        request, answer = _exchange(rng)
        asked = parse_pdu(request)
        items = asked.parameters.items
        if asked.function == READ_VAR:
            lines = usual.read_lines(items, answer)
        else:
            data = asked.data_items()
            lines = usual.write_lines(
                items, [one.data for one in data], [int(one.transport_size) for one in data], answer
            )
        if lines is not None:
            assert (lines, True) == form_lines(asked, parse_pdu(answer), answer)
            written[asked.function] += 1
    assert min(written.values()) > 100


def test_a_message_is_masked_as_any_other_is(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = Random(18)
    messages = []
    for _ in range(2000):
        for octets in _exchange(rng):
            changed = bytearray(octets)
            changed[4:6] = rng.randbytes(2)
            if rng.random() < 0.3:
                changed[rng.randrange(len(changed))] = rng.randrange(256)
            messages.append(bytes(changed[: rng.randrange(len(changed))] if rng.random() < 0.1 else changed))
    quick = [mask_s7(octets) for octets in messages]
    assert sum([usual.masked(octets) is not None for octets in messages]) > len(messages) // 2
    monkeypatch.setattr(usual, "masked", lambda _: None)
    assert quick == [mask_s7(octets) for octets in messages]


def test_names_of_items_are_forgotten_before_they_are_too_many() -> None:
    for at in range(usual._MOST + 10):
        usual.item_name(
            parse_pdu(build_variables(JOB, READ_VAR, 1, build_item(2, 1, 1, 0x84, at * 8))).parameters.items[0]
        )
    assert 0 < len(usual._names) <= usual._MOST
