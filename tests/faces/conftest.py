"""The captures of the project, each read once for all tests of this room."""

from __future__ import annotations

import pytest

from tests.faces.gathering import Gathered, captures_in, gather
from tests.faces.made import made
from tests.faces.reading import CAPTURES


@pytest.fixture(scope="session")
def project(tmp_path_factory: pytest.TempPathFactory) -> Gathered:
    """What all faces show for every capture of the project, and for a synthetic one."""
    folder = tmp_path_factory.mktemp("project")
    return gather([*captures_in(CAPTURES), made(tmp_path_factory.mktemp("made"))], folder)
