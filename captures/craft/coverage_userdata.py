"""Each userdata subfunction in every possible direction, and every system status list: docs/coverage.md counts them.

Payloads are written as hexadecimal digits, as in the protocol reference; blanks only group the octets.
"""

from __future__ import annotations

from captures.craft.case import Case, crafts
from captures.craft.pdus import ASKED, MODE, PUSH, TOLD, USERDATA, ask, dt, s7, tell
from captures.craft.talk import CLIENT, SERVER, Talk
from dissect.layers import S7_ModeTransition
from dissect.protocols.s7.szl import record_size
from dissect.protocols.s7.szl_communication import CAPABILITY_RECORDS, STATUS_RECORDS
from dissect.protocols.s7.szl_records import COMPONENT_RECORDS
from dissect.protocols.s7.szl_tables import HEAD_ONLY, SZL_IDS
from dissect.protocols.s7.tables import USERDATA_SUBFUNCTIONS

Row = tuple[int, int, str]
"""Kind, subfunction, payload; no payload is none."""

TIME = "2311142215306213"

# ---- programmer commands --------------------------------------------------------------------------------------------

TRIGGER = "0000 0000 0001 0012 0001 0001 0001 0001 0001 0000"
BLOCK = "000a 0005 0010"
ANSWER = "00000000"
INTERRUPTED = "0008 0001 0022"
DBS = "0a0a 0005 0006"
ACCUS = "00000001 00000002 00000003 00000004"
START = "11 01 01 01 00 00 0001 0002 0003" + TIME
BSTACK = "000c 0002 0004" + DBS + "00000000" + INTERRUPTED + DBS + "00000000" + "01 00 0000" + TIME
ISTACK = (
    "000c 0002 0004" + DBS + "00000000" + ACCUS + "00000010 00000020 0000 00ff" + INTERRUPTED + "0000 00000000" + START
)
LSTACK = INTERRUPTED + "0004 01020304" + "01 00 0000" + TIME


def command(parameters: str, data: str) -> str:
    """The payload of a programmer command: two sizes, two blocks."""
    sizes = "".join(f"{len(bytes.fromhex(block)):04x}" for block in (parameters, data))
    return sizes + parameters + data


PROGRAMMER: tuple[Row, ...] = (
    (ASKED, 0x01, command(TRIGGER + BLOCK, "00 07 00 01 00 02")), (TOLD, 0x01, command(ANSWER, "")),
    (PUSH, 0x01, command(ANSWER, "0010 0001 00000002 0012 0001")),
    (ASKED, 0x02, command(TRIGGER, "0002 0106 0000 0000 1101 0000 0008")), (TOLD, 0x02, command(ANSWER, "")),
    (PUSH, 0x02, command(ANSWER, "0002 ff09 0006 4133851fdead ff09 0001 02 00")),
    (ASKED, 0x03, command(TRIGGER, "0000")), (TOLD, 0x03, command(ANSWER, "")), (PUSH, 0x03, command(ANSWER, ISTACK)),
    (ASKED, 0x04, command(TRIGGER, "0000")), (TOLD, 0x04, command(ANSWER, BSTACK)), (PUSH, 0x04, command(ANSWER, BSTACK)),
    (ASKED, 0x05, command(TRIGGER, "0101")), (TOLD, 0x05, command(ANSWER, LSTACK)), (PUSH, 0x05, command(ANSWER, LSTACK)),
    (ASKED, 0x06, command(TRIGGER, "0000")), (TOLD, 0x06, command(ANSWER, "")), (PUSH, 0x06, command(ANSWER, "0001")),
    (ASKED, 0x07, command(TRIGGER, "0000")), (TOLD, 0x07, command(ANSWER, "")),
    (ASKED, 0x08, command(TRIGGER, "0001 0201 0000 0006 0009 0002 1234")), (TOLD, 0x08, command(ANSWER, "")),
    (PUSH, 0x08, command(ANSWER, "0001 ff 00")),
    (ASKED, 0x09, command(TRIGGER, "0001 7205 000a 0004 0009 000a 00010002000300040005")), (TOLD, 0x09, command(ANSWER, "")),
    (PUSH, 0x09, command(ANSWER, "0002 ff 03")),
    (ASKED, 0x0A, command(TRIGGER + BLOCK, "0000")), (TOLD, 0x0A, command(ANSWER, "")),
    (PUSH, 0x0A, command(ANSWER, INTERRUPTED + "000c 0002 0004 0000 00ff" + ACCUS + DBS)),
    (ASKED, 0x0B, command(TRIGGER, "01 00")), (TOLD, 0x0B, command(ANSWER, "")),
    (ASKED, 0x0C, command(TRIGGER, "")), (TOLD, 0x0C, command(ANSWER, "")),
    (ASKED, 0x0D, command(TRIGGER, "0202")), (TOLD, 0x0D, command(ANSWER, "")),
    (ASKED, 0x0E, command(TRIGGER, "0802")), (TOLD, 0x0E, command(ANSWER, "")),
    (ASKED, 0x0F, command(TRIGGER, "0000 0903")), (TOLD, 0x0F, command(ANSWER, "")),
    (ASKED, 0x10, command(TRIGGER, "00000000")), (TOLD, 0x10, command("01000001", "0202 0100 1003 0000")),
    (ASKED, 0x11, command(TRIGGER, "1304")), (TOLD, 0x11, command(ANSWER, "0014 0008" + TRIGGER + "0001 0201 0000 0006")),
    (ASKED, 0x12, command(TRIGGER, "0000 0202 0014 0008" + TRIGGER + "0001 7005 0003 0007")), (TOLD, 0x12, command(ANSWER, "")),
    (ASKED, 0x13, command(TRIGGER + BLOCK + "0003", "01 01 00 7f 0010 00 07")), (TOLD, 0x13, command(ANSWER, "")),
    (PUSH, 0x13, command(ANSWER, "0010 0001 00000002 0012 0001")),
    (ASKED, 0x16, command(TRIGGER, "0001")), (TOLD, 0x16, command(ANSWER, "")),
)  # fmt: skip

