"""Wireshark's side of the comparison: the JSON tree of one packet as facts.

With ``-T json -x`` tshark adds ``NAME_raw`` to every field ``NAME``: its octets, position, size, mask and type. A field without
it was not read from the wire but computed (a class 0 DT gets the reference of its connection) and is left out.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from dissect.testing.oracle import facts
from dissect.testing.oracle.facts import BODY_NAMES, NAMES, OCTETS, FieldPlace, LocatedValue, Record, Value

Tree = dict[str, Any]

#: Protocols whose trees are needed in full.
PROTOCOLS: Final = ("frame", "tpkt", "cotp", "s7comm")
#: Fields of the packet itself that are read.
OF_FRAME: Final = ("frame.number", "frame.protocols", "frame.len", "frame.cap_len")
_USERDATA: Final = 7
#: If a field is beyond the end of its packet, tshark has a message instead of its octets ("field length invalid!").
_HEX_DIGITS: Final = frozenset("0123456789abcdefABCDEF")
#: Wireshark's type number for a field that is only the heading of a tree.
_HEADING: Final = 0
#: Wireshark up to 4.0 shows the first five fields of a userdata head under its own names, three of them as one number.
_OLD_NAMES: Final = {
    "s7comm.param.userdata.head": ("s7comm.param.func", "s7comm.param.itemcount", "s7comm.param.item.varspec"),
    "s7comm.param.userdata.length": ("s7comm.param.item.varspec_length",),
    "s7comm.param.userdata.reqres1": ("s7comm.param.item.syntaxid",),
}
#: Wireshark's alternative names for the same position in a record, by extract of the list.
_ALIASES: Final = {
    f"s7comm.szl.0091.0000.res1_{extract}": "s7comm.szl.0091.0000.res1" for extract in ("0c_4c_4d", "0d")
}
#: Precedes each piece of a BSEND and is not joined; the last of these fields is found in no other message.
_R_ID: Final = "s7comm.pbc.req.bsend.r_id"
_OF_PIECES: Final = frozenset(
    (*sorted(NAMES[facts.IN_ITEM] - {"s7comm.param.item.length"}), "s7comm.pbc.bsend.unknown", _R_ID)
)
#: Fields that are needed from trees that are not needed in full.
WANTED: Final[dict[str, frozenset[str]]] = {
    "tpkt": NAMES[facts.IN_TPKT],
    "cotp": NAMES[facts.IN_TPDU] | NAMES[facts.IN_PARAMETER],
}
#: Trees that are needed in full.
WHOLE: Final = frozenset(("s7comm",))
_BOOLEANS: Final = {"true": 1, "false": 0}


class Frame:
    """Wireshark's results for one packet: TPDUs, PDUs, ``protocols`` by its names; ``cut``: it was captured incompletely."""

    __slots__ = ("cut", "number", "pdus", "protocols", "tpdus")

    def __init__(self, layers: Tree) -> None:
        frame = layers["frame"]
        self.number = int(frame["frame.number"])
        self.protocols = frozenset(frame["frame.protocols"].split(":"))
        self.cut = int(frame["frame.cap_len"]) < int(frame["frame.len"])
        self.tpdus = _tpdus(self.number, layers)
        self.pdus = [_pdu(self.number, tree, raw) for tree, raw in _layers(layers, "s7comm")]


def listed(value: Any) -> list[Any]:
    """Return a value as a list: tshark gives one only if a name occurs more than once."""
    if value is None:
        return []
    return value if isinstance(value, list) else [value]


def _raws(tree: Tree, name: str) -> list[list[Any]]:
    """Return the ``_raw`` entries of a name: [octets, position, size, mask, type] each."""
    raw = tree.get(name + "_raw")
    if raw is None:
        return []
    return [raw] if isinstance(raw[0], str) else raw


def _layers(tree: Tree, name: str) -> list[tuple[Tree, list[Any]]]:
    """Return every tree called ``name`` with its raw entry."""
    return [
        (layer, raw)
        for layer, raw in zip(listed(tree.get(name)), _raws(tree, name), strict=False)
        if isinstance(layer, dict)
    ]


def _number(text: str) -> int:
    lowered = text.lower()
    return _BOOLEANS[lowered] if lowered in _BOOLEANS else int(lowered, 0)


def _value(name: str, text: str) -> Value:
    return bytes.fromhex(text.replace(":", "")) if name in OCTETS else _number(text)


def _take(
    facts_: dict[FieldPlace, LocatedValue], part: str, number: int, tree: Tree, start: int, which: int = 0
) -> None:
    """Add the compared fields that are directly in ``tree``; positions count from ``start``.

    If a field occurs more than once, the first one counts, or the one at index ``which``.
    """
    for name in NAMES[part]:
        raws = _raws(tree, name)
        if raws:
            facts_[FieldPlace(part, number, name)] = LocatedValue(
                _value(name, listed(tree[name])[which]), raws[which][1] - start
            )


