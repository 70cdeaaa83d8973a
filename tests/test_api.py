"""The public API as a user writes it: the names are there, and a type checker knows them."""

from __future__ import annotations

import ast
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

import dissect
from dissect import scd
from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.protocols.s7.items import DataItem
from dissect.testing.golden.reading import is_golden, load_golden, read_session
from dissect.testing.golden.writing import golden_text
from dissect.testing.playback.client import load_recorded
from dissect.testing.playback.server import load_recording

#: A program of a user, which mypy and pyright have to understand.
USER: Final = Path(__file__).parent / "typed" / "program.py"

REVEALED = [
    "int | None",
    "dict[str, object]",
    (
        "Connection | dissect.protocols.s7.message.Pdu | dissect.protocols.s7plus.message.PlusPdu"
        " | dissect.engine.transactions.payloads.ScdMessage | dissect.engine.transactions.transaction.Transaction"
        " | dissect.engine.transactions.operation.Operation | dissect.engine.acts.act.Act"
        " | dissect.engine.findings.reporter.Finding"
    ),
    "int | None",
    "list[dissect.engine.transactions.results.TransactionError]",
    "int | float | str | list[bool | int | float | str | None] | None",
    "dict[tuple[int, int] | str, ",
    '"str"',
    "NetTime",
    "list[dissect.engine.transactions.payloads.ScdMessage]",
    "bytes",
    "dissect.packets.tcp.stream.Endpoint",
    "list[tuple[str, str, str, object, str, str, bytes | None, fallback=dissect.engine.transactions.items.TransactionItem]]",
    "list[dissect.engine.transactions.connection.Connection | dissect.protocols.s7.message.Pdu",
]


def test_every_public_name_loads() -> None:
    for name in dissect._PUBLIC:
        value = getattr(dissect, name)
        assert callable(value), name
        assert value.__name__ == name


def test_a_users_program_passes_strict_type_checking(tmp_path: Path) -> None:
    program = shutil.copy(USER, tmp_path)
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", os.devnull, str(program)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout
    lines = [line for line in done.stdout.splitlines() if "Revealed type" in line]
    assert len(lines) == len(REVEALED)
    for line, expected in zip(lines, REVEALED, strict=True):
        assert expected in line


def test_a_users_program_passes_pyright(tmp_path: Path) -> None:
    environment = Path(sys.prefix) / "pyright"
    if not (environment / "node").exists():
        text = f"pyright is not installed: VENV={sys.prefix} scripts/install-pyright.sh does it"
        if os.environ.get("CI"):
            pytest.fail(text)
        pytest.skip(text)
    shutil.copy(USER, tmp_path)
    looked = {"venvPath": str(Path(sys.prefix).parent), "venv": Path(sys.prefix).name}
    tree = Path(dissect.__file__).parents[1]
    elsewhere = {} if tree.is_relative_to(sys.prefix) else {"extraPaths": [str(tree)]}
    settings = {"include": [USER.name], "typeCheckingMode": "strict", **looked, **elsewhere}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings), encoding="utf-8")
    command = [str(environment / "node"), str(environment / "node_modules/pyright/index.js"), "--outputjson"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
    said = json.loads(done.stdout)["generalDiagnostics"]
    assert [one["message"] for one in said if one["severity"] != "information"] == []
    assert len([one for one in said if one["severity"] == "information"]) == len(REVEALED)


# ---- what a person sees of it ---------------------------------------------------------------------------------------


class Elsewhere:
    """A path of another kind than pathlib's."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __fspath__(self) -> str:
        return str(self._path)


CAPTURES = Path(__file__).parents[1] / "captures"


def test_paths_of_any_kind_are_taken(tmp_path: Path) -> None:
    capture = CAPTURES / "item-errors.pcapng"
    plant, bind = CAPTURES / "scd" / "plant.toml", CAPTURES / "scd" / "plant.bind.toml"
    golden = tmp_path / "a.s7.txt"
    golden.write_text(golden_text(read_session(capture)), encoding="utf-8")
    for kind in (str, Path, Elsewhere):
        analysis = dissect.analyze(kind(capture), kind(capture))
        assert [file.name for file in analysis.files] == [str(capture)] * 2
        assert len(list(dissect.open(kind(capture), pdus=False))) > 5
        assert dissect.analyze(kind(plant.with_suffix(".pcapng")), scd=kind(plant), bind=kind(bind)).total > 5
        run = dissect.Run([kind(capture)], dissect.Observer())
        while run.step():
            pass
        assert run.files[0].name == str(capture)
        assert read_session(kind(capture)).name == str(capture)
        assert is_golden(kind(golden))
        assert load_golden(kind(golden)).transactions
        assert load_recording(kind(capture)).name
        assert load_recorded(kind(capture)).links
        assert len(scd.load(kind(plant)))
        out = kind(tmp_path / f"{kind.__name__}.pcapng")
        PcapngWriter(out).close()
        assert Path(out).stat().st_size


def test_representations_say_what_a_thing_is() -> None:
    found = {type(event).__name__: event for event in dissect.open(str(CAPTURES / "item-errors.pcapng"))}
    shown = {name: repr(event) for name, event in found.items()}
    assert re.fullmatch(r"Pdu\(Ack_Data, Write Var, ref \d+, packet \d+\)", shown["Pdu"])
    assert shown["Connection"] == "Connection(1, 127.0.0.1:45840 → 127.0.0.1:102, 16 PDUs)"
    pdu, transaction = found["Pdu"], found["Transaction"]
    connection, finding = found["Connection"], found["Finding"]
    assert isinstance(pdu, dissect.Pdu)
    assert isinstance(transaction, dissect.Transaction)
    assert isinstance(connection, dissect.Connection)
    assert isinstance(finding, dissect.Finding)
    told = [repr(item) for item in (*pdu.data_items(), *transaction.s7_results, *transaction.errors)]
    told += [repr(connection.client), repr(connection.tsap_called), repr(finding.rule)]
    told.append(repr(dissect.analyze(CAPTURES / "item-errors.pcapng")))
    assert [text for text in (*shown.values(), *told) if " object at 0x" in text] == []
    assert repr(transaction.connection.granted) == "Setup(1, 1, 480)"
    assert repr(DataItem(0xFF, 4, 16, b"\x04\xd2", 0)) == "DataItem(0xff, 2 bytes: 04 d2)"


def written(kind: type) -> str:
    """Return the docstring of a class as it stands in the source."""
    source = Path(dissect.__file__).parent.joinpath(*kind.__module__.split(".")[1:]).with_suffix(".py")
    (node,) = [
        one
        for one in ast.parse(source.read_text(encoding="utf-8")).body
        if isinstance(one, ast.ClassDef) and one.name == kind.__name__
    ]
    return ast.get_docstring(node) or ""


def test_every_public_name_says_what_it_is_compiled_or_not() -> None:
    for name in dissect._PUBLIC:
        value = getattr(dissect, name)
        assert value.__doc__, name
        if isinstance(value, type):
            assert inspect.cleandoc(value.__doc__).split("\n\nAttributes:\n")[0] == written(value), name
