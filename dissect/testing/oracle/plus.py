"""S7comm-plus, which Wireshark cannot dissect: self-consistency checks of its PDUs (docs/s7plus.md).

Two facts hold in every public capture: a PDU can be read to its last octet, and the integrity id of a response is that of its
request plus the sequence number. A wrong reading would break the second, because the id comes after everything else.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.bodies import is_known, parse_contents
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.tables import KEEP_ALIVE, REQUEST, RESPONSE

#: Maximum number of requests that wait for their response, and of faults that are described.
_OPEN: Final = 10_000
_KEPT: Final = 100


class PlusProof:
    """Counts the PDUs of a capture that pass the checks.

    ``read`` of ``pdus`` whole ones can be read to their last octet; the integrity ids of ``true`` of ``pairs`` responses follow
    from those of their requests. ``cut`` PDUs are incomplete and not checked; the body of ``unknown`` PDUs, which are whole, is
    unknown (InitSSL among them). ``faults`` describe those that fail, and why.
    """

    def __init__(self) -> None:
        self.pdus = 0
        self.cut = 0
        self.unknown = 0
        self.read = 0
        self.pairs = 0
        self.true = 0
        self.faults: list[str] = []
        self._asked: dict[tuple[int, int, int], int] = {}

    @property
    def met(self) -> bool:
        """True if there was a PDU of S7comm-plus, whole or not."""
        return bool(self.pdus or self.cut or self.unknown)

    @property
    def holds(self) -> bool:
        """True if no check failed."""
        return self.read == self.pdus and self.true == self.pairs

    def __str__(self) -> str:
        cut = f", {self.cut} not whole" if self.cut else ""
        if self.unknown:
            cut += f", {self.unknown} of functions whose body is not known"
        return (
            f"S7comm-plus: {self.read} of {self.pdus} whole PDUs read to their last byte{cut}; "
            f"{self.true} of {self.pairs} response ids = request id + sequence number"
        )

    def add(self, other: PlusProof) -> None:
        """Add the results for another capture, without its faults."""
        self.pdus += other.pdus
        self.cut += other.cut
        self.unknown += other.unknown
        self.read += other.read
        self.pairs += other.pairs
        self.true += other.true

    def take(self, octets: bytes, frame: int, connection: int, side: int, cut: bool) -> None:
        """Take a PDU: its frames one after another."""
        pdu = parse_plus(octets, frame, 0, connection, side, cut)
        if not pdu.whole:
            self.cut += 1
            return
        contents = parse_contents(pdu, shown=False)
        facts = [*pdu.malformed, *[fact.at(pdu.place(fact.offset)) for fact in contents.malformed]]
        if not facts and not is_known(pdu):
            self.unknown += 1
            return
        self.pdus += 1
        if not facts and (contents.whole or pdu.version == KEEP_ALIVE):
            self.read += 1
        else:
            self._fault(pdu, str(facts[0]) if facts else "its body is not known")
        self._pair(pdu, contents)

    def _pair(self, pdu: PlusPdu, contents: Contents) -> None:
        if contents.integrity_id < 0:
            return
        asker = pdu.side if pdu.opcode == REQUEST else 1 - pdu.side
        key = (pdu.connection, asker, pdu.sequence)
        if pdu.opcode == REQUEST:
            while len(self._asked) >= _OPEN:
                del self._asked[next(iter(self._asked))]
            self._asked[key] = contents.integrity_id
        elif pdu.opcode == RESPONSE and key in self._asked:
            self.pairs += 1
            asked = self._asked.pop(key)
            if contents.integrity_id == (asked + pdu.sequence) & 0xFFFFFFFF:
                self.true += 1
            else:
                self._fault(pdu, f"integrity id {contents.integrity_id}, that of its request is {asked}")

    def _fault(self, pdu: PlusPdu, why: str) -> None:
        if len(self.faults) < _KEPT:
            self.faults.append(
                f"frame {pdu.frame} S7comm-plus {pdu.kind} {pdu.function_name}: {why}".replace(" :", ":")
            )
