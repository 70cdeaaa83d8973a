"""The code tables of S7comm: function, area, transport size, return code, block type, userdata group (reference appendix A)."""

from __future__ import annotations

from typing import Final

from dissect.wire.codes import CodeTable

JOB: Final = 1
ACK: Final = 2
ACK_DATA: Final = 3
USERDATA: Final = 7

CPU_SERVICES: Final = 0x00
MODE_TRANSITION: Final = 0x01
READ_VAR: Final = 0x04
WRITE_VAR: Final = 0x05
REQUEST_DOWNLOAD: Final = 0x1A
DOWNLOAD_BLOCK: Final = 0x1B
DOWNLOAD_ENDED: Final = 0x1C
START_UPLOAD: Final = 0x1D
UPLOAD: Final = 0x1E
END_UPLOAD: Final = 0x1F
PI_SERVICE: Final = 0x28
PLC_STOP: Final = 0x29
SETUP_COMMUNICATION: Final = 0xF0

SUCCESS: Final = 0xFF
TYPE_NOT_SUPPORTED: Final = 0x06
INCONSISTENT: Final = 0x07
OBJECT_DOES_NOT_EXIST: Final = 0x0A

S7ANY: Final = 0x10
# Syntax ids of the head of userdata.
PARAMETER_SHORT: Final = 0x11
PARAMETER_EXTENDED: Final = 0x12
# For items: the R_ID of a PBC, and an ALARM query.
PBC_R_ID: Final = 0x13
ALARM_QUERY_ITEM: Final = 0x1A

# Groups of userdata.
GROUP_MODE: Final = 0
GROUP_TEST: Final = 1
GROUP_CYCLIC: Final = 2
GROUP_BLOCKS: Final = 3
GROUP_CPU: Final = 4
GROUP_SECURITY: Final = 5
GROUP_PBC: Final = 6
GROUP_TIME: Final = 7
GROUP_ROUTING: Final = 0x20
GROUP_NC: Final = 0x3F

# Subfunctions of programmer commands.
BLOCK_STATUS_JOB: Final = 0x01
VARIABLE_STATUS: Final = 0x02
OUTPUT_ISTACK: Final = 0x03
OUTPUT_BSTACK: Final = 0x04
OUTPUT_LSTACK: Final = 0x05
MODIFY_VARIABLE: Final = 0x08
FORCE_VARIABLES: Final = 0x09
SET_BREAKPOINT: Final = 0x0A
LEAVE_HOLD: Final = 0x0B
DISABLE_JOB: Final = 0x0D
ENABLE_JOB: Final = 0x0E
DELETE_JOB: Final = 0x0F
READ_JOB_LIST: Final = 0x10
READ_JOB: Final = 0x11
REPLACE_JOB: Final = 0x12
BLOCK_STATUS_V2: Final = 0x13

# Subfunctions of cyclic services.
CYCLIC_TRANSFER: Final = 1
UNSUBSCRIBE: Final = 4
CHANGE_DRIVEN: Final = 5
CHANGE_DRIVEN_MODIFY: Final = 7
READ_RECORD: Final = 8

# Subfunctions of block functions.
LIST_BLOCKS: Final = 1
LIST_OF_TYPE: Final = 2
BLOCK_INFO: Final = 3

# Subfunctions of CPU functions.
READ_SZL: Final = 1
MESSAGE_SERVICE: Final = 0x02
DIAGNOSTIC_MESSAGE: Final = 3
ALARM_8: Final = 0x05
NOTIFY: Final = 0x06
ALARM_8_LOCK: Final = 0x07
ALARM_8_UNLOCK: Final = 0x08
SCAN: Final = 0x09
ACKNOWLEDGE: Final = 0x0B
ACKNOWLEDGED: Final = 0x0C
LOCKED: Final = 0x0D
UNLOCKED: Final = 0x0E
AR_SEND: Final = 0x10
ALARM_SQ: Final = 0x11
ALARM_S: Final = 0x12
ALARM_QUERY: Final = 0x13
NOTIFY_8: Final = 0x16

# Subfunctions of security.
SEND_PASSWORD: Final = 1

