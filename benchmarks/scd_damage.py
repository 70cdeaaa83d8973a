"""Damage to SCD dictionaries, for `benchmarks.scd_fuzz` and the tests: in octets, in records, in the tables of a source."""

from __future__ import annotations

import json
import random
import struct
import zlib
from collections.abc import Sequence
from copy import deepcopy
from typing import Any

import msgspec

from dissect.scd.binary import MAGIC, wire_id
from dissect.scd.records import Body

#: Replacements for a node of a damaged dictionary.
JUNK: tuple[Any, ...] = (
    None, True, False, -1, 0, 1, 2, 7, 8, 9, 255, 256, 0x1A00, 0x2000, 0x6000, 65535, 65536, 2**31, 2**32, 2**60, 2**63,
    2**64 - 1, -(2**63), 0.5, -0.0, 1e308, float("nan"), float("inf"), "", "x", "uint8", "0x2000:1", "T1", "\0", "\u202e",
    "x" * 300, "9" * 5000, "0x" + "f" * 5000, b"", b"\xff", bytes(300), [], [[]], [None], {}, {"x": 1}, [0] * 300,
)  # fmt: skip
#: Further replacements that only a text form can express.
TEXT_JUNK: tuple[Any, ...] = (10**400, -(2**200), "\ud800", {"name": "x", "reserved": 3, "type": "int8", "index": 8192})


def nested(depth: int) -> list[Any]:
    """Return arrays in arrays."""
    content: list[Any] = []
    for _ in range(depth):
        content = [content]
    return content


def sealed(octets: bytes, dice: random.Random | None = None) -> bytes:
    """Return a file around a body with all sums right, so that the fault must be found in the records."""
    try:
        identity = wire_id(msgspec.msgpack.decode(octets, type=Body))
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        identity = bytes(32)
    minor = 1 if dice is not None and dice.random() < 0.1 else 0
    size = 64 + len(octets)
    return struct.pack("<8sBBHII12s32s", MAGIC, 1, minor, 64, size, zlib.crc32(octets), bytes(12), identity) + octets


def damage_octets(dice: random.Random, octets: bytes) -> bytes:
    """Return octets with some changed, cut out, doubled or put in."""
    damaged = bytearray(octets)
    for _ in range(dice.randint(1, 4)):
        at = dice.randrange(len(damaged) + 1)
        end = at + dice.choice((1, 1, 2, 5, 40))
        damaged[at:end] = dice.choice((
            dice.randbytes(1), dice.randbytes(1), b"", b"", damaged[at:end] * 2, b"\xdd\xff\xff\xff\xff",
            b"\xdb\x7f\xff\xff\xff", b"\xc6\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff", b"\x91" * 300, dice.randbytes(9),
        ))  # fmt: skip
    return bytes(damaged)


def damage_tree(dice: random.Random, tree: Any, junk: Sequence[Any]) -> None:
    """Change one to three nodes of arrays and tables in place: replace, remove, double or swap them."""
    for _ in range(dice.randint(1, 3)):
        nodes = [(tree, key) for key in _keys(tree)]
        for content, key in nodes:
            nodes.extend((content[key], inner) for inner in _keys(content[key]))
        if not nodes:
            return
        content, key = dice.choice(nodes)
        other, other_key = dice.choice(nodes)
        what = dice.randrange(6)
        if what == 0 and isinstance(content, list):
            content.insert(key, content[key])
        elif what == 1:
            del content[key]
        elif what == 2:
            content[key] = json.loads(json.dumps(other[other_key], default=repr))
        elif what == 3 and isinstance(content, dict):
            content[dice.choice(("index", "name", "type", "size", "fields", "values", "texts", "map", str(key)))] = (
                content[key]
            )
        else:
            content[key] = nested(dice.choice((20, 200, 900))) if dice.random() < 0.03 else deepcopy(dice.choice(junk))


def _keys(content: Any) -> list[Any]:
    return (
        list(range(len(content))) if isinstance(content, list) else list(content) if isinstance(content, dict) else []
    )
