"""A whole block as text, and the way back: extends the assembler from code to all parts of a block.

Sections: ``[header]`` and ``[footer]`` with ``field = value`` for the fields of `dissect.protocols.s7.blocks`; ``[interface]``
with one declaration per line and members indented below; ``[code]`` with the listing; ``[tables]`` with everything that the
listing does not contain. Lengths, networks and jumps are computed; the text contains them only if those in the block are
different.
"""

from __future__ import annotations

import re
from typing import Final

from dissect.protocols.mc7.assembler import Assembled, AssemblyError, assemble, source_lines
from dissect.protocols.mc7.block import MARK, Block, Tables, tables_octets
from dissect.protocols.mc7.interface import (
    ARRAY,
    INSTANCES,
    SECTIONS,
    STRING,
    STRUCT,
    TYPES,
    Declaration,
    Interface,
    interface_octets,
    name_declarations,
    parse_interface,
)
from dissect.protocols.mc7.labels import jump_labels, parameter_names
from dissect.protocols.s7.blocks import FOOTER, HEADER
from dissect.wire.layout import Field, Layout
from dissect.wire.part import Part

_SECTION: Final = re.compile(r"\[(\w+)\]")
_PAIR: Final = re.compile(r"(\w+) = ?(.*)")
_DECLARATION: Final = re.compile(
    r"(?:(?P<section>IN|OUT|IN_OUT|STAT|TEMP|RET_VAL|0x[0-7])(?:\+(?P<flags>[0-9A-F]{2}))?"
    r"(?: \((?P<attribute>[0-9A-F]{2})\))? )?(?P<type>[A-Z_0-9]+)(?P<rest>.*)"
)
_BOUNDS: Final = re.compile(r" \[(.+)\] OF")
_LENGTHS: Final = ("ssb_length", "add_length", "mc7_length", "load_length")
_TEXTS: Final = frozenset(("author", "family", "name"))
_TYPE_OF: Final = {code.name: code.number for code in TYPES}
_SECTION_OF: Final = {code.name: code.number for code in SECTIONS}


def block_source(block: Block) -> str:
    """Return a block, which must have header and footer, as text that `assemble_block` turns into the same bytes."""
    lines = ["[header]", *_fields(block.header, _stated_lengths(block)), "", "[interface]"]
    lines += _interface_lines(block)
    code = code_lines(block) if block.has_code else []
    lines += ["", "[code]", *code] if block.has_code else ["", "[values]", *_hex_lines(block.code)]
    lines += ["", "[tables]", *_table_lines(block, code), "", "[footer]", *_fields(block.footer, frozenset())]
    return "\n".join(lines) + "\n"


def _stated_lengths(block: Block) -> frozenset[str]:
    """Return the length fields that equal the sizes of the parts."""
    sizes = (len(block.interface_octets), len(block.additional), len(block.code))
    found = {name for name, size in zip(_LENGTHS, sizes, strict=False) if block.field(name) == size}
    if block.field("load_length") == HEADER.size + FOOTER.size + sum(sizes):
        found.add("load_length")
    return frozenset(found)


def _fields(part: Part | None, left_out: frozenset[str]) -> list[str]:
    lines: list[str] = []
    for value in part.values if part is not None else []:
        name = value.field.name
        if name in left_out or name == "mark" or (not value.value and not value.octets):
            continue
        if value.octets is None:
            lines.append(f"{name} = {value.value}")
            continue
        text = value.octets.rstrip(b"\0").decode("latin-1")
        plain = name in _TEXTS and text.isascii() and text.isprintable() and text == text.strip()
        if value.octets.strip(b"\0"):
            lines.append(f'{name} = "{text}"' if plain else f"{name} = {value.octets.hex()}")
    return lines


def _hex_lines(octets: bytes) -> list[str]:
    return [octets[at : at + 32].hex() for at in range(0, len(octets), 32)]


def _interface_lines(block: Block) -> list[str]:
    interface = block.interface
    if interface_octets(interface) != block.interface_octets or interface.fault:
        return ["octets = " + block.interface_octets.hex()]
    lines = [f"kind = {interface.kind}", f"number = {interface.number}"]
    for declaration in interface.declarations:
        lines += _declaration_lines(declaration, 0)
    if interface.starts:
        lines.append(f"start_values = {interface.starts.hex()}")
    if interface.rest:
        lines.append(f"rest = {interface.rest.hex()}")
    return lines


