"""Results as bytes, and back: what one process found, for another one that puts it together with what others found.

pickle knows nothing of compiled classes: they have no ``__dict__``, and cannot be made without what their constructor takes. So
an object of ours is sent as its class, the arguments of its constructor, and all its attributes by name. What belongs to a run
that goes on, and what nobody may know (session keys), is not sent.

Numbers count from 1 in each process. `receive` makes them those of the whole: an attribute whose name ends in ``frame`` is a
packet, ``frames`` are several, ``number`` counts connections or transactions.
"""

from __future__ import annotations

import inspect
import io
import pickle
import re
from collections.abc import Callable
from functools import cache
from typing import Any, Final, NamedTuple

from dissect.findings.catalogue import CATALOGUE, Rule
from dissect.findings.reporter import Finding
from dissect.s7.parameters import UserdataHead
from dissect.tcp.stream import Endpoint, TcpConnection
from dissect.transactions.connection import Connection
from dissect.transactions.ending import Ending
from dissect.transactions.transaction import Transaction

_OURS: Final = "dissect."

#: Of a connection in the words of a finding (`dissect.findings.plus_sessions`).
_NAMED: Final = re.compile(r"(?<=\bwhich connection )\d+(?= got)")

#: Attributes that are not sent, by class: they are what a new object has.
_LEFT_OUT: Final[dict[str, frozenset[str]]] = {
    "Connection": frozenset(("begun", "naming", "open_requests", "operations", "subscriptions", "traits")),
    "Analysis": frozenset(("pipeline",)),
    "HalfStream": frozenset(("held", "outside", "ready")),
    "TlsSession": frozenset(("_all", "_keys", "_secrets", "_suite", "_waiting")),
    "Direction": frozenset(("_keys", "messages")),
    "Transaction": frozenset(("earlier", "superseded")),
}


class Offsets(NamedTuple):
    """What is added to the numbers of packets, connections and transactions of a part: how many came before it."""

    packets: int = 0
    connections: int = 0
    transactions: int = 0


def send(found: object) -> bytes:
    """Return objects as bytes."""
    sent = io.BytesIO()
    _Sender(sent, pickle.HIGHEST_PROTOCOL).dump(found)
    return sent.getvalue()


def receive(sent: bytes, offsets: Offsets) -> Any:
    """Return the objects of `send`, with their numbers in the whole."""
    return _Receiver(io.BytesIO(sent), offsets).load()


class _Sender(pickle.Pickler):
    def persistent_id(self, obj: object) -> object:
        """Return the name of what every process has, None for the rest."""
        if isinstance(obj, Rule):
            return obj.slug
        return 0 if obj is _restore else None

    def reducer_override(self, obj: Any) -> Any:
        """Return how an object of ours is made again; what pickle knows by itself is left to it."""
        kind: Any = type(obj)
        if isinstance(obj, (type, tuple)) or not kind.__module__.startswith(_OURS):
            return NotImplemented
        left_out = _LEFT_OUT.get(kind.__name__, frozenset())
        state = {name: getattr(obj, name) for name in _attributes(kind) if name not in left_out and hasattr(obj, name)}
        state.update({name: value for name, value in getattr(obj, "__dict__", {}).items() if name not in left_out})
        return _made, (kind, _arguments(obj, state)), state, None, None, _restore


class _Receiver(pickle.Unpickler):
    def __init__(self, sent: io.BytesIO, offsets: Offsets) -> None:
        super().__init__(sent)
        self._offsets = offsets

    def persistent_load(self, pid: Any) -> Any:
        """Return what `_Sender.persistent_id` named."""
        return CATALOGUE[pid] if pid else self._restore

    def _restore(self, obj: Any, state: dict[str, Any]) -> None:
        for name, value in state.items():
            setattr(obj, name, self._moved(obj, name, value))

    def _moved(self, obj: Any, name: str, value: Any) -> Any:
        packets, connections, transactions = self._offsets
        if name.endswith("frame"):
            return value + packets if value > 0 else value
        if name == "frames":
            return [frame + packets for frame in value]
        if name == "number" and isinstance(obj, Connection):
            return value + connections
        if name == "number" and isinstance(obj, Transaction):
            return value + transactions
        if isinstance(obj, Finding):
            if name == "connection" and value:
                return value + connections
            if name == "detail":
                return _NAMED.sub(lambda match: str(int(match[0]) + connections), value)
        return value


def _restore(obj: Any, state: dict[str, Any]) -> None:
    """Stand for the method of the receiver that gives an object its attributes."""
    raise pickle.UnpicklingError(f"{type(obj).__name__} with {len(state)} attributes was not received by receive()")


def _made(kind: Any, arguments: tuple[Any, ...] | None) -> Any:
    """Return a new object that still needs its attributes."""
    if kind is Ending:
        return Ending(_nobody(), [0, 0], 0, 0)
    return kind.__new__(kind) if arguments is None else kind(*arguments)


@cache
def _attributes(kind: Any) -> tuple[str, ...]:
    """Return the names of the attributes that objects of a class may have, besides those in their ``__dict__``."""
    names: dict[str, None] = {}
    for each in kind.__mro__:
        declared = vars(each).get("__mypyc_attrs__") or vars(each).get("__slots__") or ()
        names.update(dict.fromkeys((declared,) if isinstance(declared, str) else declared))
    names.pop("__dict__", None)
    return tuple(names)


@cache
def _parameters(kind: Any) -> tuple[str, ...]:
    return tuple(
        [
            name
            for name, parameter in inspect.signature(kind).parameters.items()
            if parameter.default is inspect.Parameter.empty
        ]
    )


def _nobody() -> Connection:
    end = Endpoint(b"", 0)
    return Connection(0, TcpConnection(end, end, 0, 0, 0))


#: What constructors take that is no attribute of their object; an `Ending` looks at a connection that may not be there yet.
_TAKEN: Final[dict[type, Callable[[Any], tuple[Any, ...]]]] = {
    TcpConnection: lambda tcp: (*tcp.ends, tcp.vlan, tcp.first_frame, tcp.first_ns),
    UserdataHead: lambda head: (head.type, head.group, head.subfunction, head.sequence),
    Ending: lambda _: (),
}


def _arguments(obj: Any, state: dict[str, Any]) -> tuple[Any, ...] | None:
    """Return what the constructor of a class takes, None where that is not known; a compiled class cannot do without."""
    kind: Any = type(obj)
    taken = _TAKEN.get(kind)
    if taken is not None:
        return taken(obj)
    found = [state.get(name, state.get(f"_{name}", state)) for name in _parameters(kind)]
    return None if any([value is state for value in found]) else tuple(found)
