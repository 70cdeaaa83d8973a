"""A fast path for ordinary PDOs: alone in their unit, of a known kind, without anything odd.

Facts that all PDOs of a kind have in common are computed once (`KnownPdo`). Values that cannot be odd are decoded only when
they are needed. Everything else is left to `dissect.meaning.bindings.engine`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.engine.exchange import Exchange
from dissect.engine.transactions.payloads import ScdMessage, ScdParameters
from dissect.engine.transactions.side import Side

if TYPE_CHECKING:
    from collections.abc import Callable

    from dissect.meaning.bindings.binding import Binding
    from dissect.meaning.bindings.judging import ScdJudge
    from dissect.packets.tcp.stream import Endpoint
    from dissect.scd.codec import Codec
    from dissect.scd.dictionary import Dictionary
    from dissect.scd.envelope import Envelope
    from dissect.scd.messages import Head, Message
    from dissect.scd.model import Pdo

#: Mask for transaction numbers: those of an envelope may have 64 bits; pairing uses the bits below its own marks.
REFERENCE: Final = (1 << 30) - 1
#: Maximum number of PDOs that one binding remembers.
MOST_KNOWN: Final = 256


class BindingCount:
    """The counts of a binding: messages, messages with errors, values; ``cut`` counts units that were partly captured."""

    def __init__(self) -> None:
        self.messages: i64 = 0
        self.errors: i64 = 0
        self.values: i64 = 0
        self.cut: i64 = 0


class KnownPdo:
    """A PDO that was seen before: everything but its data and its transaction number.

    ``parameters`` and ``reference`` are those of its first message. ``quiet``: no data can make it odd; otherwise ``odd``
    checks its data.
    """

    def __init__(self, head: Head, mapping: Pdo, parameters: ScdParameters, reference: int, quiet: bool) -> None:
        template = head.template
        self.later: Callable[[bytes, int], Message] = head.message
        self.odd: Callable[[bytes], bool] = head.odd
        self.size: int = head.size
        self.end: int = head.end
        self.values: i64 = len(head.packing.keys) if head.packing is not None else 0
        self.pdo: str = template.pdo
        self.tid: int = template.tid
        self.counted: bool = "tid" in template.numbers
        self.numbered: bool = head.numbered
        self.reference: int = reference
        self.mapping: Pdo = mapping
        self.function: i64 = parameters.function
        self.name: str = parameters.name
        self.index: int = parameters.index
        self.sub: int = parameters.sub
        self.settled: bool = parameters.settled
        self.quiet: bool = quiet


class LatestEnd:
    """The end of the device that was found last; None if it must be found again.

    ``usual``: its mappings are those of the dictionary.
    """

    def __init__(self) -> None:
        self.end: Endpoint | None = None
        self.usual: bool = False


class Pushes:
    """The PDOs that a binding knows, of devices whose mappings are those of the dictionary."""

    def __init__(
        self,
        binding: Binding,
        codec: Codec,
        count: BindingCount,
        exchange: Exchange,
        judge: ScdJudge,
        latest: LatestEnd,
    ) -> None:
        self.bare: bool = binding.holds == "pdo"
        self._binding: str = binding.name
        self._dictionary: Dictionary = codec.dictionary
        self._envelope: Envelope = codec.envelope
        self._head_size: int = codec.envelope.head_size
        self._repeated: int = codec.envelope.repeated
        self._tid_at: int = codec.envelope.tid_at
        self._tid_mask: int = codec.envelope.tid_mask
        self._count: BindingCount = count
        self._exchange: Exchange = exchange
        self._judge: ScdJudge = judge
        self._latest: LatestEnd = latest
        self._peer: bool = binding.device == "peer"
        self._known: dict[int, KnownPdo] = {}
        self._only: KnownPdo | None = None  # the PDO of a bare content

    def learn(self, octets: bytes, known: KnownPdo) -> None:
        """Remember the PDO in ``octets``."""
        if self.bare:
            self._only = known
            return
        if len(self._known) >= MOST_KNOWN:
            self._known.clear()
        self._known[int.from_bytes(octets[: self._head_size], "little") & self._repeated] = known

    def take_again(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> bool:
        """Like `take`, if the device is the usual one that was found last; else return False."""
        latest = self._latest
        connection = side.connection
        end = connection.client if self._peer else connection.server
        return latest.usual and latest.end is end and self.take(side, octets, frame, time_ns)

    def take(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> bool:
        """Take a unit that is only a known PDO; return False if it needs a closer look."""
        known = self._only
        tid: int = 0
        if known is not None:
            if len(octets) != known.size:
                return False
        elif self._known:
            head: int = int.from_bytes(octets[: self._head_size], "little")
            known = self._known.get(head & self._repeated)
            if known is None or len(octets) != known.size or self._envelope.checked(octets, known.end) is not None:
                return False
            tid = (head >> self._tid_at & self._tid_mask) if known.numbered else known.tid
        else:
            return False
        self._push(known, tid, side, octets, frame, time_ns)
        return True

    def _push(self, known: KnownPdo, tid: int, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        connection = side.connection
        count = self._count
        count.messages += 1
        count.values += known.values
        found = ScdMessage(None, self._dictionary, self._binding, octets, known.later, tid)
        found.mapping = known.mapping
        found.frame = frame
        found.time_ns = time_ns
        found.connection = connection.number
        found.side = side.index
        connection.pdus += 1
        exchange = self._exchange
        if exchange.observer.wants_pdus:
            exchange.observer.scd(frame, time_ns, side, found)
        if not known.quiet and known.odd(octets):
            self._judge.oddities(found)
        if known.counted:
            self._judge.count(found, known.pdo, tid)
        parameters = ScdParameters(0, known.name, found)
        parameters.function = known.function
        parameters.index = known.index
        parameters.sub = known.sub
        parameters.settled = known.settled
        reference: i64 = tid & REFERENCE if known.numbered else known.reference
        exchange.indication(side, reference, parameters, octets, frame, time_ns)
