"""The parts of S7comm-plus contents that become Scapy classes (see `dissect.layers.part_tables`)."""

from __future__ import annotations

from typing import Any, Final

from scapy.fields import LEIntField, LEShortField, XLEIntField

from dissect.layers.part_row import Row
from dissect.layers.plus_counts import (
    address_numbers,
    block_behind,
    group_behind,
    ids_behind,
    items_behind,
    name_octets,
    packed_octets,
)
from dissect.layers.plus_fields import ContentField, TextField, little_numbers_field, numbers_field
from dissect.protocols.s7plus import layouts, tables
from dissect.protocols.s7plus.value_tables import STRUCT

_QUALIFIER: Final = 1256


def _value() -> dict[str, Any]:
    return {"content": ContentField()}


PLUS_SECTIONS: Final[dict[str, list[Row]]] = {
    "S7comm-plus: values and structures": [
        Row("S7Plus_Value", layouts.VALUE, "A value: flags, type, content.", replace=_value()),
        Row("S7Plus_Member", layouts.MEMBER, "A value with its id, in a structure or a list.", replace=_value()),
        Row("S7Plus_ListEnd", layouts.LIST_END, "End of members, items, errors, and the values of a notification."),
        Row("S7Plus_Row", layouts.ROW, "An element of a sparse array of structures; its members follow.", {"key": 1}),
        Row("S7Plus_Packed", layouts.PACKED, "A structure of the program, after the value with its id.", {"length": None}, computed={"length": packed_octets}),
        Row("S7Plus_PackedTwice", layouts.PACKED_TWICE, "The same with flag 0x400; it has its length twice.", {"transport_flags": 0x400, "length": None, "length_again": None}, computed={"length": packed_octets, "length_again": packed_octets}),
    ],
    "S7comm-plus: objects": [
        Row("S7Plus_Object", layouts.OBJECT, "An object; its content follows, then an `S7Plus_ObjectEnd`.", {"tag": tables.OBJECT_TAG}),
        Row("S7Plus_HeldObject", layouts.OBJECT_HELD, "The same where the attribute is named by which its parent holds it.", {"tag": tables.OBJECT_TAG}),
        Row("S7Plus_ObjectEnd", layouts.OBJECT_END, "The end of an object.", {"tag": tables.OBJECT_END_TAG}),
        Row("S7Plus_Attribute", layouts.ATTRIBUTE, "An attribute with its value; of a structure the members follow.", {"tag": tables.ATTRIBUTE_TAG}, replace=_value()),
        Row("S7Plus_Relation", layouts.RELATION, "A relation to another object.", {"tag": tables.RELATION_TAG}),
        Row("S7Plus_VariableList", layouts.VARIABLE_LIST, "A list of variables; blocks follow, the last without variables.", {"tag": tables.VARIABLES_TAG}),
        Row("S7Plus_NameList", layouts.NAME_LIST, "A list of their names; blocks follow, the last without names.", {"tag": tables.NAMES_TAG}),
        Row("S7Plus_Block", layouts.LIST_BLOCK, "A block of variables or names.", {"length": None}, counting=block_behind),
        Row("S7Plus_ListId", layouts.LIST_ID, "The beginning of the first block of variables.", {"first": 0x02000080}),
        Row("S7Plus_Variable", layouts.VARIABLE, "A variable; its kind decides how many numbers it has.", replace={"lid": LEIntField("lid", 0), "crc": XLEIntField("crc", 0), "offset_1": LEShortField("offset_1", 0), "offset_2": LEShortField("offset_2", 0), "numbers": little_numbers_field("numbers")}),
        Row("S7Plus_Name", layouts.VARIABLE_NAME, "The name of a variable.", {"length": None}, computed={"length": name_octets}, replace={"name": TextField("name_", b"\0")}),
        Row("S7Plus_TagDescription", layouts.TAG_DESCRIPTION, "A variable of an S7-1200 with firmware 2, by its name.", {"tag": tables.TAG_DESCRIPTION_TAG}, replace={"name": TextField("name_")}),
        Row("S7Plus_Tag", layouts.TAG_VARIABLE, "Type, id and numbers of such a variable.", {"one": 1}, replace={"numbers": numbers_field("numbers")}),
        Row("S7Plus_TagDescriptionEnd", layouts.TAG_DESCRIPTION_END, "The end of such a variable.", {"tag": tables.TAG_DESCRIPTION_END_TAG}),
    ],
    "S7comm-plus: requests and responses": [
        Row("S7Plus_ReturnValue", layouts.RETURN_VALUE, "Return value, the begin of a response."),
        Row("S7Plus_ObjectId", layouts.OBJECT_ID, "The object of a request."),
        Row("S7Plus_ObjectIdVlq", layouts.OBJECT_ID_VLQ, "An object in the answer to CreateObject."),
        Row("S7Plus_Count", layouts.COUNT, "Number of the ids that follow.", {"count": None}, counting=ids_behind),
        Row("S7Plus_CountByte", layouts.COUNT_OCTET, "The same in one byte.", {"count": None}, counting=ids_behind),
        Row("S7Plus_ItemCounts", layouts.ITEM_COUNTS, "Number of the addresses that follow, or of the attributes of the object in `link`.", {"item_count": None, "field_count": None}, counting=items_behind),
        Row("S7Plus_Address", layouts.ADDRESS, "The address of a variable.", {"id_count": None}, computed={"id_count": address_numbers}, replace={"lids": numbers_field("lids")}),
        Row("S7Plus_AttributeId", layouts.ATTRIBUTE_ID, "An attribute of the object."),
        Row("S7Plus_ItemValue", layouts.ITEM_VALUE, "The value of an item by its number.", {"number": 1}, replace=_value()),
        Row("S7Plus_ItemError", layouts.ITEM_ERROR, "Why an item was refused.", {"number": 1}),
        Row("S7Plus_Qualifier", layouts.QUALIFIER, "Head of a qualifier, before its members.", {"id": _QUALIFIER}),
        Row("S7Plus_Reserved", layouts.RESERVED, "Bytes without a known meaning."),
        Row("S7Plus_ExploreHead", layouts.EXPLORE_HEAD, "The object to explore, and the depth.", {"one": 1}),
        Row("S7Plus_ExploreGroup", layouts.EXPLORE_GROUP, "A group of filters and attributes; one without filters is the last.", {"filters": None, "id_count": None}, counting=group_behind),
        Row("S7Plus_ExploreFilter", layouts.EXPLORE_FILTER, "A filter; its members follow.", {"type": STRUCT}),
        Row("S7Plus_LinkRequest", layouts.LINK_REQUEST, "The relation that GetLink asks about."),
        Row("S7Plus_SequenceType", layouts.SEQUENCE_TYPE, "The kind of a sequence."),
        Row("S7Plus_SequenceKind", layouts.SEQUENCE_KIND, "Kind of the rest of a sequence of V2 and V3.", {"kind": 1}),
        Row("S7Plus_InvokeHead", layouts.INVOKE_HEAD, "The method that is called."),
        Row("S7Plus_Piece", layouts.PIECE, "A piece of a stream, in a frame of its own.", {"length": None}),
        Row("S7Plus_IntegrityId", layouts.INTEGRITY_ID, "Integrity id; in a response that of its request plus the sequence number (`plus_reply` fills it in)."),
        Row("S7Plus_Digest", layouts.DIGEST, "The digest after the data, as a CPU 1511 with firmware 1.0 sends it.", {"digest_length": None}),
        Row("S7Plus_Fill", layouts.FILL, "The zeros at the end of a PDU.", {"fill": bytes(4)}),
    ],
    "S7comm-plus: notifications": [
        Row("S7Plus_NotificationHead", layouts.NOTIFICATION_HEAD, "The number of a notification."),
        Row("S7Plus_NotificationHeadShort", layouts.NOTIFICATION_HEAD_SHORT, "The same of a CPU with firmware 2; its number is in the fixed part."),
        Row("S7Plus_NotificationHeadTimed", layouts.NOTIFICATION_HEAD_TIMED, "The same with a time, whose first byte is 0."),
        Row("S7Plus_NotifiedValue", layouts.NOTIFIED_VALUE, "The value of an item by its reference.", {"kind": tables.VALUE_ITEM}, replace=_value()),
        Row("S7Plus_NotifiedValueVlq", layouts.NOTIFIED_VALUE_VLQ, "The same with a reference of variable size.", {"kind": tables.VALUE_ITEM_VLQ}, replace=_value()),
        Row("S7Plus_NotifiedPlain", layouts.NOTIFIED_PLAIN, "A value without a reference.", {"kind": tables.PLAIN_VALUE_ITEM}, replace=_value()),
        Row("S7Plus_NotifiedRefusal", layouts.NOTIFIED_REFUSAL, "An item that cannot be read.", {"kind": tables.REFUSED_ITEM}),
        Row("S7Plus_NotifiedObjects", layouts.NOTIFIED_KIND, "Head of objects, such as alarms.", {"kind": tables.OBJECTS_ITEM}),
        Row("S7Plus_SecondPart", layouts.SECOND_PART, "Head of the items of a second part."),
    ],
}
