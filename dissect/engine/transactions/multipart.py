"""`Joiner`: joins userdata answers and BSENDs that come in several parts (reference sections 4.3 and 4.10).

A long userdata answer may be divided at any place. Each part has its own request; all parts have the same sequence number and
data unit reference, and a mark shows the last one. `Joiner` takes the transactions of one connection in the order in which they
end, and returns whole payloads; `dissect.protocols.s7.bodies.parse_joined` reads these.

A long BSEND is divided by its sender, and each piece is a separate request. All pieces begin with the same R_ID, and have the
sequence number that the partner assigned in its answer to the first. Only the first has the length of the whole.
"""

from __future__ import annotations

from typing import Final

from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.s7.layouts import DATA_HEAD
from dissect.protocols.s7.message import Pdu
from dissect.protocols.s7.parameters import RESPONSE, UserdataHead
from dissect.protocols.s7.pbc import BSEND_LENGTH, goes_on
from dissect.protocols.s7.syntaxes import PBC_ID
from dissect.protocols.s7.tables import BSEND, GROUP_PBC, USERDATA
from dissect.wire.malformed import Malformed
from dissect.wire.part import Part

#: Maximum number of chains that are open at once on a connection; devices have one or two.
MAX_CHAINS: Final = 16
#: Maximum size of all open chains of a connection, in octets; the longest list seen has some thousand.
MAX_OCTETS: Final = 1 << 20
#: The packets are remembered for this many parts of a chain.
MAX_PLACES: Final = 1024
#: Maximum number of chains without an end that are remembered.
MAX_UNFINISHED: Final = 64

#: In a whole BSEND, the number of octets before the program's data.
_BEFORE_SENT: Final = PBC_ID.size + BSEND_LENGTH.size
#: Added to the keys of BSENDs, so that they differ from those of answers.
_SENDS: Final = 1 << 40


class Chain:
    """The payloads of one userdata answer or BSEND, in one part or several.

    ``octets`` are the joined payloads without data heads; ``whole``: the last part was included. ``first`` and ``last`` are the
    transactions of the first and of the latest part, ``transactions`` counts them. ``places`` has, for each part, its end in
    ``octets`` and its packet (for the first `MAX_PLACES` parts). ``r_id`` is -1 except for a BSEND.
    """

    __slots__ = (
        "_octets",
        "data_unit_ref",
        "first",
        "group",
        "last",
        "missing",
        "places",
        "r_id",
        "sequence",
        "subfunction",
        "transactions",
        "type",
        "whole",
    )

    def __init__(self, head: UserdataHead, transaction: Transaction) -> None:
        self.group: int = head.group
        self.subfunction: int = head.subfunction
        self.type: int = head.type
        self.sequence: int = head.sequence
        self.data_unit_ref: int = head.data_unit_ref
        self._octets: bytearray = bytearray()
        self.whole: bool = False
        self.first: Transaction = transaction
        self.last: Transaction = transaction
        self.transactions: int = 0
        self.missing: int = 0  # number of octets missing in its direction when the chain began
        self.r_id: int = -1
        self.places: list[tuple[int, int]] = []

    def __repr__(self) -> str:
        state = "whole" if self.whole else "open"
        return f"Chain({self.group}, {self.subfunction}, {self.size} bytes in {self.transactions}, {state})"

    @property
    def octets(self) -> bytes:
        """The payloads joined."""
        return bytes(self._octets)

    @property
    def size(self) -> int:
        """The size of the joined payload in octets."""
        return len(self._octets)

    @property
    def sent(self) -> bytes:
        """The data that the program sent with a BSEND, without R_ID and length; empty for other chains."""
        return bytes(self._octets[_BEFORE_SENT:]) if self.r_id >= 0 else b""

    @property
    def announced(self) -> int:
        """The size of ``sent`` that the first piece of a BSEND announces; -1 for none, and for other chains."""
        if self.r_id < 0 or self.size < _BEFORE_SENT:
            return -1
        return int.from_bytes(self._octets[PBC_ID.size : _BEFORE_SENT], "big")

    def append(self, payload: bytes, transaction: Transaction) -> None:
        """Add the next part."""
        self._octets += payload
        if len(self.places) < MAX_PLACES:
            self.places.append((len(self._octets), int(transaction.response_frame or transaction.request_frame)))
        self.last = transaction
        self.transactions += 1

    def parts(self, malformed: list[Malformed] | None = None) -> list[Part]:
        """Divide the joined payload into parts; offsets are within ``octets``, faults are added to ``malformed``."""
        from dissect.protocols.s7.bodies import parse_joined  # imported late: see `Pdu.body`

        return parse_joined(self.group, self.subfunction, self.type, self.octets, malformed)


