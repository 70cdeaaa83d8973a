"""S7 PDUs whose lengths and counts are not those of their octets, and answers that do not fit their requests."""

from __future__ import annotations

from collections.abc import Callable

from captures.craft.case import Case, crafts
from captures.craft.pdus import (
    NO_FUNCTION,
    OCTET_STRING,
    PLC_STOP,
    READ,
    USERDATA,
    WRITE,
    ack,
    ack_data,
    ask,
    dt,
    job,
    pattern,
    read,
    read_bytes,
    s7,
    tell,
    values,
    write,
    written,
)
from captures.craft.talk import CLIENT, SERVER, Talk
from dissect.layers import (
    S7,
    S7_Any,
    S7_DataItem,
    S7_OtherItem,
    S7_ReadVarAnswer,
    S7_ReadVarRequest,
    S7_WriteDataItem,
    S7_WriteVarRequest,
    at,
)

GOOD = b"\x00\x01"


@crafts(
    "S7 lengths and counts that lie: parameter and data length, item count, item length, data item length, in "
    "requests and answers; a PDU that ends inside its header. Every one with a readable header is still paired."
)
def s7_lengths(case: Case) -> None:
    case.find("security.write")
    talk = Talk(case)
    talk.begin()

    def bad_request(make: Callable[[int], bytes], function: int = READ, items: int = 1) -> None:
        number = talk.next_ref()
        good = values(number, GOOD) if function == READ else written(number, *[0xFF] * items)
        talk.exchange(function, make(number), good)
        case.find("s7.malformed")

    def bad_answer(make: Callable[[int], bytes]) -> None:
        number = talk.next_ref()
        talk.exchange(READ, read_bytes(number, 2), make(number))
        case.find("s7.malformed")

    item = at("DB1.DBB0", 2)
    one = S7_DataItem(octets=GOOD)
    # Requests: the header's lengths.
    bad_request(lambda number: s7(number, S7_ReadVarRequest(items=[item]), param_length=200))
    bad_request(lambda number: s7(number, S7_ReadVarRequest(items=[item]), param_length=13))
    bad_request(lambda number: s7(number, S7_ReadVarRequest(items=[item]), data_length=10))
    bad_request(lambda number: s7(number, S7_ReadVarRequest(items=[item]), param_length=0xFFFF, data_length=0xFFFF))
    bad_request(lambda number: read_bytes(number, 2) + b"\x00\x00\x00")
    # Requests: counts and lengths of items.
    bad_request(lambda number: s7(number, S7_ReadVarRequest(item_count=5, items=[item])))
    bad_request(lambda number: s7(number, S7_ReadVarRequest(items=[S7_OtherItem(length=0, syntax_id=0x10)])))
    bad_request(lambda number: s7(number, S7_ReadVarRequest(items=[S7_Any(length=200)])))
    # Writes whose data is not what the items announce: less items, more octets than there are.
    data = S7_WriteDataItem(octets=GOOD)
    bad_request(lambda number: s7(number, S7_WriteVarRequest(items=[item, item], data=[data])), WRITE, 2)
    lying = S7_WriteDataItem(length=0x4000, octets=GOOD)
    bad_request(lambda number: s7(number, S7_WriteVarRequest(items=[item], data=[lying])), WRITE)
    # Answers: the header's lengths, the item count, the length of a data item.
    bad_answer(lambda number: s7(number, S7_ReadVarAnswer(data=[one]), data_length=300))
    bad_answer(lambda number: s7(number, S7_ReadVarAnswer(data=[one]), data_length=3))
    bad_answer(lambda number: s7(number, S7_ReadVarAnswer(data=[one]), param_length=100))
    bad_answer(lambda number: s7(number, S7_ReadVarAnswer(data=[S7_DataItem(length=0xFFFF, octets=GOOD)])))
    case.find("transaction.size_mismatch")
    bad_answer(lambda number: s7(number, S7_ReadVarAnswer(data=[one, S7_DataItem(octets=b"")], item_count=1)))
    # A PDU that ends inside its header.
    talk.send(CLIENT, dt(read_bytes(talk.next_ref(), 2)[:8]))
    case.pdu(NO_FUNCTION)
    case.find("s7.malformed")
    # An item count of 0 is no contradiction when nothing follows.
    number = talk.next_ref()
    talk.exchange(READ, s7(number, S7_ReadVarRequest()), s7(number, S7_ReadVarAnswer()))
    talk.poll(2)
    talk.close()
    case.tshark_shows(38, "a PDU that ends inside its header is none to it")


