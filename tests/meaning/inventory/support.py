"""Inventories of made conversations."""

from __future__ import annotations

from collections.abc import Callable

from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.naming import Naming
from dissect.meaning.inventory.collector import Inventory
from dissect.packets.source.packet import SourceFile
from tests.engine.transactions.talk import Talk


def inventory_of(*scenes: Callable[[Talk], None], naming: Naming | None = None) -> Inventory:
    """Return the inventory of scenes, each on a connection of its own, one behind the other in one capture."""
    inventory = Inventory()
    pipeline = Pipeline(inventory, Options(strict=True, naming=naming))
    first = Talk()
    first.pipeline = pipeline
    for number, scene in enumerate(scenes):
        talk = first if not number else Talk(50000 + number, beside=first)
        scene(talk)
    pipeline.finish()
    inventory.take(pipeline, [SourceFile("made.pcapng", 1)])
    return inventory
