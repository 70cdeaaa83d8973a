"""``--scd`` and ``--bind`` on the analysing commands."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest

from tests.cli.support import run

Capture = pytest.CaptureFixture[bytes]

PLANT: Final = Path(__file__).resolve().parents[2] / "captures" / "scd"
DICT, BIND, CAPTURE = (PLANT / name for name in ("plant.toml", "plant.bind.toml", "plant.pcapng"))
COMMANDS: Final = ("analyze", "transactions", "show")


@pytest.mark.parametrize("command", COMMANDS)
def test_with_both_options_scd_is_decoded(capfdbinary: Capture, command: str) -> None:
    ran = run(capfdbinary, command, "--scd", DICT, "--bind", BIND, CAPTURE)
    assert (ran.code, ran.err) == (0, "")
    assert "Слово состояния 1" in ran.out
    assert "REFUSED abort -4" in ran.out or "err -4" in ran.out
    without = run(capfdbinary, command, CAPTURE)
    assert without.code == 0
    assert "Слово" not in without.out


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--scd", DICT], "missing --bind BINDINGS, which says where SCD is carried"),
        (["--bind", BIND], "missing --scd DICT, the dictionary"),
    ],
)
def test_one_without_the_other(capfdbinary: Capture, command: str, options: list[str | Path], said: str) -> None:
    ran = run(capfdbinary, command, *options, CAPTURE)
    assert ran.code == 2
    assert said in ran.err
    assert ran.out == ""


@pytest.mark.parametrize(
    ("dictionary", "bindings", "said"),
    [
        (BIND, BIND, "plant.bind.toml:3: [binding]"),
        (DICT, DICT, "plant.toml:3: file, dictionary: no such key here; these are: binding"),
        (PLANT / "nowhere.toml", BIND, "nowhere.toml: No such file or directory"),
        (DICT, PLANT / "nowhere.toml", "nowhere.toml: No such file or directory"),
        (DICT, PLANT, "plant.pcapng"),
    ],
)
def test_a_file_that_cannot_be_used(capfdbinary: Capture, dictionary: Path, bindings: Path, said: str) -> None:
    ran = run(capfdbinary, "transactions", "--scd", dictionary, "--bind", bindings, CAPTURE)
    assert ran.code != 0
    assert ran.out == ""
    assert "Traceback" not in ran.err
    assert said in ran.err or bindings.is_dir()


def test_a_binding_that_is_wrong_names_line_table_and_key(capfdbinary: Capture, tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text('# one\n[[binding]]\nudp = 5600\nholds = "T9"\n', encoding="utf-8")
    ran = run(capfdbinary, "show", "--scd", DICT, "--bind", wrong, CAPTURE)
    assert ran.err.strip().endswith(
        f"{wrong}:4: [[binding]] 1, holds: no PDO T9 in the dictionary 'Насосная'; there are T1, T2, T65, T66, R1, R65"
    )


def test_a_compiled_dictionary_does_the_same(capfdbinary: Capture, tmp_path: Path) -> None:
    compiled = tmp_path / "plant.scd"
    assert run(capfdbinary, "scd", "compile", DICT, "-o", compiled).code == 0
    with_source = run(capfdbinary, "transactions", "--scd", DICT, "--bind", BIND, CAPTURE)
    assert run(capfdbinary, "transactions", "--scd", compiled, "--bind", BIND, CAPTURE) == with_source


def test_the_tree_of_a_tsdu_is_that_of_its_message_alone(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "show", "-V", "--scd", DICT, "--bind", BIND, "--frame", "65", CAPTURE)
    lines = ran.out.splitlines()
    assert lines[0].endswith("SCD response  tid 1    read 0x6061:0 Режим 1 = 8 (автомат)")
    assert lines[1].strip() == "SCD message, binding канал"
    assert "unknown protocol" not in ran.out


def test_fail_on_a_finding_about_scd(capfdbinary: Capture) -> None:
    options = ("--scd", DICT, "--bind", BIND, "--fail-on", "scd.pdo_gap")
    assert run(capfdbinary, "analyze", *options, CAPTURE).code == 1
    assert run(capfdbinary, "analyze", "--fail-on", "scd.pdo_gap", CAPTURE).code == 0


def test_cut_keeps_the_packets_of_a_finding(capfdbinary: Capture, tmp_path: Path) -> None:
    part = tmp_path / "part.pcapng"
    options = ("--scd", DICT, "--bind", BIND)
    assert run(capfdbinary, "cut", CAPTURE, "-o", part, "--finding", "scd.pdo_error", *options).code == 0
    ran = run(capfdbinary, "transactions", *options, part)
    assert "err -16 hardware error" in ran.out
    assert ran.out.count("\n") == 1
