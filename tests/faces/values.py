"""How the faces write the value of an item or variable: the forms in each, compared with the value in JSON.

JSON has the value itself. Tables have a number, or a text; CSV a cell; text lines cut long values, and show octets in place of
a list of bytes.
"""

from __future__ import annotations

import json
import math
import re
from typing import Any, Final

#: The value of an item and its origin: octets in hexadecimal digits, whether they are bytes, the text they spell.
Value = tuple[Any, str | None, bool, str | None]

_LISTED: Final = re.compile(r"\[(?P<some>.*?)(?:, … (?P<count>\d+) in all)?\]")
_SOME_OCTETS: Final = re.compile(r"(?P<some>[0-9a-f]{2}(?: [0-9a-f]{2})*)(?: … (?P<count>\d+) bytes)?(?: '.*'…?)?")
_SOME_TEXT: Final = re.compile(r"'(?P<some>.*)'(?:… \((?P<count>\d+) characters\))?", re.DOTALL)


def in_tables(value: Value, told: tuple[float | None, str | None]) -> bool:
    """Return whether a number and a text in separate columns are a value: a number, a text, several numbers as JSON."""
    content, _, is_bytes, _ = value
    number, text = told
    if is_bytes and isinstance(content, list):
        return number is None and text is not None and _is_json(content, text)
    if isinstance(content, (bool, int, float)):
        return number is not None and math.isclose(number, float(content), rel_tol=1e-15)
    if content is None:
        return number is None and text is None
    if isinstance(content, str):
        odd = content in {"nan", "inf", "-inf"} and number is not None and (math.isnan(number) or math.isinf(number))
        return odd or text == content
    return text is not None and _is_json(content, text)


def _is_json(content: Any, text: str) -> bool:
    try:
        return bool(json.loads(text) == content)
    except json.JSONDecodeError:
        return False


_CONTROL: Final = re.compile("[\x00-\x1f\x7f-\x9f]")
_ODD: Final = {"nan": "NaN", "inf": "Infinity", "-inf": "-Infinity"}


def in_cell(value: Value, told: str | None) -> bool:
    """Return whether a cell of CSV is a value: bytes in hexadecimal digits, texts without quotes, the rest as JSON."""
    content, octets, is_bytes, _ = value
    if is_bytes and isinstance(content, list):
        return told is not None and told.replace(" ", "") == octets
    if content is None:
        return told is None
    if told is None:
        return bool(content == "")
    if isinstance(content, str):
        # A spreadsheet would run a text with this beginning as a formula, so a quote comes first.
        shown = _CONTROL.sub(lambda found: f"\\x{ord(found[0]):02x}", content)
        return told in {shown, f"'{shown}"} or told == _ODD.get(content)
    try:
        return bool(json.loads(told) == content) or repr(json.loads(told)) == repr(content).replace("'", "")
    except json.JSONDecodeError:
        return False


def in_line(value: Value, told: str | None) -> bool:
    """Return whether a text line shows a value, or the beginning of it."""
    content, octets, is_bytes, _ = value
    if told is None:
        return content is None and octets is None
    if (is_bytes and isinstance(content, list)) or content is None:
        return octets is not None and _begins_octets(octets, told)
    if isinstance(content, bool):
        return told == str(content).lower()
    if isinstance(content, (int, float)):
        return _is_number(content, told)
    if isinstance(content, str):
        return _begins_text(content, told) or _begins_octets(content, told)
    if isinstance(content, list):
        return _begins_list(content, told, octets or "") or (octets is not None and _begins_octets(octets, told))
    return True  # a structure has its own wording


def _begins_octets(octets: str, told: str) -> bool:
    if not octets:
        return told == "(empty)"
    found = _SOME_OCTETS.fullmatch(told)
    if found is None:
        return False
    some = found["some"].replace(" ", "")
    return (
        octets == some if found["count"] is None else octets.startswith(some) and len(octets) == 2 * int(found["count"])
    )


def _is_number(content: float, told: str) -> bool:
    try:
        return float(told.partition(" ")[0]) == float(content)
    except ValueError:
        return False


def _begins_text(content: str, told: str) -> bool:
    found = _SOME_TEXT.match(told)
    if content in _ODD:
        return told == content
    if found is None:
        return False
    return found["count"] is None or int(found["count"]) == len(content)


def _begins_list(content: list[Any], told: str, octets: str) -> bool:
    """Return whether a text is a list, or its beginning; an element that does not fit its type is shown as its octets."""
    found = _LISTED.match(told)
    if found is None:
        return False
    count = int(found["count"]) if found["count"] is not None else len(content)
    if count != len(content):
        return False
    some = re.findall(r"'(?:\\.|[^'\\])*'|[^', ][^',]*", found["some"])
    size = len(octets) // len(content) if content else 0
    parts = [octets[at * size : (at + 1) * size] for at in range(len(content))]
    return all([_same(one, shown, part) for one, shown, part in zip(content, some, parts, strict=False)])


def _same(one: Any, shown: str, octets: str) -> bool:
    if isinstance(one, bool):
        return shown == str(one).lower()
    if isinstance(one, (int, float)):
        return _is_number(one, shown)
    return True if isinstance(one, str) else shown == (" ".join(re.findall("..", octets)) or "-")
