"""Shared by the tests of the promises."""

from __future__ import annotations

from tests.promises.nursery import nursery

__all__ = ["nursery"]