@crafts(
    "Answers that are sound and do not fit their requests: another number of items, another size, another "
    "function or userdata group; a kind of PDU that does not exist."
)
def s7_mismatches(case: Case) -> None:
    case.find("security.write")
    talk = Talk(case)
    talk.begin()
    number = talk.next_ref()
    talk.exchange(READ, read(number, "DB1.DBW0", "DB1.DBW2"), values(number, GOOD))
    case.find("transaction.count_mismatch")
    number = talk.next_ref()
    talk.exchange(READ, read(number, "DB1.DBW0"), values(number, GOOD, GOOD))
    case.find("transaction.count_mismatch")
    number = talk.next_ref()
    items = [at("DB1.DBW0"), at("DB1.DBW2")]
    data = [S7_WriteDataItem(octets=GOOD), S7_WriteDataItem(octets=GOOD)]
    talk.exchange(WRITE, s7(number, S7_WriteVarRequest(items=items, data=data)), written(number, 0xFF))
    case.find("transaction.count_mismatch")
    case.count(item_errors=1)  # nothing says whether the second item was written, nor that it was refused
    number = talk.next_ref()
    talk.exchange(READ, read_bytes(number, 4), values(number, GOOD))
    case.find("transaction.size_mismatch")
    number = talk.next_ref()
    talk.exchange(READ, read(number, "DB1.DBW0", "MD4"), values(number, GOOD, pattern(6)))
    case.find("transaction.size_mismatch")
    # A read answered as a write, and a write as a read.
    for request, answer, functions in (
        (read_bytes, written, (READ, WRITE)),
        (lambda number, _: write(number, GOOD), lambda number: values(number, GOOD), (WRITE, READ)),
    ):
        number = talk.next_ref()
        talk.send(CLIENT, dt(request(number, 2)))
        talk.send(SERVER, dt(answer(number)))
        case.pdu(*functions)
        case.count(answered=1)
        case.find("transaction.function_mismatch")
    # The clock asked for, a block list told.
    number = talk.next_ref()
    talk.exchange(USERDATA, ask(number, 7, 1), tell(number, 3, 1, bytes(4)))
    case.find("transaction.function_mismatch")
    # ROSCTR 4, 5 and 6 name nothing.
    for rosctr in (4, 5, 6):
        talk.send(CLIENT, dt(s7(talk.next_ref(), S7_ReadVarRequest(items=[at("MB0")]), rosctr=rosctr)))
        case.pdu(NO_FUNCTION)
        case.find("s7.unknown_rosctr")
    talk.poll()
    talk.close()
    case.table("rosctr", **{"1": 9, "3": 9, "4": 1, "5": 1, "6": 1, "7": 2})


@crafts(
    "Every way a PLC says no: item by item in reads and writes, in the header of an Ack_Data with and without "
    "items, in an Ack, in the parameters of userdata. None of it is malformed."
)
def refusals(case: Case) -> None:
    talk = Talk(case)
    talk.begin()
    refuse_items(case, talk)
    refuse_all(case, talk)
    # 0x0A in the data of a clock that was set is no error.
    number = talk.next_ref()
    talk.exchange(USERDATA, ask(number, 7, 2, bytes.fromhex("00202402291200000005")), tell(number, 7, 2))
    # An Ack that says nothing is wrong is an answer.
    number = talk.next_ref()
    talk.send(CLIENT, dt(write(number, GOOD)))
    talk.send(SERVER, dt(bytes(S7(rosctr=2, pdu_ref=number))))
    case.pdu(WRITE, NO_FUNCTION)
    case.count(answered=1)
    for slug in ("clock_set", "plc_stop", "protected", "write", "write_refused"):
        case.find(f"security.{slug}")
    talk.close()


def refuse_items(case: Case, talk: Talk) -> None:
    # Of four items the second and the fourth; a failed item is its head, whatever its length says.
    number = talk.next_ref()
    answer = S7_ReadVarAnswer(
        data=[
            S7_DataItem(octets=GOOD),
            S7_DataItem(return_code=0x0A, transport_size=0, length=4),
            S7_DataItem(transport_size=OCTET_STRING, octets=b"\x01\x02\x03"),
            S7_DataItem(return_code=0x05, transport_size=0),
        ]
    )
    request = S7_ReadVarRequest(items=[at("DB1.DBW0"), at("DB9.DBW0"), at("DB1.DBB0", 3, "CHAR"), at("MW60000")])
    talk.exchange(READ, s7(number, request), s7(number, answer))
    case.count(item_errors=2)
    case.find("transaction.item_error", 2)
    number = talk.next_ref()
    talk.exchange(WRITE, write(number, GOOD), written(number, 0x03))
    case.count(item_errors=1)
    case.find("transaction.item_error")
    number = talk.next_ref()
    items = [at(f"MW{place}") for place in (0, 2, 4)]
    data = [S7_WriteDataItem(octets=GOOD) for _ in items]
    talk.exchange(WRITE, s7(number, S7_WriteVarRequest(items=items, data=data)), written(number, 0xFF, 0x07, 0x06))
    case.count(item_errors=2)
    case.find("transaction.item_error", 2)


def refuse_all(case: Case, talk: Talk) -> None:
    # Ack_Data with an item count and no items, Ack_Data with the function alone, Ack.
    number = talk.next_ref()
    body = S7_ReadVarAnswer(item_count=1)
    talk.exchange(READ, read_bytes(number, 2), s7(number, body, error_class=0x81, error_code=0x04))
    number = talk.next_ref()
    talk.exchange(PLC_STOP, s7_stop(number), ack_data(number, PLC_STOP, error=0xD241))
    for error in (0xD241, 0x8104):
        number = talk.next_ref()
        talk.send(CLIENT, dt(write(number, GOOD)))
        talk.send(SERVER, dt(ack(number, error)))
        case.pdu(WRITE, NO_FUNCTION)
        case.count(answered=1)
    # Userdata: a system status list that is not there.
    number = talk.next_ref()
    talk.exchange(USERDATA, ask(number, 4, 1, b"\x04\x24\x00\x00"), tell(number, 4, 1, error_code=0xD401))
    case.count(header_errors=5)
    case.find("transaction.refused", 5)


def s7_stop(number: int) -> bytes:
    """PLC stop."""
    return job(number, PLC_STOP, bytes(5) + b"\x09P_PROGRAM")
