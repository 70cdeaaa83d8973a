"""Copies and pickles of objects: `leaves` makes `copy`, `deepcopy` and `pickle` take the objects of a class, in both builds.

Objects of compiled classes have no ``__dict__`` and are only made by a constructor with arguments, so Python's own way fails.
Here an object is stored as its class, the arguments that make a new object of it, and its attributes by name. This form is the
same in the compiled and the interpreted build: each reads the pickles of the other. State that is only needed during a run is
not stored, and neither are session keys.
"""

from __future__ import annotations

import copyreg
import inspect
import sys
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from typing import Any, Final, TypeAlias

from librt.strings import BytesWriter
from librt.vecs import vec
from mypy_extensions import i64

#: What `copyreg` and ``__reduce__`` return: a function, its arguments, and the attributes, to be set one by one.
Reduced: TypeAlias = "tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]"
#: Gives the arguments for the constructor of a class from one of its objects.
Taken: TypeAlias = Callable[[Any], "tuple[Any, ...]"]

#: How many nested lists and dictionaries may contain an object within a constant (`leaves_by_name`).
_NESTED: Final = 2
_LEFT_OUT: Final[dict[type, frozenset[str]]] = {}
_TAKEN: Final[dict[type, Taken]] = {}


def leaves(*kinds: type, without: tuple[str, ...] = (), taken: Taken | None = None) -> None:
    """Let objects of these classes be copied and pickled, without the attributes ``without``: a copy has those of a new object.

    ``taken`` gives the arguments for the constructor, which by default are the attributes with the names of its parameters. For
    a class whose objects refer to themselves through such an argument ``taken`` gives empty arguments; the attributes are set
    afterwards.
    """
    for kind in kinds:
        _LEFT_OUT[kind] = frozenset(without)
        if taken is not None:
            _TAKEN[kind] = taken
        _settable(kind)
        copyreg.pickle(kind, _reduced)


def leaves_as(kind: type, take: Callable[[Any], tuple[Any, ...]]) -> None:
    """Let objects of a class be copied and pickled in the form that ``take`` returns: a function and its arguments."""
    copyreg.pickle(kind, take)


def leaves_by_name(kind: type, inner: str = "") -> None:
    """Let objects of a class, which are all in constants of modules, be copied and pickled as the very same object.

    They are in the constant itself, in lists and dictionaries there, or in the list ``inner`` of an object there.
    """

    def place(found: Any) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        known = _places(kind, inner, len(sys.modules)).get(id(found))
        if known is None or known[0] is not found:
            raise refuse(f"a {kind.__name__} of your own", "it stands in no constant of a module")
        return _at, known[1:]

    copyreg.pickle(kind, place)


def _at(module: str, name: str, *keys: Any) -> Any:
    """Return the object in a constant of a module."""
    found = getattr(import_module(module), name)
    for key in keys:
        found = found[key] if isinstance(found, (dict, list, tuple)) else getattr(found, key)
    return found


@cache
def _places(kind: type, inner: str, modules: int) -> dict[int, tuple[Any, ...]]:
    """Return the objects of a class by their identity: the object, its module, the name of the constant, and keys within.

    It searches the first ``modules`` modules; when more have been imported, there are more constants.
    """
    found: dict[int, tuple[Any, ...]] = {}
    for module in [name for name in list(sys.modules)[:modules] if name.startswith("dissect.")]:
        for name, value in list(vars(sys.modules[module]).items()):
            for keys, one in _within(value, inner, _NESTED):
                if isinstance(one, kind):
                    found.setdefault(id(one), (one, module, name, *keys))
    return found


def _within(value: Any, inner: str, depth: int) -> Iterator[tuple[tuple[int | str, ...], Any]]:
    yield (), value
    listed = getattr(value, inner, None) if inner and not isinstance(value, type) else None
    if isinstance(listed, list):
        yield from [((inner, number), one) for number, one in enumerate(listed)]
    if depth and isinstance(value, (dict, list, tuple)):
        for key, one in list(value.items()) if isinstance(value, dict) else enumerate(value):
            if isinstance(key, (int, str)):
                yield from [((key, *keys), found) for keys, found in _within(one, inner, depth - 1)]


