"""Loads files of tags into one set: recognises them by content, and joins declarations across files (docs/tags.md)."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from dissect.meaning.tags.captures import read_capture
from dissect.meaning.tags.csv_tables import first_line, has_header, looks_like_table, read_csv
from dissect.meaning.tags.declarations import Block, Shape, essence, looks_like_source, read_declarations
from dissect.meaning.tags.decoding import EncodingError, decode_text
from dissect.meaning.tags.json_lists import read_json
from dissect.meaning.tags.layout import Layout, LayoutError, type_names
from dissect.meaning.tags.model import Tag
from dissect.meaning.tags.naming import TagNaming
from dissect.meaning.tags.problems import ERROR, Problem
from dissect.meaning.tags.symbol_tables import TIA_FIELDS, V5_FIELDS, is_asc, read_asc, read_dif, read_sdf, read_seq
from dissect.meaning.tags.tag_file import TagFile
from dissect.meaning.tags.types import meant, unknown
from dissect.meaning.tags.xlsx_files import is_workbook, read_xlsx
from dissect.meaning.tags.xml_files import XmlError, parse_xml, read_xml
from dissect.packets.source.files import compression
from dissect.packets.source.pcap import PCAP_MAGICS
from dissect.packets.source.pcapng import PCAPNG_MAGIC
from dissect.protocols.s7.tables import DB
from dissect.protocols.s7plus.program import Program
from dissect.wire.config.hints import close_names, close_to
from dissect.wire.config.hostile import ContentError, check_code_page
from dissect.wire.errors import Error

MAX_FILE: Final = 64 << 20
_XML: Final = (b"<", b"\xff\xfe<", b"\xfe\xff\0<")
_FOREIGN: Final = (
    (b"SQLite format 3", "a SQLite database"),
    (b"\xd0\xcf\x11\xe0", "an OLE document, such as an old Excel workbook or a project file"),
    (b"MZ", "a Windows program"),
    (b"PK", "a ZIP archive, such as a TIA project archive, without a workbook"),
    (b"%PDF", "a PDF document"),
)
_MAGIC: Final = 4


class TagError(Error):
    """Files of tags cannot be used as they are; ``problems`` are all problems that were found in them."""

    def __init__(self, problems: list[Problem]) -> None:
        self.problems = problems
        super().__init__("\n".join([str(problem) for problem in problems if problem.severity == ERROR]))


class TagSet:
    """The tags of files that were read together.

    ``sizes`` are the sizes in octets of data blocks whose whole layout is known, by number.
    """

    def __init__(self, files: list[TagFile]) -> None:
        self.files = files
        self.tags: list[Tag] = []
        self.sizes: dict[int, int] = {}
        self.names: dict[int, str] = {}

    def naming(self, host: str = "") -> TagNaming:
        """Return a `TagNaming` for these tags; with ``host``, a single program from a capture is taken as that of this CPU."""
        programs = self.programs
        if host and len(programs) == 1:
            programs = {host: next(iter(programs.values()))}
        return TagNaming(self.tags, programs)

    def has_block(self, name: str) -> bool:
        """Return whether a file declares a data block with this name, in upper or lower case."""
        return name.lower() in [each.lower() for each in self.block_names]

    @property
    def block_names(self) -> list[str]:
        """The names of all data blocks that the files declare."""
        return [block.name for file in self.files for block in file.blocks if block.kind == "DATA_BLOCK"]

    @property
    def programs(self) -> dict[str, Program]:
        """The S7comm-plus variables from captures among the files, by the host of their CPU."""
        found: dict[str, Program] = {}
        for file in self.files:
            for host, program in file.programs.items():
                found.setdefault(host, Program()).adopt(program)
        return found

    @property
    def problems(self) -> list[Problem]:
        """The problems of all files, by file and line."""
        return [each for file in self.files for each in sorted(file.problems.found, key=lambda row: row.line)]

    @property
    def more(self) -> int:
        """The number of problems that were only counted."""
        return sum([file.problems.more for file in self.files])


def load_tags(
    paths: Sequence[str | os.PathLike[str]],
    encoding: str = "",
    numbers: Mapping[str, int] | None = None,
    more: bool = False,
) -> TagSet:
    """Return the tags of files; an error in any file means that none is used.

    ``encoding`` is the code page of files that do not show theirs. ``numbers`` gives data blocks their number by name; each of
    these must be in these files, unless ``more`` says that it may be in the files of another PLC. Raises `TagError` with all
    problems, OSError if a file cannot be read, ImportError (whose text says what to install) for a format that needs a library,
    LookupError for an unknown encoding.
    """
    found = read_tags(paths, encoding, numbers, more)
    if any([problem.severity == ERROR for problem in found.problems]):
        raise TagError(found.problems)
    return found


def read_tags(
    paths: Sequence[str | os.PathLike[str]],
    encoding: str = "",
    numbers: Mapping[str, int] | None = None,
    more: bool = False,
) -> TagSet:
    """Return the same as `load_tags`, even if files have errors. Raises OSError, ImportError, LookupError."""
    if encoding:
        try:
            check_code_page(encoding)
        except ContentError as error:
            raise LookupError(str(error)) from None
    files = [_read(os.fspath(path), encoding) for path in paths]
    found = TagSet(files)
    numbers = numbers or {}
    # A block may be missing because it cannot be read, which is a separate error.
    whole = files and not any([problem.severity == ERROR for problem in found.problems])
    for name in [name for name in numbers if whole and not more and not found.has_block(name)]:
        files[0].problems.error(
            0, f"--tags-db {name}: no file has a data block of that name{close_to(name, found.block_names)}"
        )
    _Joining(found, {name.lower(): number for name, number in numbers.items()}).join()
    return found


# ---- one file -------------------------------------------------------------------------------------------------------


def _read(path: str, encoding: str) -> TagFile:
    file = TagFile(path)
    with Path(path).open("rb") as stream:
        octets = stream.read(_MAGIC)
        packed = compression(octets)
        if packed or octets in PCAP_MAGICS or octets == PCAPNG_MAGIC:
            read_capture(file, packed)
            return file
        octets += stream.read(MAX_FILE + 1 - _MAGIC)
    if len(octets) > MAX_FILE:
        file.problems.error(0, f"more than {MAX_FILE >> 20} MB: not a file of tags")
    elif not octets.strip():
        file.problems.error(0, "is empty")
    else:
        _dispatch(octets, file, encoding)
        if not any([file.tags, file.blocks, file.symbols, file.placed, file.constants, file.problems.found]):
            file.problems.error(0, "has no tag, block or symbol")
    return file


def _dispatch(octets: bytes, file: TagFile, encoding: str) -> None:
    """Recognise the format of a file, and read it."""
    if is_workbook(octets):
        try:
            read_xlsx(octets, file)
        except ImportError:
            raise _missing(file.path, "XLSX", "python-calamine") from None
        return
    for begin, what in _FOREIGN:
        if octets.startswith(begin):
            file.problems.error(0, f"is {what}: not a file of tags; export the tags or the source of the block")
            return
    body = octets.lstrip(b"\xef\xbb\xbf \t\r\n")
    try:
        if body.startswith(_XML):
            read_xml(parse_xml(octets), file)
            return
        text, file.encoding = decode_text(octets, encoding)
    except ImportError:
        raise _missing(file.path, "XML", "defusedxml") from None
    except (XmlError, EncodingError) as error:
        file.problems.error(error.line, str(error))
        return
    if file.encoding:
        file.problems.note(
            0, f"is not UTF-8; read as {file.encoding}: if names look wrong, say --tags-encoding (cp1251, gbk, ...)"
        )
    _text(text, file)


def _missing(path: str, what: str, library: str) -> ImportError:
    return ImportError(f"{path} is {what}, which needs {library}: pip install 's7dissect[tags]'")


def _text(text: str, file: TagFile) -> None:
    first = first_line(text)
    if first.lstrip().startswith(("{", "[")) and not looks_like_source(text):
        read_json(text, file)
    elif is_asc(first):
        read_asc(text, file)
    elif first.startswith("\t"):
        read_seq(text, file)
    elif first.strip().upper() == "TABLE":
        read_dif(text, file)
    elif (
        first.startswith('"')
        and (marks := first.count('","') + 1) in {V5_FIELDS, TIA_FIELDS}
        and not (
            marks == V5_FIELDS
            and has_header(first)  # a CSV table with quotes around all cells: V5 symbol tables have no header
        )
    ):
        read_sdf(text, file)
    elif looks_like_table(first):
        read_csv(text, file)
    elif looks_like_source(text):
        file.format = "source (AWL, SCL)"
        file.blocks, constants = read_declarations(text, file.problems)
        file.constants.update(constants)
    elif any([mark in first for mark in ",;\t"]):
        read_csv(text, file)
    else:
        file.problems.error(
            1,
            f"begins with {first.strip()[:60]!r}, which no known format does: expected a table with a header "
            "(address,type,name), a STEP 7 or TIA export, or a source",
        )


# ---- all together ---------------------------------------------------------------------------------------------------


class _Joining:
    """Joins files: collects block numbers, types and constants, then lays out blocks and checks names."""

    def __init__(self, found: TagSet, numbers: dict[str, int]) -> None:
        self._set = found
        self._numbers = numbers
        self._types: dict[str, Shape] = {}
        self._first: dict[str, tuple[Block, TagFile]] = {}
        self._constants: dict[str, int] = {}
        self._symbols: dict[tuple[str, int], str] = {}
        self._blocks: dict[str, int] = {}
        self._placed: dict[int, tuple[Block, TagFile]] = {}

    def join(self) -> None:
        """Join the files of the set."""
        for file in self._set.files:
            self._constants.update(file.constants)
            for symbol in file.symbols:
                self._symbols.setdefault((symbol.kind, symbol.number), symbol.name)
                if symbol.kind == "DB":
                    self._blocks.setdefault(symbol.name.lower(), symbol.number)
        for file in self._set.files:
            for block in file.blocks:
                self._declare(block, file)
        for file in self._set.files:
            for block in file.blocks:
                if block.kind == "DATA_BLOCK":
                    self._block(block, file)
            self._structured(file)
        self._collect()

    def _declare(self, block: Block, file: TagFile) -> None:
        if block.kind == "DATA_BLOCK":
            return
        before = self._first.setdefault(block.name.lower(), (block, file))
        other, where = before
        if other is not block and essence(other.shape) != essence(block.shape):
            file.problems.error(
                block.line,
                f"type {block.name!r} is declared differently in {where.path}, line {other.line}: which one is right?",
            )
        names = [block.name.lower()]
        for (kind, number), symbol in self._symbols.items():
            if kind in {"UDT", "FB", "SFB"}:
                both = {f"{kind} {number}".lower(), symbol.lower()}
                if block.name.lower() in both:
                    names.extend(both)
        for name in names:
            self._types.setdefault(name, block.shape)

    def _shape(self, name: str) -> Shape | None:
        return self._types.get(name.strip('"').lower())

    def _constant(self, name: str) -> int | None:
        return self._constants.get(name.lower())

    def _number(self, block: Block) -> int | None:
        """Return the number of a data block: from the user, else from the source, else from a symbol table."""
        name = block.name.lower()
        said = self._numbers.get(name)
        if said is not None:
            return said
        return block.number if block.number is not None else self._blocks.get(name)

    def _block(self, block: Block, file: TagFile) -> None:
        if block.optimized:
            others = [each for each in file.blocks if each.kind == "DATA_BLOCK" and not each.optimized]
            complain = file.problems.warning if others or file.tags else file.problems.error
            complain(
                block.line,
                f'DB "{block.name}" has S7_Optimized_Access TRUE: its members have no fixed addresses; '
                "export it after switching optimised access off",
            )
            file.skipped["optimised blocks"] += 1
            return
        number = self._number(block)
        if number is None:
            file.problems.error(
                block.line,
                f"DB {block.name!r} has no number: add --tags-db '{block.name}=10', or name the symbol table that has it too",
            )
            return
        before = self._placed.get(number)
        if before is not None:
            other, where = before
            file.problems.error(
                block.line,
                f'DB{number} is "{other.name}" ({where.path}:{other.line}) and "{block.name}": two blocks of one number',
            )
            return
        shape = block.shape
        if block.of:
            named = self._shape(block.of)
            if named is None:
                file.problems.error(
                    block.line,
                    f'DB "{block.name}" is an instance of {block.of!r}, which is not in this file or the others: '
                    "name its source too",
                )
                return
            shape = named
        if self._missing(shape, block, file):
            return
        try:
            layout = Layout(shape, self._shape, self._constant)
        except LayoutError as error:
            file.problems.error(error.line, f"{block.name}: {error}")
            return
        self._placed[number] = (block, file)
        symbol = self._symbols.get(("DB", number), "")
        title = symbol if block.number is not None and symbol else block.name.replace("DB ", "DB")
        self._set.sizes[number] = layout.size
        self._set.names[number] = title
        self._fields(layout, title, DB, number, 0, file)

    def _missing(self, shape: Shape, block: Block, file: TagFile) -> bool:
        """Note a problem for each type that the block needs and no file declares; return whether there is one."""
        missing: dict[str, int] = {}
        known: set[str] = set()
        waiting = [shape]
        while waiting:
            for name, line in type_names(waiting.pop()):
                if name.lower() in known:
                    continue
                known.add(name.lower())
                inner = self._shape(name)
                if inner is None:
                    missing[name] = line
                else:
                    waiting.append(inner)
        for name, line in missing.items():
            written = meant(name)
            hint = f"is {written} meant?" if written else "export it too (.udt) and name both files"
            file.problems.error(line, f"{block.name}: type {name!r} is not in this or the other files; {hint}")
        return bool(missing)

    def _fields(self, layout: Layout, title: str, area: int, db: int, base: int, file: TagFile) -> None:
        doubts: Counter[str] = Counter()
        for field in layout.fields:
            tag = Tag(
                f"{title}.{field.name}", area, db, base + field.start, field.type.kind, field.type.name, field.type.bits
            )
            tag.dims = field.dims
            tag.prefix = field.prefix
            tag.step = field.step
            for low, high in field.dims:
                tag.count *= high - low + 1
            tag.comment = field.comment
            tag.remark = f"address not certain: {field.remark}" if field.remark else ""
            tag.file, tag.line = file.path, field.line
            doubts[field.remark] += 1
            file.tags.append(tag)
        for doubt, count in doubts.items():
            if doubt:
                file.problems.warning(0, f"{title}: {count} addresses are not certain: {doubt}")

    def _structured(self, file: TagFile) -> None:
        """Lay out tags of tag tables whose type is a structure."""
        for placed in file.placed:
            shape = self._shape(placed.type)
            if shape is None:
                near = close_names(placed.type.lower(), self._types)
                meant = (
                    f"the files declare {near[0]!r}"
                    if near
                    else "if the program declares it, name its source (.udt) too"
                )
                file.problems.error(placed.line, f"{placed.name[:60]}: {unknown(placed.type)}; {meant}")
                continue
            try:
                layout = Layout(shape, self._shape, self._constant)
            except LayoutError as error:
                file.problems.error(placed.line, f"{placed.name[:60]}: {error}")
                continue
            address = placed.address
            self._fields(layout, placed.name, address.area, address.db, address.start, file)

    def _collect(self) -> None:
        """Collect the tags of all files; a name may stand for only one variable."""
        first: dict[str, Tag] = {}
        for file in self._set.files:
            for tag in file.tags:
                name = f"{tag.name}[{tag.prefix}".lower() if tag.prefix else tag.name.lower()
                before = first.setdefault(name, tag)
                if before is tag:
                    self._set.tags.append(tag)
                    self._check_size(tag, file)
                elif (before.area, before.db, before.start, before.type) == (tag.area, tag.db, tag.start, tag.type):
                    file.skipped["repeated"] += 1
                else:
                    place = f"{before.file}:{before.line}" if before.file != tag.file else f"line {before.line}"
                    file.problems.error(
                        int(tag.line),
                        f"{tag.name!r} is {tag.address}, and {before.address} at {place}: two tags of one name",
                    )

    def _check_size(self, tag: Tag, file: TagFile) -> None:
        size = self._set.sizes.get(int(tag.db), 0) if tag.area == DB else 0
        if size and tag.end > size * 8:
            block = self._set.names[int(tag.db)]
            file.problems.error(
                int(tag.line),
                f"{tag.name} ({tag.address}) ends at byte {(tag.end - 1) // 8}: "
                f"outside DB{tag.db} {block!r}, which has {size} bytes",
            )
