"""Catch one exception for everything that can be wrong with what was given."""

import io

import dissect

for source in ("missing.pcap", "README.md", io.BytesIO(b"text"), [(0, 1, "text")]):
    try:
        print(dissect.analyze(source))
    except dissect.Error as error:
        print(error)

# Output:
# missing.pcap: no such file
# README.md: not a capture file (pcap or pcapng, plain or in gzip or zstd)
# <BytesIO>: not a capture file (pcap or pcapng, plain or in gzip or zstd)
# packet 1: its octets are str, not bytes
