"""The page as a file: its policy is true, nothing in it points outside, and its colours can be told apart and read."""

from __future__ import annotations

import base64
import hashlib
import html
import itertools
import json
import math
import re
import shlex
from importlib.resources import files
from typing import Any

import pytest

from dissect import analyze
from dissect.output.page.data import Data
from dissect.output.page.rendering import Side, embedded, render, script
from tests.cli.support import run
from tests.meaning.report.schemas import ROOT
from tests.output.page.support import NAUGHTY, command_of, data_of, gathered_of, page_of, session_of

STYLE = files("dissect.output.page").joinpath("page.css").read_text(encoding="utf-8")
SCRIPT = script()
PAGE = page_of(ROOT / "captures" / "nodes7-poll-missing.pcapng")
#: WCAG 2: text, and graphics.
TEXT, GRAPHIC = 4.5, 3.0


def hash_of(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def test_the_policy_lets_run_what_is_there_and_nothing_else() -> None:
    found = re.search(r'http-equiv="Content-Security-Policy" content="(.*?)"', PAGE)
    assert found is not None
    rules = dict([rule.strip().split(" ", 1) for rule in html.unescape(found[1]).split(";")])
    (style,) = re.findall(r"<style>(.*?)</style>", PAGE, re.DOTALL)
    (script,) = re.findall(r"<script>(.*?)</script>", PAGE, re.DOTALL)
    assert rules == {
        "default-src": "'none'",
        "script-src": f"'{hash_of(script)}'",
        "style-src": f"'{hash_of(style)}'",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    assert PAGE.index("Content-Security-Policy") < PAGE.index("<style>") < PAGE.index("<script")


def test_nothing_points_outside_or_stands_in_an_attribute_that_runs() -> None:
    markup = re.sub(r"<(style|script)[^>]*>.*?</\1>", "", PAGE, flags=re.DOTALL)
    assert re.findall(r"\b(?:src|action|formaction|srcset|ping)=", markup) == []
    assert [target for target in re.findall(r'href="(.*?)"', markup) if not target.startswith("#")] == []
    assert re.findall(r'\s(?:on\w+|style)="', markup) == []
    assert "url(" not in STYLE
    assert "@import" not in STYLE
    for word in (
        "innerHTML",
        "outerHTML",
        "insertAdjacentHTML",
        "document.write",
        "eval(",
        "Function(",
        "fetch(",
        "XMLHttp",
    ):
        assert word not in SCRIPT, word
    assert re.findall(r"https?://(?!www\.w3\.org/2000/svg)", SCRIPT) == []


def column_of(table: dict[str, Any], title: str) -> list[Any]:
    """Return the cells of a column, none where the table does without it."""
    titles = [one for one, _ in table["columns"]]
    return [row["cells"][titles.index(title)] for row in table["rows"]] if title in titles else []


@pytest.mark.parametrize("name", ["crafted/reference-examples", "many-open", "answer-lost", "nodes7-poll"])
def test_the_tables_count_what_analyze_counts(name: str) -> None:
    path = ROOT / "captures" / f"{name}.pcapng"
    page = page_of(path)
    tables = {table["name"]: table for table in session_of(page)["tables"]}
    told: dict[str, Any] = json.loads(json.dumps(analyze(path).as_dict(), default=list))
    functions, connections = told["functions"], told["connections"]
    assert sorted(column_of(tables["functions"], "function")) == sorted([one["name"] for one in functions])
    for table, rows in (("functions", functions), ("connections", connections)):
        missed = sum([one["unanswered"] - one["still_open"] for one in rows])
        assert sum(column_of(tables[table], "no answer")) == missed
        assert sum(column_of(tables[table], "still open")) == sum([one["still_open"] for one in rows])
    assert sum(column_of(tables["functions"], "count")) == sum([one["total"] for one in functions])
    set_up = sum(told["operations"].get("connect", {}).values())
    assert (f"{set_up} operation" in page) == (set_up > 0)


def test_a_column_of_texts_that_no_row_has_is_left_out() -> None:
    columns = {}
    for name in ("nodes7-poll", "szl"):
        tables = session_of(page_of(ROOT / "captures" / f"{name}.pcapng"))["tables"]
        assert all([len(row["cells"]) == len(table["columns"]) for table in tables for row in table["rows"]])
        (devices,) = [table for table in tables if table["name"] == "devices"]
        columns[name] = [column for column, _ in devices["columns"]]
    assert {"order number", "firmware"} <= set(columns["szl"])
    assert columns["nodes7-poll"] == [
        "device", "role", "sends requests to", "connections", "transactions as server", "as client", "median answer",
        "first seen",
    ]  # fmt: skip


def test_data_cannot_end_their_element() -> None:
    text = embedded(list(NAUGHTY))
    assert json.loads(text) == list(NAUGHTY)
    assert set(text) & set("<>&\u2028\u2029\x7f") == set()
    assert text.isascii()
    assert data_of(PAGE)["sessions"][0]["name"] == "nodes7-poll-missing.pcapng"


def luminance(colour: str) -> float:
    """Return the relative luminance of #rrggbb (WCAG 2.2)."""
    channels = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    light, dark = sorted([luminance(one), luminance(other)], reverse=True)
    return (light + 0.05) / (dark + 0.05)


def test_contrast_is_enough_in_light_and_dark() -> None:
    light, dark = [
        dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", block))
        for block in re.findall(r":root \{(.*?)\}", STYLE, re.DOTALL)[:2]
    ]
    assert light.keys() == dark.keys()
    for colours in (light, dark):
        for ground in (colours["ground"], colours["panel"]):
            for name in ("text", "quiet", "link", "error", "missed", "ok"):  # the last three as badges
                assert contrast(colours[name], ground) >= TEXT, name
            for name in ("push", "other", "mark", "focus", "heat", "second"):
                assert contrast(colours[name], ground) >= GRAPHIC, name


#: What red and green become to who has no red or no green cones: linear RGB to linear RGB (Viénot, Brettel and Mollon 1999).
WITHOUT_RED = ((0.11238, 0.88762, 0.0), (0.11238, 0.88762, 0.0), (0.00401, -0.00401, 1.0))
WITHOUT_GREEN = ((0.29275, 0.70725, 0.0), (0.29275, 0.70725, 0.0), (-0.02234, 0.02234, 1.0))


def seen(colour: str, matrix: tuple[tuple[float, ...], ...] | None) -> tuple[float, float, float]:
    """Return a colour in CIE L*a*b* (D65), as it looks with all cones or by a matrix."""
    rgb = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in rgb]
    if matrix is not None:
        linear = [max(0.0, sum([factor * c for factor, c in zip(row, linear, strict=True)])) for row in matrix]
    to_xyz = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))
    xyz = [sum([factor * c for factor, c in zip(row, linear, strict=True)]) for row in to_xyz]
    x, y, z = [
        share ** (1 / 3) if share > 0.008856 else 7.787 * share + 16 / 116
        for share in (xyz[0] / 0.9505, xyz[1], xyz[2] / 1.089)
    ]
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


