"""s7dissect: from a capture to paired, timed and explained Siemens S7 transactions.

The public names are found here and loaded when they are first used, so that importing `dissect` costs next to nothing.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import TYPE_CHECKING, Final

# Another project keeps a namespace of the same name (`dissect.util` and many more). Both must be importable whichever was
# installed first and wherever on the path each stands.
__path__ = pkgutil.extend_path(__path__, __name__)

__version__: Final = "0.1.0"

#: What ``from dissect import *`` brings, `open` among it, as that of gzip and os does. Type checkers read this list.
__all__ = [
    "Act",
    "Analysis",
    "CaptureError",
    "CarvedBlock",
    "Connection",
    "Device",
    "Error",
    "Finding",
    "KeyLogError",
    "Observer",
    "Operation",
    "Options",
    "Pdu",
    "Pipeline",
    "PlusPdu",
    "Run",
    "ScdMessage",
    "SelectError",
    "TagError",
    "Transaction",
    "TransactionError",
    "TransactionItem",
    "ValueRow",
    "Where",
    "analyze",
    "blocks",
    "devices",
    "frames",
    "live",
    "open",
    "stream",
    "value_tables",
    "values",
]

#: Each public name and the module that defines it. The imports below say the same to a type checker.
_PUBLIC: Final = {
    "Act": "dissect.engine.acts.act",
    "CaptureError": "dissect.wire.errors",
    "Connection": "dissect.engine.transactions.connection",
    "Device": "dissect.meaning.inventory.model",
    "Error": "dissect.wire.errors",
    "KeyLogError": "dissect.files.session",
    "Finding": "dissect.engine.findings.reporter",
    "Observer": "dissect.engine.observer",
    "Operation": "dissect.engine.transactions.operation",
    "Options": "dissect.engine.pipeline",
    "Analysis": "dissect.meaning.report.analysis",
    "CarvedBlock": "dissect.engine.program.carved",
    "Pdu": "dissect.protocols.s7.message",
    "Pipeline": "dissect.engine.pipeline",
    "PlusPdu": "dissect.protocols.s7plus.message",
    "Run": "dissect.files.session",
    "SelectError": "dissect.meaning.select.errors",
    "ScdMessage": "dissect.engine.transactions.payloads",
    "TagError": "dissect.meaning.tags.loading",
    "Transaction": "dissect.engine.transactions.transaction",
    "TransactionItem": "dissect.engine.transactions.items",
    "TransactionError": "dissect.engine.transactions.results",
    "Where": "dissect.meaning.select.where",
    "ValueRow": "dissect.output.variables.model",
    "analyze": "dissect.files.session",
    "frames": "dissect.output.export.frames",
    "blocks": "dissect.output.carve.reading",
    "devices": "dissect.files.session",
    "live": "dissect.online.live.iterating",
    "open": "dissect.files.session",
    "stream": "dissect.online.proxy.stream",
    "value_tables": "dissect.output.variables.reading",
    "values": "dissect.output.variables.reading",
}

if TYPE_CHECKING:
    from dissect import scd as scd
    from dissect.engine.acts.act import Act as Act
    from dissect.engine.findings.reporter import Finding as Finding
    from dissect.engine.observer import Observer as Observer
    from dissect.engine.pipeline import Options as Options
    from dissect.engine.pipeline import Pipeline as Pipeline
    from dissect.engine.program.carved import CarvedBlock as CarvedBlock
    from dissect.engine.transactions.connection import Connection as Connection
    from dissect.engine.transactions.items import TransactionItem as TransactionItem
    from dissect.engine.transactions.operation import Operation as Operation
    from dissect.engine.transactions.payloads import ScdMessage as ScdMessage
    from dissect.engine.transactions.results import TransactionError as TransactionError
    from dissect.engine.transactions.transaction import Transaction as Transaction
    from dissect.files.session import KeyLogError as KeyLogError
    from dissect.files.session import Run as Run
    from dissect.files.session import analyze as analyze
    from dissect.files.session import devices as devices
    from dissect.files.session import open as open
    from dissect.meaning.inventory.model import Device as Device
    from dissect.meaning.report.analysis import Analysis as Analysis
    from dissect.meaning.select.errors import SelectError as SelectError
    from dissect.meaning.select.where import Where as Where
    from dissect.meaning.tags.loading import TagError as TagError
    from dissect.online.live.iterating import live as live
    from dissect.online.proxy.stream import stream as stream
    from dissect.output.carve.reading import blocks as blocks
    from dissect.output.export.frames import frames as frames
    from dissect.output.variables.model import ValueRow as ValueRow
    from dissect.output.variables.reading import value_tables as value_tables
    from dissect.output.variables.reading import values as values
    from dissect.protocols.s7.message import Pdu as Pdu
    from dissect.protocols.s7plus.message import PlusPdu as PlusPdu
    from dissect.wire.errors import CaptureError as CaptureError
    from dissect.wire.errors import Error as Error
else:

    def __getattr__(name: str) -> object:
        """Load a public name on its first use (PEP 562)."""
        if name == "scd":
            return importlib.import_module("dissect.scd")
        home = _PUBLIC.get(name)
        if home is None:
            message = f"module {__name__!r} has no attribute {name!r}"
            raise AttributeError(message)
        value = getattr(importlib.import_module(home), name)
        if isinstance(value, type):
            _document(value, name)
        globals()[name] = value
        return value


def _document(kind: type, name: str) -> None:
    """Add the attributes of a class to its text: Python gives them no docstrings."""
    from inspect import cleandoc

    from dissect.wire.attribute_tables import ATTRIBUTES

    members = ATTRIBUTES.get(name, {})
    if isinstance(vars(kind).get("__slots__"), tuple):  # interpreted: from here `help` takes the text of an attribute
        setattr(kind, "__slots__", {each: members.get(each) for each in vars(kind)["__slots__"]})  # noqa: B010
    text = kind.__doc__ or ""
    if members and "\nAttributes:\n" not in text:
        lines = [f"    {attribute}: {said}" for attribute, said in members.items()]
        text = "\n".join([cleandoc(text), "", "Attributes:", *lines])
    kind.__doc__ = text


def __dir__() -> list[str]:
    """Return the public names, for the Tab key; not what this module uses itself."""
    return sorted({*__all__, "scd", *[name for name in globals() if name.startswith("__")]})
