"""Read a capture with Scapy and look into S7 layers."""

from scapy.all import sniff

from dissect.layers import S7, S7Session

for packet in sniff(offline="captures/item-errors.pcapng", session=S7Session):
    if S7 in packet:
        print(packet[S7].summary())

# Output:
# S7 Job Setup communication ref=0x0000 amq=1/1 pdu=480
# S7 Ack_Data Setup communication ref=0x0000 amq=1/1 pdu=480
# S7 Job Read Var ref=0x0100 DB99.DBB0 x4
# S7 Ack_Data Read Var ref=0x0100 Object does not exist
# S7 Job Read Var ref=0x0200 DB2.DBB98 x10
# S7 Ack_Data Read Var ref=0x0200 Invalid address
# S7 Job Read Var ref=0x0300 MB120 x20
# S7 Ack_Data Read Var ref=0x0300 Invalid address
# …
