"""Results as plain values, and back: what one process found, for another one that puts it together with what others found.

Objects of compiled classes cannot be handed to another process: they have no ``__dict__``, and cannot be made without what
their constructor takes. So an object of ours is sent as its class, the arguments of its constructor, and all its attributes by
name. What belongs to a run that goes on, and what nobody may know (session keys), is not sent. Only classes of this package are
made of what comes.

Numbers count from 1 in each process. `receive` makes them those of the whole: an attribute whose name ends in ``frame`` is a
packet, ``frames`` are several, ``number`` counts connections or transactions.
"""

from __future__ import annotations

import importlib
import inspect
import re
from array import array
from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, Final, NamedTuple

from dissect.findings.catalogue import CATALOGUE, Rule
from dissect.findings.reporter import Finding
from dissect.jobs.numbers import Offsets
from dissect.s7.parameters import UserdataHead
from dissect.stations.facts import Fact, Stretch
from dissect.tcp.stream import Endpoint, TcpConnection
from dissect.transactions.connection import Connection
from dissect.transactions.ending import Ending
from dissect.transactions.transaction import Transaction

_OURS: Final = "dissect."
#: What is sent as it is, and what as the list of what it holds.
_PLAIN: Final = frozenset((type(None), bool, int, float, str, bytes))
_KINDS: Final[tuple[type, ...]] = (list, tuple, set, frozenset, deque, dict, OrderedDict, array)
_HOLDERS: Final[dict[str, Callable[[list[Any]], Any]]] = {
    **{kind.__name__: kind for kind in _KINDS},
    array.__name__: lambda numbers: array("q", numbers),
}
#: Marks of an object by its place in `Sent.objects`, of a class of ours that is a tuple, and of a rule by its slug.
_OBJECT: Final = "object"
_TUPLE: Final = "named"
_RULE: Final = "rule"

#: Of a connection in the words of a finding (`dissect.findings.plus_sessions`).
_NAMED: Final = re.compile(r"(?<=\bwhich connection )\d+(?= got)")

#: Attributes that are not sent, by class: they are what a new object has.
_LEFT_OUT: Final[dict[str, frozenset[str]]] = {
    "Connection": frozenset(("_operations", "_subscriptions", "_traits", "begun", "naming", "open_requests")),
    "Analysis": frozenset(("_shared", "pipeline")),
    "CarvedBlock": frozenset(("activation", "operation")),
    "Inventory": frozenset(("_open", "files", "pipeline")),
    "HalfStream": frozenset(("held", "outside", "ready")),
    "TlsSession": frozenset(("_all", "_keys", "_secrets", "_suite", "_waiting")),
    "Direction": frozenset(("_keys", "messages")),
    "Transaction": frozenset(("earlier", "superseded")),
}


class Sent(NamedTuple):
    """Objects as plain values: ``found``, and for each object of ours in it its class, what that takes, and its state.

    ``classes`` are those of the objects, by module and name; an object has the place of its class there. A state is the names
    of attributes and a value for each.
    """

    found: Any
    classes: list[tuple[str, str]]
    objects: list[tuple[int, list[Any] | None]]
    states: list[tuple[tuple[str, ...], list[Any]]]


def send(found: object) -> Sent:
    """Return objects as plain values. TypeError for one that cannot be sent."""
    sender = _Sender()
    plain = sender.plain(found)
    sender.finish()
    return Sent(plain, list(sender.classes), sender.objects, sender.states)


class _Sender:
    def __init__(self) -> None:
        self.classes: dict[tuple[str, str], int] = {}
        self.objects: list[tuple[int, list[Any] | None]] = []
        self.states: list[tuple[tuple[str, ...], list[Any]]] = []
        self._places: dict[int, int] = {}
        self._kept: list[tuple[Any, tuple[str, ...], Sequence[Any]]] = []

    def plain(self, value: Any) -> Any:
        """Return a value as it is sent."""
        kind: Any = type(value)
        if kind in _PLAIN:
            return value
        name = kind.__name__
        if kind in _KINDS:
            inner = list(value.items()) if kind is dict or kind is OrderedDict else value
            plain = self.plain
            return name, [each if type(each) in _PLAIN else plain(each) for each in inner]
        if isinstance(value, Rule):
            return _RULE, value.slug
        if not kind.__module__.startswith(_OURS):
            raise TypeError(f"{kind.__module__}.{name} cannot be sent")
        if isinstance(value, tuple):
            return _TUPLE, kind.__module__, name, [self.plain(each) for each in value]
        return _OBJECT, self._object(value)

    def finish(self) -> None:
        """Add the states of all objects, and of those in them."""
        plain = self.plain
        for _, names, values in self._kept:  # grows meanwhile
            self.states.append((names, [value if type(value) in _PLAIN else plain(value) for value in values]))

    def _object(self, obj: Any) -> int:
        place = self._places.get(id(obj))
        if place is not None:
            return place
        kind: Any = type(obj)
        names, values = _state(obj)
        arguments = _arguments(obj, names, values)
        taken = None if arguments is None else [self.plain(each) for each in arguments]
        place = self._places[id(obj)] = len(self.objects)
        known = self.classes.setdefault((kind.__module__, kind.__name__), len(self.classes))
        self.objects.append((known, taken))
        self._kept.append((obj, names, values))
        return place


