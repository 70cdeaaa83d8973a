"""pyshark as a second way to Wireshark, in a process of its own."""

from __future__ import annotations

import asyncio
import os
import shutil
import subprocess
import sys
from pathlib import Path
from random import Random

import pytest

from dissect.testing.oracle import pyshark_reader
from dissect.testing.oracle.pyshark_reader import _decoded, read_pyshark
from dissect.testing.oracle.tshark import Child, OracleError, read_tshark
from tests.testing.oracle.traffic import conversation, interleaved, write_capture

pytestmark = pytest.mark.skipif(shutil.which("tshark") is None, reason="tshark is not installed")


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Some connections, on port 102 and another, with several messages in a segment."""
    rng = Random(8)
    packets = interleaved(rng, [conversation(rng, number, [102 if number % 2 else 10102]) for number in range(4)])
    return str(write_capture(tmp_path_factory.mktemp("made") / "made.pcap", packets))


def test_the_same_facts_as_from_tshark(capture: str) -> None:
    direct = list(read_tshark(capture, [10102]))
    other = list(read_pyshark(capture, [10102]))
    assert [frame.number for frame in other] == [frame.number for frame in direct]
    for mine, its in zip(other, direct, strict=True):
        assert mine.protocols == its.protocols
        for kind in ("tpdus", "pdus"):
            assert [(one.octets, one.facts) for one in getattr(mine, kind)] == [
                (one.octets, one.facts) for one in getattr(its, kind)
            ]
    assert max(len(frame.pdus) for frame in other) > 1


def test_after_another_event_loop_ran(capture: str) -> None:
    asyncio.run(asyncio.sleep(0))
    assert next(read_pyshark(capture, [10102])).tpdus


def test_ports_have_to_be_told(capture: str) -> None:
    assert len(list(read_pyshark(capture))) < len(list(read_pyshark(capture, [10102])))


def test_a_file_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(OracleError, match=r"pyshark, reading .*nothing.pcap: it failed with code 1: .*No such file"):
        list(read_pyshark(str(tmp_path / "nothing.pcap")))


def test_a_file_that_is_no_capture(tmp_path: Path) -> None:
    path = tmp_path / "text.pcap"
    path.write_text("this is not a capture")
    with pytest.raises(OracleError, match="isn't a capture file"):
        list(read_pyshark(str(path)))


def test_a_line_that_is_no_json_is_told_with_its_place() -> None:
    with pytest.raises(OracleError, match=r"reading a.pcap: .*byte 5\), near b'\{\"a\":x\}'"):
        _decoded(b'{"a":x}', "a.pcap")


#: A tshark that says everything, and leaves a little later.
_LINGERS = """#!/bin/sh
{tshark} "$@"
exec >&- 2>&-
sleep 0.2
"""
#: Reads with pyshark, whose signal for a tshark that has said everything comes when that has just left.
_TOO_LATE = """
import sys, time
from asyncio.subprocess import Process
kill = Process.kill
def late(self):
    time.sleep(0.5)
    kill(self)
Process.kill = late
from dissect.testing.oracle.pyshark_reader import main
main(sys.argv[1], "0", "10102")
"""


def test_tshark_may_take_its_leave(capture: str, tmp_path: Path) -> None:
    lingers = tmp_path / "tshark"
    lingers.write_text(_LINGERS.format(tshark=shutil.which("tshark")))
    lingers.chmod(0o755)
    done = subprocess.run(
        [sys.executable, "-c", _TOO_LATE, capture],
        env={**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
        capture_output=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.count(b"\n") == len(list(read_pyshark(capture, [10102])))


#: A tshark that says all but the end of its array, and dies.
_DIES = """#!/bin/sh
[ "$1" = -v ] && exec {tshark} -v
{tshark} "$@" | head -c -4
kill -SEGV $$
"""


def test_a_tshark_that_dies_behind_the_last_packet_is_named(
    capture: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dies = tmp_path / "tshark"
    dies.write_text(_DIES.format(tshark=shutil.which("tshark")))
    dies.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    with pytest.raises(OracleError, match="tshark was ended by signal 11"):
        list(read_pyshark(capture, [10102]))


def test_a_child_that_ends_within_a_line_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    dying = [sys.executable, "-c", "import sys; sys.stdout.write('{\"frame\":'); sys.exit('out of memory')"]
    monkeypatch.setattr(pyshark_reader, "Child", lambda _command, what: Child(dying, what))
    with pytest.raises(OracleError, match=r"pyshark, reading a.pcap: it failed with code 1: out of memory"):
        list(read_pyshark("a.pcap"))
