"""The screens, driven by keys: what stands on them in both sizes, and that nothing a device says can disturb them."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from unittest.mock import MagicMock

import pytest
from textual.color import Color
from textual.filter import NoColor
from textual.pilot import Pilot

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.transactions.transaction import Transaction
from dissect.online.alerts.problems import STOPPED
from dissect.online.live.events import ALERT
from dissect.online.live.session import Session
from dissect.online.monitor.app import MonitorApp
from dissect.online.monitor.lists import FindingFacts
from dissect.online.monitor.screens import PageScreen
from dissect.wire.text import Clock
from tests.meaning.report.support import UNSAFE, begun, read
from tests.online.monitor.support import CAPTURES, SIZES, hostile, live, of_capture, of_packets, screen

Act = Callable[[MonitorApp, Pilot[bool]], Awaitable[None]]


def drive(session: Session, act: Act, size: tuple[int, int] = (80, 24), directory: Path | None = None) -> bool | None:
    """Show a session, act, and return what the screens gave back."""

    async def run() -> bool | None:
        app = MonitorApp(session, directory=directory)
        async with app.run_test(size=size) as pilot:
            await pilot.pause()
            await act(app, pilot)
        return app.return_value

    try:
        return asyncio.run(run())
    finally:
        session.close()


async def press(pilot: Pilot[bool], *keys: str) -> None:
    """Press keys, and wait until what they cause was drawn."""
    await pilot.press(*keys)
    await pilot.pause()
    await pilot.pause()


def files(directory: Path) -> list[Path]:
    return sorted(directory.iterdir())


def text(app: MonitorApp) -> str:
    return "\n".join(screen(app))


@pytest.mark.parametrize("size", SIZES)
def test_a_capture_in_both_sizes(size: tuple[int, int]) -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        lines = screen(app)
        assert lines[0].startswith("s7dissect nodes7-poll-missing.pcapng")
        assert lines[0].endswith("ENDED")
        assert "18 packets" in lines[0]
        shown = "\n".join(lines)
        assert "CONNECTIONS 0 open of 1" in shown
        assert "127.0.0.1:52220 → 127.0.0.1 " in shown
        assert "closed" in shown
        assert "TRANSACTIONS 3 (2 with errors)" in shown
        assert "Setup communication  granted PDU 960, AmQ 8/8" in shown
        assert len([line for line in lines if line.startswith("E ") and "Read Var  2 of 4 items refused" in line]) == 2
        assert "FINDINGS 4" in shown
        assert any(["transaction.item_error" in line and "4x" in line for line in lines])
        assert "the source has ended" in lines[-1]

    drive(of_capture("nodes7-poll-missing"), act, size)


def test_wide_has_room_for_more() -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        shown = text(app)
        assert "worst of each second" in shown
        assert "127.0.0.1:52220 → 127.0.0.1:102 " in shown
        assert "DB2.DBB400 x4: Invalid address" in shown

    drive(of_capture("nodes7-poll-missing"), act, (200, 60))


def test_it_survives_every_size() -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        for width, height in ((200, 60), (20, 4), (80, 24), (1, 1), (80, 24), (129, 30), (130, 30)):
            await pilot.resize_terminal(width, height)
            await pilot.pause()
            assert len(screen(app)) == height
        assert "TRANSACTIONS 3" in text(app)
        await press(pilot, "enter")
        await pilot.resize_terminal(30, 10)
        await pilot.pause()
        await press(pilot, "end")
        await pilot.resize_terminal(200, 60)
        await pilot.pause()
        assert screen(app)[0].startswith("Transaction 3")

    drive(of_capture("nodes7-poll-missing"), act)


def test_a_taller_screen_shows_more_at_once() -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        before = app.findings.size.height
        await pilot.resize_terminal(80, 60)
        await pilot.pause()
        assert app.findings.size.height > before

    drive(of_capture("blocks"), act)


def test_a_transaction_with_its_fields_and_octets() -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await press(pilot, "enter")
        assert isinstance(app.screen, PageScreen)
        shown = text(app)
        assert "Transaction 3" in shown
        assert "item 4: 0x0a Object does not exist" in shown
        assert "Request: packet 13" in shown
        assert "TPKT" in shown
        assert "3-4" not in screen(app)[-1]
        every = "\n".join([line.text for line in app.screen.page.lines])
        assert "pdu_ref          0x0003" in every
        assert "Answer: packet 14" in every
        assert "03 00 00 43 02 f0 80 32" in every  # the hex view begins with the TPKT
        await press(pilot, "end")
        assert screen(app)[0].rstrip().endswith(f"of {len(app.screen.page._wrapped)}")
        await press(pilot, "escape")
        assert "TRANSACTIONS 3" in text(app)

    drive(of_capture("nodes7-poll-missing"), act)


def test_a_connection_and_a_finding() -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await press(pilot, "tab", "enter")
        assert screen(app)[0].startswith("Finding transaction.item_error")
        assert "packets 13, 14: Read Var DB99.DBB0 x2: 0x0a" in text(app)
        assert "Check the address" in text(app)
        await press(pilot, "escape", "shift+tab", "shift+tab", "enter")
        assert screen(app)[0].startswith("Connection 1")
        assert "closed by the client" in text(app)
        assert "#3" in text(app)

    drive(of_capture("nodes7-poll-missing"), act)


def test_the_filter() -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await press(pilot, "slash")
        await press(pilot, *"setup", "enter")
        assert "filter: setup" in text(app)
        assert [entry.what.number for entry in app.entries.rows if not isinstance(entry.what, tuple)] == [1]
        await press(pilot, "escape")
        assert len(app.entries.rows) == 4
        await press(pilot, "e")
        assert "filter: failed" in text(app)
        assert [entry.failed for entry in app.entries.rows] == [True, True]
        await press(pilot, "l")
        assert "filter: failed slow" in text(app)
        await press(pilot, "e", "l")
        assert len(app.entries.rows) == 4
        assert "filter" not in "\n".join(screen(app)[:-1])

    drive(of_capture("nodes7-poll-missing"), act)


def test_letters_typed_into_the_filter_are_no_orders() -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await press(pilot, "slash", *"pqfsz")
        assert app.is_running
        assert (app.paused, app.entries.frozen, app.zoomed) == (False, False, False)
        await press(pilot, "enter")
        assert app.model.wanted.typed == "pqfsz"

    drive(of_capture("nodes7-poll-missing"), act)


def two_parts() -> tuple[Session, Callable[[], None]]:
    """Return a session on a silent line after one read, and what puts three more reads on the line."""
    talk = begun()
    read(talk, 1)
    first = talk.packets()
    for ref in range(2, 5):
        read(talk, ref)
    later = talk.packets()[len(first) :]
    session, line = live(first)

    def more() -> None:
        line.batches.append(later)

    return session, more


async def until(pilot: Pilot[bool], what: Callable[[], bool]) -> None:
    for _ in range(400):
        if what():
            await pilot.pause()
            return
        await pilot.pause(0.025)
    raise AssertionError("it does not come")


def test_pause_holds_the_screen_and_not_the_capture() -> None:
    session, more = two_parts()

    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await until(pilot, lambda: "TRANSACTIONS 2" in text(app))
        assert screen(app)[0].endswith("LIVE")
        await press(pilot, "p")
        before = screen(app)[1:]
        more()
        await until(pilot, lambda: "PAUSED, 3 new" in text(app))
        assert screen(app)[1:] == before
        await press(pilot, "p")
        await until(pilot, lambda: "TRANSACTIONS 5" in text(app))
        assert screen(app)[0].endswith("LIVE")

    drive(session, act)


@pytest.mark.parametrize("key", ["F", "up"])
def test_freezing_holds_the_transactions_alone(key: str) -> None:
    session, more = two_parts()

    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await until(pilot, lambda: "TRANSACTIONS 2" in text(app))
        await press(pilot, key)
        rows = list(app.entries.rows)
        more()
        await until(pilot, lambda: "FROZEN, 3 newer" in text(app))
        assert "TRANSACTIONS 5" in text(app)
        assert app.entries.rows == rows
        await press(pilot, "end")
        assert len(app.entries.rows) == len(rows) + 3
        assert app.entries.selected is app.entries.rows[-1]

    drive(session, act)


def test_a_silent_line_draws_nothing_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    session, _ = two_parts()

    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await until(pilot, lambda: "TRANSACTIONS 2" in text(app))
        app.show()
        await pilot.pause()
        drawn = [MagicMock(), MagicMock()]
        for pane, refresh in zip((app.entries, app.findings), drawn, strict=True):
            monkeypatch.setattr(pane, "refresh", refresh)
        app.show()
        app.show()
        monkeypatch.undo()
        assert [refresh.called for refresh in drawn] == [False, False]

    drive(session, act)


def test_saving_what_is_shown(tmp_path: Path) -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await press(pilot, "s")
        (first,) = files(tmp_path)
        assert f"to {first.name}" in screen(app)[-1]
        told = first.read_text(encoding="utf-8")
        assert "CONNECTIONS 0 open of 1" in told
        assert "148 µs  Read Var  MB20 x2 = 14 15" in told
        assert "transaction.item_error (4 times)" in told
        await press(pilot, "s", "enter", "s")
        assert len(files(tmp_path)) == 3
        assert first.read_text(encoding="utf-8") == told
        assert "pdu_ref          0x0003" in max(files(tmp_path), key=lambda path: path.stat().st_mtime_ns).read_text(
            encoding="utf-8"
        )

    drive(of_capture("nodes7-poll-missing"), act, directory=tmp_path)


def test_saving_where_nothing_can_be_saved(tmp_path: Path) -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await press(pilot, "s")
        assert screen(app)[-1].startswith("NOT SAVED")

    drive(of_capture("nodes7-poll-missing"), act, directory=tmp_path / "missing")


@pytest.mark.parametrize("size", SIZES)
def test_what_a_device_says_is_text_and_nothing_else(size: tuple[int, int], tmp_path: Path) -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        seen = []
        on_findings = ("escape", "tab", "enter", "s")
        in_filter = ("escape", "slash", *"[/r]", "enter")
        for keys in (("s",), ("enter", "s"), ("pagedown",), on_findings, in_filter):
            await press(pilot, *keys)
            seen.append(text(app))
        assert "[red]X[/]" in "".join(seen)
        assert "\\x1b[2J\\x07" in "".join(seen).replace("\n", "")
        for shown in seen:
            assert UNSAFE.search(shown.replace("\n", "")) is None
        for path in files(tmp_path):
            assert UNSAFE.search(path.read_text(encoding="utf-8").replace("\n", "")) is None
        assert len(files(tmp_path)) == 3

    drive(of_packets(hostile()), act, size, tmp_path)


def test_zoom() -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await press(pilot, "z")
        assert "CONNECTIONS" not in text(app)
        assert app.entries.size.height == 22
        await press(pilot, "z")
        assert "CONNECTIONS" in text(app)

    drive(of_capture("nodes7-poll-missing"), act)


def test_help_names_every_key() -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await press(pilot, "question_mark")
        shown = text(app)
        for key in ("Tab", "Enter", "  z ", "  p ", "  f ", "  / ", "  e ", "  l ", "  s ", "  q, "):
            assert key in shown

    drive(of_capture("nodes7-poll-missing"), act, (200, 60))


def test_the_latest_alert_is_shown_however_many_came_before() -> None:
    session = of_capture("nodes7-poll-missing")
    for number in range(50):
        session.say(f"ALERT warning  rule: number {number}", ALERT)

    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        assert text(app).splitlines()[-1].rstrip() == "ALERT warning  rule: number 49"
        session.say("ALERT warning  rule: number 50 \x1b[2J", ALERT)
        app.model.take(session.poll())
        app.show()
        await pilot.pause()
        assert text(app).splitlines()[-1].startswith("ALERT warning  rule: number 50 ")
        assert UNSAFE.search(text(app).replace("\n", "")) is None

    drive(session, act)


def test_a_problem_of_the_monitor_is_said() -> None:
    session = of_capture("nodes7-poll-missing")
    session.run.problems.tell(STOPPED, "alerts failed and was switched off: no such file \x1b[2J")
    session._hand_over(session.run)

    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        assert app.model.said == 1
        assert "PROBLEM alerts failed" in text(app)
        assert UNSAFE.search(text(app).replace("\n", "")) is None

    drive(session, act)


@pytest.mark.parametrize(("key", "interrupted"), [("q", None), ("ctrl+c", True)])
def test_leaving(key: str, interrupted: bool | None) -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await pilot.press("enter")
        await pilot.press(key)

    assert drive(of_capture("nodes7-poll-missing"), act) is interrupted


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_it_in_order(number: signal.Signals) -> None:
    session, _ = two_parts()
    before = signal.getsignal(number)

    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        os.kill(os.getpid(), number)
        for _ in range(200):
            if app.return_value is not None:
                return
            await asyncio.sleep(0.01)
        raise AssertionError("the signal was not heard")

    assert drive(session, act) is True
    assert signal.getsignal(number) == before
    assert not session.running


def test_no_colour_is_sent_where_none_is_wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")

    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        assert any([isinstance(one, NoColor) for one in app._filters])
        strips = app.screen._compositor.render_strips()
        shown = [strip.apply_filter(NoColor(), Color(0, 0, 0)) for strip in strips]
        styles = [segment.style for strip in shown for segment in strip]
        colours = {style.color.name for style in styles if style is not None and style.color is not None}
        assert colours <= {"default"}
        assert any([line.startswith("E ") for line in screen(app)])  # what is red is a letter too

    drive(of_capture("nodes7-poll-missing"), act)


SCREENS = re.findall(
    r"```screen\n(.*?)\n```", (CAPTURES.parent / "docs" / "monitor.md").read_text(encoding="utf-8"), re.DOTALL
)


def test_the_screens_in_the_document_are_real() -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        assert text(app) == SCREENS[0]
        await press(pilot, "enter")
        assert text(app) == SCREENS[1]

    drive(of_capture("nodes7-poll-missing"), act)


# ---- what weighs most -----------------------------------------------------------------------------------------------


def found(*slugs: str) -> list[FindingFacts]:
    return [FindingFacts(CATALOGUE[slug], 1, ()) for slug in slugs]


WARNINGS = [slug for slug, rule in CATALOGUE.items() if rule.severity == "warning"][:8]
ERRORS = [slug for slug, rule in CATALOGUE.items() if rule.severity == "error"]


@pytest.mark.parametrize("looked", [False, True])
def test_errors_are_seen_though_warnings_came_first(looked: bool) -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        if looked:  # somebody was there, and went on
            await press(pilot, "tab", "shift+tab")
        app.findings.update_rows(found(*WARNINGS), "FINDINGS")
        app._arrange()
        await pilot.pause()
        app.findings.update_rows(found("security.plc_start", "security.plc_stop", *WARNINGS), "FINDINGS")
        app._arrange()
        await pilot.pause()
        lines = screen(app)
        at = next(number for number, line in enumerate(lines) if "FINDINGS" in line)
        assert [line.split()[1] for line in lines[at + 1 : at + 3]] == ["security.plc_start", "security.plc_stop"]
        assert lines[at].endswith(f"({10 - (len(lines) - at - 2)} more)")

    drive(of_capture("nodes7-poll-missing"), act)


def test_all_errors_have_room_before_warnings() -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        app.findings.update_rows(found(*ERRORS[:8], *WARNINGS), "FINDINGS")
        app._arrange()
        await pilot.pause()
        lines = screen(app)
        assert [line.split()[1] for line in lines if line.startswith("error ")] == ERRORS[:8]
        assert any(["TRANSACTIONS" in line for line in lines])
        app.findings.update_rows(found(*ERRORS[:15], *WARNINGS), "FINDINGS")
        app._arrange()
        await pilot.pause()
        lines = screen(app)
        seen = len([line for line in lines if line.startswith("error ")])
        assert 8 <= seen < 15
        assert any([line.endswith(f"({15 + len(WARNINGS) - seen} more)") for line in lines])

    drive(of_capture("nodes7-poll-missing"), act)


def test_rows_above_are_counted_where_somebody_reads_further_down() -> None:
    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        app.findings.update_rows(found(*ERRORS[:2], *WARNINGS), "FINDINGS")
        app._arrange()
        await press(pilot, "tab", "end")
        assert any([re.search(r"FINDINGS  \(\d more above\)", line) for line in screen(app)])
        await press(pilot, "tab")
        assert ERRORS[0] in text(app)

    drive(of_capture("nodes7-poll-missing"), act)


def test_local_time_on_every_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "Asia/Kolkata")
    time.tzset()

    async def act() -> None:
        session = of_capture("nodes7-poll-missing")
        app = MonitorApp(session, clock=Clock(local=True))
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.pause()
            assert "07:01:15 +05:30" in screen(app)[0]
            assert not [line for line in screen(app) if " 01:31:" in line]
            await press(pilot, "enter")
            assert "2026-11-21 07:01:15.612989 +05:30" in text(app)
        session.close()

    try:
        asyncio.run(act())
    finally:
        monkeypatch.undo()
        time.tzset()


def test_an_expression_selects_what_rolls_by() -> None:
    session, _ = two_parts()

    async def act(app: MonitorApp, pilot: Pilot[bool]) -> None:
        await until(pilot, lambda: "TRANSACTIONS 2" in text(app))
        assert len(app.entries.rows) == 3
        await press(pilot, "f")
        app._input.value = "number == 2 and latncy > 1s"
        await press(pilot, "enter")
        assert app.foot.left.startswith("NOT SELECTED: no field 'latncy'; did you mean latency")
        assert len(app.entries.rows) == 3
        app._input.value = "number == 2"
        await press(pilot, "enter")
        assert "filter: number == 2" in text(app)
        assert [entry.what.number for entry in app.entries.rows if isinstance(entry.what, Transaction)] == [2]
        await press(pilot, "escape")
        assert len(app.entries.rows) == 3

    drive(session, act)
