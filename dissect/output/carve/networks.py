"""Lists the bodies of S7-1200/1500 blocks: the XML that is transferred with the CPU's code, network by network.

Networks in ladder or function block diagram become one line for each output, written with the names of the gates. SCL becomes
its source, token by token. Names come from the references that are transferred with the body. The XML is Siemens' own; its form
is taken from captures (mc7 reference section 12).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from difflib import SequenceMatcher
from typing import TYPE_CHECKING, Final, NamedTuple

from dissect.engine.program.carved import CarvedBlock
from dissect.engine.program.plus import BODY, INTERFACE, REFERENCES
from dissect.protocols.mc7.changes import INTERFACE as DECLARATIONS
from dissect.protocols.mc7.changes import NETWORK, Change
from dissect.protocols.s7plus.blobs import open_blob
from dissect.wire.text import count

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

NEEDS: Final = "the body of an S7-1200/1500 block needs s7commplus and defusedxml: pip install 's7dissect[s7plus]'"
#: Limits: size of a text that is read, nested gates, and characters of a line.
_LARGEST: Final = 4 * 1024 * 1024
_DEPTH: Final = 60
#: Maximum number of gates in one line: wires may cross so that each gate leads to all others.
_GATES: Final = 1000
_WIDTH: Final = 4000
_ESCAPED: Final = re.compile("_x([0-9A-Fa-f]{4})_")
_RAIL: Final = "TRUE"
_AND: Final = " AND "
#: The pin of a ladder comparison for the logic before it.
_PRECEDING: Final = "pre"
#: The pins between two boxes if the second one depends on whether the first one succeeded.
_ENABLES: Final = ("eno", "en")
#: The program editor's name for the only section of a data block; then limits: nested structures, and names of a section.
_STATIC: Final = "Static"
_SECTION: Final = "Section"  # the name of a section in TIA Portal V11 and V12; a section has a number as its type
_NESTED: Final = 8
_MEMBERS: Final = 10_000
#: Maximum number of digits of an index or a position.
_INDEX: Final = 6
#: Gates that join their inputs, and the text between these.
_JOINS: Final[dict[str, str]] = {"O": " OR ", "A": _AND, "X": " XOR "}
#: Gates that write their operand, and the text before it.
_COILS: Final[dict[str, str]] = {"Coil": "", "SCoil": "set ", "RCoil": "reset "}
#: Tokens of SCL that are not names.
_TOKENS: Final[dict[str, str]] = {"BL": " ", "NL": "\n", "OpAs": ":=", "FiSt": ";"}


class PlusNetwork(NamedTuple):
    """A network: its number from 1 on, its language, and its lines."""

    number: int
    language: str
    lines: tuple[str, ...]


def networks(block: CarvedBlock, dictionaries: Mapping[int, bytes]) -> list[PlusNetwork] | None:
    """Return the networks of a block's body in order; empty if there is no body, None if it cannot be opened."""
    try:
        from defusedxml.ElementTree import fromstring  # noqa: F401 - only to see whether it is installed
    except ImportError:
        return None
    bodies: list[Element] = []
    names: dict[str, str] = {}
    closed = 0
    for id_, octets in block.plus.blobs() if block.plus is not None else ():
        if id_ not in {BODY, REFERENCES}:
            continue
        root = _parsed(octets, dictionaries)
        if root is None:
            closed += id_ == BODY
        elif id_ == BODY:
            bodies.append(root)
        else:
            names |= {each.get("RefId", ""): _name(each.get("Name", "")) for each in root.iter("Ident")}
    if closed and not bodies:
        return None
    return sorted([_network(root, names) for root in bodies])


def _parsed(octets: bytes, dictionaries: Mapping[int, bytes]) -> Element | None:
    from defusedxml.common import DefusedXmlException
    from defusedxml.ElementTree import ParseError, fromstring

    opened = open_blob(octets, dictionaries, _LARGEST)
    if opened.fault or not opened.octets:
        return None
    try:
        root: Element = fromstring(opened.octets)
    except (ParseError, DefusedXmlException, ValueError):
        return None
    return root


