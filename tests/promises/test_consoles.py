"""Code pages of Windows: every command writes UTF-8 to stdout, and escapes on stderr what the code page has no place for.

One process for each code page runs all commands; Python gave it its streams by PYTHONIOENCODING, as Windows does by the code
page.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

import pytest

from dissect.cli.main import COMMANDS
from tests.meaning.report.support import ROOT
from tests.promises import hostile

#: What neither cp1252 nor cp437 has a place for, what only one of them has, and what both have.
SAID: Final = ["ЖЯ→", "温度", "€ 5 ‰", "∞ ≥ Ω", "Größe µs é"]
SCD: Final = ROOT / "captures" / "scd"
#: Commands that print what a capture or a file says, and what is wrong with names that are given.
CALLS: Final = """
analyze HOSTILE
analyze --brief HOSTILE
analyze HOSTILE -T json
analyze HOSTILE --fail-on ЖЯ→
transactions HOSTILE
transactions HOSTILE -T jsonl
transactions HOSTILE -T csv
transactions HOSTILE -Y ЖЯ→==1
operations HOSTILE
devices HOSTILE
devices HOSTILE -T csv
blocks HOSTILE
show HOSTILE -V
values HOSTILE
report HOSTILE
index FOLDER
sql connections HOSTILE
open HOSTILE -o NEW/→open.pcapng
cut HOSTILE -o NEW/→cut.pcapng --connection 1
evidence verify FOLDER
anonymize HOSTILE -o NEW/→anonymous.pcapng --key LICENSE
export HOSTILE -o NEW/→.csv
browser --verify →.html
baseline HOSTILE
golden HOSTILE
diff HOSTILE PLAIN
diff HOSTILE PLAIN -T junit
verify →.pcapng
monitor --plain HOSTILE
alerts →.toml
proxy --to →
serve →.pcapng
replay HOSTILE --dry-run
replay HOSTILE --to →
scd check SCD/plant.toml
scd check →.toml
tags list →.csv
tags list TAGS
help
help →
fields
schema
schema →
completion →
extcap →
interfaces →
cluster-check →
""".strip().split("\n")
#: The order of these is that of the system or of time.
UNSTEADY: Final = frozenset(("interfaces",))

RUN: Final = """
import gc, json, os, sys
from dissect.cli.main import main
calls, folder = json.loads(sys.argv[1]), sys.argv[2]
out, err = sys.stdout, sys.stderr
codes, encoding = [], out.encoding
assert encoding == err.encoding == sys.argv[3]
for number, call in enumerate(calls):
    for descriptor, name in ((1, "out"), (2, "err")):
        opened = os.open(os.path.join(folder, f"{number}.{name}"), os.O_WRONLY | os.O_CREAT, 0o600)
        os.dup2(opened, descriptor)
        os.close(opened)
    out.reconfigure(encoding=encoding, errors="strict")
    try:
        main(call)
    except SystemExit as end:
        codes.append(end.code)
    except Exception as error:
        codes.append(repr(error))
    out.flush()
    err.flush()
with open(os.path.join(folder, "codes"), "w") as file:
    json.dump(codes, file)
"""


@pytest.fixture(scope="module")
def calls(tmp_path_factory: pytest.TempPathFactory) -> list[list[str]]:
    folder = tmp_path_factory.mktemp("captures")
    tags = folder / "tags.csv"
    tags.write_text("Name,Data type,Address\nЖЯ→,Bool,%M0.0\nTemperatur €,Int,%MW2\n", encoding="utf-8")
    names = {
        "HOSTILE": hostile.write(folder / "→ ЖЯ.pcapng", [text.encode() for text in SAID]),
        "PLAIN": ROOT / "captures" / "item-errors.pcapng",
        "LICENSE": ROOT / "LICENSE",
        "FOLDER": folder,
        "TAGS": tags,
    }
    made = [
        [str(names.get(word, word)).replace("SCD/", f"{SCD}/") for word in call.split()]
        for call in [*CALLS, *[f"{name} --help" for name in COMMANDS], "--help", "--version", "→"]
    ]
    assert {call[0] for call in made} >= COMMANDS.keys()
    return made


def ran(calls: list[list[str]], folder: Path, encoding: str) -> list[tuple[object, bytes, bytes]]:
    """Run all commands in a process whose streams have an encoding; return exit code, stdout and stderr of each."""
    (folder / "new").mkdir(parents=True)
    words = [[word.replace("NEW/", f"{folder / 'new'}/") for word in call] for call in calls]
    environment = {
        **os.environ,
        "PYTHONIOENCODING": f"{encoding}:strict",
        "COLUMNS": "100",
        "XDG_CACHE_HOME": str(folder),
    }
    done = subprocess.run(
        [sys.executable, "-c", RUN, json.dumps(words), str(folder), encoding],
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
        cwd=folder,
        timeout=600,
    )
    assert (folder / "codes").exists(), done.stderr.decode(errors="replace")
    codes = json.loads((folder / "codes").read_text("ascii"))
    return [
        (code, (folder / f"{number}.out").read_bytes(), (folder / f"{number}.err").read_bytes())
        for number, code in enumerate(codes)
    ]


def test_every_command_under_every_code_page(calls: list[list[str]], tmp_path: Path) -> None:
    encodings = ("utf-8", "cp1252", "cp437")
    with ThreadPoolExecutor(2) as pool:
        told = dict(
            zip(encodings, pool.map(lambda one: ran(calls, tmp_path / one, one), encodings), strict=True),
        )
    usual = told.pop("utf-8")
    assert [call for call, (code, *_) in zip(calls, usual, strict=True) if not isinstance(code, int)] == []
    for encoding, results in told.items():
        for call, here, there in zip(calls, usual, results, strict=True):
            code, out, err = here
            if call[0] in UNSTEADY:
                out = there[1]
            said = err.decode().replace(f"{tmp_path}/utf-8", f"{tmp_path}/{encoding}")
            assert there == (code, out, said.encode(encoding, "backslashreplace")), (encoding, call)


def test_what_was_said_was_tried(calls: list[list[str]], tmp_path: Path) -> None:
    """Otherwise the test above would compare ASCII with ASCII."""
    chosen = [call for call in calls if call[0] in {"transactions", "tags", "cut", "--help", "→"}]
    results = ran(chosen, tmp_path, "cp437")
    assert "ЖЯ" in b"".join([out for _, out, _ in results]).decode()
    wrong = b"".join([err for _, _, err in results]).decode("cp437")
    assert "\\u2192" in wrong
    assert "\\u0416\\u042f" in wrong