# Subfunctions of time functions.
READ_CLOCK: Final = 1
SET_CLOCK: Final = 2
READ_CLOCK_FOLLOWING: Final = 3
SET_CLOCK_SECOND: Final = 4

# Subfunctions of PBC.
BSEND: Final = 1

# Subfunctions of NC programming.
NC_REQUEST_DOWNLOAD: Final = 1
NC_DOWNLOAD_BLOCK: Final = 2
NC_CONTINUE_DOWNLOAD: Final = 3
NC_START_UPLOAD: Final = 6
NC_UPLOAD_BLOCK: Final = 7
NC_CONTINUE_UPLOAD: Final = 8

# Subfunctions of mode transition.
MODE_STOP: Final = 0

# The effect of a request on its device: the last column of `FUNCTIONS` and `USERDATA_SUBFUNCTIONS`, and the effect of a PI
# service. It decides which requests may be replayed, and which are security events (reference section 7.4).
READ: Final = "read"  # changes nothing in the device
SESSION: Final = "session"  # changes what the device sends to this client
WRITE: Final = "write"
PROGRAM_READ: Final = "program read"  # begins to read a block or a file
PROGRAM_CHANGE: Final = "program change"  # begins to load a block or file, links it in, or deletes it
TRANSFER: Final = "transfer"  # continues what was begun
TEST: Final = "test"  # starts a test job, which takes time of the program's cycle, or is a command about one
DEBUG: Final = "debug"  # follows the program as it runs, or halts it
FORCE: Final = "force"  # sets variables against the program
CLOCK: Final = "clock"  # sets the clock
ALARM_CHANGE: Final = "alarm change"  # locks, unlocks or acknowledges
LOGIN: Final = "authentication"
START: Final = "start"
STOP: Final = "stop"
MEMORY: Final = "memory"  # clears, compresses or copies the memory to ROM
FLASH: Final = "flash"  # flashes LEDs
DESTRUCTIVE: Final = "destructive"  # deletes what may not come back
ROUTING: Final = "routing"  # reaches through to another device
CONTROL: Final = "control"  # anything else that changes the device
# For pushes, which are not requested.
STATE: Final = "state change"
ALARM: Final = "alarm"
SEND: Final = "data push"

# What a good answer to a userdata request always has: the column after the effect in `USERDATA_SUBFUNCTIONS`. If it is empty,
# an answer without payload (return code 0x0a) is good, or the rule is unknown (reference 4.2 and 4.5 to 4.12).
DATA: Final = "data"

ROSCTR: Final = CodeTable(
    "ROSCTR",
    2,
    [
        (0x01, "Job", "Request; the PLC sends jobs of its own in a block download."),
        (0x02, "Ack", "Answer without parameters and data, used for errors."),
        (0x03, "Ack_Data", "Answer with parameters."),
        (0x07, "Userdata", "Request, response or push of a function group; the type stands in the parameters."),
    ],
)

FUNCTIONS: Final = CodeTable(
    "S7 function",
    2,
    [
        (0x00, "CPU services", "Userdata head: the function group says what it is.", ""),
        (0x01, "Mode transition indication", "Sent as ROSCTR 7 push from PLC; parameters: 8 bytes: 01, item count 00, 4 unknown, mode, 1 unknown.", STATE),
        (0x04, "Read Var", "Sent as Job; parameters: function, item count, items.", READ),
        (0x05, "Write Var", "Sent as Job; parameters: function, item count, items.", WRITE),
        (0x1a, "Request download", "Sent as Job, client to PLC; parameters: status, 2 unknown, 4 unknown, file name, length part.", PROGRAM_CHANGE),
        (0x1b, "Download block", "Sent as Job, PLC to client; parameters: status, 2 unknown, 4 unknown, file name.", TRANSFER),
        (0x1c, "Download ended", "Sent as Job, PLC to client; parameters: status, error code(2), 4 unknown, file name.", TRANSFER),
        (0x1d, "Start upload", "Sent as Job; parameters: status, 2 unknown, upload id(4), file name.", PROGRAM_READ),
        (0x1e, "Upload", "Sent as Job; parameters: status, 2 unknown, upload id(4).", READ),
        (0x1f, "End upload", "Sent as Job; parameters: status, error code(2), upload id(4).", READ),
        (0x28, "PI service", "Sent as Job; parameters: 7 unknown, parameter block length(2), block, service name.", CONTROL),
        (0x29, "PLC stop", "Sent as Job; parameters: 5 unknown, service name P_PROGRAM.", STOP),
        (0xf0, "Setup communication", "Sent as Job; parameters: reserved, max AmQ calling(2), max AmQ called(2), PDU length(2).", SESSION),
    ],
)

