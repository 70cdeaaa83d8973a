"""Answers a read of several variables of S7comm-plus from the recorded results of its variables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.tables import GET_MULTI_VARIABLES
from dissect.testing.playback.server.model import RecordedStep, Script
from dissect.testing.playback.server.plus import answer_with
from dissect.wire.varint import VLQ, VLQ64, build_varint

#: Maximum number of answers to single items that are kept.
MAX_ITEMS: Final = 1_000_000
#: The error for an item that was not recorded: a server's answer for a block that does not exist.
NO_ITEM: Final = 0x8104

Key = tuple[int, ...]


class PlusItemAnswer:
    """The result of an item: ``value`` are its octets with flags and type, empty if it was refused with ``code``."""

    __slots__ = ("code", "latency_ns", "value")

    def __init__(self, value: bytes, code: int, latency_ns: int) -> None:
        self.value = value
        self.code = code
        self.latency_ns = latency_ns


class PlusItems:
    """The items of recorded reads by their addresses, in recorded order."""

    def __init__(self, scripts: Sequence[Script]) -> None:
        self._items: dict[Key, list[PlusItemAnswer]] = {}
        left = MAX_ITEMS
        for script in scripts:
            for step in script.steps:
                left -= self._add(step) if left > 0 else 0

    def _add(self, step: RecordedStep) -> int:
        request, response = parse_plus(step.request), parse_plus(step.answer)
        if request.function != GET_MULTI_VARIABLES or response.function != GET_MULTI_VARIABLES or response.malformed:
            return 0
        keys = _keys(parse_contents(request))
        contents = parse_contents(response)
        for number, value in contents.items:
            self._enter(
                keys, number, PlusItemAnswer(bytes(response.data[value.offset : value.end]), 0, step.latency_ns)
            )
        for number, code in contents.refusals:
            self._enter(keys, number, PlusItemAnswer(b"", code, step.latency_ns))
        return len(keys)

    def _enter(self, keys: Sequence[Key], number: int, answer: PlusItemAnswer) -> None:
        if 0 < number <= len(keys) and (answer.value or answer.code):
            self._items.setdefault(keys[number - 1], []).append(answer)

    def of(self, key: Key) -> list[PlusItemAnswer]:
        """Return the recorded results of a variable."""
        return self._items.get(key, [])


class Together:
    """An answer built from items: ``octets``, the answer time of its slowest item, and the labels of unknown items."""

    __slots__ = ("latency_ns", "missing", "octets")

    def __init__(self) -> None:
        self.octets = b""
        self.latency_ns = 0
        self.missing: list[str] = []


def put_together(request: PlusPdu, of: Callable[[Key], PlusItemAnswer | None]) -> Together | None:
    """Return the answer to a read with at least one recorded item; None for anything else."""
    contents = parse_contents(request)
    if request.function != GET_MULTI_VARIABLES or not contents.addresses or not request.whole:
        return None
    together = Together()
    values = refusals = b""
    for number, address in enumerate(contents.addresses, 1):
        answer = of(address.key)
        if answer is None:
            together.missing.append(address.label)
        else:
            together.latency_ns = max(together.latency_ns, answer.latency_ns)
        index = build_varint(number, VLQ)
        if answer is not None and answer.value:
            values += index + answer.value
        else:
            refusals += index + build_varint(answer.code if answer is not None else NO_ITEM, VLQ64)
    if len(together.missing) == len(contents.addresses):
        return None
    together.octets = answer_with(request, 0, values + b"\0" + refusals + b"\0")
    return together


def _keys(contents: Contents) -> list[Key]:
    return [address.key for address in contents.addresses]
