"""Feed a connection with bytes that are damaged: what is sound behind them is read, and findings name the rest."""

import dissect
from dissect.layers import COTP_DT, S7, TPKT, S7_DataItem, S7_ReadVarAnswer, S7_ReadVarRequest, at


def read(number: int) -> bytes:
    """Return a request."""
    return bytes(TPKT() / COTP_DT() / S7(pdu_ref=number) / S7_ReadVarRequest(items=[at("DB10.DBW4")]))


def answer(number: int) -> bytes:
    """Return its answer."""
    return bytes(TPKT() / COTP_DT() / S7(pdu_ref=number) / S7_ReadVarAnswer(data=[S7_DataItem(octets=b"\x00\x2a")]))


talk = dissect.stream(pdus=False)
events = talk.client_sent(read(1)) + talk.server_sent(answer(1))
events += talk.server_sent(answer(2))  # out of turn
events += talk.client_sent(b"noise" + read(3)[:9]) + talk.client_sent(read(3)[9:]) + talk.server_sent(answer(3))
for event in events + talk.close():
    print(event)

# Output:
# error cotp.bad_start, packet 4: the first TPDU of the client is DT
# warning session.data_before_setup, packet 4: Read Var
# Read Var DB10.DBW4: answered
# Read Var: answer without request
# error tpkt.garbage, packet 7: 5 bytes from 127.0.0.1:49152, first 0x6e; decoding resumed in packet 8
# warning transaction.orphan, packet 6: Read Var: reference 0x0002
# Read Var DB10.DBW4: answered
# Connection(1, 127.0.0.1:49152 → 127.0.0.1:102, 5 PDUs)
