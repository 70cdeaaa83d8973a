"""The pumping station of captures/scd: its dictionary, its messages, and carriers for it."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any, Final

from dissect import scd
from dissect.meaning.bindings import load_bindings
from dissect.meaning.bindings.binding import Bindings
from dissect.meaning.bindings.engine import ScdCarrier

FOLDER: Final = Path(__file__).resolve().parents[3] / "captures" / "scd"
#: Ports of the bindings: messages over UDP and TCP, the bare PDO T2 over UDP.
MESSAGES, STREAM, BARE = 5600, 5601, 5602


@cache
def dictionary() -> scd.Dictionary:
    return scd.compile(FOLDER / "plant.toml")


@cache
def codec() -> scd.Codec:
    return scd.Codec(dictionary())


@cache
def bindings() -> Bindings:
    return load_bindings(FOLDER / "plant.bind.toml", dictionary())


def carrier() -> ScdCarrier:
    """Return a carrier with the bindings of plant.bind.toml."""
    return ScdCarrier(dictionary(), bindings())


def message(service: Any, phase: Any, where: str = "", value: object = None, tid: int = 1, err: int = 0) -> bytes:
    """A message about a variable by name or address, with a value or without."""
    made = scd.Message(service=service, phase=phase, tid=tid, err=err)
    made.index, made.sub = _address(where)
    if value is not None:
        made.values = {(made.index, made.sub): value}  # type: ignore[dict-item]
    return codec().encode_message(made)


def _address(where: str) -> tuple[int, int]:
    if where.startswith("0x"):
        index, _, sub = where.partition(":")
        return int(index, 16), int(sub or "0")
    return dictionary().variable(where).address


def ask(where: str, value: object = None, tid: int = 1) -> bytes:
    """A read, or with a value a write."""
    return message("read" if value is None else "write", "request", where, value, tid)


def tell(where: str, value: object = None, tid: int = 1, err: int = 0) -> bytes:
    """The answer to a read, with its value, or to a write, without one."""
    return message("write" if value is None else "read", "response", where, value, tid, err)


def refuse(where: str, err: int, tid: int = 1, service: str = "read") -> bytes:
    return message(service, "abort", where, None, tid, err)


def pdo(name: str = "T1", counter: int = 0, err: int = 0, **values: object) -> bytes:
    """A PDO of the first pump, by default its state."""
    made = scd.Message(service="pdo", phase="push", pdo=name, tid=counter, err=err)
    mapped = codec().pdo(name).map
    made.values = {row.variable.address: values.get(row.variable.name, 0) for row in mapped}  # type: ignore[misc]
    return codec().encode_message(made)


def entry(where: str, bits: int, offset: int) -> int:
    """An entry of a mapping object."""
    index, sub = dictionary().variable(where).address
    return index | sub << 16 | offset << 32 | bits << 48
