"""Records as JSON lines: one object a line, keys in a fixed order (docs/json.md).

This is the bulk output, so lines are put together from cached pieces: the text of a polled item or of a parameter block is made
once, and used for every transaction that repeats it (`dissect.meaning.report.item_json`, `dissect.meaning.report.plus_octets`).
"""

from __future__ import annotations

from typing import Final

from librt.strings import BytesWriter
from mypy_extensions import i64

from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.good_items import GoodItems, good_octets
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.results import DOUBTS, FUNCTION_MISMATCH
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import ANSWERED, OUTCOMES, Transaction
from dissect.meaning.report.facet import Locate
from dissect.meaning.report.facets import FACETS
from dissect.meaning.report.item_json import (
    errors_json,
    function_text,
    item_json,
    setup_text,
    with_tags,
    write_good_item,
)
from dissect.meaning.report.operations import operation_json
from dissect.meaning.report.pdu_json import PduLines, with_header
from dissect.meaning.report.plus_octets import PlusLines
from dissect.meaning.report.read_plan import ReadPlan
from dissect.meaning.report.scd import scd_json
from dissect.meaning.report.tpdu_json import tpdu_json_line
from dissect.meaning.report.words import Places
from dissect.meaning.report.writer import Writer
from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.parameters import ACK_HEADER_SIZE, Parameters
from dissect.protocols.s7.tables import (
    ACK_DATA,
    JOB,
    READ_VAR,
    SETUP_COMMUNICATION,
    SUCCESS,
    WRITE_VAR,
)
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.parameters import PLUS
from dissect.wire.build import COMPILED
from dissect.wire.digits import Times, write_decimal
from dissect.wire.text import THREE, Clock, JsonTexts, decimal, json_text

TRANSACTION_SCHEMA: Final = "s7dissect.transaction/1"

_HEAD: Final = f'{{"schema":"{TRANSACTION_SCHEMA}","number":'
_CONNECTION: Final = ',"connection":'
_ITEMS: Final = ',"items":['
#: The part after the latency of an answered transaction; the same up to its items; and the part after items without errors.
_ANSWERED: Final = f',"outcome":"{OUTCOMES[ANSWERED]}","reason":null'.encode("ascii")
_WELL: Final = _ANSWERED + _ITEMS.encode("ascii")
_WELL_TEXT: Final = _WELL.decode("ascii")
_NO_ERRORS: Final = b'],"errors":[]}'
#: The text between items and errors.
_ERRORS: Final = b'],"errors":['
_NO_ERRORS_TEXT: Final = _NO_ERRORS.decode("ascii")
_HEAD_OCTETS: Final = _HEAD.encode("ascii")
_COMMA: Final = 0x2C
_SECOND_NS: Final = 1_000_000_000
#: A cache with this many entries is emptied.
_MAX_CACHED: Final = 8192
#: Places in the table of beginnings of lines (`_starts`), a power of two; a table is faster than a dictionary.
_PLACES: Final = 1024

#: First octet of the PDU reference in the header, and the one after its last. Notes are cached for PDUs of at most `_SHORT`
#: octets.
_REFERENCE_AT: Final = 4
_REFERENCE_END: Final = 6
_SHORT: Final = 240


class _Start:
    """The part of a line that depends on the connection and on who sent the request; ``key`` is a number for both."""

    __slots__ = ("key", "octets")

    def __init__(self, key: i64, octets: bytes) -> None:
        self.key: i64 = key
        self.octets: bytes = octets


