"""Our side of the comparison: the facts that the engine reads from a TPDU or a PDU.

Values are those of the objects that users get (`Tpdu`, `Pdu`, `Item`, `DataItem` …) if such an object has an attribute for the
field. Only constant fields, which no object keeps, are read from the octets by their layout.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Final

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options
from dissect.engine.transactions.connection import ISO_TSAP_PORT, Connection
from dissect.engine.transactions.side import Side
from dissect.files.session import Run
from dissect.protocols.ibh.tables import IBH_NETLINK
from dissect.protocols.iso import layouts as iso
from dissect.protocols.iso.cotp import CALLED_TSAP, CALLING_TSAP, PREFERRED_SIZE, TPDU_SIZE, Tpdu, parse_tpdu
from dissect.protocols.s7 import layouts as s7
from dissect.protocols.s7.bodies import parse_body
from dissect.protocols.s7.items import DATA_HEAD, item_fill
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import ACK_HEADER_SIZE
from dissect.protocols.s7.syntaxes import PBC_ID
from dissect.protocols.s7.tables import BSEND, READ_VAR, ROSCTR, USERDATA, WRITE_VAR
from dissect.protocols.tls.key_log import KeyLog
from dissect.testing.oracle import facts
from dissect.testing.oracle.facts import FieldPlace, LocatedValue, Record
from dissect.testing.oracle.plus import PlusProof
from dissect.wire.layout import Layout

#: Reasons why a PDU is not compared.
NO_DISSECTOR: Final = "Wireshark has no dissector for IBH-NetLink"
ENCRYPTED: Final = "Wireshark is not asked to decrypt TLS"

#: Attributes whose names differ from their fields.
_ATTRIBUTES: Final = {"address": "start_bit"}
#: Octets of the parameters of a USEND before its R_ID.
_BEFORE_R_ID: Final = 5
_NO_FIELDS: Final = object()
#: Position of the length of the data block in a PDU, and of the data unit reference in extended parameters.
_DATA_LENGTH: Final = 8
_DATA_UNIT_REF: Final = 8
#: Function group of BSEND.
PBC: Final = 6
_TSAPS: Final = {CALLING_TSAP: facts.CALLING_TSAP, CALLED_TSAP: facts.CALLED_TSAP}
_SIZES: Final = {TPDU_SIZE: facts.TPDU_SIZE, PREFERRED_SIZE: facts.PREFERRED_SIZE}


class Witness(Observer):
    """Reads a capture and keeps the octets of every TPKT and S7 PDU, in the order of the engine's reports.

    ``ports`` are recognised ports other than 102: Wireshark needs them as a preference. ``not_comparable`` counts PDUs that
    Wireshark cannot dissect, by reason. ``plus`` are the self-consistency checks of S7comm-plus.
    """

    def __init__(self, path: str, tls_keys: KeyLog | None = None) -> None:
        super().__init__()
        self.wants_tpdus = True
        self.wants_pdus = True
        self.messages: dict[str, list[tuple[int, bytes]]] = {facts.TPDU: [], facts.PDU: []}
        self.ports: set[int] = set()
        self.not_comparable: Counter[str] = Counter()
        self.plus = PlusProof()
        run = Run([path], self, Options(tls_keys=tls_keys))
        while run.step():
            pass
        #: The part of the capture that could not be read, empty for none.
        self.loss = run.files[0].loss

    def records(self, kind: str, numbers: Iterable[int]) -> list[Record]:
        """Return the facts of a record, by its index in ``found``."""
        read = tpdu_record if kind == facts.TPDU else pdu_record
        records = []
        for number in numbers:
            record = read(*self.messages[kind][number])
            record.number = number
            records.append(record)
        return records

    def connection_opened(self, connection: Connection) -> None:
        """Note a port other than that of ISO-on-TCP."""
        if connection.protocol == IBH_NETLINK:
            return
        ends = connection.tcp.ends
        if any(end.port == ISO_TSAP_PORT for end in ends):
            return
        server = (
            ends[1 - connection.tcp.initiator] if connection.tcp.known_start else min(ends, key=lambda end: end.port)
        )
        self.ports.add(server.port)

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        """Keep a TPKT."""
        self.messages[facts.TPDU].append((frame, octets))

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Keep an S7 PDU, unless it came in packets that Wireshark shows as data."""
        if side.connection.protocol == IBH_NETLINK:
            self.not_comparable[NO_DISSECTOR] += 1
        elif side.inner is not None:
            self.not_comparable[ENCRYPTED] += 1
        else:
            self.messages[facts.PDU].append((frame, octets))

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Check an S7comm-plus PDU."""
        self.plus.take(octets, frame, side.connection.number, side.index, cut)


def _read(
    facts_: dict[FieldPlace, LocatedValue], part: str, number: int, layout: Layout, octets: bytes, at: int, read: object
) -> None:
    """Add the fields of one header: their positions from the layout, their values from the object ``read``."""
    for value in layout.read(octets, at):
        field = value.field
        if field.wireshark:
            attribute = getattr(read, _ATTRIBUTES.get(field.name, field.name), None)
            fact = attribute if isinstance(attribute, int) else value.value
            facts_[FieldPlace(part, number, field.wireshark)] = LocatedValue(fact, value.offset)


def tpdu_record(frame: int, octets: bytes) -> Record:
    """Return the facts of a TPKT and its TPDU."""
    facts_: dict[FieldPlace, LocatedValue] = {}
    _read(facts_, facts.IN_TPKT, 0, iso.TPKT, octets, 0, _NO_FIELDS)
    tpdu = parse_tpdu(octets[facts.TPKT_SIZE :])
    for value in tpdu.fields:
        if value.field.wireshark:
            facts_[FieldPlace(facts.IN_TPDU, 0, value.field.wireshark)] = LocatedValue(value.value, value.offset)
    for number, parameter in enumerate(tpdu.parameters, 1):
        at = parameter.offset
        code, length = iso.PARAMETER.fields
        facts_[FieldPlace(facts.IN_PARAMETER, number, code.wireshark)] = LocatedValue(parameter.code, at)
        facts_[FieldPlace(facts.IN_PARAMETER, number, length.wireshark)] = LocatedValue(
            len(parameter.value), at + code.size
        )
    _connection_parameters(facts_, tpdu)
    header = facts.TPKT_SIZE + min(octets[facts.TPKT_SIZE] + 1, len(octets) - facts.TPKT_SIZE)
    return Record(facts.TPDU, frame, octets[:header], facts_)


def _connection_parameters(facts_: dict[FieldPlace, LocatedValue], tpdu: Tpdu) -> None:
    """Add the parameters of a CR or CC: TSAPs and sizes."""
    for code, name in _TSAPS.items():
        tsap = tpdu.tsap(code)
        if tsap is not None and tsap.octets:
            facts_[FieldPlace(facts.IN_TPDU, 0, name)] = LocatedValue(tsap.octets, _last(tpdu, code) + 2)
    for code, name in _SIZES.items():
        # `tpdu_size` is the size in force; each parameter is compared with its own value.
        alone = Tpdu(tpdu.type, tpdu.layout)
        stated = [parameter.value for parameter in tpdu.parameters if parameter.code == code]
        alone.take_variable(b"".join([bytes((code, len(value))) + value for value in stated]))
        if alone.tpdu_size:
            facts_[FieldPlace(facts.IN_TPDU, 0, name)] = LocatedValue(alone.tpdu_size, _last(tpdu, code) + 2)


def _last(tpdu: Tpdu, code: int) -> int:
    """Return the position of the last parameter with ``code``."""
    return [parameter.offset for parameter in tpdu.parameters if parameter.code == code][-1]


def pdu_record(frame: int, octets: bytes) -> Record:
    """Return the facts of an S7 PDU."""
    facts_: dict[FieldPlace, LocatedValue] = {}
    pdu = parse_pdu(octets, frame)
    header = s7.ACK_HEADER if pdu.header_size == ACK_HEADER_SIZE else s7.HEADER
    _read(facts_, facts.IN_HEADER, 0, header, octets, 0, pdu)
    _parameters(facts_, pdu)
    if pdu.rosctr == USERDATA:
        if pdu.data_length >= DATA_HEAD:
            _read(facts_, facts.IN_DATA, 0, s7.DATA_ITEM, octets, pdu.data_offset, _NO_FIELDS)
        _body(facts_, facts.IN_BODY, pdu, 0)
        return Record(facts.PDU, frame, octets, facts_)
    for number, item in enumerate(pdu.parameters.items, 1):
        layout = s7.S7ANY_ITEM if item.transport_size >= 0 else s7.ITEM_HEAD
        _read(facts_, facts.IN_ITEM, number, layout, octets, pdu.header_size + item.offset, item)
    _data_items(facts_, pdu)
    _body(facts_, facts.IN_BODY, pdu, 0)
    return Record(facts.PDU, frame, octets, facts_)


def _body(facts_: dict[FieldPlace, LocatedValue], place: str, pdu: Pdu, start: int) -> None:
    """Add the fields of a body after ``start`` that were not added already; positions count from there."""
    taken = {(fact.offset, content.name) for content, fact in facts_.items()}
    for part in parse_body(pdu).parts:
        if part.offset < start:
            continue
        for value in part.values:
            name, at = value.field.wireshark, value.offset - start
            if not name or value.end == value.offset or (at, name) in taken:
                continue
            content = value.value if value.field.bits is not None else pdu.octets[value.offset : value.end]
            facts_[FieldPlace(place, at, name)] = LocatedValue(content, at)


def take_joined(record: Record, joined: bytes) -> None:
    """Replace the body facts of the last PDU of an answer by those of the whole, joined answer.

    The answer is read as the payload of a PDU with the head of ``record`` and without further parts.
    """
    octets = bytearray(record.octets)
    pdu = parse_pdu(record.octets)
    payload = pdu.data_offset + DATA_HEAD
    # Each piece of a BSEND begins with its R_ID, which Wireshark does not join.
    head = pdu.parameters.userdata
    start = payload + (PBC_ID.size if head is not None and (head.group, head.subfunction) == (PBC, BSEND) else 0)
    octets[start:] = joined
    size = len(octets) - payload
    octets[_DATA_LENGTH : _DATA_LENGTH + 2] = (DATA_HEAD + size).to_bytes(2, "big")
    octets[payload - 2 : payload] = size.to_bytes(2, "big")
    octets[pdu.header_size + _DATA_UNIT_REF] = 0
    for place in [place for place, fact in record.facts.items() if place.part == facts.IN_BODY]:
        if place.number >= start:
            del record.facts[place]
    _body(record.facts, facts.IN_JOINED, parse_pdu(bytes(octets)), start)


def _parameters(facts_: dict[FieldPlace, LocatedValue], pdu: Pdu) -> None:
    if pdu.rosctr not in ROSCTR:
        return
    at = pdu.header_size
    parameters = pdu.parameters
    octets = pdu.octets[: at + pdu.param_length]
    part = facts.IN_PARAMETERS
    if parameters.userdata is not None:
        _userdata(facts_, pdu, octets)
    elif parameters.setup is not None:
        _read(facts_, part, 0, s7.SETUP, octets, at, parameters.setup)
    elif parameters.function in {READ_VAR, WRITE_VAR} and parameters.item_count >= 0:
        _read(facts_, part, 0, s7.VARIABLES_HEAD, octets, at, parameters)
    elif parameters.function >= 0 and pdu.rosctr != USERDATA:
        function = s7.VARIABLES_HEAD.fields[0]
        facts_[FieldPlace(part, 0, function.wireshark)] = LocatedValue(parameters.function, at)


def _userdata(facts_: dict[FieldPlace, LocatedValue], pdu: Pdu, octets: bytes) -> None:
    head = pdu.parameters.userdata
    assert head is not None
    at = pdu.header_size
    part = facts.IN_PARAMETERS
    if pdu.function != 0:
        _read(facts_, part, 0, s7.MODE_TRANSITION, octets, at, _NO_FIELDS)
        return
    layout = s7.USERDATA_EXTENDED if head.extended else s7.USERDATA_SHORT
    if head.usend:
        octets = octets[: at + _BEFORE_R_ID]  # at the position of type and group in other requests
    _read(facts_, part, 0, layout, octets, at, head)


def _data_items(facts_: dict[FieldPlace, LocatedValue], pdu: Pdu) -> None:
    part = facts.IN_DATA_ITEM
    items = pdu.data_items()
    for number, item in enumerate(items, 1):
        _read(facts_, part, number, s7.DATA_ITEM, pdu.octets, item.offset, item)
        size = len(item.data)
        if not size:
            continue
        at = item.offset + DATA_HEAD
        facts_[FieldPlace(part, number, facts.CONTENT)] = LocatedValue(item.data, at)
        if item_fill(size, number == len(items)):
            facts_[FieldPlace(part, number, facts.FILL)] = LocatedValue(pdu.octets[at + size], at + size)
    if not items:
        name = s7.DATA_ITEM.fields[0].wireshark
        for number, code in enumerate(pdu.return_codes(), 1):
            facts_[FieldPlace(part, number, name)] = LocatedValue(code, pdu.data_offset + number - 1)
