"""The layout of classic blocks: the worked examples, each as a source whose members say where they must be."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest

from dissect.meaning.tags.loading import TagSet, read_tags
from dissect.meaning.tags.model import Tag

# Name: (members of the block, types before it, "member place" pairs, octets of the block).
EXAMPLES: Final[dict[str, tuple[str, str, str, int]]] = {
    "bits, bytes and words": (
        "a,b:BOOL; c:BYTE; d:BOOL; e:INT; f:BOOL;",
        "",
        "a 0.0 b 0.1 c 1 d 2.0 e 4 f 6.0",
        8,
    ),
    "ten bits": (
        "b0,b1,b2,b3,b4,b5,b6,b7:BOOL; b8:BOOL; b9:BOOL; x:CHAR; w:WORD;",
        "",
        "b0 0.0 b7 0.7 b8 1.0 b9 1.1 x 2 w 4",
        6,
    ),
    "small structs": (
        "a:BYTE; s:STRUCT x:BOOL; END_STRUCT; t:STRUCT y:BYTE; END_STRUCT; b:BOOL;",
        "",
        "a 0 s.x 2.0 t.y 4 b 6.0",
        8,
    ),
    "bit arrays": (
        "f:ARRAY[0..9] OF BOOL; g:BOOL; h:ARRAY[1..3] OF BOOL; i:BYTE;",
        "",
        "f[0] 0.0 f[7] 0.7 f[8] 1.0 f[9] 1.1 g 2.0 h[1] 4.0 h[3] 4.2 i 6",
        8,
    ),
    "two dimensions of bits": (
        "m:ARRAY[1..2,1..3] OF BOOL; n:ARRAY[0..2,0..9] OF BOOL; o:BOOL;",
        "",
        "m[1,1] 0.0 m[1,3] 0.2 m[2,1] 1.0 m[2,3] 1.2 n[0,0] 2.0 n[0,9] 3.1 n[1,0] 4.0 n[2,0] 6.0 n[2,9] 7.1 o 8.0",
        10,
    ),
    "byte arrays": (
        "a:BYTE; p:ARRAY[1..3] OF BYTE; q:ARRAY[1..3] OF CHAR; r:ARRAY[1..2,1..3] OF BYTE; z:BYTE;",
        "",
        "a 0 p[1] 2 p[3] 4 q[1] 6 q[3] 8 r[1,1] 10 r[2,1] 13 r[2,3] 15 z 16",
        18,
    ),
    "strings": (
        "x:BYTE; s:STRING[5]; y:BYTE; t:STRING[4]; u:STRING; z:BOOL;",
        "",
        "x 0 s 2 y 9 t 10 u 16 z 272.0",
        274,
    ),
    "string arrays": (
        "s:ARRAY[1..3] OF STRING[5]; w:WSTRING[3]; c:CHAR; d:WCHAR;",
        "",
        "s[1] 0 s[2] 8 s[3] 16 w 24 c 34 d 36",
        38,
    ),
    "long types": (
        "b:BYTE; dt:DATE_AND_TIME; b2:BYTE; l:DTL; r:LREAL; i:LINT;",
        "",
        "b 0 dt 2 b2 10 l 12 r 24 i 32",
        40,
    ),
    "times": (
        "s:S5TIME; t:TIME; d:DATE; o:TIME_OF_DAY; b:BOOL; u:TIME;",
        "",
        "s 0 t 2 d 6 o 8 b 12.0 u 14",
        18,
    ),
    "array of structs": (
        "a:ARRAY[0..2] OF STRUCT x:BYTE; y:INT; z:BYTE; END_STRUCT; b:BYTE;",
        "",
        "a[0].x 0 a[0].y 2 a[0].z 4 a[1].x 6 a[1].y 8 a[1].z 10 a[2].x 12 a[2].y 14 a[2].z 16 b 18",
        20,
    ),
    "pointers": (
        "a:BOOL; p:POINTER; b:BOOL; q:ANY; c:BOOL;",
        "",
        "a 0.0 p 2 b 8.0 q 10 c 20.0",
        22,
    ),
    "nested types": (
        'f:BOOL; l:"Ln"; g:BOOL; v:ARRAY[1..2] OF "Ln";',
        (
            'TYPE "Ln" STRUCT a:"Pt"; b:"Pt"; n:BYTE; END_STRUCT; END_TYPE\n'
            'TYPE "Pt" STRUCT x:REAL; ok:BOOL; END_STRUCT; END_TYPE\n'
        ),
        "f 0.0 l.a.x 2 l.a.ok 6.0 l.b.x 8 l.b.ok 12.0 l.n 14 g 16.0 v[1].b.ok 28.0 v[1].n 30 v[2].a.x 32 v[2].n 44",
        46,
    ),
    "negative and three bounds": (
        "m:ARRAY[-1..1] OF INT; n:ARRAY[1..2,0..1,5..6] OF DINT;",
        "",
        "m[-1] 0 m[0] 2 m[1] 4 n[1,0,5] 6 n[1,0,6] 10 n[1,1,5] 14 n[2,0,5] 22 n[2,1,6] 34",
        38,
    ),
    "a queue of jobs": (
        "qFIFO:ARRAY[0..2] OF Job; pInsert:INT; pRemove:INT; fFull:BOOL; fEmpty:BOOL; lastDestination:INT;",
        "TYPE Job STRUCT a,b,c,d:REAL; e,f:TIME; g:INT; END_STRUCT END_TYPE\n",
        "qFIFO[0].a 0 qFIFO[1].a 26 qFIFO[2].a 52 pInsert 78 pRemove 80 fFull 82.0 fEmpty 82.1 lastDestination 84",
        86,
    ),
    "every type": (
        (
            "a:BOOL; b:BYTE; c:WORD; d:DWORD; e:LWORD; f:SINT; g:USINT; h:INT; i:UINT; j:DINT; k:UDINT; l:LINT; m:ULINT;"
            "n:REAL; o:LREAL; p:TIME; q:LTIME; r:DATE; s:TIME_OF_DAY; t:TOD; u:LTOD; v:LTOD; w:DATE_AND_TIME; x:DT; y:DTL;"
            "z:DTL; aa:CHAR; ab:WCHAR; ac:STRING; ad:WSTRING;"
        ),
        "",
        (
            "a 0.0 b 1 c 2 d 4 e 8 f 16 g 17 h 18 i 20 j 22 k 26 l 30 m 38 n 46 o 50 p 58 q 62 r 70 s 72 t 76 u 80 v 88 w 96 "
            "x 104 y 112 z 124 aa 136 ab 138 ac 140 ad 396"
        ),
        908,
    ),
}


def of_source(tmp_path: Path, text: str, name: str = "block.awl") -> TagSet:
    """Return the tags of a source."""
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return read_tags([path])


def placed(tags: list[Tag]) -> dict[str, str]:
    """Return where each element of each tag is, "4" or "4.1" for a bit."""
    found = {}
    for tag in tags:
        for number in range(tag.count):
            start = tag.start + number * tag.step
            bit = f".{start % 8}" if tag.kind == "BOOL" else ""
            found[tag.element(number).removeprefix("DB7.")] = f"{start // 8}{bit}"
    return found


@pytest.mark.parametrize("name", EXAMPLES)
def test_members_of_a_block_are_where_the_worked_examples_have_them(name: str, tmp_path: Path) -> None:
    members, types, places, size = EXAMPLES[name]
    found = of_source(tmp_path, f"{types}DATA_BLOCK DB 7\nSTRUCT {members} END_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n")
    assert [problem.text for problem in found.problems if problem.severity == "error"] == []
    words = places.split()
    expected = dict(zip(words[::2], words[1::2], strict=True))
    where = placed(found.tags)
    assert {name: where.get(name) for name in expected} == expected
    assert found.sizes == {7: size}


def test_what_no_cpu_settled_is_flagged_on_the_members_and_once_for_the_user(tmp_path: Path) -> None:
    found = of_source(
        tmp_path, "DATA_BLOCK DB 7 STRUCT a:INT; s:ARRAY[0..1] OF STRING[5]; b:INT; END_STRUCT; BEGIN END_DATA_BLOCK"
    )
    remarks = {tag.name: tag.remark for tag in found.tags}
    assert remarks["DB7.a"] == ""
    assert "no real CPU settled" in remarks["DB7.s"]
    assert "no real CPU settled" in remarks["DB7.b"]
    assert [problem.severity for problem in found.problems] == ["warning"]


def test_an_interface_lies_in_memory_in_the_order_of_its_sections_and_temporary_members_take_no_room(
    tmp_path: Path,
) -> None:
    found = of_source(
        tmp_path,
        'FUNCTION_BLOCK "Pump"\nVAR x:BYTE; END_VAR\nVAR_TEMP t:DINT; END_VAR\nVAR_OUTPUT q:BOOL; END_VAR\n'
        "VAR_INPUT RETAIN i:BOOL; v AT i:BYTE; END_VAR\nVAR_IN_OUT io:STRING[20]; END_VAR\nBEGIN\n"
        "NETWORK\nTITLE =it's\n      L 1;\nEND_FUNCTION_BLOCK\n"
        'DATA_BLOCK "PumpA"\nTITLE = "x" it\'s\n'
        "{ S7_Optimized_Access := 'FALSE' }\nVERSION : 0.1\n\"Pump\"\nBEGIN\nEND_DATA_BLOCK\n",
    )
    assert [problem.text for problem in found.problems] == [
        "DB 'PumpA' has no number: add --tags-db 'PumpA=10', or name the symbol table that has it too"
    ]
    path = tmp_path / "block.awl"
    numbered = read_tags([path], numbers={"pumpa": 3})
    assert placed(numbered.tags) == {"PumpA.i": "0.0", "PumpA.q": "2.0", "PumpA.x": "10"}
