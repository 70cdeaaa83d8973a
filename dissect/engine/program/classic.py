"""A block of an S7-300/400 as octets: header, code or values, interface, networks, footer (mc7 reference section 2)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.blocks import FOOTER, HEADER, is_header
from dissect.protocols.s7.tables import BLOCK_KINDS
from dissect.wire.part import Part

#: The text of `Part.text` for a time that is not set.
_NO_DAY: Final = "1984-01-01 00:00:00.000"


class ClassicBlock:
    """A block as far as its octets are there; lengths that reach beyond them are cut, without an error.

    ``code`` are the MC7 octets, or the values of a data block. ``interface`` are the declarations with their start values.
    ``networks`` is the additional information: network and jump tables. Texts are from the wire and not escaped. ``missing``
    counts octets that the header announces but that are not there. ``checksum`` is -1 if the footer is incomplete.
    """

    __slots__ = (
        "author", "checksum", "code", "code_time", "family", "interface", "interface_time", "kind", "language", "missing",
        "name", "networks", "number", "protection", "size", "version",
    )  # fmt: skip

    def __init__(self, octets: bytes) -> None:
        head = Part(HEADER, octets, 0, HEADER.size)
        self.kind = BLOCK_KINDS.name(head.number("block_kind"))
        self.number = head.number("block_number")
        self.language = head.text("language")
        self.size = head.number("load_length")
        self.protection = head.text("security")
        self.code_time = _time(head, "code_time")
        self.interface_time = _time(head, "interface_time")
        self.missing = max(self.size - len(octets), 0)
        at = HEADER.size
        pieces = []
        for length in ("mc7_length", "ssb_length", "add_length"):
            end = at + head.number(length)
            pieces.append(octets[at:end])
            at = end
        self.code, self.interface, self.networks = pieces
        self.author = self.family = self.name = self.version = ""
        self.checksum = -1
        begin = self.size - FOOTER.size
        if at <= begin and self.size <= len(octets):
            foot = Part(FOOTER, octets, begin, self.size)
            self.author, self.family, self.name = [_text(foot.octets(name)) for name in ("author", "family", "name")]
            self.version = foot.text("version")
            self.checksum = foot.number("checksum")

    def __repr__(self) -> str:
        return f"ClassicBlock({self.kind} {self.number}, {self.language}, {self.size} bytes)"


def read_classic(octets: bytes) -> ClassicBlock | None:
    """Return the block at the beginning of octets; None if there is none. Never raises."""
    return ClassicBlock(octets) if is_header(octets) else None


def _time(head: Part, name: str) -> str:
    text = head.text(name)
    return "" if text == _NO_DAY else text


def _text(octets: bytes) -> str:
    return octets.decode("latin-1").rstrip("\0 ")
