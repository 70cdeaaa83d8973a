"""Makes a `WantedSet` from names that a user gives: addresses of all dialects, tags, elements and members, SCD objects."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Final

from dissect.engine.exchange import PayloadDecoder
from dissect.engine.transactions.naming import Naming
from dissect.meaning.bindings.engine import ScdCarrier
from dissect.meaning.select.literals import place_of
from dissect.meaning.tags.address import WIDTHS, AddressError, TagAddress, TypeNameError, parse_tag_address
from dissect.meaning.tags.index import TagPart
from dissect.meaning.tags.model import NUMBERED_BITS, Tag
from dissect.meaning.tags.naming import HostNaming, TagNaming
from dissect.meaning.tags.types import DataType
from dissect.output.variables.wanted import Wanted, WantedSet, of_tag, whole
from dissect.protocols.s7.tables import NUMBERED_AREAS
from dissect.wire.config.hints import close_names
from dissect.wire.errors import Error
from dissect.wire.text import shortened

#: Addresses of SCD, and names of S7comm-plus: only the traffic shows whether these exist.
_OBJECT: Final = re.compile(r"0x[0-9a-f]{1,16}:[0-9]{1,10}")
_PLUS: Final = re.compile(r'.*".*|.* LID [0-9]+.*')
#: The name of an element of an array: the array and the indexes.
_ELEMENT: Final = re.compile(r"(.+)\[([0-9,. -]+)\]")
#: Maximum number of bits of a whole data block that are watched.
_MOST_BITS: Final = 8 * 65536


class WantedError(Error, ValueError):
    """A name is neither an address nor a tag; the message, one line, says what was expected."""


class Known:
    """The names that a user may give: those of the tags in ``naming``, and ``others`` (of SCD).

    ``of_command``: they belong to a command with an option for tags; ``files``: they may also be files.
    """

    def __init__(
        self, naming: Naming | None, others: Iterable[str] = (), of_command: bool = True, files: bool = True
    ) -> None:
        self.of_command = of_command
        self.files = files and of_command
        self.tags: list[tuple[Tag, TagNaming | None]] = []
        if isinstance(naming, HostNaming):
            for one in naming.all:
                self.tags += [(tag, one) for tag in one.tags]
        elif isinstance(naming, TagNaming):
            self.tags = [(tag, None) for tag in naming.tags]
        self.others = {name.lower() for name in others if name}
        self.has_tags = naming is not None

    @property
    def names(self) -> list[str]:
        """All names."""
        return [*dict.fromkeys([tag.name for tag, _ in self.tags]), *self.others]


def scd_names(decoder: PayloadDecoder | None) -> list[str]:
    """Return the names of the variables in the SCD dictionary of a decoder; empty for no decoder."""
    if not isinstance(decoder, ScdCarrier):
        return []
    return [
        variable.label
        for row in decoder.dictionary
        for variable in ([row.head] if row.single and row.head is not None else row.fields)
        if not variable.reserved
    ]


def choose(texts: Sequence[str], known: Known) -> WantedSet:
    """Return the set of the things that ``texts`` name. Raises `WantedError` for the first text that names nothing."""
    found: dict[tuple[str, int, int, int, int], Wanted] = {}
    for text in texts:
        for wanted in one_of(text, known):
            found.setdefault((wanted.word, *_place(wanted)), wanted)
    return WantedSet(list(found.values()))


def _place(wanted: Wanted) -> tuple[int, int, int, int]:
    return int(wanted.area), int(wanted.db), int(wanted.start), int(wanted.bits)


def one_of(text: str, known: Known) -> list[Wanted]:
    """Return the things that one text names: a tag, all members of a structure, an address. Raises `WantedError`."""
    tags = _tags(text, known)
    if tags:
        return tags
    if _OBJECT.fullmatch(text.lower()) or _PLUS.fullmatch(text) or text.lower() in known.others:
        return [Wanted(text)]
    place = place_of(text)
    if place is not None:  # a whole block has more bits than that, what is no place in memory none
        numbered = place.area in NUMBERED_AREAS
        start, bits = (
            (place.start * NUMBERED_BITS, place.size * NUMBERED_BITS) if numbered else (place.start, place.size)
        )
        if 0 < bits <= _MOST_BITS:
            return [Wanted(text, place.area, place.db, start, bits)]
    try:
        return [_of_address(text, parse_tag_address(text))]
    except (AddressError, TypeNameError) as error:
        raise WantedError(_wrong(text, str(error), known)) from None


def _tags(text: str, known: Known) -> list[Wanted]:
    lower = text.lower()
    found = [of_tag(text, tag, naming) for tag, naming in known.tags if tag.name.lower() == lower]
    if found:
        return found
    element = _ELEMENT.fullmatch(text)
    if element:
        # Each row of an array of bits is a tag by itself, and several CPUs may have an array of one name.
        name, indexes = element[1].lower(), element[2].replace(" ", "")
        arrays = [(tag, naming) for tag, naming in known.tags if tag.dims and tag.name.lower() == name]
        elements = [_element(text, tag, indexes, naming) for tag, naming in arrays]
        found = [wanted for wanted in elements if wanted is not None]
        if found:
            return found
    members = (f"{lower}.", f"{lower}[")
    return [of_tag(tag.name, tag, naming) for tag, naming in known.tags if tag.name.lower().startswith(members)]


def _element(text: str, tag: Tag, indexes: str, naming: TagNaming | None) -> Wanted | None:
    for number in range(int(tag.count)):
        if f"{tag.prefix}{tag.index(number)}" == indexes:
            start = int(tag.start + number * tag.step)
            wanted = Wanted(text, int(tag.area), int(tag.db), start, int(tag.size))
            wanted.part = TagPart(tag, number, 1, start % 8, int(tag.size), 0, True)
            wanted.naming = naming
            return wanted
    return None


def _of_address(text: str, address: TagAddress) -> Wanted:
    """Return an address with its type, if it has one."""
    base = address.type
    if base is None:
        bits = WIDTHS[address.width or ("X" if address.bit >= 0 else "B")]
        return Wanted(text, address.area, address.db, address.start, bits)
    if address.bit > 0 and base.bits != 1:
        raise AddressError(f"{shortened(text, 60)}: {base.name} has no bit")
    count = max(address.elements, 1)
    wanted = Wanted(text, address.area, address.db, address.start, base.bits * count)
    wanted.part = whole(_typed(address, base, count))
    return wanted


def _typed(address: TagAddress, base: DataType, count: int) -> Tag:
    """Return a tag without a name, by which octets can be decoded."""
    tag = Tag("", address.area, address.db, address.start, base.kind, base.name, base.bits)
    if count > 1:
        tag.count = count
        tag.dims = [(0, count - 1)]
    return tag


def _wrong(text: str, why: str, known: Known) -> str:
    shown = shortened(text, 60)
    near = close_names(text, known.names)
    if near:
        return f"{shown}: no such tag; close to it: {', '.join([shortened(name, 60) for name in near])}"
    if "is not an address" not in why:
        return why
    option = "--tags" if known.of_command else "tags="
    tags = f"nor a tag of the files of {option}" if known.has_tags else f"and without {option} there are no names"
    neither = "neither a file nor an address" if known.files else "not an address"
    return f"{shown}: {neither} such as DB10.DBD4, DB10.DBD4:REAL, MW20 or I0.1, {tags}"
