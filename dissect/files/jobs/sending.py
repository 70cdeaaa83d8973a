"""Converts results to plain values and back, to send them from one process to another that adds them up.

Objects of compiled classes cannot be pickled: they have no ``__dict__``, and their constructors need arguments. So an object is
sent as its class, the arguments of its constructor, and all its attributes by name. State that is only needed while a run goes
on, and secrets (session keys), are not sent. Only classes of this package are made from received values.

Numbers count from 1 in each process. `receive` converts them to those of the whole run: attributes whose names end in ``frame``
are packets, ``frames`` are several packets, ``number`` counts connections or transactions.
"""

from __future__ import annotations

import importlib
import inspect
import re
from collections import OrderedDict, deque
from collections.abc import Callable
from functools import cache
from itertools import repeat
from operator import attrgetter
from typing import Any, Final, NamedTuple

from librt.strings import BytesWriter
from librt.vecs import vec
from mypy_extensions import i64

from dissect.engine.findings.catalogue import CATALOGUE, Rule
from dissect.engine.findings.reporter import Finding
from dissect.engine.stations.facts import Fact, Stretch
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.ending import Ending
from dissect.engine.transactions.transaction import Transaction
from dissect.files.jobs.numbers import Offsets
from dissect.meaning.report.kept import Findings
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.s7.parameters import UserdataHead

_OURS: Final = "dissect."


def _writer(octets: bytes) -> BytesWriter:
    """Return a `BytesWriter` with these octets, to which more can be written."""
    writer = BytesWriter()
    writer.write(octets)
    return writer


#: Types of values that are sent unchanged, and types that are sent as a list of their elements.
_PLAIN: Final = frozenset((type(None), bool, int, float, str, bytes))
_KINDS: Final[tuple[type, ...]] = (list, tuple, set, frozenset, deque, dict, OrderedDict, vec[i64])
_HOLDERS: Final[dict[str, Callable[[Any], Any]]] = {
    **{kind.__name__: kind for kind in _KINDS},
    BytesWriter.__name__: _writer,
}
#: Marks for an object (by its index in `Sent.objects`), for a named tuple of ours, and for a rule (by its slug).
_OBJECT: Final = "object"
_TUPLE: Final = "named"
_RULE: Final = "rule"

#: The number of a connection in the detail of a finding (`dissect.engine.findings.plus_sessions`).
_NAMED: Final = re.compile(r"(?<=\bwhich connection )\d+(?= got)")

#: Attributes that are not sent, by class; they keep the values of a new object.
_LEFT_OUT: Final[dict[str, frozenset[str]]] = {
    "Connection": frozenset(("_begun", "_operations", "_subscriptions", "_traits", "naming", "open_requests")),
    "Analysis": frozenset(("_explained", "_findings", "_first_findings", "_shared", "pipeline")),
    "CarvedBlock": frozenset(("activation", "operation")),
    "Inventory": frozenset(("_open", "files", "pipeline")),
    "HalfStream": frozenset(("held", "outside", "ready")),
    "Ledger": frozenset(("_met", "_of")),
    "Occurrences": frozenset(("_forgotten", "_known", "_latest")),
    "Parameters": frozenset(("good_answer", "good_heads", "good_layout")),
    "TlsSession": frozenset(("_all", "_keys", "_secrets", "_suite", "_waiting")),
    "Direction": frozenset(("_keys", "messages")),
    "Transaction": frozenset(("_known_body", "_request_seq")),
}


class Sent(NamedTuple):
    """Objects as plain values: ``value``, and for each of our objects in it its class and the arguments of its constructor.

    ``classes`` are the (module, name) of the classes; an object has the index of its class there. A column has the values of
    one attribute of objects of one class: their indexes in ``objects``, the name of the attribute, and the values.
    """

    value: Any
    classes: list[tuple[str, str]]
    objects: list[tuple[int, list[Any] | None]]
    columns: list[tuple[list[int], str, list[Any]]]


def send(value: object) -> Sent:
    """Return objects as plain values. Raises TypeError for an object that cannot be sent."""
    sender = _Sender()
    plain = sender.plain(value)
    sender.finish()
    return Sent(plain, list(sender.classes), sender.objects, sender.columns)


