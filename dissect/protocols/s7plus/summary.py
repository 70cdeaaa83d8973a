"""Short texts about a PDU: addresses with values, objects by class and name, and what is called, deleted or refused.

Text from the wire is not escaped.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dissect.protocols.s7plus.alarms import ALARM, alarm_text
from dissect.protocols.s7plus.contents import Contents, VariableAddress, known_address
from dissect.protocols.s7plus.ids import NEW_OBJECT, short_name
from dissect.protocols.s7plus.message import PlusPdu
from dissect.protocols.s7plus.objects import PlusObject
from dissect.protocols.s7plus.pieces import return_note
from dissect.protocols.s7plus.session import NAME, REFERENCE_LIST, parse_reference_list
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    DELETE_OBJECT,
    EXPLORE,
    GET_LINK,
    GET_MULTI_VARIABLES,
    INVOKE,
    NOTIFICATION,
    REQUEST,
    SET_MULTI_VARIABLES,
    refuses,
)
from dissect.protocols.s7plus.value_showing import in_line
from dissect.protocols.s7plus.values import Value
from dissect.wire.text import count

#: Maximum number of names in a text; the others are counted.
_NAMED: Final = 8


def summary(pdu: PlusPdu, found: Contents) -> list[str]:
    """Return a few texts about a PDU; none if its head is sufficient."""
    if pdu.opcode == NOTIFICATION:
        said = _items(found)
        said += [f"{reference}: refused" for reference, _ in found.refusals[:_NAMED]]
        said += _objects(found.objects)
        return _some(said, found.item_count + len(found.refusals) + len(found.objects))
    if pdu.opcode == REQUEST:
        return _asked(pdu, found)
    said = _items(found)
    said += [f"{number}: {return_note(value)}" for number, value in found.refusals[:_NAMED]]
    count = found.item_count + len(found.refusals)
    if found.value is not None:
        said.append(in_line(found.value, 0))
        count += 1
    # The ids in a refusal belong to objects that were not created.
    if pdu.function in {CREATE_OBJECT, GET_LINK} and not refuses(pdu.return_code):
        said += [short_name(id_) for id_ in found.ids[:_NAMED]]
        count += len(found.ids)
    objects = found.objects or found.begun
    return _some(said + _objects(objects), count + len(objects))


def _items(found: Contents) -> list[str]:
    return [f"{number}: {in_line(value, 0)}" for number, value in found.items[:_NAMED]]


def _objects(objects: list[PlusObject]) -> list[str]:
    return [object_text(one) for one in objects[:_NAMED]]


def _asked(pdu: PlusPdu, found: Contents) -> list[str]:
    function = pdu.function
    if function in {GET_MULTI_VARIABLES, SET_MULTI_VARIABLES}:
        labels = [address.label for address in found.addresses[:_NAMED]]
        if found.items:
            values = dict(found.items)
            labels = [
                f"{label}{f' = {_written(values[number], found.addresses[number - 1])}' if number in values else ''}"
                for number, label in enumerate(labels, 1)
            ]
        return _some(labels, len(found.addresses))
    if found.object_id < 0:
        return _some(_objects(found.objects), len(found.objects))
    if function == CREATE_OBJECT:
        return _some([f"in {short_name(found.object_id)}", *_objects(found.objects)], 1 + len(found.objects))
    if function == DELETE_OBJECT or function == EXPLORE:
        return [short_name(found.object_id)]
    if function == INVOKE:
        return [short_name(found.method)]
    address = single_address(found)
    if address is None:
        return _some(_objects(found.objects), len(found.objects))
    written = f" = {_written(found.value, address)}" if found.value is not None else ""
    streamed = sum([end - begin for begin, end in found.pieces])
    return [f"{address.label}{written}{f', {streamed} bytes streamed' if streamed else ''}"]


def _written(value: Value, address: VariableAddress) -> str:
    id_ = address.lids[-1] if address.lids else address.sub_area
    listed = references_text(value, _label) if id_ == REFERENCE_LIST else ""
    return listed or in_line(value, id_)


def _label(address: VariableAddress) -> str:
    return address.label


def references_text(value: Value, called: Callable[[VariableAddress], str]) -> str:
    """Return what a subscription gets or loses by a new reference list; empty for any other value.

    ``called`` returns the name of an address.
    """
    content = value.content
    if not isinstance(content, list):
        return ""
    new, gone, added = parse_reference_list([number for number in content if isinstance(number, int)])
    labels = [called(address) for _, address in added[:_NAMED]]
    more = f" and {len(added) - _NAMED} more" if len(added) > _NAMED else ""
    said = [f"{'new list: ' if new else 'added: '}{', '.join(labels)}{more}"] if added else []
    return "; ".join(said + ([f"removed: {count(len(gone), 'reference')}"] if gone else []))


def single_address(found: Contents) -> VariableAddress | None:
    """Return the address in a request about one attribute of one object; None for other requests."""
    if found.object_id < 0 or not found.ids or found.addresses:
        return None
    return known_address(0, found.object_id, found.ids[0], found.ids[1:])


def object_text(found: PlusObject) -> str:
    """Return class, id (if it already has one) and name of an object; for an alarm, the event."""
    if found.class_id == ALARM:
        return alarm_text(found)
    name = found.text(NAME)
    known = {short_name(found.class_id): None}  # some roots have the name of their class
    if found.rid != NEW_OBJECT:
        known[short_name(found.rid)] = None
    return f"{' '.join(known)}{f' {name!r}' if name else ''}"


def _some(said: list[str], count: int) -> list[str]:
    """Return the first of ``count`` texts, and the number of the others; ``said`` has at least the first ones."""
    return said if count <= _NAMED else [*said[:_NAMED], f"and {count - _NAMED} more"]
