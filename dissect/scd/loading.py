"""From a file to a checked dictionary (R13, R17): compiled, or a TOML or JSON source."""

from __future__ import annotations

from pathlib import Path

from dissect.scd.binary import MAX_FILE, is_compiled, parse_file
from dissect.scd.dictionary import Dictionary
from dissect.scd.errors import DictionaryError
from dissect.scd.source import parse_json, parse_toml


def load(path: str | Path) -> Dictionary:
    """Return the dictionary of a file, compiled or source; nothing is kept of one that is wrong.

    Raises `DictionaryError` with the place, OSError where there is no reading the file.
    """
    octets = _read(Path(path))
    if is_compiled(octets) or Path(path).suffix not in (".toml", ".json"):
        return load_octets(octets, str(path))
    return _from_source(octets, str(path))


def load_octets(octets: bytes, path: str = "") -> Dictionary:
    """Return the dictionary of a compiled file's octets; ``path`` is what an error calls it."""
    body = parse_file(octets, path)
    try:
        return Dictionary(body)
    except DictionaryError as error:
        error.path = path
        raise


def compile_source(path: str | Path) -> Dictionary:
    """Return the dictionary of a source: TOML, or JSON by its suffix; `Dictionary.save` writes it compiled.

    Raises `DictionaryError` with file, line and rule, OSError where there is no reading the file.
    """
    return _from_source(_read(Path(path)), str(path))


def compile_text(text: str, path: str = "") -> Dictionary:
    """Return the dictionary of a TOML source."""
    return parse_toml(text, path)


def _from_source(octets: bytes, path: str) -> Dictionary:
    try:
        text = octets.decode()
    except UnicodeDecodeError as error:
        line = octets.count(b"\n", 0, error.start) + 1
        raise DictionaryError(f"octet {error.start}", f"no UTF-8: {error.reason}", path=path, line=line) from None
    return parse_json(text, path) if path.endswith(".json") else parse_toml(text, path)


def _read(path: Path) -> bytes:
    size = path.stat().st_size
    if size > MAX_FILE:
        raise DictionaryError("file", f"{size} octets, a dictionary has at most {MAX_FILE}", path=str(path))
    with path.open("rb") as stream:
        octets = stream.read(MAX_FILE + 1)
    if len(octets) > MAX_FILE:
        raise DictionaryError("file", f"more than {MAX_FILE} octets", path=str(path))
    return octets
