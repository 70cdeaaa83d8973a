"""`s7dissect devices`: cards, formats, selections, names of the settings, gates."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.support import run
from tests.meaning.report.schemas import ROOT

Capture = pytest.CaptureFixture[bytes]
PLANT = ROOT / "captures" / "crafted" / "plus-plant.pcapng"
SZL = ROOT / "captures" / "szl.pcapng"


def test_text_json_and_csv_say_the_same(capfdbinary: Capture) -> None:
    text = run(capfdbinary, "devices", PLANT).out
    told = json.loads(run(capfdbinary, "devices", PLANT, "-T", "json").out)
    header, *rows = run(capfdbinary, "devices", PLANT, "-T", "csv").out.splitlines()
    assert [device["address"] for device in told["devices"]] == [row.split(",")[0] for row in rows]
    for device, row in zip(told["devices"], rows, strict=True):
        cells = dict(zip(header.split(","), row.split(","), strict=True))
        assert cells["role"] == device["role"]
        assert cells["order_number"] == (device["order_number"] or "")
        assert f"{device['address']}  {device['role']}" in text
    assert [(talk["client"], talk["server"], talk["transactions"]) for talk in told["talks"]] == [
        ("192.0.2.10", "192.0.2.20", 6),
        ("192.0.2.30", "192.0.2.20", 18),
    ]


def test_names_of_the_settings_are_shown(capfdbinary: Capture, tmp_path: Path) -> None:
    settings = tmp_path / "s7dissect.toml"
    settings.write_text('[hosts]\n"192.0.2.20" = "Press"\n', encoding="utf-8")
    lines = run(capfdbinary, "devices", PLANT, "--config", settings).out.splitlines()
    assert lines[0].startswith("Press (192.0.2.20)  CPU")
    assert lines[-3].split() == ["Press"]
    row = run(capfdbinary, "devices", PLANT, "--config", settings, "-T", "csv").out.splitlines()[1]
    assert row.startswith("192.0.2.20,Press,CPU")


def test_a_selection_says_what_it_is(capfdbinary: Capture) -> None:
    lines = run(capfdbinary, "devices", PLANT, "-Y", "client == 192.0.2.10").out.splitlines()
    assert lines[0] == "SELECTION: client == 192.0.2.10"
    assert not any("192.0.2.30" in line for line in lines)


def test_several_files_name_theirs(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "devices", SZL, PLANT)
    assert f"(packet {SZL}:13)" in ran.out
    assert f"(packet {PLANT}:7)" in ran.out


def test_a_change_between_two_captures_fails_the_command(capfdbinary: Capture, tmp_path: Path) -> None:
    """The same capture with another serial number, a month later."""
    octets = SZL.read_bytes()
    serial = b"S C-C2UR28922012"
    assert serial in octets
    later = tmp_path / "later.pcapng"
    later.write_bytes(octets.replace(serial, b"S C-X9ZZ00000001"))
    ran = run(capfdbinary, "devices", SZL, later, "--fail-on", "device.*")
    assert (ran.code, "device.serial_changed (1)" in ran.err) == (1, True)
    assert "serial number S C-C2UR28922012 → S C-X9ZZ00000001" in ran.out
    apart = run(capfdbinary, "devices", "--separate", SZL, later, "--fail-on", "device.*")
    assert (apart.code, apart.out) == (0, ran.out)
    assert run(capfdbinary, "devices", SZL, SZL, "--fail-on", "device.*").code == 0
