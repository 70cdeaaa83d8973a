"""The only readers of JSON, TOML and names of code pages from files of users, which may be damaged or malicious.

Each raises one kind of error, whatever the content: nesting without end, invalid text, a number with thousands of digits. A
test of the house finds readers elsewhere.
"""

from __future__ import annotations

import codecs
import json
import re
from collections.abc import Callable
from typing import Any, Final

#: The most parts of a dotted key in TOML, and the deepest nesting of tables and arrays in a bounded file.
MAX_DEPTH: Final = 16

#: Encodings that are refused: two for host names, whose decoders raise errors of their own, and one that always raises.
_NO_PAGES: Final = frozenset(("idna", "punycode", "undefined"))

# Strings, which `re` compiles and keeps at their first use, because most runs use none.
_KEY: Final = r"(?:[A-Za-z0-9_-]++|\"[^\"\n]*\"|'[^'\n]*')"
#: A dotted key with so many parts that tomllib needs too much time and memory, which grow with the square of the parts.
_LONG_KEY: Final = rf"(?<![A-Za-z0-9_-]){_KEY}(?:[ \t]*\.[ \t]*{_KEY}){{{MAX_DEPTH}}}"
_LONG_NUMBER: Final = r"(?<![\w\"'.-])[0-9][0-9_]{4000}"
_AT_LINE: Final = r" \(at line (\d+), column \d+\)$"


class ContentError(ValueError):
    """The content of a file cannot be used: the text says why, ``line`` where (0: not known)."""

    def __init__(self, text: str, line: int = 0) -> None:
        super().__init__(text)
        self.line = line


def long_key_line(text: str) -> int:
    """Return the line of a dotted key with more parts than tables may nest, 0 if there is none.

    It only searches the text, so a value of sixteen words with points between them is found as well.
    """
    return _line(text, _LONG_KEY)


def _line(text: str, pattern: str) -> int:
    match = re.search(pattern, text)
    return text.count("\n", 0, match.start()) + 1 if match else 0


def read_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text. Raises `ContentError`."""
    import tomllib  # most runs do not read TOML

    line = long_key_line(text)
    if line:
        raise ContentError(f"a key of more than {MAX_DEPTH} parts", line)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        match = re.search(_AT_LINE, str(error))
        raise ContentError(re.sub(_AT_LINE, "", str(error)), int(match[1]) if match else text.count("\n") + 1) from None
    except ValueError:
        raise ContentError("a number of too many digits", _line(text, _LONG_NUMBER)) from None
    except RecursionError:
        raise ContentError("arrays are nested too deeply") from None


def read_json(text: str | bytes, pairs: Callable[[list[tuple[str, Any]]], Any] | None = None) -> Any:
    """Return the content of a JSON text; ``pairs`` makes an object of its members. Raises `ContentError`."""
    try:
        return json.loads(text, object_pairs_hook=pairs)
    except json.JSONDecodeError as error:
        raise ContentError(error.msg, error.lineno) from None
    except UnicodeError:
        raise ContentError("not UTF-8") from None
    except RecursionError:
        raise ContentError("it is nested too deeply") from None
    except ContentError:
        raise
    except ValueError:  # Python reads no number of so many digits
        octets = text if isinstance(text, bytes) else text.encode("utf-8", "replace")
        found = re.search(rb"[0-9]{4000}", octets)
        line = octets.count(b"\n", 0, found.start()) + 1 if found else 0
        raise ContentError("a number of too many digits", line) from None


def check_code_page(name: str) -> None:
    """Raise `ContentError` unless ``name`` is an encoding of texts that Python can decode.

    Python's codecs also transform octets (``hex``, ``zlib``) and texts (``rot13``), or exist to fail (``undefined``).
    """
    try:
        known = codecs.lookup(name).name
        "".encode(name)  # refuses a codec that is not a text encoding
        b"".decode(name)
    except (LookupError, UnicodeError, ValueError, TypeError):
        known = ""
    if not known or known in _NO_PAGES:
        raise ContentError(f"{name!r} is not an encoding of texts")
