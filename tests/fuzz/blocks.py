"""Fuzz target ``blocks``: a block of S7-300/400; the last octet of an input determines how it is composed.

Bit 0: the input is a whole block, as it is transferred; otherwise its first octets are divided into code, interface and
additional information, so that a fuzzer does not have to find the right lengths of a header. Bits 1 to 3 are the type of such a
block.
"""

from __future__ import annotations

import json
from typing import Final

from dissect.protocols.mc7.block import Block, block_of_parts, parse_block
from dissect.protocols.mc7.changes import change_lines, compare_blocks
from dissect.protocols.mc7.checks import all_facts
from dissect.protocols.mc7.code import decode
from dissect.protocols.mc7.hazards import new_output_writes, newly_skipped_calls, older_than, system_calls
from dissect.protocols.mc7.listing import AWL, STL, Lister, block_lines, block_values
from dissect.protocols.mc7.source import assemble_block, block_source, code_lines
from dissect.protocols.mc7.usage import cross_reference_lines, cross_reference_values
from dissect.protocols.mc7.values import block_data
from tests.fuzz.checks import check_line

WHOLE: Final = 1
_KINDS: Final = ("OB", "FC", "FB", "DB", "SFC", "SFB", "SDB", "OB")


def of_parts(code: bytes, interface: bytes, additional: bytes, kind: str) -> bytes:
    """Return the input for a block of three parts, each of 255 octets at most."""
    sizes = bytes((len(interface), len(additional)))
    return sizes + interface + additional + code + bytes((_KINDS.index(kind) << 1,))


def block_of(octets: bytes) -> Block:
    """Return the block that an input describes."""
    if not octets or octets[-1] & WHOLE:
        return parse_block(octets[:-1])
    body = octets[:-1]
    first, second = body[0] if body else 0, body[1] if len(body) > 1 else 0
    interface, rest = body[2 : 2 + first], body[2 + first :]
    return block_of_parts(_KINDS[octets[-1] >> 1 & 7], 7, 1, rest[second:], interface, rest[:second])


def blocks(octets: bytes) -> None:
    """Any block: read without an exception and without a gap, shown safely, compared with itself, assembled to its octets."""
    block = block_of(octets)
    assert b"".join([instruction.octets for instruction in block.instructions]) == (
        block.code if block.has_code else b""
    )
    assert sum([len(network.instructions) for network in block.networks]) == len(block.instructions)
    for fact in all_facts(block):
        check_line(fact.text)
        assert fact.offset < 0x20000  # the jump list counts in words
    for language in (STL, AWL):
        lister = Lister(language, lambda *_: "a tag", lambda *_: block)
        for line in block_lines(block, lister):
            check_line(line)
        json.dumps(block_values(block, lister), allow_nan=False)
    for line in cross_reference_lines([block]):
        check_line(line)
    json.dumps(cross_reference_values([block]))
    for value in block_data(block):
        check_line(value.text)
    _check_versions(block)
    if block.footer is not None and block.octets and not block.facts:
        assert assemble_block(block_source(block)) == block.octets
    if block.has_code:
        code_lines(block)


def _check_versions(block: Block) -> None:
    """A block has no changes from itself; for other code there are lines that can be shown."""
    assert compare_blocks(block, block) == []
    assert older_than(block, block) == ""
    assert new_output_writes(block, block) == []
    assert newly_skipped_calls(block, block) == []
    for call in system_calls(block):
        check_line(call.text)
    other = block_of_parts(block.kind, block.number, block.language, block.code[4:], block.interface_octets, b"")
    for before, after in ((block, other), (other, block)):
        for line in change_lines(block.label, compare_blocks(before, after)):
            check_line(line)


def block_seeds() -> list[bytes]:
    """Return the inputs with which a fuzzer begins: our own blocks whole and in parts, and code of every instruction."""
    from dissect.protocols.mc7.instruction_tables import INSTRUCTIONS
    from tests.protocols.mc7.samples import fb7, fc5, ob1

    whole = [ob1(), ob1("10S"), fc5(), fb7()]
    parts = [parse_block(octets) for octets in whole]
    seeds = [octets + bytes((WHOLE,)) for octets in whole]
    seeds += [of_parts(each.code, each.interface_octets, each.additional, each.kind) for each in parts]
    words = [row.firsts[0] << 8 | min(row.seconds) for row in INSTRUCTIONS]
    for at in range(0, len(words), 8):
        code = b"".join([word.to_bytes(2, "big") + bytes(row_size(word) - 2) for word in words[at : at + 8]])
        seeds.append(of_parts(code + b"\x65\x00", parts[2].interface_octets, b"", "FC"))
    return seeds


def row_size(word: int) -> int:
    """Return the octets of the instruction that begins with a word."""
    return decode(word.to_bytes(2, "big") + bytes(4))[0].size
