"""Each row of the tables at least once, in conversations without faults: docs/coverage.md counts them.

Payloads are written as hexadecimal digits, as in the protocol reference; blanks only group the octets.
"""

from __future__ import annotations

from captures.craft.case import Case, crafts
from captures.craft.iso import tpkt
from captures.craft.pdus import (
    DOWNLOAD_BLOCK,
    DOWNLOAD_ENDED,
    NO_FUNCTION,
    OCTET_STRING,
    PI_SERVICE,
    PLC_STOP,
    READ,
    REQUEST_DOWNLOAD,
    USERDATA,
    WRITE,
    ack,
    ack_data,
    dt,
    job,
    s7,
    written,
)
from captures.craft.talk import CLIENT, SERVER, Talk
from captures.craft.worked import END_UPLOAD, START_UPLOAD, UPLOAD
from dissect.layers import (
    COTP_CC,
    COTP_CR,
    COTP_ER,
    COTP_Parameter,
    S7_Any,
    S7_DataItem,
    S7_ReadVarAnswer,
    S7_ReadVarRequest,
    S7_WriteDataItem,
    S7_WriteVarRequest,
)
from dissect.protocols.iso.tables import PARAMETERS
from dissect.protocols.s7.services import BLOCK_SERVICES, NC_PREFIX, PI_SERVICES
from dissect.protocols.s7.tables import (
    ANSWER_TRANSPORT_SIZE,
    AREAS,
    BLOCK_TYPES,
    DB_AREAS,
    ELEMENT_OCTETS,
    LENGTH_IN_BITS,
    RETURN_CODES,
    TRANSPORT_SIZES,
)

# ---- COTP -----------------------------------------------------------------------------------------------------------

#: A value of each parameter, except the three parameters that everyone sends.
COTP_VALUES = {
    0x08: "00000000", 0x09: "0000", 0x85: "03e8", 0x86: "03040a", 0x87: "0000", 0x88: "000a 0014 000a 0014",
    0x89: "0003e8 000064 0003e8 000064", 0x8A: "0001", 0x8B: "001e", 0x8C: "00000001 0001 0004", 0xC3: "0000",
    0xC4: "01", 0xC5: "73", 0xC6: "01", 0xC7: "00", 0xE0: "66756c6c", 0xF0: "08", 0xF2: "00007530",
}  # fmt: skip


@crafts("Every parameter of COTP in a CR, in its CC, and in an ER as far as it may stand there.")
def coverage_cotp(case: Case) -> None:
    known = [
        COTP_Parameter.tpdu_size(1024),
        COTP_Parameter.calling("01.00"),
        COTP_Parameter.called("01.02"),
    ]
    others = [COTP_Parameter(code=code, value=bytes.fromhex(text)) for code, text in COTP_VALUES.items()]
    missing = {row.number for row in PARAMETERS} - {one.code for one in known + others}
    if missing:
        message = f"give a value of COTP parameters {sorted(missing)}"
        raise ValueError(message)
    talk = Talk(case)
    talk.open()
    talk.send(CLIENT, tpkt(COTP_CR(src_ref=1, parameters=known + others)))
    talk.send(SERVER, tpkt(COTP_CC(dst_ref=1, src_ref=0x4431, parameters=known + others)))
    talk.setup()
    talk.poll()
    talk.close()
    talk = Talk(case, client_port=49153)
    talk.open()
    refused = COTP_CR(src_ref=2, class_=0, parameters=[*known, COTP_Parameter(code=0x99, value=b"\x01")])
    talk.send(CLIENT, tpkt(refused))
    rejected = bytes(refused)[: bytes(refused).index(b"\x99") + 1]
    talk.send(SERVER, tpkt(COTP_ER(dst_ref=2, cause=1, parameters=[COTP_Parameter(code=0xC1, value=rejected)])))
    talk.close(SERVER)
    case.find("cotp.error")


# ---- jobs -----------------------------------------------------------------------------------------------------------

DOWNLOADED, UPLOADED = "P", "A"
MC7 = bytes.fromhex(
    "7070 0101 050a 0001 00000064 00000000 0239 5d992d70 03a1 638321a7 0000 0000 0000 0040".replace(" ", "")
) + bytes(64)
"""A block of 100 octets: its header, then its content."""


