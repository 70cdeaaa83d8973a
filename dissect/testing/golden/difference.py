"""A difference as `diff` reports it, and the options that suppress some of them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from fnmatch import fnmatchcase
from typing import Final

from dissect.engine.transactions.naming import Naming

#: All kinds of differences, with what comes after the colon in ``--ignore WHAT:PATTERN``.
KINDS: Final = {
    "connections": "a connection is missing or added",
    "tsaps": "protocol, carrier or TSAPs of a connection",
    "negotiation": "TPDU size, PDU length, parallel jobs, requested or granted",
    "endings": "how a connection began, was refused or ended, and by whom",
    "missing": "a request that only the first has; PATTERN: the request",
    "added": "a request that only the second has; PATTERN: the request",
    "order": "a request at a different position; PATTERN: the request",
    "requests": "a different request at the same position; PATTERN: the first request",
    "answers": "whether there is an answer; PATTERN: the request",
    "codes": "error codes and return codes; PATTERN: address of the item, else the function",
    "values": "values read or written; PATTERN: address of the item, or name of a tag",
    "time": "date and time values: DATE, TOD, DATE_AND_TIME, the clock; PATTERN: as for values and contents",
    "transport": "data transport size and length of equal values; PATTERN: address of the item",
    "contents": "content of other functions; PATTERN: function, or 'structure.field'",
    "scd": "decoded SCD; PATTERN: address such as 0x6041:0",
    "latency": "answer times beyond the tolerance",
}

_TOLERANCE: Final = re.compile(r"([0-9]{1,9}(?:\.[0-9]{1,9})?)(%|ns|us|µs|ms|s)")
_NS: Final = {"ns": 1, "us": 1_000, "µs": 1_000, "ms": 1_000_000, "s": 1_000_000_000}


class DiffOptions:
    """Which differences to ignore, and how far answer times may shift.

    ``ignore`` are names of `KINDS`, each alone or as ``NAME:PATTERN`` with ``*`` and ``?``. ``latency`` is a share (``20%``), a
    time (``5ms``), or both with a comma between them: then both must be exceeded. None compares no times. Raises ValueError for
    anything else. With ``naming``, a changed value is reported tag by tag.
    """

    __slots__ = ("_patterns", "latency_ns", "latency_share", "naming")

    def __init__(self, ignore: Iterable[str] = (), latency: str | None = None, naming: Naming | None = None) -> None:
        self.naming = naming
        self._patterns: dict[str, list[str]] = {}
        for text in ignore:
            kind, colon, pattern = text.partition(":")
            if kind not in KINDS or (colon and not pattern):
                raise ValueError(
                    f"{text!r} is not a kind of difference; known kinds: {', '.join(KINDS)}, each alone or as NAME:PATTERN"
                )
            # Names of tags contain brackets, which `fnmatch` would read as a set of characters.
            self._patterns.setdefault(kind, []).append(pattern.replace("[", "[[]") if colon else "*")
        self.latency_ns: float | None = None
        self.latency_share: float | None = None
        if latency is not None and not isinstance(latency, str):
            raise ValueError(f"latency={latency!r}: a tolerance is a text such as '20%', '5ms' or '20%,5ms'")
        for part in latency.split(",") if latency is not None else ():
            match = _TOLERANCE.fullmatch(part.strip())
            if match is None:
                raise ValueError(f"{part!r} is not a tolerance such as 20% or 5ms")
            if match[2] == "%":
                self.latency_share = float(match[1]) / 100
            else:
                self.latency_ns = float(match[1]) * _NS[match[2]]

    def ignores(self, kind: str, *targets: str) -> bool:
        """Return whether a difference of this kind about any of these is to be ignored."""
        patterns = self._patterns.get(kind)
        if patterns is None:
            return False
        return any(
            [pattern == "*" or fnmatchcase(target, pattern) for pattern in patterns for target in targets or ("",)]
        )

    def mentions(self, *kinds: str) -> bool:
        """Return whether anything of these kinds is ignored."""
        return not self._patterns.keys().isdisjoint(kinds)

    def shifted(self, was_ns: int | None, is_ns: int | None) -> bool:
        """Return whether an answer time shifted beyond the tolerance; False if either is unknown."""
        if was_ns is None or is_ns is None or (self.latency_ns is None and self.latency_share is None):
            return False
        shift = abs(is_ns - was_ns)
        if self.latency_ns is not None and shift <= self.latency_ns:
            return False
        return self.latency_share is None or shift > self.latency_share * abs(was_ns)


class Difference:
    """One difference.

    ``kind`` is a name of `KINDS`; ``connection`` and ``transaction`` are numbers in the first session, ``connection_b`` and
    ``transaction_b`` in the second, 0 for none. ``subject`` is the operation (``READ DB10.DBW4``), ``address`` the item or
    field; ``was`` and ``is_`` are the old and new state in words, empty for none. ``text`` is the whole difference in one line,
    safe to show.
    """

    __slots__ = (
        "address",
        "connection",
        "connection_b",
        "is_",
        "kind",
        "subject",
        "text",
        "transaction",
        "transaction_b",
        "was",
    )

    def __init__(
        self,
        kind: str,
        text: str,
        connections: tuple[int, int],
        transactions: tuple[int, int] = (0, 0),
        subject: str = "",
        address: str = "",
        values: tuple[str, str] = ("", ""),
    ) -> None:
        self.kind = kind
        self.text = text
        self.connection, self.connection_b = connections
        self.transaction, self.transaction_b = transactions
        self.subject = subject
        self.address = address
        self.was, self.is_ = values

    def as_dict(self) -> dict[str, object]:
        """Return the difference as JSON-ready values."""
        return {
            "kind": self.kind,
            "connection": self.connection or None,
            "connection_b": self.connection_b or None,
            "transaction": self.transaction or None,
            "transaction_b": self.transaction_b or None,
            "subject": self.subject,
            "address": self.address or None,
            "was": self.was or None,
            "is": self.is_ or None,
            "text": self.text,
        }

    def __repr__(self) -> str:
        return f"Difference({self.text!r})"
