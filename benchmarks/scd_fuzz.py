"""Throw damaged dictionaries and payloads at the SCD codec: ``python -m benchmarks.scd_fuzz --seconds 60``.

Each case is a made-up dictionary (`benchmarks.scd_made`) and its treatment: files and sources damaged in octets and in their
records, values sent and received through every function, payloads and messages of arbitrary octets. Only `dissect.scd.Error`
may be raised, and nothing at all for data received in an envelope; sent values must be received unchanged. Anything else is
printed with the seed of its case, and the run ends with 1.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import time
import tomllib
import traceback
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.measure import machine
from benchmarks.scd_damage import JUNK, TEXT_JUNK, damage_octets, damage_tree, sealed
from benchmarks.scd_made import made_body, made_value, same, same_values
from benchmarks.tables import columns
from dissect.scd.codec import Codec, Decoded
from dissect.scd.dictionary import Dictionary
from dissect.scd.dump import dump_json, dump_tables, dump_toml
from dissect.scd.errors import DictionaryError, Error
from dissect.scd.layout import Key
from dissect.scd.loading import load_octets
from dissect.scd.messages import Message
from dissect.scd.model import Object, Pdo, StructType, Variable
from dissect.scd.packing import LIMITS
from dissect.scd.service import decode_named, encode_named
from dissect.scd.source import parse_json, parse_toml
from dissect.scd.types import Value

PLANT = (Path(__file__).resolve().parent.parent / "captures" / "scd" / "plant.toml").read_text("utf-8")

Told = Counter[str]


class WrongError(Exception):
    """Two results that should be equal are not."""


def expect(holds: bool, what: str) -> None:
    """Raise `WrongError` if a condition is false that should always be true."""
    if not holds:
        raise WrongError(what)


class Case:
    """One dictionary, and everything that is done with it; ``told`` counts the results."""

    def __init__(self, dice: random.Random, told: Told) -> None:
        self.dice = dice
        self.told = told
        self.od = Dictionary(made_body(dice))
        self.codec = Codec(self.od, strict_pad=True, limits=False)

    def run(self) -> None:
        """Do everything."""
        self.round_trip()
        self.pdos()
        self.structs()
        self.objects()
        self.variables()
        self.messages()
        for _ in range(4):
            self.damaged_file()
            self.damaged_source()

    def attempt(self, what: str, call: Callable[[], object], only: type[Error] = Error) -> object:
        """Return the result of the call, None if it raises an error that it may raise."""
        self.told[what] += 1
        try:
            return call()
        except only as error:
            expect(bool(str(error)) and bool(error.detail), f"{what}: an error that says nothing")
            self.told[f"{what}: {error.code}"] += 1
            return None

    def round_trip(self) -> None:
        """Source → file → dump → file, and the wire id of what is loaded."""
        octets = self.od.octets
        loaded = load_octets(octets)
        expect(loaded.octets == octets and loaded.wire_id == self.od.wire_id, "a file loads as another one")
        expect(parse_toml(dump_toml(loaded)).octets == octets, "its TOML compiles to another file")
        expect(parse_json(dump_json(loaded)).octets == octets, "its JSON compiles to another file")
        self.told["round trip"] += 1

    def payload(self, size: int) -> bytes:
        """Return arbitrary octets, mostly of the right size."""
        return self.dice.randbytes(size if self.dice.random() < 0.7 else self.dice.randrange(size + 12))

    def both_ways(
        self, what: str, values: Mapping[Any, Value], encode: Callable[[Mapping[Any, Value]], bytes],
        decode: Callable[[bytes], Decoded],
    ) -> None:  # fmt: skip
        """Send and receive ``values``, then receive arbitrary octets, and send and receive the result."""
        octets = encode(values)
        found = decode(octets)
        sound = same_values(found.values, dict(values)) and not found.flags.keys() - {LIMITS}
        expect(sound, f"{what}: another value came back")
        self.told[f"{what} both ways"] += 1
        for size in {0, len(octets) // 2, len(octets) - 1} - {-1, len(octets)}:
            self.attempt(f"{what} cut", partial(decode, octets[:size]))
        received = self.attempt(what, partial(decode, self.payload(len(octets))))
        if isinstance(received, Decoded) and not received.flags.keys() - {"pad", "trailing", LIMITS}:
            again = decode(encode(received.values))
            sound = same_values(again.values, received.values) and not again.flags.keys() - {LIMITS}
            expect(sound, f"{what}: received, sent, received")

    def pdos(self) -> None:
        """Bare PDOs."""
        for pdo in (*self.od.tpdo.values(), *self.od.rpdo.values()):
            name = f"{pdo.direction}{pdo.number}"
            keys: list[Key] = [row.variable.address for row in pdo.map]
            if len(set(keys)) != len(keys):
                self.attempt("PDO of one variable twice", partial(self.codec.decode, name, bytes(pdo.size)))
                continue
            values: dict[Any, Value] = {
                row.variable.address: made_value(self.dice, row.variable.type, row.bits) for row in pdo.map
            }
            self.both_ways(
                "PDO", values, partial(self.codec.encode, name),
                partial(self.codec.decode, name),
            )  # fmt: skip
            self.columns(name, pdo)
            self.remapped(pdo)

    def columns(self, name: str, pdo: Pdo) -> None:
        """Many payloads at once compared with one by one; numbers only, the rest is compared in tests."""
        octets = self.dice.randbytes(3 * pdo.size + 2)
        starts = [self.dice.randrange(len(octets) - pdo.size + 1) for _ in range(3)]
        found = self.codec.decode_many(name, octets, starts)
        for at, start in enumerate(starts):
            one = self.attempt("columns", partial(self.codec.decode, name, octets[start : start + pdo.size]))
            if isinstance(one, Decoded):
                for key, value in one.values.items():
                    if isinstance(value, (bool, int, float)):
                        expect(same(found[key][at].item(), value), "a column holds another value")

    def remapped(self, pdo: Pdo) -> None:
        """A mapping rewritten in traffic."""
        entries = [
            self.dice.choice((self.dice.getrandbits(64), 0x00080000_00002000, 0)) for _ in range(self.dice.randrange(4))
        ]
        self.attempt("mapping", partial(self.od.with_mapping, pdo.mapping.index, entries))

    def structs(self) -> None:
        """Bare structs."""
        for struct_type in [row for row in self.od.types.values() if isinstance(row, StructType)]:
            name = struct_type.name
            self.both_ways(
                "struct", self.values_of(struct_type.fields, named=True),
                partial(self.codec.encode_type, name),
                partial(self.codec.decode_type, name),
            )  # fmt: skip

    def values_of(self, fields: Sequence[Variable], *, named: bool = False) -> dict[Any, Value]:
        """Return a value for each variable, by name or by address."""
        return {
            row.name if named else row.address: made_value(self.dice, row.type, row.bits)
            for row in fields
            if not row.reserved
        }

    def objects(self) -> None:
        """Whole objects, through the codec and through the functions of the text."""
        for obj in [row for row in self.od if not row.single]:
            index = obj.index
            self.both_ways(
                "object", self.values_of(obj.fields), partial(self.codec.encode_object, index),
                partial(self.codec.decode_object, index),
            )  # fmt: skip
            self.named(obj)

    def named(self, obj: Object) -> None:
        """The results of `init`, `encode` and `decode` for a name."""
        objects = self.codec.objects(obj.name)
        self.attempt("decode by name", partial(decode_named, self.codec, self.payload(obj.size), objects))
        self.attempt("encode by name", partial(encode_named, self.codec, objects))

    def variables(self) -> None:
        """Single values, and invalid ones."""
        for obj in self.od:
            for row in obj:
                values: dict[Any, Value] = {row.address: made_value(self.dice, row.type, row.bits)}
                key = row.address
                self.both_ways(
                    "value", values, partial(self.encode_one, key),
                    partial(self.codec.decode_value, key),
                )  # fmt: skip
                self.attempt("not a value", partial(row.encode, self.dice.choice(JUNK + TEXT_JUNK)))

    def encode_one(self, key: tuple[int, int], given: Mapping[Any, Value]) -> bytes:
        """Return the octets of one variable's value."""
        return self.codec.encode_value(key, given[key])

    def messages(self) -> None:
        """Messages in the envelope: sent and received, damaged, of arbitrary octets."""
        roles = self.codec.envelope.roles
        unit = b""
        for message in self.made_messages():
            octets = self.attempt("message", partial(self.codec.encode_message, message))
            if not isinstance(octets, bytes):
                continue
            found = self.codec.parse_message(octets)
            expect(found.error is None and found.size == len(octets), f"a message of ours is refused: {found.error}")
            if "index" in roles or "pdo" in roles:
                expect(same_values(found.values, message.values), "a message with another value came back")
            unit += octets
        # From here on nothing may be raised at all.
        cut = unit[: self.dice.randrange(len(unit) + 1)]
        for octets in (unit, damage_octets(self.dice, unit), self.dice.randbytes(60), cut):
            for message in self.codec.parse_messages(octets):
                expect(message.size > 0 or message.error is not None, "a message without size and without error")
                self.told[f"received: {'good' if message.error is None else message.error.code}"] += 1
            self.codec.envelope.frame(octets, self.dice.randrange(len(octets) + 1))

    def made_messages(self) -> list[Message]:
        """Return some messages that the dictionary allows."""
        made = []
        variables = [row for obj in self.od for row in obj]
        roles = self.codec.envelope.roles
        tid = self.dice.randrange(32) if "tid" in roles else 0
        for row in self.dice.sample(variables, min(3, len(variables))):
            value: dict[Key, Value] = {row.address: made_value(self.dice, row.type, row.bits)}
            made += [
                Message("read", "request", tid, 0, *row.address), Message("write", "response", tid, 0, *row.address),
                Message("read", "response", tid, 0, *row.address, values=value),
                Message("write", "request", tid, 0, *row.address, values=value),
                Message("read", "abort", tid, self.dice.randrange(-128, 0), *row.address),
            ]  # fmt: skip
        for pdo in self.od.tpdo.values():
            values: dict[Key, Value] = {
                row.variable.address: made_value(self.dice, row.variable.type, row.bits) for row in pdo.map
            }
            if len(values) == len(pdo.map):
                made.append(Message("pdo", "push", tid, values=values, pdo=f"T{pdo.number}"))
        return made

    def damaged_file(self) -> None:
        """A file with wrong octets, or with wrong records and right sums."""
        body = self.od.octets[64:]
        if self.dice.random() < 0.4:
            octets = sealed(damage_octets(self.dice, body), self.dice)
        elif self.dice.random() < 0.1:
            octets = damage_octets(self.dice, self.od.octets)
        else:
            records = msgspec.msgpack.decode(body)
            try:
                damage_tree(self.dice, records, JUNK)
                octets = sealed(msgspec.msgpack.encode(records), self.dice)
            except RecursionError:  # of ours, while it is written
                return
        self.use(self.attempt("file", partial(load_octets, octets, "x.scd"), DictionaryError))

    def damaged_source(self) -> None:
        """A TOML or JSON source with other characters or other values."""
        how = self.dice.random()
        if how < 0.3:
            text = damage_octets(self.dice, (PLANT if how < 0.1 else dump_toml(self.od)).encode()).decode(
                errors="replace"
            )
            self.use(self.attempt("TOML", partial(parse_toml, text, "x.toml"), DictionaryError))
            return
        if how < 0.4:
            text = damage_octets(self.dice, dump_json(self.od).encode()).decode(errors="replace")
        else:
            # A dump has no PDOs, templates and instances: they are objects in it.
            tables = tomllib.loads(PLANT) if how > 0.8 else json.loads(json.dumps(dump_tables(self.od)))
            try:
                damage_tree(self.dice, tables, JUNK + TEXT_JUNK)
                text = json.dumps(tables, default=repr)
            except RecursionError:  # of ours, while it is written
                return
        self.use(self.attempt("JSON", partial(parse_json, text, "x.json"), DictionaryError))

    def use(self, found: object) -> None:
        """Use a damaged dictionary that still obeys the rules."""
        if not isinstance(found, Dictionary):
            return
        expect(load_octets(found.octets).octets == found.octets, "what was accepted loads as another one")
        expect(parse_toml(dump_toml(found)).octets == found.octets, "what was accepted dumps as another one")
        codec = Codec(found, strict_pad=True)
        for pdo in (*found.tpdo.values(), *found.rpdo.values()):
            name = f"{pdo.direction}{pdo.number}"
            self.attempt("PDO", partial(codec.decode, name, self.payload(pdo.size)))
        for obj in found:
            self.attempt("object", partial(codec.decode_object, obj.index, self.payload(obj.size)))
        self.attempt("envelope", lambda: list(codec.parse_messages(self.dice.randbytes(40))))


