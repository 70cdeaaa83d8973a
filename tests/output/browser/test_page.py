"""The page in Chromium: it asks the network for nothing, and says what the command line says."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from dissect.cli.main import run as run_here
from dissect.wire.text import duration_text
from tests.meaning.report.support import saved
from tests.output.browser.support import OWN, Opened, captures
from tests.output.page.support import NAUGHTY, naughty_packets
from tests.promises import hostile

PLANT = OWN / "crafted" / "plus-plant.pcapng"


def here(folder: Path, argv: Sequence[str]) -> tuple[int, str, str]:
    """Run a command line in this process and in this folder."""
    out, errors = io.BytesIO(), io.BytesIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        streams = [io.TextIOWrapper(one, encoding="utf-8", write_through=True) for one in (out, errors)]
        patch.setattr(sys, "stdout", streams[0])
        patch.setattr(sys, "stderr", streams[1])
        code = run_here(list(argv))
        for stream in streams:
            stream.detach()
    return code, out.getvalue().decode(), errors.getvalue().decode()


def test_it_asks_for_nothing(opened: Opened) -> None:
    """Since it was opened."""
    opened.choose(PLANT)
    for tab in (
        "report",
        "findings",
        "transactions",
        "values",
        "operations",
        "acts",
        "devices",
        "blocks",
        "save",
        "help",
    ):
        opened.select(tab)
    opened.until("document.querySelector('article.manual h1')")
    asked = opened.requests()
    assert [address for address in asked if not address.startswith(("file:", "blob:"))] == []
    assert [address for address in asked if address.startswith("file:")] == [opened.page.as_uri()]
    assert opened.console() == []


@pytest.mark.parametrize(
    "attempt",
    [
        "fetch('http://127.0.0.1:9/').catch(() => 0)",
        "new Image().src = 'http://127.0.0.1:9/x.png'",
        "new WebSocket('ws://127.0.0.1:9/')",
        "navigator.sendBeacon('http://127.0.0.1:9/', 'x')",
        "document.head.append(Object.assign(document.createElement('script'), {src: 'http://127.0.0.1:9/x.js'}))",
        "document.head.append(Object.assign(document.createElement('link'), {rel: 'stylesheet', href: 'http://127.0.0.1:9/x.css'}))",
        "document.body.append(Object.assign(document.createElement('iframe'), {src: 'http://127.0.0.1:9/'}))",
        "document.body.setAttribute('onclick', 'window.hacked = 1'); document.body.click()",
    ],
)
def test_its_policy_forbids_every_connection(opened: Opened, attempt: str) -> None:
    opened.console()
    opened.script(
        f"""window.refused = [];
        addEventListener('securitypolicyviolation', (event) => refused.push(event.violatedDirective));
        try {{ {attempt} }} catch {{}}"""
    )
    opened.until("refused.length")
    assert opened.script("return window.hacked") is None
    opened.console()


def test_all_captures_give_what_the_command_line_gives(opened: Opened) -> None:
    """Byte for byte: the summary as JSON and the transactions as lines, exit codes and complaints."""
    files = captures()
    assert len(files) == len({path.name for path in files}) > 100
    opened.choose(*files)
    forms = (["analyze", "-T", "json"], ["transactions", "-T", "jsonl"])
    lines = [[*form, path.name] for path in files for form in forms]
    told = opened.run(lines)
    folders = [path.parent for path in files for _ in forms]
    with pytest.MonkeyPatch.context() as patch:
        # Certificates are read with a package that is compiled, and not there.
        for name in [name for name in sys.modules if name.partition(".")[0] == "cryptography"]:
            patch.delitem(sys.modules, name)
        patch.setitem(sys.modules, "cryptography", None)
        expected = [here(folder, line) for folder, line in zip(folders, lines, strict=True)]
    different = [line for line, one, other in zip(lines, told, expected, strict=True) if one != other]
    assert different == []
    assert sum([len(out) for _, out, _ in told]) > 500_000


@pytest.mark.parametrize(
    "line",
    [
        ["devices", "-T", "json", "plus-plant.pcapng"],
        ["values", "-T", "csv", "plus-plant.pcapng", 'DB1."level"'],
        ["transactions", "-Y", "latency > 8ms and function == 'GetMultiVariables'", "plus-plant.pcapng"],
        ["transactions", "-Y", "latencey > 8ms", "plus-plant.pcapng"],
        ["operations", "-T", "jsonl", "plus-plant.pcapng"],
        ["golden", "plus-plant.pcapng"],
        ["show", "-V", "--frame", "8", "plus-plant.pcapng"],
        ["report", "-o", "-", "plus-plant.pcapng"],
        ["analyze", "--", "no such file"],
        ["fields"],
    ],
)
def test_other_commands_too(opened: Opened, line: list[str]) -> None:
    if opened.texts("#state")[0].partition(" ·")[0] != PLANT.name:
        opened.choose(PLANT)
    (told,) = opened.run([line])
    assert told == here(PLANT.parent, line)


def test_files_that_commands_write_are_those_of_the_command_line(opened: Opened, tmp_path: Path) -> None:
    opened.choose(PLANT)
    line = ["cut", "plus-plant.pcapng", "-o", "part.pcapng", "--time", "1..2"]
    octets = opened.driver.execute_async_script(
        """const done = arguments[1];
        engine.run(arguments[0]).then(async ({ files: [file] }) =>
          done([file.name, [...new Uint8Array(await file.data.arrayBuffer())]]));""",
        line,
    )
    assert here(PLANT.parent, [*line[:3], str(tmp_path / "part.pcapng"), *line[4:]])[0] == 0
    assert octets == ["part.pcapng", list((tmp_path / "part.pcapng").read_bytes())]
    (left,) = opened.run([["analyze", "part.pcapng"]])
    assert (left[0], "no such file" in left[2]) == (2, True)


def test_files_beside_the_captures_are_known_for_what_they_are(opened: Opened, tmp_path: Path) -> None:
    keys = tmp_path / "session.keys"
    keys.write_text(f"CLIENT_RANDOM {'0' * 64} {'1' * 96}\n")
    names = ["plant.pcapng", "plant.toml", "plant.bind.toml"]
    opened.choose(*[OWN / "scd" / name for name in names], OWN / "tags" / "valve.csv", OWN / "tags" / "valve.db", keys)
    roles = opened.script("return held.map((one) => one.role)")
    assert roles == ["capture", "scd", "bind", "tags", "tags", "keys"]
    assert "use the installed s7dissect to decrypt TLS" in opened.texts("#panel [role=alert]")[0]
    opened.script("held.forEach((one) => { one.used = one.name.startsWith('plant') }); changed()")
    opened.select("transactions")
    (line,) = opened.texts(".command code")
    assert line.endswith(" --scd plant.toml --bind plant.bind.toml plant.pcapng")
    argv = ["transactions", "-T", "csv", "--scd", names[1], "--bind", names[2], names[0]]
    (told,) = opened.run([argv])
    assert told == here(OWN / "scd", argv)
    opened.script("held.at(-1).used = true; changed()")
    opened.select("transactions")
    assert "--tls-keys needs the package cryptography" in opened.texts("[role=alert]")[0]


def test_several_captures_are_read_as_one_or_one_at_a_time(opened: Opened) -> None:
    names = ["item-errors.pcapng", "blocks.pcapng"]
    opened.choose(*[OWN / name for name in names])
    opened.select("devices")
    assert opened.texts(".command code") == [f"s7dissect devices -T json {' '.join(names)}"]
    told = json.loads(here(OWN, ["devices", "-T", "json", *names])[1])["devices"]
    rows = opened.script(
        "return [...document.querySelectorAll('tbody tr')].map((one) => [...one.cells].map((c) => c.textContent))"
    )
    assert [row[:2] for row in rows] == [[one["address"], one["role"]] for one in told]
    assert [row[7:9] for row in rows] == [[str(one["transactions"]), str(one["with_errors"])] for one in told]
    opened.select("files")
    together = (
        "[...document.querySelectorAll('label')].find((one) => one.textContent.includes('as one')).control.click()"
    )
    opened.script(together)
    assert opened.script("return held.filter((one) => one.used).map((one) => one.name)") == names[:1]
    opened.click(f"[aria-label='Use {names[1]}']")
    assert opened.script("return held.filter((one) => one.used).map((one) => one.name)") == names[1:]
    opened.script(together)


def test_a_device_tells_its_facts_and_what_it_is_known_by(opened: Opened) -> None:
    name = "crafted/plus-plant.pcapng"
    opened.choose(OWN / name)
    opened.select("devices")
    one = json.loads(here(OWN, ["devices", "-T", "json", name])[1])["devices"][0]
    opened.click("tbody tr")
    facts = [value["value"] for module in one["modules"] for values in module["facts"].values() for value in values]
    assert opened.texts(".detail td:nth-child(3)") == facts
    assert len(facts) > 1
    told = opened.texts(".detail li")
    assert told == [evidence_line(each) for each in one["evidence"]]
    opened.click(".detail li button")
    opened.until("document.querySelector('.detail .dissected')")


def test_evidence_says_on_how_many_connections_it_was_seen(opened: Opened) -> None:
    opened.choose(OWN / "two-clients.pcapng")
    opened.select("devices")
    devices = json.loads(here(OWN, ["devices", "-T", "json", "two-clients.pcapng"])[1])["devices"]
    evidence = next(one["evidence"] for one in devices if any(each["times"] > 1 for each in one["evidence"]))
    opened.click(f"tbody tr:nth-child({[one['evidence'] for one in devices].index(evidence) + 1})")
    assert opened.texts(".detail li") == [evidence_line(each) for each in evidence]


def evidence_line(evidence: dict[str, Any]) -> str:
    """``times`` says on how many connections it was seen (docs/json.md), as the text of `devices` does."""
    on = f", on {evidence['times']} connections" if evidence["times"] > 1 else ""
    return f"{evidence['role']}: {evidence['text']}{on} packet {evidence['frame']}"


def test_acts_are_those_of_the_table(opened: Opened, tmp_path: Path) -> None:
    opened.choose(PLANT)
    opened.select("acts")
    assert opened.texts(".command code") == ["s7dissect export --only acts -o acts.csv plus-plant.pcapng"]
    written = tmp_path / "acts.csv"
    assert here(PLANT.parent, ["export", "--only", "acts", "-o", str(written), PLANT.name])[0] == 0
    with written.open(encoding="utf-8", newline="") as file:
        records = list(csv.DictReader(file))
    assert len(records) > 2
    assert any('"' in one["blocks"] for one in records)
    names = ("act", "first_frame", "last_frame", "client_host", "server_host", "kind", "subject", "bytes", "outcome")
    rows = opened.script(
        "return [...document.querySelectorAll('tbody tr')].map((one) => [...one.cells].map((c) => c.textContent))"
    )
    assert [[*row[:1], *row[2:10]] for row in rows] == [[one[name] for name in names] for one in records]
    assert opened.texts(".told") == []
    opened.click("tbody tr")
    opened.until("document.querySelector('.detail .dissected')")


def test_a_block_shows_its_code(opened: Opened) -> None:
    name = "program.pcapng"
    opened.choose(OWN / "crafted" / name)
    opened.select("blocks")
    told = json.loads(here(OWN / "crafted", ["blocks", "-T", "json", name])[1])["blocks"]
    rows = opened.script(
        "return [...document.querySelectorAll('tbody tr')].map((one) => [...one.cells].map((c) => c.textContent))"
    )
    assert [row[:3] for row in rows] == [[str(one["operation"]), one["label"], one["direction"]] for one in told]
    assert len({row[-1] for row in rows}) > 2
    opened.click("tbody tr:nth-child(4)")
    opened.until("document.querySelector('.detail pre')")
    line = ["blocks", "--code", "STL", "-Y", f"number == {told[3]['operation']}", name]
    assert opened.texts(".detail pre") == [here(OWN / "crafted", line)[1]]
    assert told[3]["label"] in opened.texts(".detail pre")[0]
    opened.script(
        "[...document.querySelectorAll('.choice button')].find((one) => one.textContent === 'What changed').click()"
    )
    opened.until("document.querySelector('#panel pre.wrapped')")
    assert opened.texts("#panel pre.wrapped") == [here(OWN / "crafted", ["blocks", "--diff", name])[1]]


def test_rows_are_chosen_linked_and_taken_apart(opened: Opened) -> None:
    opened.choose(PLANT)
    opened.select("transactions")
    assert opened.texts(".pager .quiet")[0] == "rows 1 to 24 of 24"
    opened.click("tr[data-key='2']")
    opened.until("document.querySelectorAll('.dump').length === 2")
    assert opened.script("return location.hash") == "#transactions/2"
    assert opened.texts(".detail .command code") == ["s7dissect show -V --frame 8 --frame 9 plus-plant.pcapng"]
    opened.script(
        "[...document.querySelectorAll('.field')].find((one) => one.textContent.includes('protocol_id')).focus()"
    )
    assert opened.texts(".dump b.lit") == ["72"]
    _, shown, _ = here(PLANT.parent, ["show", "-V", "--frame", "8", "--frame", "9", PLANT.name])
    assert [
        text for text in opened.texts(".field span:last-child") if " ".join(text.split()) not in " ".join(shown.split())
    ] == []
    fields = re.findall(r"^ +\d+(?:-\d+)? {2}(?![0-9a-f]{2} |\d{4}-)\S", shown, re.MULTILINE)
    assert opened.count(".field") == len(fields) > 70
    opened.open("#transactions/17")
    opened.driver.find_element("id", "choose").send_keys(str(PLANT))
    opened.until("document.querySelector('tr[aria-selected=true]')?.dataset.key === '17'")
    opened.until("document.querySelector('.dump')")


def test_rows_are_walked_by_keyboard(opened: Opened) -> None:
    from selenium.webdriver.common.keys import Keys

    opened.choose(PLANT)
    opened.select("transactions")
    opened.script("document.querySelector('tr[data-key]').focus()")
    for key in (Keys.ARROW_DOWN, Keys.ARROW_DOWN, Keys.ENTER):
        opened.driver.switch_to.active_element.send_keys(key)
    opened.until("document.querySelector('.dump')")
    assert opened.script("return location.hash") == "#transactions/3"
    opened.script("document.querySelector('[role=tab][aria-selected=true]').focus()")
    opened.driver.switch_to.active_element.send_keys(Keys.ARROW_RIGHT)
    assert opened.script("return document.activeElement.textContent") == "Values"
    opened.drawn()
    assert opened.script("return document.querySelectorAll('#tabs [tabindex=\"0\"]').length") == 1


def test_an_expression_selects_and_its_errors_are_those_of_the_command_line(opened: Opened) -> None:
    opened.choose(PLANT)
    opened.select("transactions", "", "latency > 8ms and host == 192.0.2.30")
    assert (
        opened.script("return decodeURIComponent(location.hash)")
        == "#transactions?latency > 8ms and host == 192.0.2.30"
    )
    assert opened.texts(".command code")[0].endswith("-Y 'latency > 8ms and host == 192.0.2.30' plus-plant.pcapng")
    _, rows, _ = here(PLANT.parent, ["transactions", "-Y", "latency > 8ms and host == 192.0.2.30", PLANT.name])
    assert opened.count("tr[data-key]") == len(rows.splitlines()) > 5
    opened.select("transactions", "", "latencey > 8ms")
    (said,) = opened.texts("[role=alert]")
    _, _, errors = here(PLANT.parent, ["transactions", "-Y", "latencey > 8ms", PLANT.name])
    assert said in errors.replace("\n", "")
    assert "latency" in said
    opened.script(
        """const box = document.getElementById('where'); box.value = 'host == 1.2.3.4 and request_f';
        box.dispatchEvent(new Event('input'))"""
    )
    opened.until("document.querySelector('#fields option')")
    assert opened.script("return [...document.querySelectorAll('#fields option')].map((one) => one.value)") == [
        "host == 1.2.3.4 and request_frame"
    ]


def test_rows_are_read_in_pages(opened: Opened, tmp_path: Path) -> None:
    from tests.meaning.report.support import WORD, begun, read
    from tests.properties.packets import MS

    talk = begun()
    for ref in range(1, 350):
        read(talk, ref, WORD, ref.to_bytes(2, "big"))
    opened.choose(saved(tmp_path / "many.pcapng", talk.packets(step_ns=MS)))
    opened.select("transactions")
    assert opened.texts(".pager .quiet")[0] == "rows 1 to 100 of 350"
    keys = []
    for _ in range(4):
        keys += opened.script(
            "return [...document.querySelectorAll('tr[data-key]')].map((one) => Number(one.dataset.key))"
        )
        before = opened.texts(".pager .quiet")
        if not opened.script("return document.querySelector('[aria-label=\"Next rows\"]').disabled"):
            opened.click("[aria-label='Next rows']")
            opened.until(f"document.querySelector('.pager .quiet').textContent !== {before[0]!r}")
    assert keys == list(range(1, 351))
    opened.select("transactions", "207")
    opened.until("document.querySelector('tr[aria-selected=true]')?.dataset.key === '207'")


def test_values_are_plotted_as_they_are_listed(opened: Opened) -> None:
    opened.choose(PLANT)
    opened.select("values")
    opened.click("tr[data-key]")
    opened.drawn()
    opened.until("document.querySelector('figure svg path.line')")
    _, rows, _ = here(PLANT.parent, ["values", PLANT.name, 'DB1."level"'])
    assert opened.count("figure circle.point") == len(rows.splitlines()) == 5
    assert (
        opened.script("return document.querySelector('figure svg').getAttribute('aria-label')")
        == 'DB1."level": 5 values, from 42.5 to 45.5'
    )


def test_values_of_two_plcs_with_the_same_address_are_two(opened: Opened) -> None:
    capture = OWN / "crafted" / "other-ports.pcapng"
    _, told, _ = here(OWN / "crafted", ["values", "--summary", "-T", "jsonl", capture.name])
    variables = [json.loads(line) for line in told.splitlines()]
    assert len({one["address"] for one in variables}) < len(variables)
    opened.choose(capture)
    opened.select("values")
    for at in (1, 2):
        opened.script("document.querySelectorAll('tr[data-key]')[arguments[0]].click()", at - 1)
        opened.drawn()
        opened.until(f"document.querySelectorAll('figure').length === {at}")
    labels = opened.script(
        "return [...document.querySelectorAll('figure svg')].map((one) => one.getAttribute('aria-label'))"
    )
    for one, label in zip(variables, labels, strict=False):
        assert label.startswith(f"{one['plc']} {one['address']}: {one['count']} value")


def test_more_values_than_a_plot_has_are_told(opened: Opened) -> None:
    opened.choose(PLANT)
    opened.script("engine.known.clear()")
    opened.select("values")
    opened.script(
        """const page = Lines.prototype.page;
        Lines.prototype.page = async function (at) { return (await page.call(this, at)).slice(0, 2); };
        window.restore = () => { Lines.prototype.page = page; };"""
    )
    try:
        opened.click("tr[data-key]")
        opened.drawn()
        opened.until("document.querySelector('#panel .told[role=status]')")
        assert opened.texts("#panel .told[role=status]") == [
            "The plots show the first 2 values of 5; an expression above selects others."
        ]
    finally:
        opened.script("restore()")


def test_durations_read_as_on_the_command_line(opened: Opened) -> None:
    for ns in (0, 42, 4200, 12_345, 999_499, 999_500, 12_345_678, 99_500_000, 999_500_000, 7 * 10**11, 10**15):
        assert opened.script("return duration(arguments[0])", ns) == duration_text(ns)


def test_a_browser_that_cannot_run_it_says_so(opened: Opened) -> None:
    opened.choose(PLANT)
    opened.script("heard({ kind: 'fatal', id: 0, text: 'no WebAssembly' })")
    assert opened.texts("#state") == ["This browser cannot run it: no WebAssembly"]
    opened.script("idle()")


def test_the_report_is_the_one_of_the_command_in_a_frame_without_origin(opened: Opened) -> None:
    opened.choose(PLANT)
    opened.select("report")
    frame = opened.driver.find_element("css selector", "iframe.report")
    assert frame.get_attribute("sandbox") == "allow-scripts allow-downloads"
    opened.driver.switch_to.frame(frame)
    try:
        opened.until("document.documentElement.dataset.ready === 'yes'")
        assert opened.count("#plot-rates rect.bar") > 0
        opened.click("a[href='#tables']")
        opened.until("scrollY > 0 && Math.abs(document.getElementById('tables').getBoundingClientRect().top) < 200")
        assert (
            opened.script("try { return parent.document.title } catch (error) { return error.name }") == "SecurityError"
        )
    finally:
        opened.driver.switch_to.default_content()


def test_reading_can_be_cancelled(opened: Opened, tmp_path: Path) -> None:
    opened.choose(PLANT)
    opened.script(
        """window.ended = '';
        engine.run(['report', '-o', '-', 'plus-plant.pcapng']).catch((error) => { ended = error.message });
        document.getElementById('cancel').click()"""
    )
    opened.until("ended === 'cancelled'")
    opened.until("document.documentElement.dataset.ready === 'yes'")
    assert opened.run([["analyze", PLANT.name]])[0][0] == 0


def test_too_much_is_refused_before_it_is_read(opened: Opened) -> None:
    opened.script(
        """const big = new File(["x"], "big.pcap"); Object.defineProperty(big, "size", {value: 900e6});
        held = [{name: "big.pcap", file: big, role: "capture", used: true}]; changed()"""
    )
    (said,) = opened.texts("#panel [role=alert]")
    assert said.startswith("900 MB of captures would need up to ")
    assert opened.script("return document.querySelector('[data-tab=report]').disabled")
    opened.script("held[0].file = new File([new Uint8Array(2e6)], 'big.pcap'); changed()")
    assert opened.texts("#memory")[0].startswith("Reading 2.0 MB takes up to ")


def test_hostile_names_and_texts_change_nothing(opened: Opened, tmp_path: Path) -> None:
    names = [name.replace("/", "_").replace("\0", "_")[:80] + ".pcapng" for name in NAUGHTY]
    first = saved(tmp_path / "first.pcapng", naughty_packets())
    files = [first, hostile.write(tmp_path / "second.pcapng")]
    for name in names:
        os.link(first, tmp_path / name)
    opened.choose(*files)
    opened.driver.execute_async_script(
        """const done = arguments[1]; const one = held[0].file;
        held = []; add(arguments[0].map((name) => new File([one], name))).then(() => done());""",
        names,
    )
    assert opened.texts("table.files td:nth-child(2)") == names
    told = opened.run([["analyze", f"./{name}" if name.startswith("-") else name] for name in names])
    expected = [here(tmp_path, ["analyze", name]) for name in names]
    assert told == expected
    opened.choose(*files)
    tags = set(opened.script("return [...document.querySelectorAll('main *')].map((one) => one.localName)"))
    for tab in ("findings", "transactions", "values", "operations", "acts", "devices", "blocks", "save"):
        opened.select(tab)
        assert opened.script("return window.hacked") is None
        tags |= set(opened.script("return [...document.querySelectorAll('main *')].map((one) => one.localName)"))
    assert tags & {"script", "img", "svg", "iframe", "style", "base", "meta", "link"} == set()
    assert opened.console() == []


def test_it_fits_a_phone(opened: Opened) -> None:
    opened.choose(PLANT)
    for width in (390, 1024, 1600):
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        opened.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        for tab in (
            "files",
            "report",
            "findings",
            "transactions",
            "values",
            "operations",
            "acts",
            "devices",
            "blocks",
            "save",
            "command",
        ):
            opened.select(tab)
            assert opened.script("return document.documentElement.scrollWidth - innerWidth") <= 0, (width, tab)