def keep_out(kind: type, *names: str) -> None:
    """Leave these attributes out of the copies of a class from which users derive (`derived`), and of its subclasses."""
    _LEFT_OUT[kind] = frozenset(names)
    _settable(kind)


def derived(found: Any) -> Reduced:
    """Return an object of a class from which users derive, in the form that `copy` and `pickle` use.

    For its ``__reduce__``. As in Python, the copy is made without the constructor of the user's class.
    """
    return _blank, (type(found),), _state(found)


def made(kind: Any, *arguments: Any) -> Any:
    """Return a new object, whose attributes are set next."""
    return kind(*arguments)


def refuse(what: str, instead: str) -> TypeError:
    """Return the error for an object that cannot leave the process; ``instead`` says what can."""
    return TypeError(f"{what} cannot be copied or pickled: {instead}")


def _settable(kind: type) -> None:
    """Give a class the ``__setstate__`` that mypyc gives to compiled ones: without it, slots would need another form."""
    if not hasattr(kind, "__setstate__"):
        setattr(kind, "__setstate__", _set_state)  # noqa: B010 - a type checker knows no such attribute


def _set_state(found: Any, state: dict[str, Any]) -> None:
    for name, value in state.items():
        setattr(found, name, value)


def _reduced(found: Any) -> Reduced:
    kind: Any = type(found)
    taken = _TAKEN.get(kind)
    arguments = taken(found) if taken is not None else tuple([getattr(found, name) for name in _parameters(kind)])
    return made, (kind, *arguments), _state(found)


def _state(found: Any) -> dict[str, Any]:
    kind: Any = type(found)
    left_out = _left_out(kind)
    names = dict.fromkeys((*attributes(kind), *getattr(found, "__dict__", ())))
    return {name: getattr(found, name) for name in names if name not in left_out and hasattr(found, name)}


def _blank(kind: Any) -> Any:
    found = kind.__new__(kind)
    base = next(each for each in kind.__mro__ if each in _LEFT_OUT)
    base.__init__(found)
    return found


@cache
def attributes(kind: Any) -> tuple[str, ...]:
    """Return the names of the attributes that objects of a class may have, besides those in their ``__dict__``."""
    names: dict[str, None] = {}
    for each in kind.__mro__:
        declared = vars(each).get("__mypyc_attrs__") or vars(each).get("__slots__") or ()
        names.update(dict.fromkeys((declared,) if isinstance(declared, str) else declared))
    names.pop("__dict__", None)
    return tuple(names)


@cache
def _left_out(kind: Any) -> frozenset[str]:
    return frozenset().union(*[_LEFT_OUT.get(each, frozenset()) for each in kind.__mro__])


@cache
def _parameters(kind: Any) -> tuple[str, ...]:
    """Return the names of the attributes that a constructor takes: those of its parameters that have no default."""
    needed = [
        name
        for name, parameter in inspect.signature(kind).parameters.items()
        if parameter.default is inspect.Parameter.empty
    ]
    return tuple([_attribute(kind, name) for name in needed])


def _attribute(kind: Any, name: str) -> str:
    """Return the attribute that holds a parameter; its own name if a class has no slots that show it (interpreted)."""
    found = (each for each in (name, f"_{name}", name.removesuffix("_")) if hasattr(kind, each))
    return next((each for each in found if not inspect.isroutine(getattr(kind, each))), name)


def _writer(octets: bytes) -> BytesWriter:
    writer = BytesWriter()
    writer.write(octets)
    return writer


def _numbers(found: list[int]) -> Any:
    return vec[i64](found)


# The store of answer times (`dissect.meaning.report.latencies`).
copyreg.pickle(BytesWriter, lambda writer: (_writer, (writer.getvalue(),)))
copyreg.pickle(vec[i64], lambda numbers: (_numbers, (list(numbers),)))
