"""What the tests of the promises share."""

from __future__ import annotations

from tests.promises.nursery import nursery

__all__ = ["nursery"]
