"""Reads the objects of CreateObject and Explore: ids, classes, and the few attributes that are needed.

The check of a PDU notes the places of the relevant parts. Values are read when they are needed. PDUs that are not sound are
left to `dissect.protocols.s7plus.bodies`. A property test ensures that both agree
(tests/protocols/s7plus/test_read_objects.py).
"""

from __future__ import annotations

from mypy_extensions import mypyc_attr

from dissect.protocols.s7plus.check import Check
from dissect.protocols.s7plus.contents import Made
from dissect.protocols.s7plus.objects import PlusObject, objects_at


@mypyc_attr(acyclic=True, free_list_len=1)
class Outline(Made):
    """Objects of a sound request or response, with only the attributes that are needed."""

    __slots__ = ("_every",)

    def __init__(self, ids: list[int], objects: list[PlusObject], every: list[PlusObject]) -> None:
        """``objects`` are those that are not inside another one; ``every`` are these and all objects inside them."""
        super().__init__(ids, objects)
        self._every = every

    @property
    def every(self) -> list[PlusObject]:
        """The objects and all objects inside them, each before those inside it."""
        return self._every


def read_objects(checked: Check) -> Outline:
    """Return the objects of a sound PDU whose objects are noted: CreateObject, and responses to Explore."""
    noted = checked.noted
    if noted:
        objects, every = objects_at(checked.data, noted, checked.end)
    else:
        objects = every = []
    found = Outline(checked.made, objects, every)
    found.object_id = int(checked.object_id)
    return found
