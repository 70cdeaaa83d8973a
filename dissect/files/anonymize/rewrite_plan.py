"""The plan for rewriting a message: octets that stay, octets that are replaced; all others are set to zero."""

from __future__ import annotations

from dissect.files.anonymize.account import Account
from dissect.files.anonymize.masked import Masked


class RewritePlan:
    """The plan for a message; initially no octet stays. ``pieces`` are (begin, end, octets), in order.

    ``octets`` of a piece is None if the original octets stay.
    """

    __slots__ = ("_hidden", "account", "octets", "pieces")

    def __init__(self, octets: bytes, account: Account) -> None:
        self.octets = octets
        self.account = account
        self._hidden: Masked = account.hidden
        self.pieces: list[tuple[int, int, bytes | None]] = []

    def keep(self, begin: int, end: int) -> None:
        """Keep the octets."""
        if begin >= end:
            return
        if self.pieces and self.pieces[-1][1] == begin and self.pieces[-1][2] is None:
            begin = self.pieces.pop()[0]
        self.pieces.append((begin, end, None))

    def put(self, begin: int, new: bytes, kind: str) -> None:
        """Replace the octets from ``begin`` on."""
        end = begin + len(new)
        if new == (self.octets[begin:end] if begin <= len(self.octets) else b""):
            self.keep(begin, end)
        elif new:
            self.pieces.append((begin, end, new))
            self.account.replace(kind)

    def write(self, new: bytes, begin: int = 0) -> None:
        """Replace the octets from ``begin`` on without counting; equal octets stay."""
        at = 0
        while at < len(new):
            end = at
            same = new[at] == self.octets[begin + at]
            while end < len(new) and (new[end] == self.octets[begin + end]) == same:
                end += 1
            if same:
                self.keep(begin + at, begin + end)
            else:
                self.pieces.append((begin + at, begin + end, new[at:end]))
            at = end

    def zero(self, begin: int, end: int, kind: str) -> None:
        """Count octets as set to zero, which is the default for all octets."""
        if begin < min(end, len(self.octets)):
            self._hidden.add(kind, self.octets[begin:end])
