"""Causes that explain other findings: malformed writes, wrong sizes, ways of sending that a server does not accept."""

from __future__ import annotations

from captures.craft.case import Case, crafts
from captures.craft.pdus import READ, WRITE, ack, cr, dt, pattern, read, read_bytes, s7, values, written
from captures.craft.talk import CLIENT, SERVER, Talk
from dissect.layers import (
    COTP_CC,
    TPKT,
    COTP_Parameter,
    S7_DataItem,
    S7_Octets,
    S7_ReadVarAnswer,
    S7_WriteVarRequest,
    at,
)

#: A DR that refuses a connect request: reason 1, congestion.
REFUSAL = bytes.fromhex("0300000b06800001000001")


@crafts(
    "One thing is wrong and several others follow from it: writes without a fill byte that are refused, several bits in one "
    "item, an answer that does not fit the TPDU size, requests in fragments or with TPDU numbers that nothing answers, a "
    "confirm without TSAPs, and a connection that is refused while its client has nine open."
)
def causes(case: Case) -> None:
    leave_out_fill_bytes(case)
    ask_for_several_bits(case)
    ask_for_too_much(case)
    send_in_parts(case)
    send_numbered(case)
    confirm_without_tsaps(case)
    pile_up(case)


def leave_out_fill_bytes(case: Case) -> None:
    talk = Talk(case, client_port=50001)
    talk.begin()
    items = [at("DB1.DBB0"), at("DB1.DBW2")]
    early = S7_Octets(octets=bytes.fromhex("0004000801 000400101234"))
    sound = S7_Octets(octets=bytes.fromhex("000400080100 000400101234"))
    for _ in range(2):
        number = talk.next_ref()
        talk.send(CLIENT, dt(s7(number, S7_WriteVarRequest(items=items, data=[early]))))
        case.find("s7.malformed")
        talk.send(SERVER, dt(ack(number, 0x8104)))
        case.pdu(WRITE, -1)
        case.count(answered=1, header_errors=1)
    number = talk.next_ref()
    talk.exchange(WRITE, s7(number, S7_WriteVarRequest(items=items, data=[sound])), written(number, 0xFF, 0xFF))
    case.find("security.write")
    talk.close()


def ask_for_several_bits(case: Case) -> None:
    talk = Talk(case, client_port=50002)
    talk.begin()
    number = talk.next_ref()
    no = S7_DataItem(return_code=6, transport_size=0, octets=b"")
    talk.exchange(READ, read(number, "DB200.DBX16.0", count=4), s7(number, S7_ReadVarAnswer(data=[no])))
    case.find("transaction.bit_count")
    case.count(item_errors=1)
    talk.close()


def ask_for_too_much(case: Case) -> None:
    talk = Talk(case, client_port=50003)
    talk.begin(tpdu_size=512, pdu_length=960)
    talk.poll(1, 400)
    talk.send(CLIENT, dt(read_bytes(talk.next_ref(), 600)))
    case.unanswered(READ, "connection_closed")
    case.find("session.tpdu_too_small")
    talk.put(talk.make(SERVER, flags="RA"))


def send_in_parts(case: Case) -> None:
    talk = Talk(case, client_port=50004)
    talk.begin()
    for _ in range(2):
        number = talk.next_ref()
        message = read(number, *[f"DB{db}.DBB0" for db in range(1, 13)])
        talk.send(CLIENT, dt(message[:121], end=False) + dt(message[121:]))
        case.unanswered(READ, "connection_closed")
        case.pause(2500)
    case.find("cotp.fragments_unanswered")
    talk.close()


def send_numbered(case: Case) -> None:
    talk = Talk(case, client_port=50005)
    talk.open()
    talk.connect()
    talk.setup(480, 1, 1)
    for number in (1, 2, 3):
        talk.send(CLIENT, dt(read_bytes(talk.next_ref(), 2), number=number))
        case.unanswered(READ, "connection_closed")
        case.pause(1000)
    case.find("cotp.tpdu_nr")
    case.find("cotp.number_unanswered")
    talk.close()


def confirm_without_tsaps(case: Case) -> None:
    talk = Talk(case, client_port=50006)
    talk.open()
    talk.send(CLIENT, cr())
    confirm = COTP_CC(dst_ref=1, src_ref=2, parameters=[COTP_Parameter.tpdu_size(1024)])
    talk.send(SERVER, bytes(TPKT() / confirm))
    case.find("cotp.bare_confirm")
    talk.close()


def pile_up(case: Case) -> None:
    opened = [Talk(case, client_port=50010 + number) for number in range(9)]
    for talk in opened:
        talk.begin()
    refused = Talk(case, client_port=50020)
    refused.open()
    refused.send(CLIENT, cr())
    refused.send(SERVER, REFUSAL)
    case.find("cotp.refused")
    refused.close(SERVER)
    number = opened[0].next_ref()
    opened[0].exchange(READ, read_bytes(number, 2), values(number, pattern(2)))
    for talk in opened:
        talk.close()