class TransactionLines(Observer):
    """Makes the JSON lines of transactions; as an observer, it collects them in ``lines``.

    With ``locate``, a packet's number is that within its file, and the file is named.
    """

    def __init__(self) -> None:
        super().__init__()
        self.locate: Locate | None = None
        self.lines: list[str] = []
        self._clock: Clock = Clock()
        self._times: Times = Times()
        self._ends: dict[int, str] = {}
        self._out: BytesWriter = BytesWriter()
        self._good: GoodItems = GoodItems()
        self._starts: list[_Start | None] = [None] * _PLACES
        self._polls: list[bytes] = [b""] * 256  # by function: the part of a job's line between its reference and packet
        self._short: dict[bytes, str] = {}
        self._texts: JsonTexts = JsonTexts()
        self._plus_lines: PlusLines = PlusLines()
        self._plans: dict[Parameters, ReadPlan] = {}  # only used when interpreted

    def transaction(self, transaction: Transaction) -> None:
        """Add the line of a transaction."""
        self.lines.append(self.line(transaction))

    def take(self) -> list[str]:
        """Return the lines collected since the last call."""
        lines, self.lines = self.lines, []
        return lines

    def line(self, transaction: Transaction) -> str:
        """Return the line of one transaction, without a line end."""
        if transaction.rosctr == PLUS:
            return self._plus(transaction).decode("ascii")
        if COMPILED and self._is_usual(transaction):
            return self._usual(transaction).decode("ascii")
        return self._any_line(transaction)

    def octets(self, transaction: Transaction) -> bytes:
        """Return the line of one transaction in UTF-8."""
        if transaction.rosctr == PLUS:
            return self._plus(transaction)
        if COMPILED and self._is_usual(transaction):
            return self._usual(transaction)
        return self._any_line(transaction).encode("utf-8", "backslashreplace")

    def _polled(self, transaction: Transaction) -> str:
        """Return the line of a read without an error, from its `ReadPlan`; empty for any other transaction."""
        parameters = transaction.parameters
        layout = parameters.good_layout
        if (
            layout is None
            or transaction._flags
            or transaction.has_errors
            or transaction._outcome != ANSWERED
            or transaction.response_rosctr != ACK_DATA
            or transaction.rosctr != JOB
            or transaction._carried is not None
            or self.locate is not None
            or transaction.connection.naming is not None
            or transaction.again is not None
        ):
            return ""
        buf = transaction._response_buf
        at: i64 = transaction._response_offset
        data_at: i64 = at + ACK_HEADER_SIZE
        if transaction.response_parameters is not None:
            data_at += len(transaction.response_parameters.octets)
        if not parameters.like_good(buf, at, transaction.response_size, data_at):
            return ""
        plan = self._plans.get(parameters)
        if plan is None or plan.layout is not layout:
            plan = self._plan(parameters)
        time_ns: i64 = transaction.request_ns
        return (
            f"{_HEAD}{transaction.number}{self._connection(transaction.connection, transaction.asked_by)}"
            f'{transaction.pdu_ref},"rosctr":{JOB},"function":{parameters.fragment or function_text(parameters)}'
            f',"request_frame":{transaction.request_frame},"response_frame":{transaction.response_frame}'
            f',"request_time":"{self._clock.iso_second(time_ns)}{time_ns % _SECOND_NS:09d}Z"'
            f',"latency_ns":{transaction.response_ns - time_ns}{_WELL_TEXT}{plan.text(buf, data_at)}{_NO_ERRORS_TEXT}'
        )

    def _plan(self, parameters: Parameters) -> ReadPlan:
        if len(self._plans) >= _MAX_CACHED:
            self._plans.clear()
        plan = ReadPlan(parameters)
        self._plans[parameters] = plan
        return plan

    def _is_usual(self, transaction: Transaction) -> bool:
        """Return whether a transaction is an answered job, as most are, both packets captured and without anything special."""
        return (
            transaction._outcome == ANSWERED
            and transaction.rosctr == JOB
            and not transaction.reason
            and transaction._carried is None
            and transaction.parameters.function >= 0
            and transaction.request_frame != 0
            and transaction.response_frame != 0
            and transaction.again is None
        )

    def _usual(self, transaction: Transaction) -> bytes:
        """Return the line of a transaction that `_is_usual`; constant parts are cached."""
        out = self._out
        out.truncate(0)
        out.write(_HEAD_OCTETS)
        write_decimal(out, transaction.number)
        out.write(self._start(transaction.connection, transaction.asked_by))
        write_decimal(out, transaction.pdu_ref)
        out.write(self._poll(transaction.parameters))
        if self.locate is not None:
            out.write(self._places(transaction.request_frame, transaction.response_frame, self.locate).encode("ascii"))
        else:
            write_decimal(out, transaction.request_frame)
            out.write(b',"response_frame":')
            write_decimal(out, transaction.response_frame)
        out.write(b',"request_time":"')
        self._times.write(out, transaction.request_ns)
        out.write(b'","latency_ns":')
        write_decimal(out, transaction.response_ns - transaction.request_ns)
        function: i64 = transaction.parameters.function
        plain: bool = not transaction.has_errors and transaction._flags & (FUNCTION_MISMATCH | DOUBTS) == 0
        if plain and (function == READ_VAR or function == WRITE_VAR):
            self._write_polled(out, transaction)
        elif transaction._flags & DOUBTS:
            return self._any_line(transaction).encode("ascii")
        else:
            out.write(_ANSWERED)
            about = self._setup(transaction) + self._notes(transaction)
            told = f'{about}{_ITEMS}{self._items(transaction)}],"errors":[{self._errors(transaction)}]}}'
            out.write(told.encode("ascii"))
        return out.getvalue()

    def _plus(self, transaction: Transaction) -> bytes:
        """Return the line of a transaction of S7comm-plus."""
        out = self._out
        out.truncate(0)
        out.write(_HEAD_OCTETS)
        write_decimal(out, transaction.number)
        out.write(self._start(transaction.connection, transaction.asked_by))
        self._plus_lines.write_function(out, transaction)
        self._write_when(out, transaction)
        self._plus_lines.write_body(out, transaction)
        out.write(_ERRORS)
        if transaction.has_errors:
            out.write(self._errors(transaction).encode("ascii"))
        out.write(b"]}")
        return out.getvalue()

    def _write_when(self, out: BytesWriter, transaction: Transaction) -> None:
        """Write packets, times and outcome of a transaction of any outcome."""
        asked: i64 = transaction.request_frame
        told: i64 = transaction.response_frame
        if self.locate is not None:
            out.write(self._places(asked, told, self.locate).encode("ascii"))
        else:
            _write_number(out, asked)
            out.write(b',"response_frame":')
            _write_number(out, told)
        if asked:
            out.write(b',"request_time":"')
            self._times.write(out, transaction.request_ns)
        else:  # without a request, the time of the answer must be given
            out.write(b',"request_time":null,"response_time":"')
            self._times.write(out, transaction.response_ns)
        likely: bool = transaction.is_likely
        if likely:
            out.write(b'","response_time":"')
            self._times.write(out, transaction.response_ns)
        out.write(b'","latency_ns":')
        answered: bool = transaction._outcome == ANSWERED and not likely
        if answered and not transaction.reason and transaction.again is None:
            write_decimal(out, transaction.response_ns - transaction.request_ns)
            out.write(_ANSWERED)
            return
        latency = decimal(transaction.response_ns - transaction.request_ns) if answered else "null"
        reason = f'"{transaction.reason}"' if transaction.reason else "null"
        ending = f'{latency},"outcome":"{OUTCOMES[transaction._outcome]}","reason":{reason}{_certainty(transaction)}'
        out.write(ending.encode("ascii"))
        out.write(self._again(transaction).encode("ascii"))

    def _write_polled(self, out: BytesWriter, transaction: Transaction) -> None:
        """Write the part after the latency of a read or write without an error."""
        out.write(_WELL)
        begin = len(out)
        good = self._good
        if good.begin(transaction):
            items = transaction.parameters.items
            while good.step():
                if good.index:
                    out.append(_COMMA)
                write_good_item(out, items[good.index], good.buf, good.at, good.size)
        if not good.whole:
            out.truncate(begin)
            out.write(self._items(transaction).encode("ascii"))
        out.write(_NO_ERRORS)

    def _poll(self, parameters: Parameters) -> bytes:
        """Return the part of a job's line between its reference and its packet."""
        function: i64 = parameters.function
        found = self._polls[function]
        if len(found) == 0:  # quicker than the truth of bytes (mypyc)
            found = f',"rosctr":{JOB},"function":{function_text(parameters)},"request_frame":'.encode("ascii")
            self._polls[function] = found
        return found

    def _start(self, connection: Connection, asked_by: i64) -> bytes:
        """Return `_connection` as octets."""
        key: i64 = connection.number * 2 + asked_by
        place: i64 = key & (_PLACES - 1)
        found = self._starts[place]
        if found is None or found.key != key:
            found = _Start(key, self._connection(connection, asked_by).encode("ascii"))
            self._starts[place] = found
        return found.octets

    def _any_line(self, transaction: Transaction) -> str:
        if not COMPILED:
            line = self._polled(transaction)
            if line:
                return line
        asked: i64 = transaction.request_frame
        told: i64 = transaction.response_frame
        outcome: i64 = transaction._outcome
        frames: str
        if self.locate is not None:
            frames = self._places(asked, told, self.locate)
        elif asked and told:
            frames = f'{decimal(asked)},"response_frame":{decimal(told)}'
        else:
            frames = f'{asked},"response_frame":null' if asked else f'null,"response_frame":{told}'
        # Without a request, the time of the answer must be given.
        time_ns: i64 = transaction.request_ns
        at = '"'
        if not asked:
            time_ns = transaction.response_ns
            at = 'null,"response_time":"'
        rest: i64 = time_ns % _SECOND_NS
        latency = "null"
        told_at = ""
        if transaction.is_likely:
            told_at = f',"response_time":"{self._clock.iso(transaction.response_ns)}"'
        elif outcome == ANSWERED:
            latency = decimal(transaction.response_ns - transaction.request_ns)
        reason = f'"{transaction.reason}"' if transaction.reason else "null"
        opening = _ITEMS
        closing = "]"
        facet = FACETS.get(transaction.rosctr)
        if facet is None:
            reference = str(transaction.pdu_ref)
            rosctr = str(transaction.rosctr)
            notes = self._setup(transaction) + self._notes(transaction)
            if notes:
                opening = notes + _ITEMS
            body = self._items(transaction)
            tail = scd_json(transaction, self.locate) if transaction._carried is not None else ""
            function = function_text(transaction.parameters)
        else:
            reference = facet.reference(transaction) or "null"
            rosctr = "null"
            opening = closing = ""
            body = facet.body_json(transaction)
            tail = facet.tail_json(transaction, self.locate)
            function = transaction.parameters.fragment
            if not function:
                function = facet.function_json(transaction.parameters)
                transaction.parameters.fragment = function
        return (
            f"{_HEAD}{decimal(transaction.number)}{self._connection(transaction.connection, transaction.asked_by)}"
            f'{reference},"rosctr":{rosctr},"function":{function}'
            f',"request_frame":{frames},"request_time":{at}{self._clock.iso_second(time_ns)}'
            f'{THREE[rest // 1_000_000]}{THREE[rest // 1000 % 1000]}{THREE[rest % 1000]}Z"{told_at},"latency_ns":{latency}'
            f',"outcome":"{OUTCOMES[outcome]}","reason":{reason}{_certainty(transaction)}{self._again(transaction)}'
            f"{opening}{body}{closing}"
            f',"errors":[{self._errors(transaction)}]{tail}}}'
        )

    def _again(self, transaction: Transaction) -> str:
        """Return the key ``sent_again`` of a request that TCP sent more than once; empty for nearly all."""
        again = transaction.again
        if again is None:
            return ""
        number, file = str(again.frame), ""
        if self.locate is not None:
            number, name = self._place(again.frame, self.locate)
            file = f',"file":{name}'
        after = again.time_ns - transaction.request_ns
        return f',"sent_again":{{"times":{again.times},"frame":{number}{file},"after_ns":{after}}}'

    def _places(self, asked: i64, told: i64, locate: Locate) -> str:
        """Return numbers and files of the packets of request and answer; 0 means none."""
        asked_at, asked_in = self._place(asked, locate)
        told_at, told_in = self._place(told, locate)
        return f'{asked_at},"response_frame":{told_at},"request_file":{asked_in},"response_file":{told_in}'

    def _place(self, frame: i64, locate: Locate) -> tuple[str, str]:
        if frame == 0:
            return "null", "null"
        name, number = locate(frame)
        return decimal(number), self._texts.of(name)

    def _connection(self, connection: Connection, asked_by: i64) -> str:
        """Return the part of a line between the number of the transaction and its reference."""
        key: i64 = connection.number * 2 + asked_by
        found = self._ends.get(key)
        if found is None:
            if len(self._ends) >= _MAX_CACHED:
                self._ends.clear()
            ends = connection.tcp.ends
            found = (
                f'{_CONNECTION}{connection.number},"asked_by":"{ends[asked_by]}"'  # nothing in it that JSON escapes
                f',"answered_by":"{ends[1 - asked_by]}","pdu_ref":'
            )
            self._ends[key] = found
        return found

    def _setup(self, transaction: Transaction) -> str:
        asked = transaction.parameters.setup
        answer = transaction.response_parameters
        granted = answer.setup if answer is not None else None
        if asked is None and granted is None:
            return ""
        return f',"setup":{{"asked":{setup_text(asked)},"granted":{setup_text(granted)}}}'

    def _notes(self, transaction: Transaction) -> str:
        """Return the keys ``asks`` and ``tells``, notes on request and answer; empty for reads, writes and setups."""
        function: i64 = transaction.parameters.function
        if function == READ_VAR or function == WRITE_VAR or function == SETUP_COMMUNICATION:
            return ""
        asks = self._noted(transaction.request_octets, transaction, True)
        tells = self._noted(transaction.response_octets, transaction, False)
        return f',"asks":[{asks}],"tells":[{tells}]'

    def _noted(self, octets: bytes, transaction: Transaction, asked: bool) -> str:
        """Return the notes on a PDU; those of short PDUs are cached, as most repeat with other references."""
        if not octets:
            return ""
        key = octets[:_REFERENCE_AT] + octets[_REFERENCE_END:] if len(octets) <= _SHORT else b""
        found = self._short.get(key) if key else None
        if found is None:
            response = None if asked else transaction.response
            body = transaction.request_body if asked else response.body if response is not None else None
            found = "" if body is None else ",".join([json_text(note) for note in body.notes])
            if key:
                if len(self._short) >= _MAX_CACHED:
                    self._short.clear()
                self._short[key] = found
        return found

    def _errors(self, transaction: Transaction) -> str:
        return errors_json(transaction, self._texts) if transaction.has_errors else ""

    def _items(self, transaction: Transaction) -> str:
        naming = transaction.connection.naming
        if naming is not None:
            return ",".join(
                [
                    with_tags(item_json(result.item, result.return_code, result.data), naming.named(result))
                    for result in transaction.s7_results
                ]
            )
        good = good_octets(transaction)
        if good is not None:  # nearly always: then no `ItemResult` is needed
            items = transaction.parameters.items
            return ",".join([item_json(items[index], SUCCESS, good[index]) for index in range(len(good))])
        return ",".join([item_json(result.item, result.return_code, result.data) for result in transaction.s7_results])


