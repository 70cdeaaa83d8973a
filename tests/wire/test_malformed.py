from __future__ import annotations

import ast
from pathlib import Path

import pytest

import dissect
from dissect.wire.malformed import LIMITS, REASONS, Malformed

FACT = Malformed("cotp", "length_beyond", "li", 4, 18, 9, "tpkt")


@pytest.mark.parametrize(
    ("fact", "text"),
    [
        (FACT, "cotp: length indicator at byte 4 claims 18 bytes, the TPKT has 9"),
        (Malformed("cotp", "bad_value", "li", 0, 1, 255, "li"),
         "cotp: length indicator at byte 0 is 255, expected 1 to 254"),
        (Malformed("s7", "too_short", "header", 0, 10, 1, "tsdu"), "s7: header at byte 0 needs 10 bytes, the TSDU has 1"),
        (Malformed("s7plus", "length_beyond", "item count", 55, 111, 1, "pdu"),
         "s7plus: item count at byte 55 announces 111, the rest of the PDU has 1 byte"),
        (Malformed("s7plus", "length_beyond", "length", 55, 111, 13, "pdu"),
         "s7plus: length at byte 55 claims 111 bytes, the rest of the PDU has 13"),
        (Malformed("s7plus", "too_short", "CRC", 55, 1, 0, "pdu"),
         "s7plus: CRC at byte 55 needs 1 byte, the rest of the PDU has 0"),
        (Malformed("s7plus", "bad_value", "depth of object", 55, 40, 41, "pdu"),
         "s7plus: depth of object at byte 55 is 41, more than the 40 that are read"),
        (Malformed("s7", "length_below", "item.length", 12, 10, 3, "item"), "s7: item.length at byte 12 is 3, less than 10"),
        (Malformed("s7", "bad_value", "syntax_id", 4, 17, 18, "param"), "s7: syntax_id at byte 4 is 18, expected 17"),
        (Malformed("s7", "trailing_octets", "end", 21, 0, 1, "param"),
         "s7: 1 byte too many at byte 21, in the parameter part"),
        (Malformed("s7", "trailing_octets", "pdu", 26, 26, 104, "tsdu"),
         "s7: 78 bytes too many behind pdu at byte 26, in the TSDU"),
        (Malformed("s7", "count_mismatch", "item_count", 11, 5, 1, "param"),
         "s7: item_count at byte 11: 5 announced, 1 there"),
        (Malformed("cotp", "unknown_type", "type", 1, 0, 3, "li"), "cotp: type at byte 1 is 3, which is unknown"),
        (Malformed("s7plus", "trailing_octets", "items", 9, 0, 2, "pdu"),
         "s7plus: 2 bytes too many behind items at byte 9, in the PDU"),
        (Malformed("s7plus", "bad_compression", "blob", 9, 0, 7, "pdu"),
         "s7plus: blob at byte 9: its 7 bytes cannot be decompressed to the end"),
        (Malformed("s7plus", "too_large", "blob", 9, 4096, 1, "pdu"),
         "s7plus: blob at byte 9: its 1 byte decompress to 4096 or more"),
    ],
)  # fmt: skip
def test_it_says_everything_in_a_sentence(fact: Malformed, text: str) -> None:
    assert str(fact) == text


def test_every_reason_and_every_limit_has_its_words() -> None:
    said = {str(Malformed("s7", reason, "length", 1, 2, 3, "item")) for reason in REASONS}
    assert len(said) == len(REASONS)
    said = {str(Malformed("s7", "too_short", "length", 1, 2, 3, limit)).partition(", the ")[2] for limit in LIMITS}
    assert len(said) == len(LIMITS)
    assert "" not in said


def test_it_gives_values_in_a_fixed_order() -> None:
    assert list(FACT.as_dict().items()) == [
        ("layer", "cotp"),
        ("reason", "length_beyond"),
        ("field", "li"),
        ("offset", 4),
        ("needed", 18),
        ("available", 9),
        ("limit", "tpkt"),
    ]


def test_reasons_and_limits_are_closed_sets() -> None:
    reasons: set[object] = set()
    limits: set[object] = set()
    for path in Path(dissect.__file__).parent.rglob("*.py"):
        source = path.read_bytes()
        if b"Malformed(" not in source:
            continue  # most modules: walking them all takes seconds
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Malformed":
                for argument, given in ((node.args[1], reasons), (node.args[6], limits)):
                    if isinstance(argument, ast.Constant):
                        given.add(argument.value)
    assert reasons - set(REASONS) == set()
    assert limits - set(LIMITS) == set()
    assert {"length_beyond", "too_short"} <= reasons
    assert {"tpkt", "li"} <= limits