class _Sender:
    def __init__(self) -> None:
        self.classes: dict[tuple[str, str], int] = {}
        self.objects: list[tuple[int, list[Any] | None]] = []
        self.columns: list[tuple[list[int], str, list[Any]]] = []
        self._places: dict[int, int] = {}
        self._kept: list[Any] = []  # keeps objects alive, so that their ids are not reused
        self._new: dict[Any, list[Any]] = {}  # by class: objects whose attributes are not converted yet

    def plain(self, value: Any) -> Any:
        """Return a value in the form in which it is sent."""
        kind: Any = type(value)
        if kind in _PLAIN:
            return value
        place = self._places.get(id(value))
        if place is not None:
            return _OBJECT, place
        name = kind.__name__
        if kind in _KINDS:
            return name, self._all_plain(list(value.items()) if kind is dict or kind is OrderedDict else list(value))
        if kind is Findings:
            return list.__name__, self._all_plain(list(value))
        if kind is BytesWriter:
            return name, value.getvalue()
        if isinstance(value, Rule):
            return _RULE, value.slug
        if not kind.__module__.startswith(_OURS):
            raise TypeError(f"{kind.__module__}.{name} cannot be sent")
        if isinstance(value, tuple):
            return _TUPLE, kind.__module__, name, self._all_plain(list(value))
        return _OBJECT, self._object(value)

    def finish(self) -> None:
        """Add the attributes of all objects, and of the objects in those attributes."""
        while self._new:
            new, self._new = self._new, {}
            for objects in new.values():
                self._add_columns(objects)

    def _all_plain(self, values: list[Any]) -> list[Any]:
        if _PLAIN.issuperset(map(type, values)):
            return values
        plain = self.plain
        return [each if type(each) in _PLAIN else plain(each) for each in values]

    def _object(self, obj: Any) -> int:
        kind: Any = type(obj)
        arguments = _arguments(obj)
        taken = None if arguments is None else self._all_plain(list(arguments))
        place = self._places[id(obj)] = len(self.objects)
        known = self.classes.setdefault((kind.__module__, kind.__name__), len(self.classes))
        self.objects.append((known, taken))
        self._kept.append(obj)
        self._new.setdefault(kind, []).append(obj)
        return place

    def _add_columns(self, objects: list[Any]) -> None:
        """Add the attributes of objects of one class."""
        places = [self._places[id(obj)] for obj in objects]
        kind: Any = type(objects[0])
        for name in _sent(kind):
            try:
                values = list(map(attrgetter(name), objects))
            except AttributeError:  # not all objects have this attribute
                self._add_some(name, objects)
            else:
                self.columns.append((places, name, self._all_plain(values)))
        if hasattr(objects[0], "__dict__"):
            left_out = _left_out(kind)
            for name in dict.fromkeys([name for obj in objects for name in obj.__dict__ if name not in left_out]):
                self._add_some(name, objects)

    def _add_some(self, name: str, objects: list[Any]) -> None:
        having = [obj for obj in objects if hasattr(obj, name)]
        if having:
            values = self._all_plain([getattr(obj, name) for obj in having])
            self.columns.append(([self._places[id(obj)] for obj in having], name, values))


def receive(sent: Sent, offsets: Offsets) -> Any:
    """Return the objects that `send` converted, with their numbers in the whole run.

    Raises ValueError for classes from elsewhere.
    """
    objects: list[Any] = []
    kinds = [_ours(module, name) for module, name in sent.classes]
    for kind, arguments in sent.objects:
        objects.append(_made(kinds[kind], None if arguments is None else _values(arguments, objects)))
    for places, name, values in sent.columns:
        which = [objects[place] for place in places]
        whole = _values(values, objects)
        if _moves(name):
            whole = _moved(type(which[0]), name, whole, offsets)
        for _ in map(setattr, which, repeat(name), whole):
            pass
    return _value(sent.value, objects)


@cache
def _ours(module: str, name: str) -> Any:
    kind = getattr(importlib.import_module(module), name) if module.startswith(_OURS) else None
    if not isinstance(kind, type) or kind.__module__ != module:
        raise ValueError(f"{module}.{name} is not a class of this package")
    return kind


def _values(plain: list[Any], objects: list[Any]) -> list[Any]:
    if tuple not in map(type, plain):
        return plain
    return [_value(each, objects) if type(each) is tuple else each for each in plain]


