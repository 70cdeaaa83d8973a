"""A write whose client leaves out the fill byte after an item of odd length: what is said of it, and what is not."""

from __future__ import annotations

from itertools import product
from typing import Final

import pytest

from dissect.meaning.report.writers.jsonl import TransactionLines
from dissect.protocols.s7.items import without_fill
from tests.cases import each
from tests.engine.transactions.talk import Talk, ack, ack_data, item, read, write, written

BYTE: Final = 2
#: The sizes of the items of a write, and those after which the fill byte is left out; every way to leave out one or more.
WAYS: Final = [
    (sizes, tuple(left_out))
    for count in (2, 3, 4)
    for sizes in product((1, 2, 3), repeat=count)
    for left_out in product((False, True), repeat=count - 1)
    if any(left_out) and not any(gone and not size & 1 for size, gone in zip(sizes, left_out, strict=False))
]


def request(sizes: tuple[int, ...], left_out: tuple[bool, ...], last: bool = False, reference: int = 1) -> bytes:
    """A write of bytes; ``last``: a fill byte stands behind the last item too."""
    data = b""
    for number, size in enumerate(sizes):
        data += written(4, bytes(range(0x41, 0x41 + size)))
        filled = size & 1 and (last if number == len(sizes) - 1 else not left_out[number])
        data += bytes(1) if filled else b""
    return write(reference, [item(0x83, 0, 80 * n, BYTE, size) for n, size in enumerate(sizes)], data)


def refused(octets: bytes, answer: bytes) -> Talk:
    talk = Talk()
    talk.open()
    talk.ask(octets)
    talk.tell(answer)
    talk.close()
    return talk


@each("way", WAYS)
def test_the_place_is_named_wherever_it_is(way: tuple[tuple[int, ...], tuple[bool, ...]]) -> None:
    sizes, left_out = way
    first = left_out.index(True) + 1
    for last in (False, True):
        talk = refused(request(sizes, left_out, last), ack(1, 0x8104))
        (fault,) = [finding for finding in talk.findings if finding.slug == "s7.malformed"]
        assert f"no fill byte after item {first}, whose length is odd: item {first + 1} begins one byte early" in (
            fault.detail
        )
        reporter = talk.pipeline.exchange.reporter
        assert reporter.counts == {"s7.malformed": 1}
        assert {slug for _, slug in reporter.explained} == {
            "transaction.refused", "security.write_refused", "security.protected"
        }  # fmt: skip


@each("way", WAYS)
def test_an_item_that_begins_early_has_no_value(way: tuple[tuple[int, ...], tuple[bool, ...]]) -> None:
    sizes, left_out = way
    talk = refused(request(sizes, left_out), ack(1, 0x8104))
    (transaction,) = talk.transactions
    first = left_out.index(True) + 1
    for number, result in enumerate(transaction.s7_results):
        if number < first:
            assert result.data == bytes(range(0x41, 0x41 + sizes[number]))
        else:
            assert result.data is None
            assert result.value is None
    line = TransactionLines().line(transaction)
    assert line.count('"data":null') >= len(sizes) - first


@each("sizes", [sizes for count in (1, 2, 3, 4) for sizes in product((1, 2, 3), repeat=count)])
def test_a_write_with_its_fill_bytes_is_sound(sizes: tuple[int, ...]) -> None:
    """Also with one behind the last item, which one client sends."""
    for last in (False, True):
        octets = request(sizes, (False,) * (len(sizes) - 1), last)
        talk = refused(octets, ack(1, 0x8104))
        assert talk.pipeline.finding_counts == {
            "transaction.refused": 1, "security.write_refused": 1, "security.protected": 1
        }  # fmt: skip
        assert all(result.data for result in talk.transactions[0].s7_results)
        items = talk.transactions[0].parameters.items
        assert without_fill(items, octets, 12 + 12 * len(sizes), len(octets)) == 0


@pytest.mark.parametrize("cut", [1, 2, 3, 4, 5])
def test_what_is_wrong_in_another_way_is_not_called_a_missing_fill_byte(cut: int) -> None:
    octets = request((1, 2, 3), (True, False))
    shorter = octets[:8] + (int.from_bytes(octets[8:10], "big") - cut).to_bytes(2, "big") + octets[10:-cut]
    talk = refused(shorter, ack(1, 0x8104))
    (fault,) = [finding for finding in talk.findings if finding.slug == "s7.malformed"]
    assert "fill byte" not in fault.detail


@pytest.mark.parametrize(
    ("codes", "alone", "explained"),
    [(b"\xff\x05", 0, 1), (b"\x0a\x05", 1, 1), (b"\x0a\xff", 1, 0), (b"\x05\x05", 1, 1)],
)
def test_items_before_the_fault_stand_for_themselves(codes: bytes, alone: int, explained: int) -> None:
    talk = refused(request((1, 2), (True,)), ack_data(1, b"\x05\x02", codes))
    reporter = talk.pipeline.exchange.reporter
    assert reporter.counts.get("transaction.item_error", 0) == alone
    assert reporter.explained.get(("s7.malformed", "transaction.item_error"), 0) == explained
    # that a write was refused is one finding of all its items: it stands if one of them was sound
    assert reporter.counts.get("security.write_refused", 0) == alone


def test_a_read_has_no_fill_bytes_to_leave_out() -> None:
    talk = refused(read(1, item(0x83, 0, 0, BYTE), item(0x83, 0, 8, BYTE)), ack(1, 0x8104))
    assert "s7.malformed" not in talk.pipeline.finding_counts


def test_a_sound_write_that_is_refused_is_told_although_a_malformed_one_was() -> None:
    """What is reported once per connection is not used up by what had a cause."""
    talk = Talk()
    talk.open()
    for reference in (1, 2):
        talk.ask(request((1, 2), (True,), reference=reference))
        talk.tell(ack(reference, 0x8104))
    for reference in (3, 4):
        talk.ask(request((1, 2), (False,), reference=reference))
        talk.tell(ack(reference, 0x8104))
    talk.close()
    reporter = talk.pipeline.exchange.reporter
    assert reporter.explained["s7.malformed", "security.write_refused"] == 2
    assert reporter.counts["security.write_refused"] == reporter.counts["security.protected"] == 1
    assert reporter.counts["transaction.refused"] == 2
    (told,) = [one for one in talk.findings if one.slug == "security.write_refused" and not one.because]
    assert told.frames == [12, 13]
