"""Measure the SCD codec and others in one run: ``python -m benchmarks.scd``.

Decoding and encoding of three PDOs, a batch of them into columns, loading a dictionary of 1000 objects. Our figures are for the
whole call: from octets to a mapping of values with flags for infinities, surplus octets and times out of range. For the others
the natural result is measured: bitstruct a tuple, construct a container, cantools a dictionary, canopen (only if everything is
aligned: its bit fields are wrong) the values of a mapping. Each value is checked against ours first. Packages that are not
installed are left out. All take turns; figures are the best of several rounds, in microseconds of CPU time per call, and as
multiples of ours.
"""

from __future__ import annotations

import argparse
import json
import random
import struct
import sys
import tempfile
import time
import timeit
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.measure import machine
from benchmarks.tables import columns
from dissect.scd.codec import Codec
from dissect.scd.dictionary import Dictionary
from dissect.scd.loading import load
from dissect.scd.mapping import Entry, pack_entry
from dissect.scd.records import Body, ObjectRecord, TypeRecord
from dissect.scd.types import STANDARD, Kind

#: (kind, bits) of the fields of each PDO.
Fields = list[tuple[str, int]]
ALIGNED: Fields = [("u", 16), ("s", 32), ("s", 8)]
UNALIGNED: Fields = [("b", 1), ("b", 1), ("u", 12), ("s", 32), ("b", 1), ("u", 5), ("s", 10), ("f", 32)]
MIXED: Fields = [*UNALIGNED[:7], ("u", 8)] * 7 + [("f", 32), ("f", 64), *[("u", 16)] * 5, ("b", 1)]
PDOS = {"3 aligned": ALIGNED, "8 unaligned": UNALIGNED, "64 mixed": MIXED}

OURS = "s7dissect decode"

#: The promised limits, in microseconds per call, PDOs per second and milliseconds (issue 4).
TARGETS = {"3 aligned": 1.0, "8 unaligned": 2.0, "batch": 5e6, "load": 50.0}

_KINDS = {"b": Kind.BOOL, "u": Kind.UINT, "s": Kind.INT, "f": Kind.REAL}


def dictionary(fields: Fields) -> Dictionary:
    """Return a dictionary with a TPDO 1 of these fields one after the other."""
    codes = {(row.kind, row.bits): index for index, row in STANDARD.items()}
    types: list[TypeRecord] = []
    objects: list[ObjectRecord] = []
    entries: list[int] = []
    at = 0
    for letter, bits in fields:
        key = _KINDS[letter], bits
        if key not in codes:
            codes[key] = 0x60 + len(types)
            types.append(TypeRecord(codes[key], f"{letter}{bits}", key[0], bits))
        index = 0x6000 + len(objects)
        objects.append(ObjectRecord(index, 7, f"v{index:x}", codes[key], 0, "ro", False, True))
        entries.append(pack_entry(Entry(index, 0, at, bits), True))
        at += bits
    mapping = ObjectRecord(0x1A00, 8, "map", 27, 0, "rw", False, False, len(entries), len(entries), list(entries))
    return Dictionary(Body("benchmark", "1", "utc", types, [], [mapping, *objects]))


def sample(fields: Fields, dice: random.Random) -> list[Any]:
    """Return values for the fields."""
    made: list[Any] = []
    for letter, bits in fields:
        if letter == "b":
            made.append(dice.random() < 0.5)
        elif letter == "f":
            made.append(struct.unpack("<f", struct.pack("<f", dice.uniform(-100, 100)))[0])
        else:
            made.append(dice.randrange(1 << bits) - ((1 << bits - 1) if letter == "s" else 0))
    return made


def best(calls: Sequence[Callable[[], object]], rounds: int = 15) -> list[float]:
    """Return the CPU seconds of one call of each: the best of several rounds, in which they take turns of about 10 ms."""
    timers = [timeit.Timer(call, timer=time.process_time) for call in calls]
    numbers = []
    for timer in timers:
        number = 1
        while (took := timer.timeit(number)) < 0.01:
            number = max(2 * number, int(number * 0.01 / max(took, 1e-6)))
        numbers.append(number)
    figures = [
        [timer.timeit(number) / number for timer, number in zip(timers, numbers, strict=True)] for _ in range(rounds)
    ]
    return [min(column) for column in zip(*figures, strict=True)]


def bit_format(fields: Fields) -> str:
    """Return bitstruct's format over the reversed octets."""
    size = sum(bits for _, bits in fields)
    return f"p{-size % 8}" * (size % 8 > 0) + "".join(f"{letter}{bits}" for letter, bits in reversed(fields))


