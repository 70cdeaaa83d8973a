"""Any bytes as code: nothing raised, no step lost, and the assembler makes the same bytes of what is shown."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from dissect.protocols.mc7.assembler import assemble, source_lines
from dissect.protocols.mc7.block import parse_block
from dissect.protocols.mc7.code import decode, jumps, row_of, unknown_octets
from dissect.protocols.mc7.instruction_tables import INSTRUCTIONS
from tests.protocols.mc7.samples import ob1

_WORDS = [first << 8 | second for row in INSTRUCTIONS for first in row.firsts for second in row.seconds]


@given(st.binary(max_size=400))
def test_random_octets_never_raise_and_never_lose_step(octets: bytes) -> None:
    found = decode(octets)
    at = 0
    for instruction in found:
        assert instruction.offset == at
        assert instruction.size == len(instruction.octets)
        at += instruction.size
    assert at == len(octets)
    assert b"".join([instruction.octets for instruction in found]) == octets
    assert unknown_octets(found) <= len(octets)


@given(st.lists(st.tuples(st.sampled_from(_WORDS), st.binary(min_size=4, max_size=4)), max_size=60), st.booleans())
def test_what_is_shown_is_assembled_to_the_same_octets(drawn: list[tuple[int, bytes]], german: bool) -> None:
    code = b"".join([word.to_bytes(2, "big") + behind[: row_of(word).size - 2] for word, behind in drawn])
    found = decode(code)
    labels = {jump.target: f"L{jump.target}" for jump in jumps(found)}
    starts = {instruction.offset for instruction in found}
    labels = {target: label for target, label in labels.items() if target in starts}
    assert assemble("\n".join(source_lines(found, labels, german)), german).code == code


@given(st.binary(max_size=300), st.sets(st.integers(0, 300), max_size=20))
def test_borders_help_and_never_hide(octets: bytes, borders: set[int]) -> None:
    plain, guided = decode(octets), decode(octets, sorted(borders))
    assert unknown_octets(guided) <= unknown_octets(plain)
    assert b"".join([instruction.octets for instruction in guided]) == octets


def test_sound_code_is_read_alike_whatever_its_tables_say() -> None:
    code = parse_block(ob1()).code
    plain = [instruction.offset for instruction in decode(code)]
    assert [instruction.offset for instruction in decode(code, range(1, len(code)))] == plain


def test_a_border_finds_the_step_again() -> None:
    # An unknown word that looks like the first of six octets swallows the next instruction; the border brings it back.
    code = bytes.fromhex("0600 3803 8100 8200 6500".replace(" ", ""))
    assert [each.name for each in decode(code)] == ["DW", "L", "BE"]
    assert [each.name for each in decode(code, [4])] == ["DW", "L", "BE"]
    code = bytes.fromhex("0600380381000600 6500".replace(" ", ""))
    assert [each.name for each in decode(code)] == ["DW", "L", "BE"]
    cut = bytes.fromhex("0600 7e41 0600 0600".replace(" ", ""))
    assert [each.name for each in decode(cut)] == ["DW", "L", "DW"]
