"""Code tables of S7comm-plus (docs/s7plus.md names the sources).

Siemens publishes nothing about this protocol. Versions, opcodes, functions and return values are those of Thomas Wiens's
public Wireshark plugin and of his S7CommPlusDriver; what both leave open stays a number.
"""

from __future__ import annotations

from typing import Final

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
    (V3, "V3", "An integrity part stands before the opcode."),
    (SYSTEM_EVENT, "system event", "Tells how many octets arrived, or a text; no opcode."),
    (KEEP_ALIVE, "keep-alive", "Four octets in all: a number and a reserved octet."),
])  # fmt: skip

REQUEST: Final = 0x31
RESPONSE: Final = 0x32
NOTIFICATION: Final = 0x33
RESPONSE2: Final = 0x02

OPCODES: Final = CodeTable("S7comm-plus opcode", 2, [
    (REQUEST, "Request", "Asks for a function."),
    (RESPONSE, "Response", "Answers the request of the same sequence number."),
    (NOTIFICATION, "Notification", "What a subscription tells without being asked."),
    (RESPONSE2, "Response2", "An answer seen with cyclic data of older panels."),
])  # fmt: skip

ERROR: Final = 0x04B1
CREATE_OBJECT: Final = 0x04CA
SET_VARIABLE: Final = 0x04F2
SET_MULTI_VARIABLES: Final = 0x0542
GET_MULTI_VARIABLES: Final = 0x054C
ERROR_2: Final = 0x05A9
INIT_SSL: Final = 0x05B3

#: Functions that answer a request of any other function: it could not be carried out.
ERRORS: Final = frozenset((ERROR, ERROR_2))

FUNCTIONS: Final = CodeTable("S7comm-plus function", 4, [
    (ERROR, "Error", "Answers a request that could not be carried out."),
    (0x04BB, "Explore", "Browses the objects of the device."),
    (CREATE_OBJECT, "CreateObject", "Creates an object: a session, a subscription, a block."),
    (0x04D4, "DeleteObject", "Deletes an object, or ends a session."),
    (SET_VARIABLE, "SetVariable", "Writes one variable."),
    (0x04FC, "GetVariable", "Reads one variable; old S7-1200 firmware."),
    (0x0506, "AddLink", "Links objects."),
    (0x051A, "RemoveLink", "Removes a link between objects."),
    (0x0524, "GetLink", "Reads the links of an object."),
    (SET_MULTI_VARIABLES, "SetMultiVariables", "Writes several variables."),
    (GET_MULTI_VARIABLES, "GetMultiVariables", "Reads several variables."),
    (0x0556, "BeginSequence", "Begins a sequence of requests that belong together, as in a download."),
    (0x0560, "EndSequence", "Ends it."),
    (0x056B, "Invoke", "Calls a method of an object."),
    (0x057C, "SetVarSubStreamed", "Writes a variable in a stream of frames."),
    (0x0586, "GetVarSubStreamed", "Reads a variable as a stream."),
    (0x0590, "GetVariablesAddress", "Asks where variables are."),
    (0x059A, "Abort", "Breaks a request off."),
    (ERROR_2, "Error2", "Answers a request that could not be carried out."),
    (INIT_SSL, "InitSSL", "Asks that the connection goes on in TLS."),
])  # fmt: skip

#: Bit of the transport flags: the sender wants no answer.
NO_RESPONSE: Final = 0x40

PARTIAL_ERROR: Final = 19

#: The lower 16 bits of a return value; negative numbers (0x8000 and above) are refusals.
RETURN_CODES: Final = CodeTable("S7comm-plus return value", 4, [
    (0, "OK", "All is well."),
    (17, "Message session pre-legitimated", "The session is open, a password may still be asked for."),
    (PARTIAL_ERROR, "Service executed with partial error", "At least one of several variables or objects was refused."),
    (22, "Service session delegitimated", "The session lost its rights."),
    (0xFF01, "Invalid LID", "A variable was addressed by an id that the device does not know."),
    (0xFF7A, "Service multi-ES not supported", "Several engineering stations at once are not supported."),
    (0xFFEF, "Invalid CRC", "The checksum of a symbolic address does not fit the device's program."),
    (0xFFF4, "Object not found", "The device has no such object."),
])  # fmt: skip


def refuses(code: int) -> bool:
    """Tell whether the lower 16 bits of a return value say no, to the whole request or to a part of it."""
    return code >= 0x8000 or code == PARTIAL_ERROR
