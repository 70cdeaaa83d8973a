"""`Fact`: one fact of a record, and the kinds of values.

A record (a connection, a finding …) has a table of its facts in this room. Several outputs are made from it: its JSON
(`dissect.meaning.facts.written`), the JSON Schema of that (`dissect.meaning.facts.schema`), its columns in tables and SQL
(`dissect.output.export.tables`) and its fields of selections (`dissect.meaning.select.fields`). Each of these knows how to
write or compare a kind. Properties that only one of them needs, such as the example of a field or the order of columns, are
defined there, by the name of the fact.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, Generic, Protocol, TypeVar

Record = TypeVar("Record")

# Kinds of values, and the type that the getter of a fact returns; None if there is no value.
COUNT: Final = "count"  # int
SERIAL: Final = "serial"  # int: a number that continues over several runs
DURATION: Final = "duration"  # nanoseconds: int
FLAG: Final = "flag"  # bool
TEXT: Final = "text"  # str
WORD: Final = "word"  # str that occurs many times
CODE: Final = "code"  # one of `Fact.codes`
END: Final = "end"  # an end of a connection: Endpoint
TSAP: Final = "tsap"  # Tsap
FRAME: Final = "frame"  # a packet, by its number in the run; 0 for none
FRAMES: Final = "frames"  # several: list[int]
FILE: Final = "file"  # the file of a packet: as FRAME
TIME: Final = "time"  # nanoseconds since 1970, UTC: int
INSTANT: Final = "instant"  # the same, but only as an integer in tables
REAL: Final = "real"  # int or float
BYTES: Final = "bytes"  # bytes, in JSON as hexadecimal
COUNTS: Final = "counts"  # list[int]
WORDS: Final = "words"  # list[str]
OBJECT: Final = "object"  # an object with `as_dict`: only for JSON
JSON: Final = "json"  # written to JSON unchanged: only for JSON
RECORDS: Final = "records"  # a list of records of the table `Fact.records`, or such lists by names: only for JSON
KINDS: Final = (
    COUNT, SERIAL, DURATION, FLAG, TEXT, WORD, CODE, END, TSAP, FRAME, FRAMES, FILE, TIME, COUNTS, WORDS, OBJECT, JSON,
    RECORDS, INSTANT, REAL, BYTES,
)  # fmt: skip


#: The JSON Schema of the VLAN ids of a network.
VLANS: Final = {
    "type": "array",
    "items": {"type": "integer", "minimum": 0, "maximum": 4095, "description": "A VLAN id."},
}


class Located(Protocol):
    """Determines the file of a packet; ``several`` says whether outputs name files."""

    several: bool

    def locate(self, frame: int) -> tuple[str, int]:
        """Return file and number within it of packet ``frame`` of the run."""


class Fact(Generic[Record]):
    """A fact: ``about`` is its meaning in one sentence, ``get`` returns its value.

    ``get`` is None for a fact with a special writer. ``key`` is its key in JSON (its name unless given, empty for none),
    ``column`` its name in tables. ``null``: it may have no value. ``rare``: its key is present only if it has a value.
    ``least`` and ``most`` are the smallest and the greatest number, ``codes`` are all values of a code, ``shape`` is the JSON
    Schema if its kind does not determine it, ``records`` the table of the records in it.
    """

    __slots__ = (
        "about", "codes", "column", "get", "key", "kind", "least", "most", "name", "null", "rare", "records", "shape", "unit",
    )  # fmt: skip

    def __init__(
        self,
        name: str,
        kind: str,
        about: str,
        get: Callable[[Record], Any] | None,
        *,
        key: str | None = None,
        column: str = "",
        unit: str = "",
        null: bool = False,
        rare: bool = False,
        least: int = 0,
        most: int | None = None,
        codes: tuple[str, ...] = (),
        shape: Mapping[str, Any] | None = None,
        records: Mapping[str, Fact[Any]] | None = None,
    ) -> None:
        self.name = name
        self.kind = kind
        self.about = about
        self.get = get
        self.key = name if key is None else key
        self.column = column or name
        self.unit = unit
        self.null = null
        self.rare = rare
        self.least = least
        self.most = most
        self.codes = codes
        self.shape = shape
        self.records = records

    def __repr__(self) -> str:
        return f"Fact({self.name!r})"


def by_name(facts: tuple[Fact[Record], ...]) -> dict[str, Fact[Record]]:
    """Return the facts of a table by their names."""
    return {fact.name: fact for fact in facts}
