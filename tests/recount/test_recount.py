"""Every sentence with a number, a name or a time is recounted, in all outputs and over all captures."""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest

from dissect.meaning.report.analysis import MAX_CONNECTIONS
from tests.meaning.report.support import WORD, begun, read, saved
from tests.meaning.report.test_many_pairs import stops
from tests.recount.gathering import Recounted, captures_in, differences, recounted, rows
from tests.recount.kinds import KINDS
from tests.recount.recount import is_duration, is_moment, is_size, is_time_of_day, main, quantile

ROOM: Final = Path(__file__).parent
#: What reads outputs and counts; the other modules of this room make the outputs.
INDEPENDENT: Final = ("recount", "kinds", "pages", "details", "counted", "packets")


def test_all_captures_of_the_project(project: list[Recounted], record_property: Callable[[str, object], None]) -> None:
    found = rows(project)
    for kind, number, wrong in found:
        print(f"{kind:50} {number:8} {wrong:8}")
    record_property("recounted", sum([number for _, number, _ in found]))
    assert differences(project) == ""


def test_how_much_is_recounted(project: list[Recounted]) -> None:
    found = rows(project)
    assert len(found) >= 100
    assert sum([number for _, number, _ in found]) >= 30_000
    assert {claim.face for one in project for claim in one.claims} == set(KINDS)


def test_who_recounts_imports_nothing_of_the_package() -> None:
    for name in INDEPENDENT:
        tree = ast.parse((ROOM / f"{name}.py").read_text(encoding="utf-8"))
        imported = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        imported += [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
        assert [one for one in imported if one.split(".")[0] == "dissect"] == []
        assert [one for one in imported if one.startswith("tests.") and one.split(".")[-1] not in INDEPENDENT] == []


@pytest.mark.parametrize("count", [3, 300, 1300])
def test_a_read_refused_again_and_again_is_counted_alike_everywhere(tmp_path: Path, count: int) -> None:
    """More often than findings are detailed: text, page, screens, alerts and exports say the same."""
    talk = begun()
    for number in range(count):
        read(talk, number + 1, WORD, 0x0A)
    found = recounted(saved(tmp_path / "a.pcapng", talk.packets(step_ns=10**9)))
    assert differences([found]) == ""
    said = {claim.kind: claim.said for claim in found.claims if "times it happened" in claim.kind}
    assert {said[kind] for kind in ("finding: times it happened", "brief: times it happened")} == {str(count)}
    assert len([claim for claim in found.claims if claim.kind.startswith("per function")]) >= 7


def test_more_connections_than_are_kept_are_counted_alike_everywhere(tmp_path: Path) -> None:
    """A thousand PLC stops of one PLC, in a connection each, then one of another PLC."""
    found = recounted(saved(tmp_path / "a.pcapng", stops(["10.0.0.2"] * (MAX_CONNECTIONS + 3) + ["10.0.0.3"])))
    assert differences([found]) == ""
    plcs = [claim.said for claim in found.claims if claim.kind == "brief: answered of a PLC"]
    assert plcs == [str(2 * (MAX_CONNECTIONS + 3)), "2"]


def test_the_outputs_in_a_folder_are_recounted(
    tmp_path: Path, project: list[Recounted], capsys: pytest.CaptureFixture[str]
) -> None:
    one = next(one for one in project if one.path.name == "item-errors.pcapng")
    for name, text in one.outputs.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    assert main(tmp_path, one.path) == 0
    (tmp_path / "analyze.txt").write_text(
        one.outputs["analyze.txt"].replace("8 answered", "9 answered"), encoding="utf-8"
    )
    assert main(tmp_path, one.path) == 1
    assert "analyze.txt: headline: answered: says 9, counted 8" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("said", "ns", "right"),
    [
        ("52 µs", 52_263, True),
        ("53 µs", 52_263, False),
        ("0.3 µs", 300, True),
        ("1.26 ms", 1_260_000, True),
        ("1.27 ms", 1_260_000, False),
        ("14 min 34 s", 874_900_000_000, True),
        ("14 min 33 s", 874_900_000_000, False),
        ("-5.0 µs", -5000, True),
        ("5.0 µs", -5000, False),
        ("nothing", 0, False),
    ],
)
def test_durations(said: str, ns: int, right: bool) -> None:
    assert is_duration(said, ns) is right


def test_times_and_sizes() -> None:
    ns = 1_795_224_665_693_204_999
    assert is_moment("2026-11-21 01:31:05.693204 UTC", ns)
    assert not is_moment("2026-11-21 01:31:05.693205 UTC", ns)
    assert is_time_of_day("01:31:05.693", ns)
    assert is_time_of_day("01:31:05", ns)
    assert not is_time_of_day("01:31:06", ns)
    assert is_size("4.0 kB", 4030)
    assert not is_size("4.1 kB", 4030)
    assert not is_size("403 B", 402)
    assert [quantile([1, 2, 3, 4], share) for share in (0.25, 0.5, 0.95)] == [1, 2, 4]


def test_shared_captures(corpus: Path) -> None:
    """Public captures: what was never seen while this was written."""
    found = [recounted(path) for path in captures_in(corpus)]
    assert sum([number for _, number, _ in rows(found)]) >= 60_000
    assert differences(found) == ""
