"""Loads a file as a checked dictionary (R13, R17): compiled, a TOML or JSON source, or a device description."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Final

from dissect.scd.binary import MAGIC, MAX_FILE, is_compiled, parse_file
from dissect.scd.dictionary import Dictionary
from dissect.scd.errors import DictionaryError
from dissect.scd.source import parse_json, parse_toml
from dissect.scd.toml_tables import source_text

if TYPE_CHECKING:
    from dissect.scd.foreign import Imported

#: Suffixes of sources.
SOURCE_SUFFIXES: Final = (".toml", ".json")
#: Suffixes of device descriptions: INI files of CANopen, XML files of POWERLINK and CANopen.
INI_SUFFIXES: Final = (".eds", ".dcf")
XML_SUFFIXES: Final = (".xdd", ".xdc")
#: Octets of the largest description; parsed it takes about sixty times its size. Real ones have a few hundred KiB.
MAX_DESCRIPTION: Final = 4 << 20


def load(path: str | os.PathLike[str]) -> Dictionary:
    """Return the dictionary in a file: compiled, source or device description. A wrong dictionary is not used at all.

    Raises `DictionaryError` with the place, OSError if the file cannot be read.
    """
    if is_description(path):
        return import_file(path).dictionary
    octets = _read(Path(path))
    suffix = Path(path).suffix.lower()
    if suffix in SOURCE_SUFFIXES and not is_compiled(octets):
        return _from_source(octets, os.fspath(path))
    if is_compiled(octets) or MAGIC.startswith(octets):
        return load_octets(octets, os.fspath(path))
    known = ", ".join(SOURCE_SUFFIXES + INI_SUFFIXES + XML_SUFFIXES)
    detail = f"neither a compiled dictionary (the magic number differs) nor, by its suffix, a source: {known}"
    raise DictionaryError("file", detail, path=os.fspath(path))


def load_octets(octets: bytes, path: str = "") -> Dictionary:
    """Return the dictionary in the octets of a compiled file; ``path`` is its name in errors."""
    body = parse_file(octets, path)
    try:
        return Dictionary(body)
    except DictionaryError as error:
        raise error.of_file(path) from None


def compile_source(path: str | os.PathLike[str]) -> Dictionary:
    """Return the dictionary of a source: TOML, or by suffix JSON, EDS, DCF, XDD, XDC; `Dictionary.save` writes it.

    Content of a device description that a dictionary cannot hold is dropped; `import_file` returns notes about it.

    Raises `DictionaryError` with file, line and rule, OSError if the file cannot be read.
    """
    if is_description(path):
        return import_file(path).dictionary
    octets = _read(Path(path))
    if is_compiled(octets):
        raise DictionaryError(
            "file", "is compiled already; `s7dissect scd dump` makes a source of it", path=os.fspath(path)
        )
    return _from_source(octets, os.fspath(path))


def is_description(path: str | os.PathLike[str]) -> bool:
    """Whether the suffix is that of an EDS, DCF, XDD or XDC file."""
    return Path(path).suffix.lower() in INI_SUFFIXES + XML_SUFFIXES


def import_file(path: str | os.PathLike[str], encoding: str = "", node: int | None = None) -> Imported:
    """Return the dictionary of a device description (EDS, DCF, XDD, XDC by suffix), and notes about parts it does not keep.

    ``encoding`` is for an EDS or DCF; by default it is UTF-8, else Latin-1, which a note says; XML states its own. ``node`` is
    the node id for values that depend on one: 1 to 127 for CANopen, to 254 for POWERLINK. Raises `DictionaryError` with the
    place, also if the package that reads the format is missing; OSError.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in INI_SUFFIXES + XML_SUFFIXES:
        suffixes = ", ".join(INI_SUFFIXES + XML_SUFFIXES)
        raise DictionaryError("file", f"{suffix or 'no suffix'!r} is not one of {suffixes}", path=os.fspath(path))
    octets = _read(Path(path), MAX_DESCRIPTION)
    if suffix in INI_SUFFIXES:
        from dissect.scd.eds import import_eds

        return import_eds(octets, os.fspath(path), encoding, node)
    from dissect.scd.xdd import import_xdd

    return import_xdd(octets, os.fspath(path), node)


def _from_source(octets: bytes, path: str) -> Dictionary:
    text = source_text(octets, path)
    return parse_json(text, path) if path.lower().endswith(".json") else parse_toml(text, path)


def _read(path: Path, most: int = MAX_FILE) -> bytes:
    size = path.stat().st_size
    if size > most:
        raise DictionaryError("file", f"{size} bytes, a dictionary has at most {most}", path=os.fspath(path))
    with path.open("rb") as stream:
        octets = stream.read(most + 1)
    if len(octets) > most:
        raise DictionaryError("file", f"more than {most} bytes", path=os.fspath(path))
    return octets