def _state(obj: Any) -> tuple[tuple[str, ...], Sequence[Any]]:
    """Return the names of the attributes of an object that are sent, and their values."""
    kind: Any = type(obj)
    names = _sent(kind)
    try:
        values: tuple[Any, ...] = tuple([getattr(obj, name) for name in names])
    except AttributeError:  # those that it has
        names = tuple([name for name in names if hasattr(obj, name)])
        values = tuple([getattr(obj, name) for name in names])
    own = getattr(obj, "__dict__", None)
    if not own:
        return names, values
    left_out = _LEFT_OUT.get(kind.__name__, frozenset())
    state = {**dict(zip(names, values, strict=True)), **{name: own[name] for name in own if name not in left_out}}
    return tuple(state), tuple(state.values())


def receive(sent: Sent, offsets: Offsets) -> Any:
    """Return the objects of `send`, with their numbers in the whole. ValueError for what is none of ours."""
    objects: list[Any] = []
    kinds = [_ours(module, name) for module, name in sent.classes]
    for kind, arguments in sent.objects:
        objects.append(_made(kinds[kind], None if arguments is None else [_value(each, objects) for each in arguments]))
    for obj, (names, values) in zip(objects, sent.states, strict=True):
        for name, value in zip(names, values, strict=True):
            whole = _value(value, objects) if type(value) is tuple else value
            setattr(obj, name, _moved(obj, name, whole, offsets) if _moves(name) else whole)
    return _value(sent.found, objects)


@cache
def _ours(module: str, name: str) -> Any:
    found = getattr(importlib.import_module(module), name) if module.startswith(_OURS) else None
    if not isinstance(found, type) or found.__module__ != module:
        raise ValueError(f"{module}.{name} is no class of this package")
    return found


def _value(plain: Any, objects: list[Any]) -> Any:
    if not isinstance(plain, tuple):
        return plain
    kind, content = plain[0], plain[-1]
    if kind == _OBJECT:
        return objects[content]
    if kind == _RULE:
        return CATALOGUE[content]
    inner = [_value(each, objects) if type(each) is tuple else each for each in content]
    return _ours(plain[1], plain[2])(*inner) if kind == _TUPLE else _HOLDERS[kind](inner)


@cache
def _moves(name: str) -> bool:
    """Return whether an attribute of this name may hold a number that counts over all files."""
    return name.endswith("frame") or name in {"_frames", "frames", "number", "connection", "detail"}


def _moved(obj: Any, name: str, value: Any, offsets: Offsets) -> Any:
    """Return an attribute with the numbers of the whole in it."""
    if name.endswith("frame"):
        return value + offsets.packets if value > 0 else value
    if name in {"_frames", "frames"}:
        return None if value is None else [frame + offsets.packets for frame in value]
    if name == "number" and isinstance(obj, Connection):
        return value + offsets.connections
    if name == "number" and isinstance(obj, Transaction):
        return value + offsets.transactions
    if name == "connection" and value and isinstance(obj, (Fact, Finding)):
        return value + offsets.connections
    if name == "detail" and isinstance(obj, Finding):
        return _NAMED.sub(lambda match: str(int(match[0]) + offsets.connections), value)
    return value


def _made(kind: Any, arguments: list[Any] | None) -> Any:
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
def _sent(kind: Any) -> tuple[str, ...]:
    left_out = _LEFT_OUT.get(kind.__name__, frozenset())
    return tuple([name for name in _attributes(kind) if name not in left_out])


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
    Stretch: lambda stretch: (stretch.value, stretch.source, stretch.first_frame, stretch.first_ns),
    Ending: lambda _: (),
    Finding: lambda finding: (finding.rule, finding.connection, finding.frames, finding.time_ns, finding.detail),
}


def _arguments(obj: Any, names: tuple[str, ...], values: Sequence[Any]) -> tuple[Any, ...] | None:
    """Return what the constructor of a class takes, None where that is not known; a compiled class cannot do without."""
    kind: Any = type(obj)
    taken = _TAKEN.get(kind)
    if taken is not None:
        return taken(obj)
    places = _places(kind, names)
    return None if places is None else tuple([values[place] for place in places])


@cache
def _places(kind: Any, names: tuple[str, ...]) -> tuple[int, ...] | None:
    """Return where in a state what the constructor of a class takes is, None where something is not there."""
    at = {name: place for place, name in enumerate(names)}
    found = [at.get(name, at.get(f"_{name}")) for name in _parameters(kind)]
    places = tuple([place for place in found if place is not None])
    return places if len(places) == len(found) else None
