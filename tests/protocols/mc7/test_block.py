"""Blocks: parts, facts about what does not fit, hostile lengths and interfaces."""

from __future__ import annotations

import time
from typing import Final

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect.protocols.mc7.assembler import AssemblyError, assemble
from dissect.protocols.mc7.block import FACTS, Block, parse_block, parse_tables, tables_octets
from dissect.protocols.mc7.checks import all_facts, check_block, inconsistencies
from dissect.protocols.mc7.interface import interface_octets, parse_interface
from dissect.protocols.mc7.source import assemble_block, block_source
from dissect.protocols.s7.blocks import HEADER
from tests.cases import each
from tests.protocols.mc7.samples import FC5_SOURCE, OB1_SOURCE, fb7, fc5, ob1


def slugs(block: Block) -> set[str]:
    return {fact.slug for fact in all_facts(block)}


def test_a_block_says_what_it_is() -> None:
    block = parse_block(ob1())
    assert all_facts(block) == []
    assert (block.label, block.language_text, block.protected, block.encrypted) == ("OB1", "AWL/STL", False, False)
    assert block.said("code_time") == "2026-02-04 12:00:00.000"
    assert (block.said("author"), block.said("family"), block.said("name")) == ("plant", "demo", "cycle")
    assert (block.said("version"), block.field("checksum"), block.field("local_length")) == ("1.0", 4660, 30)
    assert [network.number for network in block.networks] == [1, 2, 3, 4, 5]
    assert block.network_of(0) == 1
    assert block.network_of(len(block.code) - 1) == 5
    assert [declaration.name for declaration in block.interface.declarations][-2:] == ["TEMP8", "TEMP9"]
    assert block.interface.temp_bits == 20 * 8


def test_an_interface_has_types_and_places() -> None:
    interface = parse_block(fb7()).interface
    found = [(each.name, each.type_text, each.start, each.bits) for each in interface.declarations]
    assert found == [
        ("IN0", "INT", 0, 16), ("OUT0", "INT", 16, 16), ("STAT0", "REAL", 32, 32), ("STAT1", "STRUCT", 64, 80),
    ]  # fmt: skip
    structure = interface.declarations[3]
    assert [(each.name, each.type_text, each.start) for each in structure.members] == [
        ("STAT1.m0", "BOOL", 0), ("STAT1.m1", "ARRAY [1..4] OF INT", 16),
    ]  # fmt: skip
    assert interface.declarations[2].initial.hex() == "0000803f"


def test_code_that_was_masked_for_sharing_proves_nothing() -> None:
    block = parse_block(ob1())
    octets = bytearray(block.octets)
    octets[36 : 36 + len(block.code)] = bytes(len(block.code))
    masked = parse_block(bytes(octets))
    assert slugs(masked) & {"no_end", "jump_list", "network_border"}
    assert inconsistencies(masked) == []
    octets[36] = 1
    assert inconsistencies(parse_block(bytes(octets)))


@each("octets", [ob1(), fc5(), fb7()])
def test_a_block_is_assembled_to_the_same_octets(octets: bytes) -> None:
    assert assemble_block(block_source(parse_block(octets))) == octets


def test_every_cut_is_read_as_far_as_it_goes() -> None:
    whole = ob1()
    for size in range(len(whole)):
        block = parse_block(whole[:size])
        facts = all_facts(block)
        assert facts, size
        assert facts[0].slug == ("not_a_block" if size < HEADER.size else "cut")
        if size > HEADER.size + 60:
            assert block.instructions[0].name == "A"
    surplus = parse_block(whole + b"xyz")
    assert slugs(surplus) == {"surplus"}
    assert len(surplus.networks) == 5


@each(
    ("octets", "words"),
    [
        (b"", "got nothing"),
        (b"MZ\x90\0\x03\0\0\0", "got 4d 5a 90 00"),
        (b"pp\x01\x01", "4 of 36 bytes"),
        (b"pp\x01\x01\x01\x77" + bytes(40), "0x77"),
    ],
)
def test_what_is_no_block_is_said(octets: bytes, words: str) -> None:
    (fact,) = all_facts(parse_block(octets))
    assert fact.slug == "not_a_block"
    assert words in fact.text