def test_outcomes_and_severities_are_told_apart_without_red_or_green_cones() -> None:
    """A difference of 2.3 in L*a*b* is just visible; here at least ten times that between any two of these."""
    for block in re.findall(r":root \{(.*?)\}", STYLE, re.DOTALL)[:2]:
        colours = dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", block))
        for one, other in itertools.combinations(("ok", "error", "missed", "push"), 2):
            for matrix in (None, WITHOUT_RED, WITHOUT_GREEN):
                distance = math.dist(seen(colours[one], matrix), seen(colours[other], matrix))
                assert distance > 23, (one, other, matrix, distance)


def test_a_page_is_small() -> None:
    assert len(SCRIPT) + len(STYLE) < 90_000
    assert "@param" not in SCRIPT
    assert len(PAGE) < 120_000


@pytest.mark.parametrize("name", ["crafted/program", "crafted/plus-plant", "item-errors", "crafted/cotp-refused"])
def test_the_command_in_each_row_shows_something(
    capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    path = ROOT / "captures" / f"{name}.pcapng"
    monkeypatch.chdir(path.parent)
    session = session_of(page_of(path))
    commands = {command_of(session, row) for table in session["tables"] for row in table["rows"][:10]}
    assert len(commands) > 3
    for command in sorted(commands):
        ran = run(capfdbinary, *shlex.split(command)[1:])
        assert (ran.code, ran.err) == (0, ""), command
        assert ran.out, command


def test_functions_are_of_who_answers_and_commands_name_both() -> None:
    """A PLC that is loaded asks for each piece of a block, and the engineering station answers."""
    session = session_of(page_of(ROOT / "captures" / "crafted" / "program.pcapng"))
    (table,) = [table for table in session["tables"] if table["name"] == "functions"]
    assert table["columns"][0][0] == "answered by"
    (row,) = [row for row in table["rows"] if row["cells"][1] == "Download block"]
    assert row["cells"][0] == "192.0.2.10"
    assert """'answered_by == 192.0.2.10 and function == "Download block"'""" in row["show"]


def test_hosts_have_their_names_wherever_they_stand_in_a_table() -> None:
    names = {"192.0.2.20": "Press", "192.0.2.10": "Desk", "192.0.2.30": "Panel"}
    gathered = gathered_of([ROOT / "captures" / "crafted" / "plus-plant.pcapng"], hosts=names)
    for table in Data(gathered, "").as_dict()["tables"]:
        for row in table["rows"]:
            assert not [cell for cell in row["cells"] if isinstance(cell, str) and "192.0.2." in cell], table["name"]


def test_details_of_findings_name_hosts_as_the_tables_do() -> None:
    names = {"192.0.2.20": "Press", "192.0.2.10": "Desk", "192.0.2.30": "Panel"}
    path = ROOT / "captures" / "crafted" / "plus-plant.pcapng"
    gathered = gathered_of([path], hosts=names)
    page = render([Side(gathered, [path.name])], "0")
    assert "192.0.2.10:49320 to 192.0.2.20:102" in page_of(path)
    assert "Desk:49320 to Press:102" in page
    assert "Desk:49320 to Press:102" in json.dumps(Data(gathered, "").as_dict()["marks"])
    assert not re.findall(
        r">[^<]*192\.0\.2\.[^<]*<", re.sub(r"<(script|code)[^>]*>.*?</\1>", "", page, flags=re.DOTALL)
    )


def test_wireshark_is_not_asked_for_s7comm_where_it_does_not_look_for_it() -> None:
    """It reads neither IBH-NetLink nor S7comm on other ports."""
    for name, expected in (("crafted/netlink", "ip.addr == 192.0.2.20"), ("szl", "s7comm && ip.addr == 192.0.2.20")):
        tables = Data(gathered_of([ROOT / "captures" / f"{name}.pcapng"]), "").as_dict()["tables"]
        (functions,) = [table for table in tables if table["name"] == "functions"]
        assert {re.sub(r"[\d.]+$", "192.0.2.20", row["filter"]) for row in functions["rows"]} == {expected}
