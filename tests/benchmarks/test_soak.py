"""The soak in its quick form: what was sent over a real line is what was told, and memory does not follow the connections.

Rates depend on the machine and are stated by `benchmarks.soak`; here nothing depends on how fast it is.
"""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

import pytest

from benchmarks import soak
from benchmarks.generate import generate
from benchmarks.soak_sender import Load
from benchmarks.soak_trials import Trial, delays_ms
from benchmarks.soak_watchers import MONITORS
from dissect.packets.source.live import dumpcap, ring
from dissect.wire.build import COMPILED
from tests.cases import RELEASE

#: In the last quarter of the small day, a third of a kibibyte for each of its connections; and the most at any time.
_MOST_GROWTH: Final = 1.05
_MOST_MB: Final = 140
_ROOT: Final = Path(__file__).resolve().parent.parent.parent
#: Runs a piece of the soak in a process of its own, which alone moves to another network.
_SCRIPT: Final = """
import json, sys
from pathlib import Path
import dissect.engine.pipeline
sys.path.append(sys.argv[1])
from benchmarks.soak_line import FAR, NoLineError, enter
from benchmarks.soak_trials import SenderProcess, attempt, delays_ms
from benchmarks.soak_watchers import monitor, monitor_call
work, engine, only, rate, seconds, marks = Path(sys.argv[2]), *sys.argv[3:]
try:
    enter()
except NoLineError as error:
    print(json.dumps({"skip": str(error)}))
    sys.exit()
path = str(Path(dissect.engine.pipeline.__file__).parents[2])
call, environment, build = monitor_call(sys.executable, path, work)
sender = SenderProcess(work / "made.pcap")
watcher = monitor(call, environment, build, engine, FAR, only)
trial = attempt(watcher, sender, int(rate), float(seconds), work, float(marks), patience=20.0)
sender.close()
told = trial.as_dict() | {"marked": len(trial.marks), "delays": delays_ms(trial), "held": trial.held, "line": trial.line()}
print(json.dumps(told))
"""


def _needs(engine: str) -> None:
    error = ring.trouble() if engine == "ring" else dumpcap.trouble("lo")
    if error is not None:
        pytest.skip(f"{engine} cannot capture here: {error}")