AREAS: Final = CodeTable(
    "S7 area",
    2,
    [
        (0x00, "raw memory", "Libnodave name for S5 raw memory; not an S7 area."),
        (0x01, "data record", "RDREC; count = maximum length, DB field = record index, address = logical id."),
        (0x03, "system information (200 family)", "Libnodave daveSysInfo."),
        (0x05, "system flags SM (200 family)", "Libnodave daveSysFlags."),
        (0x06, "analog inputs (200 family)", "Libnodave sends transport size WORD."),
        (0x07, "analog outputs (200 family)", "Libnodave sends transport size WORD."),
        (0x1c, "S7 counters", "Transport size 0x1c; address is NOT multiplied by 8; 2 bytes per counter."),
        (0x1d, "S7 timers", "Transport size 0x1d; address is NOT multiplied by 8; 2 bytes per timer (S5TIME)."),
        (0x1e, "IEC counters (200 family)", "Counter number."),
        (0x1f, "IEC timers (200 family)", "Timer number."),
        (0x80, "direct peripheral access", "Bit address."),
        (0x81, "process image of inputs", "Bit address."),
        (0x82, "process image of outputs", "Bit address."),
        (0x83, "flags (bit memory)", "Bit address."),
        (0x84, "data block", "DB number field used."),
        (0x85, "instance data block", "DB number field used."),
        (0x86, "local data", "Not normally reachable over the network; libnodave reuses the value for S5 system data."),
        (0x87, "local data of the caller", "V stands for Vorgaenger (predecessor); on S7-200 the V memory is read as DB 1 in area 0x84, not here."),
    ],
)

#: The letters for an area in an address (international mnemonics).
AREA_LETTERS: Final[dict[int, str]] = {
    0x00: "RAW",
    0x01: "RECORD",
    0x03: "SI200",
    0x05: "SF200",
    0x06: "AI200",
    0x07: "AO200",
    0x1c: "C",
    0x1d: "T",
    0x1e: "C200",
    0x1f: "T200",
    0x80: "P",
    0x81: "I",
    0x82: "Q",
    0x83: "M",
    0x84: "DB",
    0x85: "DI",
    0x86: "L",
    0x87: "V",
}

#: Areas by their single letter in an address, including the German ones (E and A for inputs and outputs, Z for counters).
LETTER_AREAS: Final[dict[str, int]] = {
    **{letters: area for area, letters in AREA_LETTERS.items() if len(letters) == 1},
    "E": 0x81,
    "A": 0x82,
    "Z": 0x1c,
}

#: Areas whose address is a plain object number, not an octet address times 8.
NUMBERED_AREAS: Final = frozenset((0x1c, 0x1d, 0x1e, 0x1f))

#: Those among them whose items need the transport size with the same number.
OWN_SIZE_AREAS: Final = frozenset((0x1c, 0x1d))

#: The area of data records, which have no addresses, and the areas of data blocks.
RECORD_AREA: Final = 0x01
DB: Final = 0x84
DI: Final = 0x85

#: Areas in which the DB number field is used.
DB_AREAS: Final = frozenset((0x84, 0x85))

