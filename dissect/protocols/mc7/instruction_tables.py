"""The instructions of MC7, one row each; disassembler, assembler, docs and tests all use these rows.

If several forms can encode an operand, the assembler takes the first one; short forms come first, as in STEP 7. Source:
reference sheet mc7.md, section 5; names in both languages: section 7; content of real blocks: section 5.6.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.protocols.mc7.operands import (
    JUMP_LIST,
    Bit,
    Constant,
    Count,
    Fixed,
    Indexed,
    Jump,
    LongNumber,
    NumberVia,
    Parameter,
    Plain,
    Pointer,
    PointerPlace,
    Shape,
    Short,
    ShortBit,
    ShortConstant,
    ShortNumber,
    Via,
    Wide,
)

# Whether an instruction has a parameter list or a jump list.
NO_LIST: Final = 0
CALL_LIST: Final = 1  # a jump over the addresses of parameters follows

#: How certain a row is: "C" confirmed by all real blocks of the sheet, "2" two sources agree, "1" one source.
SURE: Final = "C"
TWO_SOURCES: Final = "2"
ONE_SOURCE: Final = "1"


class Row(NamedTuple):
    """One instruction in one operand form.

    ``firsts`` are its possible first bytes (eight if they include a bit number), ``seconds`` the possible second bytes.
    ``size`` is in bytes, without a parameter list; ``list`` is one of the constants above.
    """

    firsts: range
    seconds: frozenset[int]
    size: int
    name: str
    shape: Shape
    list: int = NO_LIST


def _one(number: int) -> range:
    return range(number, number + 1)


_ANY: Final = frozenset(range(256))
_LOW: Final = frozenset(range(0x80))
_HIGH: Final = frozenset(range(0x80, 0x100))
_PLACES: Final = range(3, 7)
_BIT_AREAS: Final = range(1, 7)
_TESTS: Final = ("A", "AN", "O", "ON", "X", "XN")
_TIMERS: Final = (*_TESTS, "L", "", "FR", "LC", "SF", "SE", "SD", "SS", "SP", "R")
_COUNTERS: Final = (*_TESTS, "L", "", "FR", "LC", "CD", "S", "CU", "", "", "R")
_SETTERS: Final = ((0, "S"), (1, "R"), (2, "="), (4, "FP"), (5, "FN"))
#: Low nibble of a load (a transfer has 4 more), and the width in bytes.
_MOVES: Final = ((1, 1), (2, 2), (3, 4))


def _pairs(highs: range, lows: range) -> frozenset[int]:
    return frozenset(high << 4 | low for high in highs for low in lows)


def _shifted(numbers: range, by: int) -> range:
    return range(numbers.start + by, numbers.stop + by)


def _short(first: int, name: str, shape: Shape, seconds: frozenset[int] = _ANY, listed: int = NO_LIST) -> Row:
    return Row(_one(first), seconds, 2, name, shape, listed)


def _plain(first: int, second: int, name: str) -> Row:
    return Row(_one(first), frozenset((second,)), 2, name, Plain(second))


def _fixed(first: int, second: int, name: str, operand: str) -> Row:
    return Row(_one(first), frozenset((second,)), 2, name, Fixed(second, operand))


def _word(first: int, second: int, name: str, shape: Shape, size: int = 4, listed: int = NO_LIST) -> Row:
    return Row(_one(first), frozenset((second,)), size, name, shape, listed)


def _short_rows() -> list[Row]:
    """Section 5.1: the operand is in the second byte."""
    rows: list[Row] = []
    for first, name, area in (
        (0x02, "L", "T"), (0x04, "FR", "T"), (0x0C, "LC", "T"), (0x14, "SF", "T"), (0x1C, "SE", "T"), (0x24, "SD", "T"),
        (0x2C, "SS", "T"), (0x34, "SP", "T"), (0x3C, "R", "T"), (0xF8, "A", "T"), (0xF9, "O", "T"), (0xFC, "AN", "T"),
        (0xFD, "ON", "T"), (0x42, "L", "C"), (0x44, "FR", "C"), (0x4C, "LC", "C"), (0x54, "CD", "C"), (0x5C, "S", "C"),
        (0x6C, "CU", "C"), (0x7C, "R", "C"), (0xB8, "A", "C"), (0xB9, "O", "C"), (0xBC, "AN", "C"), (0xBD, "ON", "C"),
        (0x20, "OPN", "DB"), (0x55, "CC", "FB"), (0x75, "UC", "FB"),
    ):
        rows.append(_short(first, name, ShortNumber(area)))
    rows += [_short(0x1D, "CC", ShortNumber("FC"), _ANY, CALL_LIST), _short(0x3D, "UC", ShortNumber("FC"), _ANY,
            CALL_LIST)]
    for first, name in ((0x10, "BLD"), (0x11, "INC"), (0x19, "DEC"), (0x29, "SLD"), (0x61, "SLW"), (0x64, "RLD"),
                        (0x69, "SRW"), (0x71, "SSD"), (0x74, "RRD")):
        rows.append(_short(first, name, Count()))
    for first, name, width in ((0x0A, "L", 1), (0x0B, "T", 1), (0x12, "L", 2), (0x13, "T", 2), (0x1A, "L", 4), (0x1B,
            "T", 4)):
        rows.append(_short(first, name, Short("M", width)))
    for first, name, width in ((0x4A, "L", 1), (0x4B, "T", 1), (0x52, "L", 2), (0x53, "T", 2), (0x5A, "L", 4), (0x5B,
            "T", 4)):
        rows.append(_short(first, name, Short("I", width, 0, 127), _LOW))
        rows.append(_short(first, name, Short("Q", width, 128, 127), _HIGH))
    rows.append(_short(0x28, "L", ShortConstant()))
    for number, name in enumerate(("A", "O", "S", "=", "AN", "ON", "R")):
        rows.append(Row(range(0x80 + 8 * number, 0x88 + 8 * number), _ANY, 2, name, ShortBit("M")))
        firsts = range(0xC0 + 8 * number, 0xC8 + 8 * number)
        rows.append(Row(firsts, _LOW, 2, name, ShortBit("I", 0, 127)))
        rows.append(Row(firsts, _HIGH, 2, name, ShortBit("Q", 128, 127)))
    rows.append(_short(0xFE, "SRD", Count(0xC0, 1, 31), frozenset(range(0xC0, 0xE0))))
    rows.append(_short(0x68, "SSI", Count(0x01, 0x10, 15), frozenset(range(0x01, 0x100, 0x10))))
    return rows


def _bit_rows() -> list[Row]:
    """Section 5.2: bits by address, through memory and through address registers; nesting and status bits."""
    rows: list[Row] = []
    for first, name, other in ((0x00, "A", "AN"), (0x01, "O", "ON"), (0x05, "X", "XN"), (0x09, "S", "R"), (0x41, "=",
            ""),
                               (0x49, "FP", "FN")):
        rows.append(Row(_one(first), _pairs(_BIT_AREAS, range(8)), 4, name, Bit(0)))
        if other:
            rows.append(Row(_one(first), _pairs(_shifted(_BIT_AREAS, 8), range(8)), 4, other, Bit(8)))
    for first, names in ((0x51, ("A", "O", "AN", "ON")), (0x58, ("X", "S", "XN", "R")), (0x59, ("=", "FP", "", "FN"))):
        for number, name in enumerate(names):
            high, low = number // 2 * 8, number % 2 * 8
            if name:
                seconds = _pairs(_shifted(_PLACES, high), _shifted(_BIT_AREAS, low))
                rows.append(Row(_one(first), seconds, 4, name, Via(0, high, low)))
    for register, low in (("AR1", 0), ("AR2", 8)):
        for number, name in enumerate(_TESTS):
            seconds = _pairs(_BIT_AREAS, range(low + number, low + number + 1))
            rows.append(Row(_one(0x79), seconds, 4, name, Indexed(register, 0, 0, low + number)))
            rows.append(_word(0xFB, 0x10 + low + number, name, Indexed(register, 0, 1, low + number, True)))
        for number, name in _SETTERS:
            seconds = _pairs(_shifted(_BIT_AREAS, 8), range(low + number, low + number + 1))
            rows.append(Row(_one(0x79), seconds, 4, name, Indexed(register, 0, 8, low + number)))
            rows.append(_word(0xFB, 0x20 + low + number, name, Indexed(register, 0, 2, low + number, True)))
    rows += [_plain(0xBA, 0, "A("), _plain(0xBB, 0, "O("), _plain(0xBF, 0, ")"), _plain(0xFB, 0, "O"), _plain(0xFF,
            0xF1, "AN("),
             _plain(0xFF, 0xF3, "ON("), _plain(0xFF, 0xF4, "X("), _plain(0xFF, 0xF5, "XN(")]
    for high, bit in ((0x0, "OS"), (0x1, "OV"), (0x2, ">0"), (0x4, "<0"), (0x5, "UO"), (0x6, "<>0"), (0x8, "==0"),
            (0xA, ">=0"),
                      (0xC, "<=0"), (0xE, "BR")):
        rows += [_fixed(0xFF, high << 4 | low, name, bit) for low, name in enumerate(_TESTS)]
    return rows


def _word_rows() -> list[Row]:
    """Section 5.2: words, compares, arithmetic, accumulators, the end of a block."""
    rows = [_fixed(0x00, 0, "NOP", "0"), _fixed(0xFF, 0xFF, "NOP", "1"), _plain(0x01, 0, "INVI"), _plain(0x09, 0,
            "NEGI"),
            _plain(0x41, 0, "AW"), _plain(0x49, 0, "OW"), _plain(0x51, 0, "XOW"), _plain(0x59, 0, "-I"), _plain(0x79,
                    0, "+I"),
            _word(0x58, 0, "+", Constant(0, "", 2)), _word(0x60, 5, "+", Constant(5, "L#", 4), 6)]
    for first, kind in ((0x21, "I"), (0x39, "D"), (0x31, "R")):
        for second, sign in ((0x20, ">"), (0x40, "<"), (0x60, "<>"), (0x80, "=="), (0xA0, ">="), (0xC0, "<=")):
            rows.append(_plain(first, second, sign + kind))
    for second, name in (
        (0x00, "/I"), (0x01, "MOD"), (0x02, "ABS"), (0x03, "/R"), (0x04, "*I"), (0x06, "NEGR"), (0x07, "*R"), (0x08,
                "ENT"),
        (0x09, "-D"), (0x0A, "*D"), (0x0B, "-R"), (0x0D, "+D"), (0x0E, "/D"), (0x0F, "+R"), (0x10, "SIN"), (0x11,
                "COS"),
        (0x12, "TAN"), (0x13, "LN"), (0x14, "SQRT"), (0x18, "ASIN"), (0x19, "ACOS"), (0x1A, "ATAN"), (0x1B, "EXP"),
        (0x1C, "SQR"),
    ):
        rows.append(_plain(0x60, second, name))
    for second, name in (
        (0x06, "DTR"), (0x07, "NEGD"), (0x08, "ITB"), (0x0A, "DTB"), (0x0C, "BTI"), (0x0D, "INVD"), (0x0E, "BTD"),
        (0x12, "SLW"), (0x13, "SLD"), (0x17, "RLD"), (0x18, "RLDA"), (0x1A, "CAW"), (0x1B, "CAD"), (0x1C, "CLR"),
        (0x1D, "SET"), (0x1E, "ITD"), (0x22, "SRW"), (0x23, "SRD"), (0x24, "SSI"), (0x25, "SSD"), (0x27, "RRD"),
        (0x28, "RRDA"), (0x2C, "SAVE"), (0x2D, "NOT"), (0x2E, "PUSH"), (0x37, "AD"), (0x3A, "MCRA"), (0x3B, "MCRD"),
        (0x3C, "MCR("), (0x3D, ")MCR"), (0x3E, "POP"), (0x47, "OD"), (0x4E, "LEAVE"), (0x57, "XOD"), (0x5C, "RND"),
        (0x5D, "RND-"), (0x5E, "RND+"), (0x5F, "TRUNC"),
    ):
        rows.append(_plain(0x68, second, name))
    for second, name in ((0x34, "AW"), (0x44, "OW"), (0x54, "XOW")):
        rows.append(_word(0x68, second, name, Constant(second, "W#16#", 2)))
        rows.append(_word(0x68, second + 2, name[:-1] + "D", Constant(second + 2, "DW#16#", 4), 6))
    rows += [_plain(0x65, 0, "BE"), _plain(0x65, 1, "BEU"), _plain(0x05, 0, "BEC"), _plain(0x70, 2, "TAK"),
             _fixed(0x70, 6, "L", "STW"), _fixed(0x70, 7, "T", "STW")]
    return rows


def _move_rows() -> list[Row]:
    """Section 5.3: load and transfer, constants, address registers."""
    rows: list[Row] = []
    for name, step, periphery in (("L", 0, "PI"), ("T", 4, "PQ")):
        for low, width in _MOVES:
            rows.append(Row(_one(0x7E), _pairs(range(7), range(low + step, low + step + 1)), 4, name, Wide(width,
                    low + step, periphery)))
            for register, beside in (("AR1", 0), ("AR2", 8)):
                nibble = low + step + beside
                rows.append(Row(_one(0xBE), _pairs(range(7), range(nibble, nibble + 1)), 4, name,
                                Indexed(register, width, 0, nibble, False, periphery)))
                rows.append(_word(0xFB, nibble, name, Indexed(register, width, 0, nibble, True)))
        for first, width, beside in ((0xBA, 1, 0), (0xBB, 2, 0), (0xBB, 4, 8)):
            seconds = _pairs(_shifted(_PLACES, 2 * step), range(beside, beside + 7))
            rows.append(Row(_one(first), seconds, 4, name, Via(width, 2 * step, beside, periphery)))
    for second, kind in ((0x07, "W#16#"), (0x02, "2#"), (0x03, ""), (0x05, "'"), (0x06, "B#("), (0x08, "C#"), (0x0A,
            "D#"),
                         (0x0C, "S5T#"), (0x00, "W#16#")):
        rows.append(_word(0x30, second, "L", Constant(second, kind, 2)))
    for second, kind in ((0x01, "REAL"), (0x02, "2#"), (0x03, "L#"), (0x05, "'"), (0x06, "B#("), (0x07, "DW#16#"),
            (0x09, "T#"),
                         (0x0B, "TOD#")):
        rows.append(_word(0x38, second, "L", Constant(second, kind, 4), 6))
    rows.append(_word(0x38, 0x04, "L", Pointer(0x04, 4), 6))
    rows += [_fixed(0xFB, 0x3C, "L", "DBLG"), _fixed(0xFB, 0x3D, "L", "DILG"), _fixed(0xFB, 0x4C, "L", "DBNO"),
             _fixed(0xFB, 0x4D, "L", "DINO"), _plain(0xFB, 0x7C, "CDB")]
    rows += [_fixed(0xFE, 0x01, "LAR1", "AR2"), _plain(0xFE, 0x04, "LAR1"), _plain(0xFE, 0x05, "TAR1"), _plain(0xFE,
            0x06, "+AR1"),
             _plain(0xFE, 0x08, "CAR"), _fixed(0xFE, 0x09, "TAR1", "AR2"), _plain(0xFE, 0x0C, "LAR2"), _plain(0xFE,
                     0x0D, "TAR2"),
             _plain(0xFE, 0x0E, "+AR2"), _word(0xFE, 0x02, "+AR1", Pointer(0x02, 2)), _word(0xFE, 0x0A, "+AR2",
                     Pointer(0x0A, 2)),
             _word(0xFE, 0x03, "LAR1", Pointer(0x03, 4), 6), _word(0xFE, 0x0B, "LAR2", Pointer(0x0B, 4), 6)]
    for low, name in ((0x3, "LAR1"), (0x7, "TAR1"), (0xB, "LAR2"), (0xF, "TAR2")):
        rows.append(Row(_one(0xFE), _pairs(_PLACES, range(low, low + 1)), 4, name, PointerPlace(low)))
    return rows


def _object_rows() -> list[Row]:
    """Section 5.4: timers, counters, formal parameters, blocks."""
    rows: list[Row] = []
    for area, names, high, indirect in (("T", _TIMERS, 0xE, 0), ("C", _COUNTERS, 0xF, 8)):
        for low, name in enumerate(names):
            if not name:
                continue
            rows.append(_word(0xFB, high << 4 | low, name, LongNumber(high << 4 | low, area)))
            seconds = _pairs(_shifted(_PLACES, indirect), range(low, low + 1))
            rows.append(Row(_one(0xBF), seconds, 4, name, NumberVia(low, area, indirect)))
            formal = 0xA0 if area == "T" else 0xB0
            rows.append(_word(0xFB, formal | low, name, Parameter(formal | low, area)))
    for low, name in ((0, "A"), (1, "AN"), (2, "O"), (3, "ON"), (4, "X"), (5, "XN")):
        rows.append(_word(0xFB, 0x80 | low, name, Parameter(0x80 | low, "BOOL")))
    for low, name in ((0, "S"), (1, "R"), (2, "="), (4, "FP"), (5, "FN")):
        rows.append(_word(0xFB, 0x90 | low, name, Parameter(0x90 | low, "BOOL")))
    for low, used in ((1, "BYTE"), (2, "WORD"), (3, "DWORD")):
        rows.append(_word(0xFB, 0xC0 | low, "L", Parameter(0xC0 | low, used)))
        rows.append(_word(0xFB, 0xC4 | low, "T", Parameter(0xC4 | low, used)))
    rows += [_word(0xFB, 0xCB, "L", Parameter(0xCB, "P##")), _word(0xFB, 0xCA, "L", Parameter(0xCA, "P##")),
             _word(0xFB, 0xD0, "UC", Parameter(0xD0, "FC"), 4, CALL_LIST), _word(0xFB, 0xD2, "UC", Parameter(0xD2,
                     "FB")),
             _word(0xFB, 0xD8, "OPN", Parameter(0xD8, "DB")), _word(0xFB, 0xD9, "OPN", Parameter(0xD9, "DI"))]
    for low, name, area, listed in ((0, "UC", "FC", CALL_LIST), (1, "CC", "FC", CALL_LIST), (2, "UC", "FB", NO_LIST),
                                    (3, "CC", "FB", NO_LIST), (8, "OPN", "DB", NO_LIST), (9, "OPN", "DI", NO_LIST)):
        rows.append(_word(0xFB, 0x70 | low, name, LongNumber(0x70 | low, area), 4, listed))
        rows.append(Row(_one(0xFB), _pairs(_PLACES, range(low, low + 1)), 4, name, NumberVia(low, area), listed))
    rows += [_word(0xFB, 0x74, "UC", LongNumber(0x74, "SFC"), 4, CALL_LIST), _word(0xFB, 0x76, "UC", LongNumber(0x76,
            "SFB"))]
    return rows


#: Jumps whose targets are in the jump list of a block.
JU: Final = "JU"
JL: Final = "JL"


def _jump_rows() -> list[Row]:
    """Section 5.5."""
    rows = [_word(0x70, 0x0B, JU, Jump(0x0B)), _word(0x70, 0x09, JL, Jump(0x09, JUMP_LIST)), _word(0x70, 0x08,
            "LOOP", Jump(0x08))]
    for second, name in (
        (0x08, "JOS"), (0x18, "JO"), (0x28, "JP"), (0x48, "JM"), (0x58, "JUO"), (0x68, "JN"), (0x78, "JNBI"), (0x88,
                "JZ"),
        (0x98, "JNB"), (0xA8, "JPZ"), (0xB8, "JCN"), (0xC8, "JMZ"), (0xD8, "JCB"), (0xE8, "JBI"), (0xF8, "JC"),
    ):
        rows.append(_word(0xFF, second, name, Jump(second)))
    return rows


#: Every instruction.
INSTRUCTIONS: Final = (*_short_rows(), *_bit_rows(), *_word_rows(), *_move_rows(), *_object_rows(), *_jump_rows())

#: Second bytes seen in real blocks, for those first bytes that have many instructions (section 5.6).
_MET: Final[dict[int, frozenset[int]]] = {
    0x60: frozenset((*range(0x08), 0x09, 0x0A, 0x0B, 0x0D, 0x0E, 0x0F, 0x13, 0x1C)),
    0x68: frozenset((0x06, 0x07, 0x08, 0x0A, 0x0C, 0x0D, 0x12, 0x13, *range(0x1A, 0x1F), 0x22, 0x23, 0x24, 0x2C,
            0x2D, 0x2E,
                     0x34, 0x36, 0x37, 0x3E, 0x44, 0x46, 0x47, 0x57, 0x5C, 0x5F)),
    0x70: frozenset((0x02, 0x08, 0x09, 0x0B)),
    0xFF: frozenset((0x11, 0xE0, 0xE4, 0xF3, 0xF4, 0xFF, 0x18, 0x28, 0x68, 0x88, 0x98, 0xA8, 0xB8, 0xF8)),
    0xFE: frozenset((*range(0x02, 0x07), *range(0x0A, 0x0F), 0x53, 0x5B, 0x63, 0x67, 0x6B, 0x6F, *range(0xC0, 0xE0))),
    0x30: frozenset((0x00, 0x02, 0x03, 0x05, 0x07, 0x08, 0x0A, 0x0C)),
    0x38: frozenset((0x01, 0x03, 0x04, 0x07, 0x09, 0x0B)),
    0xFB: frozenset((*range(0x04), 0x05, 0x06, 0x07, 0x09, 0x0A, 0x0B, *range(0x0D, 0x13), 0x18, 0x20, 0x21, 0x22,
            0x2A, 0x38,
                     0x3C, 0x4C, 0x4D, 0x58, 0x60, *range(0x68, 0x71), 0x74, 0x76, *range(0x78, 0x85), 0x90, 0x91,
                             0x92, 0xA0,
                     0xA1, 0xAA, 0xAB, 0xAC, 0xAF, 0xC1, 0xC2, 0xC3, 0xC5, 0xC6, 0xC7, 0xCB, 0xD0, 0xD2, 0xD8, 0xD9,
                             0xE0, 0xEC)),
}
#: First bytes never seen in real blocks.
_UNMET: Final = frozenset((0x04, 0x0C, 0x44, 0x55, 0x71, 0x74, 0xB8, 0xB9, 0xBC, 0xBD, 0xD2, 0xD7, 0xF2, 0xF3, 0xF7))
#: Instructions known from one source only.
_SINGLE: Final = frozenset((0xFBCA,))


def confidence(first: int, second: int) -> str:
    """Return how certain the meaning of the two first bytes is (`SURE`, `TWO_SOURCES`, `ONE_SOURCE`)."""
    if first << 8 | second in _SINGLE:
        return ONE_SOURCE
    met = _MET.get(first)
    return SURE if (first not in _UNMET if met is None else second in met) else TWO_SOURCES


#: English names and the German ones, if these differ.
GERMAN: Final[dict[str, str]] = {
    "A": "U", "AN": "UN", "A(": "U(", "AN(": "UN(", "OPN": "AUF", "JU": "SPA", "JC": "SPB", "JCN": "SPBN",
            "JCB": "SPBB",
    "JNB": "SPBNB", "JBI": "SPBI", "JNBI": "SPBIN", "JO": "SPO", "JOS": "SPS", "JZ": "SPZ", "JN": "SPN", "JP": "SPP",
    "JM": "SPM", "JPZ": "SPPZ", "JMZ": "SPMZ", "JUO": "SPU", "JL": "SPL", "BEU": "BEA", "BEC": "BEB", "SP": "SI",
            "SE": "SV",
    "SD": "SE", "SF": "SA", "CU": "ZV", "CD": "ZR", "CAR": "TAR", "CAW": "TAW", "CAD": "TAD", "CDB": "TDB", "AW": "UW",
    "AD": "UD",
}  # fmt: skip
ENGLISH: Final = {german: english for english, german in GERMAN.items()}

#: The effect of each instruction.
MEANINGS: Final[dict[str, str]] = {
    "A": "AND", "AN": "AND NOT", "O": "OR", "ON": "OR NOT", "X": "exclusive OR", "XN": "exclusive OR NOT",
    "S": "set, or preset a counter", "R": "reset", "=": "assign", "FP": "rising edge", "FN": "falling edge",
    "A(": "AND, open a bracket", "AN(": "AND NOT, open a bracket", "O(": "OR, open a bracket",
    "ON(": "OR NOT, open a bracket", "X(": "exclusive OR, open a bracket", "XN(": "exclusive OR NOT, open a bracket",
    ")": "close a bracket", "NOT": "negate the RLO", "SET": "RLO = 1", "CLR": "RLO = 0", "SAVE": "RLO to BR",
    "L": "load into ACCU 1", "T": "transfer ACCU 1", "LC": "load as BCD", "FR": "enable again",
    "SF": "start timer as off delay", "SE": "start timer as extended pulse", "SD": "start timer as on delay",
    "SS": "start timer as retentive on delay", "SP": "start timer as pulse", "CD": "count down", "CU": "count up",
    "NOP": "no operation", "BLD": "mark for the programming tool, no effect", "INVI": "ones' complement, 16 bits",
    "INVD": "ones' complement, 32 bits", "NEGI": "negate INT", "NEGD": "negate DINT", "NEGR": "negate REAL",
    "AW": "AND word", "OW": "OR word", "XOW": "exclusive OR word", "AD": "AND double word", "OD": "OR double word",
    "XOD": "exclusive OR double word", "+": "add a constant", "+I": "add INT", "-I": "subtract INT",
    "*I": "multiply INT", "/I": "divide INT", "+D": "add DINT", "-D": "subtract DINT", "*D": "multiply DINT",
    "/D": "divide DINT", "MOD": "remainder of DINT", "+R": "add REAL", "-R": "subtract REAL", "*R": "multiply REAL",
    "/R": "divide REAL", "ABS": "absolute value", "SQR": "square", "SQRT": "square root", "EXP": "exponential",
    "LN": "natural logarithm", "SIN": "sine", "COS": "cosine", "TAN": "tangent", "ASIN": "arc sine",
    "ACOS": "arc cosine", "ATAN": "arc tangent", "INC": "increment ACCU 1-LL", "DEC": "decrement ACCU 1-LL",
    "SLW": "shift word left", "SRW": "shift word right", "SLD": "shift double word left",
    "SRD": "shift double word right", "SSI": "shift INT right", "SSD": "shift DINT right",
    "RLD": "rotate double word left", "RRD": "rotate double word right", "RLDA": "rotate left through CC 1",
    "RRDA": "rotate right through CC 1", "DTR": "DINT to REAL", "ITB": "INT to BCD", "DTB": "DINT to BCD",
    "BTI": "BCD to INT", "BTD": "BCD to DINT", "ITD": "INT to DINT", "RND": "REAL to DINT, rounded",
    "RND-": "REAL to DINT, downward", "RND+": "REAL to DINT, upward", "TRUNC": "REAL to DINT, cut off",
    "CAW": "swap the bytes of a word", "CAD": "swap the bytes of a double word", "PUSH": "ACCU 1 to ACCU 2",
    "POP": "ACCU 2 to ACCU 1", "TAK": "swap ACCU 1 and ACCU 2", "ENT": "ACCU 3 to 4, ACCU 2 to 3",
    "LEAVE": "ACCU 3 to 2, ACCU 4 to 3", "MCRA": "activate the master control relay",
    "MCRD": "deactivate the master control relay", "MCR(": "begin a zone of the master control relay",
    ")MCR": "end a zone of the master control relay", "BE": "end of the block", "BEU": "end the block",
    "BEC": "end the block if RLO = 1", "OPN": "open a data block", "CDB": "swap the open DB and DI", "UC": "call",
    "CC": "call if RLO = 1", "LAR1": "load AR1", "LAR2": "load AR2", "TAR1": "transfer AR1", "TAR2": "transfer AR2",
    "+AR1": "add to AR1", "+AR2": "add to AR2", "CAR": "swap AR1 and AR2", "JU": "jump",
    "JL": "jump by a list: entry ACCU 1-LL", "LOOP": "decrement, jump if not 0", "JC": "jump if RLO = 1",
    "JCN": "jump if RLO = 0", "JCB": "jump if RLO = 1, save RLO in BR", "JNB": "jump if RLO = 0, save RLO in BR",
    "JBI": "jump if BR = 1", "JNBI": "jump if BR = 0", "JO": "jump on overflow", "JOS": "jump on stored overflow",
    "JZ": "jump if zero", "JN": "jump if not zero", "JP": "jump if positive", "JM": "jump if negative",
    "JPZ": "jump if positive or zero", "JMZ": "jump if negative or zero", "JUO": "jump if unordered",
    **{
        sign + kind: f"compare {name}"
        for sign in (">", "<", "<>", "==", ">=", "<=")
        for kind, name in (("I", "INT"), ("D", "DINT"), ("R", "REAL"))
    },
}  # fmt: skip
