"""`s7dissect baseline`: what recorded captures teach, and what one holds that another did not."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from dissect.online.alerts.loading import RuleError, load_rules
from tests.cli.support import halves, run, simple
from tests.meaning.report.support import OWN, ROOT

Capture = pytest.CaptureFixture[bytes]

POLL = ROOT / "captures" / "nodes7-poll.pcapng"
TWO = ROOT / "captures" / "two-clients.pcapng"
CONTROL = ROOT / "captures" / "plc-control.pcapng"


def plant(capfdbinary: Capture, path: Path, *captures: Path) -> Path:
    assert run(capfdbinary, "baseline", *captures, "-o", path).code == 0
    return path


def test_the_same_input_gives_the_same_octets(capfdbinary: Capture, tmp_path: Path) -> None:
    first, again = run(capfdbinary, "baseline", POLL), run(capfdbinary, "baseline", POLL)
    assert first.code == 0
    assert first.out == again.out
    assert plant(capfdbinary, tmp_path / "plant.toml", POLL).read_text() == first.out
    assert 'reads = ["C", "DB1", "DB2", "I", "M", "Q", "T"]\nwrites = []\n' in first.out
    assert 'captures = ["nodes7-poll.pcapng"]' in first.out  # no folder


def test_the_document_shows_what_is_learned(capfdbinary: Capture) -> None:
    blocks = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "alerts.md").read_text(encoding="utf-8"), re.DOTALL)
    shown = next(block for block in blocks if "[[pair]]" in block)
    assert run(capfdbinary, "baseline", POLL).out.endswith(f"\n{shown}")


def test_an_output_that_cannot_be_written_is_told(capfdbinary: Capture, tmp_path: Path) -> None:
    told = run(capfdbinary, "baseline", POLL, "-o", tmp_path / "no" / "plant.toml")
    assert told.code == 2
    assert "No such file or directory" in told.err


@pytest.mark.parametrize("path", [path for path in OWN if path.suffix == ".pcapng"], ids=lambda path: path.stem)
def test_nothing_is_new_in_what_was_learned(capfdbinary: Capture, tmp_path: Path, path: Path) -> None:
    learned = run(capfdbinary, "baseline", path, "-o", tmp_path / "plant.toml")
    if "nothing to learn" in learned.err:
        assert not (tmp_path / "plant.toml").exists()
        return
    # In plus-plant a client begins two seconds late; known clients are waited for from the start.
    factor = "10" if path.stem == "plus-plant" else "1"
    against = ("--against", tmp_path / "plant.toml", "--silence-factor", factor)
    told = run(capfdbinary, "baseline", path, *against)
    plant_ = tmp_path / "plant.toml"
    allowed = plant_.read_text().replace("    # ", "    ")
    if allowed != plant_.read_text():  # acts are never learned, and are in the file to be allowed
        assert told.code == 1
        plant_.write_text(allowed)
        told = run(capfdbinary, "baseline", path, *against)
    assert told.out == ""
    assert told.code == learned.code


def test_the_second_client_is_told(capfdbinary: Capture, tmp_path: Path) -> None:
    against = plant(capfdbinary, tmp_path / "plant.toml", POLL)
    told = run(capfdbinary, "baseline", TWO, "--against", against, "--rate-factor", "0")
    assert told.code == 1
    assert told.out == (
        "2026-11-21 01:30:45.319452 UTC  ALERT warning  new: "
        "first connection with TSAP 01.00 > 01.01 to 127.0.0.1 by 127.0.0.1\n"
    )


def test_a_stop_is_told_as_json(capfdbinary: Capture, tmp_path: Path) -> None:
    against = plant(capfdbinary, tmp_path / "plant.toml", POLL)
    told = run(capfdbinary, "baseline", CONTROL, "-T", "jsonl", "--against", against)
    assert told.code == 1
    alerts = [json.loads(line) for line in told.out.splitlines()]
    assert {"kind": "function", "what": "PLC stop"} in [alert["new"] for alert in alerts]
    assert len({(alert["rule"], alert["text"]) for alert in alerts}) == len(alerts)  # each once


def test_a_higher_rate_is_told(capfdbinary: Capture, tmp_path: Path) -> None:
    against = plant(capfdbinary, tmp_path / "plant.toml", simple(tmp_path / "few.pcapng"))
    many = simple(tmp_path / "many.pcapng", 60)
    told = run(capfdbinary, "baseline", many, "--against", against)
    assert [line.split("  ")[2].split(":")[0] for line in told.out.splitlines()] == ["rate 1 s", "rate 10 s"]
    assert run(capfdbinary, "baseline", many, "--against", against, "--rate-factor", "7").code == 0


def test_update_adds(capfdbinary: Capture, tmp_path: Path) -> None:
    path = plant(capfdbinary, tmp_path / "plant.toml", POLL)
    assert run(capfdbinary, "baseline", TWO, "--update", path, "-o", path).code == 0
    assert 'tsaps = ["01.00 > 01.01", "01.00 > 01.02"]' in path.read_text()
    assert 'captures = ["nodes7-poll.pcapng", "two-clients.pcapng"]' in path.read_text()
    for capture in (POLL, TWO):
        assert run(capfdbinary, "baseline", capture, "--against", path).code == 0
    assert [one.name for one in tmp_path.iterdir()] == ["plant.toml"]  # nothing is left beside it


def test_what_somebody_wrote_is_not_overwritten(capfdbinary: Capture, tmp_path: Path) -> None:
    path = tmp_path / "plant.toml"
    path.write_text("mine")
    told = run(capfdbinary, "baseline", POLL, "-o", path)
    assert (told.code, path.read_text()) == (2, "mine")
    assert "exists; use --update, or choose another file" in told.err


def test_a_file_that_goes_on_is_one_capture(capfdbinary: Capture, tmp_path: Path) -> None:
    first, second = halves(tmp_path)
    assert "connections = 1\ntransactions = 4\n" in run(capfdbinary, "baseline", first, second).out


def test_rules_are_tried(capfdbinary: Capture, tmp_path: Path) -> None:
    rules = tmp_path / "alerts.toml"
    target = tmp_path / "target"
    rules.write_text(
        '[[action]]\nname = "a"\ncommand = ["touch", "' + str(target) + '"]\n'
        '[[rule]]\nname = "stopped"\nwhen = "finding"\nfinding = "security.plc_stop"\nactions = ["a"]\n'
    )
    told = run(capfdbinary, "baseline", CONTROL, "--rules", rules)
    assert told.code == 1
    assert "  ALERT error  stopped: " in told.out
    assert not target.exists()  # nothing is done
    assert run(capfdbinary, "baseline", POLL, "--rules", rules) == (0, "", "")


def test_rules_are_tried_where_their_program_and_socket_are_not(capfdbinary: Capture, tmp_path: Path) -> None:
    """Nothing is sent, so a rules file of another machine is tried on this one."""
    rules = tmp_path / "alerts.toml"
    rules.write_text(
        f'[[action]]\nname = "log"\nsyslog = "{tmp_path}/log"\n'
        f'[[action]]\nname = "page"\ncommand = ["{tmp_path}/page", "{{severity}}"]\n'
        '[[rule]]\nname = "stopped"\nwhen = "finding"\nfinding = "security.plc_stop"\nactions = ["log", "page"]\n'
    )
    told = run(capfdbinary, "baseline", CONTROL, "--rules", rules)
    assert (told.code, "  ALERT error  stopped: " in told.out, told.err) == (1, True, "")
    for gone in ("log", "page"):  # to watch a line with them is another matter
        with pytest.raises(RuleError, match=f"{tmp_path}/{gone}"):
            load_rules(rules)
        (tmp_path / gone).touch(0o755)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--against", "BAD"), "bad.toml:2: [[pair]] 1, client: is missing"),
        (("--update", "BAD"), "bad.toml:2: [[pair]] 1, client: is missing"),
        (("--rules", "BAD"), "bad.toml:1: file, format: no such key here"),
        (("--rules", "NEW"), "\"new\" of 'n' needs a baseline: give one with --against"),
        (("--rate-factor", "2"), "--rate-factor and --silence-factor need --against."),
        (("--silence-factor", "3", "--rules", "NEW"), "--silence-factor need --against without --rules"),
        (("--against", "BAD", "-o", "x"), "--output and --update cannot be combined with --against and --rules"),
        (("-T", "jsonl"), "-T needs --against or --rules: a baseline is written as TOML."),
        (("--against", "no.toml"), "no.toml: No such file"),
    ],
)
def test_wrong_use(capfdbinary: Capture, tmp_path: Path, arguments: tuple[str, ...], told: str) -> None:
    (tmp_path / "bad.toml").write_text("format = 1\n[[pair]]\n")
    (tmp_path / "new.toml").write_text('[[rule]]\nname = "n"\nwhen = "new"\n')
    names = {"BAD": tmp_path / "bad.toml", "NEW": tmp_path / "new.toml"}
    ran = run(capfdbinary, "baseline", POLL, *[names.get(argument, argument) for argument in arguments])
    assert ran.code == 2
    assert told in ran.err
    assert "Traceback" not in ran.err


def test_a_capture_without_s7_teaches_nothing(capfdbinary: Capture, tmp_path: Path) -> None:
    empty = simple(tmp_path / "capture.pcapng", 0)
    cut = tmp_path / "cut.pcapng"
    shutil.copyfile(empty, cut)
    cut.write_bytes(cut.read_bytes()[:200])
    told = run(capfdbinary, "baseline", cut, "-o", tmp_path / "plant.toml")
    assert told.code in {2, 3}
    assert "nothing to learn" in told.err
    assert not (tmp_path / "plant.toml").exists()


def test_a_damaged_capture_is_told(capfdbinary: Capture, tmp_path: Path) -> None:
    cut = tmp_path / "cut.pcapng"
    cut.write_bytes(POLL.read_bytes()[:-30])
    told = run(capfdbinary, "baseline", cut)
    assert told.code == 3
    assert "[[pair]]" in told.out
    assert "cut.pcapng" in told.err