TRANSPORT_SIZES: Final = CodeTable(
    "S7 transport size of a request item",
    2,
    [
        (0x01, "BIT", "One byte per bit in the data; more than 1 bit is refused by most CPUs (return code 0x06)."),
        (0x02, "BYTE", ""),
        (0x03, "CHAR", "Answered with data size 0x09."),
        (0x04, "WORD", ""),
        (0x05, "INT", "Answered with data size 0x05."),
        (0x06, "DWORD", ""),
        (0x07, "DINT", "Answered with data size 0x05, length in bits (21,482 of 21,482 captured items), never 0x06."),
        (0x08, "REAL", "IEEE 754 single, big-endian."),
        (0x09, "DATE", "Days since 1990-01-01; Wireshark defines the number but prints no name."),
        (0x0a, "TOD", "Milliseconds since midnight."),
        (0x0b, "TIME", "Signed milliseconds."),
        (0x0c, "S5TIME", "Time base in bits 13-12, 3 BCD digits."),
        (0x0f, "DATE_AND_TIME", "BCD."),
        (0x13, "WCHAR", "S7-1200/1500; answered with data size 0x09; Wireshark has no name for it."),
        (0x1c, "COUNTER", "3 BCD digits."),
        (0x1d, "TIMER", "S5TIME form."),
        (0x1e, "IEC TIMER/COUNTER", "Wireshark: constant named counter, text says timer; sources disagree."),
        (0x1f, "IEC COUNTER/TIMER", "See 0x1e; libnodave area 30 = counters, 31 = timers (200 family)."),
        (0x20, "HS COUNTER", "High-speed counter (200 family)."),
        (0x30, "LREAL", "One source only (PLC4X), not seen in captures."),
    ],
)

#: Size of one element by request transport size; sizes that are not in the table are unknown.
ELEMENT_OCTETS: Final[dict[int, int]] = {
    0x01: 1,
    0x02: 1,
    0x03: 1,
    0x04: 2,
    0x05: 2,
    0x06: 4,
    0x07: 4,
    0x08: 4,
    0x09: 2,
    0x0a: 4,
    0x0b: 4,
    0x0c: 2,
    0x0f: 8,
    0x13: 2,
    0x1c: 2,
    0x1d: 2,
    0x30: 8,
}

#: Request transport sizes that the code refers to.
BIT: Final = 0x01
BYTE: Final = 0x02
CHAR: Final = 0x03
WORD: Final = 0x04
INT: Final = 0x05
DWORD: Final = 0x06
DINT: Final = 0x07
REAL: Final = 0x08
WCHAR: Final = 0x13

DATA_TRANSPORT_SIZES: Final = CodeTable(
    "S7 transport size of a data item",
    2,
    [
        (0x00, "NULL", "With return codes other than success, and userdata answers without payload."),
        (0x03, "BIT", "1 bit takes 1 byte."),
        (0x04, "BYTE/WORD/DWORD", "Length in bytes = ceil(bits / 8)."),
        (0x05, "INTEGER", "Length in bytes = ceil(bits / 8)."),
        (0x06, "DINTEGER", "Never seen in captures (DINT comes as 0x05); Wireshark and PLC4X: bytes; Snap7 family divides by 8: if they disagree, the remaining data length decides."),
        (0x07, "REAL", ""),
        (0x09, "OCTET STRING", "Timers, counters, DBREAD, all userdata payloads."),
        (0x11, "NCK ADDRESS1", "Items of addresses follow instead of values (Sinumerik)."),
        (0x12, "NCK ADDRESS2", "Items of addresses follow instead of values (Sinumerik)."),
    ],
)

#: Data transport sizes that the code refers to.
DATA_BIT: Final = 0x03
DATA_BYTES: Final = 0x04
OCTET_STRING: Final = 0x09

#: Data transport sizes whose length field counts bits (the others count octets).
LENGTH_IN_BITS: Final = frozenset((0x03, 0x04, 0x05))

#: The data transport size with which a CPU answers a request transport size; no capture has an exception (reference 3.5).
ANSWER_TRANSPORT_SIZE: Final[dict[int, int]] = {
    0x01: 0x03,
    0x02: 0x04,
    0x03: 0x09,
    0x04: 0x04,
    0x05: 0x05,
    0x06: 0x04,
    0x07: 0x05,
    0x08: 0x07,
    0x13: 0x09,
    0x1C: 0x09,
    0x1D: 0x09,
}