def with_struct(fields: Fields) -> Callable[[bytes], Any] | None:
    """Decode with a bare struct.Struct, if that is possible."""
    codes = {("u", 16): "H", ("s", 32): "i", ("s", 8): "b"}
    if not all(field in codes for field in fields):
        return None
    return struct.Struct("<" + "".join(codes[field] for field in fields)).unpack


def with_bitstruct_c(fields: Fields) -> Callable[[bytes], Any]:
    """Decode with bitstruct's C extension alone."""
    from bitstruct import c

    unpack = c.compile(bit_format(fields)).unpack
    return lambda octets: unpack(octets[::-1])[::-1]


def with_bitstruct(fields: Fields) -> Callable[[bytes], Any]:
    """Decode with bitstruct's Python form."""
    import bitstruct

    unpack = bitstruct.compile(bit_format(fields)).unpack
    return lambda octets: unpack(octets[::-1])[::-1]


def with_construct(fields: Fields) -> Callable[[bytes], Any]:
    """Decode with construct: bits from the top over the reversed octets, floats and signed numbers adapted."""
    import construct

    size = sum(bits for _, bits in fields)
    parts: list[Any] = [construct.Padding(-size % 8)]
    for at, (letter, bits) in reversed(list(enumerate(fields))):
        name = f"f{at}"
        if letter == "f":
            real = construct.Float32b if bits == 32 else construct.Float64b
            parts.append(name / construct.Bytewise(real))
        else:
            parts.append(
                name / (construct.Flag if letter == "b" else construct.BitsInteger(bits, signed=letter == "s"))
            )
    whole = construct.BitStruct(*parts)
    names = [f"f{at}" for at in range(len(fields))]

    def decode(octets: bytes) -> list[Any]:
        found = whole.parse(octets[::-1])
        return [found[name] for name in names]

    return decode


