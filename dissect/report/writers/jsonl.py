"""Records as JSON lines: one object a line, keys in a fixed order (docs/json.md).

This is the bulk output, so lines are put together from cached pieces: what a polled item or a request block looks like is
written once and used for every transaction that repeats it (`dissect.report.item_json`, `dissect.report.plus_octets`).
"""

from __future__ import annotations

import json
from typing import Final

from librt.strings import BytesWriter
from mypy_extensions import i64

from dissect.engine.observer import Observer
from dissect.iso.cotp import parse_tpdu
from dissect.report.facet import Locate
from dissect.report.facets import FACETS
from dissect.report.item_json import (
    CODE,
    errors_json,
    item_json,
    item_text,
    userdata_text,
    value_json,
    with_tags,
    write_good_item,
)
from dissect.report.operations import operation_json
from dissect.report.plus import plus_pdu_line
from dissect.report.plus_octets import PlusLines
from dissect.report.scd import scd_json, scd_line_json
from dissect.report.words import Places
from dissect.report.writer import Writer
from dissect.s7.items import DataItem
from dissect.s7.message import Pdu, parse_pdu
from dissect.s7.parameters import Parameters, Setup
from dissect.s7.tables import (
    FUNCTIONS,
    JOB,
    READ_VAR,
    ROSCTR,
    SETUP_COMMUNICATION,
    SUCCESS,
    WRITE_VAR,
)
from dissect.s7plus.message import PlusPdu, parse_plus
from dissect.s7plus.parameters import PLUS
from dissect.transactions.connection import Connection
from dissect.transactions.good_items import GoodItems, good_octets
from dissect.transactions.operation import Operation
from dissect.transactions.payloads import ScdMessage
from dissect.transactions.results import FUNCTION_MISMATCH
from dissect.transactions.table import Side
from dissect.transactions.transaction import ANSWERED, OUTCOMES, Transaction
from dissect.wire.build import COMPILED
from dissect.wire.digits import Times, write_decimal
from dissect.wire.layout import FieldValue
from dissect.wire.malformed import Malformed
from dissect.wire.part import Part
from dissect.wire.text import THREE, Clock, JsonTexts, decimal, json_text

TRANSACTION_SCHEMA: Final = "s7dissect.transaction/1"
PDU_SCHEMA: Final = "s7dissect.pdu/1"

_HEAD: Final = f'{{"schema":"{TRANSACTION_SCHEMA}","number":'
_CONNECTION: Final = ',"connection":'
_ITEMS: Final = ',"items":['
#: What stands between latency and items of a transaction that was answered, and behind those where all is well.
_ANSWERED: Final = f',"outcome":"{OUTCOMES[ANSWERED]}","reason":null'.encode("ascii")
_WELL: Final = _ANSWERED + _ITEMS.encode("ascii")
_NO_ERRORS: Final = b'],"errors":[]}'
#: What stands between items and errors of any other.
_ERRORS: Final = b'],"errors":['
_HEAD_OCTETS: Final = _HEAD.encode("ascii")
_COMMA: Final = 0x2C
_SECOND_NS: Final = 1_000_000_000
#: Cached pieces are forgotten together when there are this many.
_MAX_CACHED: Final = 8192
#: Beginnings of lines that are found without a dictionary, a power of two.
_PLACES: Final = 1024

#: Where the header holds the PDU reference, and the octets of PDUs whose notes are cached.
_REFERENCE_AT: Final = 4
_REFERENCE_END: Final = 6
_SHORT: Final = 240


def function_text(parameters: Parameters) -> str:
    """Return the ``function`` object of a parameter block of S7comm, and for userdata the ``userdata`` object after it."""
    if not parameters.fragment:
        code: i64 = parameters.function
        text = (
            '{"code":null,"name":null}' if code < 0 else f'{{"code":{code},"name":{json_text(FUNCTIONS.name(code))}}}'
        )
        userdata = parameters.userdata
        if userdata is not None:
            text += f',"userdata":{userdata_text(userdata)}'
        parameters.fragment = text
    return parameters.fragment


class _Start:
    """What a connection and who asks on it have in a line, by a number for both."""

    __slots__ = ("key", "octets")

    def __init__(self, key: i64, octets: bytes) -> None:
        self.key: i64 = key
        self.octets: bytes = octets


