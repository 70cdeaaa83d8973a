"""Which answer belongs to which request: reused references, requests from both ends, unsolicited messages."""

from __future__ import annotations

from captures.craft.case import Case, crafts
from captures.craft.pdus import (
    DOWNLOAD_BLOCK,
    DOWNLOAD_ENDED,
    MODE,
    PI_SERVICE,
    PUSH,
    READ,
    REQUEST_DOWNLOAD,
    USERDATA,
    ack_data,
    ask,
    dt,
    job,
    pattern,
    read_bytes,
    s7,
    tell,
    userdata_item,
    values,
)
from captures.craft.talk import CLIENT, SERVER, Talk
from dissect.layers import (
    S7_USEND,
    S7_DataItem,
    S7_ModeTransition,
    S7_USENDData,
    S7_UserdataExtended,
    S7_UserdataShort,
)

BLOCK = b"_0A00001P"


@crafts(
    "PDU references: the same in every job, 0, wrapped at 65535, answered in another order, one number for a job "
    "and for userdata at once, used again while open with another request and with the same, an answer that comes "
    "twice."
)
def references(case: Case) -> None:
    talk = Talk(case)
    talk.begin()
    for number in (0x0500, 0x0500, 0x0500, 0, 0xFFFE, 0xFFFF, 0, 1):
        talk.exchange(READ, read_bytes(number, 2), values(number, number.to_bytes(2, "big")))
    for number in (1, 2, 3):
        talk.send(CLIENT, dt(read_bytes(number, 2)))
    for number in (3, 1, 2):
        talk.send(SERVER, dt(values(number, b"\x00\x01")))
    case.pair(READ, READ, READ)
    # A job and a userdata request with the same number, answered in reverse order.
    talk.send(CLIENT, dt(read_bytes(7, 2)))
    talk.send(CLIENT, dt(ask(7, 7, 1)))
    talk.send(SERVER, dt(tell(7, 7, 1, pattern(10))))
    talk.send(SERVER, dt(values(7, b"\x00\x07")))
    case.pair(READ, USERDATA)
    # Another request with a number that is still open, as two jobs may have: the answer matches only one of them.
    talk.send(CLIENT, dt(read_bytes(8, 2)))
    case.unanswered(READ, "connection_closed")
    case.find("transaction.unanswered")
    talk.exchange(READ, read_bytes(8, 4), values(8, pattern(4)))
    # The same request three times, as new octets: each gets its answer.
    for _ in range(3):
        talk.send(CLIENT, dt(read_bytes(9, 2)))
    for _ in range(3):
        talk.send(SERVER, dt(values(9, b"\x00\x09")))
    case.pair(READ, READ, READ)
    # The same answer again, as new octets.
    talk.exchange(READ, read_bytes(10, 2), values(10, b"\x00\x0a"))
    talk.send(SERVER, dt(values(10, b"\x00\x0a")))
    case.orphan(READ)
    case.find("transaction.orphan")
    case.pause(1_100)
    # A system status list in two parts: each part is requested, the second with its own number.
    szl = pattern(60)
    talk.exchange(
        USERDATA,
        ask(11, 4, 1, b"\x00\x00\x00\x00"),
        tell(11, 4, 1, szl[:40], sequence=3, data_unit_ref=0xD5, last_data_unit=1),
    )
    follow_up = S7_UserdataExtended(type=1, group=4, subfunction=1, sequence=3, data=[userdata_item(b"")])
    talk.exchange(USERDATA, s7(12, follow_up), tell(12, 4, 1, szl[40:], sequence=3, data_unit_ref=0xD5))
    case.find("session.shared_reference")
    case.find("operation.wrong_size")  # its head, any octets, states more
    talk.close()