def _value(plain: Any, objects: list[Any]) -> Any:
    if not isinstance(plain, tuple):
        return plain
    kind, content = plain[0], plain[-1]
    if kind == _OBJECT:
        return objects[content]
    if kind == _RULE:
        return CATALOGUE[content]
    inner = _values(content, objects)
    return _ours(plain[1], plain[2])(*inner) if kind == _TUPLE else _HOLDERS[kind](inner)


@cache
def _moves(name: str) -> bool:
    """Return whether an attribute of this name may contain a number that counts over all files."""
    return name.endswith("frame") or name in {"_frames", "frames", "number", "connection", "detail"}


def _moved(kind: type, name: str, values: list[Any], offsets: Offsets) -> list[Any]:
    """Return the values of an attribute with their numbers converted to those of the whole run."""
    packets, connections = offsets.packets, offsets.connections
    if name.endswith("frame"):
        return [value + packets if value > 0 else value for value in values]
    if name in {"_frames", "frames"}:
        return [value and [frame + packets for frame in value] for value in values]
    if name == "number" and issubclass(kind, Connection):
        return [value + connections for value in values]
    if name == "number" and issubclass(kind, Transaction):
        return [value + offsets.transactions for value in values]
    if name == "connection" and issubclass(kind, (Fact, Finding)):
        return [value and value + connections for value in values]
    if name == "detail" and issubclass(kind, Finding):
        return [_NAMED.sub(lambda match: str(int(match[0]) + connections), value) for value in values]
    return values


_NOWHERE: Final = Endpoint(b"", 0)
_SOME_RULE: Final = next(iter(CATALOGUE.values()))
#: Fast constructor calls for frequent classes; all attributes are set again afterwards. `Ending` is here because its
#: constructor reads a connection, which may not be complete yet.
_BLANK: Final[dict[type, Callable[[], Any]]] = {
    Endpoint: lambda: Endpoint(b"", 0),
    TcpConnection: lambda: TcpConnection(_NOWHERE, _NOWHERE, 0, 0, 0),
    Stretch: lambda: Stretch("", "", 0, 0),
    Ending: lambda: Ending(_nobody(), [], 0, 0),
    Finding: lambda: Finding(_SOME_RULE, 0, [], 0, ""),
}


def _nobody() -> Connection:
    return Connection(0, TcpConnection(_NOWHERE, _NOWHERE, 0, 0, 0))


def _made(kind: Any, arguments: list[Any] | None) -> Any:
    """Return a new object whose attributes are not set yet."""
    blank = _BLANK.get(kind)
    if blank is not None:
        return blank()
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


def _left_out(kind: Any) -> frozenset[str]:
    return _LEFT_OUT.get(kind.__name__, frozenset())


@cache
def _sent(kind: Any) -> tuple[str, ...]:
    return tuple([name for name in _attributes(kind) if name not in _left_out(kind)])


@cache
def _parameters(kind: Any) -> tuple[str, ...]:
    return tuple(
        [
            name
            for name, parameter in inspect.signature(kind).parameters.items()
            if parameter.default is inspect.Parameter.empty
        ]
    )


#: The arguments of constructors that are not simply attributes of the object.
_TAKEN: Final[dict[type, Callable[[Any], tuple[Any, ...]]]] = {
    UserdataHead: lambda head: (head.type, head.group, head.subfunction, head.sequence),
}


def _arguments(obj: Any) -> tuple[Any, ...] | None:
    """Return the arguments for the constructor of an object; None if none are needed (`_BLANK`) or known.

    Compiled classes cannot be made without these arguments.
    """
    kind: Any = type(obj)
    if kind in _BLANK:
        return None
    taken = _TAKEN.get(kind)
    if taken is not None:
        return taken(obj)
    names = _taken_names(kind, tuple(getattr(obj, "__dict__", ())))
    if names is None or not all([hasattr(obj, name) for name in names]):
        return None
    return tuple([getattr(obj, name) for name in names])


@cache
def _taken_names(kind: Any, own: tuple[str, ...]) -> tuple[str, ...] | None:
    """Return the names of the attributes that a constructor takes, None if one is missing; ``own`` are in ``__dict__``."""
    there = {*_sent(kind), *own} - _left_out(kind)
    names = [next((name for name in (each, f"_{each}") if name in there), "") for each in _parameters(kind)]
    return tuple(names) if all(names) else None
