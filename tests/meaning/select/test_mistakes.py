"""Expressions that cannot be: what is said, where the mark points, and what may have been meant."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.meaning.select import SelectError, Where
from dissect.meaning.select.grammar import MAX_DEPTH, MAX_SIZE, parse
from tests.cases import each

#: Expression, what the mark points at (the end: nothing), and words of the reason.
MISTAKES: Final[list[tuple[str, str, str]]] = [
    ("latncy > 20ms", "latncy", "no field 'latncy'; did you mean latency"),
    ("failed and hsot == 10.0.0.1", "hsot", "did you mean slot or host?"),
    ("ip.addr == 10.0.0.1", "ip.addr", "did you mean host?"),
    ("xyzzy", "xyzzy", "`s7dissect fields` lists the fields"),
    ("host = 10.0.0.1", "=", "did you mean ==?"),
    ("host equals 10.0.0.1", "equals", "did you mean ==?"),
    ("host contain 10", "contain", "did you mean contains"),
    ("port 102", "102", "expected an operator"),
    ("host ==", "", "the expression ends here: expected a value"),
    ("host == 10.0.0.1 and", "", "the expression ends here: expected a field"),
    ("== 5", "==", "expected a field"),
    ("(failed", "", "expected and, or, or a closing parenthesis"),
    ("failed)", ")", "expected and, or, or the end"),
    ("failed error", "error", "expected an operator"),
    ("port == 1 number == 2", "number", "expected and, or, or the end"),
    ("port in", "", "expected { and values, separated by commas, or one value"),
    ("number in 10-12", "10-12", "the range 10..12"),
    ("number == 10-12", "10-12", "the range 10..12"),
    ("port in {1, 2", "", "expected a comma or }"),
    ("port in {..}", "..", "a range has an end"),
    ('subject == "abc', '"abc', 'the text that begins here has no closing "'),
    ("subject == 'abc", "'abc", "the text that begins here has no closing '"),
    ('port "x', '"x', 'the text that begins here has no closing "'),
    ('port "x"', '"', "got a text"),
    ('"x" == port', '"', "got a text"),
    ("latency > 20", "20", "a duration needs a unit (ns, us, ms, s, min, h, d), such as 20ms"),
    ("latency > 20sec", "20sec", "unknown unit 'sec'"),
    ("latency > 20 parsecs", "parsecs", "expected and, or, or the end"),
    ("latency > fast", "fast", "expected a duration, such as 20ms"),
    ("host == 10.0.0.300", "10.0.0.300", "expected an address or a network"),
    (
        "value[Curve[2] > 5",
        "[Curve[2] > 5",
        "these brackets are not closed; put a name with brackets in quotes",
    ),
    ("host == 10.0.0.0/33", "10.0.0.0/33", "expected an address or a network"),
    ("host == plc1", "plc1", "expected an address or a network"),
    ("host == 10.0.0.1:70000", "10.0.0.1:70000", "a port is at most 65535"),
    ("host > 10.0.0.1", "host > 10.0.0.1", "cannot be compared with >; it takes ==, !="),
    ("time > 25:00:00", "25:00:00", "there is no such time of day"),
    ("time > 2016-02-30T00:00:00", "2016-02-30T00:00:00", "there is no such day"),
    ("time > yesterday", "yesterday", "expected HH:MM, HH:MM:SS"),
    ("time in {1..12:0}", "1..12:0", "'12:0' is not a time"),
    ("address overlaps DB10.DBQ4", "DB10.DBQ4", "expected an S7 address, such as DB10.DBW4"),
    ('address overlaps "Tank.Level"', '"Tank.Level"', "expected an S7 address"),
    ("address == Tank.Level", "Tank.Level", "a name stands in quotes"),
    ("db == ten", "ten", "expected a number"),
    ("db overlaps DB10.DBW4", "db overlaps DB10.DBW4", "cannot be compared with overlaps"),
    ("port in {1..x}", "x", "expected a number"),
    ("function == raed_var", "raed_var", "did you mean"),
    ("outcome == unanswerd", "unanswerd", "no such name 'unanswerd'; did you mean unanswered"),
    ("area == X", "X", "expected a number or one of"),
    ("severity >= warn", "warn", "error, warning, note"),
    ("slug == security.plc_stp", "security.plc_stp", "security.plc_stop"),
    ("failed == maybe", "maybe", "expected true or false"),
    ("failed > true", "failed > true", "cannot be compared with >"),
    ("data contains xyz", "xyz", "expected bytes, such as 00:01:ff"),
    ("value > high", "high", "> takes a number"),
    ('subject matches "("', '"("', "invalid regular expression"),
    ("port[DB1.DBW0] == 5", "port[DB1.DBW0]", "no brackets can follow"),
    ("value[] == 5", "value[]", "the brackets are empty"),
    ("failed xor error", "xor", "expected an operator"),
    ('host "x"', '"', "expected an operator"),
    ("failed and 'x' == 1", "'", "got a text"),
    ("port == 20 ms", "20 ms", "expected a number"),
    ("latency in {20 ms, 5 x3}", "5 x3", "expected a duration"),
    ("failed in {true, false}", "failed in {true, false", "cannot be compared with in"),
    ("host overlaps 10.0.0.1 and failed", "host overlaps 10.0.0.1", "cannot be compared with overlaps"),
    ("failed and value[ ] == 5", "value[ ]", "the brackets are empty"),
    ("failed or (port in {1, 2)", ")", "expected a comma or }"),
    ("", "", "the expression is empty"),
]


@each("case", MISTAKES)
def test_a_mistake_is_told_with_its_place(case: tuple[str, str, str]) -> None:
    expression, marked, words = case
    with pytest.raises(SelectError) as told:
        Where(expression)
    lines = told.value.lines()
    assert words in lines[0]
    if not expression:
        assert len(lines) == 1
        return
    assert lines[1] == f"  {expression}"
    start, size = lines[2].index("^"), lines[2].count("^")
    assert lines[1][start : start + size] == marked
    if not marked:
        assert start == len(lines[1])


def test_a_field_that_these_things_never_have_is_a_mistake() -> None:
    with pytest.raises(SelectError, match="transactions have no field 'slug'; findings have it"):
        Where("failed and slug == transaction.slow", kinds=("transaction",))
    assert Where("failed and slug == transaction.slow").texts


def test_what_is_too_long_or_too_deep_is_refused() -> None:
    with pytest.raises(SelectError, match=f"at most {MAX_SIZE} characters"):
        Where("failed or " * MAX_SIZE + "failed")
    with pytest.raises(SelectError, match=f"more than {MAX_DEPTH} times"):
        Where("not (failed or " * (MAX_DEPTH // 2) + "failed" + ")" * (MAX_DEPTH // 2))
    deep = "(" * 1000 + "failed" + ")" * 1000
    assert parse(deep) == parse("((failed))") or Where(deep).knows("transaction")
    assert Where("not " * 601 + "failed").text.startswith("not")
    with pytest.raises(SelectError, match="a pattern has at most"):
        Where(f'subject matches "{"a" * 300}"')


def test_conditions_may_be_nested_just_so_deep() -> None:
    """Parentheses and two negations in a row are no levels of their own."""
    for begin, end in (("(failed or ", ")"), ("((failed and ", "))"), ("(failed or not not ", ")")):
        most = MAX_DEPTH - 1
        assert Where(begin * most + "failed" + end * most).knows("transaction")
        with pytest.raises(SelectError, match=f"more than {MAX_DEPTH} times"):
            Where(begin * (most + 1) + "failed" + end * (most + 1))


def test_what_does_not_print_is_not_written_to_a_terminal() -> None:
    with pytest.raises(SelectError) as told:
        Where("subject == \x1b[2J\u202e\tx y")
    assert all(line.isprintable() for line in told.value.lines())


def test_of_a_long_expression_the_place_is_shown() -> None:
    with pytest.raises(SelectError) as told:
        Where("failed or " * 100 + "failt")
    _, line, mark = told.value.lines()
    assert len(line) < 160
    assert line[mark.index("^") :].startswith("failt")


@each("blank", ("", " ", "   ", "\t"))
def test_where_an_expression_ends_too_soon_blanks_behind_it_do_not_move_the_mark(blank: str) -> None:
    """The mark stands where the next word belongs, and a caller gets the same place as the one that is shown."""
    with pytest.raises(SelectError) as told:
        Where(f"host =={blank}")
    assert (told.value.start, told.value.end) == (7, 8)
    assert told.value.lines()[2] == f"  {' ' * 7}^"


@each(
    ("text", "mark"),
    [("subject == \u6f22\u5b57 xor", 17), ("subject == ab xor", 15), ("subject == \u00e9\u00e9 xor", 15)],
)
def test_the_mark_stands_below_the_word_in_columns_of_the_terminal(text: str, mark: int) -> None:
    """Wide characters take two columns each."""
    with pytest.raises(SelectError) as told:
        Where(text)
    assert text[told.value.start : told.value.end] == "xor"
    line = told.value.lines()[2]
    assert (line.index("^"), line.count("^")) == (mark + 1, 3)


def test_a_wrong_part_that_is_longer_than_the_line_is_marked_as_far_as_it_is_shown() -> None:
    with pytest.raises(SelectError) as told:
        Where(f"port == {'9' * 300}x and failed")
    _, line, mark = told.value.lines()
    assert line.endswith("\u2026")
    assert (mark.index("^"), len(mark)) == (10, len(line.removesuffix(" \u2026")))


def test_a_place_far_behind_is_shown_with_what_is_left_out_before_it() -> None:
    with pytest.raises(SelectError) as told:
        Where("failed or " * 100 + "failt")
    _, line, mark = told.value.lines()
    assert line.startswith("  \u2026 ")
    assert (mark.index("^"), mark.count("^")) == (len(line) - len("failt"), len("failt"))
