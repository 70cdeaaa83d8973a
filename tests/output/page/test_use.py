"""How the report is used in a browser: tables follow the time, rows are copied and saved, plots are read by keyboard, and
axe-core finds nothing to complain about."""

from __future__ import annotations

import csv
import io
import re
import shlex
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest

from dissect.output.page import gathered as room
from dissect.output.page.rendering import Side, render
from dissect.wire.build import COMPILED
from dissect.wire.text import Clock, cell
from tests.cli.support import run
from tests.meaning.report.support import WORD, begun, read, saved
from tests.output.page.browser import Browser, started
from tests.output.page.support import data_of, gathered_of, naughty_packets, page_of
from tests.output.page.test_script import tools
from tests.properties.messages import Item
from tests.properties.packets import EPOCH_NS, MS, Flow

HOUR: Final = 3600 * 10**9
#: What looks for what keeps people out, in all of the page, unfolded.
AXE: Final = """const done = arguments[0];
    document.querySelectorAll('details').forEach((one) => { one.open = true; });
    axe.run(document, {resultTypes: ['violations']}).then(
        (found) => done(found.violations.map((one) => `${one.id}: ${one.nodes[0].html.slice(0, 200)}`)),
        (error) => done([String(error)]));"""


#: Keeps what is saved.
KEEP: Final = """window.kept = []; const made = URL.createObjectURL;
    URL.createObjectURL = (blob) => { window.kept.push(blob); return made.call(URL, blob); };"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One browser for all of these tests."""
    with started() as browser:
        yield browser


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, dict[str, Any]]:
    """A capture of four hours past midnight with two PLCs, of which more failed than the page lists: it, its page, its data."""
    folder = tmp_path_factory.mktemp("long")
    packets = []
    for number, host in enumerate(("10.0.0.2", "10.0.0.3")):
        talk = begun(Flow("10.0.0.9", host, (41000 + number, 102)))
        for ref in range(1, 300):
            read(talk, ref, WORD, 0x0A if ref % 3 == 0 else ref.to_bytes(2, "big"))
        start = EPOCH_NS - EPOCH_NS % (24 * HOUR) + 22 * HOUR + number * MS
        packets += talk.packets(start_ns=start, step_ns=4 * HOUR // 620)
    capture = saved(folder / "long.pcapng", sorted(packets))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(room, "MAX_FAILED", 60)
        patch.setattr(room, "MAX_CONNECTIONS", 1)
        page = page_of(capture)
    path = folder / "long.html"
    path.write_text(page, encoding="utf-8")
    return capture, path, data_of(page)["sessions"][0]


def shown(browser: Browser, table: str) -> str:
    """Return what a table says of its rows."""
    return browser.texts(f"#table-{table} .head [role=status]")[0]


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_tables_follow_the_time_and_say_what_is_not_in_the_page(
    browser: Browser, long: tuple[Path, Path, dict[str, Any]], capfdbinary: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The number that a table says of the time that is shown is how many rows the command beside it lists."""
    capture, path, _ = long
    monkeypatch.chdir(capture.parent)
    browser.open(path)
    assert shown(browser, "failed") == "60 of 198 rows are in this page."
    assert shown(browser, "functions").endswith(" rows.")
    for press in ("Zoom in", "Zoom in", "Later", "Show all of the time"):
        browser.click(f"#zoom button[aria-label='{press}']")
        whole = press == "Show all of the time"
        for table in ("failed", "connections"):
            said = re.fullmatch(
                r"(\d+) of ([\d,]+) rows?( in the time shown)? are in this page\.", shown(browser, table)
            )
            assert said is not None, shown(browser, table)
            assert bool(said[3]) is not whole
            (command,) = browser.texts(f"#table-{table} .rest code")
            ran = run(capfdbinary, *shlex.split(command)[1:], "-T", "jsonl")
            assert (ran.code, len(ran.out.splitlines())) == (0, int(said[2])), command
        rows = [int(text) for text in browser.texts("#table-failed tbody tr:not(.how) td:nth-child(2)")]
        assert rows
        if not whole:
            assert "of the whole capture" in shown(browser, "functions")
            begin, end = browser.run(
                "return [...document.querySelectorAll('#zoom [role=status]')][0].textContent"
            ).split(" \u2013 ")
            times = browser.texts("#table-failed tbody tr:not(.how) td:nth-child(3)")
            assert begin <= min(times)
            assert max(times) <= end


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_a_link_to_a_row_outside_the_time_shows_all_of_it(
    browser: Browser, long: tuple[Path, Path, dict[str, Any]]
) -> None:
    _, path, data = long
    browser.open(path)
    (failed,) = [one for one in data["tables"] if one["name"] == "failed"]
    for _ in range(4):
        browser.click("#zoom button[aria-label='Zoom in']")
    key = failed["rows"][0]["key"]
    assert browser.count(f"#{key}") == 0
    browser.run("location.hash = arguments[0]; dispatchEvent(new HashChangeEvent('hashchange'))", f"#{key}")
    assert browser.run("return document.querySelector('tr.found').id") == key
    assert browser.count("#table-failed .rest code") == 1


def test_the_axis_has_both_days_and_the_zone(browser: Browser, long: tuple[Path, Path, dict[str, Any]]) -> None:
    _, path, _ = long
    browser.open(path)
    first, second = browser.texts("#plot-rates text.date")
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", first)
    assert first < second
    assert browser.texts("#plot-rates text.zone") == ["UTC"]
    assert all(
        [re.fullmatch(r"\d\d:\d\d", text) for text in browser.texts("#plot-rates text.quiet[text-anchor=middle]")]
    )


def test_each_plot_is_one_stop_and_its_points_are_reached_by_arrows(
    browser: Browser, long: tuple[Path, Path, dict[str, Any]]
) -> None:
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    _, path, _ = long
    browser.open(path)
    stops = "return [...document.querySelectorAll('svg.plot')].map((one) => one.querySelectorAll('[tabindex=\"0\"]').length)"
    assert set(browser.run(stops)) <= {0, 1}
    assert browser.count("svg.plot a.hit") > 20
    label = "return document.activeElement.getAttribute('aria-label')"
    first = browser.driver.find_element(By.CSS_SELECTOR, "#plot-rates a.hit[tabindex='0']")
    browser.run("arguments[0].focus()", first)
    names = []
    for key in (Keys.ARROW_RIGHT, Keys.ARROW_RIGHT, Keys.ARROW_LEFT, Keys.END, Keys.HOME):
        names.append(browser.run(label))
        browser.driver.switch_to.active_element.send_keys(key)
    assert names[1] == names[3] != names[0]
    assert browser.run(label) == names[0]
    assert all([re.search(r"\d\d:\d\d:\d\d\.\d{3} UTC$", name) for name in names])  # what, and when
    browser.driver.switch_to.active_element.send_keys(Keys.ARROW_RIGHT)
    assert browser.run(stops.replace("querySelectorAll('svg.plot')", "querySelectorAll('#plot-rates svg.plot')")) == [1]


def test_a_card_shows_its_plc(browser: Browser, long: tuple[Path, Path, dict[str, Any]]) -> None:
    """Two of them, with answer times as small plots on one scale; one that has nothing to say has no part."""
    _, path, data = long
    browser.open(path)
    assert browser.texts("#plcs h3") == [card["host"] for card in data["plcs"]["rows"]] == ["10.0.0.2", "10.0.0.3"]
    heads = browser.texts("#plcs article:first-child h4")
    assert heads == ["Answer times", "Clients", "Polls", "Slowest answers", "Refused addresses"]
    scales = """return [...document.querySelectorAll('#plcs svg.plot')].map((one) =>
        [...one.querySelectorAll('text[text-anchor=end]:not(.zone)')].map((text) => text.textContent).join())"""
    assert len(set(browser.run(scales))) == 1
    assert browser.count("#plcs svg.timed path.cells") >= 2
    href = browser.run("return document.querySelector('#plcs td a').getAttribute('href')")
    browser.open(path, fragment=href)
    assert browser.count("tr.found") == 1


def test_what_is_saved_is_what_is_shown_for_programs(browser: Browser, long: tuple[Path, Path, dict[str, Any]]) -> None:
    """All rows that match, numbers as numbers, times in UTC; the same is copied."""
    _, path, data = long
    browser.open(path)
    browser.run(KEEP)
    browser.run("navigator.clipboard.writeText = async (text) => { window.copied = text; };")
    search = """const box = document.querySelector('#table-slowest input');
        box.value = '10.0.0.3'; box.dispatchEvent(new Event('input'))"""
    browser.run(search)
    browser.click("#table-slowest .buttons button[aria-label^=Save]")
    browser.click("#table-slowest .buttons button[aria-label^=Copy]")
    text = browser.driver.execute_async_script("window.kept[0].text().then(arguments[0])")
    rows = list(csv.reader(io.StringIO(text.removeprefix("\ufeff"), newline="")))
    (slowest,) = [one for one in data["tables"] if one["name"] == "slowest"]
    wanted = [row["cells"] for row in slowest["rows"] if "10.0.0.3" in row["cells"][3]]
    assert rows[0] == ["number", "time (UTC)", "packets", "from → to", "answer (ns)", "function", "what"]
    assert [(int(row[0]), int(row[4])) for row in rows[1:]] == [(cells[0], cells[4]) for cells in wanted]
    assert len(rows) > 26  # more than are shown at once
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z", rows[1][1])
    assert [line.split("\t") for line in browser.run("return window.copied").split("\n")] == rows
    assert browser.console() == []


def test_a_saved_cell_is_no_formula(browser: Browser, tmp_path: Path) -> None:
    """As in the CSV of the commands."""
    path = tmp_path / "naughty.html"
    path.write_text(page_of(saved(tmp_path / "naughty.pcapng", naughty_packets())), encoding="utf-8")
    browser.open(path)
    browser.run(KEEP)
    cells = []
    for number, name in enumerate(("operations", "connections", "variables")):
        browser.click(f"#table-{name} .buttons button[aria-label^=Save]")
        text = browser.driver.execute_async_script(f"window.kept[{number}].text().then(arguments[0])")
        cells += [one for row in csv.reader(io.StringIO(text.removeprefix("\ufeff"), newline="")) for one in row]
    assert len(cells) > 100
    assert [one for one in cells if cell(one) != one] == []


def test_above_sixty_pairs_there_is_a_matrix_and_names_keep_their_ends(browser: Browser, tmp_path: Path) -> None:
    packets = []
    for client in range(8):
        for server in range(9):
            talk = begun(Flow(f"10.0.{client}.1", f"10.1.{server}.2", (42000 + server, 102)))
            read(talk, 1, WORD, 0x0A if (client, server) == (3, 4) else b"\0\1")
            packets += talk.packets(start_ns=EPOCH_NS + (client * 9 + server) * MS)
    talk = begun(Flow(ports=(43000, 102)))
    for ref in range(1, 13):
        read(talk, ref, Item(0x02, 200, 65000 + ref % 2, 0x84, 65000 * 8))
    path = tmp_path / "matrix.html"
    path.write_text(page_of(saved(tmp_path / "m.pcapng", sorted([*packets, *talk.packets()]))), encoding="utf-8")
    browser.open(path, 390)
    assert browser.count("#plot-talks path.edge") == 0
    assert browser.count("#plot-talks rect.box") == 73
    assert browser.count("#plot-talks rect.box.warning") == 1
    assert browser.overflow() <= 0
    labels = browser.texts("#plot-polls svg text[text-anchor=start]")
    assert len({text for text in labels if "Read Var" in text}) == 2  # they differ in the number of the block only
    assert browser.count("#plot-lanes, #plot-tags") == 0


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_a_pair_without_a_row_has_a_command_to_copy(
    browser: Browser, long: tuple[Path, Path, dict[str, Any]], capfdbinary: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of two pairs the page lists the connections of one."""
    capture, path, _ = long
    monkeypatch.chdir(capture.parent)
    browser.open(path)
    assert browser.count("#plot-talks a.hit") == browser.count("#plot-talks g.stop[role=button]") == 1
    browser.run("navigator.clipboard.writeText = async (text) => { window.copied = text; };")
    browser.click("#plot-talks g.stop")
    command = browser.run("return window.copied")
    ran = run(capfdbinary, *shlex.split(command)[1:], "-T", "jsonl")
    assert (ran.code, len(ran.out.splitlines())) == (0, 300)


@pytest.mark.parametrize("made", ["srcdoc", "blob"])
def test_a_frame_shows_it_as_a_window_does(
    browser: Browser, long: tuple[Path, Path, dict[str, Any]], tmp_path: Path, made: str
) -> None:
    """Another page may embed it unchanged, in a frame that may run scripts and nothing else."""
    _, path, data = long
    around = tmp_path / "around.html"
    around.write_text(
        "<!DOCTYPE html><title>around</title><iframe sandbox='allow-scripts' width=1000 height=700></iframe>",
        encoding="utf-8",
    )
    browser.driver.get("about:blank")
    browser.driver.get_log("browser")
    browser.driver.get(around.as_uri())
    load = """const [page, made, done] = arguments, frame = document.querySelector('iframe');
        const blob = new Blob([page], {type: 'text/html'});
        frame.onload = () => done();
        if (made === 'srcdoc') frame.srcdoc = page; else frame.src = URL.createObjectURL(blob);"""
    browser.driver.execute_async_script(load, path.read_text(encoding="utf-8"), made)
    browser.driver.switch_to.frame(0)
    try:
        assert browser.run("return document.documentElement.dataset.ready") == "yes"
        assert browser.count("#plot-rates rect.bar") > 20
        browser.click("#plcs td a")
        (polls,) = [one for one in data["tables"] if one["name"] == "polls"]
        found = """const done = arguments[0];
            const look = () => (document.querySelector('tr.found') ? done(1) : setTimeout(look, 20)); look();"""
        assert browser.driver.execute_async_script(found) == 1
        assert browser.run("return document.querySelector('tr.found').id") in {row["key"] for row in polls["rows"]}
        browser.click("nav a[href='#completeness']")
        assert browser.run("return document.documentElement.dataset.ready") == "yes"
    finally:
        browser.driver.switch_to.default_content()
    assert browser.run("return document.title") == "around"
    assert browser.console() == []


def axe() -> str:
    """Return axe-core."""
    return (tools() / "node_modules" / "axe-core" / "axe.min.js").read_text(encoding="utf-8")


@pytest.mark.parametrize(("theme", "width"), [("light", 1280), ("dark", 390)])
def test_axe_has_no_complaint(
    browser: Browser, long: tuple[Path, Path, dict[str, Any]], theme: str, width: int
) -> None:
    features = [{"name": "prefers-color-scheme", "value": theme}]
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    try:
        browser.open(long[1], width)
        browser.click("#table-failed tbody button")
        browser.driver.execute_cdp_cmd("Runtime.evaluate", {"expression": axe()})
        assert browser.driver.execute_async_script(AXE) == []
    finally:
        browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_paper_begins_with_the_verdict_and_the_plots(browser: Browser, long: tuple[Path, Path, dict[str, Any]]) -> None:
    _, path, _ = long
    browser.open(path)
    places = """return ['verdict', 'plots', 'plcs', 'findings', 'tables'].map((id) =>
        document.getElementById(id).getBoundingClientRect().top)"""
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        found = browser.run(places)
        assert found == sorted(found)
        hidden = """return [...document.querySelectorAll('button, .rest, nav')]
            .filter((one) => one.offsetHeight && !one.closest('th')).length"""
        assert browser.run(hidden) == 0
    finally:
        browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def test_what_is_not_permitted_is_copied_the_older_way(
    browser: Browser, long: tuple[Path, Path, dict[str, Any]]
) -> None:
    """In a frame that may not write to the clipboard."""
    from selenium.webdriver.common.by import By

    _, path, _ = long
    browser.open(path)
    browser.run("""navigator.clipboard.writeText = () => Promise.reject(new Error('no'));
        document.addEventListener('copy', (event) => { window.copied = event.target.value; });""")
    # A person's click: any other is not permitted to copy either.
    browser.driver.find_element(By.CSS_SELECTOR, "#verdict button.copy").click()
    done = (
        "const done = arguments[0], look = () => (window.copied ? done(window.copied) : setTimeout(look, 20)); look();"
    )
    assert browser.driver.execute_async_script(done).startswith("s7dissect show -V --frame ")


def test_a_clock_that_is_set_back_an_hour_shows_both_zones(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the end of summer time: times of the page are those of the clock of then, as in its findings."""
    monkeypatch.setenv("TZ", "Europe/Berlin")
    time.tzset()
    try:
        change = 1_792_890_000 * 10**9  # 2026-10-25 01:00 UTC
        talk = begun()
        for ref in range(1, 60):
            read(talk, ref, WORD, b"\0\1")
        packets = talk.packets(start_ns=change - HOUR, step_ns=2 * HOUR // 120)
        gathered = gathered_of([saved(tmp_path / "a.pcapng", packets)], local=True)
        page = render([Side(gathered, ["a.pcapng"])], "0")
        clock = Clock(True)
        times = [when.rpartition(".")[0] + when[-7:] for when in [clock.moment(packet.time_ns) for packet in packets]]
    finally:
        monkeypatch.undo()
        time.tzset()
    (session,) = data_of(page)["sessions"]
    assert session["zones"] == [[0, 7200, "+02:00"], [3600.0, 3600, "+01:00"]]
    path = tmp_path / "clock.html"
    path.write_text(page, encoding="utf-8")
    browser.open(path)
    browser.click("#table-slowest > button")
    browser.click("#table-slowest th:nth-child(3) button")
    said = browser.texts("#table-slowest tbody tr:not(.how) td:nth-child(3)")
    assert len(said) == 60
    assert {text[:8] + text[-7:] for text in said} <= {text[11:] for text in times}
    assert {text[-6:] for text in said} == {"+02:00", "+01:00"}