def _declaration_lines(declaration: Declaration, depth: int) -> list[str]:
    text = ""
    if declaration.section >= 0:
        text = SECTIONS.name(declaration.section & 7)
        if declaration.section & ~7:
            text += f"+{declaration.section & ~7:02X}"
        if declaration.attribute >= 0:
            text += f" ({declaration.attribute:02X})"
        text += " "
    if declaration.type == ARRAY:
        bounds = ",".join([f"{low}..{high}" for low, high in declaration.bounds])
        text += f"ARRAY [{bounds}] OF"
    elif declaration.type == STRUCT:
        text += "STRUCT WIDE" if declaration.wide else "STRUCT"
    else:
        text += declaration.type_text
    lines = ["  " * depth + text]
    for member in declaration.members:
        lines += _declaration_lines(member, depth + 1)
    return lines


def code_lines(block: Block) -> list[str]:
    """Return the listing of the code, which `assemble` turns into the same bytes."""
    names, labels = parameter_names(block), jump_labels(block)
    lines: list[str] = []
    for network in block.networks:
        if block.tables.networks:
            lines.append(f"NETWORK {network.number}")
        lines += source_lines(network.instructions, labels, False, names)
    return lines


def _table_lines(block: Block, code: list[str]) -> list[str]:
    if not block.tables.present or not block.has_code or block.tables.cut:
        return [f"octets = {block.additional.hex()}"] if block.additional else []
    tables = block.tables
    made = _made_tables(assemble("\n".join(code), False, parameter_names(block)), tables.rest, len(block.code))
    lines = ["present = 1"]
    if made.networks != tables.networks:
        lines.append("networks = " + " ".join(str(length) for length in tables.networks))
    if made.jumps != tables.jumps:
        lines.append("jumps = " + " ".join(str(offset) for offset in tables.jumps))
    if tables.rest:
        lines.append(f"rest = {tables.rest.hex()}")
    return lines


def _made_tables(assembled: Assembled, rest: bytes, size: int) -> Tables:
    ends = [*assembled.networks[1:], max(size - 2, 0)] if assembled.networks else []
    lengths = [max(end - start, 0) for start, end in zip(assembled.networks, ends, strict=True)]
    return Tables(lengths, assembled.jumps, rest, True, False)


def assemble_block(text: str) -> bytes:
    """Return the bytes of a block from its text. Raises `AssemblyError` with the number of the wrong line."""
    sections = _sections(text)
    pairs = {name: _pairs(lines) for name, lines in sections.items() if name in {"header", "footer", "tables"}}
    interface = _assemble_interface(sections.get("interface", []))
    header, tables = pairs.get("header", {}), pairs.get("tables", {})
    block = Block(b"")
    block.interface = parse_interface(interface)
    block.kind = "FC" if header.get("block_kind") == "12" else ""
    if "code" in sections:
        assembled = assemble(_padded(sections["code"]), False, parameter_names(block))
        code = assembled.code
        additional = _assemble_tables(assembled, tables)
    else:
        code = bytes.fromhex("".join(line for _, line in sections.get("values", [])))
        additional = bytes.fromhex(tables.get("octets", ""))
    sizes = {"ssb_length": len(interface), "add_length": len(additional), "mc7_length": len(code)}
    sizes["load_length"] = HEADER.size + FOOTER.size + sum(sizes.values())
    stated = {name: str(size) for name, size in sizes.items()} | header
    head = MARK + _field_octets(HEADER, stated)[len(MARK) :]
    return head + code + interface + additional + _field_octets(FOOTER, pairs.get("footer", {}))


def _padded(lines: list[tuple[int, str]]) -> str:
    """Return lines as a text in which each keeps its original line number."""
    padded: list[str] = []
    for number, line in lines:
        padded += [""] * (number - 1 - len(padded))
        padded.append(line)
    return "\n".join(padded)


def _sections(text: str) -> dict[str, list[tuple[int, str]]]:
    sections: dict[str, list[tuple[int, str]]] = {}
    lines: list[tuple[int, str]] = []
    for number, line in enumerate(text.splitlines(), 1):
        found = _SECTION.fullmatch(line.strip())
        if found is not None:
            lines = sections.setdefault(found[1], [])
        elif line.strip() and not line.strip().startswith("//"):
            lines.append((number, line))
    return sections


