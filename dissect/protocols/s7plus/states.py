"""Reads the operating state of a CPU from a value."""

from __future__ import annotations

from dissect.protocols.s7plus.session import OPERATING_STATE
from dissect.protocols.s7plus.values import Struct, Value


def state_in(value: Value) -> int:
    """Return the operating state in ``value``, either the state or the structure that has it as a member; -1 for none."""
    content = value.content
    member = content.find(OPERATING_STATE) if isinstance(content, Struct) else value
    return number_in(member) if member is not None else -1


def number_in(value: Value) -> int:
    """Return the number in a value, -1 if it is not a whole number."""
    content = value.content
    return content if isinstance(content, int) and not isinstance(content, bool) else -1
