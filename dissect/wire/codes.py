"""Tables of codes: number, name and one sentence of each code, written once.

Parsers, Scapy layers, reports and documentation all read the same rows. A number that is not in a table is not an error; it is
shown as a number.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mypy_extensions import mypyc_attr

from dissect.wire.text import hex_number


class Code:
    """One row: the number on the wire, its short name, and one sentence that explains it.

    ``effect`` is what a request with this function does to its receiver, and ``returns`` what a good answer to it always has,
    both in tables of functions (`dissect.protocols.s7.tables`); else they are empty.
    """

    __slots__ = ("effect", "name", "number", "returns", "text")

    def __init__(self, number: int, name: str, text: str, effect: str = "", returns: str = "") -> None:
        self.number = number
        self.name = name
        self.text = text
        self.effect = effect
        self.returns = returns

    def __repr__(self) -> str:
        return f"Code({self.number:#x}, {self.name!r})"


#: Number, name and sentence of each row; for functions also their effect, and what a good answer always has.
Rows = Sequence[tuple[int, str, str] | tuple[int, str, str, str] | tuple[int, str, str, str, str]]


@mypyc_attr(allow_interpreted_subclasses=True)
class CodeTable:
    """The rows of one field, looked up by number.

    ``digits`` is how many hexadecimal digits a number is shown with (2 for one octet, 4 for two).
    """

    __slots__ = ("_listed", "_made", "digits", "title")

    def __init__(self, title: str, digits: int, rows: Rows) -> None:
        self.title = title
        self.digits = digits
        self._listed: Rows | None = rows
        self._made: dict[int, Code] = {}

    @property
    def _rows(self) -> dict[int, Code]:
        """The rows by number, made at the first use: most tables are not used in a run."""
        listed = self._listed
        if listed is not None:
            self._listed = None
            self._made = {row[0]: Code(*row) for row in listed}
        return self._made

    def __contains__(self, number: int) -> bool:
        return number in self._rows

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[Code]:
        return iter(self._rows.values())

    def get(self, number: int) -> Code | None:
        """Return the row of ``number``, None when the table does not have it."""
        return self._rows.get(number)

    def name(self, number: int) -> str:
        """Return the name of ``number``; for an unknown number its hexadecimal form, for example ``0x2f``."""
        row = self._rows.get(number)
        return row.name if row is not None else self.hex(number)

    def text(self, number: int) -> str:
        """Return the sentence of ``number``, empty when the table does not have it."""
        row = self._rows.get(number)
        return row.text if row is not None else ""

    def effect(self, number: int) -> str:
        """Return what a request with ``number`` does, empty when the table does not have it."""
        row = self._rows.get(number)
        return row.effect if row is not None else ""

    def returns(self, number: int) -> str:
        """Return what a good answer to ``number`` always has, empty when that is open or the table does not have it."""
        row = self._rows.get(number)
        return row.returns if row is not None else ""

    def hex(self, number: int) -> str:
        """Return ``number`` in hexadecimal with the table's digits, for example ``0x04``."""
        return hex_number(number, self.digits)

    def coded(self, number: int) -> str:
        """Return ``number`` in hexadecimal and its name, for example ``0x0a Object does not exist``."""
        return coded(self.hex(number), self.name(number))

    def names(self) -> dict[int, str]:
        """Return {number: name} for every row, in table order (Scapy's enumeration fields take this form)."""
        return {row.number: row.name for row in self._rows.values()}


def coded(code: str, name: str) -> str:
    """Return a code with its name: ``0x0a Object does not exist``; a name that is only hexadecimal means an unknown code."""
    return f"{code} (unknown code)" if name.startswith("0x") else f"{code} {name}"