def test_an_encrypted_block_shows_its_header() -> None:
    octets = bytearray(ob1())
    octets[4] = 0x29
    block = parse_block(bytes(octets))
    assert "encrypted" in slugs(block)
    assert block.instructions == []
    assert block.said("author") == "plant"
    assert len(block.interface.declarations) == 10


def test_a_block_with_injected_code_shows_in_its_tables() -> None:
    """As an injector does it: a call in front, lengths corrected, nothing else."""
    block = parse_block(ob1())
    call = bytes.fromhex("fb700457700b0002")
    code = call + block.code
    octets = bytearray(block.octets[:36] + code + block.octets[36 + len(block.code) :])
    octets[34:36] = len(code).to_bytes(2, "big")
    octets[8:12] = len(octets).to_bytes(4, "big")
    injected = parse_block(bytes(octets))
    assert {fact.slug for fact in inconsistencies(injected)} == {"network_sum", "jump_list", "network_border"}
    assert [instruction.name for instruction in injected.instructions[:2]] == ["UC", "A"]
    assert len(injected.instructions) == len(block.instructions) + 1


#: What is replaced in the source of OB1, by what, and the fact that it makes.
INCONSISTENT: Final = [
    ("       BE\n", "", "no_end"),
    ("present = 1", "present = 1\nnetworks = 7 7 7", "network_border"),
    ("present = 1", "present = 1\nnetworks = 4", "network_sum"),
    ("present = 1", "present = 1\njumps = 40", "jump_list"),
    ("present = 1", "octets = 0500", "network_table"),
    ("JCN   M3_1", "JCN   +3000", "jump_target"),
    ("L     100", "DW    W#16#0600", "unknown_instruction"),
    ("UC    FC 5 (P#V 22.0, P#M 40.0)", "UC    FC 5", "parameter_list"),
    ("local_length = 30", "local_length = 10", "local_data"),
    ("kind = 1\nTEMP BYTE", "kind = 1\nstart_values = 01\nTEMP BYTE", "start_values"),
    ("local_length = 30", "local_length = 30\nload_length = 999", "lengths"),
    ("kind = 1\nTEMP BYTE", "kind = 1\nrest = 010203\nTEMP BYTE", "interface"),
]


@each(("old", "new", "slug"), INCONSISTENT)
def test_each_inconsistency_is_a_fact(old: str, new: str, slug: str) -> None:
    assert old in OB1_SOURCE
    assert slug in slugs(parse_block(assemble_block(OB1_SOURCE.replace(old, new))))


#: What is replaced in the source of FC5, by what, and the fact that it makes.
UNDECLARED: Final = [
    ("L     #IN0", "L     #PAR12", "parameter"),
    ("L     #IN0", "A     #IN0", "parameter_type"),
]


@each(("old", "new", "slug"), UNDECLARED)
def test_parameters_have_to_be_declared(old: str, new: str, slug: str) -> None:
    assert slug in slugs(parse_block(assemble_block(FC5_SOURCE.replace(old, new))))


def test_every_fact_that_the_documentation_lists_is_told_of_some_block() -> None:
    altered = [OB1_SOURCE.replace(old, new) for old, new, _ in INCONSISTENT]
    altered += [FC5_SOURCE.replace(old, new) for old, new, _ in UNDECLARED]
    blocks = [parse_block(assemble_block(source)) for source in altered]
    encrypted = bytearray(ob1())
    encrypted[4] = 0x29
    blocks += [parse_block(octets) for octets in (b"", ob1()[:-1], ob1() + b"x", bytes(encrypted))]
    assert set().union(*[slugs(block) for block in blocks]) == set(FACTS)


def test_floods_of_facts_are_counted() -> None:
    source = OB1_SOURCE.replace("       NOP   0", "       DW    W#16#0600\n" * 500).replace("M3_2:  NOP   0", "M3_2:")
    source = source.replace("M3_2:", "M3_2:\n" + "       DW    W#16#0600\n" * 500)
    facts = [fact for fact in check_block(parse_block(assemble_block(source))) if fact.slug == "unknown_instruction"]
    assert len(facts) == 8
    assert "and 492 more of this kind" in facts[-1].text


@given(st.binary(max_size=600))
def test_any_octets_are_a_block_with_facts(octets: bytes) -> None:
    block = parse_block(octets)
    assert all_facts(block)
    assert len(block.code) <= len(octets)


