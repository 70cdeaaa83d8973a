"""The headers of IBH-NetLink as layouts (docs/ibh.md). Wireshark has no dissector for them, so there are no Wireshark names."""

from __future__ import annotations

from typing import Final

from dissect.protocols.ibh.tables import FUNCTIONS, SERVICES
from dissect.wire.layout import Field, Layout


class LittleEndian(Field):
    """A little-endian number of several octets."""

    def read(self, octets: bytes, offset: int) -> int:
        """Return the value of the field, whose octets begin at ``offset``."""
        return int.from_bytes(octets[offset : offset + self.size], "little")


_SOURCE: Final = "docs/ibh.md"

IBH: Final = Layout(
    "IBH-NetLink",
    _SOURCE,
    [
        Field("channel1", 1, "Channel of the sender: 0x07 of a client that talks to a station, 0xff of the gateway."),
        Field("channel2", 1, "Channel of the receiver; an answer has the two the other way round."),
        Field("length", 1, "Bytes from the ninth one on."),
        Field("number", 1, "A counter; a receipt repeats it, 0 wants none."),
        LittleEndian("s_flags", 2, "What is answered.", "", SERVICES),
        LittleEndian("r_flags", 2, "What is requested.", "", SERVICES),
    ],
)

_ADDRESSES: Final = [
    Field("src_conn", 1, "Number the client gave to the connection."),
    Field("dst_conn", 1, "Number the station gave to it, 0 before."),
    Field("mpi", 1, "MPI address of the station."),
]
_FUNCTION: Final = [
    Field("length", 1, "Bytes after this one."),
    Field("function", 1, "What the packet does.", "", FUNCTIONS),
    Field("number", 1, "Number of the data packet; missing when nothing follows the function."),
]

#: The short header, to the gateway.
MPI_SHORT: Final = Layout(
    "MPI", _SOURCE, [*_ADDRESSES, Field("local_mpi", 1, "MPI address of the gateway, 0 or 1 as seen."), *_FUNCTION]
)
#: The long header, from the gateway.
MPI_LONG: Final = Layout(
    "MPI",
    _SOURCE,
    [
        *_ADDRESSES,
        Field("unknown1", 1, "Not known, 0 as seen."),
        Field("unknown2", 1, "Not known, 0 as seen."),
        Field("unknown3", 1, "Not known, 0x22 as seen."),
        *_FUNCTION,
    ],
)
