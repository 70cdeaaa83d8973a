"""Runs of pytest inside pytest."""

from __future__ import annotations

import pytest
import snap7  # noqa: F401 - as below

import dissect
from dissect.testing import golden_check, recorder, servers  # noqa: F401 - as below
from dissect.testing.golden import diff_sessions, golden_text, parse_golden, read_session
from tests.testing.projects import ROOT, Project


@pytest.fixture(scope="session", autouse=True)
def everything_is_imported() -> None:
    """Inner runs forget their imports, and compiled modules must not be loaded twice in one process."""
    path = str(ROOT / "captures" / "multi-items-python.pcapng")
    session = read_session(path)
    assert not diff_sessions(session, parse_golden(golden_text(session)))
    assert dissect.analyze(path).functions


@pytest.fixture
def project(pytester: pytest.Pytester) -> Project:
    return Project(pytester)
