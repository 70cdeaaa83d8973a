"""What the tests of the Scapy layers share."""

from __future__ import annotations

import pytest
from scapy.config import conf


@pytest.fixture(autouse=True)
def _loud(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every error of a dissector out: by default Scapy hides it and makes a Raw."""
    monkeypatch.setattr(conf, "debug_dissector", 2)