class TransactionLines(Observer):
    """Writes transactions as lines of JSON; ``lines`` collects those it is told of as an observer.

    With ``locate`` packets are numbered within their file, and its name stands beside the number.
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
        self._polls: list[bytes] = [b""] * 256  # by function: what a job has between its reference and its packet
        self._short: dict[bytes, str] = {}
        self._texts: JsonTexts = JsonTexts()
        self._plus_lines: PlusLines = PlusLines()

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

    def _is_usual(self, transaction: Transaction) -> bool:
        """Tell whether a transaction is a job that was answered, as most are."""
        return (
            transaction.outcome == ANSWERED
            and transaction.rosctr == JOB
            and not transaction.reason
            and transaction.carried is None
            and transaction.parameters.function >= 0
            and transaction.request_frame != 0
            and transaction.response_frame != 0
        )

    def _usual(self, transaction: Transaction) -> bytes:
        """Return the line of a usual transaction. What does not vary is put together once."""
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
        plain: bool = not transaction.has_errors and transaction.flags & FUNCTION_MISMATCH == 0
        if plain and (function == READ_VAR or function == WRITE_VAR):
            self._write_polled(out, transaction)
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
        """Write the packets and times of a transaction of any outcome, and that."""
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
        else:  # nothing else tells when it was
            out.write(b',"request_time":null,"response_time":"')
            self._times.write(out, transaction.response_ns)
        out.write(b'","latency_ns":')
        if transaction.outcome == ANSWERED and not transaction.reason:
            write_decimal(out, transaction.response_ns - transaction.request_ns)
            out.write(_ANSWERED)
            return
        latency = (
            decimal(transaction.response_ns - transaction.request_ns) if transaction.outcome == ANSWERED else "null"
        )
        reason = f'"{transaction.reason}"' if transaction.reason else "null"
        out.write(f'{latency},"outcome":"{OUTCOMES[transaction.outcome]}","reason":{reason}'.encode("ascii"))

    def _write_polled(self, out: BytesWriter, transaction: Transaction) -> None:
        """Write what follows the latency of a read or write of which all is well."""
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
        """Return what a job has between its reference and its packet."""
        function: i64 = parameters.function
        found = self._polls[function]
        if len(found) == 0:  # for bytes that is quicker to ask (mypyc)
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
        asked: i64 = transaction.request_frame
        told: i64 = transaction.response_frame
        outcome: i64 = transaction.outcome
        frames: str
        if self.locate is not None:
            frames = self._places(asked, told, self.locate)
        elif asked and told:
            frames = f'{decimal(asked)},"response_frame":{decimal(told)}'
        else:
            frames = f'{asked},"response_frame":null' if asked else f'null,"response_frame":{told}'
        # Where there is no request, nothing else tells when it was.
        time_ns: i64 = transaction.request_ns
        at = '"'
        if not asked:
            time_ns = transaction.response_ns
            at = 'null,"response_time":"'
        rest: i64 = time_ns % _SECOND_NS
        latency = decimal(transaction.response_ns - transaction.request_ns) if outcome == ANSWERED else "null"
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
            tail = scd_json(transaction, self.locate) if transaction.carried is not None else ""
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
            f'{THREE[rest // 1_000_000]}{THREE[rest // 1000 % 1000]}{THREE[rest % 1000]}Z","latency_ns":{latency}'
            f',"outcome":"{OUTCOMES[outcome]}","reason":{reason}{opening}{body}{closing}'
            f',"errors":[{self._errors(transaction)}]{tail}}}'
        )

    def _places(self, asked: i64, told: i64, locate: Locate) -> str:
        """Return the packets of request and answer (0 for none) by number and file."""
        asked_at, asked_in = self._place(asked, locate)
        told_at, told_in = self._place(told, locate)
        return f'{asked_at},"response_frame":{told_at},"request_file":{asked_in},"response_file":{told_in}'

    def _place(self, frame: i64, locate: Locate) -> tuple[str, str]:
        if frame == 0:
            return "null", "null"
        name, number = locate(frame)
        return decimal(number), self._texts.of(name)

    def _connection(self, connection: Connection, asked_by: i64) -> str:
        """Return what a connection has between the number of a transaction and its reference."""
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
        return f',"setup":{{"asked":{_setup_text(asked)},"granted":{_setup_text(granted)}}}'

    def _notes(self, transaction: Transaction) -> str:
        """Return what request and answer are about, for functions whose items do not tell it."""
        function: i64 = transaction.parameters.function
        if function == READ_VAR or function == WRITE_VAR or function == SETUP_COMMUNICATION:
            return ""
        asks = self._noted(transaction.request_octets, transaction, True)
        tells = self._noted(transaction.response_octets, transaction, False)
        return f',"asks":[{asks}],"tells":[{tells}]'

    def _noted(self, octets: bytes, transaction: Transaction, asked: bool) -> str:
        """Return the notes of a PDU. Short ones, most requests among them, come again and again with other references."""
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
                    for result in transaction.results()
                ]
            )
        good = good_octets(transaction)
        if good is not None:  # nearly always; each item meets its own octets without an object in between
            items = transaction.parameters.items
            return ",".join([item_json(items[index], SUCCESS, good[index]) for index in range(len(good))])
        return ",".join([item_json(result.item, result.return_code, result.data) for result in transaction.results()])


def _write_number(out: BytesWriter, packet: i64) -> None:
    """Write the number of a packet, null for none."""
    if packet:
        write_decimal(out, packet)
    else:
        out.write(b"null")


def _setup_text(setup: Setup | None) -> str:
    """Return `Setup.as_dict` as JSON."""
    if setup is None:
        return "null"
    if not setup.fragment:
        setup.fragment = (
            f'{{"max_amq_calling":{setup.max_amq_calling},"max_amq_called":{setup.max_amq_called}'
            f',"pdu_length":{setup.pdu_length}}}'
        )
    return setup.fragment


class PduLines:
    """Writes S7 PDUs as lines of JSON. With ``locate`` packets are numbered within their file, which is named."""

    def __init__(self) -> None:
        self._clock: Clock = Clock()
        self.locate: Locate | None = None

    def line(self, pdu: Pdu, connection: Connection) -> str:
        """Return the line of one PDU, without a line end."""
        ends = connection.tcp.ends
        frame = str(pdu.frame)
        if self.locate is not None:
            name, number = self.locate(pdu.frame)
            frame = f'{number},"file":{json_text(name)}'
        error = f'{pdu.error_class},"error_code":{pdu.error_code}' if pdu.error_class >= 0 else 'null,"error_code":null'
        told = ",".join([_malformed(fact) for fact in pdu.malformed])
        return (
            f'{{"schema":"{PDU_SCHEMA}","frame":{frame},"time":"{self._clock.iso(pdu.time_ns)}"'
            f',"connection":{pdu.connection},"src":{json_text(str(ends[pdu.side]))},"dst":{json_text(str(ends[1 - pdu.side]))}'
            f',"protocol":"s7comm",{_header(pdu)}'
            f',"error_class":{error},"function":{function_text(pdu.parameters)}'
            f"{_body(pdu)}"
            f',"cut":{"true" if pdu.cut else "false"},"malformed":[{told}]}}'
        )

    def scd_line(self, found: ScdMessage, connection: Connection) -> str:
        """Return the line of one SCD message, without a line end."""
        place = self.locate(found.frame) if self.locate is not None else None
        return scd_line_json(found, self._clock.iso(found.time_ns), connection, place)

    def plus_line(self, pdu: PlusPdu, connection: Connection) -> str:
        """Return the line of one S7comm-plus PDU, without a line end."""
        place = self.locate(pdu.frame) if self.locate is not None else None
        return plus_pdu_line(pdu, self._clock.iso(pdu.time_ns), connection, place)


def _header(pdu: Pdu) -> str:
    """Return the header's fields; what a cut header does not hold is null."""
    rosctr = f'{pdu.rosctr},"rosctr_name":{json_text(ROSCTR.name(pdu.rosctr))}'
    if pdu.rosctr < 0:
        rosctr = 'null,"rosctr_name":null'
    if pdu.pdu_ref < 0:
        return f'"rosctr":{rosctr},"redundancy_id":null,"pdu_ref":null,"param_length":null,"data_length":null'
    return (
        f'"rosctr":{rosctr},"redundancy_id":{pdu.redundancy_id},"pdu_ref":{pdu.pdu_ref}'
        f',"param_length":{pdu.param_length},"data_length":{pdu.data_length}'
    )


