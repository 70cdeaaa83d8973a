"""What a pipeline offers to somebody who looks for another protocol in what it carries (`dissect.bindings`: SCD).

The methods are called where a byte passes; a decoder hands what it finds back through `Exchange`, whose dialogue pairs it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mypy_extensions import i64, mypyc_attr

from dissect.transactions.connection import Connection
from dissect.transactions.table import Side
from dissect.transactions.transaction import Transaction

if TYPE_CHECKING:
    from dissect.engine.exchange import Exchange


@mypyc_attr(allow_interpreted_subclasses=True)
class PayloadDecoder:
    """Takes what may be its own; this one takes nothing. ``udp_ports`` are those of the datagrams it wants to see."""

    def __init__(self) -> None:
        self.udp_ports: set[int] = set()

    def attach(self, exchange: Exchange) -> None:
        """Remember where findings, observer and dialogue are; called once, before the first packet."""

    def claims_port(self, transport: str, connection: Connection) -> bool:
        """Tell whether a new conversation over ``tcp`` or ``udp`` is one to be followed; name its client if so."""
        return False

    def datagram(self, side: Side, octets: bytes, missing: i64, frame: i64, time_ns: i64) -> None:
        """Take a UDP payload of a conversation that was claimed; ``missing`` octets of it were not captured."""

    def stream(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take the next octets of a TCP connection that was claimed."""

    def hole(self, side: Side, size: i64, frame: i64, time_ns: i64) -> None:
        """``size`` octets are missing here from a TCP connection that was claimed."""

    def claims_tsdus(self, connection: Connection) -> bool:
        """Tell whether the TSDUs of a connection are its own, once its TSAPs are known."""
        return False

    def tsdu(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> bool:
        """Take a TSDU that is neither S7comm nor S7comm-plus; False when it is none of its own."""
        return False

    def transaction(self, transaction: Transaction) -> None:
        """Look at an S7 transaction before it is told, and at one of its own when it is over."""

    def restart(self) -> None:
        """Another capture begins, in which nothing is known of what was seen before."""

    def message_count(self) -> int:
        """Return how many messages were found."""
        return 0

    def as_dict(self) -> dict[str, Any]:
        """Return what was found, as JSON-ready values for the analysis."""
        return {}

    def end(self, side: Side, frame: i64, time_ns: i64) -> None:
        """The connection of ``side`` is over."""