@crafts(
    "A download: the PLC asks the client for the block, with the references the client uses at the same time for "
    "its own reads. Then BSEND from both ends, with one number."
)
def plc_asks(case: Case) -> None:
    talk = Talk(case)
    talk.begin()
    name = bytes(7) + b"\x09" + BLOCK
    lengths = b"\x0d1000216000088"
    talk.exchange(
        REQUEST_DOWNLOAD,
        job(0x0165, REQUEST_DOWNLOAD, b"\x00\x01\x00\x00\x00\x00\x00\x09" + BLOCK + lengths),
        ack_data(0x0165, REQUEST_DOWNLOAD),
    )
    for number, more in ((0x0165, 1), (0x0167, 1), (0x0169, 0)):
        # The client's read and the PLC's job are open together; first the client answers, then the PLC.
        talk.send(CLIENT, dt(read_bytes(number, 2)))
        talk.send(SERVER, dt(job(number, DOWNLOAD_BLOCK, name)))
        piece = pattern(70)
        data = len(piece).to_bytes(2, "big") + b"\x00\xfb" + piece
        talk.send(CLIENT, dt(ack_data(number, DOWNLOAD_BLOCK, bytes([more]), data)))
        talk.send(SERVER, dt(values(number, b"\x00\x01")))
        case.pair(READ, DOWNLOAD_BLOCK)
    talk.exchange(DOWNLOAD_ENDED, job(0x0165, DOWNLOAD_ENDED, name), ack_data(0x0165, DOWNLOAD_ENDED), asking=SERVER)
    insert = bytes(6) + b"\xfd\x00\x0a\x01\x00" + BLOCK[1:] + b"\x05_INSE"
    talk.exchange(PI_SERVICE, job(0x0200, PI_SERVICE, insert), ack_data(0x0200, PI_SERVICE))
    # BSEND: whoever sends, the other answers.
    send = b"\x12\x06\x13\x00" + b"\x00\x00\x00\x01" + b"\x00\x04data"
    talk.send(CLIENT, dt(bsend(0x0300, send)))
    talk.send(SERVER, dt(bsend(0x0300, send)))
    talk.send(CLIENT, dt(tell(0x0300, 6, 1)))
    talk.send(SERVER, dt(tell(0x0300, 6, 1)))
    case.pair(USERDATA, USERDATA)
    case.find("security.program_change", 2)  # the download, _INSE
    case.find("operation.wrong_size")  # three pieces of 70 octets are not 216
    talk.close()


def bsend(number: int, payload: bytes) -> bytes:
    """A BSEND, whose request has the extended head."""
    return s7(number, S7_UserdataExtended(type=1, group=6, subfunction=1, data=[userdata_item(payload)]))


@crafts(
    "Messages nobody asks for, all with reference 0, among jobs with reference 0: mode transition, diagnostic "
    "message, alarm, cyclic data, variable status, USEND."
)
def pushes(case: Case) -> None:
    case.find("operation.stray_push")
    case.find("security.mode_changed")
    case.find("security.stopped")
    talk = Talk(case)
    talk.begin()
    stamp = bytes.fromhex("2311142215306213")
    alarm = stamp + bytes.fromhex("0001120a1601000000c201000000ff040010002a")
    variable = bytes.fromhex("0004000800000000") + bytes.fromhex("0001ff040010002a")
    messages = [
        (MODE, s7(0, S7_ModeTransition(mode=0))),
        (MODE, s7(0, S7_ModeTransition(mode=2))),
        (USERDATA, short_push(4, 3, bytes.fromhex("4304ff840000000000000000") + stamp)),
        (USERDATA, short_push(4, 5, alarm)),
        (USERDATA, tell(0, 2, 1, bytes.fromhex("0001ff04001000aa"), kind=PUSH, sequence=4)),
        (USERDATA, tell(0, 2, 5, bytes.fromhex("0001ff04001000ab"), kind=PUSH, sequence=5)),
        (USERDATA, tell(0, 1, 2, variable, kind=PUSH, sequence=2)),
        (USERDATA, usend()),
    ]
    for function, message in messages:
        talk.send(CLIENT, dt(read_bytes(0, 2)))
        talk.send(SERVER, dt(message))
        case.push(function)
        talk.send(SERVER, dt(values(0, b"\x00\x01")))
        case.pair(READ)
    talk.close()


def short_push(group: int, subfunction: int, payload: bytes) -> bytes:
    """A push with the short head."""
    return s7(0, S7_UserdataShort(type=PUSH, group=group, subfunction=subfunction, data=[userdata_item(payload)]))


def usend() -> bytes:
    """A USEND: its R_ID is where others have the extended head."""
    return s7(0, S7_USEND(r_id=1, data=[S7_USENDData(), S7_DataItem(transport_size=9, octets=b"ab")]))