RETURN_CODES: Final = CodeTable(
    "S7 return code",
    2,
    [
        (0x00, "Reserved", "In a write request: no meaning; in a response: undefined."),
        (0x01, "Hardware error", "No peripheral at the address / hardware fault."),
        (0x03, "Access not allowed", "Object may not be accessed (also: timers and counters not writable); libnodave: item not available on the 200 family."),
        (0x05, "Invalid address", "Address outside the area."),
        (0x06, "Data type not supported", "For example a bit block with a count other than 1."),
        (0x07, "Data type inconsistent", "Length of write data does not match the item."),
        (0x0a, "Object does not exist", "For example a missing DB; in userdata also the normal head of an answer without payload (look at the error code)."),
        (0xff, "Success", "Data follow."),
    ],
)

SYNTAX_IDS: Final = CodeTable(
    "S7 syntax id",
    2,
    [
        (0x10, "S7ANY", "Transport size(1) count(2) DB number(2) area(1) address(3)."),
        (0x11, "ParameterShort", "Userdata head: type+group(1) subfunction(1) sequence(1)."),
        (0x12, "ParameterExtended", "Userdata head: type+group(1) subfunction(1) sequence(1) data unit reference(1) last data unit(1) error code(2)."),
        (0x13, "PBC-R_ID", "Unknown(1) R_ID(4)."),
        (0x15, "ALARM_LOCKFREE", "Number of associated values(1) event id(4)."),
        (0x16, "ALARM_IND", "Associated values(1) event id(4) event state(1) state(1) ack going(1) ack coming(1)."),
        (0x19, "ALARM_ACK", "Associated values(1) event id(4) ack going(1) ack coming(1)."),
        (0x1a, "ALARM_QUERYREQ", "Unknown(1) query type(1) unknown(1) alarm type or event id(4)."),
        (0x1c, "NOTIFY_IND", "As ALARM_IND, then event going(1) event coming(1) last changed(1) reserved(1)."),
        (0x82, "NCK", "Area and unit(1) column(2) line(2) module(1) line count(1)."),
        (0x83, "NCK_M", "As NCK, metric units."),
        (0x84, "NCK_I", "As NCK, inch units."),
        (0xa2, "DRIVEESANY", "Unknown(1) unknown(2) unknown(2) parameter number(2) parameter index(2)."),
        (0xb0, "DBREAD", "Number of areas(1), then per area bytes(1) DB(2) start byte(2)."),
        (0xb2, "1200SYM", "Reserved 0xff(1) root area(2) area or DB(2) CRC(4), then n x flags+value(4)."),
    ],
)

#: Block types by the two digits in a file name.
BLOCK_TYPES: Final[dict[str, str]] = {
    "08": "OB",
    "09": "CMod",
    "0A": "DB",
    "0B": "SDB",
    "0C": "FC",
    "0D": "SFC",
    "0E": "FB",
    "0F": "SFB",
}

USERDATA_TYPES: Final = CodeTable(
    "S7 userdata type",
    1,
    [
        (0x0, "push", "Unsolicited indication."),
        (0x1, "request", "Request."),
        (0x2, "response", "Response."),
        (0x3, "unused", "Not used by any known device."),
    ],
)

USERDATA_GROUPS: Final = CodeTable(
    "S7 userdata function group",
    2,
    [
        (0x00, "mode transition", ""),
        (0x01, "programmer commands (test and installation)", ""),
        (0x02, "cyclic services", ""),
        (0x03, "block functions", ""),
        (0x04, "CPU functions", ""),
        (0x05, "security", ""),
        (0x06, "PBC (programmable block communication)", ""),
        (0x07, "time functions", ""),
        (0x20, "data record routing", ""),
        (0x3f, "NC programming (Sinumerik)", ""),
    ],
)

