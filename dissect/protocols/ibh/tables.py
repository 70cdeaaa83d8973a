"""Meanings of the codes in IBH-NetLink packets. There is no specification: docs/ibh.md has the source of each row."""

from __future__ import annotations

from typing import Final

from dissect.wire.codes import CodeTable

#: The TCP port of the gateway.
NETLINK_PORT: Final = 1099
#: The protocol of a connection (`Connection.protocol`).
IBH_NETLINK: Final = "ibh_netlink"

#: Flags of packets that have an MPI header.
MPI_REQUEST: Final = 0x0082
MPI_INDICATION: Final = 0x02C2

#: Flags: a request has its service in ``r_flags``; an answer repeats it in ``s_flags``.
SERVICES: Final = CodeTable("IBH service", 4, [
    (0x0000, "none", "The other flags of the packet apply."),
    (0x0001, "device", "The gateway itself: identification, reset."),
    (0x0004, "bus parameters", "Address and speed of the gateway on the bus."),
    (MPI_REQUEST, "MPI request", "To a station on the bus, the short MPI header follows; in s_flags: received by the gateway."),
    (0x0096, "stations", "Which stations are on the bus."),
    (0x0097, "connection", "Claims a connection number."),
    (MPI_INDICATION, "MPI indication", "From a station on the bus, the long MPI header follows."),
])

DATA_MORE: Final = 0xF0
DATA: Final = 0xF1

#: Functions of the MPI header. Connects, disconnects and data have the code of the corresponding COTP TPDU.
FUNCTIONS: Final = CodeTable("MPI function", 2, [
    (0x05, "go ahead", "After a connection is confirmed, from both sides; also requests the rest of a message."),
    (0x80, "disconnect", "Ends the connection to the station."),
    (0xB0, "acknowledge", "Acknowledges a data packet."),
    (0xD0, "connect confirm", "The station accepts the connection."),
    (0xE0, "connect request", "Asks the station for a connection."),
    (DATA_MORE, "data, more to come", "A part of a message that goes on in the next packet."),
    (DATA, "data", "A message, or the last part of one."),
])

# Kinds of packets.
KIND_DATA: Final = 0
KIND_FRAGMENT: Final = 1
KIND_ACK: Final = 2
KIND_CONNECT: Final = 3
KIND_CONFIRM: Final = 4
KIND_DISCONNECT: Final = 5
KIND_GO_AHEAD: Final = 6
KIND_MPI_OTHER: Final = 7
KIND_RECEIPT: Final = 8
KIND_SERVICE: Final = 9
KIND_OTHER: Final = 10

#: Names of the kinds, by the numbers above.
KINDS: Final[list[str]] = [
    "mpi_data",
    "mpi_fragment",
    "mpi_ack",
    "mpi_connect",
    "mpi_confirm",
    "mpi_disconnect",
    "mpi_go_ahead",
    "mpi_other",
    "receipt",
    "service",
    "other",
]

#: The kind of a packet by the function of its MPI header.
KIND_OF: Final[dict[int, int]] = {
    DATA: KIND_DATA,
    DATA_MORE: KIND_FRAGMENT,
    0xB0: KIND_ACK,
    0xE0: KIND_CONNECT,
    0xD0: KIND_CONFIRM,
    0x80: KIND_DISCONNECT,
    0x05: KIND_GO_AHEAD,
}
