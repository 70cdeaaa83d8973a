"""The tree of an expression: what binds how tightly, how values are written, and where in the text each part is."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.meaning.select.errors import SelectError
from dissect.meaning.select.grammar import (
    OPERATORS,
    All,
    Comparison,
    Either,
    FieldName,
    Literal,
    Negation,
    Node,
    Presence,
    parse,
)
from tests.cases import each


def has(name: str, at: int = 0) -> Presence:
    return Presence(FieldName(name, "", at, at + len(name)))


def comparison(text: str) -> Comparison:
    node = parse(text)
    assert isinstance(node, Comparison)
    return node


A: Final = has("a")


@each(
    ("text", "tree"),
    [
        ("a", A),
        ("(a)", has("a", 1)),
        ("not a", Negation(has("a", 4))),
        ("!a", Negation(has("a", 1))),
        ("NOT not a", has("a", 8)),
        ("not not not a", Negation(has("a", 12))),
        ("a and b", All((A, has("b", 6)))),
        ("a && b", All((A, has("b", 5)))),
        ("a OR b", Either((A, has("b", 5)))),
        ("a || b", Either((A, has("b", 5)))),
        ("a or b or c", Either((A, has("b", 5), has("c", 10)))),
        ("a and b and c", All((A, has("b", 6), has("c", 12)))),
        ("a or b and c", Either((A, All((has("b", 5), has("c", 11)))))),
        ("a and b or c", Either((All((A, has("b", 6))), has("c", 11)))),
        ("a and (b or c)", All((A, Either((has("b", 7), has("c", 12)))))),
        ("not a or b", Either((Negation(has("a", 4)), has("b", 9)))),
        ("not (a or b)", Negation(Either((has("a", 5), has("b", 10))))),
        ("a\tand\n b", All((A, has("b", 7)))),
    ],
)
def test_not_binds_more_tightly_than_and_and_and_than_or(text: str, tree: Node) -> None:
    assert parse(text) == tree
    assert {parse(text), parse(text)} == {tree}


@each("word", ["and.x", "or_1", "not.y", "in_z", "android", "order", "nothing", "inside"])
def test_a_field_may_begin_with_a_word_of_the_language(word: str) -> None:
    assert parse(word) == has(word)


@each(
    ("written", "operator"),
    [
        ("==", "=="), ("eq", "=="), ("EQ", "=="), ("!=", "!="), ("ne", "!="), ("<", "<"), ("lt", "<"), ("<=", "<="),
        ("le", "<="),
        (">", ">"), ("gt", ">"), (">=", ">="), ("ge", ">="), ("===", "==="), ("all_eq", "==="), ("!==", "!=="),
        ("any_ne", "!=="),
        ("in", "in"), ("contains", "contains"), ("matches", "matches"), ("~", "matches"), ("Overlaps", "overlaps"),
    ],
)  # fmt: skip
def test_operators_have_two_spellings(written: str, operator: str) -> None:
    found = comparison(f"a {written} 5")
    end = len(written) + 4
    assert found == Comparison(FieldName("a", "", 0, 1), operator, (Literal("5", False, end - 1, end),), 0, end)
    assert len({found, parse(f"a {written} 5")}) == 1
    assert operator in OPERATORS


@each(
    ("written", "text", "quoted"),
    [
        ("5", "5", False), ("-1.5e3", "-1.5e3", False), ("10.0.0.1:102", "10.0.0.1:102", False), ("5ms", "5ms", False),
        ("5 ms", "5 ms", False), ("5  \u00b5s", "5 \u00b5s", False), ("DB1.DBW0 x3", "DB1.DBW0 x3", False),
        ("..7", "..7", False),
        ('"a b"', "a b", True), ("'a b'", "a b", True), ('""', "", True), ("'it\"s'", 'it"s', True),
        (r'"a\"b"', 'a"b', True), (r"'a\'b'", "a'b", True), (r'"a\\b"', r"a\b", True), (r'"\d+\."', r"\d+\.", True),
        ('"a\nb"', "a\nb", True), ("\u0436", "\u0436", False), ("fe80::1", "fe80::1", False),
    ],
)  # fmt: skip
def test_a_value_is_a_word_with_a_unit_or_a_text_in_quotes(written: str, text: str, quoted: bool) -> None:
    assert comparison(f"a == {written}").literals == (Literal(text, quoted, 5, 5 + len(written)),)


@each(
    ("written", "texts"),
    [
        ("{1}", ["1"]), ("{1, 2}", ["1", "2"]), ("{1,2,}", ["1", "2"]), ("{ 1..3 , \"a,b\" , 5 ms }", ["1..3", "a,b", "5 ms"]),
        ("7", ["7"]), ("1..2", ["1..2"]),
    ],
)  # fmt: skip
def test_a_set_has_values(written: str, texts: list[str]) -> None:
    found = comparison(f"a in {written}")
    assert [one.text for one in found.literals] == texts
    assert found.operator == "in"
    assert (found.start, found.end) == (0, found.literals[-1].end)
    negated = parse(f"a not in {written}")
    assert isinstance(negated, Negation)
    assert isinstance(negated.within, Comparison)
    assert [one.text for one in negated.within.literals] == texts
    assert (negated.within.operator, negated.within.start) == ("in", 0)


@each(
    ("written", "name", "index"),
    [
        ("value[DB1.DBW0]", "value", "DB1.DBW0"), ("Value[ MW4 ]", "value", "MW4"), ("a.b[x[1]]", "a.b", "x[1]"),
        ("value[x[1].y[2]]", "value", "x[1].y[2]"), ('value["a]b"]', "value", '"a]b"'), ("value['it[']", "value", "'it['"),
        ("VALUE", "value", ""), ("value[x]", "value", "x"), ("value['']", "value", "''"), ("scd.tid", "scd.tid", ""),
    ],
)  # fmt: skip
def test_a_field_may_have_an_index(written: str, name: str, index: str) -> None:
    field = FieldName(name, index, 0, len(written))
    assert parse(written) == Presence(field)
    assert comparison(f"{written} == 5").field == field


def test_conditions_are_nested_a_hundred_times_at_most() -> None:
    """A negation is a level, two in a row are none; a condition is the innermost level, one that is negated has two."""
    for begin, end, inner in (
        ("(a or ", ")", "b"),
        ("(a and (not ", "))", "b"),
        ("(a or ", ")", "b not in 5"),
        ("(a or ", ")", "b in 5"),
        ("(a or ", ")", "b == 5"),
    ):
        each_level = 2 if "not" in begin else 1
        levels = (100 - (2 if "not in" in inner else 1)) // each_level
        assert parse(begin * levels + inner + end * levels) is not None
        with pytest.raises(SelectError, match="conditions are nested more than 100 times"):
            parse(begin * (levels + 1) + inner + end * (levels + 1))


def test_an_expression_has_just_so_many_characters() -> None:
    assert parse("a" * 4000) == has("a" * 4000)
    with pytest.raises(SelectError) as told:
        parse("a" * 4001)
    assert told.value.reason == "an expression has at most 4000 characters; this one has 4001"
    assert told.value.lines() == [told.value.reason]


@each(
    ("text", "marked", "reason"),
    [
        ("a is 5", "is", "did you mean ==?"),
        ("a <> 5", "<>", "did you mean !=?"),
        ("a =~ 5", "=~", "did you mean matches?"),
        ("a LIKE 5", "LIKE", "did you mean contains?"),
        ("a =< 5", "=<", "did you mean <=?"),
        ("a match 5", "match", "did you mean matches?"),
        ("a == 5 bc", "bc", "expected and, or, or the end, got 'bc'"),
        ("(a == 5 b)", "b", "expected and, or, or a closing parenthesis, got 'b'"),
        ("a in {1 2}", "2", "expected a comma or }, got '2'"),
        ("a in {", "", "the expression ends here: expected a value"),
        ("a not b", "b", "expected in, got 'b'"),
        ("a not", "", "the expression ends here: expected in"),
        ("a == != 5", "!=", "expected a value, got '!='"),
        ("a == ,", ",", "expected a value, got ','"),
        ("not", "", "the expression ends here: expected a field"),
        ("a == 'b' \"c'", "\"c'", 'the text that begins here has no closing "'),
        ("a == 5 ''", "'", "expected and, or, or the end, got a text"),
        ("a == 5 'c'", "'", "expected and, or, or the end, got a text"),
        ("a == 5 'c", "'c", "the text that begins here has no closing '"),
        ("a == \"b'c", "\"b'c", 'the text that begins here has no closing "'),
        ("a[b", "[b", "these brackets are not closed; put a name with brackets in quotes"),
        ("(a == 5", "", "the expression ends here: expected and, or, or a closing parenthesis"),
        ("a %% 5", "%%", "expected an operator"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(text: str, marked: str, reason: str) -> None:
    with pytest.raises(SelectError) as told:
        parse(text)
    assert reason in told.value.reason
    start = text.index(marked) if marked else len(text)
    assert (told.value.start, told.value.end) == (start, start + (len(marked) or 1))


@each("field", ["a[]", "a[  ]"])
def test_brackets_have_something_in_them(field: str) -> None:
    with pytest.raises(SelectError, match="the brackets are empty") as told:
        parse(f"b or {field} == 5")
    assert (told.value.start, told.value.end, told.value.text) == (5, 5 + len(field), f"b or {field} == 5")
