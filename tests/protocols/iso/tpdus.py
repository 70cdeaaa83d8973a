"""TPDUs of every type and form, to the octet."""

from __future__ import annotations

from typing import Final

from dissect.protocols.iso.tables import AK, CC, CR, DC, DR, DT, EA, ED, ER, RJ

Fields = dict[str, int]
Parameters = list[tuple[int, str, int]]
ALL_PARAMETERS: Final = (
    "63ef12345678438504aabbccdd86030102038702000188080001000200030004890c0000010000020000030000048a020001"
    "8b02000a8c08000000010002000308040102030409020102c302abcdc40101c50155c60100c7021020f00101f204000003e8"
)
#: TPDUs of every type and form: type, octets, fixed part, parameters (code, value, offset), user data. Those of reference
#: section 8 are marked with the number of their frame there.
TPDUS: Final[list[tuple[str, str, Fields, Parameters, str]]] = [
    (
        "CR",  # frame 13: two-octet TSAPs
        "11e00000004b00c0010ac1020100c2020103",
        {"li": 17, "type": CR, "credit": 0, "dst_ref": 0, "src_ref": 0x4B, "class_": 0, "options": 0},
        [(0xC0, "0a", 7), (0xC1, "0100", 10), (0xC2, "0103", 14)],
        "",
    ),
    (
        "CC",  # frame 14
        "11d0004b000600c0010ac1020100c2020103",
        {"li": 17, "type": CC, "credit": 0, "dst_ref": 0x4B, "src_ref": 6, "class_": 0, "options": 0},
        [(0xC0, "0a", 7), (0xC1, "0100", 10), (0xC2, "0103", 14)],
        "",
    ),
    (
        "CR",  # frame 15: a text as TSAP
        "1fe00000011200c1020600c21053494d415449432d524f4f542d484d49c0010a",
        {"li": 31, "type": CR, "credit": 0, "dst_ref": 0, "src_ref": 0x112, "class_": 0, "options": 0},
        [(0xC1, "0600", 7), (0xC2, "53494d415449432d524f4f542d484d49", 11), (0xC0, "0a", 29)],
        "",
    ),
    (
        "DR",  # frame 16
        "06800112000082",
        {"li": 6, "type": DR, "credit": 0, "dst_ref": 0x112, "src_ref": 0, "reason": 0x82},
        [],
        "",
    ),
    (
        "DR",  # frame 17: additional information
        "0a800112000003e0020102",
        {"li": 10, "type": DR, "credit": 0, "dst_ref": 0x112, "src_ref": 0, "reason": 3},
        [(0xE0, "0102", 7)],
        "",
    ),
    ("DC", "05c00006004b", {"li": 5, "type": DC, "credit": 0, "dst_ref": 6, "src_ref": 0x4B}, [], ""),  # frame 18
    (
        "ER",  # frame 19: the rejected header
        "0870004b01c10211e0",
        {"li": 8, "type": ER, "credit": 0, "dst_ref": 0x4B, "cause": 1},
        [(0xC1, "11e0", 5)],
        "",
    ),
    (
        "CR",  # frame 20: class 2, class 0 as alternative
        "17e00000002121c0010bc1020100c2020102c60101c70100",
        {"li": 23, "type": CR, "credit": 0, "dst_ref": 0, "src_ref": 0x21, "class_": 2, "options": 1},
        [(0xC0, "0b", 7), (0xC1, "0100", 10), (0xC2, "0102", 14), (0xC6, "01", 18), (0xC7, "00", 21)],
        "",
    ),
    (
        "DT",  # frame 21: normal form of class 2
        "04f00021830102030405060708",
        {"li": 4, "type": DT, "credit": 0, "dst_ref": 0x21, "eot": 1, "tpdu_nr": 3},
        [],
        "0102030405060708",
    ),
    ("AK", "0462002104", {"li": 4, "type": AK, "credit": 2, "dst_ref": 0x21, "next_nr": 4}, [], ""),  # frame 22
    ("RJ", "0451002102", {"li": 4, "type": RJ, "credit": 1, "dst_ref": 0x21, "next_nr": 2}, [], ""),  # frame 23
    (
        "ED",  # frame 24
        "04100021800102",
        {"li": 4, "type": ED, "credit": 0, "dst_ref": 0x21, "eot": 1, "tpdu_nr": 0},
        [],
        "0102",
    ),
    ("EA", "0420002100", {"li": 4, "type": EA, "credit": 0, "dst_ref": 0x21, "next_nr": 0}, [], ""),  # frame 25
    (
        "DT",  # frame 99: the first of two fragments
        "02f000320100002400000e00000401",
        {"li": 2, "type": DT, "credit": 0, "eot": 0, "tpdu_nr": 0},
        [],
        "320100002400000e00000401",
    ),
    (
        "DT",  # frame 100: the second
        "02f080120a10020010000184000000",
        {"li": 2, "type": DT, "credit": 0, "eot": 1, "tpdu_nr": 0},
        [],
        "120a10020010000184000000",
    ),
    ("DT", "02f000", {"li": 2, "type": DT, "credit": 0, "eot": 0, "tpdu_nr": 0}, [], ""),  # frame 101: the empty DT
    ("DT", "02f080", {"li": 2, "type": DT, "credit": 0, "eot": 1, "tpdu_nr": 0}, [], ""),  # an empty TSDU
    ("DT", "02f1aa32", {"li": 2, "type": DT, "credit": 1, "eot": 1, "tpdu_nr": 0x2A}, [], "32"),
    (
        "DT",  # the extended form of classes 2 to 4
        "07f00021800000053201",
        {"li": 7, "type": DT, "credit": 0, "dst_ref": 0x21, "eot": 1, "tpdu_nr": 5},
        [],
        "3201",
    ),
    (
        "DT",  # the normal form with a checksum
        "08f0002183c302abcd32",
        {"li": 8, "type": DT, "credit": 0, "dst_ref": 0x21, "eot": 1, "tpdu_nr": 3},
        [(0xC3, "abcd", 5)],
        "32",
    ),
    (
        "DT",  # the extended form with a checksum
        "0bf000217fffffffc302abcd32",
        {"li": 11, "type": DT, "credit": 0, "dst_ref": 0x21, "eot": 0, "tpdu_nr": 0x7FFFFFFF},
        [(0xC3, "abcd", 8)],
        "32",
    ),
    ("ED", "02108001", {"li": 2, "type": ED, "credit": 0, "eot": 1, "tpdu_nr": 0}, [], "01"),  # the form of RFC 1006
    (
        "ED",
        "071000218000000901",
        {"li": 7, "type": ED, "credit": 0, "dst_ref": 0x21, "eot": 1, "tpdu_nr": 9},
        [],
        "01",
    ),
    (
        "AK",
        "0960002100000004000f",
        {"li": 9, "type": AK, "credit": 0, "dst_ref": 0x21, "next_nr": 4, "credit_extended": 15},
        [],
        "",
    ),
    (
        "AK",  # normal form with a checksum
        "0862002104c302abcd",
        {"li": 8, "type": AK, "credit": 2, "dst_ref": 0x21, "next_nr": 4},
        [(0xC3, "abcd", 5)],
        "",
    ),
    (
        "AK",  # extended form with a checksum
        "0d60002100000004000fc302abcd",
        {"li": 13, "type": AK, "credit": 0, "dst_ref": 0x21, "next_nr": 4, "credit_extended": 15},
        [(0xC3, "abcd", 10)],
        "",
    ),
    (
        "RJ",
        "0950002100000002000f",
        {"li": 9, "type": RJ, "credit": 0, "dst_ref": 0x21, "next_nr": 2, "credit_extended": 15},
        [],
        "",
    ),
    ("EA", "0720002100000001", {"li": 7, "type": EA, "credit": 0, "dst_ref": 0x21, "next_nr": 1}, [], ""),
    (
        "EA",
        "0820002101c302abcd",
        {"li": 8, "type": EA, "credit": 0, "dst_ref": 0x21, "next_nr": 1},
        [(0xC3, "abcd", 5)],
        "",
    ),
    (
        "CR",  # user data, which RFC 1006 tolerates for tests
        "06e00000004b00cafe",
        {"li": 6, "type": CR, "credit": 0, "dst_ref": 0, "src_ref": 0x4B, "class_": 0, "options": 0},
        [],
        "cafe",
    ),
    (
        "CR",  # everything that X.224 defines for parameters
        ALL_PARAMETERS,
        {"li": 99, "type": CR, "credit": 15, "dst_ref": 0x1234, "src_ref": 0x5678, "class_": 4, "options": 3},
        [
            (0x85, "aabbccdd", 7),
            (0x86, "010203", 13),
            (0x87, "0001", 18),
            (0x88, "0001000200030004", 22),
            (0x89, "000001000002000003000004", 32),
            (0x8A, "0001", 46),
            (0x8B, "000a", 50),
            (0x8C, "0000000100020003", 54),
            (0x08, "01020304", 64),
            (0x09, "0102", 70),
            (0xC3, "abcd", 74),
            (0xC4, "01", 78),
            (0xC5, "55", 81),
            (0xC6, "00", 84),
            (0xC7, "1020", 87),
            (0xF0, "01", 91),
            (0xF2, "000003e8", 94),
        ],
        "",
    ),
]
