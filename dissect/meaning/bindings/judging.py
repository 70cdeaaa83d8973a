"""Findings about SCD in traffic (profile, reference 3.3-3.5); the texts are in `dissect.engine.findings.catalogue`."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING, Final

from dissect.engine.transactions.transaction import PUSH
from dissect.meaning.bindings.devices import ScdDevice, ScdDevices, is_rewritten
from dissect.meaning.bindings.evidence import Evidence
from dissect.scd.errors import E_CRC, E_INDEX, E_PDO_NUMBER, E_SUB, Error
from dissect.scd.layout import address_text
from dissect.scd.packing import ACCESS, ENCODING, LIMITS, NONFINITE, PAD, TIME_NS_RANGE, TRAILING, VERSION, limits_text
from dissect.scd.ranges import STRUCTURE_SUB
from dissect.scd.wording import value_text
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.engine.findings.reporter import Reporter
    from dissect.engine.transactions.payloads import ScdMessage
    from dissect.engine.transactions.side import Side
    from dissect.engine.transactions.transaction import Transaction
    from dissect.scd.layout import Key
    from dissect.scd.messages import Message
    from dissect.scd.model import Pdo
    from dissect.scd.types import Value

#: The counter of a PDO has one octet.
_COUNTER: Final = 256
#: Maximum number of PDO counters that are followed at the same time: of one connection, and of all.
MAX_COUNTERS: Final = 1024
MAX_COUNTERS_ALL: Final = 65536
#: Maximum number of variables of a new mapping that a finding names.
_NAMED: Final = 8
_UNKNOWN: Final = frozenset((E_INDEX, E_SUB, E_PDO_NUMBER))
_ODD: Final = {
    TRAILING: "bytes are left over",
    NONFINITE: "an infinity",
    TIME_NS_RANGE: "nanoseconds of a second or more",
    PAD: "undefined bits that are not zero",
    VERSION: "a different version of the mapping",
    ENCODING: "a text that is invalid in the dictionary's encoding",
}


class ScdJudge:
    """Judges messages as they come, and exchanges when they are over.

    ``peers`` are the names of bindings whose dictionary belongs to the end that asks. ``forgotten`` counts PDO counters beyond
    the limits.
    """

    def __init__(self, reporter: Reporter, devices: ScdDevices, peers: frozenset[str]) -> None:
        self.forgotten = 0
        self._peers = peers
        self._kept = 0
        self._reporter = reporter
        self._devices = devices
        self._dictionary = devices.dictionary
        self._evidence = Evidence(devices.dictionary)
        self._counters: OrderedDict[int, dict[tuple[int, str], int]] = OrderedDict()

    # ---- messages of their own --------------------------------------------------------------------------------------

    def message(self, side: Side, found: ScdMessage) -> None:
        """Judge a message as it comes."""
        message = found.message
        if message.error is not None or message.flags:
            self.oddities(found)
        if message.service == "pdo":
            if message.pdo and "tid" in message.numbers:
                self.count(found, message.pdo, message.tid)
            if message.err:
                text = f"{message.err} {self._dictionary.error_text(message.err)}"
                self._note("scd.pdo_error" if message.err < 0 else "scd.status", found, text)

    def oddities(self, found: ScdMessage) -> None:
        """Report faults and oddities of a message."""
        message = found.message
        error = message.error
        if error is not None:
            slug = (
                "scd.crc"
                if error.code == E_CRC
                else "scd.unknown_object"
                if error.code in _UNKNOWN
                else "scd.malformed"
            )
            self._note(slug, found, f"{error.code} {error.where}: {error.detail}")
        if ACCESS in message.flags and message.phase not in {"response", "abort"}:  # reported with the request
            self._note("scd.access", found, "the access attribute or the index range forbids this")
        odd = [text for flag, text in _ODD.items() if flag in message.flags]
        if odd:
            self._note("scd.odd_value", found, ", ".join(odd))
        if LIMITS in message.flags and self._reporter.wants(
            "scd.limits", found.connection, found.frame, found.frame, found.time_ns
        ):
            outside = [self._outside(key, message.values.get(key)) for key in message.flags[LIMITS][:_NAMED]]
            self._note("scd.limits", found, ", ".join(text for text in outside if text) or "a value of it")

    def _outside(self, key: Key, value: Value | None) -> str:
        """Return "0x6000:4 Pump 1.speed = 4000, limits -3000..3000"; for a field of a bare struct only its name."""
        if not isinstance(key, tuple) or value is None:
            return str(key)
        variable = self._dictionary.variable(key)
        limits = limits_text(variable.traits.low, variable.traits.high)
        return f"{address_text(key)} {printable(variable.label)} = {value_text(value)}, limits {limits}"

    def count(self, found: ScdMessage, pdo: str, tid: int) -> None:
        """Follow the counter of a PDO; a counter that never changes is not in use."""
        number = found.connection
        counters = self._counters.get(number)
        if counters is None:
            counters = self._counters[number] = {}
        key = (found.side, pdo)
        last = counters.get(key)
        if last is None:
            self._follow(number, key, tid)
            return
        counters[key] = tid
        lost = (tid - last) % _COUNTER - 1
        if lost > 0:
            detail = f"{lost} before this one: the counter went from {last} to {tid}"
            self._note("scd.pdo_gap", found, detail)

    def _follow(self, number: int, key: tuple[int, str], counter: int) -> None:
        """Begin to follow a counter; beyond the limit, those of the oldest connection are forgotten."""
        counters = self._counters[number]
        if len(counters) >= MAX_COUNTERS:
            self.forgotten += 1
            return
        counters[key] = counter
        self._kept += 1
        while self._kept > MAX_COUNTERS_ALL:
            oldest = next(iter(self._counters))
            self.forgotten += len(self._counters[oldest])
            self.forget(oldest)

    def garbage(self, side: Side, skipped: int, frame: int, time_ns: int) -> None:
        """Report skipped octets of a bound stream, which are not a message."""
        detail = f"{skipped} bytes from {side.tcp.ends[side.index]}"
        self._reporter.note("scd.garbage", side.connection.number, [frame], time_ns, detail)

    def forget(self, connection: int) -> None:
        """The connection is over."""
        self._kept -= len(self._counters.pop(connection, ()))

    # ---- what devices say of themselves -----------------------------------------------------------------------------

    def exchange(self, transaction: Transaction) -> None:
        """Judge a finished SDO exchange, or a PDO: values of the device, and values that were written to it."""
        pushed = transaction._outcome == PUSH
        for found in transaction.scd:
            message = found.message
            if pushed and self.is_common(found.message):
                continue  # nothing in it can be compared with earlier values
            device = self._device(transaction, found)
            if message.err < 0 and message.service != "pdo":
                detail = self._evidence.denied(message)
                if detail:
                    self._note("scd.other_dictionary", found, detail)
            if message.err > 0 and message.service != "pdo":
                self._note("scd.status", found, f"{message.err} {self._dictionary.error_text(message.err)}")
            if message.service == "write" and message.phase == "request":
                answered = transaction.outcome == "answered" and not transaction.is_likely
                if answered and not transaction.has_errors:
                    self._written(device, found)
            else:
                self.content(device, found, accepted=True)

    def _device(self, transaction: Transaction, found: ScdMessage) -> ScdDevice:
        """Return the device that got the request, or that sent this PDO."""
        connection = transaction.connection
        if transaction.outcome == "unsolicited":
            return self._devices.at(connection.client if found.binding in self._peers else connection.server)
        return self._devices.at(connection.tcp.ends[1 - transaction.asked_by])

    def content(self, device: ScdDevice, found: ScdMessage, *, accepted: bool) -> None:
        """Judge values that a device has or, if ``accepted``, that it accepted."""
        message = found.message
        if found.place and (message.error is not None or message.flags):
            self.oddities(found)
        if not accepted or self.is_common(message):
            return
        for key, value in message.values.items():
            if not isinstance(key, tuple):
                continue
            detail = self._evidence.shown(key, value)
            if detail:
                self._note("scd.other_dictionary", found, detail)
            if key in self._evidence.constants:
                old = device.constant(key, value)
                if old is not None:
                    detail = f"{address_text(key)} was {value_text(old)}, is {value_text(value)}"
                    self._note("scd.constant_changed", found, detail)

    def is_common(self, message: Message) -> bool:
        """Return whether a message has neither a constant nor a structure, like most messages."""
        return message.sub != STRUCTURE_SUB and self._evidence.keys.isdisjoint(message.values)

    def _written(self, device: ScdDevice, found: ScdMessage) -> None:
        """A write was acknowledged: values written to a mapping object are valid from now on."""
        for key, value in found.message.values.items():
            if not is_rewritten(self._dictionary, key) or not isinstance(value, int) or not isinstance(key, tuple):
                continue
            try:
                pdo = device.write_mapping(key[0], key[1], value)
            except Error as error:
                self._note("scd.bad_mapping", found, f"{error.where}: {error.detail}")
                continue
            if pdo is None and key[1]:
                continue  # an element of a PDO that is switched off during its configuration
            self._note("scd.remapped", found, f"{value_text(value)} written, now {_mapped(pdo)}")

    def _note(self, slug: str, found: ScdMessage, detail: str) -> None:
        connection = found.connection
        if self._reporter.wants(slug, connection, found.frame, found.frame, found.time_ns):
            where = f"{found.place}, " if found.place else ""
            text = f"{where}{found.subject}: {detail}"
            self._reporter.detail(slug, connection, [found.frame], found.time_ns, text)


def _mapped(pdo: Pdo | None) -> str:
    """Return the content of a PDO; None means that it is switched off."""
    if pdo is None:
        return "switched off"
    named = [f"{address_text(row.variable.address)} {printable(row.variable.label)}" for row in pdo.map[:_NAMED]]
    more = f" and {len(pdo.map) - _NAMED} more" if len(pdo.map) > _NAMED else ""
    return f"{', '.join(named)}{more}" if named else "empty"
