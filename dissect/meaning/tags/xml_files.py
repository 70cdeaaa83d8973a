"""XML of TIA: tag tables from its editor, and tag tables, data blocks and types from Openness (sheet 2.3 to 2.5)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

from dissect.meaning.tags.declarations import Block, Member, Section, Shape
from dissect.meaning.tags.symbol_tables import add_constant, take_constant
from dissect.meaning.tags.tag_file import Row, TagFile
from dissect.meaning.tags.types import whole_number

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

#: The attribute that stores the line of an element.
_LINE: Final = "s7dissect.line"
_MAX_DEPTH: Final = 200
#: The greatest number of a block, which has 16 bits.
_LAST_BLOCK: Final = 0xFFFF
#: Sections in their order in memory; other sections need no memory.
_ORDER: Final = {"Input": 0, "Output": 1, "InOut": 2, "Static": 3, "None": 3}


class XmlError(ValueError):
    """Content is not XML, or XML that is not accepted; ``line`` if it is known."""

    def __init__(self, line: int, text: str) -> None:
        self.line = line
        super().__init__(text)


def parse_xml(octets: bytes) -> Element:
    """Return the root of a document; each element has the line on which it begins. Raises `XmlError`, ImportError."""
    from xml.etree.ElementTree import ParseError, TreeBuilder

    from defusedxml.common import DefusedXmlException
    from defusedxml.ElementTree import DefusedXMLParser

    depth = 0

    class Builder(TreeBuilder):
        """Notes the line of each element, and stops if elements are nested too deep for recursion."""

        def start(self, tag: Any, attrs: Any, /) -> Any:
            nonlocal depth
            depth += 1
            if depth > _MAX_DEPTH:
                raise XmlError(expat.CurrentLineNumber, f"elements within elements more than {_MAX_DEPTH} deep")
            return super().start(tag, {**attrs, _LINE: str(expat.CurrentLineNumber)})

        def end(self, tag: Any, /) -> Any:
            nonlocal depth
            depth -= 1
            return super().end(tag)

    parser = DefusedXMLParser(target=Builder(), forbid_dtd=True)
    expat = parser.parser
    try:
        parser.feed(octets)
        root: Element = parser.close()
    except DefusedXmlException:
        raise XmlError(
            expat.CurrentLineNumber, "has a document type or entities, which no export has: not read"
        ) from None
    except ParseError as error:
        raise XmlError(error.position[0], f"is not well-formed XML: {error}") from None
    except XmlError:
        raise
    except (ValueError, LookupError) as error:
        raise XmlError(1, f"the encoding cannot be read: {error}") from None
    return root


def local(element: Element) -> str:
    """Return the name of an element without its namespace."""
    return element.tag.rpartition("}")[2]


def _line(element: Element) -> int:
    return int(element.get(_LINE, "0"))


def read_xml(root: Element, into: TagFile) -> None:
    """Read a document of TIA."""
    name = local(root)
    if name in {"Tagtable", "Tagtables"}:
        into.format = "TIA tag table (XML)"
        _tag_table(root, into)
        return
    if name == "Document":
        engineering = root.find("Engineering")
        version = engineering.get("version", "") if engineering is not None else ""
        into.format = f"TIA Openness {version}".strip()
        found = 0
        for element in root:
            kind = local(element)
            if kind == "SW.Tags.PlcTagTable":
                _openness_tags(element, into)
            elif kind in {
                "SW.Blocks.GlobalDB",
                "SW.Blocks.InstanceDB",
                "SW.Blocks.ArrayDB",
                "SW.Types.PlcStruct",
                "SW.Blocks.FB",
            }:
                _openness_block(element, kind, into)
            elif kind.startswith("SW."):
                into.problems.error(
                    _line(element), f"{kind} has no variables with addresses: export tag tables, data blocks and types"
                )
            else:
                continue
            found += 1
        if not found:
            into.problems.error(0, "an Openness document without a tag table, data block or type")
        return
    into.problems.error(0, f"XML with the root {name[:60]!r}: expected Tagtable (TIA) or Document (Openness)")


def _tag_table(root: Element, into: TagFile) -> None:
    for element in root.iter():
        kind = local(element)
        text = (element.text or "").strip()
        if kind == "Tag":
            comment = element.get("remark", "")
            into.add(Row(_line(element), text, element.get("addr", ""), element.get("type", ""), comment))
        elif kind == "Constant":
            add_constant(into, text, element.get("value", ""))


# ---- Openness -------------------------------------------------------------------------------------------------------


def _attributes(element: Element) -> dict[str, str]:
    """Return the attributes of an object: texts by name."""
    for child in element:
        if local(child) == "AttributeList":
            return {local(each): (each.text or "").strip() for each in child}
    return {}


def _comment(element: Element) -> str:
    """Return the first comment of an object, in any language, that is not empty."""
    for child in element.iter():
        if local(child) == "MultilingualText" and child.get("CompositionName") == "Comment":
            for text in child.iter():
                if local(text) == "Text" and (text.text or "").strip():
                    return (text.text or "").strip()
    return ""


def _openness_tags(table: Element, into: TagFile) -> None:
    for element in table.iter():
        kind = local(element)
        if kind == "SW.Tags.PlcTag":
            given = _attributes(element)
            row = Row(
                _line(element),
                given.get("Name", ""),
                given.get("LogicalAddress", ""),
                given.get("DataTypeName", ""),
                _comment(element),
            )
            into.add(row)
        elif kind == "SW.Tags.PlcUserConstant":
            given = _attributes(element)
            add_constant(into, given.get("Name", ""), given.get("Value", ""))


def _openness_block(element: Element, kind: str, into: TagFile) -> None:
    given = _attributes(element)
    name = given.get("Name", "")
    number = whole_number(given.get("Number", ""))
    if number is not None and not 0 <= number <= _LAST_BLOCK:
        number = None
    layout = given.get("MemoryLayout", "")
    optimized = None if not layout else layout.lower() != "standard"
    sections: list[tuple[int, Section]] = []
    for section in _sections(element):
        where = section.get("Name", "")
        declared = [child for child in section if local(child) == "Member"]
        if where == "Constant":
            for each in declared:
                take_constant(into, each.get("Name", ""), _start_value(each))
        elif where in _ORDER and declared:
            sections.append((_ORDER[where], Section([_member(each) for each in declared], where == "InOut")))
    sections.sort(key=lambda row: row[0])
    role = {"SW.Types.PlcStruct": "TYPE", "SW.Blocks.FB": "FUNCTION_BLOCK"}.get(kind, "DATA_BLOCK")
    shape = Shape([section for _, section in sections])
    of = given.get("InstanceOfName", "") if not sections else ""
    into.blocks.append(Block(role, name, number, shape, of, optimized, _line(element)))


def _sections(block: Element) -> Iterator[Element]:
    """Yield the sections of a block or type, but not those of expanded types inside its members."""
    for attributes in block:
        if local(attributes) == "AttributeList":
            outer = next((each for each in attributes.iter() if local(each) == "Sections"), None)
            if outer is not None:
                yield from [each for each in outer if local(each) == "Section"]


def _start_value(member: Element) -> str:
    return next(((each.text or "").strip() for each in member if local(each) == "StartValue"), "")


def _member(element: Element) -> Member:
    """Return a member. A structure contains its own members; a user's type is named in quotes."""
    written = element.get("Datatype", "")
    bounds: list[str] = []
    if written.lower().startswith("array"):
        inner, _, rest = written.partition("[")[2].partition("]")
        bounds = inner.split(",")
        written = rest.strip()[2:].strip() if rest.strip().lower().startswith("of") else rest.strip()
    shape = None
    if written.lower() == "struct":
        shape = Shape([Section([_member(child) for child in element if local(child) == "Member"])])
    comment = next(_texts(element), "")
    return Member(element.get("Name", ""), written.strip('"'), bounds, shape, False, comment, _line(element))


def _texts(element: Element) -> Iterator[str]:
    for child in element:
        if local(child) == "Comment":
            for text in child.iter():
                if local(text) == "MultiLanguageText" and (text.text or "").strip():
                    yield (text.text or "").strip()
