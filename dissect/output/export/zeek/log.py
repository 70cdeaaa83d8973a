"""One log in Zeek's format: as tab-separated values, or as JSON lines (exports reference 1.6 and 1.7)."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, TextIO

from dissect.output.export.zeek.columns import columns_of
from dissect.wire.text import Clock

_UNSET: Final = "-"
_EMPTY: Final = "(empty)"
#: Characters that are escaped in a text: the separator, backslashes, and those that cannot be printed.
_ESCAPED: Final = re.compile("[\\\\\x00-\x1f\x7f-\x9f\ud800-\udfff]")
_NS_PER_S: Final = 1_000_000_000


class Log:
    """A log in a file of its own, which is made with the first row. ``rows`` is the number of rows.

    Values have the type of their column: times and intervals are nanoseconds, texts are as on the wire, None is unset. Times
    are cut to microseconds, Zeek's precision.
    """

    def __init__(self, folder: Path, name: str, as_json: bool) -> None:
        self.rows = 0
        self._path = folder / f"{name}.log"
        self._name = name
        self._json = as_json
        self._columns = columns_of(name)
        self._file: TextIO | None = None
        self._clock = Clock()
        self._last_ns = 0

    def add(self, values: Sequence[Any]) -> None:
        """Add a row."""
        if self._file is None:
            self._file = self._begin(values[0])
        self.rows += 1
        self._last_ns = values[0]
        if self._json:
            told = {
                name: _as_json(kind, value)
                for (name, kind), value in zip(self._columns, values, strict=True)
                if value is not None
            }
            line = json.dumps(told, ensure_ascii=False)
        else:
            cells = [_cell(kind, value) for (_, kind), value in zip(self._columns, values, strict=True)]
            line = "\t".join(cells)
        self._file.write(f"{line}\n")

    def close(self) -> None:
        """Write the last line, and close the file."""
        if self._file is not None:
            if not self._json:
                self._file.write(f"#close\t{self._stamp(self._last_ns)}\n")
            self._file.close()
            self._file = None

    def abandon(self) -> None:
        """Close the file, which will be deleted."""
        if self._file is not None:
            try:
                self._file.close()
            except OSError:  # there may be no room for data that are still buffered
                self._file = None

    def _begin(self, first_ns: int) -> TextIO:
        file = self._path.open("w", encoding="utf-8", errors="backslashreplace", newline="\n")
        if not self._json:
            names, kinds = zip(*self._columns, strict=True)
            file.write(
                "#separator \\x09\n#set_separator\t,\n#empty_field\t(empty)\n#unset_field\t-\n"
                f"#path\t{self._name}\n#open\t{self._stamp(first_ns)}\n"
                f"#fields\t{chr(9).join(names)}\n#types\t{chr(9).join(kinds)}\n"
            )
        return file

    def _stamp(self, time_ns: int) -> str:
        """Return the time of a packet (UTC) for #open and #close: with the current time each run would differ."""
        return re.sub("[T:]", "-", self._clock.iso(time_ns)[:19])


def _cell(kind: str, value: Any) -> str:
    if value is None:
        return _UNSET
    if kind in {"time", "interval"}:
        return seconds(value)
    if kind == "bool":
        return "T" if value else "F"
    if kind.startswith("vector["):
        return ",".join([_text(str(one)).replace(",", "\\x2c") for one in value]) if value else _EMPTY
    return _text(str(value)) if kind == "string" else str(value)


def _text(value: str) -> str:
    if not value:
        return _EMPTY
    told = _escaped(value)
    return f"\\x{ord(told[0]):02x}{told[1:]}" if told in {_UNSET, _EMPTY} else told


def _escaped(value: str) -> str:
    return _ESCAPED.sub(_escape, value)


def _escape(found: re.Match[str]) -> str:
    character = found[0]
    if character == "\\":
        return "\\\\"
    return "".join([f"\\x{octet:02x}" for octet in character.encode("utf-8", "surrogateescape")])


def seconds(ns: int) -> str:
    """Return nanoseconds as seconds, cut off after six decimals."""
    whole, rest = divmod(abs(ns), _NS_PER_S)
    return f"{'-' if ns < 0 else ''}{whole}.{rest // 1000:06d}"


def _as_json(kind: str, value: Any) -> Any:
    if kind in {"time", "interval"}:
        return float(seconds(value))
    if kind == "string":
        return "".join([_escape_octet(one) for one in value])
    return value


def _escape_octet(character: str) -> str:
    """Return an octet that is not UTF-8 (a surrogate escape) as Zeek writes it in JSON; others unchanged."""
    code = ord(character)
    return f"\\x{code - 0xDC00:02x}" if 0xDC80 <= code <= 0xDCFF else character
