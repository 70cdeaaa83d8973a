"""Shared by the tests of values: rows of synthetic conversations."""

from __future__ import annotations

import struct
from collections.abc import Iterable

from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.naming import Naming
from dissect.output.variables.choosing import Known, choose
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.model import ValueRow
from tests.properties.messages import Item, dt, read_answer, read_job, write_answer, write_job
from tests.properties.packets import Packet, Talk

REAL = 0x08
BYTE = 0x02
BIT = 0x01
WORD = 0x04
INT = 0x05


def db(size: int, octet: int, length: int = 1, bit: int = 0, number: int = 1) -> Item:
    """Return an item in a data block."""
    return Item(size, length, number, 0x84, 8 * octet + bit)


def real(value: float) -> bytes:
    """Return a REAL."""
    return struct.pack(">f", value)


def reads(talk: Talk, ref: int, *pairs: tuple[Item, bytes | int]) -> Talk:
    """Let side 0 read items, and side 1 answer with contents or return codes: two packets."""
    items = [item for item, _ in pairs]
    talk.send(0, dt(read_job(ref, items)))
    return talk.send(1, dt(read_answer(ref, items, [content for _, content in pairs])))


def writes(talk: Talk, ref: int, *triples: tuple[Item, bytes, int]) -> Talk:
    """Let side 0 write items, and side 1 answer with return codes: two packets."""
    talk.send(0, dt(write_job(ref, [row[0] for row in triples], [row[1] for row in triples])))
    return talk.send(1, dt(write_answer(ref, [row[2] for row in triples])))


def collected(collector: ValueCollector, packets: Iterable[Packet], options: Options | None = None) -> ValueCollector:
    """Drive packets through a pipeline into a collector; our bugs raise."""
    pipeline = Pipeline(collector, options or Options(strict=True))
    for packet in packets:
        pipeline.frame(packet.time_ns, packet.octets, 0, len(packet.octets), packet.wire_length, packet.link_type)
    pipeline.finish()
    return collector


def rows_of(
    talk: Talk, *names: str, changes: bool = False, every_ns: int = 0, naming: Naming | None = None
) -> list[ValueRow]:
    """Return the rows of a talk, for the named variables or for all."""
    wanted = choose(names, Known(naming)) if names else None
    options = Options(strict=True, naming=naming)
    return collected(ValueCollector(wanted, changes, every_ns), talk.packets(), options).take()


def said(rows: Iterable[ValueRow]) -> list[tuple[str, str, str, object]]:
    """Return how, address, type and value of rows."""
    return [(row.how, row.address, row.type, row.value) for row in rows]
