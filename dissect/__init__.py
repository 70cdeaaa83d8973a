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

#: Each public name and the module that defines it. The imports below say the same to a type checker.
_PUBLIC: Final = {
    "analyze": "dissect.session",
    "open": "dissect.session",
}

if TYPE_CHECKING:
    from dissect.session import analyze as analyze
    from dissect.session import open as open
else:

    def __getattr__(name: str) -> object:
        """Load a public name on its first use (PEP 562)."""
        home = _PUBLIC.get(name)
        if home is None:
            message = f"module {__name__!r} has no attribute {name!r}"
            raise AttributeError(message)
        value = getattr(importlib.import_module(home), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
