"""Hand over packets that another library has read, here Scapy."""

from collections.abc import Iterator

from scapy.utils import RawPcapNgReader

import dissect


def packets(path: str) -> Iterator[tuple[int, int, bytes]]:
    """Give time in nanoseconds, LINKTYPE number and bytes of each packet."""
    with RawPcapNgReader(path) as reader:
        for octets, about in reader:
            microseconds = (about.tshigh << 32) + about.tslow
            yield microseconds * 1_000_000_000 // about.tsresol, about.linktype, octets


print(dissect.analyze(packets("captures/item-errors.pcapng")))

# Output:
# Analysis(1 connections, 8 transactions, 7 with errors, 0 unanswered)