#: Subfunctions by function group, with their sender, the effect of a request, and `DATA` if a good answer always has a payload.
USERDATA_SUBFUNCTIONS: Final[dict[int, CodeTable]] = {
    0x00: CodeTable(
        "S7 mode transition subfunction",
        2,
        [
            (0x00, "STOP", "Push.", STATE),
            (0x01, "warm restart", "Push.", STATE),
            (0x02, "RUN", "Push.", STATE),
            (0x03, "hot restart", "Push.", STATE),
            (0x04, "HOLD", "Push.", STATE),
            (0x06, "cold restart", "Push.", STATE),
            (0x09, "RUN_R (H system redundant)", "Push.", STATE),
            (0x0b, "LINK-UP", "Push.", STATE),
            (0x0c, "UPDATE", "Push.", STATE),
        ],
    ),
    0x01: CodeTable(
        "S7 programmer commands (test and installation) subfunction",
        2,
        [
            (0x01, "block status", "Request/response/push.", DEBUG),
            (0x02, "variable status", "Request/response/push.", TEST),
            (0x03, "output ISTACK", "Request/response/push.", TEST),
            (0x04, "output BSTACK", "Request/response/push.", TEST),
            (0x05, "output LSTACK", "Request/response/push.", TEST),
            (0x06, "time measurement", "Request/response/push.", TEST),
            (0x07, "force selection", "Request/response.", TEST),
            (0x08, "modify variable", "Request/response/push.", FORCE),
            (0x09, "force", "Request/response/push.", FORCE),
            (0x0a, "breakpoint", "Request/response/push.", DEBUG),
            (0x0b, "exit HOLD", "Request/response.", DEBUG),
            (0x0c, "memory reset", "Request/response.", MEMORY),
            (0x0d, "disable job", "Request/response.", TEST),
            (0x0e, "enable job", "Request/response.", TEST),
            (0x0f, "delete job", "Request/response.", TEST),
            (0x10, "read job list", "Request/response.", TEST, DATA),
            (0x11, "read job", "Request/response.", TEST),
            (0x12, "replace job", "Request/response.", FORCE),
            (0x13, "block status v2", "Request/response/push.", DEBUG),
            (0x16, "flash LED", "Request/response.", FLASH),
        ],
    ),
    0x02: CodeTable(
        "S7 cyclic services subfunction",
        2,
        [
            (0x01, "cyclic transfer", "Request/response/push.", READ, DATA),
            (0x04, "unsubscribe", "Request/response.", SESSION),
            (0x05, "change driven transfer", "Request/response/push.", READ, DATA),
            (0x07, "change driven transfer modify", "Request/response/push.", CONTROL, DATA),
            (0x08, "RDREC (read data record)", "Request/response.", READ, DATA),
        ],
    ),
    0x03: CodeTable(
        "S7 block functions subfunction",
        2,
        [
            (0x01, "list blocks", "Request/response.", READ, DATA),
            (0x02, "list blocks of type", "Request/response.", READ, DATA),
            (0x03, "get block info", "Request/response.", READ, DATA),
        ],
    ),
    0x04: CodeTable(
        "S7 CPU functions subfunction",
        2,
        [
            (0x01, "read SZL", "Request/response.", READ, DATA),
            (0x02, "message service", "Request/response.", SESSION),
            (0x03, "diagnostic message", "Push.", STATE),
            (0x05, "ALARM_8 indication", "Push.", ALARM),
            (0x06, "NOTIFY indication", "Push.", ALARM),
            (0x07, "ALARM_8 lock", "Request/response.", ALARM_CHANGE),
            (0x08, "ALARM_8 unlock", "Request/response.", ALARM_CHANGE),
            (0x09, "SCAN indication", "Push.", ALARM),
            (0x0b, "ALARM ack", "Request/response.", ALARM_CHANGE),
            (0x0c, "ALARM ack indication", "Push.", ALARM),
            (0x0d, "ALARM lock indication", "Push.", ALARM),
            (0x0e, "ALARM unlock indication", "Push.", ALARM),
            (0x10, "AR_SEND indication", "Push.", ALARM),
            (0x11, "ALARM_SQ indication", "Push.", ALARM),
            (0x12, "ALARM_S indication", "Push.", ALARM),
            (0x13, "ALARM query", "Request/response.", READ, DATA),
            (0x16, "NOTIFY_8 indication", "Push.", ALARM),
        ],
    ),
    0x05: CodeTable(
        "S7 security subfunction",
        2,
        [
            (0x01, "PLC password", "Request/response.", LOGIN),
            (0x02, "clear session password", "Request/response.", LOGIN),
        ],
    ),
    0x06: CodeTable(
        "S7 PBC (programmable block communication) subfunction",
        2,
        [
            (0x01, "BSEND", "Request/response.", SEND),
        ],
    ),
    0x07: CodeTable(
        "S7 time functions subfunction",
        2,
        [
            (0x01, "read clock", "Request/response.", READ, DATA),
            (0x02, "set clock", "Request/response.", CLOCK),
            (0x03, "read clock (following)", "Request/response.", READ, DATA),
            (0x04, "set clock (second form)", "Request/response.", CLOCK),
        ],
    ),
    0x20: CodeTable(
        "S7 data record routing subfunction",
        2,
        [
            (0x01, "DRR init", "Request/response.", ROUTING),
            (0x02, "DRR finish", "Request/response.", ROUTING),
            (0x03, "DRR data", "Request/response.", ROUTING),
        ],
    ),
    0x3f: CodeTable(
        "S7 NC programming (Sinumerik) subfunction",
        2,
        [
            (0x01, "request download", "Request/response.", PROGRAM_CHANGE),
            (0x02, "download block", "Push/response.", TRANSFER),
            (0x03, "continue download", "Push.", TRANSFER),
            (0x04, "download ended", "Request/response.", TRANSFER),
            (0x06, "start upload", "Request/response.", PROGRAM_READ),
            (0x07, "upload", "Push/response.", TRANSFER),
            (0x08, "continue upload", "Push.", TRANSFER),
        ],
    ),
}

