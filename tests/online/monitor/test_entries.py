from __future__ import annotations

from pathlib import Path

import dissect
from dissect.engine.transactions.transaction import Transaction
from dissect.online.monitor.entries import Entry, Ring, detached
from tests.cases import each
from tests.meaning.report.support import begun
from tests.online.monitor.support import CAPTURES, events_of, of_packets
from tests.properties.messages import fragments, pdu

NAMES = sorted([path.stem for path in CAPTURES.glob("*.pcapng")])


@each("name", NAMES)
def test_a_detached_transaction_says_the_same(name: str) -> None:
    """And holds its octets only, with the packet around them where that carries nothing else."""
    for event in dissect.open(str(CAPTURES / f"{name}.pcapng"), pdus=False):
        if not isinstance(event, Transaction):
            continue
        kept = detached(event)
        assert (kept.request_octets, kept.response_octets) == (event.request_octets, event.response_octets)
        assert [error.as_dict() for error in kept.errors] == [error.as_dict() for error in event.errors]
        for field in ("number", "outcome", "reason", "function_name", "latency_ns", "failed", "request_frame"):
            assert getattr(kept, field) == getattr(event, field), field
        assert [result.value for result in kept.s7_results] == [result.value for result in event.s7_results]
        for buf, offset in ((kept._request_buf, kept._request_offset), (kept._response_buf, kept._response_offset)):
            assert offset in {0, 7}
            if offset:
                assert buf[:2] == b"\x03\x00"
                assert int.from_bytes(buf[2:4], "big") == len(buf)


def test_the_packet_is_kept_where_it_carries_the_pdu_whole() -> None:
    (setup,) = [event.what for event in events_of(of_packets(begun().packets())) if isinstance(event.what, Transaction)]
    assert (int(detached(setup)._request_offset), int(detached(setup)._response_offset)) == (7, 7)


def test_a_pdu_from_several_fragments_is_kept_alone() -> None:
    talk = begun()
    job = pdu(1, 9, b"\x04\x01\x12\x0a\x10\x02\x00\x01\x00\x01\x84\x00\x00\x00")
    talk.send(0, fragments(job, [5]))
    (*_, read) = [event.what for event in events_of(of_packets(talk.packets())) if isinstance(event.what, Transaction)]
    kept = detached(read)
    assert (int(kept._request_offset), kept._request_buf) == (0, job)
    assert kept._response_buf == b""


def transaction() -> Transaction:
    (setup,) = [event.what for event in events_of(of_packets(begun().packets())) if isinstance(event.what, Transaction)]
    return detached(setup)


def test_the_ring_is_bounded_in_entries() -> None:
    ring = Ring(3, 10**9)
    what = transaction()
    for order in range(10):
        ring.add(Entry(order, 0, what, False))
    assert [entry.order for entry in ring.entries] == [7, 8, 9]
    assert ring.octets == sum([entry.octets for entry in ring.entries])


def test_the_ring_is_bounded_in_octets() -> None:
    what = transaction()
    size = Entry(0, 0, what, False).octets
    ring = Ring(1000, 4 * size)
    for order in range(10):
        ring.add(Entry(order, 0, what, False))
    assert [entry.order for entry in ring.entries] == [6, 7, 8, 9]
    assert ring.octets == 4 * size


def test_one_that_is_larger_than_all_there_is_stays_alone() -> None:
    ring = Ring(1000, 10)
    for order in range(3):
        ring.add(Entry(order, 0, transaction(), False))
    assert [entry.order for entry in ring.entries] == [2]


def test_the_captures_are_found() -> None:
    assert len(NAMES) > 30
    assert Path(CAPTURES / "password.pcapng").exists()
