"""XDD and XDC files of POWERLINK (EPSG DS 311) and CANopen (CiA 311): ISO 15745 profiles in XML (profile 3.1)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import PurePath
from types import MappingProxyType
from typing import TYPE_CHECKING, Final
from xml.etree.ElementTree import ParseError

from dissect.scd.errors import DictionaryError
from dissect.scd.foreign import Description, ForeignEntry, ForeignSub, Imported, Notes
from dissect.scd.foreign_types import DOMAIN_TYPE
from dissect.scd.model import ARRAY, CLASSES, DOMAIN, RECORD, VAR
from dissect.scd.ranges import MAX_SUB, STRUCTURE_SUB
from dissect.scd.translation import translate

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_OBJECTS: Final = frozenset(("Object", "CANopenObject"))
_SUBS: Final = frozenset(("SubObject", "CANopenSubObject"))
_HEX: Final = re.compile(r"[0-9A-Fa-f]{1,4}")
_MAPPED: Final = frozenset(("default", "optional", "tpdo", "rpdo"))

#: Types of the parameters to which objects refer by uniqueIDRef (IEC 61131-3).
_PARAMETER_TYPES: Final = MappingProxyType(
    {
        "BOOL": 0x01, "SINT": 0x02, "INT": 0x03, "DINT": 0x04, "LINT": 0x15, "USINT": 0x05, "UINT": 0x06, "UDINT": 0x07,
        "ULINT": 0x1B, "BYTE": 0x05, "WORD": 0x06, "DWORD": 0x07, "LWORD": 0x1B, "CHAR": 0x05, "REAL": 0x08, "LREAL": 0x11,
        "STRING": 0x09, "WSTRING": 0x0B,
    }
)  # fmt: skip
_PARAMETER_ACCESS: Final = MappingProxyType(
    {
        "const": "const", "read": "ro", "write": "wo", "readWrite": "rw", "readWriteInput": "rwr", "readWriteOutput": "rww",
    }
)  # fmt: skip


def import_xdd(octets: bytes, path: str, node: int | None = None) -> Imported:
    """Return the dictionary of an XDD or XDC file; of an XDC with its actual values. Raises `DictionaryError`.

    ``node`` is the node id for values that depend on one.
    """
    try:
        notes = Notes()
        return translate(_description(_root(octets), PurePath(path).stem, notes, node), notes)
    except DictionaryError as error:
        raise error.of_file(path) from None


def _root(octets: bytes) -> Element:
    try:
        from defusedxml.common import DefusedXmlException
        from defusedxml.ElementTree import fromstring
    except ImportError:
        hint = "reading XDD and XDC files needs the package defusedxml: pip install 's7dissect[eds]'"
        raise DictionaryError("XDD", hint) from None
    try:
        root: Element = fromstring(octets, forbid_dtd=True)
    except DefusedXmlException:
        raise DictionaryError(
            "XML", "a DTD or an entity, which device descriptions do not have: reading stopped"
        ) from None
    except ParseError as error:
        raise DictionaryError("XML", str(error), line=error.position[0]) from None
    except (ValueError, LookupError) as error:
        raise DictionaryError("XML", f"the encoding cannot be read: {error}") from None
    return root


def _local(element: Element) -> str:
    return element.tag.rpartition("}")[2]


def _description(root: Element, stem: str, notes: Notes, node: int | None) -> Description:
    name, version = "", ""
    parameters: dict[str, Element] = {}
    objects = []
    for element in root.iter():
        tag = _local(element)
        if tag in _OBJECTS:
            objects.append(element)
        elif tag == "productName":
            name = name or (element.text or "").strip()
        elif tag == "ProfileBody":
            version = version or element.get("fileVersion", "")
        elif tag == "parameter" and "uniqueID" in element.attrib:
            parameters[element.attrib["uniqueID"]] = element
    if not objects:
        raise DictionaryError("XDD", "no Object in an ObjectList: not a device description")
    entries: dict[int, ForeignEntry] = {}
    for element in objects:
        entry = _entry(element, parameters, notes)
        if entry.index in entries:
            where = f"Object {entry.index:04X}"
            raise DictionaryError(where, "the index occurs twice", rule="R57", index=entry.index)
        entries[entry.index] = entry
    return Description(name or stem, version, node, entries)


def _hex(element: Element, key: str, where: str, default: int | None = None) -> int:
    """Return an attribute that is a hexadecimal number without a prefix."""
    text = element.get(key, "").strip()
    if not text and default is not None:
        return default
    digits = text.removeprefix("0x").removeprefix("0X")
    if not _HEX.fullmatch(digits):
        raise DictionaryError(where, f"{key} {text[:40]!r} is not a hexadecimal number", rule="R57")
    return int(digits, 16)


def _class(element: Element, where: str) -> int:
    text = element.get("objectType", str(VAR)).strip()
    if text.isascii() and text.isdecimal() and len(text) < 4 and int(text) in CLASSES:
        return int(text)
    raise DictionaryError(where, f"objectType {text[:40]!r} is not a class of objects", rule="R63")


def _entry(element: Element, parameters: dict[str, Element], notes: Notes) -> ForeignEntry:
    index = _hex(element, "index", f"Object {element.get('index', '')[:40]!r}")
    where = f"Object {index:04X}"
    kind = _class(element, where)
    entry = ForeignEntry(index, element.get("name", ""), kind, False, {})
    outer = _hex(element, "dataType", where, -1)
    if kind not in (ARRAY, RECORD):
        entry.subs[0] = _variable(element, 0, DOMAIN_TYPE if kind == DOMAIN and outer < 0 else outer, parameters)
    for child in _children(element):
        sub = _hex(child, "subIndex", where)
        if sub == STRUCTURE_SUB:
            continue
        if sub > MAX_SUB:
            raise DictionaryError(f"{where}, SubObject {sub:02X}", "sub-indices have 8 bits", rule="R62", index=index)
        if sub in entry.subs and kind in (ARRAY, RECORD):
            raise DictionaryError(f"{where}, SubObject {sub:02X}", "occurs twice", rule="R62", index=index)
        inherited = outer if kind == ARRAY and sub else -1
        code = _hex(child, "dataType", f"{where}, SubObject {sub:02X}", inherited)
        if kind in (VAR, DOMAIN):
            notes.add("sub-indices of an object that is one variable are omitted", index)
            break
        entry.subs[sub] = _variable(child, sub, code, parameters)
    return entry


def _children(element: Element) -> Iterator[Element]:
    return (child for child in element if _local(child) in _SUBS)


def _variable(element: Element, sub: int, code: int, parameters: dict[str, Element]) -> ForeignSub:
    parameter = parameters.get(element.get("uniqueIDRef", ""))
    access, value = element.get("accessType", ""), element.get("actualValue", element.get("defaultValue"))
    if parameter is not None:
        access = access or _PARAMETER_ACCESS.get(parameter.get("access", ""), "")
        for child in parameter:
            tag = _local(child)
            if code < 0:
                code = _PARAMETER_TYPES.get(tag, code)
            if value is None and tag in {"actualValue", "defaultValue"}:
                value = child.get("value")
    mapped = element.get("PDOmapping", "no").lower() in _MAPPED
    return ForeignSub(
        sub, element.get("name", ""), code, access, mapped, value, element.get("lowLimit"), element.get("highLimit")
    )
