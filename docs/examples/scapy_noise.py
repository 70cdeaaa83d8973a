"""Wait for an answer with Scapy behind stray bytes and in several pieces; give up in time when only a part comes."""

import socket

from scapy.supersocket import StreamSocket

from dissect.layers import COTP_DT, S7, TPKT, S7_DataItem, S7_ReadVarAnswer, S7_ReadVarRequest, at

read = TPKT() / COTP_DT() / S7(pdu_ref=1) / S7_ReadVarRequest(items=[at("DB10.DBW4")])
answer = bytes(S7(pdu_ref=1) / S7_ReadVarAnswer(data=[S7_DataItem(octets=b"\x00\x2a")]))
pieces = bytes(TPKT() / COTP_DT(eot=0) / answer[:9]) + bytes(TPKT() / COTP_DT() / answer[9:])

for name, told in (("noise", b"\xff\x00noise" + pieces), ("two DTs", pieces), ("a part", pieces[:-3])):
    ours, plc = socket.socketpair()
    plc.sendall(told)
    stream = StreamSocket(ours, TPKT)
    found = stream.sr1(read, timeout=1, verbose=False)
    print(f"{name}:", found.summary() if found else "no answer in time")
    stream.close()
    plc.close()

# Output:
# noise: TPKT / COTP_DT / S7 Ack_Data Read Var ref=0x0001 1 ok
# two DTs: TPKT / COTP_DT / S7 Ack_Data Read Var ref=0x0001 1 ok
# a part: no answer in time
