"""EDS and DCF files of CANopen (CiA 306): python-canopen reads their objects, configparser the rest (profile 3.1).

python-canopen fails without saying where. So each section is checked first, and python-canopen gets only the sections that
describe objects, in an order that it can read.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from configparser import DuplicateOptionError, DuplicateSectionError, Error, MissingSectionHeaderError, ParsingError
from configparser import RawConfigParser as Parser
from io import StringIO
from itertools import chain
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Final

from msgspec.structs import replace

from dissect.scd.errors import DictionaryError, Troubles
from dissect.scd.foreign import Description, ForeignEntry, ForeignSub, Imported, Notes
from dissect.scd.foreign_types import DOMAIN_TYPE
from dissect.scd.model import ARRAY, CLASSES, DEFSTRUCT, DEFTYPE, DOMAIN, NULL, RECORD, VAR
from dissect.scd.ranges import MAX_SUB, STRUCTURE_SUB
from dissect.scd.translation import translate
from dissect.scd.written import whole_octal

if TYPE_CHECKING:
    from canopen.objectdictionary import ODVariable

_OBJECT: Final = re.compile(r"[0-9A-Fa-f]{4}")
_SUB: Final = re.compile(r"([0-9A-Fa-f]{4})[Ss][Uu][Bb]([0-9A-Fa-f]{1,2})")
_LISTS: Final = ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects")
#: CiA 306 spells it with one m.
_COMMISSIONING: Final = ("DeviceComissioning", "DeviceCommissioning")
#: The last type that python-canopen knows; for others it looks for a section that describes the type.
_LAST_KNOWN: Final = 0x1B
#: python-canopen warns if this section is missing.
_DEVICE: Final = "DeviceInfo"
#: How many sections python-canopen gets at a time.
_PORTION: Final = 1000


def import_eds(octets: bytes, path: str, encoding: str = "", node: int | None = None) -> Imported:
    """Return the dictionary of an EDS or DCF file; of a DCF with the values of its parameters.

    ``node`` is the node id for values that depend on one; by default that of the file. Without ``encoding`` it is UTF-8 (or
    UTF-16 with a mark), else Latin-1. Raises `DictionaryError` with section and line.
    """
    notes = Notes()
    try:
        return translate(_File(_text(octets, encoding, notes), path, notes).description(node), notes)
    except DictionaryError as error:
        raise error.of_file(path) from None


def _text(octets: bytes, encoding: str, notes: Notes) -> str:
    """Return the text of a file without spaces around its lines, because an indented line would continue the one before."""
    if not encoding:
        encoding = "utf-16" if octets.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
        try:
            octets.decode(encoding)
        except UnicodeDecodeError:
            encoding = "latin-1"
            notes.add("the file is not UTF-8 and was read as Latin-1; if its names are wrong, specify the encoding")
    try:
        text = octets.decode(encoding)
    except UnicodeDecodeError as error:
        line = octets.count(b"\n", 0, error.start) + 1
        raise DictionaryError(f"byte {error.start}", f"not {encoding}: {error.reason}", line=line) from None
    except LookupError:
        raise DictionaryError("encoding", f"{encoding!r} is not an encoding") from None
    return "\n".join([line.strip() for line in text.replace("\r\n", "\n").replace("\r", "\n").split("\n")])


class _File:
    """One file: its sections, and where they begin."""

    def __init__(self, text: str, path: str, notes: Notes) -> None:
        self._path = path
        self._notes = notes
        self._lines: dict[str, int] = {}
        for number, line in enumerate(text.split("\n"), 1):
            if line.startswith("[") and "]" in line:
                self._lines.setdefault(line[1 : line.rindex("]")], number)
        self._parser = _parsed(text)
        self._objects = {int(name, 16): name for name in self._named(_OBJECT)}
        self._subs: dict[tuple[int, int], str] = {}
        #: Types unknown to python-canopen, by index and sub-index.
        self._codes: dict[tuple[int, int], int] = {}
        self._mandatory = self._listed()

    def description(self, node: int | None = None) -> Description:
        """Return what the file describes, for a device of the node id ``node``."""
        if not self._objects:
            raise DictionaryError("file", "no object is described: a section such as [1000] with ParameterName")
        copy = self._copy()
        node_id = self._node_id() if node is None else node
        entries = self._entries(copy)
        return Description(self._product(), self._file_version(), node_id, entries)

    # Sections

    def _named(self, pattern: re.Pattern[str]) -> Iterator[str]:
        seen: dict[str, str] = {}
        for name in self._parser.sections():
            if pattern.fullmatch(name):
                first = seen.setdefault(name.upper(), name)
                if first != name:
                    raise self._fail(name, "", f"the same as [{first}] of line {self._lines.get(first, 0)}", "R57")
                yield name

    def _fail(self, section: str, key: str, detail: str, rule: str = "") -> DictionaryError:
        where = f"[{section}], {key}" if key else f"[{section}]"
        return DictionaryError(where, detail, line=self._lines.get(section, 0), rule=rule)

    def _number(self, section: str, key: str, default: int | None = None) -> int:
        text = self._parser.get(section, key, fallback=None)
        if text is None or not text.strip():
            if default is None:
                raise self._fail(section, key, "is missing")
            return default
        try:
            return whole_octal(text)
        except ValueError as error:
            raise self._fail(section, key, f"{text[:40]!r} {error}") from None

    def _listed(self) -> frozenset[int]:
        """Return the indices in [MandatoryObjects], which python-canopen drops; check the lists (R76)."""
        mandatory: frozenset[int] = frozenset()
        for section in _LISTS:
            if self._parser.has_section(section):
                keys = [key for key in self._parser.options(section) if key.isdecimal() and key.isascii()]
                listed = frozenset(self._number(section, key) for key in keys)
                for index in sorted(listed - self._objects.keys()):
                    self._notes.add(f"listed in [{section}] and not described", index)
                if section == "MandatoryObjects":
                    mandatory = listed
        return mandatory

    def _node_id(self) -> int | None:
        for section in _COMMISSIONING:
            if self._parser.has_option(section, "NodeID"):
                return self._number(section, "NodeID")
        return None

    def _product(self) -> str:
        return self._parser.get("DeviceInfo", "ProductName", fallback="") or PurePath(self._path).stem

    def _file_version(self) -> str:
        numbers = [self._parser.get("FileInfo", key, fallback="") for key in ("FileVersion", "FileRevision")]
        return ".".join(number for number in numbers if number)

    # Input for python-canopen

    def _copy(self) -> Parser:
        """Return the sections of objects, checked and sorted."""
        copy = _empty()
        copy.add_section(_DEVICE)
        troubles = Troubles()
        for index in sorted(self._objects):
            name = self._objects[index]
            with troubles:
                self._section(copy, name, f"{index:04X}", (index, 0))
            if self._parser.has_section(f"{name}Name"):
                count = self._number(f"{name}Name", "NrOfEntries")
                names = {**dict(self._parser.items(f"{name}Name")), "NrOfEntries": str(count)}
                copy.read_dict({f"{index:04X}Name": names})
        for name in self._named(_SUB):
            with troubles:
                self._copy_sub(copy, name)
        troubles.found.sort(key=lambda error: error.line)
        troubles.done()
        return copy

    def _copy_sub(self, copy: Parser, name: str) -> None:
        """Copy the section of a sub-index, if it is valid; raises `DictionaryError`."""
        match = _SUB.fullmatch(name)
        assert match is not None
        index, sub = int(match[1], 16), int(match[2], 16)
        if index not in self._objects:
            raise self._fail(name, "", f"belongs to no object: [{match[1]}] is missing", "R62")
        if sub == STRUCTURE_SUB:
            return
        if (index, sub) in self._subs:
            raise self._fail(name, "", f"the same as [{self._subs[index, sub]}]", "R62")
        self._subs[index, sub] = name
        kind = self._number(self._objects[index], "ObjectType", VAR)
        if kind not in (ARRAY, RECORD):
            # python-canopen has no place for these: those of a type are read with the type; a NULL object has no data.
            if kind not in (DEFTYPE, DEFSTRUCT):
                self._notes.add(f"sub-indices of a {CLASSES.get(kind, 'VAR')} are omitted", index)
            return
        self._section(copy, name, f"{index:04X}sub{sub:X}", (index, sub))

    def _section(self, copy: Parser, name: str, wanted: str, address: tuple[int, int]) -> None:
        values = dict(self._parser.items(name))
        if "ParameterName" not in values:
            raise self._fail(name, "ParameterName", "is missing", "R71")
        is_object = wanted[4:] == ""
        kind = self._number(name, "ObjectType", VAR)
        if is_object and kind not in CLASSES:
            raise self._fail(name, "ObjectType", f"{kind} is not a class of objects", "R63")
        values["ObjectType"] = str(kind)
        if not is_object or kind in (VAR, DOMAIN) or "CompactSubObj" in values:
            code = self._number(name, "DataType", DOMAIN_TYPE if kind == DOMAIN else None)
            values["DataType"] = f"0x{self._known(code, address):X}"
            values.setdefault("AccessType", "")
            values["PDOMapping"] = str(self._number(name, "PDOMapping", 0))
        copy.read_dict({wanted: values})

    def _known(self, code: int, address: tuple[int, int]) -> int:
        """Return a code that python-canopen knows; remember another one for `_sub`."""
        described = f"{code:X}sub1"
        if code > _LAST_KNOWN and self._parser.has_option(described, "DefaultValue"):
            # Some editors give a type limits in this way: the type itself is in the section with its number.
            code = self._number(described, "DefaultValue")
        if 0 <= code <= _LAST_KNOWN:
            return code
        self._codes[address] = code
        return DOMAIN_TYPE

    # Output of python-canopen

    def _entries(self, copy: Parser) -> dict[int, ForeignEntry]:
        entries: dict[int, ForeignEntry] = {}
        for names in _portions(copy, self._objects):
            self._take(_read(copy, names), names, entries)
        return entries

    def _take(self, od: dict[int, Any], names: dict[int, list[str]], entries: dict[int, ForeignEntry]) -> None:
        """Add the objects of a portion, as python-canopen read them."""
        for index in names:
            name = self._objects[index]
            kind = self._number(name, "ObjectType", VAR)
            title = self._parser.get(name, "ParameterName")
            entry = ForeignEntry(index, title, kind, index in self._mandatory, {})
            if kind in (DEFTYPE, DEFSTRUCT):
                self._notes.add("omitted: a definition of a type in an EDS", index)
                continue
            if kind in (ARRAY, RECORD):
                found = od[index]
                entry.subs = {sub: self._sub(row) for sub, row in found.subindices.items() if sub <= MAX_SUB}
                self._compact(entry, name)
            elif kind != NULL:
                entry.subs = {0: self._sub(od[index])}
            entries[index] = entry

    def _compact(self, entry: ForeignEntry, name: str) -> None:
        """Add the elements that CompactSubObj only counts, and the values of [1003Value]."""
        count = self._number(name, "CompactSubObj", 0)
        if not count:
            return
        if not 1 <= count <= MAX_SUB:
            raise self._fail(name, "CompactSubObj", f"{count} elements, 1 to {MAX_SUB} are possible", "R62")
        first = entry.subs[1]
        for sub in range(1, count + 1):
            row = entry.subs.get(sub)
            title = row.name if row is not None and sub > 1 else f"{first.name} {sub}"
            value = self._parser.get(f"{name}Value", str(sub), fallback=first.value)
            entry.subs[sub] = replace(first, sub=sub, name=title, value=value)
        if entry.subs[0].value is None:
            entry.subs[0].value = str(count)

    def _sub(self, row: ODVariable) -> ForeignSub:
        section = self._subs.get((row.index, row.subindex), self._objects[row.index])
        get = self._parser.get
        value = getattr(row, "value_raw", None)
        code = self._codes.get((row.index, row.subindex), row.data_type)
        return ForeignSub(
            row.subindex, row.name, -1 if code is None else code, row.access_type, row.pdo_mappable,
            getattr(row, "default_raw", None) if value is None else value,
            get(section, "LowLimit", fallback=None), get(section, "HighLimit", fallback=None),
            row.unit, float(row.factor) or 1.0,
        )  # fmt: skip


def _empty() -> Parser:
    # No section of an EDS passes its keys to the others, as configparser's [DEFAULT] would.
    parser = Parser(inline_comment_prefixes=(";",), default_section="")
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    return parser


def _parsed(text: str) -> Parser:
    parser = _empty()
    try:
        parser.read_string(text)
    except (DuplicateSectionError, DuplicateOptionError) as error:
        option = f", {error.option}" if isinstance(error, DuplicateOptionError) else ""
        raise DictionaryError(f"[{error.section}]{option}", "occurs twice", line=error.lineno or 0) from None
    except MissingSectionHeaderError as error:
        raise DictionaryError("INI", "no section such as [FileInfo] begins the file", line=error.lineno) from None
    except ParsingError as error:
        line, what = error.errors[0]
        raise DictionaryError("INI", f"{what} is neither a section nor a key with a value", line=line) from None
    except Error as error:
        raise DictionaryError("INI", str(error)) from None
    return parser


class _Named(StringIO):
    """A text file with a name, from which python-canopen chooses the format."""

    name = "description.eds"


def _portions(copy: Parser, objects: Iterable[int]) -> Iterator[dict[int, list[str]]]:
    """Yield objects with the names of their sections, some at a time: python-canopen needs many times the size of a file."""
    sections: dict[int, list[str]] = {}
    for name in copy.sections():
        if name != _DEVICE:
            sections.setdefault(int(name[:4], 16), []).append(name)
    portion: dict[int, list[str]] = {}
    count = 0
    for index in objects:
        portion[index] = sections[index]
        count += len(sections[index])
        if count >= _PORTION:
            yield portion
            portion, count = {}, 0
    if portion:
        yield portion


def _read(copy: Parser, names: dict[int, list[str]]) -> dict[int, Any]:
    try:
        from canopen import import_od
        from canopen.objectdictionary import ObjectDictionaryError
    except ImportError:
        hint = "reading EDS and DCF files needs the package canopen: pip install 's7dissect[eds]'"
        raise DictionaryError("EDS", hint) from None
    part = _empty()
    part.read_dict({name: dict(copy.items(name)) for name in chain((_DEVICE,), *names.values())})
    written = StringIO()
    part.write(written)
    try:
        return import_od(_Named(written.getvalue())).indices
    except (Error, ObjectDictionaryError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise DictionaryError("EDS", f"python-canopen cannot read it: {error}") from None
