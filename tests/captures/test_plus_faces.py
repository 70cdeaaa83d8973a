"""S7comm-plus on the faces that show, cut and watch: captures/s7plus and captures/crafted/plus-plant.pcapng."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import pytest

import dissect
from dissect.engine.transactions.transaction import Transaction
from dissect.online.monitor.details import entry_lines
from dissect.online.monitor.entries import Entry
from tests.conftest import Command

CAPTURES: Final = Path(__file__).resolve().parents[2] / "captures"
PARTNER: Final = CAPTURES / "s7plus" / "s7commplus.pcapng"
IN_TLS: Final = CAPTURES / "s7plus" / "s7commplus-tls.pcapng"
PLANT: Final = CAPTURES / "crafted" / "plus-plant.pcapng"


def numbers(s7dissect: Command, command: str, path: Path, where: str) -> list[int]:
    done = s7dissect(command, "-T", "jsonl", "-Y", where, path)
    assert done.returncode == 0, done.stderr
    key = "number" if command == "transactions" else "frame"
    return [json.loads(line)[key] for line in done.stdout.splitlines()]


@pytest.mark.parametrize("path", [PARTNER, IN_TLS])
def test_show_gives_each_pdu_as_json(s7dissect: Command, path: Path) -> None:
    told = [json.loads(line) for line in s7dissect("show", "-T", "jsonl", path).stdout.splitlines()]
    pdus = [one for one in told if "s7plus" in json.dumps(one)]
    assert len(pdus) >= 26
    assert sum("41ac0000" in line for line in map(json.dumps, pdus)) >= 5


@pytest.mark.parametrize("path", [PARTNER, IN_TLS, PLANT])
def test_a_part_of_a_capture_holds_the_same_transactions(s7dissect: Command, path: Path, tmp_path: Path) -> None:
    part = tmp_path / "part.pcapng"
    assert s7dissect("cut", path, "-o", part, "--connection", "1").returncode == 0

    def facts(of: Path) -> list[object]:
        lines = s7dissect("transactions", "-T", "jsonl", "-Y", "connection == 1", of).stdout.splitlines()
        return [(one["function"], one["items"], one["outcome"]) for one in map(json.loads, lines)]

    assert facts(part) == facts(path)
    assert len(facts(part)) > 3


@pytest.mark.parametrize("path", [PARTNER, IN_TLS])
def test_details_of_the_screens_show_items_and_contents(path: Path) -> None:
    found = [one for one in dissect.open(str(path), pdus=False) if isinstance(one, Transaction)]
    (refused,) = [one for one in found if one.errors]
    shown = "\n".join([line.text for line in entry_lines(Entry(1, 0, refused, False))])
    assert "DB7.DBD0" in shown
    assert "0x8104" in shown


def test_a_rule_speaks_of_a_stop(s7dissect: Command, tmp_path: Path) -> None:
    rules = tmp_path / "rules.toml"
    rules.write_text('[[rule]]\nname = "stop"\nwhen = "finding"\nfinding = "security.plc_stop"\n')
    for path, count in ((PLANT, 1), (PARTNER, 0)):
        done = s7dissect("monitor", "--plain", "--alerts", rules, path)
        assert (done.stdout + done.stderr).decode().count("ALERT") == count


@pytest.mark.parametrize(
    ("path", "where", "count", "messages"),
    [
        (PARTNER, "s7plus.version == 1", 13, 25),
        (PARTNER, "s7plus.session_id == 1", 11, 11),
        (PARTNER, "s7plus.return_value == 0", 13, 13),
        (PARTNER, "db == 7", 1, 1),
        (PARTNER, "address == DB1.DBD0", 5, 5),
        (PARTNER, "items > 1", 1, 1),
        (IN_TLS, "s7plus.version == 2", 11, 11),
        (IN_TLS, "address == DB1.DBD0", 5, 5),
        (PLANT, "s7plus.opcode == notification", 7, 7),
        (PLANT, "s7plus.subscription_id", 7, 7),
        (PLANT, "s7plus.version == 3", 20, 32),
    ],
)
def test_fields_select(s7dissect: Command, path: Path, where: str, count: int, messages: int) -> None:
    assert len(numbers(s7dissect, "transactions", path, where)) == count
    assert len(numbers(s7dissect, "show", path, where)) == messages


def test_a_refused_item_of_a_notification_has_a_return_code(s7dissect: Command) -> None:
    assert numbers(s7dissect, "transactions", PLANT, "return_code == 19") == [5]
