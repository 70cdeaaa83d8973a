"""An entry of the table of known differences (`dissect.testing.oracle.known`)."""

from __future__ import annotations

from collections.abc import Callable

from dissect.testing.oracle.grounds import Case


class KnownDifference:
    """One understood difference: ``names`` are the fields it may explain, ``applies`` decides by the octets."""

    __slots__ = ("applies", "id", "names", "reference", "side", "what", "why")

    def __init__(
        self,
        id_: str,
        side: str,
        names: tuple[str, ...],
        what: str,
        why: str,
        reference: str,
        applies: Callable[[Case], bool],
    ) -> None:
        self.id = id_
        self.side = side
        self.names = frozenset(names)
        self.what = what
        self.why = why
        self.reference = reference
        self.applies = applies