def with_cantools(fields: Fields) -> Callable[[bytes], Any]:
    """Decode with a cantools message of little-endian signals."""
    from cantools.database import Message
    from cantools.database.can.signal import Signal
    from cantools.database.conversion import BaseConversion

    starts = [0]
    for _, bits in fields:
        starts.append(starts[-1] + bits)
    signals = [
        Signal(
            f"f{at}", starts[at], bits, "little_endian", letter == "s",
            conversion=BaseConversion.factory(is_float=letter == "f"),
        )
        for at, (letter, bits) in enumerate(fields)
    ]  # fmt: skip
    message = Message(1, "m", (starts[-1] + 7) // 8, signals)
    return lambda octets: message.decode(octets, decode_choices=False)


def with_canopen(fields: Fields) -> Callable[[bytes], Any] | None:
    """Decode with a mapping of python-canopen, if every field is aligned to octets."""
    if fields is not ALIGNED:
        return None
    import canopen
    from canopen.objectdictionary import ODRecord, ODVariable

    od = canopen.ObjectDictionary()
    for index in (0x1800, 0x1A00):
        record = ODRecord("PDO", index)
        for sub in range(4):
            record.add_member(ODVariable(f"s{sub}", index, sub))
        od.add_object(record)
    kinds = {("u", 16): 6, ("s", 32): 4, ("s", 8): 2}
    for at, field in enumerate(fields):
        variable = ODVariable(f"v{at}", 0x6000 + at)
        variable.data_type = kinds[field]
        od.add_object(variable)
    pdo = canopen.RemoteNode(1, od).tpdo[1]
    pdo.clear()
    for at, (_, bits) in enumerate(fields):
        pdo.add_variable(0x6000 + at, 0, bits)

    def decode(octets: bytes) -> list[Any]:
        pdo.data = bytearray(octets)
        return [variable.raw for variable in pdo]

    return decode


PEERS: dict[str, Callable[[Fields], Callable[[bytes], Any] | None]] = {
    "struct alone": with_struct,
    "bitstruct.c alone": with_bitstruct_c,
    "bitstruct, Python": with_bitstruct,
    "construct": with_construct,
    "cantools": with_cantools,
    "canopen": with_canopen,
}


def measure_pdo(name: str, fields: Fields) -> list[tuple[str, str, float]]:
    """Return (PDO, package, µs per call) for decoding by all and for our encoding."""
    codec = Codec(dictionary(fields))
    values = sample(fields, random.Random(4))
    keyed = {(0x6000 + at, 0): value for at, value in enumerate(values)}
    octets = codec.encode("T1", keyed)
    decoded = codec.decode("T1", octets)
    assert list(decoded.values.values()) == values
    assert decoded.flags == {}
    objects = codec.objects()
    calls: dict[str, Callable[[], object]] = {
        OURS: lambda: codec.decode("T1", octets),
        f"{OURS}, objects updated": lambda: codec.decode("T1", octets, objects),
    }
    for who, make in PEERS.items():
        try:
            decode = make(fields)
        except ImportError as error:
            print(f"{who}: left out, {error}", file=sys.stderr)
            continue
        if decode is None:
            continue
        found = decode(octets)
        found = list(found.values()) if isinstance(found, dict) else list(found)
        assert found == values, (who, found, values)
        calls[who] = partial(decode, octets)
    calls["s7dissect encode"] = lambda: codec.encode("T1", keyed)
    seconds = best(list(calls.values()))
    return [(name, who, one * 1e6) for who, one in zip(calls, seconds, strict=True)]


def measure_batch(fields: Fields, count: int) -> float | None:
    """Return PDOs a second decoded into columns, gathered from a buffer in which each has a header before it."""
    codec = Codec(dictionary(fields))
    dice = random.Random(5)
    some = [codec.encode("T1", {(0x6000 + at, 0): v for at, v in enumerate(sample(fields, dice))}) for _ in range(1000)]
    offsets, buffer = [], bytearray()
    for at in range(count):
        buffer += b"header"
        offsets.append(len(buffer))
        buffer += some[at % 1000]
    try:
        import numpy as np
    except ImportError as error:
        print(f"batch: left out, {error}", file=sys.stderr)
        return None
    whole, places = bytes(buffer), np.array(offsets)
    made = codec.decode_many("T1", whole, places)
    for at in (0, 17, count - 1):
        single = codec.decode("T1", whole[offsets[at] : offsets[at] + codec.pdo("T1").size])
        assert [made[key][at].item() for key in made] == list(single.values.values())
    return count / best([lambda: codec.decode_many("T1", whole, places)])[0]


def measure_load(objects: int) -> float:
    """Return the milliseconds of loading a compiled dictionary of so many objects, PDOs among them."""
    rows = [ObjectRecord(0x6000 + at, 7, f"object {at}", 6, 0, "rw", False, True) for at in range(objects - 10)]
    maps = []
    for number in range(10):
        entries = [pack_entry(Entry(0x6000 + 40 * number + at, 0, 16 * at, 16), True) for at in range(40)]
        maps.append(ObjectRecord(0x1A00 + number, 8, f"map {number}", 27, 0, "rw", False, False, 40, 40, list(entries)))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "made.scd"
        Dictionary(Body("benchmark", "1", "utc", [], [], [*maps, *rows])).save(path)
        assert len(load(path)) == objects
        return best([lambda: load(path)])[0] * 1e3


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; return 1 if a target is missed and ``--gate`` is given."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scd", description=__doc__)
    parser.add_argument("--batch", type=int, default=200_000, help="PDOs of the batch (default 200000)")
    parser.add_argument("--json", type=Path, help="write all figures to this file too")
    parser.add_argument("--gate", action="store_true", help="end with 1 when a target of issue 4 is missed")
    options = parser.parse_args(arguments)
    print(machine())
    figures = [figure for name, fields in PDOS.items() for figure in measure_pdo(name, fields)]
    ours = {name: us for name, who, us in figures if who == OURS}
    lines = [(f"{name}: {who}", f"{us:.2f}", f"{us / ours[name]:.1f}") for name, who, us in figures]
    print(columns(("PDO", "µs a call", "x our decode"), lines))
    batches = {name: measure_batch(fields, options.batch) for name, fields in PDOS.items()}
    for name, rate in batches.items():
        if rate:
            print(f"batch, {name}: {rate / 1e6:.1f} M PDOs/s")
    load_ms = measure_load(1000)
    print(f"load of 1000 objects: {load_ms:.1f} ms")
    missed = [f"{name}: {us:.2f} µs" for name, us in ours.items() if us > TARGETS.get(name, us)]
    missed += [
        f"batch, {name}"
        for name in ("3 aligned", "8 unaligned")
        if (batches[name] or TARGETS["batch"]) < TARGETS["batch"]
    ]
    missed += [f"load: {load_ms:.1f} ms"] if load_ms > TARGETS["load"] else []
    print("targets: " + ("missed by " + "; ".join(missed) if missed else "all met"))
    if options.json:
        figures_as_rows = [{"pdo": name, "who": who, "us": us} for name, who, us in figures]
        told = {"machine": machine(), "calls": figures_as_rows, "batch_per_s": batches, "load_ms": load_ms}
        options.json.write_text(json.dumps(told, indent=1), encoding="utf-8")
    return 1 if missed and options.gate else 0


if __name__ == "__main__":
    sys.exit(main())