def _pairs(lines: list[tuple[int, str]]) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for number, line in lines:
        found = _PAIR.fullmatch(line.strip())
        if found is None:
            raise AssemblyError(number, f"expected FIELD = VALUE, got {line.strip()[:40]!r}")
        pairs[found[1]] = found[2]
    return pairs


def _assemble_tables(assembled: Assembled, pairs: dict[str, str]) -> bytes:
    if "octets" in pairs or pairs.get("present") != "1":
        return bytes.fromhex(pairs.get("octets", ""))
    tables = _made_tables(assembled, bytes.fromhex(pairs.get("rest", "")), len(assembled.code))
    if "networks" in pairs:
        tables = tables._replace(networks=[int(number) for number in pairs["networks"].split()])
    if "jumps" in pairs:
        tables = tables._replace(jumps=[int(number) for number in pairs["jumps"].split()])
    return tables_octets(tables)


def _field_octets(layout: Layout, pairs: dict[str, str]) -> bytes:
    octets = bytearray(layout.size)
    at = 0
    for index, field in enumerate(layout.fields):
        if index and not field.shares:
            at += layout.fields[index - 1].size
        text = pairs.get(field.name, "")
        if text:
            _put(octets, at, field, text)
    return bytes(octets)


def _put(octets: bytearray, at: int, field: Field, text: str) -> None:
    if field.means is not None and field.codes is None:
        data = text[1:-1].encode("latin-1") if text.startswith('"') else bytes.fromhex(text)
        octets[at : at + field.size] = data[: field.size].ljust(field.size, b"\0")
        return
    value = int(text)
    if field.bits is not None:
        value = int.from_bytes(octets[at : at + field.size], "big") | (value << field.bits[1] & field.bits[0])
    octets[at : at + field.size] = value.to_bytes(field.size, "big")


def _assemble_interface(lines: list[tuple[int, str]]) -> bytes:
    interface = Interface()
    stack: list[tuple[int, Declaration]] = []
    for number, line in lines:
        pair = _PAIR.fullmatch(line.strip())
        if pair is not None:
            if pair[1] == "octets":
                return bytes.fromhex(pair[2])
            if pair[1] in {"kind", "number"}:
                setattr(interface, pair[1], int(pair[2]))
            elif pair[1] == "start_values":
                interface.starts = bytes.fromhex(pair[2])
            else:
                interface.rest = bytes.fromhex(pair[2])
            continue
        depth = (len(line) - len(line.lstrip())) // 2
        declaration = _declaration(line.strip(), number)
        while stack and stack[-1][0] >= depth:
            stack.pop()
        (stack[-1][1].members if stack else interface.declarations).append(declaration)
        stack.append((depth, declaration))
    name_declarations(interface.declarations)
    return interface_octets(interface)


def _declaration(text: str, line: int) -> Declaration:
    found = _DECLARATION.fullmatch(text)
    if found is None or found["type"] not in _TYPE_OF:
        raise AssemblyError(line, f"{text[:40]!r} is not a declaration, for example IN INT")
    declaration = Declaration(_TYPE_OF[found["type"]])
    rest = found["rest"]
    if declaration.type in INSTANCES:
        declaration.extra = int(rest)
        return declaration
    if found["section"] is None:
        raise AssemblyError(line, f"the section is missing: one of {', '.join(_SECTION_OF)}")
    section = _SECTION_OF.get(found["section"])
    declaration.section = (int(found["section"], 16) if section is None else section) | int(found["flags"] or "0", 16)
    declaration.attribute = int(found["attribute"], 16) if found["attribute"] else -1
    if declaration.type == ARRAY:
        bounds = _BOUNDS.fullmatch(rest)
        if bounds is None:
            raise AssemblyError(line, "an array needs its bounds, for example ARRAY [0..9] OF")
        for part in bounds[1].split(","):
            low, _, high = part.partition("..")
            declaration.bounds.append((int(low), int(high)))
    elif declaration.type == STRING:
        declaration.extra = int(rest.strip("[]"))
    elif declaration.type == STRUCT:
        declaration.wide = rest == " WIDE"
    return declaration
