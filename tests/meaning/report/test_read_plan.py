"""The plan that lines of polled reads are written by writes what each of their items is written as by itself."""

from __future__ import annotations

import struct
from random import Random

import pytest

from dissect.meaning.report.item_json import item_json
from dissect.meaning.report.read_plan import ReadPlan
from dissect.protocols.s7.items import item_fill, item_heads
from dissect.protocols.s7.parameters import Parameters, parse_parameters
from dissect.protocols.s7.singles import real_json, real_text
from dissect.protocols.s7.tables import ACK_DATA, JOB, READ_VAR, SUCCESS

#: Transport sizes that are asked for, and octets of an element.
ASKED = {1: 1, 2: 1, 3: 1, 4: 2, 5: 2, 6: 4, 7: 4, 8: 4, 9: 2, 10: 4, 11: 4, 12: 2, 19: 2, 28: 2, 29: 2}


def asked_and_told(rng: Random, asked: list[tuple[int, int]]) -> tuple[Parameters, list[bytes], bytes]:
    """Return a request for items of a transport size and count, their octets, and the PDU that answers it."""
    block = bytes([READ_VAR, len(asked)])
    data = b""
    contents: list[bytes] = []
    for index, (size, count) in enumerate(asked):
        block += bytes([0x12, 10, 0x10, size]) + struct.pack(">HH", count, 7) + b"\x84" + (8 * index).to_bytes(3, "big")
        content = rng.randbytes(ASKED[size] * count) if rng.random() < 0.8 else b"{ab}" * (ASKED[size] * count)
        content = content[: ASKED[size] * count]
        contents.append(content)
        code = 3 if size == 1 else 4
        length = len(content) * (1 if size == 1 else 8)
        data += bytes([SUCCESS, code]) + struct.pack(">H", length) + content
        data += bytes(item_fill(len(content), index + 1 == len(asked)))
    head = struct.pack(">BBHHHHH", 0x32, ACK_DATA, 0, 1, 2, len(data), 0)
    return parse_parameters(block, JOB), contents, head + bytes([READ_VAR, len(asked)]) + data


@pytest.mark.parametrize("seed", range(40))
def test_items_are_written_as_one_by_one(seed: int) -> None:
    rng = Random(seed)
    asked = []
    for _ in range(rng.randint(1, 12)):
        size = rng.choice(list(ASKED))
        asked.append((size, 1 if size == 1 else rng.randint(1, 6)))
    parameters, contents, pdu = asked_and_told(rng, asked)
    items = parameters.items
    assert [item.size for item in items] == [len(content) for content in contents]
    parameters.good_answer = item_heads(len(items), pdu, 14, len(pdu))
    parameters.keep_layout(pdu, 0, 14)
    buf = b"before" + pdu + b"behind"
    assert parameters.like_good(buf, 6, len(pdu), 20)
    written = ReadPlan(parameters).text(buf, 20)
    assert written == ",".join([item_json(item, SUCCESS, data) for item, data in zip(items, contents, strict=True)])


def test_an_answer_is_like_a_good_one_in_all_that_tells_something() -> None:
    parameters, _, pdu = asked_and_told(Random(3), [(2, 3), (8, 2), (5, 1)])
    assert not parameters.like_good(pdu, 0, len(pdu), 14)  # none is known
    parameters.good_answer = item_heads(3, pdu, 14, len(pdu))
    parameters.keep_layout(pdu[:11] + b"\x01" + pdu[12:], 0, 14)
    assert parameters.good_layout is None  # its header says that not all is well
    parameters.keep_layout(pdu, 0, 14)
    assert parameters.like_good(pdu, 0, len(pdu), 14)
    assert not parameters.like_good(pdu + b"\0", 0, len(pdu) + 1, 14)
    assert not parameters.like_good(pdu, 0, len(pdu), 16)  # of a PDU whose lengths lie
    heads = {10, 11, 12, 13} | {14 + place + octet for place in (0, 8, 20) for octet in range(4)}
    for at in range(10, len(pdu)):
        other = bytearray(pdu)
        other[at] ^= 1
        assert parameters.like_good(bytes(other), 0, len(pdu), 14) == (at not in heads)


def test_singles_are_written_as_their_text() -> None:
    rng = Random(9)
    numbers = [rng.uniform(-2e6, 2e6) for _ in range(3000)] + [rng.uniform(-1, 1) for _ in range(3000)]
    numbers += [round(rng.uniform(-1000, 1000), rng.randint(0, 4)) for _ in range(3000)]
    numbers += [sign * 2.0**power for power in range(-12, 24) for sign in (1, -1)]
    octets = {struct.pack(">f", number) for number in numbers}
    for edge in (0.002, 1e6, 0.0009765625):
        (word,) = struct.unpack(">I", struct.pack(">f", edge))
        octets |= {(word + step).to_bytes(4, "big") for step in range(-200, 200)}
    for single in octets:
        text = real_text(single)
        assert real_json(single) == (text if "." in text or "e" in text else text + ".0")