def _malformed(fact: Malformed) -> str:
    return json.dumps(fact.as_dict(), separators=(",", ":"))


def _body(pdu: Pdu) -> str:
    """Return what the PDU carries: setup, request items, data items, return codes, and what is kept as octets."""
    parameters = pdu.parameters
    text = ""
    if parameters.item_count >= 0:
        text += f',"item_count":{parameters.item_count}'
    if parameters.setup is not None:
        text += f',"setup":{_setup_text(parameters.setup)}'
    if parameters.items:
        items = ",".join([item_text(item)[: -len(CODE)] + "}" for item in parameters.items])
        text += f',"items":[{items}]'
    data_items = pdu.data_items()
    if data_items:
        text += f',"data_items":[{",".join([_data_item(pdu, index, item) for index, item in enumerate(data_items)])}]'
    elif codes := pdu.return_codes():
        text += f',"return_codes":[{",".join([str(code) for code in codes])}]'
    else:
        if parameters.setup is None and not parameters.items and len(parameters.octets) > 2:
            text += f',"parameters":"{parameters.octets.hex()}"'
        if pdu.data:
            text += f',"data":"{pdu.data.hex()}"'
        if parameters.setup is None and not parameters.items:
            body = pdu.body
            parts = [_part("parameters", part) for part in body.parameters] + [
                _part("data", part) for part in body.data
            ]
            text += f',"parts":[{",".join(parts)}]'
    if pdu.malformed or pdu.cut:
        text += f',"octets":"{pdu.octets.hex()}"'  # what was read of it may not be all
    return text


