"""Findings about connections: negotiation, PDU sizes, number of open jobs, endings (reference 7.1 and 7.2)."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.findings.crowd import beside
from dissect.engine.findings.known_bugs_tables import KNOWN_BUGS
from dissect.engine.findings.reporter import Reporter
from dissect.engine.transactions.connection import ISO_TSAP_PORT, Connection
from dissect.engine.transactions.ending import DISCONNECT, ERROR_TPDU, Ending
from dissect.engine.transactions.gaps import has_gaps
from dissect.engine.transactions.open_requests import FEW_JOBS, GIVEN_UP_NS
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import ConnectionTable
from dissect.engine.transactions.transaction import Transaction
from dissect.packets.tcp.stream import HALF_SPACE, MASK
from dissect.protocols.ibh.tables import IBH_NETLINK, NETLINK_PORT
from dissect.protocols.iso.cotp import Tpdu
from dissect.protocols.iso.tables import DR_REASONS, ER_CAUSES
from dissect.protocols.s7.parameters import Parameters
from dissect.protocols.s7.tables import ACK, SETUP_COMMUNICATION
from dissect.wire.codes import CodeTable
from dissect.wire.text import count

#: The smallest sensible PDU length: the setup answer itself has 20 octets, and no real device grants less than 240.
_MIN_PDU_LENGTH: Final = 64
#: A connection must have this many PDUs to be reported as captured on one side only.
_ONE_SIDED_PDUS: Final = 3
#: A bit of `Connection._told` for side 0, shifted by one for side 1; the transport rules use the lower bits.
_REDUNDANT: Final = 64
#: Another bit: two open requests with the same reference were reported.
_SHARED: Final = 512
#: If this many requests were open when a connection was cut, a single finding sums them up.
_SEVERAL: Final = 2
#: Reasons in a DR without information: not specified, normal disconnect.
_NO_REASON: Final = frozenset((0x00, 0x80))


def judge_request(
    reporter: Reporter, side: Side, parameters: Parameters, open_now: i64, frame: i64, time_ns: i64
) -> str:
    """Report a request before communication was set up, or more open requests than granted.

    Return the slug of the fault of the request itself, empty for none.
    """
    connection = side.connection
    fault = ""
    number = connection.number
    if parameters.function == SETUP_COMMUNICATION:
        _judge_again(reporter, connection, parameters, frame, time_ns)
        connection.setup_seen = True
        connection.setup_open = True
        if parameters.setup is not None:
            connection.setup_asked = parameters.setup
    elif not connection.mid_stream and not has_gaps(side) and _too_early(side):
        connection.setup_seen = True  # reported once
        connection.setup_open = False
        fault = "session.data_before_setup"
        reporter.note(fault, number, [frame], time_ns, parameters.function_name)
    allowed = connection.jobs_allowed(side.index)
    if allowed and open_now > allowed:
        if allowed < FEW_JOBS:
            # Leave out requests that the client has given up after a long wait, and those whose answer a gap may hide.
            peer = side.peer
            hole_frame: i64 = 0
            hole_end: i64 = -1
            if peer is not None:  # as an expression it would create int objects (mypyc)
                hole_frame = peer.hole_frame
                hole_end = peer.hole_end
            requests = connection.open_requests[side.index]
            open_now = requests.open_since(time_ns - GIVEN_UP_NS, hole_frame, hole_end, allowed + 1)
        if open_now > allowed and side.told_jobs == frame:
            # The text about the packet applies to each of its requests.
            reporter.count("session.too_many_jobs", number, frame, time_ns)
        elif open_now > allowed:
            side.told_jobs = frame
            detail = f"more requests pending than the {allowed} granted (AmQ)"
            reporter.note("session.too_many_jobs", number, [frame], time_ns, detail)
    return fault


def judge_shared(reporter: Reporter, side: Side, parameters: Parameters, frame: i64, time_ns: i64) -> None:
    """Report a request with the same reference as one that is still open; once per connection."""
    connection = side.connection
    if not connection._told & _SHARED:
        connection._told |= _SHARED
        detail = f"{parameters.subject}: {connection.tcp.ends[side.index]} still waits for an answer to the one before"
        reporter.note("session.shared_reference", connection.number, [frame], time_ns, detail)
    else:
        reporter.again("session.shared_reference", connection.number, frame, time_ns)


def _judge_again(reporter: Reporter, connection: Connection, parameters: Parameters, frame: i64, time_ns: i64) -> None:
    """Report a second setup of communication on one connection."""
    asked = parameters.setup
    before = connection.setup_asked
    if asked is not None and before is not None:
        same = asked.as_dict() == before.as_dict()
        detail = "the same values" if same else f"PDU length {asked.pdu_length}, before {before.pdu_length}"
        reporter.note("session.repeated_setup", connection.number, [frame], time_ns, f"asks for {detail}")


def judge_size(reporter: Reporter, connection: Connection, size: i64, frame: i64, time_ns: i64) -> None:
    """Report a PDU of ``size`` octets, more than was negotiated."""
    detail = f"{size} bytes, {connection.pdu_length} negotiated"
    reporter.note("session.pdu_too_long", connection.number, [frame], time_ns, detail)


def judge_answer_size(
    reporter: Reporter, connection: Connection, parameters: Parameters, frame: i64, time_ns: i64
) -> None:
    """Report a read whose answer would be longer than the negotiated PDU length."""
    limit = connection.pdu_length
    size: i64 = parameters.answer_size
    detail = f"{parameters.subject}: the answer needs {size} bytes, {limit} negotiated"
    fill = sum([int(item.size & 1) for item in parameters.items[:-1] if item.size > 0])
    if size - fill <= limit:
        detail += f", {count(fill, 'fill byte')} included{KNOWN_BUGS['fill_bytes_forgotten'].note}"
    reporter.note("session.read_too_long", connection.number, [frame], time_ns, detail)


def judge_header(
    reporter: Reporter, side: Side, rosctr: i64, extra: i64, redundancy: i64, frame: i64, time_ns: i64
) -> None:
    """Report an S7 header with a redundancy id (once per side), or an Ack with more than a header."""
    connection = side.connection
    who = connection.tcp.ends[side.index]
    told: i64 = _REDUNDANT << side.index
    if redundancy and not connection._told & told:
        connection._told |= told
        reporter.note("s7.redundancy_id", connection.number, [frame], time_ns, f"0x{redundancy:04x} from {who}")
    elif redundancy:
        reporter.again("s7.redundancy_id", connection.number, frame, time_ns)
    if rosctr == ACK and extra > 0:
        reporter.note("s7.ack_content", connection.number, [frame], time_ns, f"{extra} bytes from {who}")


def _too_early(side: Side) -> bool:
    """Return whether a request comes before communication is set up: no setup was requested, or its answer is still to come."""
    connection = side.connection
    if not connection.setup_seen:
        return True
    peer = side.peer
    if not connection.setup_open or peer is None:
        return False
    # An acknowledged answer has arrived, even if the capture shows it later or never.
    unseen: i64 = (side.last_ack - peer.stream.next_seq) & MASK
    return peer.captured and peer.holes == 0 and peer.stream.held is None and not 0 < unseen < HALF_SPACE


def judge_grant(reporter: Reporter, transaction: Transaction) -> None:
    """Report a setup answer that grants more than requested, or a PDU length that is too small to work with."""
    transaction.connection.setup_open = False
    granted = transaction.response_parameters.setup if transaction.response_parameters is not None else None
    asked = transaction.parameters.setup
    if granted is None or asked is None or transaction.error_code:
        return
    wrong = ""
    if granted.pdu_length > asked.pdu_length:
        wrong = f"PDU length {granted.pdu_length} granted, {asked.pdu_length} requested"
    elif granted.pdu_length < _MIN_PDU_LENGTH:
        wrong = f"PDU length {granted.pdu_length} granted"
    elif granted.max_amq_called > asked.max_amq_called or granted.max_amq_calling > asked.max_amq_calling:
        wrong = (
            f"AmQ {granted.max_amq_calling}/{granted.max_amq_called} granted,"
            f" {asked.max_amq_calling}/{asked.max_amq_called} requested"
        )
    if wrong:
        reporter.note(
            "session.bad_grant",
            transaction.connection.number,
            [transaction.request_frame, transaction.response_frame],
            transaction.response_ns,
            wrong,
        )


def judge_port(reporter: Reporter, connection: Connection, frame: i64, time_ns: i64) -> None:
    """Report S7 communication with neither end on the usual port (ISO-on-TCP: 102); once per connection."""
    ends = connection.tcp.ends
    usual = NETLINK_PORT if connection.protocol == IBH_NETLINK else ISO_TSAP_PORT
    if ends[0].port != usual and ends[1].port != usual:
        who = f"server {connection.server}" if connection.client_known else f"between {ends[0]} and {ends[1]}"
        reporter.note("session.unusual_port", connection.number, [frame], time_ns, who)


def judge_disconnect(
    reporter: Reporter, side: Side, tpdu: Tpdu, table: ConnectionTable, frame: i64, time_ns: i64
) -> None:
    """Report a DR: it refuses a connect request or ends a connection. ``table`` has the open connections."""
    connection = side.connection
    reason = _reason(DR_REASONS, tpdu.field("reason"))
    who = connection.tcp.ends[side.index]
    if connection.cr_seen and not connection.established:
        tsap = connection.tsap_called
        where = f" for called TSAP {tsap.describe()}" if tsap is not None else ""
        connection.refused = reason
        if reporter.wants("cotp.refused", connection.number, frame, frame, time_ns):
            detail = f"{who} refuses{where}: {reason}{beside(table, connection)}"
            reporter.detail("cotp.refused", connection.number, [frame], time_ns, detail)
    else:
        connection._note_iso_end(f"DR from {who}: {reason}", DISCONNECT, side.index, frame, time_ns)
        if not _is_leave(connection, side, tpdu):
            reporter.note("cotp.disconnected", connection.number, [frame], time_ns, f"{who}: {reason}")


def _reason(codes: CodeTable, number: i64) -> str:
    """Return the name of a reason; -1 means that the TPDU ended before the reason."""
    return codes.name(number) if number >= 0 else "no reason given"


def _is_leave(connection: Connection, side: Side, tpdu: Tpdu) -> bool:
    """Return whether a DR is the normal leave of a client such as python-snap7: no special reason, and nothing is open."""
    leaves = connection.client_known and side.index == connection.client_side and tpdu.field("reason") in _NO_REASON
    return leaves and not connection.open_requests[0].count and not connection.open_requests[1].count


def judge_error_tpdu(reporter: Reporter, side: Side, tpdu: Tpdu, frame: i64, time_ns: i64) -> None:
    """Report an ER TPDU: its sender rejected something that the other side sent."""
    cause = _reason(ER_CAUSES, tpdu.field("cause"))
    connection = side.connection
    words = f"ER from {connection.tcp.ends[side.index]}: {cause}"
    connection._note_iso_end(words, ERROR_TPDU, side.index, frame, time_ns)
    reporter.note("cotp.error", connection.number, [frame], time_ns, cause)


def judge_cut(reporter: Reporter, side: Side, ending: Ending, table: ConnectionTable) -> None:
    """Report, in one finding, that a side ended the connection while several requests or the connect request were open.

    A single open request has its own finding, `transaction.unanswered`, which says who cut it off.
    """
    connection = side.connection
    peer = side.peer
    if not ending.cut or peer is None or side.holes or peer.holes or not (side.captured and peer.captured):
        return
    if not ending.connecting and ending.open_requests < _SEVERAL:
        return
    said = ending.deed(connection)
    if ending.connecting:
        said += " before the connect request was answered"
        tsap = connection.tsap_called
        if tsap is not None:
            said += f", called TSAP {tsap.describe()}"
        if ending.side != connection.client_side:
            said += beside(table, connection)
    elif ending.oldest is not None:
        said += f" with {ending.open_requests} requests pending, the oldest is {ending.oldest.subject}, {ending.age()}"
        said += ending.last_heard()
    frames = [frame for frame in (ending.oldest_frame, ending.frame) if frame]
    reporter.note("session.cut", connection.number, [int(frame) for frame in frames], ending.time_ns, said)


def judge_end(reporter: Reporter, side: Side) -> None:
    """A connection is over: report if only one side of it was captured."""
    connection = side.connection
    peer = side.peer
    if peer is None or connection.pdus < _ONE_SIDED_PDUS or connection.udp:
        return  # over UDP it is normal that one side is silent
    if not side.captured or not peer.captured:
        tcp = connection.tcp
        frames = [int(tcp.first_frame), int(tcp.last_frame)]
        detail = f"only packets from {tcp.ends[side.index if side.captured else peer.index]} were captured"
        reporter.note("capture.one_sided", connection.number, frames, tcp.last_ns, detail)