#: Block types as a number: two octets in test functions, one octet in registers (reference section 4.8).
BLOCK_KINDS: Final = CodeTable(
    "S7 block type",
    2,
    [(0x00, "not set", "No block."), *[(int(digits, 16), name, "") for digits, name in BLOCK_TYPES.items()]],
)

#: Types whose content after the header is code; the content of a DB is values, that of an SDB is system data.
CODE_BLOCKS: Final = frozenset(("OB", "FC", "FB", "SFC", "SFB"))

#: Areas of a Sinumerik, as people write them (reference section 3.5).
NCK_AREAS: Final = CodeTable(
    "S7 NCK area",
    1,
    [
        (0, "N", "NCK."),
        (1, "B", "Mode group."),
        (2, "C", "Channel."),
        (3, "A", "Axis."),
        (4, "T", "Tool."),
        (5, "V", "Feed drive."),
        (6, "H", "Main drive."),
        (7, "M", "MMC."),
    ],
)

SYMBOL_ROOTS: Final = CodeTable("S7-1200 symbol root", 4, [(0x0000, "memory", ""), (0x8a0e, "data block", "")])

SYMBOL_AREAS: Final = CodeTable(
    "S7-1200 symbol area",
    4,
    [(0x50, "I", "Inputs."), (0x51, "Q", "Outputs."), (0x52, "M", "Flags."), (0x53, "C", "Counters."), (0x54, "T", "Timers.")],
)

#: The kind of a step on the way to a symbol.
SYMBOL_FLAGS: Final = CodeTable(
    "S7-1200 symbol step",
    1,
    [
        (2, "encapsulated LID", ""),
        (3, "encapsulated index", ""),
        (4, "LID", "Obtained by LID."),
        (5, "index", "Obtained by index."),
        (6, "part start", ""),
        (7, "part length", ""),
    ],
)

BLOCK_LANGUAGES: Final = CodeTable(
    "S7 block language",
    2,
    [
        (0x00, "undefined", ""),
        (0x01, "AWL/STL", "Statement list."),
        (0x02, "KOP/LAD", "Ladder diagram."),
        (0x03, "FUP/FBD", "Function block diagram."),
        (0x04, "SCL", "Structured text."),
        (0x05, "DB", "Data block."),
        (0x06, "GRAPH", "Sequential function chart."),
        (0x07, "SDB", "System data block."),
        (0x08, "CPU-DB", "Data block that the CPU created."),
        (0x11, "SDB after overall reset", ""),
        (0x12, "SDB routing", ""),
        (0x29, "encrypted", ""),
    ],
)

BLOCK_SECURITY: Final = CodeTable("S7 block security", 8, [(0, "none", ""), (3, "know-how protection", "")])

#: Time bases of a cyclic service; the interval is the time base times a factor (reference section 4.7).
CYCLIC_TIME_BASES: Final = CodeTable("S7 cyclic time base", 2, [(0, "100 ms", ""), (1, "1 s", ""), (2, "10 s", "")])