@given(st.data())
def test_any_damage_to_a_block_is_borne(data: st.DataObject) -> None:
    octets = bytearray(data.draw(st.sampled_from([ob1(), fc5(), fb7()])))
    for _ in range(data.draw(st.integers(1, 6))):
        octets[data.draw(st.integers(0, len(octets) - 1))] = data.draw(st.integers(0, 255))
    block = parse_block(bytes(octets))
    all_facts(block)
    assert b"".join([instruction.octets for instruction in block.instructions]) == (
        block.code if block.has_code else b""
    )
    assert sum(len(network.instructions) for network in block.networks) == len(block.instructions)
    if block.header is not None and block.kind:
        assert assemble_block(block_source(block))[: len(octets)].startswith(b"pp")


def changed(drawn: tuple[bytes, int, int]) -> bytes:
    """Return octets with another one at a place, which counts from the start again behind the end."""
    octets, at, octet = bytearray(drawn[0]), drawn[1], drawn[2]
    octets[at % len(octets)] = octet
    return bytes(octets)


INTERFACES: Final = [parse_block(octets).interface_octets for octets in (ob1(), fc5(), fb7())]


@given(
    st.binary(max_size=200)
    | st.tuples(st.sampled_from(INTERFACES), st.integers(0, 100), st.integers(0, 255)).map(changed)
)
@example(INTERFACES[2])
def test_any_octets_are_an_interface_read_as_far_as_it_goes(octets: bytes) -> None:
    interface = parse_interface(octets)
    if not interface.fault and len(octets) >= 7:
        assert interface_octets(interface) == octets


@given(st.binary(max_size=200))
def test_any_octets_are_tables(octets: bytes) -> None:
    tables = parse_tables(octets)
    if not tables.cut:
        assert tables_octets(tables) == octets


def test_start_values_that_are_cut_off_are_told() -> None:
    octets = ob1()
    size = len(parse_block(octets).code)
    head = HEADER.size + size
    stated = octets[: head + 5] + (300).to_bytes(2, "little") + octets[head + 7 :]
    (fact,) = [fact for fact in all_facts(parse_block(stated)) if fact.slug == "interface"]
    assert "300 bytes of start values, 0 are there" in fact.text


def test_hostile_interfaces_are_bounded() -> None:
    nested = bytes((0x11, 0x04, 1)) * 20_000
    wide = bytes((0x11, 0x04, 0xFF, 0xFF, 0xFF)) + bytes((0x01, 0x04)) * 20_000
    array = bytes((0x10, 0x04, 0xFF)) + bytes.fromhex("0080ff7f") * 255 + b"\x05\x04"
    for declared in (nested, wide, array * 60, b"\x01\x05" * 32_767):
        octets = b"\x01\x00\x00" + min(len(declared), 0xFFFF).to_bytes(2, "little") + bytes(2) + declared
        begin = time.process_time()
        interface = parse_interface(octets)
        assert time.process_time() - begin < 5
        assert len(interface.declarations) <= 32_768


def test_hostile_tables_are_bounded() -> None:
    octets = bytearray(ob1())
    add = b"\xff\xff" + b"\x01\x00" * 20_000
    octets[30:32] = len(add).to_bytes(2, "big")
    block = parse_block(bytes(octets[:-36]) + add + bytes(octets[-36:]))
    assert len(block.networks) <= 0x8000
    assert {fact.slug for fact in all_facts(block)} >= {"lengths"}


@each(
    ("text", "words"),
    [
        ("A I 0.0\nFOO 1", "line 2: 'FOO' is not an instruction"),
        ("L MZ 1", "line 1: L does not take 'MZ 1'"),
        ("JU nowhere", "line 1: label nowhere is not defined"),
        ("x: A I 0.0\nx: BE", "line 2: label x occurs twice"),
        ("UC FC 1 (M 0.0)", "line 1: 'M 0.0' is not an address of a parameter"),
        ("SLD", ""),
        ("OPN", "line 1: OPN needs an operand"),
    ],
)
def test_the_assembler_says_what_is_wrong(text: str, words: str) -> None:
    if not words:
        assert assemble(text).code.hex() == "6813"
        return
    with pytest.raises(AssemblyError) as raised:
        assemble(text)
    assert words in str(raised.value)
