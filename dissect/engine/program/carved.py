"""Builds blocks from their transfer: a download or upload of S7comm carries one block, a transfer of S7comm-plus several.

`carve` takes a finished operation. The name of a block comes from its header, or from the request if it has no header: some
clients (python-snap7) load contents without a header.
"""

from __future__ import annotations

import re
from typing import Final

from dissect.engine.program.classic import ClassicBlock, read_classic
from dissect.engine.program.plus import PlusBlock, plus_block_of, plus_blocks
from dissect.engine.transactions.operation import DONE, NAMELESS, NOT_CAPTURED, TRANSFERS, Activation, Operation
from dissect.protocols.s7.blocks import HEADER as HEADER_LAYOUT
from dissect.protocols.s7.blocks import is_header
from dissect.wire.part import Part
from dissect.wire.text import count

S7COMM: Final = "s7comm"
S7COMM_PLUS: Final = "s7comm_plus"
#: The kind of a transfer that has no block type and number, such as a file of an NC.
FILE: Final = "file"

# Names of the parts of a block; `compare` says which of them changed.
HEADER: Final = "header"
INTERFACE: Final = "interface"
CODE: Final = "code"
VALUES: Final = "values"

_NAMED: Final = re.compile(r"(\w+) (\d+), (?:passive|active|active and passive|.)(, header alone)?\Z")
_HEADER_ALONE: Final = ", header alone"


class CarvedBlock:
    """A block that was downloaded, uploaded, or read from a file.

    ``kind`` is its type (``DB``), ``number`` its number, -1 for a file; ``label`` is both together. ``octets`` are the block up
    to the first gap; ``missing`` describes what is missing, empty for a complete block. ``behind_gap`` are octets that were
    captured after the gap: their place in the block is unknown. ``operation`` is the transfer, None for a block from a file.
    ``activation`` says what happened to a downloaded block. Texts are from the wire and not escaped. Times are ISO texts
    without a time zone, as the engineering station wrote them, or empty. ``checksum`` is -1 for none.
    """

    __slots__ = (
        "activation", "behind_gap", "classic", "kind", "missing", "number", "octets", "operation", "plus", "protocol", "title",
    )  # fmt: skip

    def __init__(self, kind: str, number: int, octets: bytes, protocol: str) -> None:
        self.kind = kind
        self.number = number
        self.title = ""  # its name in the request, if that is not a block name
        self.octets = octets
        self.protocol = protocol
        self.missing = ""
        self.behind_gap = b""
        self.classic: ClassicBlock | None = None
        self.plus: PlusBlock | None = None
        self.operation: Operation | None = None
        self.activation: Activation | None = None

    def __repr__(self) -> str:
        return f"CarvedBlock({self.label!r}, {self.direction!r}, {len(self.octets)} bytes)"

    @property
    def label(self) -> str:
        """Type and number: ``DB1``; for a file its name."""
        return f"{self.kind}{self.number}" if self.number >= 0 else self.title or self.kind

    @property
    def direction(self) -> str:
        """``download``, ``upload``, or empty for a block from a file."""
        return self.operation.kind if self.operation is not None else ""

    @property
    def complete(self) -> bool:
        """True if no part is missing."""
        return not self.missing

    @property
    def activated(self) -> bool | None:
        """Whether a client activated it after the download; None for an upload, and if no activation is needed."""
        activation = self.activation
        if activation is None or not (activation.frame or activation.due or activation.deleted):
            return None
        return activation.frame > 0

    @property
    def language(self) -> str:
        """The language it was written in; empty if unknown."""
        return self._said("language")

    @property
    def name(self) -> str:
        """Its name: the one in the header, or the symbol in S7comm-plus."""
        return self._said("name")

    @property
    def author(self) -> str:
        """Its author."""
        return self._said("author")

    @property
    def family(self) -> str:
        """Its family."""
        return self._said("family")

    @property
    def version(self) -> str:
        """Its version."""
        return self._said("version")

    @property
    def code_time(self) -> str:
        """When its code was changed last."""
        return self._said("code_time")

    @property
    def interface_time(self) -> str:
        """When its interface was changed last."""
        return self._said("interface_time")

    @property
    def checksum(self) -> int:
        """The checksum in the footer; its algorithm is not public."""
        return self.classic.checksum if self.classic is not None else -1

    @property
    def protected(self) -> bool:
        """True for know-how protection."""
        if self.classic is not None:
            return self.classic.protection not in {"", "none"}
        return self.plus is not None and self.plus.protected

    @property
    def plc(self) -> str:
        """Address of the PLC, empty for a block from a file."""
        operation = self.operation
        if operation is None:
            return ""
        return str(operation.connection.tcp.ends[1 - operation.asked_by].host)

    def parts(self) -> dict[str, bytes]:
        """Return its parts by name: code (values for a data block), interface, and the rest as header."""
        if self.classic is not None:
            code = VALUES if self.kind in _VALUES else CODE
            rest = _rest(self.octets, self.classic)
            return {code: self.classic.code, INTERFACE: self.classic.interface, HEADER: rest}
        if self.plus is not None:
            code = VALUES if self.kind in _VALUES else CODE
            return {code: self.plus.code, INTERFACE: self.plus.interface, HEADER: self.plus.rest}
        return {VALUES if self.kind in _VALUES else CODE: self.octets}

    def _said(self, name: str) -> str:
        known = self.classic if self.classic is not None else self.plus
        text = getattr(known, name) if known is not None else ""
        assert isinstance(text, str)
        return text


