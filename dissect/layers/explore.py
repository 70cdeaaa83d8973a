"""Makes these layers known to Scapy: ``explore("s7dissect")``, ``load_layer("s7")``, ``load_contrib("s7")``, ``conf.exts``.

Scapy looks only among modules called ``scapy.layers.…`` and ``scapy.contrib.…``, and its window does not open at all while a
layer of any other module is known. So the package goes by further names there, which are those of an extension in
``conf.exts``. Importing `dissect.layers` enters it; ``conf.exts.load("s7dissect")`` cannot, because Scapy takes nothing by
that way but what is under the GPL version 2.
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
        # The window of explore() looks at scapy.layers.NAME, and older versions of Scapy want each name to be there.
        first, _, rest = module.removeprefix("scapy.layers.").partition(".")
        setattr(scapy.layers, first, sys.modules[first] if rest else package)
    conf.exts.exts.append(extension)
    conf.exts.all_specs.update(extension.specs)