# ---- cyclic services, blocks ----------------------------------------------------------------------------------------

ITEM = "120a10020002000784000000"
VALUE = "ff04001000aa"

CYCLIC: tuple[Row, ...] = (
    (ASKED, 1, "00010101" + ITEM), (TOLD, 1, "0001" + VALUE), (PUSH, 1, "0001" + VALUE),
    (ASKED, 5, "00010005" + ITEM), (TOLD, 5, "0001" + VALUE), (PUSH, 5, "0001" + VALUE),
    (ASKED, 7, "00010202" + ITEM), (TOLD, 7, "0001" + VALUE), (PUSH, 7, "0001" + VALUE),
    (ASKED, 4, "0504"), (TOLD, 4, ""),
    (ASKED, 8, "0001120a10020064000501000100"), (TOLD, 8, "0001ff0900000003010203"),
)  # fmt: skip

INFO = (
    "0100 004a 2200 7070 01 01 05 0a 0001 000000d8 00000000 02395d992d70 03a1638321a7 0038 0000 0000 0058"
    "415554484f522020 46414d494c592020 4845414445522020 01 00 63cc 00000000 00000000"
)

BLOCKS: tuple[Row, ...] = (
    (ASKED, 1, ""), (TOLD, 1, "30380002 30410011"),
    (ASKED, 2, "3041"), (TOLD, 2, "00012205 00072205"),
    (ASKED, 3, "3041 3030303031 41"),
    (
        TOLD, 3, INFO,
    ),
)  # fmt: skip

# ---- CPU functions --------------------------------------------------------------------------------------------------

USER = "5553455231000000"
SIGNAL = "ff040010002a"
MESSAGE = "120a16 01 000000c2 01 00 00 00" + SIGNAL
NOTIFICATION = "120e1c 00 000000c3 05 00 ff fe 02 04 06 00"
ACKNOWLEDGED = "120819 00 60000001 01 01"
LOCKED = "120615 00 60000001"
EVENT = "4302 ff 68 c701 0000 14010802" + TIME

