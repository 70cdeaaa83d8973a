"""Request and answer of one transaction, without anything that belongs to one recording; the PDUs are parsed on demand."""

from __future__ import annotations

from collections import deque
from functools import lru_cache
from typing import Final

from dissect.engine.transactions.results import has_items, requested_items, userdata_results
from dissect.protocols.s7.errors import errors_of
from dissect.protocols.s7.items import DataItem, Item, ItemResult, read_results, write_results
from dissect.protocols.s7.message import NOT_REFUSED, Pdu, parse_pdu
from dissect.protocols.s7.parameters import Setup
from dissect.protocols.s7.tables import JOB, READ_VAR, RETURN_CODES, WRITE_VAR
from dissect.protocols.s7.values import Value
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.tables import RETURN_CODES as PLUS_CODES
from dissect.testing.golden.masking import mask_plus, mask_plus_answer, mask_s7

# The names of the two sides of an exchange.
S7: Final = "s7"
PLUS: Final = "plus"
SCD: Final = "scd"

#: Number of exchanges whose parsed PDUs are kept: a long session is read from beginning to end, and parsed PDUs take many times
#: the memory of their octets.
_KEPT: Final = 4096
#: Maximum size of a request that is parsed once for all exchanges that begin with it, and how many of them are kept.
SMALL: Final = 256
PARSED: Final = 2048


class ItemRecord:
    """An item of a read or write with its result.

    ``address`` has no count; ``label`` has one if it is not 1 (text from the wire, not escaped). ``return_code`` is -1 without
    an answer. ``data`` are the octets read or written, None if there are none; ``value`` is decoded from them by the requested
    type: bool, int, float, str or a list of these, None if it cannot be decoded.
    """

    __slots__ = ("_result", "address", "count", "data", "label", "return_code", "transport_size")

    def __init__(self, result: ItemResult, number: int) -> None:
        item = result.item
        self._result = result
        self.address = item.address if item is not None else f"item {number}"
        self.label = item.label if item is not None else self.address
        self.transport_size = int(item.transport_size) if item is not None else -1
        self.count = int(item.count) if item is not None else -1
        self.return_code = int(result.return_code)
        self.data = result.data

    @property
    def value(self) -> Value:
        """The decoded value (see `dissect.protocols.s7.values`)."""
        return self._result.value

    @property
    def answer(self) -> DataItem | None:
        """The data item of the answer; for a write, that of the request."""
        return self._result.answer

    @property
    def result(self) -> ItemResult:
        """The item with its answer, as a transaction has it."""
        return self._result

    @property
    def refused(self) -> bool:
        """True if there is an answer and it is not success."""
        return self._result.refused

    @property
    def error(self) -> str:
        """Name of the return code if the item was refused, otherwise empty."""
        return RETURN_CODES.name(self.return_code) if self.refused else ""


