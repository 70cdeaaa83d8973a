"""Numbers of tshark's fields in the words of a golden. Written by hand: nothing here comes from the package."""

from __future__ import annotations

from typing import Final

#: Reasons of a DR and of an ER (X.224 13.5.3, 13.12.3).
DISCONNECTS: Final = {
    0: "reason not specified",
    1: "congestion at TSAP",
    3: "address unknown",
    128: "normal disconnect by the session entity",
    130: "connection negotiation failed (proposed classes not supported)",
}
REJECTIONS: Final = {1: "invalid parameter code", 3: "invalid parameter value"}

ROSCTRS: Final = {1: "Job", 2: "Ack", 3: "Ack_Data", 7: "Userdata"}
JOB, ACK, ACK_DATA, USERDATA = ROSCTRS
READ, WRITE, SETUP = 0x04, 0x05, 0xF0
#: Functions whose requests have their own form.
FORMS: Final = {READ: "READ", WRITE: "WRITE", SETUP: "SETUP"}

FUNCTIONS: Final = {
    0x00: "CPU services",
    READ: "Read Var",
    WRITE: "Write Var",
    0x1A: "Request download",
    0x1B: "Download block",
    0x1C: "Download ended",
    0x1D: "Start upload",
    0x1E: "Upload",
    0x1F: "End upload",
    0x28: "PI service",
    0x29: "PLC stop",
    SETUP: "Setup communication",
}

PUSH, REQUEST, RESPONSE = 0, 1, 2
#: Subfunction of the group of security.
PASSWORD: Final = 1
MODE, TEST, CYCLIC, BLOCKS, CPU, SECURITY, PBC, TIME, ROUTING, NC = 0, 1, 2, 3, 4, 5, 6, 7, 0x20, 0x3F
GROUPS: Final = {
    MODE: "mode transition",
    TEST: "programmer commands (test and installation)",
    CYCLIC: "cyclic services",
    BLOCKS: "block functions",
    CPU: "CPU functions",
    SECURITY: "security",
    PBC: "PBC (programmable block communication)",
    TIME: "time functions",
    ROUTING: "data record routing",
    NC: "NC programming (Sinumerik)",
}
# fmt: off
SUBFUNCTIONS: Final = {
    MODE: {0: "STOP", 1: "warm restart", 2: "RUN", 3: "hot restart", 4: "HOLD", 6: "cold restart",
           9: "RUN_R (H system redundant)", 11: "LINK-UP", 12: "UPDATE"},
    TEST: {1: "block status", 2: "variable status", 3: "output ISTACK", 4: "output BSTACK", 5: "output LSTACK",
           6: "time measurement", 7: "force selection", 8: "modify variable", 9: "force", 10: "breakpoint", 11: "exit HOLD",
           12: "memory reset", 13: "disable job", 14: "enable job", 15: "delete job", 16: "read job list", 17: "read job",
           18: "replace job", 19: "block status v2", 22: "flash LED"},
    CYCLIC: {1: "cyclic transfer", 4: "unsubscribe", 5: "change driven transfer", 7: "change driven transfer modify",
             8: "RDREC (read data record)"},
    BLOCKS: {1: "list blocks", 2: "list blocks of type", 3: "get block info"},
    CPU: {1: "read SZL", 2: "message service", 3: "diagnostic message", 5: "ALARM_8 indication", 6: "NOTIFY indication",
          7: "ALARM_8 lock", 8: "ALARM_8 unlock", 9: "SCAN indication", 11: "ALARM ack", 12: "ALARM ack indication",
          13: "ALARM lock indication", 14: "ALARM unlock indication", 16: "AR_SEND indication", 17: "ALARM_SQ indication",
          18: "ALARM_S indication", 19: "ALARM query", 22: "NOTIFY_8 indication"},
    SECURITY: {1: "PLC password", 2: "clear session password"},
    PBC: {1: "BSEND"},
    TIME: {1: "read clock", 2: "set clock", 3: "read clock (following)", 4: "set clock (second form)"},
    ROUTING: {1: "DRR init", 2: "DRR finish", 3: "DRR data"},
    NC: {1: "request download", 2: "download block", 3: "continue download", 4: "download ended", 6: "start upload",
         7: "upload", 8: "continue upload"},
}
# fmt: on

BLOCK_TYPES: Final = {
    "08": "OB",
    "09": "CMod",
    "0A": "DB",
    "0B": "SDB",
    "0C": "FC",
    "0D": "SFC",
    "0E": "FB",
    "0F": "SFB",
}
FILE_SYSTEMS: Final = {"A": "active", "B": "active and passive", "P": "passive"}

# ---- items ----------------------------------------------------------------------------------------------------------

S7ANY: Final = 0x10
BIT, CHAR = 1, 3
REALS: Final = {8: ">f", 48: ">d"}
#: Type, letter of its width, how one element is packed (empty: as octets), data transport size of the answer.
TYPES: Final = {
    BIT: ("BIT", "X", "?", 3),
    2: ("BYTE", "B", "B", 4),
    CHAR: ("CHAR", "B", "", 9),
    4: ("WORD", "W", ">H", 4),
    5: ("INT", "W", ">h", 5),
    6: ("DWORD", "D", ">I", 4),
    7: ("DINT", "D", ">i", 5),
    8: ("REAL", "D", ">f", 7),
    9: ("DATE", "W", "", 4),
    10: ("TOD", "D", "", 4),
    11: ("TIME", "D", "", 4),
    12: ("S5TIME", "W", "", 4),
    15: ("DATE_AND_TIME", "L", "", 4),
    19: ("WCHAR", "W", "", 9),
    28: ("COUNTER", "", "", 9),
    29: ("TIMER", "", "", 9),
    30: ("IEC_TIMER/COUNTER", "", "", 4),
    31: ("IEC_COUNTER/TIMER", "", "", 4),
    32: ("HS_COUNTER", "B", "", 4),
    48: ("LREAL", "L", ">d", 4),
}
SIZES: Final = {3: "BIT", 4: "BYTE/WORD/DWORD", 5: "INTEGER", 6: "DINTEGER", 7: "REAL", 9: "OCTET_STRING"}
RECORD_AREA, DB_AREA, DI_AREA = 0x01, 0x84, 0x85
LETTERS: Final = {0x80: "P", 0x81: "I", 0x82: "Q", 0x83: "M", 0x86: "L", 0x87: "V"}
#: Areas of numbers, and areas without a letter.
NUMBERED: Final = {0x1C: "C", 0x1D: "T", 0x1E: "C200:", 0x1F: "T200:"}
NAMED: Final = {0x00: "RAW", 0x03: "SI200", 0x05: "SF200", 0x06: "AI200", 0x07: "AO200"}
