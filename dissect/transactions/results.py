"""What was asked for joined with what became of it, an item each: of reads, writes, subscriptions, test functions.

Everything here works on parsed parameters and the octets of PDUs, so that a transaction and a session read from a file say the
same of them. Reference sections 3.5 (items), 4.7 (cyclic services) and 4.8 (test functions).
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.s7.items import DATA_HEAD, DataItem, Item, parse_data_items, parse_items, walk_areas
from dissect.s7.message import HEADER_SIZE
from dissect.s7.parameters import PUSH, REQUEST, Parameters, UserdataHead
from dissect.s7.tables import GROUP_CYCLIC, GROUP_TEST, SUCCESS
from dissect.s7.values import Value, decode_value
from dissect.s7.watched_items import ADDRESS_SIZE, parse_test_items
from dissect.wire.octets import u16

#: Subfunctions of the cyclic services that have items: cyclic transfer, change driven transfer, its modification.
CYCLIC_ITEMS: Final = frozenset((0x01, 0x05, 0x07))
VARIABLE_STATUS: Final = 0x02
#: Test functions that write: modify variable and force.
TEST_WRITES: Final = frozenset((0x08, 0x09))
TEST_ITEMS: Final = frozenset((VARIABLE_STATUS, *TEST_WRITES))

#: Return code in a push: the value has not changed since the last one (reference 4.7).
UNCHANGED: Final = 0xFE

#: Octets before the items: reserved, count, time base and factor in a request, reserved and count in what is sent.
_ASKED_HEAD: Final = 4
_SENT_HEAD: Final = 2
_TEST_SIZES: Final = 4


class ItemResult:
    """An item of the request joined with its own answer (either may be missing).

    ``return_code`` is -1 when there is no answer; ``data`` the octets read or written, None when there are none.
    ``decodable`` tells whether ``data`` has the size that the item asked for, so that ``value`` can be decoded.
    ``unchanged`` tells that a push says the value is the one it sent before.
    """

    __slots__ = ("answer", "data", "item", "return_code", "unchanged")

    def __init__(self, item: Item | None, return_code: i64, data: bytes | None, answer: DataItem | None) -> None:
        self.item: Item | None = item
        self.return_code: i64 = return_code
        self.data: bytes | None = data
        self.answer: DataItem | None = answer
        self.unchanged: bool = False

    def __repr__(self) -> str:
        return f"ItemResult({self.item!r}, {self.return_code}, {self.data!r})"

    @property
    def refused(self) -> bool:
        """True when there is an answer and it is not success."""
        return self.return_code != -1 and self.return_code != SUCCESS and not self.unchanged

    @property
    def decodable(self) -> bool:
        """True when there are octets of the size the item asked for (see `Item.fits`)."""
        item = self.item
        data = self.data
        return item is not None and data is not None and item.fits(len(data))

    @property
    def value(self) -> Value:
        """The decoded value, None when there is none (see `decode_value`)."""
        item = self.item
        data = self.data
        if item is None or data is None or not self.decodable:
            return None
        return decode_value(item.transport_size, data)


class Subscription:
    """What a job was asked to send: its items, and the PDU that named them."""

    __slots__ = ("items", "request")

    def __init__(self, head: UserdataHead, request: bytes) -> None:
        self.items: list[Item] = requested_items(head, request)
        self.request: bytes = request


def read_results(items: list[Item], answers: list[DataItem]) -> list[ItemResult]:
    """Join the items of a read with the data items of its answer; a DBREAD item is one result for each of its areas."""
    results: list[ItemResult] = []
    for index in range(max(len(items), len(answers))):
        item = items[index] if index < len(items) else None
        answer = answers[index] if index < len(answers) else None
        if item is not None and item.areas is not None:
            results.extend(area_results(item, answer))
        elif answer is None:
            results.append(ItemResult(item, -1, None, None))
        else:
            results.append(_result(item, answer))
    return results


def _result(item: Item | None, answer: DataItem) -> ItemResult:
    return ItemResult(item, answer.return_code, answer.data if answer.return_code == SUCCESS else None, answer)


def area_results(item: Item, answer: DataItem | None) -> list[ItemResult]:
    """Return a DBREAD item area by area, each with its own return code; as one where it was refused or does not fit."""
    areas = item.areas
    if areas is None:
        return [_result(item, answer)] if answer is not None else [ItemResult(item, -1, None, None)]
    if answer is None:
        return [ItemResult(area, -1, None, None) for area in areas]
    told = walk_areas(areas, answer.data) if answer.return_code == SUCCESS else []
    if not told:
        return [_result(item, answer)]
    return [_result(area, told[index]) for index, area in enumerate(areas)]


def write_results(items: list[Item], written: list[DataItem], codes: list[int]) -> list[ItemResult]:
    """Join the items of a write with the values it carried and the return codes of its answer."""
    results: list[ItemResult] = []
    for index in range(max(len(items), len(codes))):
        item = items[index] if index < len(items) else None
        data_item = written[index] if index < len(written) else None
        code = codes[index] if index < len(codes) else -1
        results.append(ItemResult(item, code, data_item.data if data_item is not None else None, data_item))
    return results


def has_items(head: UserdataHead) -> bool:
    """Tell whether a userdata PDU is about items: of a cyclic service or of a test function on variables."""
    if head.group == GROUP_CYCLIC:
        return head.subfunction in CYCLIC_ITEMS
    return head.group == GROUP_TEST and head.subfunction in TEST_ITEMS


def _payload(octets: bytes) -> bytes:
    """Return the payload of a userdata PDU, behind the head of its data block; empty when there is none."""
    if len(octets) < HEADER_SIZE:
        return b""
    at: i64 = HEADER_SIZE + u16(octets, 6)
    if at + DATA_HEAD > len(octets):
        return b""
    return octets[at + DATA_HEAD : at + DATA_HEAD + u16(octets, at + 2)]


def _test_data(payload: bytes) -> bytes:
    """Return the data block of a programmer command, behind its sizes and parameter block."""
    if len(payload) < _TEST_SIZES:
        return b""
    at: i64 = _TEST_SIZES + u16(payload, 0)
    return payload[at : at + u16(payload, 2)]


def requested_items(head: UserdataHead, octets: bytes) -> list[Item]:
    """Return the items that a request of a cyclic service or test function names; ``octets`` is the PDU."""
    if head.type != REQUEST or head.data_unit_ref or not has_items(head):
        return []
    payload = _payload(octets)
    if head.group == GROUP_CYCLIC:
        if len(payload) < _ASKED_HEAD:
            return []
        return parse_items(payload, _ASKED_HEAD, len(payload), payload[1], [])
    return parse_test_items(_test_data(payload))


def userdata_results(
    asked: Parameters | None, request: bytes, told: Parameters | None, response: bytes, subscribed: list[Item] | None
) -> list[ItemResult]:
    """Join the items of a cyclic service or test function with their values.

    ``request`` and ``response`` are PDUs, empty where there is none, with their parameters. A push has no request: its items
    are those that were ``subscribed``; where these are not known its values stand without addresses.
    """
    asks = asked.userdata if asked is not None and request else None
    tells = told.userdata if told is not None and response else None
    items = subscribed if subscribed is not None else []
    if asks is not None:
        items = requested_items(asks, request)
    if asks is not None and asks.group == GROUP_TEST:
        return write_results(items, _test_values(asks, request, len(items)), [])
    if tells is None or tells.type == REQUEST or not has_items(tells) or tells.more or tells.continues:
        return read_results(items, [])
    payload = _payload(response)
    if tells.group == GROUP_CYCLIC:
        if len(payload) < _SENT_HEAD:
            return read_results(items, [])
        results = read_results(items, parse_data_items(payload, _SENT_HEAD, len(payload), payload[1], True, []))
    else:
        results = _test_results(tells, items, _test_data(payload))
    for result in results:
        result.unchanged = result.return_code == UNCHANGED
    return results


def _test_values(head: UserdataHead, request: bytes, count: int) -> list[DataItem]:
    """Return the values that a request to modify or force variables carries behind their addresses."""
    if head.subfunction not in TEST_WRITES or not count:
        return []
    data = _test_data(_payload(request))
    return parse_data_items(data, _SENT_HEAD + ADDRESS_SIZE * count, len(data), count, False, [])


def _test_results(head: UserdataHead, items: list[Item], data: bytes) -> list[ItemResult]:
    """Return what a push of a test function says: values, or the return codes of what was written."""
    if head.type != PUSH or len(data) < _SENT_HEAD:
        return read_results(items, [])
    count: i64 = u16(data, 0)
    if head.subfunction == VARIABLE_STATUS:
        return read_results(items, parse_data_items(data, _SENT_HEAD, len(data), count, True, []))
    return write_results(items, [], list(data[_SENT_HEAD : _SENT_HEAD + count]))
