"""The report in a real browser: it draws what it holds, sorts, searches and links, asks the network for nothing, and text from
the wire neither runs nor breaks its layout."""

from __future__ import annotations

import base64
import os
import re
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any, Final

import pytest

from dissect.output.page.rendering import Side, render, script
from dissect.wire.text import duration_text
from tests.meaning.report.schemas import ROOT
from tests.meaning.report.support import UNSAFE, WORD, begun, read, saved
from tests.output.page.browser import Browser, started
from tests.output.page.support import NAUGHTY, data_of, gathered_of, naughty_packets, page_of
from tests.promises import hostile
from tests.properties.messages import Item
from tests.properties.packets import EPOCH_NS, MS, Flow

OWN: Final = ROOT / "captures"
PLANT: Final = OWN / "crafted" / "plus-plant.pcapng"
WIDTHS: Final = (390, 1024, 1920)
#: Where screenshots go that somebody wants to look at.
SHOTS: Final = os.environ.get("S7DISSECT_SCREENSHOTS")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One browser for all of these tests."""
    with started() as browser:
        yield browser


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("pages")


def written(folder: Path, name: str, page: str) -> Path:
    path = folder / f"{name}.html"
    path.write_text(page, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def busy(folder: Path) -> tuple[Path, dict[str, Any]]:
    """A page with everything: errors, a gap, two PLCs, polls, more rows than are shown at once."""
    talk = begun()
    for ref in range(1, 60):
        read(talk, ref, WORD, 0x0A if ref % 7 == 0 else ref.to_bytes(2, "big"))
        if ref == 30:
            talk.skip(1, 200)
    other = begun(Flow("10.0.0.9", "10.0.0.77", (40001, 102)))
    for ref in range(1, 8):
        read(other, ref)
    packets = sorted([*talk.packets(step_ns=20 * MS), *other.packets(start_ns=EPOCH_NS + 5 * MS, step_ns=50 * MS)])
    page = page_of(saved(folder / "busy.pcapng", packets), tags=["DB10.DBW4"])
    return written(folder, "busy", page), data_of(page)["sessions"][0]


def test_every_plot_has_its_data(browser: Browser, busy: tuple[Path, dict[str, Any]]) -> None:
    path, data = busy
    browser.open(path)
    filled = sum([1 for one in data["rates"]["bins"] for count in one[1:] if count])
    assert filled > 20
    assert browser.count("#plot-rates rect.bar") == filled
    drawn = "".join(
        browser.run(
            "return [...document.querySelectorAll('#plot-times path.cells')].map((one) => one.getAttribute('d'))"
        )
    )
    assert drawn.count("M") == len(data["times"]["cells"]) > 20
    box = re.search(r"M([0-9.]+) ([0-9.]+)h", drawn)
    assert box is not None
    hover = """const root = document.querySelector('#plot-times svg.timed'), frame = root.getBoundingClientRect();
        const ratio = frame.width / root.viewBox.baseVal.width;
        root.querySelector('.ground').dispatchEvent(new PointerEvent('pointermove', {bubbles: true,
            clientX: frame.left + (arguments[0] + 1) * ratio, clientY: frame.top + (arguments[1] + 1) * ratio}));
        return document.getElementById('tip').textContent;"""
    assert re.match(r"(1 answer|\d+ answers) in ", browser.run(hover, float(box[1]), float(box[2])))
    answers = sum([cell[2] for cell in data["times"]["cells"]])
    assert browser.count("#plot-times circle.point") == max(5, answers // 20)
    assert browser.count("#plot-spreads a.hit") == len(data["spreads"]["rows"]) == 4
    assert browser.count("#plot-polls a.hit") == len(data["polls"]["rows"]) == 2
    assert browser.count("#plot-talks path.edge") == len(data["talks"]["pairs"]) == 2
    assert browser.count("#plot-talks path.edge.warning") == 1
    assert len(data["gaps"]) == 1
    for plot in ("rates", "times", "tag-1"):
        assert browser.count(f"#plot-{plot} svg.timed rect.gap") == 1, plot
    assert {one["host"] for one in data["tags"]["series"]} == {"10.0.0.77", data["talks"]["pairs"][0]["server"]}
    path_of_steps = browser.run(
        "return document.querySelector('#plot-tag-2 path.line, #plot-tag-1 path.line').getAttribute('d')"
    )
    assert path_of_steps.startswith("M")
    assert browser.count("#plot-rates a[href='#f-transaction.item_error']") >= 1
    browser.open(written(path.parent, "plant", page_of(PLANT, tags=['DB1."setpoint"'])))
    assert browser.texts("#plot-times .legend li") == ["1 answer", "one of the slowest"]  # no cell has more
    assert browser.count("#plot-lanes svg.timed rect.span") == 7
    assert browser.texts("#plot-lanes g text") == ["STOP", "RUN"]
    assert browser.count("#plot-polls") == 0  # S7comm-plus numbers every request; nothing else is polled
    assert browser.count("#plot-tag-1 g.writer") == 1


def test_a_step_is_not_drawn_across_a_gap(browser: Browser, busy: tuple[Path, dict[str, Any]]) -> None:
    path, data = busy
    browser.open(path)
    (series,) = [one for one in data["tags"]["series"] if any([step[5] for step in one["steps"]])]
    number = data["tags"]["series"].index(series) + 1
    drawn = browser.run(f"return document.querySelector('#plot-tag-{number} path.line').getAttribute('d')")
    assert drawn.count("M") == 2


def test_tables_sort_search_and_show_more(browser: Browser, busy: tuple[Path, dict[str, Any]]) -> None:
    path, _ = busy
    browser.open(path)
    table = "#table-slowest"
    assert browser.count(f"{table} tbody tr:not(.how)") == 25
    browser.click(f"{table} > button")
    assert browser.count(f"{table} tbody tr:not(.how)") > 60
    numbers = f"{table} tbody tr:not(.how) td:nth-child(2)"
    browser.click(f"{table} th:nth-child(2) button")
    found = [int(text) for text in browser.texts(numbers)]
    assert found == sorted(found)
    assert (
        browser.run(f"return document.querySelector('{table} th:nth-child(2)').getAttribute('aria-sort')")
        == "ascending"
    )
    browser.click(f"{table} th:nth-child(2) button")
    assert [int(text) for text in browser.texts(numbers)] == found[::-1]
    search = "const box = document.querySelector(arguments[0]); box.value = arguments[1]; box.dispatchEvent(new Event('input'))"
    browser.run(search, f"{table} input", "10.0.0.77 Setup")
    assert browser.count(f"{table} tbody tr:not(.how)") == 1
    browser.click(f"{table} tbody button")
    assert browser.texts(f"{table} tr.how code")[0].startswith("s7dissect show -V --frame ")
    assert browser.texts(f"{table} tr.how code")[1].startswith("frame.number == ")


def test_plots_rows_and_findings_lead_to_each_other(browser: Browser, busy: tuple[Path, dict[str, Any]]) -> None:
    path, data = busy
    browser.open(path)
    key = data["points"][-1][2]
    browser.run("location.hash = arguments[0]; dispatchEvent(new HashChangeEvent('hashchange'))", f"#{key}")
    assert browser.run("return document.querySelector('tr.found').id") == key
    browser.run("location.hash = arguments[0]; dispatchEvent(new HashChangeEvent('hashchange'))", f"#pt-{key}")
    assert browser.run("return document.activeElement.id") == f"pt-{key}"
    assert browser.count("#plot-times a.found") == 1
    browser.open(path, fragment="#f-transaction.item_error")
    assert browser.run("return document.getElementById('f-transaction.item_error').open")
    browser.click("#plot-talks a.hit")
    pair = data["talks"]["pairs"][0]
    assert (
        browser.run("return document.querySelector('#table-connections input').value")
        == f"{pair['client']}: {pair['server']}:"
    )
    assert browser.count("#table-connections tbody tr:not(.how)") == 1


def test_a_pair_of_hosts_leads_to_its_connections_only(browser: Browser, folder: Path) -> None:
    ends = [("10.0.0.1", "10.0.0.2"), ("10.0.0.10", "10.0.0.2"), ("10.0.0.1", "10.0.0.20"), ("fe80::1", "fe80::2")]
    packets = [packet for client, server in ends for packet in begun(Flow(client, server)).packets()]
    browser.open(written(folder, "pairs", page_of(saved(folder / "pairs.pcapng", sorted(packets)))))
    for number, (client, server) in enumerate(ends, 1):
        browser.run(
            """[...document.querySelectorAll('#plot-talks a.hit')].find((one) => one.dataset.tip.startsWith(arguments[0]))
               .dispatchEvent(new MouseEvent('click', {bubbles: true}))""",
            f"{client} → {server}\n",
        )
        assert len(browser.texts("#table-connections tbody tr")) == 1, number


def test_distributions_and_polls_lead_to_their_rows(browser: Browser, busy: tuple[Path, dict[str, Any]]) -> None:
    path, data = busy
    for plot, rows, said in (
        ("spreads", data["spreads"]["rows"], lambda row: [row["host"], row["function"]]),
        ("polls", data["polls"]["rows"], lambda row: [row["host"], row["subject"]]),
    ):
        for number, row in enumerate(rows):
            link = f"return document.querySelectorAll('#plot-{plot} a.hit')[{number}].getAttribute('href')"
            browser.open(path)
            browser.open(path, fragment=browser.run(link))
            cells = browser.texts("tr.found td")
            assert [cell for cell in said(row) if cell in cells] == said(row), cells


def test_durations_are_written_as_the_commands_write_them(browser: Browser, busy: tuple[Path, dict[str, Any]]) -> None:
    path, data = busy
    browser.open(path)
    code = script()
    source = code[code.index("function fixed(") : code.index("function round(")]
    edges = [10_000, 999_500, 99_995_000, 999_500_000, 600 * 10**9, 3600 * 10**9, 86_400 * 10**9]
    values = {edge + step for edge in edges for step in (-501, -500, -499, -1, 0, 1, 499, 500, 501, 5000)}
    # Halves of the last digit, where Python and JavaScript round differently by themselves.
    values |= {number * half for half in (50, 500, 5000, 125_000, 500_000, 5_000_000) for number in range(300)}
    rng = Random(4)
    values |= {int(10 ** rng.uniform(0, 15.5)) for _ in range(3000)}
    asked = sorted(values | {-value for value in values})
    written: list[str] = browser.run(f"{source}; return arguments[0].map(duration)", asked)
    assert {ns: text for ns, text in zip(asked, written, strict=True) if text != duration_text(ns)} == {}
    (slowest,) = [table for table in data["tables"] if table["name"] == "slowest"]
    shown = browser.texts("#table-slowest tbody tr > td:nth-of-type(6)")[:5]
    assert shown == [duration_text(row["cells"][4]) for row in slowest["rows"][:5]]


def test_time_can_be_zoomed(browser: Browser, busy: tuple[Path, dict[str, Any]]) -> None:
    path, _ = busy
    browser.open(path)
    every = browser.count("#plot-rates rect.bar")
    browser.click("#zoom button[aria-label='Zoom in']")
    assert 0 < browser.count("#plot-rates rect.bar") < every
    browser.click("#zoom button[aria-label='Show all of the time']")
    assert browser.count("#plot-rates rect.bar") == every


def test_it_is_used_by_keyboard(browser: Browser, busy: tuple[Path, dict[str, Any]]) -> None:
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.support.ui import WebDriverWait

    path, _ = busy
    browser.open(path)
    head = browser.driver.find_element(By.CSS_SELECTOR, "#table-failed th:nth-child(2) button")
    head.send_keys(Keys.ENTER)
    assert head.find_element(By.XPATH, "..").get_attribute("aria-sort") == "ascending"
    point = browser.driver.find_element(By.CSS_SELECTOR, "#plot-times a.hit")
    browser.run("arguments[0].focus()", point)
    assert "Read Var" in browser.texts("#tip")[0] or "Setup" in browser.texts("#tip")[0]
    point.send_keys(Keys.ENTER)
    # The page follows once the browser says that the place has changed.
    WebDriverWait(browser.driver, 10).until(lambda _driver: browser.count("tr.found") == 1)


def test_nothing_leaves_the_page_and_nothing_overflows(browser: Browser, busy: tuple[Path, dict[str, Any]]) -> None:
    path, _ = busy
    for width in WIDTHS:
        browser.open(path, width)
        assert browser.requests() == [path.as_uri()]
        assert browser.console() == []
        assert browser.overflow() <= 0, width
        shot(browser, f"busy-{width}")
    told = browser.driver.execute_async_script(
        "const done = arguments[0]; fetch('http://127.0.0.1:9/').then(() => done('sent'), (error) => done(String(error)));"
    )
    assert "Failed to fetch" in told
    assert any("Content Security Policy" in line for line in browser.console())


def test_bins_below_a_second_are_counted_as_such(browser: Browser, busy: tuple[Path, dict[str, Any]]) -> None:
    """One request in a bin of 10 ms is one, not 100 in a second; longer bins are counted per second."""
    path, data = busy
    browser.open(path)
    width = round(data["rates"]["width"] * 1000)
    assert browser.texts("#plot-rates h3") == [f"Transactions per {width} ms"]
    most = max([sum(one[1:2] + one[4:]) for one in data["rates"]["bins"]])
    ticks = [text for text in browser.texts("#plot-rates svg.timed text[text-anchor=end]") if text.isdigit()]
    assert most <= max([int(tick) for tick in ticks]) <= most * 3
    packets = begun(Flow(ports=(40002, 102))).packets(step_ns=60 * 1000 * MS)
    browser.open(written(path.parent, "slow", page_of(saved(path.parent / "slow.pcapng", packets))))
    assert browser.texts("#plot-rates h3") == ["Transactions per second"]


def test_times_past_midnight_have_their_day(browser: Browser, folder: Path) -> None:
    late = begun(Flow(ports=(40003, 102))).packets(start_ns=EPOCH_NS + 18 * 3600 * 10**9, step_ns=600 * 1000 * MS)
    browser.open(written(folder, "late", page_of(saved(folder / "late.pcapng", late))))
    assert re.match(r"03-04 \d\d:\d\d:\d\d", browser.texts("#table-connections td.short")[0])


def test_times_of_several_years_have_their_year_and_names_of_files_their_room(browser: Browser, folder: Path) -> None:
    year = 365 * 86400 * 10**9
    paths = []
    for number in range(2):
        talk = begun(Flow(ports=(40004 + number, 102))).packets(start_ns=EPOCH_NS + number * year)
        paths.append(
            saved(folder / f"a_long_name_of_a_capture_of_the_filling_station_in_the_north_{number}.pcapng", talk)
        )
    browser.open(written(folder, "years", render([Side(gathered_of(paths), [path.name for path in paths])], "0")), 1400)
    assert re.match(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d", browser.texts("#table-connections td.short")[0])
    touching = """return [...document.querySelectorAll('#table-slowest td')].filter((one) => one.scrollWidth > one.clientWidth)
        .map((one) => one.textContent)"""
    assert browser.count("#table-slowest tbody tr") == 2
    assert browser.run(touching) == []


def test_an_answer_captured_before_its_request_took_nobody_knows_how_long(browser: Browser, folder: Path) -> None:
    packets = read(begun(Flow(ports=(40006, 102))), 1).packets()
    early, late = packets[-2:]
    turned = [*packets[:-2], late._replace(time_ns=early.time_ns), early._replace(time_ns=late.time_ns)]
    browser.open(written(folder, "turned", page_of(saved(folder / "turned.pcapng", turned))))
    rows = browser.texts("#table-functions tbody tr")
    assert [row.endswith("???") for row in rows if "Read Var" in row] == [True]


def test_labels_stay_in_their_plot(browser: Browser, folder: Path) -> None:
    """Long subjects of polls and axes of a few minutes at every width: nothing leaves the figure, no two labels touch."""
    talk = begun()
    for ref in range(1, 40):
        read(talk, ref, Item(0x02, 200, 65000, 0x84, 65000 * 8))
    path = written(folder, "long", page_of(saved(folder / "long.pcapng", talk.packets(step_ns=1000 * MS))))
    script = """const found = [];
        for (const figure of document.querySelectorAll('figure')) {
          const frame = figure.getBoundingClientRect(), rows = new Map();
          for (const text of figure.querySelectorAll('svg text')) {
            const box = text.getBoundingClientRect();
            if (!box.width) continue;
            if (box.left < frame.left || box.right > frame.right) found.push(`outside: ${text.textContent}`);
            const row = rows.get(text.getAttribute('y')) || [];
            if (row.some((one) => one.left < box.right && box.left < one.right)) found.push(`touches: ${text.textContent}`);
            rows.set(text.getAttribute('y'), [...row, box]);
          }
        }
        return found;"""
    for width in WIDTHS:
        browser.open(path, width)
        assert browser.count("#plot-rates svg.timed text") >= 4
        assert browser.run(script) == [], width


def test_a_table_wider_than_the_page_says_so_and_scrolls_by_keyboard(
    browser: Browser, busy: tuple[Path, dict[str, Any]]
) -> None:
    browser.open(busy[0], 390)
    hint = "return [...document.querySelectorAll('#table-connections .aside')].map((one) => one.hidden)"
    assert browser.run(hint) == [False]
    box = "document.querySelector('#table-connections .scroll')"
    assert browser.run(f"return [{box}.tabIndex, {box}.getAttribute('role'), {box}.ariaLabel]") == [
        0, "region", "Connections",
    ]  # fmt: skip
    browser.driver.execute_async_script(
        f"const [done] = arguments, box = {box};"
        "box.addEventListener('scroll', () => requestAnimationFrame(done)); box.scrollLeft = 1e6;"
    )
    assert browser.run(hint) == [True]
    browser.open(busy[0], 1920)
    assert browser.run("return document.querySelector('#table-functions .aside').hidden")
    assert browser.run("return document.querySelector('#table-functions .scroll').tabIndex") == -1


def test_paper_shows_what_is_folded(browser: Browser, busy: tuple[Path, dict[str, Any]]) -> None:
    browser.open(busy[0])
    folded = "return [...document.querySelectorAll('details')].filter((one) => !one.open).length"
    every = browser.run(folded)
    assert every > 1
    assert browser.run(f"dispatchEvent(new Event('beforeprint')); {folded}") == 0
    assert browser.run(f"dispatchEvent(new Event('afterprint')); {folded}") == every


def test_it_prints_without_controls(browser: Browser, busy: tuple[Path, dict[str, Any]]) -> None:
    browser.open(busy[0])
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        for hidden in ("nav", "#zoom", "#table-failed input"):
            assert (
                browser.run("return getComputedStyle(document.querySelector(arguments[0])).display", hidden) == "none"
            )
        printed = browser.driver.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})
        box = re.search(rb"/MediaBox \[0 0 ([0-9.]+) ([0-9.]+)\]", base64.b64decode(printed["data"]))
        assert box is not None
        assert float(box[1]) > float(box[2])  # the widest tables have 13 columns
        # A sheet of A4 within its margins, where nothing can be scrolled: every column is on it, addresses and times whole.
        sheet = {"width": 1047, "height": 700, "deviceScaleFactor": 1, "mobile": False}
        browser.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", sheet)
        browser.run("dispatchEvent(new Event('beforeprint'))")
        assert browser.count("details .scroll table") > 1
        wider = """return [...document.querySelectorAll('.scroll table')]
            .filter((one) => one.getBoundingClientRect().right > innerWidth).map((one) => one.textContent.slice(0, 40))"""
        assert browser.run(wider) == []
        broken = """return [...document.querySelectorAll('#lists td.short')].filter((one) => {
            const range = document.createRange();
            range.selectNodeContents(one);
            const lines = new Set([...range.getClientRects()].map((box) => box.top)).size;
            return lines > one.textContent.split(' ').length;
        }).map((one) => one.textContent)"""
        assert browser.count("#table-connections td.short") == 6
        assert browser.run(broken) == []
    finally:
        browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def test_text_from_the_wire_neither_runs_nor_breaks_the_layout(browser: Browser, folder: Path) -> None:
    """What breaks pages, and the 200 strings that every output is given, in every place for a name."""
    name = "<img src=x onerror=window.hacked=1>.pcapng"
    captures = [saved(folder / name, naughty_packets()), hostile.write(folder / "\u202egnp.hostile.pcapng")]
    gathered = gathered_of(captures)
    page = render([Side(gathered, [path.name for path in captures])], "0", None)
    path = written(folder, "hostile", page)
    assert UNSAFE.search(page.replace("\n", "")) is None
    for width in WIDTHS:
        browser.open(path, width)
        assert browser.run("return window.hacked") is None
        assert browser.overflow() <= 0, width
        shot(browser, f"hostile-{width}")
    while browser.count("#table-connections .scroll + button:not([hidden])"):
        browser.click("#table-connections .scroll + button")
    assert browser.console() == []
    assert browser.requests() == [path.as_uri()]
    assert browser.count("script") == 2
    assert browser.count("iframe, base, img, meta[http-equiv=refresh], [onclick], [onload], [onerror]") == 0
    assert browser.count("#table-connections tbody tr:not(.how)") == len(NAUGHTY) + len(hostile.strings())
    shown = " ".join(browser.texts("#table-connections td"))
    assert "<script>window.hacked=1</script>" in shown
    assert "{{7*7}}" in shown
    assert UNSAFE.search(browser.run("return document.documentElement.textContent").replace("\n", "")) is None


def test_two_sessions_are_overlaid(browser: Browser, folder: Path) -> None:
    path = written(folder, "both", page_of(OWN / "nodes7-poll.pcapng", OWN / "nodes7-poll-missing.pcapng"))
    browser.open(path)
    assert browser.count("#plot-rates path.outline.s0") == 1
    assert browser.count("#plot-rates path.outline.s1") == 2  # what failed as well
    one, other = data_of(path.read_text(encoding="utf-8"))["sessions"]
    assert (one["rates"]["width"], one["times"]["width"]) == (other["rates"]["width"], other["times"]["width"])
    assert browser.count("#plot-times path.line") == 2
    assert browser.count("#plot-a-talks") == browser.count("#plot-b-talks") == 1
    assert browser.texts("#differences li") == ["one difference"]
    assert browser.count("#a-table-connections tbody tr:not(.how)") == 1
    browser.open(path, 390, "#b-c1")
    assert browser.run("return document.querySelector('tr.found').id") == "b-c1"
    assert browser.overflow() <= 0
    assert browser.console() == []


def test_a_capture_without_s7_opens_too(browser: Browser, folder: Path) -> None:
    path = written(folder, "none", page_of(saved(folder / "none.pcapng", [])))
    browser.open(path)
    assert browser.console() == []
    assert browser.texts("#lists p") == ["There is nothing to list."]
    assert browser.texts("#figures") == ["There is nothing to draw."]
    assert browser.count("#plcs[hidden]") == browser.count("nav a[href='#plcs'][hidden]") == 1
    assert browser.run("return document.getElementById('zoom').offsetHeight") == 0  # there is no time to zoom


def shot(browser: Browser, name: str) -> None:
    """Keep a picture of the whole page where somebody asked for them."""
    if SHOTS:
        height = min(8000, int(browser.run("return document.documentElement.scrollHeight")))
        width = int(browser.run("return innerWidth"))
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        browser.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        Path(SHOTS).mkdir(parents=True, exist_ok=True)
        browser.driver.save_screenshot(str(Path(SHOTS, f"{name}.png")))
