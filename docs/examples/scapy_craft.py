"""Make S7 messages with Scapy, and look at them with the analyzer."""

import dissect
from dissect.layers import COTP_DT, S7, TPKT, S7_DataItem, S7_ReadVarAnswer, S7_ReadVarRequest, at

read = TPKT() / COTP_DT() / S7(pdu_ref=1) / S7_ReadVarRequest(items=[at("DB10.DBW4"), at("M10.3")])
good = S7_DataItem(octets=b"\x00\x2a")
refused = S7_DataItem(return_code="Object does not exist", transport_size=0)
answer = TPKT() / COTP_DT() / S7(pdu_ref=1) / S7_ReadVarAnswer(data=[good, refused])

talk = dissect.stream(("10.0.0.1", 4000), ("10.0.0.2", 102))
for event in talk.client_sent(bytes(read)) + talk.server_sent(bytes(answer)) + talk.close():
    if isinstance(event, dissect.Transaction):
        for item in event.items:
            print(item.address, item.value, item.result)

# Output:
# DB10.DBW4 42 ok
# M10.3 None Object does not exist
