"""`monitor -i va -i vc`: one process, two networks; each line, object and packet names its interface."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

from dissect.packets.source.files import open_capture
from dissect.packets.source.live import privileges
from tests.conftest import ROOT
from tests.meaning.report.support import begun, read
from tests.packets.source.live_support import Sink, in_namespace, needs_ring, sender
from tests.properties.packets import Flow

needs_root = pytest.mark.skipif(not privileges.is_root(), reason="only root can make interfaces")
NAMES = ("vb", "vd")


def frames(number: int) -> list[bytes]:
    """A connection of its own for each network, of 20 reads."""
    flow = Flow(f"10.0.{number}.1", f"10.0.{number}.2")
    talk = begun(flow)
    for reference in range(1, 21):
        read(talk, reference)
    return [packet.octets for packet in talk.close(0).close(1).packets()]


def wait_for_both() -> None:
    """Wait until both interfaces are watched: they are promiscuous then."""
    end = time.monotonic() + 60
    while time.monotonic() < end:
        told = subprocess.run(["ip", "-d", "link"], capture_output=True, text=True, check=True).stdout
        if told.count("promiscuity 1") == len(NAMES):
            return
        time.sleep(0.1)
    raise AssertionError("the monitor opened no interface")


def watch(arguments: list[str], folder: Path) -> tuple[int, str, str]:
    """Run the command on two networks, on each of which a connection passes at the same time."""
    for words in ("link add vc type veth peer name vd", "link set vc up", "link set vd up"):
        made = subprocess.run(["ip", *words.split()], capture_output=True, text=True, check=False)
        if made.returncode:
            pytest.skip(f"ip {words}: {made.stderr.strip()}")
    command = [
        sys.executable,
        "-m",
        "dissect",
        "monitor",
        "-i",
        "vb",
        "-i",
        "vd",
        "--engine",
        "ring",
        "-Z",
        "root",
        "-f",
        "tcp port 102",
    ]
    pipe = subprocess.PIPE
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "XDG_STATE_HOME": str(folder)}
    with subprocess.Popen(
        [*command, *arguments], cwd=folder, stdout=pipe, stderr=pipe, text=True, env=environment
    ) as process:
        wait_for_both()
        with sender("va") as first, sender("vc") as second:
            for one, other in zip(frames(1), frames(2), strict=True):
                first.send(one)
                second.send(other)
                time.sleep(0.002)
            time.sleep(1)  # what is held is given out
            process.terminate()
            out, err = process.communicate(timeout=60)
    return process.returncode, out, err


@needs_ring
@needs_root
def test_each_line_and_packet_names_its_interface(tmp_path: Path) -> None:
    def task() -> None:
        code, out, err = watch(["-T", "jsonl", "-w", "ring", "-b", "filesize:1000", "--manifest"], tmp_path)
        assert code == 130, err  # it was ended by a signal
        objects = [json.loads(line) for line in out.splitlines()]
        about = [one for one in objects if one.get("event") not in {"summary", "problem", "device"}]
        assert {one["interface"] for one in about} == {*NAMES}
        transactions = [one for one in about if one["schema"].startswith("s7dissect.transaction")]
        assert Counter(one["interface"] for one in transactions) == {"vb": 21, "vd": 21}
        for one in transactions:
            number = {"vb": "1", "vd": "2"}[one["interface"]]
            assert f"10.0.{number}.1:49152" in json.dumps(one)
        assert not [one for one in about if one.get("finding", {}).get("slug") == "capture.time_backwards"]
        (path,) = (tmp_path / "ring").glob("*.pcapng")
        sources: Counter[str] = Counter()
        reader = open_capture(str(path))

        class Named(Sink):
            def frame(self, *packet: object) -> None:
                sources[reader.interface] += 1

        while reader.step(Named()):
            pass
        reader.close()
        assert sources["vb"] == sources["vd"] == len(frames(1))
        begin = json.loads(next((tmp_path / "ring").glob("*.manifest.jsonl")).read_text().splitlines()[0])
        assert begin["source"] == "vb, vd"

    in_namespace(task)


@needs_ring
@needs_root
def test_lines_of_text_begin_with_their_interface(tmp_path: Path) -> None:
    def task() -> None:
        code, out, err = watch(["--plain", "--only", "connections,transactions"], tmp_path)
        assert code == 130, err  # it was ended by a signal
        lines = out.splitlines()
        assert len(lines) == 2 * (2 + 21)
        assert Counter(line.partition("  ")[0] for line in lines) == {"vb": 23, "vd": 23}

    in_namespace(task)
