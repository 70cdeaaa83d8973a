"""What a watch writes after it gave up its rights, when even its own Python can no longer be read."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Final

from dissect import analyze
from tests.meaning.report.schemas import ROOT
from tests.online.live.test_export import counted
from tests.output.page.support import session_of

TRANSFER: Final = ROOT / "captures" / "transfer.pcapng"
#: Opens a report and an export, then makes every file of Python unreadable to itself, as one below /root is to nobody.
WATCH: Final = """
import os, sys
from pathlib import Path
from dissect.cli.rights import _import_all
from dissect.engine.observer import Observer
from dissect.online.live.export import ExportCompanion
from dissect.online.live.reports import ReportCompanion
from dissect.online.live.run import LiveRun
from dissect.packets.source.files import open_capture
from dissect.wire.text import Clock
import dissect
source, out = sys.argv[1], Path(sys.argv[2])
companions = [
    ReportCompanion(str(out / "pages"), 3600 * 10**9, "eth0", "0", Clock(), {}),
    ExportCompanion(out / "tables", 300 * 10**9, "eth0", "0"),
]
_import_all()
run = LiveRun(open_capture(source), Observer(), companions=companions)
shut = tuple({str(Path(file).resolve().parent) for file in (os.__file__, dissect.__file__)} | set(sys.path[1:]) - {""})
def refuse(event, arguments):
    if event == "open" and isinstance(arguments[0], str) and arguments[0].startswith(shut):
        raise PermissionError(13, "Permission denied", arguments[0])
sys.addaudithook(refuse)
try:
    import pydoc_data.topics
except (ImportError, OSError) as error:
    print("shut:", type(error).__name__)
while run.step():
    pass
print(run.failures)
"""


def test_reports_and_tables_need_no_file_of_python_once_the_watch_began(tmp_path: Path) -> None:
    (tmp_path / "pages").mkdir()
    ran = subprocess.run(
        [sys.executable, "-c", WATCH, str(TRANSFER), str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert ran.stdout.startswith("shut"), ran.stdout + ran.stderr
    assert ran.stdout.splitlines()[1] == "[]", ran.stdout
    total = analyze(TRANSFER).total
    (page,) = (tmp_path / "pages").glob("*.html")
    bins = session_of(page.read_text(encoding="utf-8"))["rates"]["bins"]
    assert sum([sum(one[1:]) for one in bins]) == total
    assert counted(tmp_path / "tables", "transactions") == total
