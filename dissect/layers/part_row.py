"""A row of the tables of parts (`dissect.layers.part_tables`): from each, `dissect.layers.part_classes` makes a class."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from scapy.packet import Packet

from dissect.layers.fields import ScapyField
from dissect.layers.part_counts import Counting
from dissect.wire.layout import Layout

#: Returns the number of a field that was left out, from the part's other fields.
Computing = Callable[[Packet], int]


class Row(NamedTuple):
    """A class: its name, its layout, its description in a sentence or two, and the values of a new packet.

    A default of None is a field that building fills in. ``counted`` names the classes whose parts a field counts; ``counting``
    computes counts of anything else after the part, ``computed`` values from the part itself. ``replace`` replaces fields of
    the layout by other Scapy fields. ``title`` is the name that Scapy shows, if it differs from the layout's.
    """

    name: str
    layout: Layout
    text: str
    defaults: Mapping[str, Any] = {}
    counted: Mapping[str, tuple[str, ...]] = {}
    counting: Counting | None = None
    title: str = ""
    computed: Mapping[str, Computing] = {}
    replace: Mapping[str, ScapyField] = {}
