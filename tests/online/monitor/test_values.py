"""The screen of watched variables: values, changes, trends, tags, names of hosts; bounded; and tags on the other screens."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Final

from textual.pilot import Pilot

from dissect.engine.pipeline import Options
from dissect.engine.transactions.naming import Naming
from dissect.meaning.report.words import Places
from dissect.meaning.tags import load_tags
from dissect.online.live.session import Session
from dissect.online.monitor.app import MonitorApp
from dissect.online.monitor.details import watched_details
from dissect.online.monitor.rows import watched_heads
from dissect.online.monitor.screens import ValuesScreen
from dissect.online.monitor.watched import LATEST, SECONDS, Watched
from dissect.output.variables.choosing import Known, choose
from dissect.packets.source.files import open_capture
from tests.meaning.report.support import ROOT, UNSAFE, begun, transactions
from tests.meaning.tags.support import tank_file
from tests.online.monitor.support import SIZES, ended, screen
from tests.online.monitor.test_app import SCREENS, Act, files, press
from tests.output.variables.support import BYTE, REAL, WORD, db, reads, real, writes
from tests.properties.packets import Packet

LEVELS: Final = (1.0, 2.0, 2.0, 4.0, 3.0)


def tank() -> list[Packet]:
    """Return a talk, half a second from packet to packet, in which a level is read every second, and is written."""
    talk = begun()
    for ref, level in enumerate(LEVELS, 1):
        reads(talk, ref, (db(BYTE, 0, 10), struct.pack(">fBBhh", level, 1, 0, 215, 0)))
    writes(talk, 9, (db(REAL, 0), real(8.0), 0xFF), (db(WORD, 6), b"\0\1", 0x05))
    return talk.packets(step_ns=500_000_000)


def with_tags(session_of: Callable[[Naming], Session], folder: Path) -> Session:
    """Return a session with the tags of the tank."""
    return session_of(load_tags([tank_file(folder)]).naming())


def of_tank(naming: Naming | None = None) -> Session:
    from tests.online.live.support import Clock, Line

    line = Line(Clock(), [tank()], ends=True)
    return ended(Session(lambda: line, Options(strict=True, naming=naming), name="fake0"))


def drive(session: Session, act: Act, size: tuple[int, int] = (80, 24), **more: object) -> None:
    """Show a session, and act."""
    import asyncio

    async def run() -> None:
        app = MonitorApp(session, **more)  # type: ignore[arg-type]  # what a test gives
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            await act(app, pilot)

    try:
        asyncio.run(run())
    finally:
        session.close()


def test_values_by_tags_with_their_trend(tmp_path: Path) -> None:
    for size in SIZES:

        async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
            await press(pilot, "v")
            lines = screen(app)
            assert lines[0].startswith("s7dissect fake0")
            assert "VALUES 5 (1 refused)" in lines[1]
            (level,) = [line for line in lines if "Tank.Level" in line]
            assert "8.0 m" in level
            assert "W 10.0.0.1" in level  # it was written last
            assert "█" in level
            (pump,) = [line for line in lines if "Tank.Pump" in line]
            assert "true" in pump
            # Names come first; what has none stands below.
            names = [line.split()[0] for line in lines[2:7]]
            assert names[:3] == ["Tank.Level", "Tank.Pump", "Tank.Temp"]
            await press(pilot, "enter")
            shown = "\n".join(screen(app))
            assert "Variable Tank.Level" in shown
            assert "6 values, 4 changes" in shown
            assert "was 3.0 m" in shown
            await press(pilot, "escape")
            assert isinstance(app.screen, ValuesScreen)
            await press(pilot, "escape")
            assert "TRANSACTIONS" in "\n".join(screen(app))

        drive(with_tags(of_tank, tmp_path), act, size)


def test_only_what_is_asked_for_is_watched() -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await press(pilot, "v")
        lines = screen(app)
        assert "VALUES 1 " in lines[1]
        assert lines[2].startswith("DB1.DBD0")
        assert "8.0" in lines[2]

    drive(of_tank(), act, wanted=choose(["DB1.DBD0:REAL"], Known(None)))


def test_hosts_have_their_names_on_every_screen() -> None:
    places = Places([], False, {"10.0.0.1": "panel", "10.0.0.2": "press"})

    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        shown = "\n".join(screen(app))
        assert "panel:" in shown
        assert "→ press" in shown
        assert not [line for line in shown.splitlines() if "10.0.0.2" in line]
        await press(pilot, "v")
        assert "W panel" in "\n".join(screen(app))
        await press(pilot, "enter")
        assert "press:102" in "\n".join(screen(app))

    drive(of_tank(), act, (200, 60), places=places)


def test_values_are_saved_as_text(tmp_path: Path) -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await press(pilot, "v", "s")
        (file,) = files(tmp_path)
        assert "DB1.DBD0 REAL = 8.0" in file.read_text(encoding="utf-8")

    drive(of_tank(), act, directory=tmp_path)


def test_tags_stand_on_the_main_screen_and_behind_it(tmp_path: Path) -> None:
    naming = load_tags([ROOT / "captures" / "tags" / "valve.csv"]).naming()
    path = ROOT / "captures" / "nodes7-write.pcapng"
    session = ended(Session(lambda: open_capture(str(path)), Options(strict=True, naming=naming), name=path.name))

    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        shown = "\n".join(screen(app))
        assert "Valve.pressure" in shown
        assert "Valve.name (DB2.DBB20 x8) = 'Valve'" in shown
        await press(pilot, "end", "enter")
        assert "Valve.name (DB2.DBB20 x8) = 'Valve'" in "\n".join(screen(app))

    drive(session, act, (200, 60))


def test_the_screen_in_the_document_is_real() -> None:
    naming = load_tags([ROOT / "captures" / "tags" / "valve.csv"]).naming()
    path = ROOT / "captures" / "nodes7-poll.pcapng"
    session = ended(Session(lambda: open_capture(str(path)), Options(strict=True, naming=naming), name=path.name))

    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await press(pilot, "v")
        assert "\n".join(screen(app)) == SCREENS[2]

    drive(session, act)


def test_a_name_from_the_wire_or_a_file_cannot_disturb_the_screen(tmp_path: Path) -> None:
    tags = tmp_path / "evil.csv"
    tags.write_text('address,type,name,unit\nDB1.DBD0,REAL,"[red]X[/]\x1b[2J",\u202e\n', encoding="utf-8")
    naming = load_tags([tags]).naming()

    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await press(pilot, "v")
        lines = screen(app)
        assert any(["[red]X[/]" in line for line in lines])
        assert not [line for line in lines if UNSAFE.search(line)]

    drive(of_tank(naming), act)


# ---- the model ------------------------------------------------------------------------------------------------------


def test_a_trend_is_the_latest_number_of_each_second() -> None:
    watched = Watched(choose(["DB1.DBD0:REAL"], Known(None)))
    watched.take(transactions(tank()))
    (facts,) = watched.facts
    assert (facts.count, facts.changes, facts.latest.value) == (6, 4, 8.0)
    now = int(facts.latest.time_ns)
    points = facts.trend(now, 6)
    assert points[-1] == 8.0
    assert [point for point in points if not math.isnan(point)][:2] == [1.0, 2.0]
    assert facts.trend(now + 3_000_000_000, 4) == [8.0] * 4  # it stays until another comes
    assert len(facts.trend(now, SECONDS)) == SECONDS


def test_what_never_changed_is_not_said_to_have_changed() -> None:
    talk = begun()
    for ref in (1, 2):
        reads(talk, ref, (db(WORD, 0), b"\0\1"))
    watched = Watched()
    watched.take(transactions(talk.packets()))
    (facts,) = watched.facts
    lines = [line.text for line in watched_details(facts)]
    assert lines[2] == "  2 values, 0 changes"
    assert lines[4] == "Where it was seen first"
    assert len(lines) == 6
    assert "changed" not in watched_heads("VALUES", 80)


def test_what_is_watched_is_bounded() -> None:
    talk = begun()
    for ref in range(1, 200):
        reads(talk, ref, (db(WORD, 2 * (ref % 8)), struct.pack(">H", ref)))
    watched = Watched(most=3)
    watched.take(transactions(talk.packets()))
    assert len(watched.facts) == 3
    assert watched.not_listed > 100
    assert max([len(facts.rows) for facts in watched.facts]) <= LATEST
