"""Values by tags against a real peer: what python-snap7 wrote into a data block is what the capture says by name."""

from __future__ import annotations

import random
from collections.abc import Callable
from datetime import date, timedelta
from pathlib import Path
from typing import Any, Final

from snap7 import util

import dissect
from dissect.engine.transactions.naming import NamedValue, named_values
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.tags import load_tags
from dissect.online.live.events import CLOSED
from dissect.protocols.s7.tables import READ_VAR, WRITE_VAR
from tests.online.live.support import client, plc, taken
from tests.online.proxy.test_source import dissected

#: The block of the test server (64 octets) as a source: no offsets, they follow from the rules.
SOURCE: Final = """DATA_BLOCK "Press"
{ S7_Optimized_Access := 'FALSE' }
VERSION : 0.1
   STRUCT
      force : Real;
      setpoint : Real;
      running : Bool;
      fault : Bool;
      stroke : Int;
      total : DInt;
      mode : Byte;
      part : String[7];
      step : Time;
      shift : Date;
      curve : Array[1..4] of Int;
      ready : Bool;
      energy : LReal;
      flags : Word;
      n : USInt;
      s : SInt;
   END_STRUCT;
BEGIN
END_DATA_BLOCK
"""
ROUNDS: Final = 40
_ROLL: Final = random.Random(20)


def _time(milliseconds: int) -> str:
    """Return a time the way this program writes it."""
    text = ""
    for unit, size in (("d", 86_400_000), ("h", 3_600_000), ("m", 60_000), ("s", 1000), ("ms", 1)):
        number, milliseconds = divmod(milliseconds, size)
        text += f"{number}{unit}" if number else ""
    return f"T#{text or '0ms'}"


def series(octets: bytearray) -> dict[str, object]:
    """Put random values into the block with the peer's own functions, and return them by name."""
    said: dict[str, object] = {}

    def put(name: str, setter: Callable[..., object], at: int, given: Any, told: object = None) -> None:
        setter(octets, at, given)
        said[f"Press.{name}"] = given if told is None else told

    put("force", util.set_real, 0, _ROLL.randrange(-8000, 8000) / 8)
    put("setpoint", util.set_real, 4, _ROLL.randrange(0, 4000) / 4)
    for bit, name in enumerate(("running", "fault")):
        value = _ROLL.random() < 0.5
        util.set_bool(octets, 8, bit, value)
        said[f"Press.{name}"] = value
    put("stroke", util.set_int, 10, _ROLL.randrange(-32768, 32768))
    put("total", util.set_dint, 12, _ROLL.randrange(-(1 << 31), 1 << 31))
    put("mode", util.set_byte, 16, _ROLL.randrange(256))
    text = "".join(_ROLL.choices("ABCxyz 012", k=_ROLL.randrange(8)))
    util.set_string(octets, 18, text, 7)
    said["Press.part"] = text
    milliseconds = _ROLL.randrange(1, 1 << 31)
    octets[28:32] = milliseconds.to_bytes(4, "big")
    said["Press.step"] = _time(milliseconds)
    day = date(1990, 1, 1) + timedelta(days=_ROLL.randrange(60000))
    put("shift", util.set_date, 32, day, f"D#{day.isoformat()}")
    curve = [_ROLL.randrange(-32768, 32768) for _ in range(4)]
    for number, step in enumerate(curve):
        util.set_int(octets, 34 + 2 * number, step)
    said["Press.curve"] = curve
    ready: bool = _ROLL.random() < 0.5
    util.set_bool(octets, 42, 0, ready)
    said["Press.ready"] = ready
    put("energy", util.set_lreal, 44, _ROLL.uniform(-1e9, 1e9))
    put("flags", util.set_word, 52, _ROLL.randrange(65536))
    put("n", util.set_usint, 54, _ROLL.randrange(256))
    put("s", util.set_sint, 55, _ROLL.randrange(-128, 128))
    return said


def test_the_values_by_tags_are_those_that_the_peer_wrote_and_read(tmp_path: Path) -> None:
    source = tmp_path / "press.db"
    source.write_text(SOURCE, encoding="utf-8-sig")
    path = tmp_path / "press.pcapng"
    written: list[dict[str, object]] = []
    with plc() as server, dissected(server.port, path) as (_, session, port):
        with client(port) as panel:
            for _ in range(ROUNDS):
                octets = bytearray(56)
                written.append(series(octets))
                panel.db_write(1, 0, octets)
                assert panel.db_read(1, 0, 56) == octets
                begin = _ROLL.randrange(1, 56)  # never all of it
                panel.db_read(1, begin, _ROLL.randrange(1, 57 - begin))
        taken(session, lambda events: any([event.kind == CLOSED for event in events]))
    tags = load_tags([source], numbers={"Press": 1})
    assert tags.sizes == {1: 56}
    writes: list[list[NamedValue]] = []
    whole: list[list[NamedValue]] = []
    parts: list[list[NamedValue]] = []
    for event in dissect.open(path, tags=tags, pdus=False):
        if isinstance(event, Transaction) and event.function in {READ_VAR, WRITE_VAR}:
            values = [value for _, value in named_values(event)]
            full = len(event.s7_results[0].data or b"") == 56
            (writes if event.function == WRITE_VAR else whole if full else parts).append(values)
    assert [by_name(values) for values in writes] == written
    assert [by_name(values) for values in whole] == written
    # Random pieces of the block: whatever they hold whole has the value of that round.
    checked = 0
    for said, values in zip(written, parts, strict=True):
        for value in values:
            if value.whole and value.name in said:
                assert value.value == said[value.name], value
                checked += 1
    assert checked > ROUNDS


def by_name(values: list[NamedValue]) -> dict[str, object]:
    assert all([value.whole and value.remark == "" for value in values])
    return {value.name: value.value for value in values}
