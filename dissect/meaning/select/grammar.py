"""The language of selections: parses text into a tree of conditions.

This module does not know which fields exist, nor what each may be compared with (`dissect.meaning.select.where`).

Operators are those of Wireshark's display filters, with their other spellings (`eq`, `&&`, `~` …).
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NoReturn

from dissect.meaning.select.errors import SelectError
from dissect.wire.config.hints import close_names

if TYPE_CHECKING:
    from lark import Lark, Token

#: Greatest number of characters of an expression, and of levels of conditions within each other.
MAX_SIZE: Final = 4000
MAX_DEPTH: Final = 100

_GRAMMAR: Final = r"""
start: _expression
_expression: either
?either: both (_OR both)*
?both: one (_AND one)*
?one: NOT one -> negation
    | "(" either ")"
    | FIELD -> presence
    | FIELD OPERATOR literal -> comparison
    | FIELD NOT? IN "{" literal ("," literal)* ","? "}" -> membership
    | FIELD NOT? IN literal -> membership
literal: STRING | WORD SUFFIX?

_OR.3: /or(?![\w.])|\|\|/i
_AND.3: /and(?![\w.])|&&/i
NOT.3: /not(?![\w.])|!(?!=)/i
IN.3: /in(?![\w.])/i
OPERATOR.3: /===|!==|==|!=|<=|>=|<|>|~|(all_eq|any_ne|eq|ne|lt|le|gt|ge|contains|matches|overlaps)(?![\w.])/i
FIELD.2: /[A-Za-z_]\w*(\.[A-Za-z_]\w*)*(\[\s*("[^"]*"|'[^']*')\s*\]|\[([^\[\]]|\[[^\[\]]*\])*\])?/
WORD: /(?!(?:and|or|not|in)(?![\w.]))[^\s(){},"'<>=!&|~]+/i
SUFFIX.2: /(ns|us|[µμ]s|ms|s|min|h|d|x[0-9]+)(?![\w.])/i
STRING: /"(\\.|[^"\\])*"|'(\\.|[^'\\])*'/s
%ignore /\s+/
"""

#: Other spellings of operators.
_OPERATORS: Final = {
    "eq": "==",
    "ne": "!=",
    "lt": "<",
    "le": "<=",
    "gt": ">",
    "ge": ">=",
    "~": "matches",
    "all_eq": "===",
    "any_ne": "!==",
}
#: All operators between a field and a value, in the order in which help lists them.
OPERATORS: Final = ("==", "!=", "<", "<=", ">", ">=", "===", "!==", "in", "contains", "matches", "overlaps")
_WORDS: Final = (*_OPERATORS, *OPERATORS, "and", "or", "not in")
#: Operators of other languages, to suggest ours.
_ELSEWHERE: Final = {"=": "==", "is": "==", "equals": "==", "<>": "!=", "=~": "matches", "like": "contains", "=<": "<="}


@dataclass(frozen=True)
class Literal:
    """A value as it was typed: ``text`` without quotes; ``quoted`` says whether it had any."""

    text: str
    quoted: bool
    start: int
    end: int


@dataclass(frozen=True)
class FieldName:
    """A field as it was typed; ``index`` is the text in brackets after it, empty without brackets."""

    name: str
    index: str
    start: int
    end: int


@dataclass(frozen=True)
class Presence:
    """Only a field: true if the thing has this field; for a field of type truth, if its value is true."""

    field: FieldName


@dataclass(frozen=True)
class Comparison:
    """A field compared with literals, one of which must match; only the operator ``in`` has several."""

    field: FieldName
    operator: str
    literals: tuple[Literal, ...]
    start: int
    end: int


@dataclass(frozen=True)
class Negation:
    """True if the condition ``within`` is false."""

    within: Node


@dataclass(frozen=True)
class All:
    """Every one of the conditions holds."""

    parts: tuple[Node, ...]


@dataclass(frozen=True)
class Either:
    """At least one of the conditions holds."""

    parts: tuple[Node, ...]


Node = Presence | Comparison | Negation | All | Either


def parse(text: str) -> Node:
    """Return the tree of an expression. Raises `SelectError` with the place of a mistake."""
    if len(text) > MAX_SIZE:
        raise SelectError(f"an expression has at most {MAX_SIZE} characters; this one has {len(text)}")
    if not text.strip():
        raise SelectError("the expression is empty: expected a condition such as host == 192.168.0.1")
    from lark.exceptions import UnexpectedInput

    try:
        built: Any = _parser().parse(text)
    except UnexpectedInput as error:
        _explain(text, error)
    except SelectError as error:
        raise error.within(text, error.start, error.end) from None
    node: Node = built.node
    return node


@functools.cache
def _parser() -> Lark:
    """Return the parser. It is made for the first expression, not on import, because making it takes long."""
    from lark import Lark, v_args
    from lark.visitors import Transformer

    class Builder(Transformer[Any, Any]):
        """Makes nodes while the text is parsed, so that parsing stops as soon as they are nested too deep."""

        def start(self, parts: list[_Deep]) -> _Deep:
            return parts[0]

        def either(self, parts: list[_Deep]) -> _Deep:
            return _deeper(Either(tuple([part.node for part in parts])), parts)

        def both(self, parts: list[_Deep]) -> _Deep:
            return _deeper(All(tuple([part.node for part in parts])), parts)

        def negation(self, parts: list[Any]) -> _Deep:
            inner: _Deep = parts[1]
            if isinstance(inner.node, Negation):
                return _Deep(inner.node.within, inner.depth - 1)
            return _deeper(Negation(inner.node), [inner])

        def presence(self, parts: list[Token]) -> _Deep:
            return _Deep(Presence(_field(parts[0])), 1)

        def comparison(self, parts: list[Any]) -> _Deep:
            field, operator, literal = parts
            written = str(operator).lower()
            found = _field(field)
            return _Deep(Comparison(found, _OPERATORS.get(written, written), (literal,), found.start, literal.end), 1)

        def membership(self, parts: list[Any]) -> _Deep:
            found = _field(parts[0])
            literals = tuple([part for part in parts if isinstance(part, Literal)])
            node = Comparison(found, "in", literals, found.start, literals[-1].end)
            return _Deep(Negation(node), 2) if parts[1].type == "NOT" else _Deep(node, 1)

        @v_args(inline=True)
        def literal(self, first: Token, second: Token | None = None) -> Literal:
            start, end = first.start_pos or 0, (second or first).end_pos or 0
            if first.type == "STRING":
                return Literal(_unquoted(str(first)), True, start, end)
            return Literal(f"{first} {second}" if second is not None else str(first), False, start, end)

    return Lark(_GRAMMAR, parser="lalr", lexer="contextual", maybe_placeholders=False, transformer=Builder())


@dataclass(frozen=True)
class _Deep:
    """A node, and how many levels of nodes there are in it."""

    node: Node
    depth: int


def _deeper(node: Node, parts: list[_Deep]) -> _Deep:
    depth = 1 + max([part.depth for part in parts])
    if depth > MAX_DEPTH:
        raise SelectError(f"conditions are nested more than {MAX_DEPTH} times")
    return _Deep(node, depth)


def _field(token: Token) -> FieldName:
    name, bracket, index = str(token).partition("[")
    if bracket and not index[:-1].strip():
        raise SelectError(
            "the brackets are empty: expected an address or a tag in them, such as value[DB10.DBD16]",
            start=token.start_pos or 0,
            end=token.end_pos or 0,
        )
    return FieldName(name.lower(), index[:-1].strip(), token.start_pos or 0, token.end_pos or 0)


_ESCAPE: Final = re.compile(r"\\([\"'\\])")


def _unquoted(text: str) -> str:
    r"""Return the content of a quoted text: ``\"`` and ``\\`` are unescaped; other backslashes stay, for patterns."""
    return _ESCAPE.sub(r"\1", text[1:-1])


# ---- what is wrong --------------------------------------------------------------------------------------------------


_NEXT: Final = re.compile(r"[\w.]+|[^\s\w]+|\S")


def _explain(text: str, error: Any) -> NoReturn:
    """Raise the `SelectError` for an error of the parser: the text that it met, and what it expected."""
    at = getattr(error, "pos_in_stream", None)
    token = getattr(error, "token", None)
    if token is not None and token.type == "$END":
        at = None
    could = set(getattr(error, "allowed", None) or getattr(error, "accepts", None) or ())
    if at is None or not text[at:].strip():
        end = len(text.rstrip())
        raise SelectError(f"the expression ends here: expected {_wanted(could)}", text, end, end + 1) from None
    if text[at - 1 : at + 1] in _ELSEWHERE:  # the first character of <> is an operator of its own
        at, could = at - 1, {"OPERATOR"}
    found = _NEXT.match(text, at)
    word = found[0] if found else text[at]
    if text[at] in "\"'":
        if text.find(text[at], at + 1) < 0 or "STRING" in could:
            raise SelectError(f"the text that begins here has no closing {text[at]}", text, at, len(text)) from None
        raise SelectError(f"expected {_wanted(could)}, got a text", text, at, at + 1) from None
    if text[at] == "[" and "OPERATOR" in could:
        raise SelectError(
            "these brackets are not closed; put a name with brackets in quotes",
            text, at, len(text),
        ) from None  # fmt: skip
    hint = ""
    if "OPERATOR" in could:
        known = _ELSEWHERE.get(word.lower())
        near = [known] if known else close_names(word.lower(), _WORDS)
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
    raise SelectError(f"expected {_wanted(could)}, got {word!r}{hint}", text, at, at + len(word)) from None


def _wanted(could: set[str]) -> str:
    """Return in words what the parser expected; ``could`` are names of terminals."""
    if "OPERATOR" in could:
        return f"an operator ({', '.join(OPERATORS)})"
    if "IN" in could:
        return "in"
    if "FIELD" in could:
        return "a field (`s7dissect fields` lists them)"
    if "LBRACE" in could:
        return "{ and values, separated by commas, or one value"
    if "STRING" in could:
        return "a value"
    if "COMMA" in could:
        return "a comma or }"
    if "RPAR" in could:
        return "and, or, or a closing parenthesis"
    return "and, or, or the end"