_VALUES: Final = frozenset(("DB", "SDB", FILE))


def _rest(octets: bytes, block: ClassicBlock) -> bytes:
    """Return header, tables and footer of a block."""
    size = HEADER_LAYOUT.size
    begin = size + len(block.code)
    return octets[:size] + octets[begin + len(block.interface) :]


def carve(operation: Operation) -> list[CarvedBlock]:
    """Return the blocks that an operation carried; empty if there were none, or if it was refused first."""
    if operation.kind not in TRANSFERS:
        return []
    if operation.connection.plus is not None and operation.transactions and not _classic_name(operation):
        return _carve_plus(operation)
    if not operation.octets and operation.error is not None:
        return []
    sure = _sure(operation)
    found = block_of(operation.content[:sure], operation.subject if operation.subject != NAMELESS else "")
    found.behind_gap = operation.content[sure:]
    found.operation = operation
    found.activation = operation.activation
    found.missing = _missing(operation, found)
    return [found]


def _sure(operation: Operation) -> int:
    """Return how many octets of a transfer are certainly at the right place: all, unless a piece in the middle is missing."""
    content = operation.content
    got = len(content)
    if not 0 <= operation.gap < got:
        return got
    size = operation.announced
    if size < 0 and is_header(content):
        size = Part(HEADER_LAYOUT, content, 0, HEADER_LAYOUT.size).number("load_length")
    return got if 0 <= size <= got else operation.gap  # complete: the gap had no piece of this transfer


def block_of(octets: bytes, named: str = "") -> CarvedBlock:
    """Return the block in ``octets``; ``named`` is its name in the request (``DB 1, passive``), used if it has no header."""
    classic = read_classic(octets)
    name = _NAMED.match(named)
    if classic is not None:
        found = CarvedBlock(classic.kind, classic.number, octets, S7COMM)
        found.classic = classic
    elif name is not None:
        found = CarvedBlock(name[1], int(name[2]), octets, S7COMM)
    else:
        found = CarvedBlock(FILE, -1, octets, S7COMM)
    headed = classic is not None and named == f"{classic.kind} {classic.number}"
    found.title = "" if name is not None or headed else named
    return found


def _classic_name(operation: Operation) -> bool:
    return _NAMED.match(operation.subject) is not None


def _missing(operation: Operation, block: CarvedBlock) -> str:
    """Return, as text, what is missing of a transferred block."""
    lacks = _lacks(operation, block)
    if not lacks and operation.likely:
        number = count(int(operation.likely), "pair of request and answer is", "pairs of request and answer are")
        lacks = f"{number} only likely, so its pieces may not belong together"
    if not block.behind_gap:
        return lacks
    lacks = lacks or f"{len(block.octets)} bytes"
    return f"{lacks}, then a gap; {len(block.behind_gap)} bytes behind it left out, as their place is unknown"


def _lacks(operation: Operation, block: CarvedBlock) -> str:
    got = len(block.octets)
    if operation.dropped:
        return f"{operation.dropped} bytes were too much to keep"
    if operation.result == NOT_CAPTURED and not got:
        return "no contents captured"
    if operation.announced > got:
        return f"{got} of {operation.announced} bytes"
    if block.classic is not None and block.classic.missing and not operation.subject.endswith(_HEADER_ALONE):
        return f"{got} of {block.classic.size} bytes"
    if not operation.begun and block.classic is None:
        return "its beginning was not captured"
    if not operation.complete:
        return f"ended after {got} bytes"
    if operation.result not in {DONE, NOT_CAPTURED}:
        return f"transfer {operation.result}"
    return ""


def _carve_plus(operation: Operation) -> list[CarvedBlock]:
    found = []
    for octets, result in _pdus_of(operation):
        for block in plus_blocks(octets):
            one = CarvedBlock(block.kind, block.number, block.octets, S7COMM_PLUS)
            one.title = block.name
            one.plus = block
            one.operation = operation
            if not block.whole:
                dropped = operation.dropped
                one.missing = f"{dropped} bytes were too much to keep" if dropped else _cut_short(block)
            elif result not in {DONE, NOT_CAPTURED}:
                one.missing = f"transfer {result}"
            found.append(one)
    return found


def _pdus_of(operation: Operation) -> list[tuple[bytes, str]]:
    """Return the PDUs that an operation of S7comm-plus carried, each with its outcome."""
    content, ended = operation.content, operation.result
    if not operation.places:
        return [(content, ended)]
    found = []
    begin = 0
    whole = all([step == DONE for step in operation.steps])  # then the end of the load has the outcome of all of them
    for (end, _), result in zip(operation.places, operation.steps, strict=True):
        found.append((content[begin:end], ended if whole else result))
        begin = end
    return found


def _cut_short(block: PlusBlock) -> str:
    return "" if block.whole else f"ended after {len(block.octets)} bytes"


def plus_block(octets: bytes) -> CarvedBlock | None:
    """Return octets that are one S7comm-plus block; None if they are not."""
    block = plus_block_of(octets)
    if block is None:
        return None
    found = CarvedBlock(block.kind, block.number, octets, S7COMM_PLUS)
    found.title = block.name
    found.plus = block
    found.missing = _cut_short(block)
    return found