def _certainty(transaction: Transaction) -> str:
    """Return the keys ``certainty`` and ``doubt`` if a pair is only likely; empty for nearly all: sure pairs have none."""
    if transaction._flags & DOUBTS == 0:
        return ""
    doubt = transaction.doubt
    return f',"certainty":"{transaction.certainty}"' + (f',"doubt":"{doubt}"' if doubt else "")


def _write_number(out: BytesWriter, packet: i64) -> None:
    """Write the number of a packet, null for none."""
    if packet:
        write_decimal(out, packet)
    else:
        out.write(b"null")


class JsonlWriter(Writer):
    """Writes a JSON object for each record, always with all details."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self.joint = _CONNECTION.encode("ascii")
        self._transactions: TransactionLines = TransactionLines()
        self._pdus: PduLines = PduLines()

    def begin(self, places: Places) -> None:
        """Take ``places`` for the names of packets."""
        super().begin(places)
        if places.several:
            self._transactions.locate = places.locate
            self._pdus.locate = places.locate

    def transaction(self, transaction: Transaction) -> None:
        """Add the line of a transaction."""
        self.lines.append(self._transactions.octets(transaction))

    def operation(self, operation: Operation) -> None:
        """Add the line of an operation."""
        self.lines.append(operation_json(operation, self.clock, self.places))

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Add the line of a TPDU that carries no S7 PDU."""
        tpdu = parse_tpdu(octets[4:])
        connection = side.connection
        self.lines.append(tpdu_json_line(tpdu, int(frame), int(time_ns), connection, int(side.index), self.places))

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7 PDU."""
        # imported late: eight modules that transactions do not need
        from dissect.protocols.s7.hiding import without_secrets

        connection = side.connection
        pdu = parse_pdu(without_secrets(octets), frame, time_ns, connection.number, side.index, cut)
        self.lines.append(with_header(self._pdus.line(pdu, connection), self.header_of(side, octets)))

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7comm-plus PDU."""
        connection = side.connection
        pdu = parse_plus(octets, frame, time_ns, connection.number, side.index, cut)
        self.lines.append(with_header(self._pdus.plus_line(pdu, connection), self.header_of(side, octets)))

    def scd_message(self, found: ScdMessage, connection: Connection) -> None:
        """Add the line of an SCD message."""
        self.lines.append(self._pdus.scd_line(found, connection))
