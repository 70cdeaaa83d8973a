"""The captures of the project, each read once for all tests of this room."""

from __future__ import annotations

import pytest

from tests.recount.gathering import CAPTURES, Recounted, captures_in, recounted


@pytest.fixture(scope="session")
def project() -> list[Recounted]:
    """The statements about every capture of the project, recounted."""
    return [recounted(path) for path in captures_in(CAPTURES)]
