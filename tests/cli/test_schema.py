from __future__ import annotations

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from dissect.cli.schema import FOLDER, bundled
from tests.cases import each
from tests.cli.support import run, simple
from tests.meaning.report.schemas import NAMES, load

Capture = pytest.CaptureFixture[bytes]


def test_the_list(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "schema")
    assert (ran.code, ran.err) == (0, "")
    assert [line.split("  ", 1)[0] for line in ran.out.splitlines()] == sorted(NAMES)
    assert all(load(line.split(" ", 1)[0])["title"] in line for line in ran.out.splitlines())


@each("name", NAMES)
def test_a_schema_needs_nothing_else(capfdbinary: Capture, name: str) -> None:
    ran = run(capfdbinary, "schema", name)
    assert (ran.code, ran.err, ran.out.isascii()) == (0, "", True)
    schema = json.loads(ran.out)
    assert schema == bundled(name)
    Draft202012Validator.check_schema(schema)
    present = {schema["$id"], *[part["$id"] for part in schema.get("$defs", {}).values() if "$id" in part]}
    referred = {word.partition("#")[0] for word in ran.out.split('"') if word.startswith("urn:s7dissect:schema:")}
    assert referred <= present
    assert run(capfdbinary, "schema", f"s7dissect.{name}/1").out == ran.out


@pytest.mark.parametrize("command", ["transactions", "show", "operations", "monitor"])
def test_what_is_written_is_valid_by_what_is_written(capfdbinary: Capture, tmp_path: Path, command: str) -> None:
    """As a program does it that has nothing but the two outputs."""
    lines = run(capfdbinary, command, simple(tmp_path / "a.pcapng"), "-T", "jsonl").out.splitlines()
    schemas = {
        name: json.loads(run(capfdbinary, "schema", name).out)
        for name in {json.loads(line)["schema"] for line in lines}
    }
    for line in lines:
        told = json.loads(line)
        validator = Draft202012Validator(schemas[told["schema"]])
        assert list(validator.iter_errors(told)) == []
        told["time" if "time" in told else "number"] = []
        assert list(validator.iter_errors(told)) != []


@pytest.mark.parametrize("name", ["nix", "", "../schema/alert", "s7dissect.alert/2", "alert/1"])
def test_no_such_schema(capfdbinary: Capture, name: str) -> None:
    ran = run(capfdbinary, "schema", name)
    assert (ran.code, ran.out) == (2, "")
    assert "no schema '" in ran.err
    assert "alert, analysis" in ran.err


def test_the_schemas_stand_in_the_package() -> None:
    assert FOLDER.parent.joinpath("__init__.py").is_file()
    assert {path.name.removesuffix(".schema.json") for path in FOLDER.iterdir()} == set(NAMES)
