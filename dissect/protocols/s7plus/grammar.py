"""The elements in the body of each function, one row each; they are defined only here (docs/s7plus.md).

Two interpreters read the rows: `dissect.protocols.s7plus.check` walks over a body without making objects of it, and finds out
whether it is sound; `dissect.protocols.s7plus.bodies` makes parts, values and objects. Only they know the structure of an
element.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.tables import (
    BEGIN_SEQUENCE,
    CREATE_OBJECT,
    DELETE_OBJECT,
    END_SEQUENCE,
    EXPLORE,
    GET_LINK,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    GET_VARIABLE,
    INVOKE,
    OBJECTS_ITEM,
    PLAIN_VALUE_ITEM,
    REFUSED_ITEM,
    REFUSED_ITEM_3,
    SET_MULTI_VARIABLES,
    SET_VAR_SUBSTREAMED,
    SET_VARIABLE,
    UNKNOWN_ITEM,
    VALUE_ITEM,
    VALUE_ITEM_VLQ,
)

# Elements. `END` ends a row; the end of the PDU follows (`dissect.protocols.s7plus.ending`).
END: Final = 0
ADDRESSES: Final = 1  # the addresses of a read of several items, or an object with ids of its attributes
QUALIFIER: Final = 2
ITEMS: Final = 3  # numbers with values, up to the number 0
REFUSALS: Final = 4  # numbers with return values, up to the number 0
OBJECT: Final = 5  # the id of an object, in four octets
IDS: Final = 6  # a count, and that many ids of attributes
VALUE: Final = 7
TARGETS: Final = 8  # addresses as above, and in `WRITTEN` their numbers with values
WRITTEN: Final = 9
PATH: Final = 10  # a value: the ids of one attribute
RESERVED_1: Final = 11
RESERVED_2: Final = 12
RESERVED_4: Final = 13
OBJECTS: Final = 14
OBJECTS_V1: Final = 15  # objects, in version 1 only
DETAILS: Final = 16  # objects, if the return value says so
INTEGRITY_V3: Final = 17  # an integrity id, in version 3 only
INTEGRITY_EARLY: Final = 18  # the same, and in version 2 unless an object follows
MADE: Final = 19  # a count in one octet, and that many ids of objects
FROM: Final = 20  # the beginning of Explore: an object, an id, three octets
GROUPS: Final = 21  # its filters and the wanted attributes
LINK: Final = 22  # an object, a relation, two octets
LINKED: Final = 23  # a count in one octet, and that many objects
SEQUENCE: Final = 24  # type, kind, and, depending on the kind, an object or objects
BEGUN: Final = 25  # kind and object; nothing in version 1
CALL: Final = 26  # a session and a method
RETURN: Final = 27  # a further return value
RETURN_OR_ITEM: Final = 28  # another one, unless the item with the number 1 follows
STREAM: Final = 29  # a value, and in further frames pieces of a stream

#: Function, body of the request, body of the response after its return value.
_ROWS: Final[tuple[tuple[int, tuple[int, ...], tuple[int, ...]], ...]] = (
    (EXPLORE, (FROM, GROUPS), (OBJECT, INTEGRITY_V3, OBJECTS)),
    (CREATE_OBJECT, (OBJECT, VALUE, RESERVED_4, INTEGRITY_EARLY, OBJECTS), (MADE, OBJECTS_V1)),
    (DELETE_OBJECT, (OBJECT, RESERVED_1, QUALIFIER), (OBJECT, DETAILS)),
    (SET_VARIABLE, (OBJECT, IDS, VALUE, QUALIFIER, RESERVED_1), ()),
    (GET_VARIABLE, (OBJECT, IDS, QUALIFIER), (VALUE,)),
    (GET_LINK, (LINK,), (LINKED,)),
    (SET_MULTI_VARIABLES, (TARGETS, WRITTEN, RESERVED_1, QUALIFIER), (REFUSALS,)),
    (GET_MULTI_VARIABLES, (ADDRESSES, QUALIFIER), (ITEMS, REFUSALS)),
    (BEGIN_SEQUENCE, (SEQUENCE,), (BEGUN,)),
    (END_SEQUENCE, (RESERVED_2,), ()),
    (INVOKE, (CALL, ITEMS, RESERVED_1), (RETURN, RETURN, RETURN_OR_ITEM, ITEMS, RESERVED_1)),
    (SET_VAR_SUBSTREAMED, (OBJECT, PATH, QUALIFIER, RESERVED_2, STREAM), ()),
    (GET_VAR_SUBSTREAMED, (OBJECT, PATH, QUALIFIER, RESERVED_2), (RESERVED_1, VALUE)),
)

#: The functions whose bodies are known.
KNOWN: Final[frozenset[int]] = frozenset([row[0] for row in _ROWS])

#: The forms of the items of a notification.
REFERENCED: Final = 1  # a reference of four octets, and a value
REFERENCED_VLQ: Final = 2  # the same with a reference of variable size
REFUSED: Final = 3  # a reference of four octets
UNNAMED: Final = 4  # four octets
NOTIFIED_OBJECTS: Final = 5
NOTIFIED_VALUE: Final = 6

_FORMS: Final = {
    VALUE_ITEM: REFERENCED,
    VALUE_ITEM_VLQ: REFERENCED_VLQ,
    REFUSED_ITEM: REFUSED,
    REFUSED_ITEM_3: REFUSED,
    UNKNOWN_ITEM: UNNAMED,
    OBJECTS_ITEM: NOTIFIED_OBJECTS,
    PLAIN_VALUE_ITEM: NOTIFIED_VALUE,
}
#: By the first octet of an item: its form, 0 for none.
FORMS: Final[bytes] = bytes([_FORMS.get(kind, 0) for kind in range(256)])

#: The bit of a return value that means that `DETAILS` are present.
DETAILS_BIT: Final = 62

#: The elements of all rows, each row followed by `END`; the first row is that of an unknown body.
ELEMENTS: Final[bytes] = bytes([END, *[one for row in _ROWS for body in row[1:] for one in (*body, END)]])
#: The lowest function with a row; and, for each function from there on, where its elements begin, 0 if it has no row.
FIRST: Final[int] = min([row[0] for row in _ROWS])


def _begins(which: int) -> bytes:
    """Return where the elements of requests (1) or responses (2) begin, by function."""
    found = bytearray(256)
    at = 1
    for row in _ROWS:
        found[row[0] - FIRST] = at if which == 1 else at + len(row[1]) + 1
        at += len(row[1]) + len(row[2]) + 2
    return bytes(found)


REQUESTS: Final[bytes] = _begins(1)
RESPONSES: Final[bytes] = _begins(2)


def body_of(function: int, request: bool) -> int:
    """Return where the elements of a body begin in `ELEMENTS`; 0 if no capture and no source describes it."""
    begins = REQUESTS if request else RESPONSES
    return begins[function - FIRST] if FIRST <= function < FIRST + len(begins) else 0


def ending_with_objects(request: bool) -> frozenset[int]:
    """Return the functions whose body may end with objects, also in version 3, so that only the next octets show its end."""
    bodies = [(row[0], row[1] if request else row[2]) for row in _ROWS]
    return frozenset([function for function, body in bodies if body and body[-1] in {OBJECTS, DETAILS, SEQUENCE}])
