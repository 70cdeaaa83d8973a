"""Names that would steer a terminal: no command writes one as it is, whatever goes wrong with the file."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest

from dissect.cli.main import COMMANDS
from tests.cli.support import run, simple
from tests.meaning.report.schemas import ROOT

Capture = pytest.CaptureFixture[bytes]
#: Sets the title of a window, colours, goes to the next line, and turns the direction of writing.
EVIL: Final = "a\x1b]0;owned\x07\x1b[31m\nred\u202e"
SHOWN: Final = "a\\x1b]0;owned\\x07\\x1b[31m"
PLANT: Final = str(ROOT / "captures" / "scd" / "plant.toml")
PROGRAM: Final = str(ROOT / "captures" / "crafted" / "program.pcapng")  # it has blocks to write
#: Calls that name a file that cannot be read (MISSING), written (NOWHERE) or understood (NONSENSE).
CALLS: Final = """
analyze MISSING
analyze NONSENSE
analyze GOOD MISSING
analyze GOOD --scd MISSING --bind MISSING
analyze GOOD --scd PLANT --bind NONSENSE
analyze --nonsense=WORD
transactions MISSING
values MISSING
values GOOD WORD
operations MISSING
report MISSING -o OUT
report GOOD -o NOWHERE
report --diff GOOD MISSING -o OUT
blocks MISSING
blocks NONSENSE
blocks PROGRAM -o NOWHERE
blocks --diff GOOD MISSING
devices MISSING
show MISSING
cut MISSING -o OUT
cut GOOD -o NOWHERE
cut GOOD -o OUT --finding WORD
cut GOOD -o OUT --time WORD
open MISSING -o OUT
open GOOD -o NOWHERE
extcap --install NOWHERE
extcap --capture --extcap-interface s7dissect-file --fifo OUT --file MISSING
extcap --capture --extcap-interface s7dissect-file --fifo NOWHERE --file GOOD
extcap --capture --extcap-interface s7dissect --fifo OUT --interface WORD
anonymize MISSING -o OUT
anonymize GOOD -o NOWHERE
anonymize GOOD -o OUT --key MISSING
baseline MISSING
baseline GOOD -o NOWHERE
baseline GOOD --against MISSING
baseline GOOD --against NONSENSE
baseline GOOD --rules MISSING
baseline GOOD --rules NONSENSE
export MISSING -o OUT.parquet
export NONSENSE -o csv:OUT
export GOOD -o csv:NOWHERE
export GOOD -o sqlite:NOWHERE
export GOOD -o WORD
export GOOD -o csv:OUT --only WORD
sql talkers MISSING
sql talkers NONSENSE
sql WORD GOOD
golden MISSING
golden NONSENSE
golden GOOD -o NOWHERE
golden GOOD --with WORD
diff GOOD MISSING
diff NONSENSE GOOD
verify MISSING
alerts test MISSING
alerts test NONSENSE
evidence verify MISSING
monitor MISSING
monitor NONSENSE
monitor -i WORD
monitor GOOD --alerts MISSING
monitor GOOD --alerts NONSENSE
monitor GOOD -w NOWHERE
monitor GOOD --keep-around WORD 1s -w OUT
monitor GOOD --metrics WORD
index MISSING
index FOLDER --file NONSENSE
interfaces WORD
proxy --to WORD:x
proxy --to 127.0.0.1:1 --listen WORD
proxy --to 127.0.0.1:1 --listen 127.0.0.1:0 -w NOWHERE
serve MISSING
serve NONSENSE
serve GOOD --listen 127.0.0.1:0 -w NOWHERE
replay MISSING --to 127.0.0.1:1
replay NONSENSE --to 127.0.0.1:1
replay GOOD --to WORD
replay GOOD --to 127.0.0.1:1 -w NOWHERE
browser --verify MISSING
scd check MISSING
scd check NONSENSE
scd compile MISSING -o OUT
scd compile PLANT -o NOWHERE
scd dump MISSING
scd diff PLANT MISSING
scd decode -d MISSING --pdo T1 00
scd decode -d PLANT --pdo WORD 00
scd encode -d MISSING --value 0x6001 5
scd encode -d PLANT --value WORD 5
tags check MISSING
tags list MISSING
tags convert MISSING
analyze GOOD --tags MISSING
analyze GOOD --tls-keys MISSING
transactions GOOD -Y WORD
cluster-check WORD
analyze GOOD --separate --cluster WORD
fields WORD
schema WORD
completion WORD
help WORD
WORD
"""


def calls() -> list[list[str]]:
    return [line.split() for line in CALLS.split("\n") if line]


@pytest.mark.parametrize("call", calls(), ids=" ".join)
def test_a_name_is_escaped_wherever_it_is_told(capfdbinary: Capture, tmp_path: Path, call: list[str]) -> None:
    nonsense = tmp_path / EVIL
    nonsense.write_text("nonsense = [", encoding="utf-8")
    files = {
        "MISSING": str(tmp_path / "none" / EVIL),
        "NOWHERE": str(tmp_path / "good.pcapng" / EVIL),
        "NONSENSE": str(nonsense),
        "GOOD": str(simple(tmp_path / "good.pcapng")),
        "OUT": str(tmp_path / "out"),
        "PLANT": PLANT,
        "PROGRAM": PROGRAM,
        "FOLDER": str(tmp_path),
        "WORD": EVIL,
    }
    words = []
    for template in call:
        word = template
        for key, value in files.items():
            word = word.replace(key, value)
        words.append(word)
    ran = run(capfdbinary, *words)
    assert ran.code in ({1, 2} if call[0] in {"scd", "tags"} else {2}), ran
    told = ran.out + ran.err
    assert told
    for character in told.replace("\n", ""):
        assert character.isprintable(), told
    assert "\nred" not in told
    if set(call) & {"MISSING", "NOWHERE", "NONSENSE"}:
        assert SHOWN in told, told
        assert len(told.splitlines()) == 1, told


def test_every_command_is_walked() -> None:
    assert {call[0] for call in calls()} >= set(COMMANDS)
