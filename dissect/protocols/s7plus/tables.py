"""Code tables of S7comm-plus (docs/s7plus.md names the sources).

Siemens publishes nothing about this protocol. Versions, opcodes, functions and return values are those of Thomas Wiens's public
Wireshark plugin and of his S7CommPlusDriver; codes that neither names remain numbers.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.return_tables import RETURN_CODES as RETURN_CODES  # noqa: PLC0414 - read from here like every other table
from dissect.wire.codes import CodeTable

PROTOCOL_ID: Final = 0x72

V1: Final = 0x01
V2: Final = 0x02
V3: Final = 0x03
SYSTEM_EVENT: Final = 0xFE
KEEP_ALIVE: Final = 0xFF

VERSIONS: Final = CodeTable("S7comm-plus version", 2, [
    (V1, "V1", "First version, and the session set-up of all others."),
    (V2, "V2", "S7-1500 before firmware 1.5, and everything inside TLS."),
    (V3, "V3", "An integrity part precedes the opcode."),
    (SYSTEM_EVENT, "system event", "Number of bytes received, or a text; no opcode."),
    (KEEP_ALIVE, "keep-alive", "Four bytes in all: a number and a reserved byte."),
])  # fmt: skip

REQUEST: Final = 0x31
RESPONSE: Final = 0x32
NOTIFICATION: Final = 0x33
RESPONSE2: Final = 0x02

OPCODES: Final = CodeTable("S7comm-plus opcode", 2, [
    (REQUEST, "Request", "Requests a function."),
    (RESPONSE, "Response", "Answers the request of the same sequence number."),
    (NOTIFICATION, "Notification", "An indication of a subscription."),
    (RESPONSE2, "Response2", "An answer seen with cyclic data of older panels."),
])  # fmt: skip

ERROR: Final = 0x04B1
EXPLORE: Final = 0x04BB
CREATE_OBJECT: Final = 0x04CA
DELETE_OBJECT: Final = 0x04D4
SET_VARIABLE: Final = 0x04F2
GET_VARIABLE: Final = 0x04FC
GET_LINK: Final = 0x0524
SET_MULTI_VARIABLES: Final = 0x0542
GET_MULTI_VARIABLES: Final = 0x054C
BEGIN_SEQUENCE: Final = 0x0556
END_SEQUENCE: Final = 0x0560
INVOKE: Final = 0x056B
SET_VAR_SUBSTREAMED: Final = 0x057C
GET_VAR_SUBSTREAMED: Final = 0x0586
ERROR_2: Final = 0x05A9
INIT_SSL: Final = 0x05B3

#: Functions of a response that reports that a request, of any function, could not be carried out.
ERRORS: Final = frozenset((ERROR, ERROR_2))

FUNCTIONS: Final = CodeTable("S7comm-plus function", 4, [
    (ERROR, "Error", "Answers a request that could not be carried out."),
    (EXPLORE, "Explore", "Browses the objects of the device."),
    (CREATE_OBJECT, "CreateObject", "Creates an object: a session, a subscription, a block."),
    (DELETE_OBJECT, "DeleteObject", "Deletes an object, or ends a session."),
    (SET_VARIABLE, "SetVariable", "Writes one variable."),
    (GET_VARIABLE, "GetVariable", "Reads one variable; old S7-1200 firmware."),
    (0x0506, "AddLink", "Links objects."),
    (0x051A, "RemoveLink", "Removes a link between objects."),
    (GET_LINK, "GetLink", "Reads the links of an object."),
    (SET_MULTI_VARIABLES, "SetMultiVariables", "Writes several variables."),
    (GET_MULTI_VARIABLES, "GetMultiVariables", "Reads several variables."),
    (BEGIN_SEQUENCE, "BeginSequence", "Begins a sequence of requests that belong together, as in a download."),
    (END_SEQUENCE, "EndSequence", "Ends it."),
    (INVOKE, "Invoke", "Calls a method of an object."),
    (SET_VAR_SUBSTREAMED, "SetVarSubStreamed", "Writes a variable in a stream of frames."),
    (GET_VAR_SUBSTREAMED, "GetVarSubStreamed", "Reads a variable as a stream."),
    (0x0590, "GetVariablesAddress", "Asks where variables are."),
    (0x059A, "Abort", "Breaks a request off."),
    (ERROR_2, "Error2", "Answers a request that could not be carried out."),
    (INIT_SSL, "InitSSL", "Asks that the connection goes on in TLS."),
])  # fmt: skip

OBJECT_TAG: Final = 0xA1
OBJECT_END_TAG: Final = 0xA2
ATTRIBUTE_TAG: Final = 0xA3
RELATION_TAG: Final = 0xA4
TAG_DESCRIPTION_TAG: Final = 0xA7
TAG_DESCRIPTION_END_TAG: Final = 0xA8
VARIABLES_TAG: Final = 0xAB
NAMES_TAG: Final = 0xAC

TAGS: Final = CodeTable("S7comm-plus element", 2, [
    (OBJECT_TAG, "object", "An object begins."),
    (OBJECT_END_TAG, "end of object", "The object ends."),
    (ATTRIBUTE_TAG, "attribute", "An attribute and its value."),
    (RELATION_TAG, "relation", "A reference to a different object."),
    (TAG_DESCRIPTION_TAG, "tag description", "A variable of an S7-1200 with firmware 2."),
    (TAG_DESCRIPTION_END_TAG, "end of tag description", "It ends."),
    (VARIABLES_TAG, "list of variables", "Types and places of the variables of a block."),
    (NAMES_TAG, "list of names", "Their names, in the same order."),
])  # fmt: skip

#: The upper four bits of a variable's attributes; each kind with the count of numbers at the end of its entry.
VARIABLE_KINDS: Final = CodeTable("S7comm-plus kind of variable", 1, [
    (0, "array of FB instances", ""),
    (1, "plain", ""),
    (2, "string", ""),
    (3, "array", ""),
    (4, "array of several dimensions", ""),
    (5, "structure", ""),
    (6, "array of structures", ""),
    (7, "array of structures of several dimensions", ""),
    (8, "plain, both layouts", ""),
    (9, "string, both layouts", ""),
    (10, "array, both layouts", ""),
    (11, "array of several dimensions, both layouts", ""),
    (12, "structure, both layouts", ""),
    (13, "array of structures, both layouts", ""),
    (14, "array of structures of several dimensions, both layouts", ""),
    (15, "FB instance", ""),
])  # fmt: skip
VARIABLE_NUMBERS: Final = (25, 0, 2, 4, 16, 7, 11, 23, 0, 2, 4, 16, 7, 11, 23, 9)

VALUE_ITEM: Final = 0x92
VALUE_ITEM_VLQ: Final = 0x9B
UNKNOWN_ITEM: Final = 0x9C
REFUSED_ITEM: Final = 0x13
REFUSED_ITEM_3: Final = 0x03
OBJECTS_ITEM: Final = 0x81
PLAIN_VALUE_ITEM: Final = 0x83

#: The octet that begins an item of a notification.
NOTIFIED: Final = CodeTable("S7comm-plus notified item", 2, [
    (0x00, "end", "No item follows."),
    (REFUSED_ITEM_3, "refused", "The CPU refuses the item, and gives no reason."),
    (REFUSED_ITEM, "refused", "The CPU refuses the item, and gives no reason."),
    (OBJECTS_ITEM, "objects", "Objects follow, as alarms."),
    (PLAIN_VALUE_ITEM, "value", "A value follows; from one source only."),
    (VALUE_ITEM, "value", "A value of the item."),
    (VALUE_ITEM_VLQ, "value", "The same with a reference of variable size; two sources, in no capture."),
    (UNKNOWN_ITEM, "unknown", "Four bytes of unknown meaning; two sources, in no capture."),
])  # fmt: skip

#: Bit of the transport flags: the sender needs no response.
NO_RESPONSE: Final = 0x40

PARTIAL_ERROR: Final = 19

def refuses(code: int) -> bool:
    """Return whether the lower 16 bits of a return value refuse the whole request or a part of it."""
    return code >= 0x8000 or code == PARTIAL_ERROR
