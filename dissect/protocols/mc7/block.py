"""A block of S7-300 or S7-400 in its transferred or stored form: header, code, interface, tables, footer.

`parse_block` never raises: a fault becomes a `BlockFault`, and everything readable is kept. Source: reference sheet mc7.md,
sections 2 to 4.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Final, NamedTuple

from dissect.protocols.mc7.code import Instruction, decode
from dissect.protocols.mc7.interface import Interface, parse_interface
from dissect.protocols.s7.blocks import FOOTER, HEADER
from dissect.protocols.s7.tables import BLOCK_KINDS, BLOCK_LANGUAGES, CODE_BLOCKS
from dissect.wire.part import Part

MARK: Final = b"pp"
#: The language of encrypted code.
ENCRYPTED: Final = 0x29
SCL: Final = 4
#: Bytes of the final BE, which belongs to no network.
BE_SIZE: Final = 2
#: A table cannot have more entries than the additional information has words.
_MOST: Final = 0x8000


class BlockFault(NamedTuple):
    """A fault of a block: ``slug`` is its kind, ``offset`` its place in the code (or -1), ``text`` a sentence."""

    slug: str
    offset: int
    text: str


#: Slugs of facts, and their meanings.
FACTS: Final[dict[str, str]] = {
    "not_a_block": "The bytes are not a block of S7-300 or S7-400.",
    "cut": "Bytes of the block are missing.",
    "surplus": "More bytes than the header states.",
    "lengths": "The lengths in the header contradict each other.",
    "encrypted": "The code is encrypted (block privacy).",
    "unknown_instruction": "Bytes that are not an instruction.",
    "no_end": "The code does not end with BE at the stated length.",
    "network_border": "A network begins inside an instruction.",
    "network_sum": "The lengths of the networks do not add up to the code.",
    "network_table": "The network table is cut off.",
    "jump_list": "The jump list and the jumps in the code differ.",
    "jump_target": "A jump target is not an instruction.",
    "interface": "The interface cannot be read to its end.",
    "start_values": "The start values do not fit the declarations.",
    "local_data": "More temporary data declared than local data stated.",
    "parameter": "The code uses a parameter that the interface does not declare.",
    "parameter_type": "The code uses a parameter as a different type from the one declared.",
    "parameter_list": "A call of an FC or SFC has no parameter list.",
}


class Tables(NamedTuple):
    """The additional information: bytes of each network, offsets of jumps; ``rest`` are octets that the compiler left.

    ``present`` is False if a block has none; ``cut`` is True if it ends before the end that its counts state.
    """

    networks: list[int]
    jumps: list[int]
    rest: bytes
    present: bool
    cut: bool


NO_TABLES: Final = Tables([], [], b"", False, False)


class Network(NamedTuple):
    """A network: its number from 1 on, its offset and size in the code, and its instructions."""

    number: int
    start: int
    end: int
    instructions: list[Instruction]


def parse_tables(octets: bytes) -> Tables:
    """Return the network table and the jump list; numbers are little-endian, jumps are counted in words."""
    if len(octets) < 2:
        return Tables([], [], octets, False, False)
    at = 2
    networks: list[int] = []
    count = int.from_bytes(octets[:2], "little")
    for _ in range(min(count, _MOST)):
        if at + 2 > len(octets):
            return Tables(networks, [], b"", True, True)
        networks.append(int.from_bytes(octets[at : at + 2], "little"))
        at += 2
    if at + 2 > len(octets):
        return Tables(networks, [], octets[at:], True, True)
    offsets: list[int] = []
    count = int.from_bytes(octets[at : at + 2], "little")
    at += 2
    for _ in range(min(count, _MOST)):
        if at + 2 > len(octets):
            return Tables(networks, offsets, b"", True, True)
        offsets.append(2 * int.from_bytes(octets[at : at + 2], "little"))
        at += 2
    return Tables(networks, offsets, octets[at:], True, False)


def tables_octets(tables: Tables) -> bytes:
    """Return the octets of the additional information from which `parse_tables` read ``tables``."""
    if not tables.present:
        return tables.rest
    octets = len(tables.networks).to_bytes(2, "little")
    octets += b"".join([length.to_bytes(2, "little") for length in tables.networks])
    octets += len(tables.jumps).to_bytes(2, "little")
    return octets + b"".join([(offset // 2).to_bytes(2, "little") for offset in tables.jumps]) + tables.rest


class Block:
    """A block as far as it is there.

    ``kind`` and ``number`` identify it (``OB``, 1). ``header`` and ``footer`` have the fields around it
    (`dissect.protocols.s7.blocks`), None if they are missing. ``code`` are the MC7 bytes, or the actual values of a DB;
    ``interface_octets`` and ``additional`` are the raw parts after it. ``instructions`` and ``networks`` are empty for a DB or
    an encrypted block. ``facts`` are the faults found by `parse_block` and the checks.
    """

    def __init__(self, octets: bytes) -> None:
        self.octets = octets
        self.kind = ""
        self.number = -1
        self.language = -1
        self.header: Part | None = None
        self.footer: Part | None = None
        self.code = b""
        self.interface_octets = b""
        self.additional = b""
        self.interface = Interface()
        self.tables = NO_TABLES
        self.instructions: list[Instruction] = []
        self.networks: list[Network] = []
        self.facts: list[BlockFault] = []
        self._starts: list[int] | None = None

    @property
    def label(self) -> str:
        """Type and number: ``OB1``."""
        return f"{self.kind}{self.number}" if self.kind else "block"

    @property
    def language_text(self) -> str:
        """The language it was written in."""
        return BLOCK_LANGUAGES.name(self.language) if self.language >= 0 else ""

    @property
    def protected(self) -> bool:
        """True for know-how protection, which does not hide the code."""
        return self.header is not None and self.header.number("security") > 0

    @property
    def encrypted(self) -> bool:
        """True if the code is encrypted (block privacy)."""
        return self.language == ENCRYPTED

    @property
    def has_code(self) -> bool:
        """True if it has instructions that can be read."""
        return self.kind in CODE_BLOCKS and not self.encrypted

    def field(self, name: str) -> int:
        """Return a number of the header or footer, -1 if it is missing."""
        for part in (self.header, self.footer):
            if part is not None and part.find(name) is not None:
                return part.number(name)
        return -1

    def said(self, name: str) -> str:
        """Return the text of a field in header or footer (author, code_time …), empty if it is missing; not escaped."""
        for part in (self.header, self.footer):
            if part is not None and part.find(name) is not None:
                return part.text(name)
        return ""

    def raw(self, name: str) -> bytes:
        """Return the bytes of a field in header or footer, empty if it is missing."""
        for part in (self.header, self.footer):
            if part is not None and part.find(name) is not None:
                return part.octets(name)
        return b""

    def network_of(self, offset: int) -> int:
        """Return the number of the network with this offset of the code, 0 after the last one."""
        if self._starts is None:
            self._starts = [network.start for network in self.networks]
        index = bisect_right(self._starts, offset) - 1
        if index < 0 or offset >= self.networks[index].end:
            return 0
        return self.networks[index].number

    def tell(self, slug: str, offset: int, text: str) -> None:
        """Add a fact."""
        self.facts.append(BlockFault(slug, offset, text))


def parse_block(octets: bytes) -> Block:
    """Return the block in ``octets``, read as far as possible. Never raises; faults are in ``facts``."""
    block = Block(octets)
    if len(octets) < HEADER.size or octets[:2] != MARK:
        block.tell("not_a_block", -1, _no_block(octets))
        return block
    header = Part(HEADER, octets, 0, HEADER.size)
    block.header = header
    kind = header.number("block_kind")
    if kind not in BLOCK_KINDS or kind == 0:
        block.tell("not_a_block", -1, f"block type {kind:#04x} is unknown: not a block of S7-300 or S7-400")
        return block
    block.kind = BLOCK_KINDS.name(kind)
    block.number = header.number("block_number")
    block.language = header.number("language")
    _cut(block, header)
    if block.encrypted:
        block.tell("encrypted", -1, "the code is encrypted (block privacy): header, interface and tables only")
    _read_parts(block)
    return block


def _no_block(octets: bytes) -> str:
    if octets[:2] != MARK:
        begin = octets[:8].hex(" ") or "nothing"
        return f"not a block: expected the mark 70 70 of an S7-300 or S7-400 block, got {begin}"
    return f"cut off inside the header: {len(octets)} of {HEADER.size} bytes"


def _cut(block: Block, header: Part) -> None:
    """Split a block into its parts by the lengths in its header."""
    octets = block.octets
    stated = header.number("load_length")
    code, ssb, add = (header.number(f"{part}_length") for part in ("mc7", "ssb", "add"))
    behind = HEADER.size + code + ssb + add
    if behind + FOOTER.size != stated:
        block.tell("lengths", -1, f"the header states {stated} bytes, its parts add up to {behind + FOOTER.size}")
    if len(octets) < behind:
        block.tell("cut", -1, f"{len(octets)} of {behind + FOOTER.size} bytes are there")
    begin = HEADER.size
    block.code = octets[begin : begin + code]
    block.interface_octets = octets[begin + code : begin + code + ssb]
    block.additional = octets[begin + code + ssb : behind]
    if len(octets) >= behind + FOOTER.size:
        block.footer = Part(FOOTER, octets, behind, behind + FOOTER.size)
        if len(octets) > behind + FOOTER.size:
            block.tell("surplus", -1, f"{len(octets) - behind - FOOTER.size} bytes behind the footer")
    elif len(octets) >= behind:
        block.tell("cut", -1, f"{len(octets) - behind} of {FOOTER.size} bytes of the footer are there")


def block_of_parts(kind: str, number: int, language: int, code: bytes, interface: bytes, additional: bytes) -> Block:
    """Return a block made of its parts, without header and footer, as a STEP 7 project stores them."""
    block = Block(b"")
    block.kind, block.number, block.language = kind, number, language
    block.code, block.interface_octets, block.additional = code, interface, additional
    _read_parts(block)
    return block


def _read_parts(block: Block) -> None:
    block.interface = parse_interface(block.interface_octets)
    block.tables = parse_tables(block.additional) if block.kind in CODE_BLOCKS else NO_TABLES
    if not block.has_code:
        return
    borders = [start for start, _ in _spans(block)] + block.tables.jumps
    block.instructions = decode(block.code, borders)
    block.networks = _networks(block)


def _spans(block: Block) -> list[tuple[int, int]]:
    """Return start and end of each network; bytes beyond the table belong to the last one."""
    spans: list[tuple[int, int]] = []
    at = 0
    for length in block.tables.networks:
        spans.append((at, min(at + length, len(block.code))))
        at = min(at + length, len(block.code))
    if not spans:
        return [(0, len(block.code))]
    if at < len(block.code):
        spans[-1] = (spans[-1][0], len(block.code))
    return spans


def _networks(block: Block) -> list[Network]:
    """Return the networks with their instructions; an instruction across a wrong border belongs to the earlier network."""
    networks: list[Network] = []
    instructions = block.instructions
    at = 0
    for number, (start, end) in enumerate(_spans(block), 1):
        first = at
        while at < len(instructions) and instructions[at].offset < end:
            at += 1
        networks.append(Network(number, start, end, instructions[first:at]))
    return networks
