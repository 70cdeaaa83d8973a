"""Declarations of data blocks, types and interfaces in sources: AWL, SCL, ``.db`` and ``.udt`` by one grammar (sheet 3).

Only declarations are read; code and start values are skipped. A mistake in one block costs only that block.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from typing import Final, NamedTuple

from dissect.meaning.tags.problems import Problems
from dissect.meaning.tags.types import whole_number

_TEXT: Final = r"|(?P<text>'(?:[^'$\n]|\$[^\n])*')"
_TOKENS: Final = rf"""
    (?P<space>\s+)
    |(?P<note>//[^\n]*|\(\*.*?\*\)|/\*.*?\*/)
    |(?P<attributes>\{{(?:'(?:[^'$]|\$.)*'|[^}}'])*\}})
    |(?P<unclosed>\{{|\(\*|/\*)
    {_TEXT}
    |(?P<quoted>"[^"\n]*")
    |(?P<mark>\.\.|:=|[:;,\[\]().=])
    |(?P<word>[\w#+\-]+)
    |(?P<other>.)
    """
_TOKEN: Final = re.compile(_TOKENS, re.VERBOSE | re.DOTALL)
#: Tokens without texts. If a text is not closed on its line, no later one on that line is: trying each would take quadratic
#: time.
_NO_TEXT: Final = re.compile(_TOKENS.replace(_TEXT, ""), re.VERBOSE | re.DOTALL)
_NOTE_BEHIND: Final = re.compile(r"[^\S\n]*(?://|\(\*)")
#: The ends of attributes and comments. A missing end is noted once: searching again from each place would take quadratic time.
_CLOSING: Final = {"{": "}", "(*": "*)", "/*": "*/"}
_LINE_END: Final = re.compile(r"[^\n]*")
_OPTIMIZED: Final = re.compile(r"S7_Optimized_Access\s*:=\s*'(TRUE|FALSE)'", re.IGNORECASE)
#: The keywords that begin blocks in a source, and those that end them.
_BLOCKS: Final = {
    "DATA_BLOCK": "END_DATA_BLOCK",
    "TYPE": "END_TYPE",
    "FUNCTION_BLOCK": "END_FUNCTION_BLOCK",
    "FUNCTION": "END_FUNCTION",
    "ORGANIZATION_BLOCK": "END_ORGANIZATION_BLOCK",
}
_NEXT_BLOCK: Final = re.compile(rf"^[ \t]*({'|'.join(_BLOCKS)})\b", re.IGNORECASE | re.MULTILINE)
#: Keywords of header lines; the rest of such a line is a text.
_LINES: Final = frozenset(("TITLE", "AUTHOR", "FAMILY", "NAME", "VERSION"))
_WORDS: Final = frozenset(("KNOW_HOW_PROTECT", "STANDARD", "READ_ONLY", "UNLINKED", "RETAIN", "NON_RETAIN"))
_SECTIONS: Final = ("VAR_INPUT", "VAR_OUTPUT", "VAR_IN_OUT", "VAR", "VAR_TEMP", "CONST")
#: Sections in their order in memory, which does not depend on that in the text; other sections need no memory.
_IN_MEMORY: Final = ("VAR_INPUT", "VAR_OUTPUT", "VAR_IN_OUT", "VAR")
_QUALIFIERS: Final = frozenset(("RETAIN", "NON_RETAIN", "DB_SPECIFIC", "CONSTANT"))
#: The name by which a program addresses the elements of a block that is a single array.
_ELEMENTS: Final = "THIS"
#: Types that are written as two words.
_NUMBERED: Final = re.compile(r"(DB|UDT|FB|SFB|FC|SFC|OB|SDB)\s*(\d{1,5})", re.IGNORECASE)
_MOST_NESTED: Final = 64


class SourceError(Exception):
    """A block cannot be read: its line, and what is wrong."""

    def __init__(self, line: int, text: str) -> None:
        self.line = line
        super().__init__(text)


class Member(NamedTuple):
    """A member as declared: ``type`` is the name of its type ("Int", "UDT 3", "Job"), or ``shape`` has its own members.

    ``bounds`` are those of an array, a text for each dimension; ``overlay``: the member is a view of another one (AT).
    ``initial`` is the value of a constant.
    """

    name: str
    type: str
    bounds: list[str]
    shape: Shape | None
    overlay: bool
    comment: str
    line: int
    initial: str = ""


class Section(NamedTuple):
    """The members of one section; ``by_reference``: the section is IN_OUT."""

    members: list[Member]
    by_reference: bool = False


class Shape(NamedTuple):
    """The sections of a structure, type or block."""

    sections: list[Section]


class Block(NamedTuple):
    """A block or type: ``kind`` is a key of `_BLOCKS`, ``name`` its symbol or "DB 10", ``number`` the 10.

    Its members are in ``shape``, or ``of`` names the type or FB that has them. ``optimized`` is None if it is not stated.
    """

    kind: str
    name: str
    number: int | None
    shape: Shape
    of: str
    optimized: bool | None
    line: int


class Token(NamedTuple):
    """A token: its kind, its text, and where it begins."""

    kind: str
    text: str
    at: int

    @property
    def upper(self) -> str:
        """The text in capitals; empty for quoted names and texts."""
        return "" if self.kind in {"quoted", "text"} else self.text.upper()


_END: Final = Token("end", "", -1)


def looks_like_source(text: str) -> bool:
    """Return whether a text contains a block of a source."""
    return _NEXT_BLOCK.search(text) is not None


def essence(shape: Shape) -> list[object]:
    """Return everything in a shape that determines its layout and names: all but comments, lines and start values."""
    return [
        (
            section.by_reference,
            member.name,
            member.type.lower(),
            member.bounds,
            member.overlay,
            essence(member.shape or Shape([])),
        )
        for section in shape.sections
        for member in section.members
    ]


def read_declarations(text: str, problems: Problems) -> tuple[list[Block], dict[str, int]]:
    """Return the blocks and types of a source, and the constants of its interfaces."""
    return _Reader(text, problems).read()


class _Reader:
    def __init__(self, text: str, problems: Problems) -> None:
        self._text = text
        self._problems = problems
        self._at = 0
        self._note = Token("", "", -1)
        self._seen = 0  # up to here comments were searched; `_opened`: one was open here
        self._opened = False
        self._no_text = 0  # up to here no text ends
        self._starts = [0, *[found.end() for found in re.finditer("\n", text)]]
        self._constants: dict[str, int] = {}

    def read(self) -> tuple[list[Block], dict[str, int]]:
        blocks: list[Block] = []
        while (found := _NEXT_BLOCK.search(self._text, self._at)) is not None:
            self._at = found.start(1)
            if self._commented(found.start(1)):
                self._at = found.end()
                continue
            token = self._next()
            if token.upper not in _BLOCKS:
                continue  # a longer word, such as DATA_BLOCK-1
            try:
                block = self._block(token)
            except SourceError as error:
                self._problems.error(error.line, str(error))
                continue
            if block is not None:
                blocks.append(block)
        return blocks, self._constants

    def _commented(self, at: int) -> bool:
        """Return whether a place is inside a comment that began on an earlier line."""
        begin = max(0, self._seen - 1)
        opened = self._text.rfind("(*", begin, at)
        if opened >= 0:
            self._opened = "//" not in self._line_before(opened)
            begin = opened
        # Calls come in the order of places, so earlier text need not be searched again.
        self._opened = self._opened and self._text.find("*)", begin, at) < 0
        self._seen = at
        return self._opened

    def _line_before(self, at: int) -> str:
        return self._text[self._text.rfind("\n", 0, at) + 1 : at]

    # ---- tokens ---------------------------------------------------------------------------------------------------

    def _line(self, token: Token) -> int:
        return bisect_right(self._starts, token.at if token.at >= 0 else len(self._text))

    def _next(self) -> Token:
        """Return the next token that is not blank; a comment before it is kept in ``_note``."""
        while self._at < len(self._text):
            found = (_TOKEN if self._at >= self._no_text else _NO_TEXT).match(self._text, self._at)
            assert found is not None
            assert found.lastgroup is not None
            token = Token(found.lastgroup, found.group(), self._at)
            self._at = found.end()
            if token.text == "'" and token.at >= self._no_text:
                line_end = self._text.find("\n", token.at)
                self._no_text = line_end if line_end >= 0 else len(self._text)
            if token.kind == "unclosed":
                self._at = len(self._text)
                raise self._fail(
                    token,
                    f"{token.text} is never closed by {_CLOSING[token.text]}: all that follows it in the file was left out",
                )
            if token.kind == "note":
                self._note = token
            elif token.kind != "space":
                return token
        return _END

    def _peek(self) -> Token:
        at, note = self._at, self._note
        token = self._next()
        self._at, self._note = at, note
        return token

    def _rest_of_line(self) -> None:
        found = _LINE_END.match(self._text, self._at)
        assert found is not None
        self._at = found.end()

    def _fail(self, token: Token, text: str) -> SourceError:
        return SourceError(self._line(token), text)

    # ---- blocks ---------------------------------------------------------------------------------------------------

    def _block(self, opening: Token) -> Block | None:
        kind = opening.upper
        end = _BLOCKS[kind]
        line = self._line(opening)
        name, number = self._name()
        sections: dict[str, list[Member]] = {}
        of = ""
        optimized: bool | None = None
        while True:
            token = self._next()
            word = token.upper
            if token is _END:
                raise SourceError(line, f"{end} is missing for the {kind} {name!r}")
            if word == end:
                break
            if word in _LINES:
                self._rest_of_line()
            elif token.kind == "attributes":
                if found := _OPTIMIZED.search(token.text):
                    optimized = found[1].upper() == "TRUE"
            elif word == "STRUCT":
                sections.setdefault("VAR", []).extend(self._members(token, "STRUCT", "END_STRUCT", (end, "BEGIN"), 0))
            elif word in _SECTIONS:
                self._section(token, sections, end)
            elif word == "BEGIN":
                self._skip(end, kind != "DATA_BLOCK", line, name)
                break
            elif kind == "DATA_BLOCK" and word == "ARRAY":
                self._at = token.at
                bounds: list[str] = []
                type_, inner = self._type(bounds, (end, "BEGIN"), 0)
                sections["VAR"] = [Member(_ELEMENTS, type_, bounds, inner, False, "", self._line(token))]
            elif kind == "DATA_BLOCK" and token.kind in {"quoted", "word"} and word not in _WORDS and not sections:
                of = self._type_name(token)
            elif kind in {"FUNCTION", "ORGANIZATION_BLOCK"} and not sections and word not in _WORDS:
                continue  # the type that a function returns
            elif kind in {"FUNCTION", "FUNCTION_BLOCK", "ORGANIZATION_BLOCK"} and sections and token.kind == "word":
                self._skip(end, True, line, name)  # SCL without BEGIN
                break
        if kind in {"FUNCTION", "ORGANIZATION_BLOCK"}:
            return None
        shape = Shape([Section(sections[key], key == "VAR_IN_OUT") for key in _IN_MEMORY if key in sections])
        return Block(kind, name, number, shape, of, optimized, line)

    def _name(self) -> tuple[str, int | None]:
        """Return the name of a block, and its number if that is its name."""
        token = self._next()
        if token.kind == "quoted":
            return token.text[1:-1], None
        name = self._type_name(token)
        found = _NUMBERED.fullmatch(name)
        return name, int(found[2]) if found else None

    def _type_name(self, token: Token) -> str:
        """Return the name of a type or block; it may be two words, such as ``DB 10`` and ``UDT 3``."""
        if token.kind == "quoted":
            return token.text[1:-1]
        if token.upper in {"DB", "UDT", "FB", "SFB", "FC", "SFC", "OB", "SDB"}:
            number = self._peek()
            if number.text.isdigit():
                self._next()
                return f"{token.upper} {number.text}"
        found = _NUMBERED.fullmatch(token.text)
        return f"{found[1].upper()} {int(found[2])}" if found else token.text

    def _section(self, opening: Token, sections: dict[str, list[Member]], end: str) -> None:
        constant = opening.upper == "CONST"
        while self._peek().upper in _QUALIFIERS:
            constant = constant or self._peek().upper == "CONSTANT"
            self._next()
        closing = "END_CONST" if opening.upper == "CONST" else "END_VAR"
        members = self._members(opening, opening.upper, closing, (end, "BEGIN"), 0)
        if constant:
            for member in members:
                number = whole_number(member.initial)
                if number is not None:
                    self._constants[member.name.lower()] = number
        elif opening.upper in _IN_MEMORY:
            sections.setdefault(opening.upper, []).extend(members)

    def _skip(self, end: str, code: bool, line: int, name: str) -> None:
        """Skip code, or start values; a text in the latter may contain the keyword that ends them."""
        if code:
            found = re.compile(rf"^[ \t]*{end}\b", re.IGNORECASE | re.MULTILINE).search(self._text, self._at)
            self._at = found.end() if found else len(self._text)
            return
        while (token := self._next()) is not _END:
            if token.upper == end:
                return
        raise SourceError(line, f"{end} is missing for {name!r}")

    # ---- members --------------------------------------------------------------------------------------------------

    def _members(self, opening: Token, what: str, closing: str, beyond: tuple[str, ...], depth: int) -> list[Member]:
        """Return the members up to ``closing``; a keyword of ``beyond`` means that ``closing`` is missing."""
        if depth > _MOST_NESTED:
            raise self._fail(opening, f"structures within structures more than {_MOST_NESTED} deep")
        members: list[Member] = []
        while True:
            token = self._next()
            if token.upper == closing:
                if self._peek().text == ";":
                    self._next()
                return members
            if token is _END or token.upper in beyond or token.upper in _BLOCKS.values():
                at = f"at {token.text}" if token is not _END else "at the end of the file"
                raise self._fail(
                    opening, f"{closing} is missing: {what} of line {self._line(opening)} is still open {at}"
                )
            if token.text == ";":
                continue
            members.extend(self._declaration(token, beyond, depth))

    def _declaration(self, first: Token, beyond: tuple[str, ...], depth: int) -> list[Member]:
        names = [first]
        overlay = False
        token = self._next()
        while token.text != ":":
            if token.text == ",":
                names.append(self._next())
            elif token.upper == "AT":
                overlay = True
                self._next()
            elif token.kind != "attributes":
                raise self._fail(
                    first,
                    f"expected NAME : TYPE; found {first.text[:40]!r} followed by {token.text[:40] or 'the end'!r}",
                )
            token = self._next()
        if any([name.kind not in {"word", "quoted"} for name in names]):
            raise self._fail(first, f"expected the name of a member, found {first.text[:40]!r}")
        bounds: list[str] = []
        type_, shape = self._type(bounds, beyond, depth)
        initial = self._ending(first, shape is not None)
        comment = self._comment()
        return [
            Member(_plain(name), type_, bounds, shape, overlay, comment, self._line(name), initial) for name in names
        ]

    def _type(self, bounds: list[str], beyond: tuple[str, ...], depth: int) -> tuple[str, Shape | None]:
        """Return the type after a colon; the bounds of arrays are added to ``bounds``."""
        token = self._next()
        while token.kind == "attributes":
            token = self._next()
        while token.upper == "ARRAY":  # a loop, because a file may nest thousands of arrays of arrays
            self._expect("[", token)
            text = ""
            while (part := self._next()).text != "]":
                if part is _END or part.text == ";":
                    raise self._fail(token, "the bounds of an array are not closed: expected ARRAY [1..10] OF TYPE")
                if part.text == ",":
                    bounds.append(text)
                    text = ""
                else:
                    text += part.text
            bounds.append(text)
            of = self._next()
            if of.upper != "OF":
                raise self._fail(token, f"expected OF after the bounds of an array, found {of.text[:40]!r}")
            token = self._next()
            while token.kind == "attributes":
                token = self._next()
        if token.upper == "STRUCT":
            return "STRUCT", Shape([Section(self._members(token, "STRUCT", "END_STRUCT", beyond, depth + 1))])
        if token.kind not in {"word", "quoted"}:
            raise self._fail(token, f"expected a type after the colon, found {token.text[:40]!r}")
        name = self._type_name(token)
        if self._peek().text == "[" and token.upper in {"STRING", "WSTRING"}:
            self._next()
            length = self._next()
            self._expect("]", token)
            name = f"{name}[{length.text}]"
        return name, None

    def _expect(self, mark: str, near: Token) -> None:
        token = self._next()
        if token.text != mark:
            raise self._fail(near, f"expected {mark!r} after {near.text!r}, found {token.text[:40]!r}")

    def _ending(self, first: Token, structure: bool) -> str:
        """Skip the start value and the semicolon of a member; return the value."""
        value = ""
        depth = 0
        while True:
            token = self._peek()
            if depth == 0:
                if token.text == ";":
                    self._next()
                    return value
                closing = token.upper.startswith("END_") or token is _END
                if closing or (structure and not value) or self._is_member(token):
                    if not structure and not closing:
                        self._problems.warning(
                            self._line(first),
                            f"the semicolon behind {_plain(first)!r} is missing; it was read as if it were there",
                        )
                    return value
            if token is _END:
                return value
            self._next()
            depth += {"[": 1, "(": 1, "]": -1, ")": -1}.get(token.text, 0)
            if token.text != ":=":
                value += token.text

    def _is_member(self, token: Token) -> bool:
        """Return whether a token on a new line begins the next member."""
        if token.kind not in {"word", "quoted"} or "\n" not in self._text[self._last_end() : token.at]:
            return False
        found = re.compile(r"\s*(?:\{[^}]*\}\s*)?:(?!=)").match(self._text, token.at + len(token.text))
        return found is not None

    def _last_end(self) -> int:
        return self._at

    def _comment(self) -> str:
        """Return the comment on the line on which the member ends."""
        found = _NOTE_BEHIND.match(self._text, self._at)
        if found is None:
            return ""
        line_end = self._text.find("\n", self._at)
        rest = self._text[self._at : line_end if line_end >= 0 else len(self._text)].strip()
        if rest.startswith("//"):
            return rest.lstrip("/").strip()
        if rest.startswith("(*") and rest.endswith("*)"):
            return rest[2:-2].strip()
        return ""


def _plain(token: Token) -> str:
    return token.text[1:-1] if token.kind == "quoted" else token.text
