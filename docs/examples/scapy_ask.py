"""Talk to a PLC with Scapy: connect, set up, read. The PLC is one that repeats what a capture holds."""

import socket

from scapy.supersocket import StreamSocket

from dissect.layers import COTP_CR, COTP_DT, S7, TPKT, COTP_Parameter, S7_ReadVarRequest, S7_Setup, at
from dissect.testing.playback.server import Server


def ask(stream: StreamSocket, request: object) -> None:
    """Send a request, and print it with its answer."""
    print("->", request.summary())
    print("<-", stream.sr1(request, timeout=5, verbose=False).summary())


with Server("captures/read-areas.pcapng") as plc:
    stream = StreamSocket(socket.create_connection(("127.0.0.1", plc.port)), TPKT)
    ask(stream, TPKT() / COTP_CR(parameters=[COTP_Parameter.calling("01.00"), COTP_Parameter.called("01.01")]))
    ask(stream, TPKT() / COTP_DT() / S7(pdu_ref=1) / S7_Setup(pdu_length=480))
    ask(stream, TPKT() / COTP_DT() / S7(pdu_ref=2) / S7_ReadVarRequest(items=[at("DB1.DBB0", 3)]))
    stream.close()

# Output:
# -> TPKT / COTP CR 01.00 -> 01.01 rack 0 slot 1
# <- TPKT / COTP CC 01.00 -> 01.01 rack 0 slot 1
# -> TPKT / COTP_DT / S7 Job Setup communication ref=0x0001 amq=1/1 pdu=480
# <- TPKT / COTP_DT / S7 Ack_Data Setup communication ref=0x0001 amq=1/1 pdu=480
# -> TPKT / COTP_DT / S7 Job Read Var ref=0x0002 DB1.DBB0 x3
# <- TPKT / COTP_DT / S7 Ack_Data Read Var ref=0x0002 Object does not exist