CPU: tuple[Row, ...] = (
    (ASKED, 1, "0011 0000"), (TOLD, 1, "0011 0000 001c 0001 0001 36455337203331352d32454831342d3041423020 00c0 0003 0001"),
    (ASKED, 2, "8300" + USER + "0900"), (TOLD, 2, "0200090100"),
    (ASKED, 2, "8000" + USER + "0701 12061300 00000005"), (TOLD, 2, "0200 0701 ff 00"),
    (PUSH, 0x03, EVENT),
    (PUSH, 0x05, TIME + "4001" + MESSAGE), (PUSH, 0x06, TIME + "4001" + NOTIFICATION),
    (ASKED, 0x07, "0901" + LOCKED), (TOLD, 0x07, "0901ff"),
    (ASKED, 0x08, "0901" + LOCKED), (TOLD, 0x08, "0901ff"),
    (PUSH, 0x09, "0001" + TIME + "0002 4001" + MESSAGE),
    (ASKED, 0x0B, "0901" + ACKNOWLEDGED), (TOLD, 0x0B, "0901ff"),
    (PUSH, 0x0C, TIME + "0901" + ACKNOWLEDGED),
    (PUSH, 0x0D, "0901" + LOCKED), (PUSH, 0x0E, "0901" + LOCKED),
    (PUSH, 0x10, "12061300 00000005 0400 01020304"),
    (PUSH, 0x11, TIME + "4001 120a16 00 000000c2 00 00 00 00"), (PUSH, 0x12, TIME + "4001" + MESSAGE),
    (ASKED, 0x13, "0001 12081a00 01 34 00000004"),
    (
        TOLD, 0x13,
        "0001ff090028" + "29 0000 04 60000001 00 01 ff fe" + TIME + SIGNAL + "0000000000000000" + SIGNAL,
    ),
    (PUSH, 0x16, TIME + "4001" + NOTIFICATION),
)  # fmt: skip

# ---- security, PBC, time, record routing, NC ------------------------------------------------------------------------

SECURITY: tuple[Row, ...] = ((ASKED, 1, "1110090a6d6d0b0c"), (TOLD, 1, ""), (ASKED, 2, ""), (TOLD, 2, ""))
PBC: tuple[Row, ...] = ((ASKED, 1, "12 06 13 00 00000001 0004 cafe0001"), (TOLD, 1, ""))
CLOCK: tuple[Row, ...] = (
    (ASKED, 1, ""), (TOLD, 1, "0019" + TIME),
    (ASKED, 2, "0019" + TIME), (TOLD, 2, ""),
    (ASKED, 3, ""), (TOLD, 3, "0019" + TIME),
    (ASKED, 4, "0019" + TIME), (TOLD, 4, ""),
)  # fmt: skip
ROUTING: tuple[Row, ...] = (
    (ASKED, 1, "0001"), (TOLD, 1, "0001"), (ASKED, 3, "0001"), (TOLD, 3, "0001"), (ASKED, 2, "0001"), (TOLD, 2, "0001"),
)  # fmt: skip
FILE = b"/_N_MPF_DIR/_N_FILE_MPF".hex()
PIECE = "00fb" + b"      3520110914 1200000;$PATH=/_N_MPF_DIR\r\nG00 X0 Y0 M30\r\n".hex()
NC: tuple[Row, ...] = (
    (ASKED, 1, FILE), (TOLD, 1, "0300"), (PUSH, 2, PIECE), (TOLD, 2, "00fb"), (PUSH, 3, "0300"), (ASKED, 4, "0000"),
    (TOLD, 4, "0000"), (ASKED, 6, "0300" + FILE), (TOLD, 6, PIECE), (PUSH, 7, PIECE), (TOLD, 7, "00fb"),
    (PUSH, 8, "0300"),
)  # fmt: skip
PIECES = {(0x3F, 2), (0x3F, 7)}
"""Group and subfunction of what is a push and gets an answer."""
FROM_CLIENT = {(0x3F, PUSH, 2), (0x3F, TOLD, 7), (0x3F, PUSH, 8)}
"""Group, kind and subfunction of what is no request and comes from the client: a file goes to the NC as pushes."""


