"""Fuzz target ``segments``: TCP connections with losses, copies, disorder, fragments and resets (`tests.fuzz.scripts`)."""

from __future__ import annotations

from dissect.engine.pipeline import Options, Pipeline
from tests.fuzz.scripts import Script
from tests.fuzz.turns import TURNS
from tests.properties.books import Record, Result, check_books, facts

#: The octets around a packet in its buffer: more of what could be taken for a part of it.
_BEFORE = b"\x03\x00\x00\x07\x02\xf0\x80"
_BEHIND = b"\x03\x00\x00\x07\x02\xf0\x00" * 3


def segments(octets: bytes) -> None:
    """Any sequence of segments: packets, octets, PDUs and connections are accounted for.

    The results do not depend on the other contents of the buffer of a packet.
    """
    packets = Script(octets).packets
    result = Result(packets)
    check_books(result.pipeline, result.record)
    if not TURNS.has(octets, 0, 2):
        return  # every second one is read again from other buffers
    record = Record()
    pipeline = Pipeline(record, Options(strict=True))
    start = len(_BEFORE)
    for packet in packets:
        buf = _BEFORE + packet.octets + _BEHIND
        end = start + len(packet.octets)
        pipeline.frame(packet.time_ns, buf, start, end, packet.wire_length, packet.link_type)
    pipeline.finish()
    assert pipeline.counters.packet_counts() == result.pipeline.counters.packet_counts()
    assert pipeline.finding_counts == result.counts
    assert [facts(one) for one in record.transactions] == [facts(one) for one in result.transactions]