@crafts(
    "Every function as a job and its answer, with blocks of every type loaded and read out, every PI service with "
    "its arguments, and the answer without parameters and data."
)
def coverage_functions(case: Case) -> None:
    talk = Talk(case)
    talk.begin()
    for kind in BLOCK_TYPES:
        download(talk, kind)
    for kind in BLOCK_TYPES:
        upload(talk, kind)
    for name in PI_SERVICES:
        start(talk, name)
    stop = bytes(5) + text_of("P_PROGRAM")
    number = talk.next_ref()
    talk.exchange(PLC_STOP, job(number, PLC_STOP, stop), ack_data(number, PLC_STOP))
    number = talk.next_ref()
    talk.exchange(USERDATA, job(number, USERDATA), ack_data(number, USERDATA, error=0x8104))
    number = talk.next_ref()
    talk.send(CLIENT, dt(job(number, PI_SERVICE, bytes.fromhex("000000000000fd") + bytes(2) + text_of("_FREE"))))
    talk.send(SERVER, dt(ack(number, 0x8104)))
    case.pdu(PI_SERVICE, NO_FUNCTION)
    case.counts["answered"] += 1
    case.count(header_errors=2)
    case.find("transaction.refused", 2)
    case.find("security.program_change", len(BLOCK_TYPES) + len(BLOCK_SERVICES))
    case.find("security.program_read", len(BLOCK_TYPES))
    # Only DB 1 is linked in on this connection, by the PI services below; system data need not be.
    case.find("block.not_activated", len(BLOCK_TYPES) - 2)
    case.find("security.memory", 2)  # _MODU, _GARB
    case.find("security.plc_start")
    case.find("security.plc_stop")
    commands = [one for name, one in PI_SERVICES.items() if name.startswith(NC_PREFIX) and one.effect != "read"]
    case.find("security.nc_command", len(commands))
    case.find("security.unknown_service")  # _FREE
    talk.close()


def text_of(text: str) -> bytes:
    """A text with its length before it."""
    return bytes([len(text)]) + text.encode("ascii")


def named(kind: str, system: str) -> bytes:
    """The file name of block 1 of a type, with its length."""
    return text_of(f"_{kind}00001{system}")


def download(talk: Talk, kind: str) -> None:
    """A block goes to the PLC, which requests it piece by piece."""
    name = bytes(6) + named(kind, DOWNLOADED)
    number = talk.next_ref()
    asked = job(
        number, REQUEST_DOWNLOAD, bytes.fromhex("00010000000000") + named(kind, DOWNLOADED) + text_of("1000100000064")
    )
    talk.exchange(REQUEST_DOWNLOAD, asked, ack_data(number, REQUEST_DOWNLOAD))
    for more, piece in ((1, MC7[:60]), (0, MC7[60:])):
        number = talk.next_ref()
        given = len(piece).to_bytes(2, "big") + b"\x00\xfb" + piece
        answer = ack_data(number, DOWNLOAD_BLOCK, bytes([more]), given)
        talk.exchange(DOWNLOAD_BLOCK, job(number, DOWNLOAD_BLOCK, b"\x00" + name), answer, SERVER)
    number = talk.next_ref()
    ended = job(number, DOWNLOAD_ENDED, b"\x00" + name)
    talk.exchange(DOWNLOAD_ENDED, ended, ack_data(number, DOWNLOAD_ENDED), SERVER)


def upload(talk: Talk, kind: str) -> None:
    """A block comes from the PLC in two pieces."""
    session = bytes.fromhex("00000007")
    number = talk.next_ref()
    asked = job(number, START_UPLOAD, bytes(7) + named(kind, UPLOADED))
    length = b"\x00\x01\x00" + session + text_of(f"{len(MC7):07d}")
    talk.exchange(START_UPLOAD, asked, ack_data(number, START_UPLOAD, length))
    for more, piece in ((1, MC7[:60]), (0, MC7[60:])):
        number = talk.next_ref()
        given = len(piece).to_bytes(2, "big") + b"\x00\xfb" + piece
        talk.exchange(UPLOAD, job(number, UPLOAD, bytes(3) + session), ack_data(number, UPLOAD, bytes([more]), given))
    number = talk.next_ref()
    talk.exchange(END_UPLOAD, job(number, END_UPLOAD, bytes(3) + session), ack_data(number, END_UPLOAD))


