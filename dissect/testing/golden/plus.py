"""S7comm-plus PDUs in goldens and comparisons: remarks, the subject of a request, and the differences between two PDUs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from dissect.protocols.s7plus import layouts
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.hiding import reads_secret, shown_contents, shown_half
from dissect.protocols.s7plus.ids import HIDDEN
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.summary import object_text, summary
from dissect.protocols.s7plus.tables import NOTIFICATION
from dissect.protocols.s7plus.value_showing import value_with_type
from dissect.testing.golden.phrases import octets_change, short
from dissect.wire.part import OCTETS, SURPLUS, Part

#: Parts that belong to one recording, and parts that are the same in every PDU.
_PASSING: Final = frozenset(
    id(layout) for layout in (layouts.INTEGRITY_ID, layouts.DIGEST, layouts.FILL, layouts.NOTIFICATION_HEAD)
)
#: What a subscription asks for, by reference.
Names = Mapping[int, str]
_NO_NAMES: Final[Names] = {}
#: Parts that are compared as octets.
_PLAIN: Final = frozenset((id(OCTETS), id(SURPLUS), id(layouts.PIECE)))


def plus_notes(octets: bytes, request: bytes = b"") -> list[str]:
    """Return remarks on a PDU, safe to show; empty if its head is complete. ``request`` is the request it answers, if any."""
    if request and reads_secret(shown_half(parse_plus(request))):
        return [HIDDEN]
    pdu = parse_plus(octets)
    return [short(text) for text in summary(pdu, shown_contents(pdu, shown=False)[0])]


def plus_subject(octets: bytes) -> tuple[object, ...]:
    """Return the subject of a request without the values in it."""
    contents = shown_contents(parse_plus(octets), shown=False)[0]
    return contents.object_id, *contents.ids, *[address.key for address in contents.addresses]


def plus_differences(
    was: bytes, is_: bytes, names: Names = _NO_NAMES, names_now: Names = _NO_NAMES
) -> list[tuple[str, str]]:
    """Return the differences between two PDUs of the same function, in wire order; empty if there are none.

    Different structures count as one difference. ``names`` are the names for references in notifications.
    """
    (one, first), (other, second) = _read(was), _read(is_)
    if one.opcode == other.opcode == NOTIFICATION and not (first.malformed or second.malformed):
        return _notified_differences((one, first, names), (other, second, names_now))
    old, new = _meaningful(one, first), _meaningful(other, second)
    if [name for name, _, _ in old] != [name for name, _, _ in new]:
        texts = [
            ", ".join([short(text) for text in summary(pdu, differing)])
            for pdu, differing in ((one, first), (other, second))
        ]
        if texts[0] != texts[1]:
            return [(texts[0] or "nothing", texts[1] or "nothing")]
        return [(f"{len(old)} parts", f"{len(new)} parts")]
    differing: list[tuple[str, str]] = []
    for (name, note, octets), (_, note_now, octets_now) in zip(old, new, strict=True):
        if note != note_now:
            differing.append((f"{name} {short(note)}", f"{name} {short(note_now)}"))
        elif octets != octets_now:
            before, after = octets_change(octets, octets_now)
            differing.append((f"{name} {before}", f"{name} {after}"))
    return differing


def _notified_differences(
    was: tuple[PlusPdu, Contents, Names], is_: tuple[PlusPdu, Contents, Names]
) -> list[tuple[str, str]]:
    """Compare the items of two notifications by the names that their subscriptions gave them."""
    old, new = _notified(*was), _notified(*is_)
    differing: list[tuple[str, str]] = []
    for name in dict.fromkeys([*old, *new]):
        before, now = old.get(name), new.get(name)
        if before is None or now is None:
            differing.append((_item(name, before), _item(name, now)))
        elif before[1] != now[1]:
            texts = (before[0], now[0]) if before[0] != now[0] else octets_change(before[1], now[1])
            differing.append((_item(name, (texts[0], b"")), _item(name, (texts[1], b""))))
    return differing


def _item(name: str, item: tuple[str, bytes] | None) -> str:
    return f"without {short(name)}" if item is None else f"{short(name)} {item[0]}"


def _notified(pdu: PlusPdu, contents: Contents, names: Names) -> dict[str, tuple[str, bytes]]:
    """Return each item of a notification, in words and as octets; if an item is repeated, the last value wins."""
    items: dict[str, tuple[str, bytes]] = {}
    for reference, value in contents.items:
        octets = pdu.data[value.offset : value.end]
        items[names.get(reference) or f"item {reference}"] = (f"= {short(value_with_type(value))}", octets)
    for reference, kind in contents.refusals:
        items[names.get(reference) or f"item {reference}"] = ("refused", bytes((kind,)))
    for number, one in enumerate(contents.objects, 1):
        items[f"object {number}"] = (f"= {short(object_text(one))}", pdu.data[one.offset : one.end])
    if contents.value is not None:
        items["value"] = (
            f"= {short(value_with_type(contents.value))}",
            pdu.data[contents.value.offset : contents.value.end],
        )
    return items


def _read(octets: bytes) -> tuple[PlusPdu, Contents]:
    pdu = parse_plus(octets)
    return pdu, shown_contents(pdu)[0]


def _meaningful(pdu: PlusPdu, contents: Contents) -> list[tuple[str, str, bytes]]:
    """Return the meaningful parts: name, note, and the octets if the note does not show them completely."""
    return [
        (part.layout.name, part.note, b"" if _note_is_complete(part) else pdu.data[part.offset : part.end])
        for part in contents.parts
        if id(part.layout) not in _PASSING
    ]


def _note_is_complete(part: Part) -> bool:
    """Return whether the note shows the whole part; long texts, arrays and octets are shortened in notes."""
    return bool(part.note) and id(part.layout) not in _PLAIN and "…" not in part.note and "elements" not in part.note
