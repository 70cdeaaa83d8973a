"""SCD, Синхроком-Дата (18-10-2015): typed data of layer 6, described by a dictionary that all participants share.

>>> from dissect import scd
>>> od = scd.load("plant.scd")  # doctest: +SKIP
>>> scd.Codec(od).decode("T1", payload)  # doctest: +SKIP

The names are loaded when they are first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Final

#: The public names; for each the module that defines it, and its name there.
_PUBLIC: Final = {
    "Codec": ("dissect.scd.codec", "Codec"),
    "Dictionary": ("dissect.scd.dictionary", "Dictionary"),
    "DictionaryError": ("dissect.scd.errors", "DictionaryError"),
    "Error": ("dissect.scd.errors", "Error"),
    "Imported": ("dissect.scd.foreign", "Imported"),
    "Interval": ("dissect.scd.values", "Interval"),
    "MAC": ("dissect.scd.values", "MAC"),
    "Message": ("dissect.scd.messages", "Message"),
    "NetTime": ("dissect.scd.values", "NetTime"),
    "compile": ("dissect.scd.loading", "compile_source"),
    "decode": ("dissect.scd.service", "decode"),
    "encode": ("dissect.scd.service", "encode"),
    "import_file": ("dissect.scd.loading", "import_file"),
    "init": ("dissect.scd.service", "init"),
    "load": ("dissect.scd.loading", "load"),
}

if TYPE_CHECKING:
    from dissect.scd.codec import Codec as Codec
    from dissect.scd.dictionary import Dictionary as Dictionary
    from dissect.scd.errors import DictionaryError as DictionaryError
    from dissect.scd.errors import Error as Error
    from dissect.scd.foreign import Imported as Imported
    from dissect.scd.loading import compile_source as compile_source
    from dissect.scd.loading import import_file as import_file
    from dissect.scd.loading import load as load
    from dissect.scd.messages import Message as Message
    from dissect.scd.service import decode as decode
    from dissect.scd.service import encode as encode
    from dissect.scd.service import init as init
    from dissect.scd.values import MAC as MAC
    from dissect.scd.values import Interval as Interval
    from dissect.scd.values import NetTime as NetTime

    compile = compile_source  # noqa: A001 - the verb a dictionary is made with, as re.compile is
else:

    def __getattr__(name: str) -> object:
        """Load a public name on its first use (PEP 562)."""
        home = _PUBLIC.get(name)
        if home is None:
            message = f"module {__name__!r} has no attribute {name!r}"
            raise AttributeError(message)
        value = getattr(importlib.import_module(home[0]), home[1])
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        """Return the public names, besides those that are loaded."""
        return sorted({*globals(), *_PUBLIC})