class Joiner:
    """Joins the answers and BSENDs of one connection. ``unfinished`` are chains whose last part never came, oldest first.

    ``unfinished_count`` counts all of them, including those no longer remembered. ``headless`` counts parts of a chain whose
    first part was not captured, as at the start of a capture.
    """

    __slots__ = ("_chains", "_octets", "headless", "unfinished", "unfinished_count")

    def __init__(self) -> None:
        self._chains: dict[int, Chain] = {}
        self._octets: int = 0
        self.unfinished: list[Chain] = []
        self.unfinished_count: int = 0
        self.headless: int = 0

    @property
    def open_count(self) -> int:
        """Number of chains that expect more parts."""
        return len(self._chains)

    @property
    def octets(self) -> int:
        """Size of all open chains in octets."""
        return self._octets

    def feed(self, transaction: Transaction) -> Chain | None:
        """Take a finished transaction; return the answer or BSEND that is now complete, even if it had only one part."""
        begun = transaction.parameters.userdata if transaction.rosctr == USERDATA else None
        if begun is not None and begun.group == GROUP_PBC and begun.subfunction == BSEND:
            return self._send(transaction, begun)
        answer = transaction.response if transaction.rosctr == USERDATA else None
        head = answer.parameters.userdata if answer is not None else None
        if answer is None or head is None:
            return None
        asked = transaction.parameters.userdata if transaction.request_size else None
        if transaction.refused:
            if asked is not None and asked.sequence:
                self._give_up(_key(transaction, asked))  # the next part of an answer was requested, and refused
            return None
        payload = _payload(answer)
        if head.last_data_unit == 0 and head.data_unit_ref == 0:
            chain = Chain(head, transaction)
            chain.append(payload, transaction)
            chain.whole = True
            return chain
        key = _key(transaction, head)
        missing = self._gap(key, transaction, 1 - int(transaction.asked_by))
        chain_of = self._begun(key, head, asked, transaction)
        if chain_of is None:
            self.headless += 1
            return None
        chain_of.missing = missing
        return self._add(key, chain_of, payload, transaction, head.last_data_unit == 0)

    def _gap(self, key: int, transaction: Transaction, side: int) -> int:
        """Return how many octets of ``side`` are missing so far; drop the chain if fewer were missing when it began.

        The missing octets may have contained a part of the chain, so the parts before and after it must not be joined.
        """
        stream = transaction.connection.tcp.streams[side]
        missing = int(stream.position) - int(stream.octets)
        chain = self._chains.get(key)
        if chain is not None and chain.missing != missing:
            self._give_up(key)
        return missing

    def _send(self, transaction: Transaction, head: UserdataHead) -> Chain | None:
        """Take a piece of a BSEND, in a request or a push; the partner's answers carry no data."""
        asked = transaction.request
        piece = asked if asked is not None else transaction.response
        payload = _payload(piece) if piece is not None and head.type != RESPONSE else b""
        if len(payload) < PBC_ID.size:
            return None
        r_id = int.from_bytes(payload[PBC_ID.size - 4 : PBC_ID.size], "big")
        key = _SENDS | head.type << 34 | int(transaction.asked_by) << 32 | r_id
        follows = goes_on(head)
        if transaction.refused or not follows:
            self._give_up(key)
        if transaction.refused:
            return None
        sender = int(transaction.asked_by) if asked is not None else 1 - int(transaction.asked_by)
        missing = self._gap(key, transaction, sender)
        chain = self._chains.get(key)
        if chain is None and follows:
            self.headless += 1
            return None
        if chain is None:
            chain = self._open(key, head, transaction)
            chain.missing = missing
            chain.r_id = r_id
        else:
            payload = payload[PBC_ID.size :]
        return self._add(key, chain, payload, transaction, head.last_data_unit == 0)

    def _begun(
        self, key: int, head: UserdataHead, asked: UserdataHead | None, transaction: Transaction
    ) -> Chain | None:
        """Return the chain of a part, a new chain for a first part; None if the first part was not captured."""
        chain = self._chains.get(key)
        if chain is not None and chain.data_unit_ref == head.data_unit_ref and (asked is None or asked.sequence):
            return chain
        self._give_up(key)
        if head.last_data_unit == 0 or (asked is not None and asked.sequence):
            return None
        return self._open(key, head, transaction)

    def _open(self, key: int, head: UserdataHead, transaction: Transaction) -> Chain:
        """Begin a chain; if there are too many, drop the oldest."""
        chain = Chain(head, transaction)
        if len(self._chains) >= MAX_CHAINS:
            self._give_up(next(iter(self._chains)))
        self._chains[key] = chain
        return chain

    def _add(self, key: int, chain: Chain, payload: bytes, transaction: Transaction, last: bool) -> Chain | None:
        chain.append(payload, transaction)
        self._octets += len(payload)
        if last:
            del self._chains[key]
            self._octets -= chain.size
            chain.whole = True
            return chain
        while self._octets > MAX_OCTETS:
            self._give_up(next(iter(self._chains)))
        return None

    def close(self) -> list[Chain]:
        """The connection ended: return the remembered chains that never ended."""
        for key in list(self._chains):
            self._give_up(key)
        return self.unfinished

    def _give_up(self, key: int) -> None:
        chain = self._chains.pop(key, None)
        if chain is None:
            return
        self._octets -= chain.size
        self.unfinished_count += 1
        self.unfinished.append(chain)
        if len(self.unfinished) > MAX_UNFINISHED:
            del self.unfinished[0]


def _key(transaction: Transaction, head: UserdataHead) -> int:
    """Return the key that all parts of an answer share: asking side, group, subfunction and sequence number."""
    return transaction.asked_by << 24 | head.group << 16 | head.subfunction << 8 | head.sequence


def _payload(answer: Pdu) -> bytes:
    """Return the payload of a userdata PDU: the size is what its data head states, but at most what is present."""
    data = answer.data
    if len(data) < DATA_HEAD.size:
        return b""
    size = int.from_bytes(data[2:4], "big")
    return data[DATA_HEAD.size : DATA_HEAD.size + size]
