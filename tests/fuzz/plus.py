"""Fuzz target ``plus``: the contents of an S7comm-plus PDU, with the head and the frames made around them.

The first octet chooses the function, the second opcode and version; what follows is the body. So a fuzzer does not have to find
the right lengths, digests and sequence numbers before it reaches values and objects.
"""

from __future__ import annotations

import json
from typing import Final

from dissect.meaning.report.plus import item_text
from dissect.meaning.report.tree import plus_tree_lines
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.events import take
from dissect.protocols.s7plus.hiding import shown_half
from dissect.protocols.s7plus.items import join_items
from dissect.protocols.s7plus.layouts import VALUE
from dissect.protocols.s7plus.message import PlusPdu, fixed_part, parse_plus
from dissect.protocols.s7plus.objects import build_elements, every_object, read_elements
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import Identity, PlusSession
from dissect.protocols.s7plus.tables import FUNCTIONS, NOTIFICATION, OPCODES, REQUEST, SYSTEM_EVENT
from dissect.protocols.s7plus.value_reading import read_value
from dissect.protocols.s7plus.values import Value, build_value
from dissect.protocols.s7plus.walk import MAX_DEPTH, Walk
from dissect.testing.oracle.plus import PlusProof
from tests.fuzz.checks import check_line, check_lines
from tests.fuzz.turns import TURNS

_FUNCTIONS: Final = [row.number for row in FUNCTIONS] + [0x1234]
_OPCODES: Final = [row.number for row in OPCODES]
_VERSIONS: Final = (1, 2, 3, SYSTEM_EVENT)
#: The outputs for contents, in turn (`tests.fuzz.turns`): their tree, the items of a session, the proof of their structure.
TREE, ITEMS, PROOF, THINGS = range(4)
#: Octets of a frame, so that long bodies come in several.
_FRAME: Final = 700


def framed(octets: bytes) -> bytes:
    """Return the PDU that an input describes."""
    if len(octets) < 2:
        return b"\x72\x02\0\0"
    function, kind, body = _FUNCTIONS[octets[0] % len(_FUNCTIONS)], octets[1], octets[2:]
    version = _VERSIONS[kind >> 4 & 3]
    opcode = _OPCODES[kind % len(_OPCODES)]
    if version == SYSTEM_EVENT:
        data = bytes(16) + body
        return b"\x72\xfe" + len(data).to_bytes(2, "big") + data
    data = bytes((opcode,))
    if opcode != NOTIFICATION:
        data += (
            b"\0\0"
            + function.to_bytes(2, "big")
            + b"\0\0\0\7"
            + (b"\0\0\3\x86" if opcode == REQUEST else b"")
            + b"\x34"
        )
    elif version != 1:
        data += b"\x70\0\x0e\x51\4\0\0\0\0\0\1"
    data += body
    digest = b"\x20" + bytes(32) if version == 3 else b""
    cuts = _cut(data, octets)
    head = bytes((0x72, version))
    frames = b"".join([head + len(digest + cut).to_bytes(2, "big") + digest + cut for cut in cuts])
    return frames + head + b"\0\0"


def _cut(data: bytes, octets: bytes) -> list[bytes]:
    """Cut data into frames: of the usual size, and where the highest bit of the second octet is set at any other place too."""
    places = set(range(_FRAME, len(data), _FRAME))
    if octets[1] & 0x80 and len(octets) > 4 and data:
        step = octets[2] or 1
        places.update(range(octets[3] % len(data), len(data), step))
    ends = sorted({*places, len(data)} - {0})
    return [data[begin:end] for begin, end in zip([0, *ends], ends, strict=False)]


def written(function: int, opcode: int, version: int, body: bytes) -> bytes:
    """Return the input whose PDU has these."""
    kind = _VERSIONS.index(version) << 4 | _OPCODES.index(opcode)
    while kind % len(_OPCODES) != _OPCODES.index(opcode) or kind >> 4 & 3 != _VERSIONS.index(version):
        kind = (kind + 1) & 0xFF
    number = _FUNCTIONS.index(function) if function in _FUNCTIONS else len(_FUNCTIONS) - 1
    return bytes((number, kind)) + body


def _check_built_again(found: Contents, data: bytes) -> None:
    """Parts are built and read again with the same result; values from their own octets, objects with all their contents."""
    for one in found.objects:
        octets = build_elements([one])
        assert build_elements(read_elements(_walk(octets, data))) == octets
    values = [value for _, value in found.items]
    values += [found.value] if found.value is not None else []
    for value in values:
        octets = build_value(value)
        assert build_value(_read(octets, data)) == octets
        assert value.end <= len(data)


def _walk(octets: bytes, data: bytes) -> Walk:
    """Return a walk with the budget of the one through ``data``: an array of Null has more elements than octets."""
    walk = Walk(octets, 0, len(octets), False)
    walk.budget = max(walk.budget, Walk(data, 0, len(data), False).budget)
    return walk


def _read(octets: bytes, data: bytes) -> Value:
    walk = _walk(octets, data)
    value = read_value(walk, VALUE, 0)
    assert walk.left == 0
    return value


def plus(octets: bytes) -> None:
    """Any contents: read without an exception, divided without gaps, limited in depth, built again the same, shown safely."""
    whole = framed(octets)
    pdu = parse_plus(whole)
    found = parse_contents(pdu)
    parts = found.parts
    if parts:
        head = fixed_part(pdu)
        assert parts[0].offset == (head.size if head is not None else 1)
        assert [part.offset for part in parts[1:]] == [part.end for part in parts[:-1]]
        assert parts[-1].end == len(pdu.data)
        assert max([part.depth for part in parts]) <= MAX_DEPTH + 1
    for fact in found.malformed:
        assert 0 <= fact.offset <= len(pdu.data)
        check_line(str(fact))
    for begin, end in found.blobs:
        assert 0 <= begin < end <= len(pdu.data)
    assert len(every_object(found.objects)) <= len(octets)
    _check_built_again(found, pdu.data)
    if TURNS.has(octets, TREE, THINGS):
        check_lines(plus_tree_lines(pdu, b""))
    if TURNS.has(octets, ITEMS, THINGS):
        _check_shown(pdu, whole)
    if TURNS.has(octets, PROOF, THINGS):
        proof = PlusProof()
        proof.take(whole, 1, 1, 0, cut=False)
        check_line(str(proof))


def _check_shown(pdu: PlusPdu, whole: bytes) -> None:
    """The texts of a session about it are safe."""
    session = PlusSession(Program(), Identity())
    take(session, pdu.function, whole, whole)
    half = shown_half(pdu)
    for item in [*join_items(half, half, session), *join_items(None, half, session)]:
        check_line(item_text(item))
        json.dumps(item.json_value, allow_nan=False)