TEST_TRIGGER_TYPES: Final = CodeTable(
    "S7 trigger type",
    4,
    [
        (0x0000, "update monitor values, activate modify values", ""),
        (0x0001, "monitor or modify variables", ""),
        (0x0002, "modify variables permanently", ""),
        (0x0100, "force immediately", ""),
    ],
)

TEST_FREQUENCIES: Final = CodeTable(
    "S7 trigger frequency", 4, [(0, "every cycle", ""), (1, "once", ""), (2, "always", "Of a force job.")]
)

TEST_TRIGGER_EVENTS: Final = CodeTable(
    "S7 trigger event",
    4,
    [
        (0x0000, "immediately", ""),
        (0x0100, "system trigger", ""),
        (0x0200, "start of the main cycle", ""),
        (0x0300, "end of the main cycle", ""),
        (0x0400, "mode transition RUN-STOP", ""),
        (0x0500, "after code address", ""),
        (0x0600, "code address area", ""),
        (0x0601, "code address area with call environment", ""),
        (0x0700, "data address", ""),
        (0x0800, "data address area", ""),
        (0x0900, "local data address", ""),
        (0x0a00, "local data address area", ""),
        (0x0b00, "range trigger", ""),
        (0x0c00, "before code address", ""),
    ],
)

#: Area and width of a variable in test functions: area in the high nibble, width in the low nibble (reference section 4.8).
TEST_AREAS: Final = CodeTable(
    "S7 test function area",
    2,
    [
        (0x00, "MX", "Flag bit."),
        (0x01, "MB", "Flag byte."),
        (0x02, "MW", "Flag word."),
        (0x03, "MD", "Flag double word."),
        (0x10, "IX", "Input bit."),
        (0x11, "IB", "Input byte."),
        (0x12, "IW", "Input word."),
        (0x13, "ID", "Input double word."),
        (0x20, "QX", "Output bit."),
        (0x21, "QB", "Output byte."),
        (0x22, "QW", "Output word."),
        (0x23, "QD", "Output double word."),
        (0x31, "PIB", "Peripheral input byte."),
        (0x32, "PIW", "Peripheral input word."),
        (0x33, "PID", "Peripheral input double word."),
        (0x54, "T", "Timer."),
        (0x64, "C", "Counter."),
        (0x70, "DBX", "Bit of a data block."),
        (0x71, "DBB", "Byte of a data block."),
        (0x72, "DBW", "Word of a data block."),
        (0x73, "DBD", "Double word of a data block."),
    ],
)

CALL_ENVIRONMENTS: Final = CodeTable(
    "S7 call environment", 4, [(0, "specified call environment", ""), (2, "specified global or instance data block", "")]
)

CALL_CONDITIONS: Final = CodeTable(
    "S7 call condition",
    4,
    [
        (0x0000, "not set", ""),
        (0x0001, "on block number", ""),
        (0x0101, "on block number with code address", ""),
        (0x0a00, "on DB1 (DB) content", ""),
        (0x000a, "on DB2 (DI) content", ""),
        (0x0a0a, "on DB1 (DB) and DB2 (DI) content", ""),
    ],
)

EXIT_HOLD: Final = CodeTable("S7 exit HOLD until", 2, [(0, "next breakpoint", ""), (1, "next statement", "")])

#: What a message service subscribes to, besides the events of its mask (reference section 4.9).
ALARM_SUBSCRIPTIONS: Final = CodeTable(
    "S7 alarm subscription",
    2,
    [
        (0, "SCAN abort", ""),
        (1, "SCAN initiate", ""),
        (4, "ALARM abort", ""),
        (5, "ALARM initiate", ""),
        (6, "AR_SEND abort", ""),
        (7, "AR_SEND initiate", ""),
        (8, "ALARM_S abort", ""),
        (9, "ALARM_S initiate", ""),
    ],
)

ALARM_TYPES: Final = CodeTable("S7 alarm type", 2, [(1, "SCAN", ""), (2, "ALARM_8", ""), (4, "ALARM_S", "")])

ALARM_QUERIES: Final = CodeTable("S7 alarm query type", 2, [(1, "by alarm type", ""), (3, "by event id", "")])
