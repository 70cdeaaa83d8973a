"""SCD in traffic: decodes it by the dictionary in the places given by the bindings, pairs it and judges it.

`ScdCarrier` is plugged into the pipeline (`dissect.engine.exchange`). The path of a message:

datagram / stream / tsdu / transaction → _unit → _take → dialogue (pairs) → transaction → judged, reported

Everything between the pipeline and a `Transaction` is here. The state of a device is in `devices`; findings are made in
`dissect.meaning.bindings.judging`.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING, Any, Final

from dissect.engine.exchange import PayloadDecoder
from dissect.engine.transactions.multipart import Joiner
from dissect.engine.transactions.payloads import SCD, ScdMessage, ScdParameters
from dissect.meaning.bindings.binding import Binding, Bindings
from dissect.meaning.bindings.contents import decode
from dissect.meaning.bindings.devices import ScdDevice, ScdDevices
from dissect.meaning.bindings.judging import ScdJudge
from dissect.meaning.bindings.place import in_blocks
from dissect.meaning.bindings.pushes import REFERENCE, BindingCount, KnownPdo, Pushes
from dissect.meaning.bindings.streams import cut_stream, skip_hole
from dissect.protocols.iso.upper import SCD as UPPER_SCD
from dissect.protocols.iso.upper import UPPER_NAMES
from dissect.protocols.s7.tables import GROUP_PBC, JOB, READ_VAR, SUCCESS, USERDATA, WRITE_VAR
from dissect.scd.messages import Head
from dissect.scd.packing import TRAILING
from dissect.wire.text import encodable, printable

if TYPE_CHECKING:
    from collections.abc import Iterator

    from dissect.engine.exchange import Exchange
    from dissect.engine.transactions.connection import Connection
    from dissect.engine.transactions.side import Side
    from dissect.engine.transactions.transaction import Transaction
    from dissect.protocols.s7.items import ItemResult
    from dissect.scd.dictionary import Dictionary
    from dissect.scd.messages import Message
    from dissect.scd.model import Pdo

#: The value of `Connection.bound` once it is known that no binding applies to its TSAPs.
_NOT_BOUND: Final = -2
#: Maximum number of connections whose BSENDs are joined from their pieces.
MAX_JOINERS: Final = 1024
#: Bit in the reference of a request that only has index and sub-index, so that it differs from transaction numbers.
_BY_OBJECT: Final = 0x1000000
#: Largest error of a transaction, which is signed; that of an envelope may have 64 bits unsigned.
_MAX_ERR: Final = (1 << 63) - 1


class ScdCarrier(PayloadDecoder):
    """Decodes SCD in the places given by the bindings.

    ``counts`` are by name of the binding. ``unpaired`` counts messages of unknown kind, ``skipped`` octets of streams outside
    of messages, ``blocks_forgotten`` connections whose BSENDs were dropped because there were too many.
    """

    def __init__(self, dictionary: Dictionary, bindings: Bindings) -> None:
        super().__init__()
        self.dictionary = dictionary
        self.bindings = bindings
        self.counts: dict[str, BindingCount] = {binding.name: BindingCount() for binding in bindings.all}
        self.unpaired = 0
        self.skipped = 0
        self.blocks_forgotten = 0
        self.udp_ports = set(bindings.udp)
        self.devices = ScdDevices(dictionary)
        self._numbers = {id(binding): number for number, binding in enumerate(bindings.all)}
        self._functions: dict[str, int] = {}
        self._joiners: OrderedDict[int, Joiner] = OrderedDict()
        self._pdos: dict[str, Pdo] = {}
        self._exchange: Exchange
        self._judge: ScdJudge
        self._pushes: list[Pushes]

    def attach(self, exchange: Exchange) -> None:
        """Set the exchange that gets the messages."""
        self._exchange = exchange
        peers = frozenset(binding.name for binding in self.bindings.all if binding.device == "peer")
        self._judge = ScdJudge(exchange.reporter, self.devices, peers)
        codec, judge, counts, latest = self.devices.codec, self._judge, self.counts, self.devices.latest
        self._pushes = [Pushes(one, codec, counts[one.name], exchange, judge, latest) for one in self.bindings.all]

    # ---- where SCD travels ------------------------------------------------------------------------------------------

    def claims_port(self, transport: str, connection: Connection) -> bool:
        """Return whether a port of a new conversation is bound; the other end is then its client."""
        bound = self.bindings.udp if transport == "udp" else self.bindings.tcp
        ends = connection.tcp.ends
        for side in (0, 1):
            for binding in bound.get(ends[side].port, ()):
                if binding.matches(ends[0].address, ends[1].address):
                    connection._bound = self._numbers[id(binding)]
                    connection.protocol = UPPER_NAMES[UPPER_SCD]
                    connection.identified_by = printable(binding.name)
                    connection._set_client(1 - side)
                    return True
        return False

    def datagram(self, side: Side, octets: bytes, missing: int, frame: int, time_ns: int) -> None:
        """Take a datagram: complete messages, or one bare content."""
        if missing:
            self.counts[self.bindings.all[side.connection._bound].name].cut += 1
        elif not self._pushes[side.connection._bound].take_again(side, octets, frame, time_ns):
            self._unit(side, octets, frame, time_ns)

    def stream(self, side: Side, octets: bytes, frame: int, time_ns: int) -> None:
        """Take octets of a bound TCP connection."""
        binding = self.bindings.all[side.connection._bound]
        units, skipped = cut_stream(side, self.devices.codec.envelope, binding, octets)
        if skipped:
            self.skipped += skipped
            self._judge.garbage(side, skipped, frame, time_ns)
        pushes = self._pushes[side.connection._bound]
        for unit in units:
            if not pushes.take_again(side, unit, frame, time_ns):
                self._unit(side, unit, frame, time_ns)

    def hole(self, side: Side, size: int, frame: int, time_ns: int) -> None:
        """Octets are missing: the unfinished message stays incomplete, and the next one must be found."""
        self.skipped += skip_hole(side, self.bindings.all[side.connection._bound], size)

    def tsdu(self, side: Side, octets: bytes, frame: int, time_ns: int) -> bool:
        """Take a TSDU of a connection whose TSAPs are bound."""
        if not self.claims_tsdus(side.connection):
            return False
        if not self._pushes[side.connection._bound].take_again(side, octets, frame, time_ns):
            self._unit(side, octets, frame, time_ns)
        return True

    def claims_tsdus(self, connection: Connection) -> bool:
        """Return whether the TSAPs of a connection are bound."""
        return connection._bound >= 0 or (connection._bound != _NOT_BOUND and self._bind_tsap(connection))

    def _bind_tsap(self, connection: Connection) -> bool:
        known = False
        for tsap in (connection.tsap_called, connection.tsap_calling):
            if tsap is None:
                continue
            known = True
            for binding in self.bindings.cotp.get(tsap.octets, ()):
                ends = connection.tcp.ends
                if binding.matches(ends[0].address, ends[1].address):
                    connection._bound = self._numbers[id(binding)]
                    connection.protocol = UPPER_NAMES[UPPER_SCD]
                    connection.identified_by = printable(binding.name)
                    return True
        if known:
            connection._bound = _NOT_BOUND
        return False

    # ---- from octets to transactions --------------------------------------------------------------------------------

    def _unit(self, side: Side, octets: bytes, frame: int, time_ns: int) -> None:
        connection = side.connection
        number = connection._bound
        binding = self.bindings.all[number]
        device = self.devices.of(side, binding)
        usual = device.codec is self.devices.codec
        if usual and self._pushes[number].take(side, octets, frame, time_ns):
            return
        observer = self._exchange.observer
        for found in self._decode(device, binding, octets):
            found.frame = frame
            found.time_ns = time_ns
            found.connection = connection.number
            found.side = side.index
            connection.pdus += 1
            if observer.wants_pdus:
                observer.scd(frame, time_ns, side, found)
            self._judge.message(side, found)
            self._pair(side, found, frame, time_ns)
            if usual and found.mapping is not None and len(found.octets) == len(octets):
                self._learn(self._pushes[number], found)

    def _learn(self, pushes: Pushes, found: ScdMessage) -> None:
        """Remember a PDO that is alone in its unit, to recognise the next ones."""
        message = found.message
        mapping = found.mapping
        codec = self.devices.codec
        envelope = codec.envelope
        if mapping is None or message.err or TRAILING in message.flags or not (pushes.bare or envelope.told_by_head):
            return
        parameters = self._parameters(found)
        parameters.settled = self._judge.is_common(message)
        sizes = (0, 0) if pushes.bare else (envelope.head_size, envelope.tail_size)
        head = Head(codec, message, *sizes)
        quiet = codec.packing(message.pdo).quiet and not head.version
        pushes.learn(found.octets, KnownPdo(head, mapping, parameters, _reference(message), quiet))

    def _decode(self, device: ScdDevice, binding: Binding, octets: bytes, at: int = 0) -> Iterator[ScdMessage]:
        """Yield the messages in ``octets``, whose offset in the carrier's content is ``at``, and count them."""
        count = self.counts[binding.name]
        shared = self.devices.codec
        place = 0
        for message in decode(device.codec, binding, octets):
            size = message.size or len(octets) - place
            found = ScdMessage(message, self.dictionary, binding.name, octets[place : place + size])
            found.offset = at + place
            place += size
            count.messages += 1
            count.values += len(message.values)
            if message.error is not None:
                count.errors += 1
            elif message.pdo:
                pdo = self._pdos.get(message.pdo) if device.codec is shared else None
                found.mapping = self._mapping(device, message.pdo) if pdo is None else pdo
            yield found

    def _mapping(self, device: ScdDevice, pdo: str) -> Pdo:
        """Return a PDO as the device maps it now; mappings of the dictionary itself are looked up once."""
        if device.codec is not self.devices.codec:
            return device.codec.pdo(pdo)
        found = self._pdos.get(pdo)
        if found is None:
            found = self._pdos[pdo] = device.codec.pdo(pdo)
        return found

    def _pair(self, side: Side, found: ScdMessage, frame: int, time_ns: int) -> None:
        message = found.message
        phase = message.phase
        if (message.service and not phase) or (message.error is not None and not message.service):
            self.unpaired += 1
            return
        parameters = self._parameters(found)
        reference = _reference(message)
        exchange = self._exchange
        if phase == "request":
            exchange.request(side, reference, parameters, found.octets, frame, time_ns)
        elif phase in {"response", "abort"}:
            exchange.response(side, reference, parameters, found.octets, frame, time_ns)
        else:
            exchange.indication(side, reference, parameters, found.octets, frame, time_ns)

    def _parameters(self, found: ScdMessage) -> ScdParameters:
        message = found.message
        service = message.service
        name: str = service
        if service == "pdo":
            name = f"PDO {message.pdo}" if message.pdo else "PDO with an unknown number"
        elif not service:
            name = message.content or "message"
        # names come from the dictionary, so their number is limited
        key = self._functions.get(name)
        if key is None:
            key = self._functions[name] = len(self._functions)
        parameters = ScdParameters(key, name, found)
        if service != "pdo" and "index" in message.numbers:
            parameters.index = message.index
            parameters.sub = message.sub
        err = message.err
        if err:
            parameters.err = min(err, _MAX_ERR)
        parameters.refused = err < 0 or message.phase == "abort"
        return parameters

    # ---- transactions -----------------------------------------------------------------------------------------------

    def transaction(self, transaction: Transaction) -> None:
        """Look into the items and blocks of an S7 transaction; judge an SCD exchange when it is over."""
        if transaction.rosctr == SCD:
            self._judge.exchange(transaction)
            self.devices.look_again()
        elif transaction.rosctr == JOB and self.bindings.s7:
            function = transaction.parameters.function
            if function in {READ_VAR, WRITE_VAR}:
                self._items(transaction, wrote=function == WRITE_VAR)
        elif transaction.rosctr == USERDATA and self.bindings.bsend:
            self._block(transaction)

    def _items(self, transaction: Transaction, *, wrote: bool) -> None:
        """Decode bound contents in the items of a read or write, if an item has the whole content."""
        ends = transaction.connection.tcp.ends
        found: list[ScdMessage] = []
        for result in transaction.s7_results:
            item = result.item
            if item is None or result.data is None or item.start_bit < 0 or item.start_bit & 7:
                continue
            block = item.db if in_blocks(item.area) else 0  # outside of DBs the field has no meaning
            for binding in self.bindings.s7.get((item.area, block), ()):
                begin = binding.offset - (item.start_bit >> 3)
                if begin >= 0 and begin + binding.size <= len(result.data):
                    if binding.matches(ends[0].address, ends[1].address):
                        found += self._content(transaction, binding, result, begin, wrote=wrote)
        if found:
            transaction._carried = found

    def _content(
        self, transaction: Transaction, binding: Binding, result: ItemResult, begin: int, *, wrote: bool
    ) -> list[ScdMessage]:
        assert result.data is not None
        assert result.item is not None
        octets = result.data[begin : begin + binding.size]
        accepted = not wrote or result.return_code == SUCCESS
        return self._inside(transaction, binding, octets, begin, result.item.address, asked=wrote, accepted=accepted)

    def _inside(
        self,
        transaction: Transaction,
        binding: Binding,
        octets: bytes,
        begin: int,
        place: str,
        *,
        asked: bool,
        accepted: bool,
    ) -> list[ScdMessage]:
        """Return the messages in octets that an S7 transaction carried in its request (``asked``) or its answer.

        If a pair is only likely, the answer may belong to another request: then nothing is certainly accepted, and the content
        of the answer is not used as evidence about the device.
        """
        connection = transaction.connection
        device = self.devices.at(connection.client if binding.device == "peer" else connection.server)
        told = []
        for found in self._decode(device, binding, octets, begin):
            found.frame = transaction.request_frame if asked else transaction.response_frame
            found.time_ns = transaction.request_ns if asked else transaction.response_ns
            found.connection = connection.number
            found.side = transaction.asked_by if asked else 1 - transaction.asked_by
            found.place = place
            if asked or not transaction.is_likely:
                self._judge.content(device, found, accepted=accepted and not transaction.is_likely)
            told.append(found)
        return told

    def _block(self, transaction: Transaction) -> None:
        """Decode a BSEND with a bound R_ID when its last piece was taken."""
        number = transaction.connection.number
        joiner = self._joiners.get(number)
        if joiner is None:
            head = transaction.parameters.userdata
            if head is None or head.group != GROUP_PBC:
                return
            joiner = self._joiners[number] = Joiner()
            if len(self._joiners) > MAX_JOINERS:
                del self._joiners[next(iter(self._joiners))]
                self.blocks_forgotten += 1
        chain = joiner.feed(transaction)
        if chain is None or chain.r_id < 0:
            return
        ends = transaction.connection.tcp.ends
        for binding in self.bindings.bsend.get(chain.r_id, ()):
            if binding.matches(ends[0].address, ends[1].address):
                place = f"BSEND 0x{chain.r_id:08x}"
                accepted = not transaction.has_errors
                transaction._carried = self._inside(
                    transaction, binding, bytes(chain.sent), 0, place, asked=True, accepted=accepted
                )
                return

    def message_count(self) -> int:
        """Return how many messages were found with all bindings together."""
        return sum([count.messages for count in self.counts.values()])

    def as_dict(self) -> dict[str, Any]:
        """Return what was found where, and with which dictionary (docs/json.md)."""
        return {
            "dictionary": encodable(self.dictionary.name),
            "version": encodable(self.dictionary.version),
            "wire_id": self.dictionary.wire_id.hex(),
            "bindings": [
                {
                    "name": encodable(name),
                    "messages": count.messages,
                    "values": count.values,
                    "not_decoded": count.errors,
                    "cut": count.cut,
                }
                for name, count in self.counts.items()
            ],
            "unpaired": self.unpaired,
            "octets_skipped": self.skipped,
            "devices_forgotten": self.devices.forgotten,
            "constants_overlooked": self.devices.overlooked,
            "counters_forgotten": self._judge.forgotten,
            "blocks_forgotten": self.blocks_forgotten,
        }

    def restart(self) -> None:
        """Another capture begins: forget mappings and constants."""
        self.devices.restart()

    def end(self, side: Side, frame: int, time_ns: int) -> None:
        """The connection is over: its counters are no longer needed."""
        self._judge.forget(side.connection.number)
        self._joiners.pop(side.connection.number, None)


def _reference(message: Message) -> int:
    """Return the reference that request and answer share (profile, reference 3.3): the tid, else the object, else nothing."""
    if "tid" in message.numbers:
        return message.tid & REFERENCE
    if "index" in message.numbers:
        return (_BY_OBJECT | message.index << 8 | message.sub) & REFERENCE
    return 0
