"""Settings become defaults of options; the command line counts more, and a mistake costs the run."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dissect.wire.config.finding import NAME
from tests.cli.support import run
from tests.meaning.tags.support import tank_capture, tank_file

Capture = pytest.CaptureFixture[bytes]


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a capture and tags, and a folder in it where the command runs; no settings of a user."""
    tank_capture(tmp_path)
    tank_file(tmp_path)
    (tmp_path / "captures").mkdir()
    monkeypatch.chdir(tmp_path / "captures")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "user"))
    return tmp_path


def test_tags_hosts_and_format_come_from_the_settings(capfdbinary: Capture, project: Path) -> None:
    (project / NAME).write_text('tags = ["tank.csv"]\n[hosts]\n"10.0.0.2" = "press\\u001b"\n', encoding="utf-8")
    ran = run(capfdbinary, "transactions", "../tank.pcapng")
    assert (ran.code, ran.err) == (0, "")
    assert "Tank.Pump (DB1.DBX4.0) = true" in ran.out
    assert "10.0.0.1:49152 → press\\x1b:102" in ran.out


def test_the_command_line_counts_more_than_project_and_user(capfdbinary: Capture, project: Path) -> None:
    (project / NAME).write_text('format = "csv"\n', encoding="utf-8")
    user = project / "user" / "s7dissect"
    user.mkdir(parents=True)
    (user / NAME).write_text('format = "text"\ntags = "../../tank.csv"\n', encoding="utf-8")
    ran = run(capfdbinary, "transactions", "../tank.pcapng")
    assert ran.out.startswith("number,connection,")
    assert "Tank.Level" in ran.out
    ran = run(capfdbinary, "transactions", "../tank.pcapng", "-T", "jsonl")
    assert json.loads(ran.out.splitlines()[1])["items"][0]["tags"][0]["name"] == "Tank.Level"
    ran = run(capfdbinary, "transactions", "../tank.pcapng", "--config", "none")
    assert "Tank.Level" not in ran.out


def test_a_file_named_with_config_stands_for_that_of_the_project(capfdbinary: Capture, project: Path) -> None:
    (project / NAME).write_text("nonsense = 1\n", encoding="utf-8")
    (project / "other.toml").write_text('format = "jsonl"\n', encoding="utf-8")
    ran = run(capfdbinary, "transactions", "../tank.pcapng", "--config", "../other.toml")
    assert (ran.code, ran.out[:10]) == (0, '{"schema":')


def test_a_mistake_in_the_settings_ends_the_run_before_anything_is_written(capfdbinary: Capture, project: Path) -> None:
    (project / NAME).write_text('fromat = "csv"\nslow = []\n', encoding="utf-8")
    ran = run(capfdbinary, "transactions", "../tank.pcapng")
    assert (ran.code, ran.out) == (2, "")
    assert f"{project / NAME}:1: fromat: unknown key; close to it: 'format'" in ran.err
    assert f"{project / NAME}:2: slow: expected milliseconds" in ran.err


def test_slow_is_a_threshold_where_it_is_one_and_chooses_nothing(capfdbinary: Capture, project: Path) -> None:
    (project / NAME).write_text("slow = 0.5\n", encoding="utf-8")
    ran = run(capfdbinary, "analyze", "../tank.pcapng", "-T", "json")
    assert "transaction.slow" in ran.out
    ran = run(capfdbinary, "transactions", "../tank.pcapng")
    assert len(ran.out.splitlines()) == 4


def test_a_format_that_a_command_does_not_have_leaves_it_as_it_is(capfdbinary: Capture, project: Path) -> None:
    (project / NAME).write_text('format = "csv"\n', encoding="utf-8")
    assert run(capfdbinary, "operations", "../tank.pcapng").out.startswith("20")


def test_tags_of_one_plc_are_not_those_of_another(capfdbinary: Capture, project: Path) -> None:
    ran = run(capfdbinary, "transactions", "../tank.pcapng", "--tags", "10.0.0.2=../tank.csv")
    assert "Tank.Level" in ran.out
    ran = run(capfdbinary, "transactions", "../tank.pcapng", "--tags", "10.0.0.9=../tank.csv")
    assert "Tank.Level" not in ran.out
