"""Has Scapy's ``explore()`` list these layers: ``explore("s7dissect")``, or by choosing in its window.

Scapy looks only among modules called ``scapy.layers.…`` and ``scapy.contrib.…``, and its window does not open at all while a
layer of any other module is known. So this package goes by a second name there.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Final

import scapy.layers
from scapy.config import conf

from dissect.layers.fields import WireLayer

NAME: Final = "s7dissect"
_MODULE: Final = f"scapy.layers.{NAME}"


def show_in_scapy(package: ModuleType) -> None:
    """Enter ``package`` as a module of Scapy's layers, with the layers of its modules."""
    known = conf.layers.ldict
    own = [layer for key in list(known) if key.startswith(f"{package.__name__}.") for layer in known.pop(key)]
    known[_MODULE] = [layer for layer in own if layer is not WireLayer]
    sys.modules[_MODULE] = package
    setattr(scapy.layers, NAME, package)
