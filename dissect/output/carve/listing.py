"""The list of blocks and their comparison, as text lines, JSON-ready values and CSV rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final

from dissect.engine.program.carved import CarvedBlock
from dissect.engine.program.compare import CHANGED, GONE, MOVED, NEW, BlockChange
from dissect.meaning.report import facets, words
from dissect.meaning.report.outcome import WIDE_PAGE, Outcome
from dissect.meaning.report.styled import FAILED, HANG, PLAIN, Line
from dissect.meaning.report.words import Places
from dissect.output.carve.contents import block_values
from dissect.output.carve.records import BLOCKS_SCHEMA, COLUMNS, digest, record, row, value_record
from dissect.protocols.mc7.changes import Change, change_lines, change_values
from dissect.wire.text import Clock, shortened

CHANGES_SCHEMA: Final = "s7dissect.block-changes/1"
#: CSV columns of a comparison.
CHANGE_COLUMNS: Final = (
    "state", "type", "number", "was_number", "name", "parts", "facts", "details", "comparable", "was_octets", "now_octets",
    "was_sha256", "now_sha256",
)  # fmt: skip
_TEXT: Final = 60
#: Number of values of a data block in the text; JSON and the manifest have all of them.
_VALUES: Final = 40
_VALUE: Final = 200


class BlockList(Outcome):
    """The blocks of captures. ``lost`` counts blocks that were not kept, because there were too many."""

    layout = WIDE_PAGE

    def __init__(self, blocks: Sequence[CarvedBlock], lost: int, places: Places, clock: Clock) -> None:
        self.blocks = blocks
        self.lost = lost
        self.places = places
        self.clock = clock
        self._values: dict[str, object] | None = None

    def text(self) -> Iterator[Line]:
        """Yield a line for each block, with the values of data blocks below it."""
        for block in self.blocks:
            style = PLAIN if block.complete else FAILED
            yield Line(block_line(block, self.places, self.clock), style, HANG)
            yield from _value_lines(block)
        if self.lost:
            yield Line(f"and {words.count(self.lost, 'further block')}: too many to list", FAILED)

    def as_dict(self) -> dict[str, object]:
        """Return the blocks as values, the same object at each call; `dissect.output.carve.folder` adds the names of files."""
        if self._values is None:
            self._values = self._records()
        return self._values

    def _records(self) -> dict[str, object]:
        found = []
        for block in self.blocks:
            values = record(block, self.places, self.clock)
            named = block_values(block)
            if named:
                values["values"] = [value_record(value) for value in named]
            found.append(values)
        return {"schema": BLOCKS_SCHEMA, "lost": self.lost, "blocks": found}

    def rows(self) -> Iterator[Sequence[str]]:
        """Yield the heading and a row for each block."""
        yield COLUMNS
        records = self.as_dict()["blocks"]
        assert isinstance(records, list)
        for values in records:
            yield row(values)


def block_line(block: CarvedBlock, places: Places, clock: Clock) -> str:
    """Return a line about a block: time, actor, action, size, state, and the facts in its header."""
    parts = [_title(block), words.count(len(block.octets), "byte"), _state(block, places), _facts(block)]
    return _transfer(block, places, clock) + "  ".join([part for part in parts if part])


def transfer_line(block: CarvedBlock, places: Places, clock: Clock) -> str:
    """Return the same without the facts of the header, which the listing has."""
    return f"{_transfer(block, places, clock)}{shortened(block.label, _TEXT)}  {_state(block, places)}"


def _transfer(block: CarvedBlock, places: Places, clock: Clock) -> str:
    head = ""
    operation = block.operation
    if operation is not None:
        ends = operation.connection.tcp.ends
        head = (
            f"{clock.moment(operation.begin_ns)}  {places.pair(operation.first_frame, operation.last_frame):<10}"
            f" {places.end(ends[operation.asked_by])} → {places.end(ends[1 - operation.asked_by])}  {operation.kind:<8}  "
        )
    return head


def _title(block: CarvedBlock) -> str:
    name = f" '{shortened(block.name, _TEXT)}'" if block.name else ""
    language = f" ({block.language})" if block.language else ""
    return f"{shortened(block.label, _TEXT)}{name}{language}"


def _state(block: CarvedBlock, places: Places) -> str:
    state = "complete" if block.complete else f"INCOMPLETE: {block.missing}"
    activation = block.activation
    if activation is None:
        return state
    if activation.frame:
        return f"{state}, activated by packet {places.mark(activation.frame)}"
    return f"{state}, {'deleted' if activation.deleted else 'not activated'}"


def _facts(block: CarvedBlock) -> str:
    facts = [
        f"author {shortened(block.author, _TEXT)}" if block.author else "",
        f"family {shortened(block.family, _TEXT)}" if block.family else "",
        f"version {block.version}" if block.version else "",
        f"code {block.code_time}" if block.code_time else "",
        f"interface {block.interface_time}" if block.interface_time else "",
        "know-how protected" if block.protected else "",
    ]
    return ", ".join([fact for fact in facts if fact])


def _value_lines(block: CarvedBlock) -> Iterator[Line]:
    named = block_values(block)
    for value in named[:_VALUES]:
        place = f" ({value.address})" if value.name else ""
        yield Line(f"    {shortened(facets.named_value(value) + place, _VALUE)}", PLAIN, HANG)
    if len(named) > _VALUES:
        yield Line(f"    and {words.count(len(named) - _VALUES, 'further value')}", PLAIN)


class BlockChanges(Outcome):
    """The changes from one set of blocks to another; ``first`` and ``second`` are the names of the sets.

    ``details`` returns the changes in a block's code, interface and values, as far as these are readable.
    """

    layout = WIDE_PAGE

    def __init__(
        self,
        changes: Sequence[BlockChange],
        first: str,
        second: str,
        details: Callable[[BlockChange], list[Change]],
    ) -> None:
        self.changes = changes
        self.first = first
        self.second = second
        self.details = details

    def text(self) -> Iterator[Line]:
        """Yield a line for each changed block, with the details below it."""
        for change in self.changes:
            yield Line(change_line(change), PLAIN, HANG)
            details = self.details(change)
            for text in change_lines(change.block.label, details) if details else ():
                yield Line(f"    {text}", PLAIN, HANG)
            for called, was, now in change.facts if not details or change.block.plus is not None else ():
                yield Line(f"    {called}: {_quoted(was)} → {_quoted(now)}", PLAIN, HANG)

    def as_dict(self) -> dict[str, object]:
        """Return the changes as values."""
        return {
            "schema": CHANGES_SCHEMA,
            "a": self.first,
            "b": self.second,
            "same": not self.changes,
            "changes": [_change_record(change, self.details(change)) for change in self.changes],
        }

    def rows(self) -> Iterator[Sequence[str]]:
        """Yield the heading and a row for each block that changed."""
        from dissect.wire.text import cell

        yield CHANGE_COLUMNS
        for change in self.changes:
            block, was, now = change.block, change.was, change.now
            facts = "; ".join([f"{called}: {before} → {after}" for called, before, after in change.facts])
            details = "; ".join(change_lines(block.label, found)) if (found := self.details(change)) else ""
            texts = (
                change.state, block.kind, _number(block), _number(was), block.name, ", ".join(change.parts), facts, details,
                "true" if change.comparable else "false", _size(was), _size(now), _digest(was), _digest(now),
            )  # fmt: skip
            yield [cell(text) for text in texts]


def _number(block: CarvedBlock | None) -> str:
    return str(block.number) if block is not None and block.number >= 0 else ""


def _size(block: CarvedBlock | None) -> str:
    return str(len(block.octets)) if block is not None else ""


def _digest(block: CarvedBlock | None) -> str:
    return digest(block) if block is not None else ""


def change_line(change: BlockChange) -> str:
    """Return a line about a changed block. Text from the wire is escaped."""
    title = _title(change.block)
    if change.state == NEW:
        return f"new      {title}: {words.count(len(change.block.octets), 'byte')}"
    if change.state == GONE:
        return f"gone     {title}"
    if change.state == MOVED and change.was is not None:
        return f"moved    {title}: was {shortened(change.was.label, _TEXT)}"
    unsure = "" if change.comparable else "; one of the two is not whole"
    return f"{CHANGED}  {title}: {_what(change)}{unsure}"


def _what(change: BlockChange) -> str:
    """Return which parts of a block differ, as text."""
    if change.parts == ("header",):
        return "header only"
    return ", ".join([part for part in change.parts if part != "header" or change.facts])


def _quoted(text: str) -> str:
    return shortened(text, _TEXT) or "(none)"


def _change_record(change: BlockChange, details: list[Change]) -> dict[str, object]:
    return {
        "state": change.state,
        "label": change.block.label,
        "parts": list(change.parts),
        "comparable": change.comparable,
        "facts": [{"name": called, "was": was, "now": now} for called, was, now in change.facts],
        "details": change_values(details),
        "was": _side(change.was),
        "now": _side(change.now),
    }


def _side(block: CarvedBlock | None) -> dict[str, object] | None:
    """Return one version of a block as values; if it is from a capture, with its packets."""
    if block is None:
        return None
    values: dict[str, object] = {
        "label": block.label,
        "octets": len(block.octets),
        "sha256": digest(block),
        "complete": block.complete,
    }
    if block.operation is not None:
        values |= {
            "direction": block.direction,
            "first_frame": block.operation.first_frame,
            "last_frame": block.operation.last_frame,
        }
    return values