def _part(block: str, part: Part) -> str:
    """Return a part of a body with its fields."""
    note = json_text(part.note) if part.note else "null"
    return (
        f'{{"name":{json_text(part.layout.name)},"block":"{block}","offset":{part.offset}'
        f',"size":{part.end - part.offset},"note":{note},"fields":[{",".join([_field(value) for value in part.values])}]}}'
    )


def _field(value: FieldValue) -> str:
    said = str(value.value) if value.octets is None else f'"{value.octets.hex()}"'
    meaning = value.meaning
    text = json_text(meaning) if meaning else "null"
    return (
        f'{{"name":{json_text(value.field.name)},"offset":{value.offset},"size":{value.end - value.offset}'
        f',"value":{said},"text":{text}}}'
    )


def _data_item(pdu: Pdu, index: int, answer: DataItem) -> str:
    """Return a data item; in a write request, where the type is known, with its value."""
    text = (
        f'{{"return_code":{answer.return_code},"transport_size":{answer.transport_size},"length":{answer.length}'
        f',"data":"{answer.data.hex()}"'
    )
    if index < len(pdu.parameters.items):
        item = pdu.parameters.items[index]
        text += f',"value":{value_json(item, answer.data)}'
    return text + "}"


class JsonlWriter(Writer):
    """Writes an object for each record, all of them with everything that is known."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self.joint = _CONNECTION.encode("ascii")
        self._transactions: TransactionLines = TransactionLines()
        self._pdus: PduLines = PduLines()

    def begin(self, places: Places) -> None:
        """Name packets with ``places``."""
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
        from dissect.report.tpdu_json import tpdu_json_line  # late: rare

        connection, tpdu = side.connection, parse_tpdu(octets[4:])
        line = tpdu_json_line(PDU_SCHEMA, tpdu, int(frame), int(time_ns), connection, int(side.index), self.places)
        self.lines.append(line)

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7 PDU."""
        from dissect.s7.hiding import without_secrets  # late: eight modules, and lines of transactions do without

        connection = side.connection
        pdu = parse_pdu(without_secrets(octets), frame, time_ns, connection.number, side.index, cut)
        self.lines.append(self._pdus.line(pdu, connection))

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7comm-plus PDU."""
        connection = side.connection
        pdu = parse_plus(octets, frame, time_ns, connection.number, side.index, cut)
        self.lines.append(self._pdus.plus_line(pdu, connection))

    def scd_message(self, found: ScdMessage, connection: Connection) -> None:
        """Add the line of an SCD message."""
        self.lines.append(self._pdus.scd_line(found, connection))
