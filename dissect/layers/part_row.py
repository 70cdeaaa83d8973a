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
    """A class: its name, its layout, what it is in a sentence or two, and the values of a new packet.

    A default of None is a field that building fills in. ``counted`` names the classes whose parts a field counts;
    ``counting`` is what counts anything else behind the part, ``computed`` what follows from the part itself. ``replace`` puts
    other Scapy fields in the place of the layout's. ``title`` is what Scapy shows, where that is not the layout's name.
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
