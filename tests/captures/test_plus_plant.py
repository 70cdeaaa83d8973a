"""captures/crafted/plus-plant.pcapng seen by those that watch a plant: baseline and alerts, metrics, operations."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Final

from dissect.online.metrics.counters import SEPARATOR
from tests.conftest import Command
from tests.online.metrics.test_counters import counted

CAPTURE: Final = Path(__file__).resolve().parents[2] / "captures" / "crafted" / "plus-plant.pcapng"


def operations(s7dissect: Command, *kinds: str) -> list[tuple[str, str, str]]:
    chosen = [word for kind in kinds for word in ("--kind", kind)]
    lines = s7dissect("operations", "-T", "jsonl", *chosen, CAPTURE).stdout.splitlines()
    return [(one["kind"], one["subject"], one["result"]) for one in map(json.loads, lines)]


def test_the_four_questions_of_a_plant_engineer(s7dissect: Command) -> None:
    assert operations(s7dissect, "control") == [
        ("control", "operating state request 1 STOP", "done"),
        ("control", "operating state request 3 RUN", "done"),
    ]
    assert operations(s7dissect, "cyclic", "polling") == [
        (
            "cyclic",
            'Tank, every 500 ms, DB1."level", DB1."pump", DB1 LID 99, CPUexecUnit.DIS.OperatingState',
            "running",
        ),
        ("polling", 'DB1."setpoint"', "running"),
    ]
    assert operations(s7dissect, "download") == [("download", "OB1 'Main' (SCL)", "done")]
    assert all("6ES7 215-1AG40-0XB0 V4.3" in subject for _, subject, _ in operations(s7dissect, "session"))


def test_a_baseline_knows_what_clients_read_and_write(s7dissect: Command, tmp_path: Path) -> None:
    made = tmp_path / "plant.toml"
    assert s7dissect("baseline", CAPTURE, "-o", made).returncode == 0
    pairs = {pair["client"]: pair for pair in tomllib.loads(made.read_text(encoding="utf-8"))["pair"]}
    assert (pairs["192.0.2.30"]["reads"], pairs["192.0.2.30"]["writes"]) == (["DB1"], ["DB1"])
    assert (pairs["192.0.2.10"]["reads"], pairs["192.0.2.10"]["writes"]) == ([], [])
    told = s7dissect("baseline", "--against", made, CAPTURE).stdout.decode().splitlines()
    alerts = [line.partition("new: ")[2].partition(" on ")[0] for line in told if "ALERT" in line]
    assert sorted(alerts) == ["download", "start", "stop"]  # acts are never learned
    made.write_text(made.read_text(encoding="utf-8").replace('writes = ["DB1"]', "writes = []"), encoding="utf-8")
    said = s7dissect("baseline", "--against", made, CAPTURE).stdout.decode()
    assert said.count("ALERT") == 4
    assert "first write of DB1 on 192.0.2.20 by 192.0.2.30" in said


def test_its_items_and_alarms_are_data(s7dissect: Command) -> None:
    lines = s7dissect("transactions", "-T", "jsonl", CAPTURE).stdout.splitlines()
    found = [json.loads(line) for line in lines]
    subscribed = [one for one in found if one["function"]["name"] == "CreateObject" and one["items"]]
    assert [item["number"] for item in subscribed[0]["items"]] == [1, 2, 3, 4]
    assert subscribed[0]["items"][0]["address"] == 'DB1."level"'
    pushes = [one for one in found if one["outcome"] == "unsolicited" and one["s7plus"]["response"] is not None]
    first = pushes[0]
    assert [(item["address"], item["return_code"] == 255) for item in first["items"]] == [
        ('DB1."level"', True),
        ('DB1."pump"', True),
        ("CPUexecUnit.DIS.OperatingState", True),
        ("DB1 LID 99", False),
    ]
    assert [one["s7plus"]["response"]["credit_tick"] for one in pushes] == list(range(1, len(pushes) + 1))


def test_metrics_count_its_functions_and_operations() -> None:
    metrics, analysis = counted(CAPTURE)
    assert analysis.answered == 16
    assert {key.split(SEPARATOR)[0]: count for key, count in metrics.operations.items()} == {
        "control": 2, "cyclic": 1, "download": 1, "polling": 1, "session": 2,
    }  # fmt: skip
    names = {row.name for row in metrics.functions.rows.values()}
    assert {"GetMultiVariables", "CreateObject", "SetVariable"} <= names
