from __future__ import annotations

import ast
from pathlib import Path

import dissect
from dissect.wire.malformed import LIMITS, REASONS, Malformed

FACT = Malformed("cotp", "length_beyond", "li", 4, 18, 9, "tpkt")


def test_it_says_everything_in_a_sentence() -> None:
    assert str(FACT) == "cotp: li length beyond at octet 4 (needed 18, available 9, set by tpkt)"


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
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Malformed":
                for argument, given in ((node.args[1], reasons), (node.args[6], limits)):
                    if isinstance(argument, ast.Constant):
                        given.add(argument.value)
    assert reasons - set(REASONS) == set()
    assert limits - set(LIMITS) == set()
    assert {"length_beyond", "too_short"} <= reasons
    assert {"tpkt", "li"} <= limits
