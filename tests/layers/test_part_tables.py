"""The table that the classes of parts are made from, and what other tools see of it."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Final

import dissect
import dissect.layers
from dissect.layers import S7_BlockInfo, S7_Clock, S7_Part, S7_StartOB1, part_classes
from dissect.layers.part_row import Row
from dissect.layers.part_tables import SECTIONS
from dissect.layers.parts import CLASSES
from tests.cases import each

ROWS: Final = [row for rows in SECTIONS.values() for row in rows]
ROOT: Final = Path(__file__).resolve().parent.parent.parent


@each("row", ROWS)
def test_a_row_is_a_class(row: Row) -> None:
    cls = getattr(dissect.layers, row.name)
    assert issubclass(cls, S7_Part)
    assert CLASSES[row.layout] is cls
    assert (cls.__doc__ or "").startswith(row.text)
    packet = cls()
    again = pickle.loads(pickle.dumps(packet))
    assert type(again) is type(copy.deepcopy(packet)) is cls
    assert bytes(again) == bytes(packet)
    for name, value in row.defaults.items():
        assert name in cls().default_fields or f"{name}_" in cls().default_fields, (name, value)


def test_each_name_stands_once() -> None:
    names = [row.name for row in ROWS]
    assert len(names) == len(set(names)) == len(part_classes.__all__)
    assert len({row.layout for row in ROWS}) == len(ROWS)


def test_a_class_says_what_it_fills_in() -> None:
    assert S7_BlockInfo.__doc__ == "The answer to block info. ``info_length`` is filled in when left out."
    assert (S7_Clock._name, S7_StartOB1._name) == ("S7 clock", "S7 start information of OB 1")
    assert S7_Clock.__module__ == "dissect.layers.part_classes"


def test_the_stub_names_the_classes() -> None:
    environment = {**os.environ, "PYTHONPATH": str(Path(dissect.__file__).parent.parent)}
    script = [sys.executable, str(ROOT / "scripts" / "layers_stub.py")]
    done = subprocess.run(script, capture_output=True, text=True, check=True, env=environment)
    stub = Path(dissect.layers.__file__).with_name("part_classes.pyi")
    assert done.stdout == stub.read_text(encoding="utf-8"), "python scripts/layers_stub.py > dissect/layers/part_classes.pyi"
    assert all(f"class {row.name}(S7_Part): ..." in done.stdout for row in ROWS)


def test_the_stub_of_the_package_has_its_names_for_a_star_import(tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(Path(dissect.__file__).parent.parent)}
    script = [sys.executable, str(ROOT / "scripts" / "layers_stub.py"), "package"]
    done = subprocess.run(script, capture_output=True, text=True, check=True, env=environment)
    stub = Path(dissect.layers.__file__).with_suffix(".pyi")
    assert done.stdout == stub.read_text(encoding="utf-8"), f"python scripts/layers_stub.py package > {stub}"
    user = tmp_path / "user.py"
    user.write_text(f"from dissect.layers import *\n\nprint({', '.join(dissect.layers.__all__)})\n")
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", os.devnull, str(user)]
    checked = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, env=environment)
    assert [line for line in checked.stdout.splitlines() if line.startswith("user.py")] == []


def test_counts_of_a_row_name_classes_that_there_are() -> None:
    for row in ROWS:
        for field, names in row.counted.items():
            assert field in row.defaults
            assert set(names) <= set(dissect.layers.__all__)