@crafts(
    "Every userdata subfunction in each direction it has: mode transitions, programmer commands, cyclic services, "
    "blocks, SZL and messages, security, BSEND, clock, record routing, NC programming."
)
def coverage_userdata(case: Case) -> None:
    talk = Talk(case)
    talk.begin()
    for mode in USERDATA_SUBFUNCTIONS[0]:
        talk.send(SERVER, dt(s7(0, S7_ModeTransition(mode=mode.number))))
        case.push(MODE)
    for group, rows in (
        (1, PROGRAMMER), (2, CYCLIC), (3, BLOCKS), (4, CPU), (5, SECURITY), (6, PBC), (7, CLOCK), (0x20, ROUTING), (0x3F, NC),
    ):  # fmt: skip
        for row in rows:
            say(talk, group, row)
    # Answers to pushes: a piece of a file is a push and gets an answer, so there is no request for them.
    case.find("transaction.orphan", 2)
    case.find("transaction.item_error")  # a force job reports that it may not access its second item
    case.find("operation.stray_push")  # the first mode transition: no client has subscribed to messages yet
    for slug in (
        "stopped", "alarm_change", "debug", "flash_led", "memory", "password", "program_change", "program_read",
        "reconnaissance",
    ):  # fmt: skip
        case.find(f"security.{slug}")
    case.find("security.clock_set", 2)
    case.count(item_errors=1)  # a pushed job with one refused variable
    case.find("security.force", 3)  # modify variable, force, replace job
    case.find("security.mode_changed", len(USERDATA_SUBFUNCTIONS[0]) - 1)  # all but STOP
    talk.close()


def say(talk: Talk, group: int, row: Row) -> None:
    """Send one PDU: a request with a new reference, its answer with the same one, a push with none."""
    kind, subfunction, payload = row
    octets = bytes.fromhex(payload)
    side = CLIENT if (group, kind, subfunction) in FROM_CLIENT else SERVER
    if kind == ASKED:
        talk.send(CLIENT, dt(ask(talk.next_ref(), group, subfunction, octets)))
        talk.case.pair(USERDATA)
    elif kind == TOLD:
        talk.send(side, dt(tell(talk.pdu_ref, group, subfunction, octets, sequence=1)))
        if (group, subfunction) in PIECES:
            talk.case.orphan(USERDATA)
    else:
        talk.send(side, dt(tell(0, group, subfunction, octets, kind=PUSH, sequence=1)))
        talk.case.push(USERDATA)


# ---- system status lists --------------------------------------------------------------------------------------------


@crafts("Every system status list by its id, with two records where they are known, or with its head alone.")
def coverage_szl(case: Case) -> None:
    talk = Talk(case)
    talk.begin(pdu_length=960)
    for szl_id in sorted({row.number for row in SZL_IDS} | set(FURTHER)):
        number = talk.next_ref()
        request = ask(number, 4, 1, szl_id.to_bytes(2, "big") + bytes(2))
        answer = tell(number, 4, 1, status_list(szl_id, records_of(szl_id)), sequence=1)
        talk.exchange(USERDATA, request, answer)
    case.find("security.reconnaissance")
    talk.close()


FURTHER = (0x0025,)
"""Ids of lists that the table of ids does not have."""
STATIONS = {0x92: 18, 0x94: 258}
"""Octets of a record by partial list where they hold an index and a bit for each station."""


def records_of(szl_id: int) -> list[bytes]:
    """The records of a list: two, or one of each kind."""
    if szl_id >> 8 & 0xF == HEAD_ONLY:
        return []
    partial = szl_id & 0xFF
    if partial in STATIONS:
        return [bytes(STATIONS[partial])]
    indexed = {0x1C: COMPONENT_RECORDS, 0x31: CAPABILITY_RECORDS, 0x32: STATUS_RECORDS}.get(partial)
    size = record_size(szl_id) or 16
    if indexed is not None:
        return [index.to_bytes(2, "big") + bytes(size - 2) for index in indexed]
    return [number.to_bytes(2, "big") + bytes(size - 2) for number in (1, 2)]


def status_list(szl_id: int, records: list[bytes]) -> bytes:
    """The payload of an answer; the records of a list have one size."""
    size = len(records[0]) if records else record_size(szl_id) or 16
    numbers = (szl_id, 0, size, len(records))
    return b"".join(number.to_bytes(2, "big") for number in numbers) + b"".join(records)