def _attempt(folder: Path, engine: str, only: str, rate: int, seconds: float, marks: float) -> dict[str, Any]:
    _needs(engine)
    generate(folder / "made.pcap", 3000)
    words = [str(_ROOT), str(folder), engine, only, str(rate), str(seconds), str(marks)]
    done = subprocess.run([sys.executable, "-P", "-c", _SCRIPT, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    if "skip" in told:
        pytest.skip(f"there can be no line here: {told['skip']}")
    return told


@pytest.mark.parametrize("engine", MONITORS)
def test_what_is_sent_is_told(engine: str, tmp_path: Path) -> None:
    told = _attempt(tmp_path, engine, "transactions", 2000, 1.5, 20)
    assert told["sent"] == told["arrived"] == told["seen"], told["line"]
    assert told["sent"] > 100
    assert told["ended"]
    assert not any([told[name] for name in ("kernel", "interface", "lost_events")]), told["line"]
    assert len(told["delays"]) == told["marked"] > 0
    assert min(told["delays"]) > 0


class _Frames:
    """The frames of a load as the kernel would gather them."""

    def __init__(self, load: Load) -> None:
        self._load = load

    def frames(self) -> list[bytes]:
        import ctypes

        found = []
        for number in range(self._load.count):
            message = ctypes.string_at(self._load.address + 64 * number, 64)
            pieces, count = struct.unpack_from("@PN", message, 16)
            octets = b""
            for piece in range(count):
                base, size = struct.unpack("@PN", ctypes.string_at(pieces + 16 * piece, 16))
                octets += ctypes.string_at(base, size)
            found.append(octets)
        return found


def _sum(octets: bytes) -> int:
    octets += b"\0" * (len(octets) & 1)
    value: int = sum(struct.unpack(f">{len(octets) // 2}H", octets))
    while value >> 16:
        value = (value & 0xFFFF) + (value >> 16)
    return value


def _checks(frame: bytes) -> tuple[int, int]:
    """Return the sums over the header of IP and over TCP with its pseudo header: 0xFFFF where the checksum is right."""
    total = int.from_bytes(frame[16:18], "big")
    segment = frame[34 : 14 + total]
    return _sum(frame[14:34]), _sum(frame[26:34] + struct.pack(">HH", 6, len(segment)) + segment)


def test_each_pass_has_other_hosts_and_right_checksums(tmp_path: Path) -> None:
    path = tmp_path / "made.pcap"
    generate(path, 1500)
    load = Load(path)
    seen: list[set[bytes]] = []
    for _ in range(12):
        frames = _Frames(load).frames()
        assert len(frames) == load.count > 1000
        # A keep-alive's octet is wrong on purpose, its checksum is not.
        assert {_checks(frame) for frame in frames} == {(0xFFFF, 0xFFFF)}
        seen.append({frame[26:34] for frame in frames})
        # Both directions of a connection still meet.
        assert all([pair[4:] + pair[:4] in seen[-1] for pair in seen[-1]])
        load.renew()
    assert len(set.union(*seen)) == sum([len(pairs) for pairs in seen])


def test_the_file_has_to_be_one_that_was_made(tmp_path: Path) -> None:
    path = tmp_path / "other"
    path.write_bytes(b"\x0a\x0d\x0d\x0a" + bytes(60))
    with pytest.raises(ValueError, match="not a pcap file"):
        Load(path)
    path.write_bytes(b"\xd4\xc3\xb2\xa1" + bytes(20))
    with pytest.raises(ValueError, match="no S7"):
        Load(path)


def _trial(**told: Any) -> Trial:
    sent = {"sent": 10, "rate": 10.0, "seconds": 1.0, "behind_s": 0.0, "marks": [1_000_000, 2_000_000]}
    summary = {"packets": 10, "dropped": {"kernel": 0, "interface": 0}, "events_lost": 0}
    return Trial(sent, told.pop("came", 10), {"summary": summary | told}, 0.1)


def test_held_means_that_nothing_is_missing() -> None:
    assert _trial().held
    assert _trial(dropped={"kernel": None, "interface": None}).held  # nobody tells, but all came
    assert not _trial(packets=9).held
    assert not _trial(came=9).held
    assert not _trial(dropped={"kernel": 1, "interface": 0}).held
    assert not _trial(dropped={"kernel": 0, "interface": 1}).held
    late = _trial()
    late.behind_s = 1.0
    assert not late.held
    assert "late" in late.line()
    silent = Trial({"sent": 0, "rate": 0.0, "seconds": 1.0, "behind_s": 0.0, "marks": []}, 0, {}, 0.0)
    assert not silent.held
    assert "did not end" in silent.line()


def test_delays_belong_to_the_marks() -> None:
    trial = _trial()
    lines = [{"pdu_ref": 65535, "function": {"code": 240}}, {"pdu_ref": 1, "function": {"code": 4}}]
    trial.told = [(5_000_000, json.dumps(line).encode()) for line in lines]
    assert delays_ms(trial) == [3.0]


def _day(folder: Path, *words: str) -> dict[str, Any]:
    code = "import sys, dissect.engine.pipeline; sys.path.append(sys.argv.pop(1)); from benchmarks.soak_day import main; main()"
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, str(_ROOT), *words],
        capture_output=True,
        text=True,
        cwd=folder,
        env=dict(os.environ),
        check=False,
    )
    assert done.returncode == 0, done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def test_a_day_in_small(tmp_path: Path) -> None:
    """Twelve minutes with fifty connections in each: everything is told, nothing fails beside."""
    told = _day(tmp_path, "--hours", "0.2", "--churn", "50", "--busy-every", "1")
    assert told["failures"] == []
    assert told["connections"] == 12 * 50 + 24
    # A set-up for each connection, a read for each short one, sixteen polls and eight questions a second.
    assert told["transactions"] == 24 + 2 * 12 * 50 + 12 * 60 * 24
    assert min(told["findings"], told["alerts"]) > 0
    assert told["lines"] >= told["transactions"] + told["connections"]


@pytest.mark.measured
@pytest.mark.skipif(not COMPILED, reason="memory is promised for the compiled build")
@pytest.mark.skipif(not RELEASE, reason="a size for a release")
def test_memory_is_bounded(tmp_path: Path) -> None:
    """Sixty thousand connections, a quarter of which never end, and requests that nobody answers.

    Too few to fill every table (a whole day does, in `benchmarks.soak`), but those of connections are full after 36,000: what
    kept a kibibyte of each connection would show three times over.
    """
    told = _day(tmp_path, "--hours", "0.4", "--churn", "2500", "--busy-every", "1")
    _, _, third, last = told["resident_kb"]
    assert told["failures"] == []
    assert told["connections"] == 24 * 2500 + 24
    assert last <= _MOST_GROWTH * third, told["resident_kb"]
    assert told["peak_kb"] * 1024 <= _MOST_MB * 1e6, told["peak_kb"]


def test_busy_loops_run_beside_and_end_with_what_they_run_beside(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[subprocess.Popen[bytes]] = []

    class Loop(subprocess.Popen[bytes]):
        def __init__(self, arguments: list[str]) -> None:
            super().__init__(arguments)
            started.append(self)

    monkeypatch.setattr(subprocess, "Popen", Loop)
    with soak.beside(2):
        assert [loop.poll() for loop in started] == [None, None]
    assert all(loop.returncode for loop in started)


def test_the_rates_to_hold_can_be_chosen(capsys: pytest.CaptureFixture[str]) -> None:
    assert soak.hold_rate("ring=250k") == ("ring", 250_000)
    for wrong in ("scapy=1k", "ring", "ring=fast"):
        with pytest.raises(SystemExit):
            soak.main(["--hold-rate", wrong])
        assert "packets" in capsys.readouterr().err