def run_case(seed: int, number: int, told: Told) -> None:
    """Run one case; raises an exception that it should not."""
    Case(random.Random(f"{seed}/{number}"), told).run()


def run(seed: int, first: int, seconds: float, most: int, told: Told) -> tuple[int, Counter[str]]:
    """Run cases until the time or their number is used up; return their number, and the failures by kind."""
    failed: Counter[str] = Counter()
    end = time.monotonic() + seconds
    number = first
    while time.monotonic() < end and number - first < most:
        try:
            run_case(seed, number, told)
        except Exception as error:  # noqa: BLE001 - what else comes out is what is looked for
            kind = f"{type(error).__name__}: {str(error)[:80]}"
            failed[kind] += 1
            if failed[kind] == 1:
                print(f"case {number} of seed {seed}:", "".join(traceback.format_exception(error)), sep="\n")
        number += 1
    return number - first, failed


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print; return 1 if anything except our own error was raised."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scd_fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60, help="how long (default 60)")
    parser.add_argument("--seed", type=int, help="of all cases (default: another one each time)")
    parser.add_argument("--case", type=int, help="only this case of the seed")
    parser.add_argument("--json", type=Path, help="write the figures to this file too")
    options = parser.parse_args(arguments)
    seed = options.seed if options.seed is not None else random.SystemRandom().getrandbits(32)
    print(machine(), f"seed {seed}", sep="\n")
    told: Told = Counter()
    if options.case is not None:
        cases, failed = run(seed, options.case, float("inf"), 1, told)
    else:
        cases, failed = run(seed, 0, options.seconds, sys.maxsize, told)
    print(columns(("what was done", "times"), [(name, str(count)) for name, count in sorted(told.items())]))
    errors = sum(count for name, count in told.items() if ": " in name and name != "received: good")
    print(f"{cases} cases, seed {seed}: {errors} errors of ours, {sum(failed.values())} other exceptions")
    for kind, count in failed.most_common():
        print(f"  {count} x {kind}")
    if options.json:
        figures = {"machine": machine(), "seed": seed, "cases": cases, "told": told, "failed": failed}
        options.json.write_text(json.dumps(figures, indent=1), encoding="utf-8")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
