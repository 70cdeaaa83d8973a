"""The fixed parts of S7comm-plus as layouts (reference section 1.4, docs/s7plus.md).

tshark has no dissector for this protocol, so the fields have no Wireshark names.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.id_tables import IDS, MEMBERS
from dissect.protocols.s7plus.ids import id_name
from dissect.protocols.s7plus.program_tables import DATATYPES, SECTIONS
from dissect.protocols.s7plus.tables import FUNCTIONS, NOTIFIED, OPCODES, TAGS, VARIABLE_KINDS, VERSIONS
from dissect.protocols.s7plus.value_tables import VALUE_FLAGS, VALUE_TYPES
from dissect.wire.layout import COUNTS_REST, HOLDS_REFERENCE, HOLDS_VALUE, REST, Field, Layout
from dissect.wire.varint import VLQ, VLQ64

_SOURCE: Final = "docs/s7plus.md"


def little_means(octets: bytes) -> str | None:
    """Return a little-endian number as text."""
    return str(int.from_bytes(octets, "little"))


def little_hex_means(octets: bytes) -> str | None:
    """Return a little-endian checksum as text."""
    return f"0x{int.from_bytes(octets, 'little'):08x}"


def text_means(octets: bytes) -> str | None:
    """Return a zero-terminated name in UTF-8."""
    return octets.rstrip(b"\0").decode("utf-8", "replace")


_BEGINNING: Final = [
    Field("protocol_id", 1, "Always 0x72."),
    Field("version", 1, "Version, or kind of a PDU without opcode.", codes=VERSIONS),
]

#: Header of every frame except the keep-alive; with length 0 it is the trailer that ends a PDU.
HEADER: Final = Layout(
    "S7comm-plus header", "reference section 1.4", [*_BEGINNING, Field("length", 2, "Bytes after the header.")]
)

#: The keep-alive, which is only a header.
KEEP_ALIVE: Final = Layout(
    "S7comm-plus keep-alive",
    _SOURCE,
    [*_BEGINNING, Field("number", 1, "Counts keep-alives."), Field("reserved", 1, "0.")],
)

#: Precedes the data of every V3 frame. A digest of the stated length follows.
INTEGRITY: Final = Layout(
    "S7comm-plus integrity part", "reference section 1.4", [Field("digest_length", 1, "Bytes of the digest, 32.")]
)

_HEAD: Final = [
    Field("opcode", 1, "Request or response.", codes=OPCODES),
    Field("reserved_1", 2, "0."),
    Field("function", 2, "What is requested.", codes=FUNCTIONS),
    Field("reserved_2", 2, "0."),
    Field("sequence", 2, "Sequence number, echoed by the response.", holds=HOLDS_REFERENCE),
]

REQUEST: Final[Layout] = Layout(
    "S7comm-plus request",
    _SOURCE,
    [
        *_HEAD,
        Field("session_id", 4, "The session, as CreateObject answered it; responses have none.", holds=HOLDS_REFERENCE),
        Field("transport_flags", 1, "Bit 6: no response is wanted."),
    ],
)

RESPONSE: Final[Layout] = Layout(
    "S7comm-plus response", _SOURCE, [*_HEAD, Field("transport_flags", 1, "Flags, 0x34 or 0x36 in captures.")]
)

#: Notifications of V2 and V3; a sequence number of variable size follows.
NOTIFICATION: Final[Layout] = Layout(
    "S7comm-plus notification",
    _SOURCE,
    [
        Field("opcode", 1, "0x33.", codes=OPCODES),
        Field("subscription_id", 4, "The subscription that sends it."),
        Field("unknown_1", 2, "0x0400 in captures."),
        Field("unknown_2", 2, "0 in captures."),
        Field("unknown_3", 2, "0 in captures."),
        Field(
            "credit_tick",
            1,
            "Counts against the credit of the client; of ids below 0x70000000 the sequence.",
            holds=HOLDS_REFERENCE,
        ),
    ],
)

#: Notifications of V1, which only old S7-1200 use (one source); all octets after the opcode are contents.
NOTIFICATION_V1: Final = Layout("S7comm-plus notification", _SOURCE, [Field("opcode", 1, "0x33.", codes=OPCODES)])

EVENT: Final = Layout(
    "S7comm-plus system event",
    _SOURCE,
    [
        Field("reserved_1", 4, "0."),
        Field("confirmed_octets", 4, "Bytes received until now."),
        Field("reserved_2", 4, "0."),
        Field("reserved_3", 4, "0."),
    ],
)


# ---- contents -------------------------------------------------------------------------------------------------------

_ID: Final = Field("id", VLQ, "What it is.", codes=IDS)
_MEMBER_ID: Final = Field("id", VLQ, "What it is.", codes=MEMBERS)
_VALUE: Final = [
    Field("flags", 1, "Scalar, array, sparse array.", codes=VALUE_FLAGS),
    Field("type", 1, "Type of the value, or of its elements.", codes=VALUE_TYPES),
    Field("content", REST, "What flags and type make it.", holds=HOLDS_VALUE),
]

#: A value with nothing before it.
VALUE: Final = Layout("value", _SOURCE, _VALUE)
#: A member of a structure or of a list. If it is a structure itself, ``content`` ends before its own members.
MEMBER: Final = Layout("member", _SOURCE, [_MEMBER_ID, *_VALUE])
#: The end of a list of members, items, keys or errors.
LIST_END: Final = Layout("end of list", _SOURCE, [Field("end", 1, "0.")])
#: An element of a sparse array of structures.
ROW: Final = Layout(
    "element", _SOURCE, [Field("key", VLQ, "Its key."), Field("structure", 4, "Id of the structure.", says=id_name)]
)

_PACKED: Final = [
    Field("interface_time", 8, "When the interface of the type was changed last."),
    Field("transport_flags", VLQ, "Flag 0x400: the count stands there twice."),
    Field("length", VLQ, "Bytes of the structure."),
]
_PACKED_CONTENT: Final = Field("octets", REST, "The structure as the program holds it.")
#: A structure of the program.
PACKED: Final = Layout("packed structure", _SOURCE, [*_PACKED, _PACKED_CONTENT])
PACKED_TWICE: Final = Layout(
    "packed structure", _SOURCE, [*_PACKED, Field("length_again", VLQ, "The length that holds."), _PACKED_CONTENT]
)

_TAG: Final = Field("tag", 1, "What kind of element follows.", codes=TAGS)
_OBJECT: Final = [
    _TAG,
    Field("rid", 4, "Id of the object.", says=id_name),
    Field("class", VLQ, "Its class.", codes=IDS),
    Field("class_flags", VLQ, "Flags of the class."),
    Field("attribute", VLQ, "The attribute by which its parent holds it, 0 in captures.", codes=IDS),
]
OBJECT: Final = Layout("object", _SOURCE, _OBJECT)
OBJECT_HELD: Final = Layout(
    "object", _SOURCE, [*_OBJECT, Field("more", VLQ, "There where the attribute is not 0; meaning unknown.")]
)
OBJECT_END: Final = Layout("end of object", _SOURCE, [_TAG])
ATTRIBUTE: Final = Layout("attribute", _SOURCE, [_TAG, _ID, *_VALUE])
RELATION: Final = Layout("relation", _SOURCE, [_TAG, _ID, Field("rid", 4, "The other object.", says=id_name)])

#: Lists of variables and of names begin with a tag; then come blocks with a length, the last one with length 0.
VARIABLE_LIST: Final = Layout("list of variables", _SOURCE, [_TAG])
NAME_LIST: Final = Layout("list of names", _SOURCE, [_TAG])
LIST_BLOCK: Final = Layout("block", _SOURCE, [Field("length", 2, "Bytes of the block, 0 behind the last.")])
LIST_ID: Final = Layout("list head", _SOURCE, [Field("first", 4, "0x80000002 in captures, the low byte first.")])
#: LID, CRC and the four-byte numbers are little-endian.
VARIABLE: Final = Layout(
    "variable",
    _SOURCE,
    [
        Field("lid", 4, "Id of the variable within its block, low byte first.", means=little_means),
        Field("crc", 4, "Checksum of its symbol, low byte first.", means=little_hex_means),
        Field("datatype", 1, "Type in the program.", codes=DATATYPES),
        Field("kind", 2, "What the numbers at the end are.", codes=VARIABLE_KINDS, bits=(0xF000, 12)),
        Field("hmi_visible", 2, "Panels may show it.", bits=(0x0800, 11), shares=True),
        Field("hmi_read_only", 2, "Panels may not write it.", bits=(0x0400, 10), shares=True),
        Field("hmi_accessible", 2, "Panels may reach it.", bits=(0x0200, 9), shares=True),
        Field("optimised", 2, "It stands in the optimised part.", bits=(0x0080, 7), shares=True),
        Field("section", 2, "The section that declares it.", codes=SECTIONS, bits=(0x0070, 4), shares=True),
        Field("bit", 2, "Number of its bit.", bits=(0x0007, 0), shares=True),
        Field("bit_offsets", 1, "Retain flag, and numbers of bits in either layout."),
        Field("offset_1", 2, "Offset or length, low byte first.", means=little_means),
        Field("offset_2", 2, "Offset, low byte first.", means=little_means),
        Field("numbers", REST, "Bounds, offsets, ids, as the kind says; four bytes each, the low one first."),
    ],
)
VARIABLE_NAME: Final = Layout(
    "name",
    _SOURCE,
    [
        Field("length", 1, "Bytes of the name, its end not counted."),
        Field("name", REST, "The name and a 0.", means=text_means),
    ],
)
#: A variable of an S7-1200 with firmware 2: its name, its description, and the tag that ends it.
TAG_DESCRIPTION: Final = Layout(
    "tag description",
    _SOURCE,
    [
        _TAG,
        Field("kind", 1, "What stands at the end."),
        Field("name_length", VLQ, "Bytes of the name.", counts=COUNTS_REST),
        Field("name", REST, "The name.", means=text_means),
    ],
)
TAG_VARIABLE: Final = Layout(
    "tag",
    _SOURCE,
    [
        Field("one", 1, "1 in captures."),
        Field("type", 1, "Type of its value.", codes=VALUE_TYPES),
        Field("datatype", VLQ, "Type in the program.", codes=DATATYPES),
        Field("description_flags", 4, "Not known."),
        Field("lid", VLQ, "Id of the variable within its block.", decimal=True),
        Field("length", VLQ, "Length of a string, id of a structure."),
        Field("numbers", REST, "Accessibility and section, offsets, bounds, as the kind says."),
    ],
)
TAG_DESCRIPTION_END: Final = Layout("end of tag description", _SOURCE, [_TAG])

# Bodies.
OBJECT_ID: Final = Layout("object id", _SOURCE, [Field("rid", 4, "The object.", says=id_name)])
OBJECT_ID_VLQ: Final = Layout("object id", _SOURCE, [Field("rid", VLQ, "The object.", codes=IDS)])
RETURN_VALUE: Final = Layout("return value", _SOURCE, [Field("return_value", VLQ64, "64 bits: see the reference.")])
COUNT: Final = Layout("count", _SOURCE, [Field("count", VLQ, "How many follow.")])
COUNT_OCTET: Final = Layout("count", _SOURCE, [Field("count", 1, "How many follow.")])
ITEM_COUNTS: Final = Layout(
    "items",
    _SOURCE,
    [
        Field("link", 4, "0, or the object whose attributes are meant.", says=id_name),
        Field("item_count", VLQ, "Items."),
        Field("field_count", VLQ, "Numbers that their addresses take in all."),
    ],
)
ADDRESS: Final = Layout(
    "address",
    _SOURCE,
    [
        Field("crc", VLQ, "Checksum of the symbol, 0 for none."),
        Field("area", VLQ, "The object or area: 80 I, 81 Q, 82 M, 83 C, 84 T, 0x8a0e0000 + N DB N."),
        Field("id_count", VLQ, "Numbers that follow."),
        Field("sub_area", VLQ, "The attribute that holds the variable.", codes=IDS),
        Field("lids", REST, "The way to the variable within it."),
    ],
)
ATTRIBUTE_ID: Final = Layout("attribute id", _SOURCE, [Field("id", VLQ, "The attribute.", codes=IDS)])
ITEM_VALUE: Final = Layout("item", _SOURCE, [Field("number", VLQ, "Number of the item, from 1."), *_VALUE])
ITEM_ERROR: Final = Layout(
    "item error",
    _SOURCE,
    [Field("number", VLQ, "Number of the item, from 1."), Field("return_value", VLQ64, "Why it was refused.")],
)
QUALIFIER: Final = Layout("qualifier", _SOURCE, [Field("id", 4, "1256.", says=id_name)])
RESERVED: Final = Layout("reserved", _SOURCE, [Field("octets", REST, "0 in captures; the meaning is not known.")])
EXPLORE_HEAD: Final = Layout(
    "explore",
    _SOURCE,
    [
        Field("rid", 4, "Where to begin.", says=id_name),
        Field("id", VLQ, "0 in captures.", codes=IDS),
        Field("children", 1, "1: the objects below as well."),
        Field("one", 1, "1 in captures."),
        Field("parents", 1, "1: the objects above as well."),
    ],
)
EXPLORE_GROUP: Final = Layout(
    "group", _SOURCE, [Field("filters", 1, "1: a filter follows."), Field("id_count", 1, "Attributes that follow.")]
)
EXPLORE_FILTER: Final = Layout(
    "filter",
    _SOURCE,
    [Field("type", 1, "0x17, a structure.", codes=VALUE_TYPES), Field("structure", 4, "Its id.", says=id_name)],
)
LINK_REQUEST: Final = Layout(
    "link",
    _SOURCE,
    [
        Field("rid", 4, "The object.", says=id_name),
        Field("id", VLQ, "The relation.", codes=IDS),
        Field("reserved", 2, "0."),
    ],
)
SEQUENCE_TYPE: Final = Layout("sequence", _SOURCE, [Field("type", 1, "Kind of the sequence.")])
SEQUENCE_KIND: Final = Layout("sequence kind", _SOURCE, [Field("kind", 2, "1: an object follows.")])
INVOKE_HEAD: Final = Layout(
    "call", _SOURCE, [Field("sub_session", 4, "0 in captures."), Field("method", 4, "The method.", says=id_name)]
)
PIECE: Final = Layout(
    "stream piece",
    _SOURCE,
    [Field("length", VLQ, "Bytes of the piece.", counts=COUNTS_REST), Field("octets", REST, "The piece.")],
)

# Notifications.
NOTIFICATION_HEAD: Final = Layout(
    "notification head",
    _SOURCE,
    [Field("sequence", VLQ, "Counts notifications."), Field("changes", 1, "Counts changes of the subscription.")],
)
#: The head of an S7-1200 with old firmware: its sequence number is where others have the credit.
NOTIFICATION_HEAD_SHORT: Final = Layout(
    "notification head", _SOURCE, [Field("changes", 1, "Counts changes of the subscription.")]
)
NOTIFICATION_HEAD_TIMED: Final = Layout(
    "notification head",
    _SOURCE,
    [
        Field("sequence", VLQ, "Counts notifications."),
        Field("time", 8, "Microseconds since 1970."),
        Field("changes", 1, "Counts changes of the subscription."),
    ],
)
_KIND: Final = Field("kind", 1, "What follows.", codes=NOTIFIED)
NOTIFIED_VALUE: Final = Layout(
    "notified value", _SOURCE, [_KIND, Field("reference", 4, "Number of the item."), *_VALUE]
)
NOTIFIED_VALUE_VLQ: Final = Layout(
    "notified value", _SOURCE, [_KIND, Field("reference", VLQ, "Number of the item."), *_VALUE]
)
NOTIFIED_PLAIN: Final = Layout("notified value", _SOURCE, [_KIND, *_VALUE])
NOTIFIED_REFUSAL: Final = Layout("refused item", _SOURCE, [_KIND, Field("reference", 4, "Number of the item.")])
NOTIFIED_KIND: Final = Layout("notified objects", _SOURCE, [_KIND])
SECOND_PART: Final = Layout(
    "second part",
    _SOURCE,
    [Field("object_id", 4, "What it belongs to.", says=id_name), Field("unknown", 2, "Not known.")],
)

# Ends.
INTEGRITY_ID: Final = Layout(
    "integrity id",
    _SOURCE,
    [Field("integrity_id", VLQ, "Of a response: that of its request plus the sequence number.")],
)
DIGEST: Final = Layout(
    "digest",
    _SOURCE,
    [Field("digest_length", 1, "Bytes of the digest, 32.", counts=COUNTS_REST), Field("digest", REST, "The digest.")],
)
FILL: Final = Layout("fill", _SOURCE, [Field("fill", REST, "0.")])

# System events with a value.
EVENT_VALUE: Final = Layout("event value", _SOURCE, [Field("octets", REST, "A value in fixed sizes.")])