def start(talk: Talk, name: str) -> None:
    """A PI service with the arguments of its row."""
    if name in BLOCK_SERVICES:
        block = b"\x01\x00" + b"0A00001P"
    elif name.startswith(NC_PREFIX):
        block = b""
        for number in range(len(PI_SERVICES[name].arguments.split(", "))):
            argument = text_of("P01" if number == 0 else f"{number}A")
            block += argument + bytes(len(argument) % 2)
    else:
        block = b"EP" if name == "_MODU" else b""
    number = talk.next_ref()
    parameters = bytes.fromhex("000000000000fd") + len(block).to_bytes(2, "big") + block + text_of(name)
    talk.exchange(PI_SERVICE, job(number, PI_SERVICE, parameters), ack_data(number, PI_SERVICE))


# ---- items ----------------------------------------------------------------------------------------------------------

#: Items other than S7ANY, each with the type in which it is read.
SYNTAXES = (
    ("1208 82 41 0001 0001 7f 01", OCTET_STRING, "4045000000000000"), ("1208 83 02 0003 0004 10 01", OCTET_STRING, "01"),
    ("1208 84 e1 0003 0004 10 01", OCTET_STRING, "01"), ("120a a2 01 0002 0003 0011 0007", OCTET_STRING, "0001"),
    ("120c b0 02 02 0044 0160 01 0048 0030", OCTET_STRING, "ff 0001 ff 7a"),
    ("120e b2 ff 8a0e 0001 11223344 40000009", 4, "002a"), ("1212 b2 ff 0000 0052 11223344 4000000a 50000002", 4, "01"),
)  # fmt: skip


@crafts(
    "Items of every syntax, area and transport size, data items of every transport size, every return code: reads "
    "and writes that are answered."
)
def coverage_items(case: Case) -> None:
    talk = Talk(case)
    talk.begin()
    for row in AREAS:
        number = row.number
        read_item(talk, S7_Any(transport_size=2, count=2, area=number, db=1 if number in DB_AREAS else 0), b"\x00\x2a")
    for row in TRANSPORT_SIZES:
        size = ELEMENT_OCTETS.get(row.number, 2)
        area = row.number if row.number in {0x1C, 0x1D, 0x1E, 0x1F} else 0x83
        asked = S7_Any(transport_size=row.number, count=1, area=area)
        read_item(talk, asked, bytes(size), ANSWER_TRANSPORT_SIZE.get(row.number, OCTET_STRING))
    for text, size, octets in SYNTAXES:
        read_octets(talk, bytes.fromhex(text), size, bytes.fromhex(octets))
    # A DINT in a form that no device was seen to send.
    read_item(talk, S7_Any(transport_size=7, area=0x83), bytes(4), 6)
    errors = [row.number for row in RETURN_CODES if row.number != 0xFF]
    number = talk.next_ref()
    items = [S7_Any(transport_size=2, count=2, area=0x84, db=place) for place in range(1, len(errors) + 2)]
    told = [S7_DataItem(return_code=code, transport_size=0) for code in errors]
    answer = s7(number, S7_ReadVarAnswer(data=[*told, S7_DataItem(octets=b"\x00\x2a")]), rosctr=3)
    talk.exchange(READ, s7(number, S7_ReadVarRequest(items=items)), answer)
    number = talk.next_ref()
    given = [S7_WriteDataItem(octets=b"\x00\x2a") for _ in items]
    talk.exchange(WRITE, s7(number, S7_WriteVarRequest(items=items, data=given)), written(number, *errors, 0xFF))
    case.count(item_errors=2 * len(errors))
    case.find("transaction.item_error", 2 * len(errors))
    case.find("s7.odd_address", 2)  # counters and timers of the 300 family read as octets
    case.find("security.write")
    case.find("security.write_refused")
    talk.close()


def read_item(talk: Talk, asked: S7_Any, octets: bytes, size: int = 4) -> None:
    """Read one item, answered with these octets."""
    number = talk.next_ref()
    length = 1 if size == 3 else 8 * len(octets) if size in LENGTH_IN_BITS else len(octets)
    answer = s7(number, S7_ReadVarAnswer(data=[S7_DataItem(transport_size=size, length=length, octets=octets)]))
    talk.exchange(READ, s7(number, S7_ReadVarRequest(items=[asked])), answer)


def read_octets(talk: Talk, item: bytes, size: int, octets: bytes) -> None:
    """Read one item that is given as octets."""
    number = talk.next_ref()
    length = 8 * len(octets) if size in LENGTH_IN_BITS else len(octets)
    answer = bytes([1, 0xFF, size]) + length.to_bytes(2, "big") + octets
    talk.exchange(READ, job(number, READ, b"\x01" + item), ack_data(number, READ, answer[:1], answer[1:]))
