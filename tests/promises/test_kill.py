"""Promise G11: after kill -9 at any moment no file looks whole that is not.

Each is killed 8 times, and 200 times before a release. The writers of packets themselves are killed in
tests/packets/source/test_pcapng_writer.py, tests/files/recording/test_ring_buffer.py and tests/files/recording/test_keeper.py.
"""

from __future__ import annotations

import json
import os
import random
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest

from dissect.output.baseline.loading import load_baseline
from dissect.packets.source.files import open_capture
from dissect.testing.golden.reading import load_golden
from tests.cases import RELEASE
from tests.meaning.report.schemas import ROOT
from tests.meaning.report.support import WORD, begun, read, saved
from tests.packets.source.craft import Recorder
from tests.promises.nursery import Nursery

KILLS: Final = 200 if RELEASE else 8
CAPTURE: Final = ROOT / "captures" / "transfer.pcapng"
PLANT: Final = ROOT / "captures" / "scd" / "plant.toml"
SECRET: Final = "the same secret every time, sixteen characters or more"


def golden(path: Path) -> None:
    assert load_golden(path).transactions


def baseline(path: Path) -> None:
    assert load_baseline(str(path)).pairs


def capture(path: Path) -> None:
    reader, got = open_capture(str(path)), Recorder()
    while reader.step(got):
        pass
    assert (reader.damage, reader.rejected, len(got.frames) > 0) == ("", 0, True)


def octets(path: Path) -> None:
    assert path.stat().st_size > 100


#: What writes a file at once; how it is read; whether it is the same each time.
WRITERS: Final[dict[str, tuple[tuple[str | Path, ...], Callable[[Path], None], bool]]] = {
    "golden": (("golden", CAPTURE, "-o", "OUT", "--force"), golden, True),
    "baseline": (("baseline", CAPTURE, "--update", "OUT", "-o", "OUT"), baseline, False),
    "cut": (("cut", CAPTURE, "-o", "OUT", "--force"), capture, True),
    "anonymize": (("anonymize", CAPTURE, "-o", "OUT", "--force", "--key", "KEY"), capture, True),
    "scd compile": (("scd", "compile", PLANT, "-o", "OUT", "--force"), octets, True),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_is_whole_or_not_there(nursery: Nursery, tmp_path: Path, name: str) -> None:
    call, check, same = WRITERS[name]
    key = tmp_path / "key"
    key.write_text(SECRET)
    key.chmod(0o600)
    out = tmp_path / "out.file"
    words = [{"OUT": out, "KEY": key}.get(str(word), word) for word in call]
    if name == "baseline":
        assert nursery.wait(nursery.start("baseline", CAPTURE, "-o", out)) == 0
    begun_at = time.monotonic()
    told = tmp_path / "told"
    assert nursery.wait(nursery.start(*words, stderr=told)) == 0, told.read_text()
    took = time.monotonic() - begun_at
    whole = out.read_bytes()
    rng = random.Random(name)
    seen = 0
    for kill in range(KILLS):
        there = not kill % 2 or name == "baseline"  # over a file that is there, and where there is none
        if there:
            out.write_bytes(whole)
        else:
            out.unlink(missing_ok=True)
        process = nursery.start(*words, again=True)
        time.sleep(rng.uniform(0.2, 1.6) * took)
        os.kill(process, signal.SIGKILL)
        assert nursery.wait(process) == -signal.SIGKILL
        if out.exists():
            check(out)
            assert not same or out.read_bytes() == whole
            seen += 1
        else:
            assert not there
    assert seen >= KILLS // 2
    left = {path.name for path in tmp_path.iterdir()} - {"key", "told", "out.file"}
    assert all(one.startswith(".") or one.endswith(".part") for one in left), left


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> Path:
    talk = begun()
    for ref in range(1, 1500):
        read(talk, ref, WORD, 0x0A if ref % 50 == 2 else b"\x04\xd2")
    return saved(tmp_path_factory.mktemp("long") / "long.pcapng", talk.packets())


@pytest.mark.parametrize("call", ["monitor -T jsonl", "transactions -T jsonl", "show -T jsonl", "operations -T jsonl"])
def test_only_the_last_line_of_json_lines_may_be_cut(nursery: Nursery, tmp_path: Path, long: Path, call: str) -> None:
    rng = random.Random(call)
    most = 0
    for kill in range(KILLS):
        out = tmp_path / f"{kill}.jsonl"
        process = nursery.start(*call.split(), long, stdout=out, again=True)
        enough, end = rng.randrange(1, 100_000 if "operations" not in call else 500), time.monotonic() + 30
        while (not out.exists() or out.stat().st_size < enough) and time.monotonic() < end:
            time.sleep(0.001)
        os.kill(process, signal.SIGKILL)
        assert nursery.wait(process) == -signal.SIGKILL
        *lines, _cut = out.read_bytes().split(b"\n")
        for line in lines:
            assert json.loads(line)["schema"].startswith("s7dissect.")
        most = max(most, len(lines))
    assert most > 0


def test_evidence_of_a_monitor_is_whole_or_says_that_it_is_not(nursery: Nursery, tmp_path: Path, long: Path) -> None:
    rng = random.Random(1)
    finished = 0
    for kill in range(KILLS):
        kept = tmp_path / str(kill)
        kept.mkdir()
        process = nursery.start(
            "monitor", long, "-w", kept, "-b", "filesize:4", "--keep-around", "transaction.item_error", "5ms"
        )
        enough, end = rng.randrange(1, 40), time.monotonic() + 30
        while len(list(kept.iterdir())) < enough and time.monotonic() < end:
            time.sleep(0.001)
        os.kill(process, signal.SIGKILL)
        assert nursery.wait(process) == -signal.SIGKILL
        for path in kept.glob("*.pcapng"):
            if not path.name.startswith("."):
                capture(path)
                finished += 1
        for path in kept.glob("[!.]*.part"):
            reader = open_capture(str(path))
            while reader.step(Recorder()):
                pass
            assert reader.damage == "" or "cut off" in reader.damage
            assert reader.rejected == 0
        assert len(list(kept.glob("*.part"))) <= 2
    assert finished > 0
