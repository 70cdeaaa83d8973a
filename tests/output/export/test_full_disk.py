"""A database on a disk that becomes full: said so, with exit code 5, and nothing half-written."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.support import simple
from tests.online.live.small_disk import on_a_small_disk

SCRIPT = """
import subprocess
ran = subprocess.run([sys.executable, "-m", "dissect", "export", PATH, "-o", f"sqlite:{FOLDER}/out.sqlite"],
    capture_output=True, text=True)
print(json.dumps([ran.returncode, ran.stderr, [path.name for path in FOLDER.iterdir()]]))
"""


@pytest.mark.parametrize("kib", [4, 60, 120, 300])
def test_sqlite(kib: int, tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng", 3000)
    (tmp_path / "disk").mkdir()
    code, said, left = on_a_small_disk(tmp_path / "disk", kib, f"PATH = {str(path)!r}\n{SCRIPT}")
    assert (code, left) == (5, [])
    assert said.endswith("out.sqlite: No space left on device\n")
    assert "Traceback" not in said
