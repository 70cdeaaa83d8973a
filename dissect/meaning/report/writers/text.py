"""Records as text: transactions, operations, PDUs and TPDUs, one line each, and their trees with ``-V``."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.naming import Naming
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.results import went_wrong
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report import facets, words
from dissect.meaning.report.certainty import mark
from dissect.meaning.report.facets import facet_of
from dissect.meaning.report.line_octets import ERRORS, LineOctets
from dissect.meaning.report.operations import styled_operation
from dissect.meaning.report.pdu_octets import KIND_WIDTH, PduOctets
from dissect.meaning.report.plus import plus_notes, plus_summary
from dissect.meaning.report.scd import scd_summary
from dissect.meaning.report.styled import FAILED, HANG, PLAIN, TREE_HANG, Line
from dissect.meaning.report.words import FRAMES_WIDTH, LATENCY_WIDTH, NUMBER_WIDTH, Places
from dissect.meaning.report.writer import Writer
from dissect.protocols.ibh.packet import IbhPacket, parse_packet
from dissect.protocols.ibh.tables import IBH_NETLINK
from dissect.protocols.iso.cotp import Tpdu, parse_tpdu
from dissect.protocols.iso.foreign import identify, identify_connect
from dissect.protocols.iso.tables import CC, CR, DR, DT, ED, ER
from dissect.protocols.iso.upper import UPPER_NAMES, classify, is_rdp_connect
from dissect.protocols.s7.errors import errors_of
from dissect.protocols.s7.items import Item, ItemResult
from dissect.protocols.s7.message import NOT_REFUSED, Pdu, parse_pdu
from dissect.protocols.s7.tables import JOB, RETURN_CODES, SUCCESS
from dissect.protocols.s7plus.hiding import Shown, shown_contents
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.wire.build import COMPILED
from dissect.wire.malformed import Malformed
from dissect.wire.text import Clock, decimal, hex_number, shortened, some

#: Maximum number of characters of a packet comment that are shown.
_COMMENT: Final = 1000
_BLANKS: Final[list[str]] = [" " * count for count in range(13)]
#: Faults that a PDU may have only because its end is missing.
_SHORT: Final = frozenset(("too_short", "length_beyond", "count_mismatch"))
_KINDS: Final = ("push", "request", "response", "type 3")


def transaction_line(transaction: Transaction, clock: Clock, places: Places, most: int = 0) -> str:
    """Return one transaction on one line: time, who asked whom, answer time, function, outcome, items or notes.

    If there are more than ``most`` items, the first ones are named, and the others counted; 0 names all.
    """
    ends = transaction.connection.tcp.ends
    begun = transaction.request_ns if transaction.request_frame else transaction.response_ns
    side = sender(transaction)
    facet = facet_of(transaction)
    frames = places.pair(int(transaction.request_frame), int(transaction.response_frame))
    ending = facets.outcome(transaction)
    subject = facet.subject(transaction)
    if most and subject:
        items = facet.items(transaction)
        subject = subject.replace(", ".join(items), some(items, most), 1)
    said = f"  {ending}" if ending else ""
    if subject:
        said += f"  {subject}"
    if likely := mark(transaction):
        said += f"  {likely}"
    number = decimal(transaction.number)
    latency = words.answer_time(transaction.latency_ns)
    return (
        f"{clock.moment(begun)}  #{number}{_blanks(NUMBER_WIDTH - len(number))} {frames}{_blanks(FRAMES_WIDTH - len(frames))}"
        f" {places.end(ends[side])} → {places.end(ends[1 - side])}"
        f"  {_blanks(LATENCY_WIDTH - len(latency))}{latency}  {transaction.function_name}{said}"
    )


def sender(transaction: Transaction) -> i64:
    """Return the side from which lines point to the other one: it sent the request, or the message that has no request."""
    return transaction.asked_by if transaction.request_frame else 1 - transaction.asked_by


def _blanks(count: i64) -> str:
    """Return ``count`` blanks; none if it is negative."""
    return _BLANKS[count] if count > 0 else ""


def pdu_line(pdu: Pdu, connection: Connection, clock: Clock, places: Places) -> str:
    """Return the part after the reference in the line of a PDU."""
    return _pdu_line(pdu, connection, clock, places, [])


def _pdu_line(
    pdu: Pdu, connection: Connection, clock: Clock, places: Places, faults: list[Malformed], most: int = 0
) -> str:
    """Return the line of a PDU; contradictions within its parts are added to ``faults``."""
    rest = _pdu_rest(pdu, connection, faults, most)
    kind = pdu.rosctr_name if pdu.rosctr >= 0 else "?"
    reference = hex_number(pdu.pdu_ref, 4) if pdu.pdu_ref >= 0 else "?"
    head = _head(pdu.frame, pdu.time_ns, connection, pdu.side, clock, places)
    return f"{head}  {kind.ljust(KIND_WIDTH)}  ref {reference}{rest}"


def _pdu_rest(pdu: Pdu, connection: Connection, faults: list[Malformed], most: int) -> str:
    """Return what follows the reference in the line of a PDU."""
    said = f"  {body}" if (body := _body(pdu, connection.naming, faults, most)) else ""
    function = f"  {pdu.function_name}" if pdu.function_name else ""
    if pdu.cut:
        said += "  TRUNCATED by the capture"
    wrong = [*_own_faults(pdu), *faults]
    if wrong:
        said += f"  MALFORMED {wrong[0]}"
    return f"{function}{said}"


def scd_line(found: ScdMessage, connection: Connection, clock: Clock, places: Places) -> str:
    """Return one SCD message on one line."""
    head = _head(int(found.frame), int(found.time_ns), connection, int(found.side), clock, places)
    return f"{head}  {scd_summary(found)}"


def plus_line(pdu: PlusPdu, connection: Connection, clock: Clock, places: Places, contents: Shown | None = None) -> str:
    """Return one S7comm-plus PDU on one line; ``contents`` are its decoded contents, if they were decoded before."""
    parts = [f"S7comm-plus {pdu.kind:<12}"]
    if pdu.readable:
        parts.append(f"seq {pdu.sequence}")
    found = contents[0] if contents is not None else shown_contents(pdu, shown=False)[0]
    said = [", ".join(plus_notes(pdu)), ", ".join(plus_summary(pdu, found))]
    parts += [text for text in (pdu.function_name, *said) if text]
    if pdu.frames > 1:
        parts.append(f"in {pdu.frames} frames")
    if pdu.cut:
        parts.append("CUT, the end is missing")
    if pdu.malformed:
        parts.append(f"{pdu.malformed[0].word} {pdu.malformed[0]}")
    elif found.malformed and not pdu.cut:
        fact = found.malformed[0]
        parts.append(f"{fact.word} {fact.at(pdu.place(fact.offset))}")
    return f"{_head(pdu.frame, pdu.time_ns, connection, pdu.side, clock, places)}  {'  '.join(parts)}"


def _head(frame: int, time_ns: int, connection: Connection, side: int, clock: Clock, places: Places) -> str:
    ends = connection.tcp.ends
    moment = clock.moment(time_ns)
    return f"{places.mark(frame).rjust(6)}  {moment}  {places.end(ends[side])} → {places.end(ends[1 - side])}"


def _body(pdu: Pdu, naming: Naming | None, faults: list[Malformed], most: int) -> str:
    parameters = pdu.parameters
    if pdu.error and parameters.userdata is None:
        return f"error {errors_of(pdu.function).coded(pdu.error)}"
    if parameters.setup is not None:
        setup = parameters.setup
        return str(setup)
    if parameters.items and pdu.rosctr == JOB:
        return some(_requested(pdu, parameters.items, naming), most)
    codes = pdu.return_codes()
    if codes:
        refused = [
            f"item {number}: {RETURN_CODES.name(code)}" for number, code in enumerate(codes, 1) if code != SUCCESS
        ]
        good = words.count(len(codes), "item")
        if not refused:
            return f"{good}, all good" if len(codes) > 1 else f"{good}, good"
        return f"{len(refused)} of {good} refused: {some(refused, most)}"
    head = parameters.userdata
    body = pdu.body
    if not pdu.cut:
        faults += body.malformed
    said = facets.notes_of(body)
    if head is None:
        return said
    error = f", error {errors_of(pdu.function).coded(head.error_code)}" if head.error_code else ""
    if pdu.refusing_code != NOT_REFUSED:
        error = f", refused {RETURN_CODES.coded(pdu.refusing_code)}"
    more = ", more to come" if head.extended and head.last_data_unit else ""
    return f"{_KINDS[head.type]}, sequence {head.sequence}{more}{error}{f'  {said}' if said else ''}"


def _requested(pdu: Pdu, items: list[Item], naming: Naming | None) -> list[str]:
    """Return the items of a job, with the values that it writes."""
    data = pdu.data_items()
    said = []
    for index, item in enumerate(items):
        answer = data[index] if index < len(data) else None
        written = answer.data if answer is not None else None
        # If the capture cut the data, the length field of the data item gives their size.
        said.append(facets.item(ItemResult(item, -1, written, answer if pdu.cut else None), index + 1, naming))
    return said


def tpdu_line(
    tpdu: Tpdu, frame: int, time_ns: int, connection: Connection, side: int, clock: Clock, places: Places
) -> str:
    """Return a TPDU that carries no S7 PDU on one line."""
    said = ""
    if tpdu.type in {CR, CC} and is_rdp_connect(tpdu.variable):
        said = identify_connect(tpdu.variable)
        return f"{_head(frame, time_ns, connection, side, clock, places)}  COTP {tpdu.name}  RDP{f', {said}' if said else ''}"
    if tpdu.type in {CR, CC}:
        said = f"  {words.tsaps(tpdu.tsap(0xC1), tpdu.tsap(0xC2), connection.protocol)}"
        if tpdu.tpdu_size:
            said += f", TPDU size {tpdu.tpdu_size}"
    elif tpdu.type in {DR, ER}:
        said = "".join(
            [
                f"  {value.field.codes.name(value.value)}"
                for value in tpdu.fields
                if value.field.codes and value.offset > 1
            ]
        )
    elif tpdu.type in {DT, ED}:
        said = f"  {words.carried(tpdu)}, {words.count(len(tpdu.data), 'byte')}"
        identity = identify(classify(tpdu.data, 0, len(tpdu.data)), tpdu.data, 0, len(tpdu.data))
        said += f": {identity}" if identity else ""
    said += _tpdu_fault(tpdu)
    return f"{_head(frame, time_ns, connection, side, clock, places)}  COTP {tpdu.name}{said}"


def _tpdu_fault(tpdu: Tpdu) -> str:
    return f"  MALFORMED {tpdu.malformed[0]}" if tpdu.malformed else ""


def carrier_said(tpdu: Tpdu, side: Side, time_ns: int, places: Places) -> str:
    """Return what a DT carries: a part of a message, or nothing, and then the request that it acknowledges before its answer.

    ``side`` sent it; its assembler has not taken the DT yet.
    """
    size = words.count(len(tpdu.data), "byte")
    ends = tpdu.field("eot") == 1
    if not side.assembler.clear:
        return f"{'last part' if ends else 'part'} of a message, {size}"
    if tpdu.data:
        name = words.PROTOCOLS[UPPER_NAMES[classify(tpdu.data, 0, len(tpdu.data))]]
        return f"{name}, {size}" if ends else f"first part of a message, {size}"
    request = None if ends else side.connection.open_requests[1 - side.index].asked_last()
    if request is None:
        return "empty"
    after = words.duration(time_ns - int(request.request_ns))
    return f"empty, acknowledges {request.function_name} of {places.phrase([int(request.request_frame)])} after {after}"


def netlink_line(
    packet: IbhPacket, frame: int, time_ns: int, connection: Connection, side: int, clock: Clock, places: Places
) -> str:
    """Return an IBH-NetLink packet that carries no S7 PDU on one line."""
    parts = [packet.name]
    if packet.station >= 0:
        parts.append(f"station {packet.station}, connection {packet.src_conn}/{packet.dst_conn}")
    if packet.acked >= 0:
        parts.append(f"of packet {packet.acked}")
    if packet.data:
        parts.append(f"{words.message_name(packet.data)}, {words.count(len(packet.data), 'byte')}")
    said = "  ".join(parts)
    if packet.malformed:
        said += f"  MALFORMED {packet.malformed[0]}"
    return f"{_head(frame, time_ns, connection, side, clock, places)}  IBH {said}"


def comment_line(frame: int, text: str, places: Places) -> str:
    """Return the line of a comment in the capture on a packet."""
    return f"{places.mark(frame).rjust(6)}  comment: {shortened(text, _COMMENT)}"


class TextWriter(Writer):
    """Writes a line for each record; with ``verbose`` also the field tree and octets of each PDU."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self.number_width = NUMBER_WIDTH
        self._octets: LineOctets = LineOctets(self.clock, self.places)
        self._pdus: PduOctets = PduOctets(self.clock, self.places)

    def begin(self, places: Places) -> None:
        """Take ``places`` for the names of packets."""
        super().begin(places)
        self._octets = LineOctets(self.clock, places)
        self._pdus = PduOctets(self.clock, places)

    def transaction(self, transaction: Transaction) -> None:
        """Add the line of a transaction."""
        line = self._octets.of(transaction) if COMPILED and self.plain else b""
        if line:
            self.lines.append(line)
        else:
            text = transaction_line(transaction, self.clock, self.places, self.most)
            self._put(text, FAILED if went_wrong(transaction) else PLAIN, HANG)

    def operation(self, operation: Operation) -> None:
        """Add the line of an operation."""
        line = styled_operation(operation, self.clock, self.places)
        self._put(line.text, line.style, line.hang)

    def comment(self, frame: i64, text: str) -> None:
        """Add the line of a comment."""
        self._add(comment_line(int(frame), text, self.places))

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Add the line of a TPDU that carries no S7 PDU."""
        tpdu = parse_tpdu(octets[4:])
        connection = side.connection
        line = tpdu_line(tpdu, int(frame), int(time_ns), connection, int(side.index), self.clock, self.places)
        self._add(line, bool(tpdu.malformed))
        if self.verbose:
            from dissect.meaning.report.tree import tpdu_tree_lines  # late: only -V shows trees

            self._tree("\n".join(tpdu_tree_lines(octets)))

    def carrier(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Add the line of a DT that carries a PDU, a part of one or nothing; contents are shown with the PDU."""
        tpdu = parse_tpdu(octets[4:])
        head = _head(int(frame), int(time_ns), side.connection, int(side.index), self.clock, self.places)
        said = f"{head}  COTP {tpdu.name}  {carrier_said(tpdu, side, int(time_ns), self.places)}"
        self._add(said + _tpdu_fault(tpdu), bool(tpdu.malformed))
        if self.verbose:
            from dissect.meaning.report.tree import carrier_tree_text

            self._tree(carrier_tree_text(octets))

    def ibh_packet(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Add the line of an IBH-NetLink packet that carries no part of a PDU."""
        packet = parse_packet(octets)
        connection = side.connection
        line = netlink_line(packet, int(frame), int(time_ns), connection, int(side.index), self.clock, self.places)
        self._add(line, bool(packet.malformed))
        if self.verbose:
            from dissect.meaning.report.tree import netlink_tree_lines

            self._tree("\n".join(netlink_tree_lines(octets)))

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7 PDU."""
        connection = side.connection
        asks: bool = False  # a request to read, whose end is kept
        if self.plain and not self.verbose and not cut:
            known = self._pdus.of(frame, time_ns, side, octets, self.carrying)
            if known:
                self.lines.append(known)
                return
            asks = self._pdus.asks
        pdu = parse_pdu(octets, frame, time_ns, connection.number, side.index, cut)
        faults: list[Malformed] = []
        if asks:
            self._pdus.keep(octets, _pdu_rest(pdu, connection, faults, self.most))
            self.lines.append(self._pdus.of(frame, time_ns, side, octets, self.carrying))
            return
        line = _pdu_line(pdu, connection, self.clock, self.places, faults, self.most)
        header = self.header_of(side, octets)
        if header is not None:
            line += header.remark
        self._add(line, bool(faults) or header is not None or _says_no(pdu))
        if self.verbose:
            from dissect.meaning.report.tree import tree_text

            self._tree(tree_text(pdu, self._whole(octets, cut), connection.protocol == IBH_NETLINK))

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7comm-plus PDU."""
        connection = side.connection
        pdu = parse_plus(octets, frame, time_ns, connection.number, side.index, cut)
        contents = shown_contents(pdu, self.verbose)
        line = plus_line(pdu, connection, self.clock, self.places, contents)
        header = self.header_of(side, octets)
        if header is not None:
            line += header.remark
        self._add(line, bool(pdu.malformed) or header is not None)
        if self.verbose:
            from dissect.meaning.report.tree import DECRYPTED, REASSEMBLED, plus_tree_lines

            why = DECRYPTED if connection.tls is not None and connection.tls.is_open else REASSEMBLED
            self._tree("\n".join(plus_tree_lines(pdu, self._whole(octets, cut), why, contents)))

    def scd_message(self, found: ScdMessage, connection: Connection) -> None:
        """Add the line of an SCD message."""
        self._add(scd_line(found, connection, self.clock, self.places), found.message.error is not None)
        if self.verbose:
            from dissect.meaning.report.scd_tree import scd_tree_lines

            self._tree("\n".join(scd_tree_lines(found)))

    def _whole(self, octets: bytes, cut: bool) -> bytes:
        """Return the current packet if it carries the whole PDU, else empty octets."""
        return self.carrying if self.carrying.endswith(octets) and not cut else b""

    def _add(self, text: str, failed: bool = False) -> None:
        self._put(text, FAILED if failed else PLAIN, HANG)

    def _tree(self, text: str) -> None:
        self._put(text, PLAIN, TREE_HANG)

    def _put(self, text: str, style: str, hang: int) -> None:
        self.lines.append(text.encode("utf-8", ERRORS) if self.plain else Line(text, style, hang))


def _own_faults(pdu: Pdu) -> list[Malformed]:
    """Return the faults of a PDU, without those that are only due to the cut of the capture."""
    return [fact for fact in pdu.malformed if not (pdu.cut and fact.reason in _SHORT)]


def _says_no(pdu: Pdu) -> bool:
    """Return whether a PDU is damaged, or refuses something."""
    return bool(_own_faults(pdu) or pdu.refused)
