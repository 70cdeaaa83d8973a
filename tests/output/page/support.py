"""Shared by the tests of the report: pages made from packets, their data, and a capture whose names are all hostile."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from dissect.engine.pipeline import Options
from dissect.files.session import Run
from dissect.meaning.report.words import Places
from dissect.output.page.gathered import Gathered, span_of
from dissect.output.page.rendering import Side, render
from dissect.output.page.rows import Rows
from dissect.output.variables.choosing import Known, choose
from dissect.wire.text import Clock
from tests.meaning.report.support import read
from tests.properties import messages
from tests.properties.messages import Item, dt
from tests.properties.packets import Flow, Packet, Talk

#: Texts that have broken pages, shells, spreadsheets and terminals before.
NAUGHTY: Final = (
    "</script><script>window.hacked=1</script>",
    "<script>window.hacked=1</script>",
    "<img src=x onerror=window.hacked=1>",
    '"><svg/onload=window.hacked=1>',
    "'onmouseover='window.hacked=1",
    "<!-- <script>",
    "]]><![CDATA[",
    "{{ 7 * 7 }}{% raw %}",
    "javascript:window.hacked=1",
    "<iframe src='//example.invalid'></iframe>",
    "<style>*{display:none}</style>",
    "<base href='//example.invalid/'>",
    "<meta http-equiv=refresh content=0>",
    "\u202egnp.exe",
    "line\u2028break\u2029",
    "\x00\x07\x1b[31m",
    "=cmd|' /C calc'!A0",
    "' OR 1=1 --",
    "%s%n%x",
    "Ω≈ç√∫µ≤ 田中 🙈",
    "W" * 3000,
)


def gathered_of(
    paths: Sequence[Path],
    tags: Sequence[str] = (),
    options: Options | None = None,
    hosts: Mapping[str, str] = MappingProxyType({}),
    local: bool = False,
) -> Gathered:
    """Return what a report collects from captures; ``hosts`` maps addresses to names, ``local`` writes local times."""
    rows = Rows([path.name for path in paths], Clock(local), hosts)
    gathered = Gathered(rows, choose(tags, Known(None)) if tags else None)
    run = Run(paths, gathered, options or Options(strict=True))
    rows.places = Places(run.files, len(paths) > 1, hosts)
    gathered.files = run.files
    while run.step():
        pass
    gathered.take(run.pipeline, run.files, span_of(run.pipeline))
    return gathered


def page_of(*paths: Path, tags: Sequence[str] = ()) -> str:
    """Return the page of a capture; or of two with no differences between them."""
    sides = [Side(gathered_of([path], tags), [path.name]) for path in paths]
    return render(sides, "0", None if len(sides) == 1 else ["one difference"])


def data_of(page: str) -> dict[str, Any]:
    """Return the data that a page holds."""
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


def session_of(page: str) -> dict[str, Any]:
    """Return the data of the only session of a page."""
    (session,) = data_of(page)["sessions"]
    assert isinstance(session, dict)
    return session


def naughty_packets() -> list[Packet]:
    """Return a capture that has each of `NAUGHTY` in every place for a name: as TSAP, as name of a block, as a value."""
    packets: list[Packet] = []
    for number, text in enumerate(NAUGHTY):
        octets = text.encode()[:120]
        talk = Talk(Flow(ports=(40000 + number, 102))).handshake()
        talk.send(0, messages.connect(0xE0, called=octets[:100])).send(1, messages.connect(0xD0, called=octets[:100]))
        talk.send(0, dt(messages.setup(messages.JOB, 0))).send(1, dt(messages.setup(messages.ACK_DATA, 0)))
        item = Item(0x02, len(octets), 7, 0x84, 0)
        talk.send(0, dt(messages.write_job(1, [item], [octets])))
        talk.send(1, dt(messages.write_answer(1, [0x0A])))
        name = octets[:60]
        block = bytes((0x1D, 0, 0, 0, 0, 0, 0, 0, len(name))) + name
        talk.send(0, dt(b"\x32\x01\x00\x00\x00\x02" + len(block).to_bytes(2, "big") + b"\x00\x00" + block))
        talk.send(1, dt(b"\x32\x03\x00\x00\x00\x02\x00\x01\x00\x00\xd2\x09\x1d"))
        read(talk, 3, item, octets)
        packets += talk.packets()
    return packets


def command_of(session: dict[str, Any], how: dict[str, Any]) -> str:
    """Return the command that shows a row, as the script of the page composes it; empty for none."""
    parts = session["command"]
    if not how["show"]:
        return ""
    options = parts["bare"] if how["show"].split(" ")[0] in parts["without"] else parts["options"]
    return f"s7dissect {how['show']}{options} {parts['files'][how['in']] if 'in' in how else parts['all']}"