class Exchange:
    """Request and answer, without anything that belongs to one recording. Immutable.

    ``request`` and ``response`` are masked PDUs, empty if there is none. For SCD, whose meaning is in a dictionary, they are
    empty, too; ``scd`` has the decoded messages, one line each, beginning with "request" or "answer". ``subscribed`` is the
    masked request that asked for a push, which contains the items of the push; it is empty if unknown and for everything else.
    """

    __slots__ = (
        "_items",
        "_request",
        "_response",
        "form",
        "fragment",
        "kind",
        "request",
        "request_seen",
        "response",
        "response_seen",
        "scd",
        "subscribed",
    )

    def __init__(
        self,
        kind: str,
        request: bytes,
        response: bytes,
        scd: tuple[str, ...] = (),
        seen: tuple[bool, bool] = (False, False),
        subscribed: bytes = b"",
    ) -> None:
        mask = mask_s7 if kind == S7 else mask_plus if kind == PLUS else bytes
        self.kind = kind
        self.subscribed = mask(subscribed) if subscribed else b""
        self.request = mask(request)
        self.response = mask_plus_answer(response, request) if kind == PLUS else mask(response)
        self.request_seen = bool(request) or seen[0]
        self.response_seen = bool(response) or seen[1]
        self.scd = scd
        self.fragment = ""  # cached lines of the writer
        self.form: str | None = None  # and their head, empty if the lines have no separate one
        self._request: Pdu | None = None
        self._response: Pdu | None = None
        self._items: list[ItemRecord] | None = None

    @property
    def request_pdu(self) -> Pdu | None:
        """The S7comm request, None if there is none."""
        if self._request is None and self.kind == S7 and self.request:
            self._keep()
            self._request = self.parse_request()
        return self._request

    def parse_request(self) -> Pdu | None:
        """Return the request like `request_pdu`, but without keeping it parsed for this exchange."""
        if self.kind != S7 or not self.request:
            return None
        return _parsed(self.request) if len(self.request) <= SMALL else parse_pdu(self.request)

    @property
    def response_pdu(self) -> Pdu | None:
        """The S7comm answer, None if there is none."""
        if self._response is None and self.kind == S7 and self.response:
            self._keep()
            self._response = parse_pdu(self.response)
        return self._response

    def of(self, subscribed: bytes) -> Exchange:
        """Return this exchange as a push that the request ``subscribed`` asked for."""
        seen = self.request_seen, self.response_seen
        return Exchange(self.kind, self.request, self.response, self.scd, seen, subscribed)

    def _keep(self) -> None:
        """Keep the parsed PDUs of this exchange, and drop those of the one used longest ago."""
        if self._request is None and self._response is None:
            _kept.append(self)
            if len(_kept) > _KEPT:
                _kept.popleft().forget()

    def forget(self) -> None:
        """Drop the parsed PDUs; they are parsed again on demand."""
        self._request = self._response = self._items = None

    @property
    def plus(self) -> tuple[PlusPdu | None, PlusPdu | None]:
        """Request and answer of S7comm-plus."""
        if self.kind != PLUS:
            return None, None
        return (
            parse_plus(self.request) if self.request else None,
            parse_plus(self.response) if self.response else None,
        )

    @property
    def function(self) -> int:
        """The function octet of the request or answer, -1 if there is none."""
        first = self.request_pdu or self.response_pdu
        return first.function if first is not None else -1

    @property
    def function_name(self) -> str:
        """Name of the function; for userdata, of group and subfunction."""
        if self.kind == PLUS:
            first = next((pdu for pdu in self.plus if pdu is not None), None)
            return f"S7comm-plus {(first.function_name or first.kind) if first is not None else ''}".rstrip()
        if self.kind == SCD:
            return "SCD"
        pdu = self.request_pdu or self.response_pdu
        return (pdu.function_name or "no function") if pdu is not None else ""

    @property
    def items(self) -> list[ItemRecord]:
        """All items of a read or write, requests joined with answers, in wire order; empty for other functions."""
        if self._items is None:
            self._items = [ItemRecord(result, number) for number, result in enumerate(self._results(), 1)]
        return self._items

    def _wanted(self) -> list[Item]:
        """Return the items of the request that asked for a push."""
        head = parse_pdu(self.subscribed).parameters.userdata if self.subscribed else None
        return requested_items(head, self.subscribed) if head is not None else []

    def _results(self) -> list[ItemResult]:
        request_pdu, response_pdu = self.request_pdu, self.response_pdu
        first = request_pdu or response_pdu
        if first is None:
            return []
        head = first.parameters.userdata
        if head is not None and has_items(head):
            asking = request_pdu.parameters if request_pdu is not None else None
            answering = response_pdu.parameters if response_pdu is not None else None
            return userdata_results(asking, self.request, answering, self.response, self._wanted())
        if first.function not in {READ_VAR, WRITE_VAR} or (request_pdu is not None and request_pdu.rosctr != JOB):
            return []
        items = request_pdu.parameters.items if request_pdu is not None else []
        fits = response_pdu is not None and response_pdu.function == first.function
        if first.function == WRITE_VAR:
            codes = response_pdu.return_codes() if response_pdu is not None and fits else []
            return write_results(items, request_pdu.data_items() if request_pdu is not None else [], codes)
        return read_results(items, response_pdu.data_items() if response_pdu is not None and fits else [])

    @property
    def setup(self) -> tuple[Setup | None, Setup | None]:
        """The requested and negotiated values of a Setup communication."""
        request_pdu, response_pdu = self.request_pdu, self.response_pdu
        return (
            request_pdu.parameters.setup if request_pdu is not None else None,
            response_pdu.parameters.setup if response_pdu is not None else None,
        )

    @property
    def error_code(self) -> int:
        """Error class and code of the answer's header, or the error code of userdata; 0 for success."""
        if self.kind == PLUS:
            response_pdu = self.plus[1]
            return response_pdu.return_code if response_pdu is not None and response_pdu.return_code > 0 else 0
        pdu = self.response_pdu
        if pdu is None:
            return 0
        return pdu.error

    @property
    def error(self) -> str:
        """Name of the error code, empty for success."""
        code = self.error_code
        return (PLUS_CODES if self.kind == PLUS else errors_of(self.function)).name(code) if code else ""

    @property
    def refusing_code(self) -> int:
        """The return code that refuses the whole userdata request, `NOT_REFUSED` if it was not refused."""
        return self.response_pdu.refusing_code if self.kind != PLUS and self.response_pdu is not None else NOT_REFUSED

    @property
    def request_notes(self) -> list[str]:
        """Descriptions of the parts of the request; text from the wire, not escaped."""
        return self.request_pdu.body.notes if self.request_pdu is not None else []

    @property
    def response_notes(self) -> list[str]:
        """Descriptions of the parts of the answer; text from the wire, not escaped."""
        return self.response_pdu.body.notes if self.response_pdu is not None else []


@lru_cache(PARSED)
def _parsed(request: bytes) -> Pdu:
    """Return a small request parsed. It is cached, because polling repeats requests but gets new answers."""
    return parse_pdu(request)


_kept: Final[deque[Exchange]] = deque()
