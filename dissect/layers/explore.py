"""Makes these layers known to Scapy: ``explore("s7dissect")``, ``load_layer("s7")``, ``load_contrib("s7")``, ``conf.exts``.

Scapy only searches modules called ``scapy.layers.…`` and ``scapy.contrib.…``, and its window does not open at all if it knows a
layer of any other module. So the package has additional names there, those of an extension in ``conf.exts``. Importing
`dissect.layers` registers it; ``conf.exts.load("s7dissect")`` cannot, because Scapy only accepts packages under the GPL version
2 there.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any, Final

import scapy.layers
from scapy.config import ScapyExt, conf

from dissect import __version__
from dissect.layers.fields import WireLayer

#: Names of the package among Scapy's layers: the one its window shows, a short one, and its own.
NAME: Final = "s7dissect"
_NAMES: Final = (NAME, "s7", "dissect.layers")


def show_in_scapy(package: ModuleType) -> None:
    """Enter ``package`` as an extension of Scapy, with the layers of its modules."""
    known = conf.layers.ldict
    own = [layer for key in list(known) if key.startswith(f"{package.__name__}.") for layer in known.pop(key)]
    layers = [layer for layer in own if layer is not WireLayer]
    make: Any = ScapyExt  # which has no types
    extension = make()
    extension.config(NAME, __version__)
    for name in _NAMES:
        extension.register(name=name, mode=ScapyExt.MODE.LAYERS, path=package.__file__, default=False)
    for module in extension.specs:
        known[module] = layers
        sys.modules[module] = package  # the same classes by any name, and not a second copy of them
        # The window of explore() searches scapy.layers.NAME, and older versions of Scapy require each name to exist.
        first, _, rest = module.removeprefix("scapy.layers.").partition(".")
        setattr(scapy.layers, first, sys.modules[first] if rest else package)
    conf.exts.exts.append(extension)
    conf.exts.all_specs.update(extension.specs)