def _take_old_head(facts_: dict[FieldPlace, LocatedValue], tree: Tree, start: int) -> None:
    """Add the fields of a userdata head that old versions give different names."""
    for old, names in _OLD_NAMES.items():
        for raw in _raws(tree, old)[:1]:
            for index, octet in enumerate(bytes.fromhex(raw[0])):
                facts_[FieldPlace(facts.IN_PARAMETERS, 0, names[index])] = LocatedValue(octet, raw[1] + index - start)


def _tpdus(number: int, layers: Tree) -> list[Record]:
    cotps = _layers(layers, "cotp")
    records = []
    for tree, raw in _layers(layers, "tpkt"):
        if "tpkt.version" not in tree:
            continue  # a "continuation": octets in which it could not find a TPKT
        facts_: dict[FieldPlace, LocatedValue] = {}
        octets, start = bytes.fromhex(raw[0]), raw[1]
        _take(facts_, facts.IN_TPKT, 0, tree, start)
        if cotps and cotps[0][1][1] == start + len(octets):
            cotp, its_raw = cotps.pop(0)
            octets += bytes.fromhex(its_raw[0])
            start = its_raw[1]
            # The last value of a repeated parameter counts (X.224 13.2.3).
            _take(facts_, facts.IN_TPDU, 0, cotp, start, -1)
            _parameters(facts_, cotp, start)
        records.append(Record(facts.TPDU, number, octets, facts_))
    return records


def _parameters(facts_: dict[FieldPlace, LocatedValue], cotp: Tree, start: int) -> None:
    part = facts.IN_PARAMETER
    for name in NAMES[part]:
        for number, (text, raw) in enumerate(zip(listed(cotp.get(name)), _raws(cotp, name), strict=False), 1):
            facts_[FieldPlace(part, number, name)] = LocatedValue(_number(text), raw[1] - start)


def _pdu(number: int, tree: Tree, raw: list[Any]) -> Record:
    facts_: dict[FieldPlace, LocatedValue] = {}
    start = raw[1]
    for header, _ in _layers(tree, "s7comm.header"):
        _take(facts_, facts.IN_HEADER, 0, header, start)
    for parameters, _ in _layers(tree, "s7comm.param"):
        _take(facts_, facts.IN_PARAMETERS, 0, parameters, start)
        _take_old_head(facts_, parameters, start)
        for index, (item, _) in enumerate(_layers(parameters, "s7comm.param.item"), 1):
            _take(facts_, facts.IN_ITEM, index, item, start)
    record = Record(facts.PDU, number, bytes.fromhex(raw[0]), facts_)
    userdata = record.value(facts.IN_HEADER, "s7comm.header.rosctr") == _USERDATA
    for joined in _raws(tree, "s7comm.fragments")[:1]:
        record.joined = bytes.fromhex(joined[0])
    for data, _ in _layers(tree, "s7comm.data")[:1]:
        if userdata:
            _take(facts_, facts.IN_DATA, 0, data, start)
        else:
            for index, (item, _) in enumerate(_layers(data, "s7comm.data.item"), 1):
                _take(facts_, facts.IN_DATA_ITEM, index, item, start)
    _take_body(record, tree, start)
    return record


def _take_body(record: Record, tree: Tree, start: int) -> None:
    """Add the contents of the trees of the parameters and the data, except for fields that were added already."""
    taken = {(fact.offset, place.name) for place, fact in record.facts.items()}
    for name in ("s7comm.param", "s7comm.data"):
        joined = bool(record.joined) and name == "s7comm.data"
        others: list[tuple[str, int, int]] = []
        carried: list[tuple[int, int]] = []
        for block, _ in _layers(tree, name)[:1]:
            piece = f"{_R_ID}_raw" in block
            for shown, (octets, at, size, mask, type_) in _fields(block):
                if not size or not _HEX_DIGITS.issuperset(octets):
                    continue
                field = _ALIASES.get(shown, shown)
                inside = joined and not (piece and field in _OF_PIECES)
                if field not in BODY_NAMES:
                    if type_ != _HEADING and (at - start, field) not in taken:
                        others.append((field, at, at + size))
                    continue
                carried.append((at, at + size))
                if (at - start, field) not in taken:
                    value = int(octets, 16) if mask else bytes.fromhex(octets)
                    place = (
                        FieldPlace(facts.IN_JOINED, at, field)
                        if inside
                        else FieldPlace(facts.IN_BODY, at - start, field)
                    )
                    record.facts[place] = LocatedValue(value, place.number)
        for field, at, end in others:
            record.other[field] += 1
            record.again[field] += any(begin <= at and end <= last for begin, last in carried)


def _fields(tree: Tree) -> Iterator[tuple[str, list[Any]]]:
    """Yield name and raw entry of every field in a tree and in the trees inside it."""
    for name, value in tree.items():
        if name.endswith("_raw"):
            for raw in _raws(tree, name[:-4]):
                yield name[:-4], raw
        elif isinstance(value, dict):
            yield from _fields(value)
        elif isinstance(value, list):
            for one in value:
                if isinstance(one, dict):
                    yield from _fields(one)