def _name(text: str) -> str:
    """Return a name with its XML escapes replaced: ``DB_x0020_333`` is ``DB 333``."""
    return _ESCAPED.sub(lambda found: chr(int(found[1], 16)), text)


def _tag(element: Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _network(root: Element, names: Mapping[str, str]) -> PlusNetwork:
    place = root.get("NetPos", "")
    number = int(place) if place.isascii() and place.isdigit() and len(place) < _INDEX else 0
    lines: list[str] = []
    for child in root:
        if _tag(child) == "FlgNet":
            lines += _Gates(child, names).lines()
        elif _tag(child) == "SCLSource":
            lines += _source(child, names)
    return PlusNetwork(number, root.get("Lang", ""), tuple([_bounded(line) for line in lines]))


def _bounded(line: str) -> str:
    return line if len(line) <= _WIDTH else f"{line[:_WIDTH]}…"


class _Gates:
    """The gates of one network and the wires at their pins."""

    def __init__(self, root: Element, names: Mapping[str, str]) -> None:
        self._parts: dict[str, Element] = {}
        self._inputs: dict[str, dict[str, tuple[str, str]]] = {}  # pin → (gate, pin), or (gate, "") for an operand
        self._outputs: dict[str, list[tuple[str, str]]] = {}  # by gate: (pin, operand)
        self._used: dict[str, int] = {}
        self._enabling: set[str] = set()  # gates whose enable output enables a further gate
        self._names = names
        self._left = _GATES
        for element in root.iter():
            uid = element.get("UId", "")
            if _tag(element) == "Wire":
                self._wire(list(element))
            elif uid and _tag(element) not in {"PCon", "OCon", "Wire"}:
                self._parts[uid] = element

    def _wire(self, ends: list[Element]) -> None:
        if not ends:
            return
        source = ends[0].get("UId", ""), ends[0].get("PinName", "")
        for end in ends[1:]:
            uid, pin = end.get("UId", ""), end.get("PinName", "")
            if _tag(end) == "PCon":
                self._inputs.setdefault(uid, {})[pin] = source
                self._used[source[0]] = self._used.get(source[0], 0) + 1
                if (source[1], pin) == _ENABLES:
                    self._enabling.add(source[0])
            elif _tag(end) == "OCon":
                self._outputs.setdefault(source[0], []).append((source[1], self._operand(uid)))

    def _operand(self, uid: str) -> str:
        part = self._parts.get(uid)
        if part is None:
            return "?"
        reference = part.get("RefId", "")
        if reference:
            return self._names.get(reference) or f"ref {reference}"
        return "".join(part.itertext()).strip() or "?"

    def _gate(self, part: Element) -> str:
        reference = part.get("RefId", "")
        if _tag(part) != "Part" and reference:
            return f"CALL {self._names.get(reference) or f'ref {reference}'}"
        return _name(part.get("Gate") or part.get("Name") or _tag(part))

    def _with_instance(self, part: Element, gate: str) -> str:
        """Return a gate with its instance: ``CALL fb, instance``, or ``instance.TON`` as in SCL."""
        found = [each.get("RefId", "") for each in part if _tag(each) == "Instance"]
        if not found:
            return gate
        instance = self._names.get(found[0]) or f"ref {found[0]}"
        return f"{instance}.{gate}" if _tag(part) == "Part" else f"{gate}, {instance}"

    def lines(self) -> list[str]:
        """Return a line for each gate that is not part of a different gate's line."""
        found: list[str] = []
        for uid, part in self._parts.items():
            gate = part.get("Gate", "")
            self._left = _GATES
            if _tag(part) != "Part" and uid not in self._inputs:
                continue
            if gate in _COILS and "operand" in self._inputs.get(uid, {}):
                wanted = self._inputs[uid]
                operand = self._text(wanted["operand"], 0)
                text = self._text(wanted.get("in", ("", "")), 0)
                negated = _negated(part)
                if ("in" in negated) != ("operand" in negated):
                    text = _not(text)
                found.append(f"{_COILS[gate]}{operand} := {text}")
            elif uid in self._outputs or uid not in self._used or uid in self._enabling:
                told = self._text((uid, ""), 0)
                outputs = [f"{pin} => {operand}" for pin, operand in self._outputs.get(uid, [])]
                found.append(" ".join([told, *outputs]))
        return found

    def _text(self, source: tuple[str, str], depth: int) -> str:
        uid, pin = source
        part = self._parts.get(uid)
        if part is None:
            return _RAIL
        if _tag(part) != "Part" and uid not in self._inputs:
            return self._operand(uid)
        self._left -= 1
        if depth >= _DEPTH or self._left < 0:
            return "…"
        gate, inputs = self._gate(part), self._inputs.get(uid, {})
        negated = _negated(part)
        texts = {name: self._input(name, inputs[name], depth) for name in sorted(inputs)}
        texts |= {name: _not(text) for name, text in texts.items() if name in negated}
        if gate == "Contact":
            before = texts.get("in", _RAIL)
            operand = texts.get("operand", "?")
            return operand if before == _RAIL else f"{before}{_AND}{operand}"
        if gate in _JOINS:
            return f"({_JOINS[gate].join(texts.values())})"
        if gate in _COILS:
            return texts.get("in", _RAIL)  # a coil within a line passes its input on
        before = texts.pop(_PRECEDING, _RAIL)
        arguments = ", ".join([f"{name} := {text}" for name, text in texts.items() if text != _RAIL])
        shown = f"{self._with_instance(part, gate)}({arguments})"
        shown = f"{shown}.{pin}" if pin not in {"", "out", "OUT", "eno"} else shown
        return shown if before == _RAIL else f"{before}{_AND}{shown}"

    def _input(self, pin: str, source: tuple[str, str], depth: int) -> str:
        """Return the input of a pin; for an enable output the name of its box, which has its own line."""
        part = self._parts.get(source[0])
        wired = part is not None and source[0] in self._inputs
        if part is not None and wired and (source[1], pin) == _ENABLES:
            return f"{self._gate(part)}.ENO"
        return self._text(source, depth + 1)


def _negated(part: Element) -> set[str]:
    """Return the negated pins of a gate; a negated coil has a negated operand."""
    return {each.get("PinName", "") for each in part.iter() if _tag(each) == "Negated"}


def _not(text: str) -> str:
    depth = 0
    for at, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and text.startswith(_AND, at):
            return f"NOT ({text})"
    return f"NOT {text}"


def interface(block: CarvedBlock, dictionaries: Mapping[int, bytes]) -> list[tuple[str, list[str]]]:
    """Return the sections of a block's interface that have members, with the names; empty if it cannot be opened.

    Members of structures have the name of the structure before theirs. A data block without a function block has one section,
    `_STATIC`; an instance has those of its function block.
    """
    try:
        import defusedxml  # noqa: F401 - only to see whether it is installed
    except ImportError:
        return []
    found: list[tuple[str, list[str]]] = []
    for id_, octets in block.plus.blobs() if block.plus is not None else ():
        root = _parsed(octets, dictionaries) if id_ == INTERFACE else None
        if root is not None:
            found += _sections(root)
    return found


def _sections(root: Element) -> list[tuple[str, list[str]]]:
    """Return the sections of the first part of an interface that has declarations; parts it refers to are only structures."""
    found: list[tuple[str, list[str]]] = []
    for part in [each for each in root.iter() if _tag(each) == "Part"]:
        declared = [each for head in _within(part, "Payload", "Root") for each in head if _tag(each) == "Member"]
        if not declared:
            continue
        loose: list[str] = []
        parts = _within(part, "SubParts")
        for member in declared:
            if member.get("RID") and member.get("Type") != _SECTION:  # has a type: a variable
                _add_names(loose, member, parts, "", 0)
                continue
            names: list[str] = []
            inner, inner_parts = _inside(member, parts)
            for each in inner:
                _add_names(names, each, inner_parts, "", 0)
            if names:
                found.append((_name(member.get("Name", "")), names))
        return [(_STATIC, loose), *found] if loose else found
    return []


def _within(element: Element, *tags: str) -> list[Element]:
    """Return the content of elements with the tag ``tags[0]``; with a second tag only the elements with that tag."""
    inner = [each for head in element if _tag(head) == tags[0] for each in head]
    return [each for each in inner if _tag(each) == tags[1]] if len(tags) > 1 else inner


def _inside(member: Element, parts: list[Element]) -> tuple[list[Element], list[Element]]:
    """Return the members of a section or structure, in it or in another part, and the parts to which these refer."""
    own = [each for each in member if _tag(each) == "Member"]
    if own:
        return own, parts
    index = member.get("SubPartIndex", "")
    if not index.isdecimal() or len(index) >= _INDEX or int(index) >= len(parts):
        return [], []
    part = parts[int(index)]
    heads = _within(part, "Payload", "Member")
    return [each for head in heads for each in head if _tag(each) == "Member"], _within(part, "SubParts")


def _add_names(names: list[str], member: Element, parts: list[Element], before: str, depth: int) -> None:
    """Add the name of a variable; for a structure the names of its members."""
    if len(names) >= _MEMBERS:
        return
    name = before + _name(member.get("Name", ""))
    inner, inner_parts = _inside(member, parts) if depth < _NESTED else ([], [])
    for each in inner:
        _add_names(names, each, inner_parts, f"{name}.", depth + 1)
    if not inner:
        names.append(name)


def _source(root: Element, names: Mapping[str, str]) -> list[str]:
    """Return SCL from its tokens; unknown tokens are in angle brackets."""
    symbols = {
        each.get("SymID", ""): names.get(each.get("RefId", ""), f"ref {each.get('RefId', '?')}")
        for each in root.iter()
        if _tag(each) == "Symbol"
    }
    statements = next((each for each in root.iter() if _tag(each) == "RootStatements"), None)
    text = "".join([_token(each, symbols) for each in statements.iter()]) if statements is not None else ""
    return [line.strip() for line in text.split("\n") if line.strip()]


def _token(element: Element, symbols: Mapping[str, str]) -> str:
    tag = _tag(element)
    if tag in _TOKENS:
        return _TOKENS[tag]
    if tag == "Const":
        return element.get("TE", "?")
    if "SyId" in element.keys() and tag != "Const":  # noqa: SIM118 - an Element is no mapping
        return symbols.get(element.get("SyId", ""), "?")
    return "" if len(element) else f"<{tag}>"


# ---- comparison -----------------------------------------------------------------------------------------------------


def compare_sections(before: list[tuple[str, list[str]]], after: list[tuple[str, list[str]]]) -> list[Change]:
    """Return the names that an interface gained and lost, given results of `interface`; empty if one could not be opened."""
    if not before or not after:
        return []
    old, new = [{(section, name): None for section, names in each for name in names} for each in (before, after)]
    gone = [f"{section} {name}" for section, name in old if (section, name) not in new]
    fresh = [f"{section} {name}" for section, name in new if (section, name) not in old]
    return [Change(DECLARATIONS, 0, text, "", f"{text} removed") for text in gone] + [
        Change(DECLARATIONS, 0, "", text, f"{text} added") for text in fresh
    ]


def compare_networks(before: list[PlusNetwork], after: list[PlusNetwork]) -> list[Change]:
    """Return the changes between two bodies by network; equal networks are aligned first."""
    old, new = [network.lines for network in before], [network.lines for network in after]
    changes: list[Change] = []
    for tag, a, b, c, d in SequenceMatcher(None, old, new, False).get_opcodes():
        if tag == "equal":
            continue
        common = min(b - a, d - c)
        for at in range(common):
            changes += _lines_changed(before[a + at], after[c + at])
        changes += [
            Change(NETWORK, each.number, "\n".join(each.lines), "", " removed") for each in before[a + common : b]
        ]
        changes += [
            Change(NETWORK, each.number, "", "\n".join(each.lines), f" added ({count(len(each.lines), 'line')})")
            for each in after[c + common : d]
        ]
    return changes


def _lines_changed(before: PlusNetwork, after: PlusNetwork) -> Iterator[Change]:
    for tag, a, b, c, d in SequenceMatcher(None, before.lines, after.lines, False).get_opcodes():
        if tag == "equal":
            continue
        was, now = "; ".join(before.lines[a:b]), "; ".join(after.lines[c:d])
        text = f"{was} → {now}" if was and now else f"{now} added" if now else f"{was} removed"
        yield Change(NETWORK, after.number, was, now, text)
