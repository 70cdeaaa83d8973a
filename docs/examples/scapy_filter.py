"""Save a part of a capture with Scapy, and analyze what was saved."""

import tempfile
from pathlib import Path

from scapy.all import sniff, wrpcap

import dissect
from dissect.layers import S7Session

packets = sniff(offline="captures/two-clients.pcapng", session=S7Session)
first = packets[0].sport
part = [packet for packet in packets if first in (packet.sport, packet.dport)]
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "part.pcap"
    wrpcap(str(path), part)
    print(dissect.analyze("captures/two-clients.pcapng"))
    print(dissect.analyze(path))

# Output:
# Analysis(2 connections, 26 transactions, 0 with errors, 0 unanswered)
# Analysis(1 connections, 13 transactions, 0 with errors, 0 unanswered)
