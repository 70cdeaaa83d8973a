"""HUP to a probe: rules, tags and hosts are read again and new files begin, and no packet, connection or request is lost."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import IO, Any

from dissect.packets.source.files import open_capture
from tests.cli.support import started
from tests.forked import Forked
from tests.meaning.report.support import WORD, begun, read, saved
from tests.packets.source.craft import drain
from tests.properties import messages
from tests.properties.messages import dt

RULE = '[[rule]]\nname = "{}"\nwhen = "finding"\nfinding = "transaction.item_error"\ncooldown = 0\n'


def told(stream: IO[bytes] | None, until: str) -> list[dict[str, Any]]:
    """Return the JSON lines up to the first that holds ``until``."""
    assert stream is not None
    found = []
    for line in stream:
        found.append(json.loads(line))
        if until in line.decode():
            return found
    raise AssertionError(f"{until!r} never came")


def pieces(folder: Path) -> list[bytes]:
    """Return a capture in three pieces; a request is the last packet of the first two, its answer begins the next."""
    talk = begun()
    read(talk, 1, WORD, 0x0A)
    cuts = []
    for reference in (2, 3):
        talk.send(0, dt(messages.read_job(reference, [WORD])))
        cuts.append(saved(folder / f"cut{reference}", talk.packets()).stat().st_size)
        talk.send(1, dt(messages.read_answer(reference, [WORD], [0x0A])))
    whole = saved(folder / "whole", talk.packets()).read_bytes()
    return [whole[: cuts[0]], whole[cuts[0] : cuts[1]], whole[cuts[1] :]]


def feed(process: Forked, octets: bytes) -> None:
    assert process.stdin is not None
    process.stdin.write(octets)
    process.stdin.flush()


def test_files_are_read_again_and_nothing_is_lost(tmp_path: Path) -> None:
    rules, tags, ring = tmp_path / "rules.toml", tmp_path / "tags.csv", tmp_path / "ring"
    rules.write_text(RULE.format("before"))
    tags.write_text("name,address,type\nold,DB10.DBW4,WORD\n")
    first, second, third = pieces(tmp_path)
    beside = ("--alerts", rules, "--tags", tags, "-w", ring, "-b", "filesize:1000")
    with started("monitor", "-", "-T", "jsonl", *beside) as process:
        feed(process, first)
        before = json.dumps(told(process.stdout, '"number":2'))
        rules.write_text(RULE.format("after"))
        tags.write_text("name,address,type\nnew,DB10.DBW4,WORD\n")
        process.send_signal(signal.SIGHUP)
        told(process.stdout, "new files begin")
        feed(process, second)
        after = json.dumps(told(process.stdout, '"number":3'))
        rules.write_text("[[rule]]\nname = 5\n")
        process.send_signal(signal.SIGHUP)
        (*_, refused) = told(process.stdout, "stay as they were")
        assert "rules.toml" in json.dumps(refused)
        feed(process, third)
        assert process.stdin is not None
        process.stdin.close()
        rest = told(process.stdout, '"summary"')
        assert process.wait(20) == 0
        assert process.stderr is not None
        alerts = process.stderr.read().decode()
    summary = rest[-1]["summary"]
    assert (summary["connections"], summary["unanswered"]) == (1, 0)
    assert ('"old"' in before, '"new"' in before, '"old"' in after, '"new"' in after) == (True, False, False, True)
    assert alerts.count("before:") == 1
    assert alerts.count("after:") == 2
    files = sorted(ring.glob("*.pcapng"))
    packets = [len(drain(open_capture(str(path))).frames) for path in files]
    assert len(files) == 3
    assert sum(packets) == summary["packets"]
