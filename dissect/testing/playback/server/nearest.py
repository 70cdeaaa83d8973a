"""Names the recorded requests that are nearest to an unrecorded one, to help find the reason."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Final

from dissect.protocols.s7.items import Item
from dissect.protocols.s7.layouts import DATA_HEAD
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.tables import GROUP_CPU, READ_SZL, READ_VAR, USERDATA, WRITE_VAR
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.testing.golden.exchange import PLUS, S7, Exchange
from dissect.testing.golden.keys import subject
from dissect.testing.golden.plus import plus_subject
from dissect.wire.text import printable, shortened

#: Maximum number of names, of recorded requests that are compared, and of characters of each name.
_NAMED: Final = 3
_MOST: Final = 2_000
_LONG: Final = 100
#: Id and index of a list, two bytes each.
_LIST: Final = 4


def request_name(octets: bytes) -> str:
    """Return the name of a request of S7comm, for an SZL with id and index; safe to show."""
    pdu = parse_pdu(octets)
    name = subject(Exchange(S7, octets, b""))
    szl = _szl(pdu)
    return f"{name}, index 0x{szl[1]:04x}" if szl is not None and szl[1] else name


def nearest(request: Pdu, recorded: Iterable[bytes]) -> str:
    """Return the end of a sentence: `` (nearest recorded: …)``, empty if nothing of the kind was recorded."""
    ranked: dict[str, tuple[int, ...]] = {}
    for octets in _few(recorded):
        rosctr, function_name, items, szl, name = _known(octets)
        if rosctr != request.rosctr or function_name != request.function_name:
            continue
        if request.function in {READ_VAR, WRITE_VAR} and request.parameters.items:
            _rank_items(ranked, request.parameters.items, items)
        else:
            ranked.setdefault(name, _distance(_szl(request), szl))
    return _ranked_text(ranked)


def nearest_plus(request: PlusPdu, recorded: Iterable[bytes]) -> str:
    """Return the same for a request of S7comm-plus: recorded requests of its function with the most in common."""
    wanted = set(map(repr, plus_subject(request.octets)))
    ranked: dict[str, tuple[int, ...]] = {}
    for octets in _few(recorded):
        function, about, name = _known_plus(octets)
        if function == request.function:
            ranked.setdefault(name, (-len(wanted & about),))
    return _ranked_text(ranked)


# Cached: recorded requests do not change, and a client that polls repeats its requests.
@lru_cache(_MOST)
def _known(octets: bytes) -> tuple[int, str, Sequence[Item], tuple[int, int] | None, str]:
    """Return ROSCTR, function, items, list and name of a recorded request."""
    pdu = parse_pdu(octets)
    return int(pdu.rosctr), pdu.function_name, pdu.parameters.items, _szl(pdu), request_name(octets)


@lru_cache(_MOST)
def _known_plus(octets: bytes) -> tuple[int, frozenset[str], str]:
    """Return function, objects and name of a recorded request of S7comm-plus."""
    about = frozenset(map(repr, plus_subject(octets)))
    return parse_plus(octets).function, about, subject(Exchange(PLUS, octets, b""))


def _few(recorded: Iterable[bytes]) -> list[bytes]:
    """Return the first recorded requests, each once regardless of its reference."""
    few: dict[bytes, bytes] = {}
    for octets in recorded:
        few.setdefault(octets[:4] + octets[6:], octets)
        if len(few) >= _MOST:
            break
    return list(few.values())


def _rank_items(ranked: dict[str, tuple[int, ...]], wanted: Sequence[Item], there: Sequence[Item]) -> None:
    for item in there:
        if not item.octets:
            continue
        distances = [
            (int(item.area != one.area), int(item.db != one.db), abs(int(item.start_bit) - int(one.start_bit)))
            for one in wanted
        ]
        label = shortened(printable(item.label), _LONG)
        ranked[label] = min([*distances, *([ranked[label]] if label in ranked else [])])


def _szl(pdu: Pdu) -> tuple[int, int] | None:
    """Return id and index of the list that a request reads, None if it reads none."""
    head = pdu.parameters.userdata
    if pdu.rosctr != USERDATA or head is None or head.group != GROUP_CPU or head.subfunction != READ_SZL:
        return None
    octets = bytes(pdu.data[DATA_HEAD.size : DATA_HEAD.size + _LIST])
    return (int.from_bytes(octets[:2], "big"), int.from_bytes(octets[2:], "big")) if len(octets) == _LIST else None


def _distance(one: tuple[int, int] | None, other: tuple[int, int] | None) -> tuple[int, ...]:
    if one is None or other is None:
        return (0,)
    # The low byte identifies the list; the high one, which extract of it.
    return int(one[0] & 0xFF != other[0] & 0xFF), abs(one[0] - other[0]), abs(one[1] - other[1])


def _ranked_text(ranked: dict[str, tuple[int, ...]]) -> str:
    nearest = sorted(ranked, key=lambda name: ranked[name])[:_NAMED]
    return f" (nearest recorded: {'; '.join(nearest)})" if nearest else ""
