from __future__ import annotations

import os
import shutil

import pytest

from dissect.packets.source.pcapng_writer import PcapngWriter
from tests.testing.projects import Project, section

pytest_plugins = ["pytester"]

ONE = """
def test_pump(s7_golden):
    s7_golden.check("pump")
"""


def written(project: Project, body: str = ONE) -> None:
    """Let a project have its goldens."""
    project.test(body)
    project.run("--s7-update", "new").assert_outcomes(passed=body.count("def test_"))


def test_a_missing_golden_fails_and_says_what_to_do(project: Project) -> None:
    project.test(ONE)
    result = project.run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            "there is no golden tests/goldens/test_pump/test_pump.s7.txt yet.",
            "  recorded: 5 transactions on 1 connection, in tests/captures/pump.pcapng",
            "To keep the recording: pytest --s7-update new, *",
        ],
        consecutive=True,
    )
    result.stdout.no_fnmatch_line("*def test_pump*")
    assert not project.goldens.exists()


@pytest.mark.parametrize("update", ["new", "all"])
def test_a_missing_golden_is_written_when_asked(project: Project, update: str) -> None:
    project.test(ONE)
    result = project.run("--s7-update", update)
    result.assert_outcomes(passed=1)
    assert section(result)[0] == "written tests/goldens/test_pump/test_pump.s7.txt"
    text = project.golden().read_text()
    assert text.startswith("s7dissect golden 1\n")
    assert "DB1.DBB116 BYTE = 116" in text
    assert project.golden().stat().st_mode & 0o777 == 0o666 & ~umask()
    again = project.run()
    again.assert_outcomes(passed=1)
    assert section(again) == []
    assert project.listed() == ["test_pump/test_pump.s7.txt"]


def umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_a_change_fails_in_the_words_of_the_diff(project: Project) -> None:
    written(project)
    project.change("DB1.DBB116 BYTE = 116", "DB1.DBB116 BYTE = 117")
    changed = project.golden().read_text()
    for update in ("none", "new"):
        result = project.run("--s7-update", update)
        result.assert_outcomes(failed=1)
        result.stdout.fnmatch_lines(
            [
                "session differs from golden tests/goldens/test_pump/test_pump.s7.txt (was = golden, is = this run):",
                "  transaction 2, READ DB1.DBB116: was 117, is 116",
                "  recorded: tests/captures/pump.pcapng",
                "If the change is intended: pytest --s7-update all, *",
            ],
            consecutive=True,
        )
        result.stdout.no_fnmatch_line("*def test_pump*")
        assert project.golden().read_text() == changed


def test_a_change_is_written_when_all_are_asked_for(project: Project) -> None:
    written(project)
    text = project.change("DB1.DBB116 BYTE = 116", "DB1.DBB116 BYTE = 117")
    result = project.run("--s7-update", "all")
    result.assert_outcomes(passed=1)
    assert section(result)[0] == "changed tests/goldens/test_pump/test_pump.s7.txt"
    assert project.golden().read_text() == text
    assert project.listed() == ["test_pump/test_pump.s7.txt"]


def test_what_did_not_change_is_not_written_again(project: Project) -> None:
    written(project)
    project.golden().write_text(project.golden().read_text() + "# reviewed\n")
    result = project.run("--s7-update", "all")
    result.assert_outcomes(passed=1)
    assert section(result) == []
    assert project.golden().read_text().endswith("# reviewed\n")


def test_what_is_ignored_is_not_written_either(project: Project) -> None:
    written(project, ONE.replace('"pump"', '"pump", ignore=["values:DB1.DBB116"]'))
    project.change("DB1.DBB116 BYTE = 116", "DB1.DBB116 BYTE = 117")
    result = project.run("--s7-update", "all")
    result.assert_outcomes(passed=1)
    assert "BYTE = 117" in project.golden().read_text()
    project.change("DB1.DBB232 BYTE = 232", "DB1.DBB232 BYTE = 1")
    project.run().assert_outcomes(failed=1)


def test_an_ignored_kind_that_is_none_is_an_error(project: Project) -> None:
    project.test(ONE.replace('"pump"', '"pump", ignore="nonsense"'))
    result = project.run("--s7-update", "new")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*ValueError: 'nonsense' is not a kind of difference; known kinds: connections, *"])
    assert not project.goldens.exists()


def test_answer_times_are_kept_and_compared_when_asked(project: Project) -> None:
    written(project)
    assert "latency" not in project.golden().read_text()
    project.test(ONE.replace('"pump"', '"pump", latency="50%"'))
    result = project.run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["  the golden has no answer times to compare"])
    project.run("--s7-update", "all").assert_outcomes(passed=1)
    lines = project.golden().read_text().splitlines()
    times = [line for line in lines if line.startswith("  latency ")]
    assert len(times) == 5
    project.run().assert_outcomes(passed=1)
    project.change(times[1], "  latency 9000000000 ns")
    result = project.run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["  transaction 2, READ *: answer time was 9.00 s, is *"])


def test_only_what_is_selected_is_kept_and_compared(project: Project) -> None:
    project.test(ONE.replace('"pump"', '"pump", where="function == read and address overlaps DB1"'))
    project.run("--s7-update", "new").assert_outcomes(passed=1)
    kept = [line for line in project.golden().read_text().splitlines() if line.startswith("  ") and " = " in line]
    assert kept
    assert all([line.startswith("  DB1.") for line in kept])
    project.run().assert_outcomes(passed=1)
    project.test(ONE.replace('"pump"', '"pump", where="functoin == read"'))
    result = project.run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*no field 'functoin'*"])


def test_a_failure_says_as_much_as_can_be_read(project: Project) -> None:
    project.add_capture("read-areas-python", "pump")
    written(project)
    lines = project.golden().read_text().splitlines()
    numbers = [line for line in lines if line and line[0].isdigit()]
    project.golden().write_text("\n".join(lines[: lines.index(numbers[1])]) + "\n")  # all but the set-up
    result = project.run()
    result.assert_outcomes(failed=1)
    told = [line for line in result.stdout.lines if line.startswith("  transaction ")]
    assert len(told) == 20
    assert max(map(len, told)) < 450
    result.stdout.fnmatch_lines([f"  and {len(numbers) - 1 - 20} further differences"])


def test_a_change_is_told_by_the_tags_of_the_project(project: Project) -> None:
    (project.path / "tags.csv").write_text("address,type,name,unit\nDB1.DBB116,BYTE,Tank.Level,cm\n")
    project.ini("s7_tags = tags.csv")
    written(project)
    project.change("DB1.DBB116 BYTE = 116", "DB1.DBB116 BYTE = 117")
    result = project.run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*READ Tank.Level (DB1.DBB116): was 117 cm, is 116 cm"])


def test_a_second_golden_of_a_test_takes_a_name(project: Project) -> None:
    project.test(ONE + '    s7_golden.check("pump")\n')
    result = project.run("--s7-update", "new")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*test_pump.s7.txt was already checked in this test: give this one a name*"])
    project.test(ONE + '    s7_golden.check("pump", name="after the stop/start")\n')
    project.run("--s7-update", "new").assert_outcomes(passed=1)
    assert project.listed() == ["test_pump/test_pump-after the stop%2Fstart.s7.txt", "test_pump/test_pump.s7.txt"]
    project.run().assert_outcomes(passed=1)


def test_each_test_has_a_golden_of_its_own(project: Project) -> None:
    body = """
import pytest

class TestPump:
    @pytest.mark.parametrize("address", ["DB1/2", "ä"])
    def test_reads(self, s7_golden, address):
        s7_golden.check("pump")
"""
    project.ini("addopts = --import-mode=importlib")
    project.test(body)
    project.test(ONE, "tests/line/test_pump.py")
    project.test(ONE, "other/test_pump.py")
    project.run("--s7-update", "new").assert_outcomes(passed=4)
    assert project.listed() == [
        "__/other/test_pump/test_pump.s7.txt",
        "line/test_pump/test_pump.s7.txt",
        "test_pump/TestPump.test_reads[%5Cxe4].s7.txt",
        "test_pump/TestPump.test_reads[DB1%2F2].s7.txt",
    ]
    result = project.run()
    result.assert_outcomes(passed=4)
    assert section(result) == []


def test_what_can_be_checked(project: Project) -> None:
    body = """
from pathlib import Path

def test_all(s7_golden, s7_capture):
    s7_golden.check("pump", name="a name")
    s7_golden.check(s7_capture("pump"), name="a capture")
    s7_golden.check(s7_capture("pump").path, name="a path")
    s7_golden.check(s7_capture("pump").session(), name="a session")
    s7_golden.check(s7_golden.path("a name"), name="a golden")

def test_wrong(s7_golden):
    s7_golden.check(42)
"""
    project.test(body)
    result = project.run("--s7-update", "new")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*TypeError: 42 is not a capture, a session or a path"])
    texts = {one.read_bytes() for one in project.goldens.rglob("*.s7.txt")}
    assert len(texts) == 1
    assert len(project.listed()) == 5


def test_a_damaged_capture_is_no_session(project: Project) -> None:
    path = project.captures / "pump.pcapng"
    path.write_bytes(path.read_bytes()[:-100])
    project.test(ONE)
    result = project.run("--s7-update", "all")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["tests/captures/pump.pcapng is damaged, so it cannot be compared: *"])
    assert not project.goldens.exists()


def test_a_capture_without_a_connection_is_no_session(project: Project) -> None:
    path = project.captures / "pump.pcapng"
    PcapngWriter(str(path), overwrite=True).close()
    project.test(ONE)
    result = project.run("--s7-update", "all")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["tests/captures/pump.pcapng has no connections, so there is nothing to compare"])
    assert not project.goldens.exists()


def test_a_selection_of_nothing_is_told(project: Project) -> None:
    project.test("""
def test_pump(s7_golden):
    s7_golden.check("pump", where="function == plc_stop")
""")
    result = project.run("--s7-update", "all")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["where='function == plc_stop' selects nothing of tests/captures/pump.pcapng, so *"])
    assert not project.goldens.exists()


def test_a_golden_that_cannot_be_read_is_told_with_its_line(project: Project) -> None:
    written(project)
    text = project.change("DB1.DBB116 BYTE = 116", "DB1.DBB116 BYTE = many")
    result = project.run()
    result.assert_outcomes(failed=1)
    number = text.splitlines().index("  DB1.DBB116 BYTE = 116") + 1
    result.stdout.fnmatch_lines([f"  *test_pump.s7.txt: line {number}: *"])
    project.run("--s7-update", "all").assert_outcomes(passed=1)
    assert project.golden().read_text() == text


def test_folders_are_settings_from_the_ini_file(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    project.ini("s7_captures = recorded\ns7_goldens = expected/s7")
    shutil.move(project.captures, project.path / "recorded")
    project.test(ONE)
    monkeypatch.chdir(project.path / "tests")
    project.run("--s7-update", "new", "test_pump.py").assert_outcomes(passed=1)
    assert (project.path / "expected/s7/__/tests/test_pump/test_pump.s7.txt").is_file()
    project.run().assert_outcomes(passed=1)


def test_without_an_ini_file_the_folders_do_not_depend_on_what_is_run(project: Project) -> None:
    (project.path / "pytest.ini").unlink()
    project.test(ONE)
    project.run("--s7-update", "new", "tests/test_pump.py").assert_outcomes(passed=1)
    project.run().assert_outcomes(passed=1)
    assert project.listed() == ["test_pump/test_pump.s7.txt"]


def test_a_golden_that_cannot_be_written_leaves_nothing_behind(project: Project) -> None:
    written(project)
    project.change("DB1.DBB116 BYTE = 116", "DB1.DBB116 BYTE = 117")
    before = project.golden().read_text()
    project.test(
        """
import os
import pytest

@pytest.fixture(autouse=True)
def full(monkeypatch):
    def fail(*_):
        raise OSError(28, "No space left on device")
    monkeypatch.setattr("pathlib.Path.replace", fail)
"""
        + ONE
    )
    result = project.run("--s7-update", "all")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*No space left on device*"])
    assert project.golden().read_text() == before
    assert project.listed() == ["test_pump/test_pump.s7.txt"]


def test_the_option_is_in_the_help(project: Project) -> None:
    result = project.run("--help")
    result.stdout.fnmatch_lines(["*--s7-update={none,new,all}*", "*s7_captures*", "*s7_goldens*"])


def test_s7comm_plus_is_kept_and_compared(project: Project) -> None:
    project.add_capture("s7plus/s7commplus", "plus")
    project.test("def test_plus(s7_golden):\n    s7_golden.check('plus')\n", "tests/test_plus.py")
    project.run("--s7-update", "new").assert_outcomes(passed=1)
    project.run().assert_outcomes(passed=1)
    golden = project.golden("test_plus/test_plus")
    text = golden.read_text()
    assert "41 ac 00 00" in text
    golden.write_text(text.replace("41 ac 00 00", "41 ad 00 00"))
    project.run().assert_outcomes(failed=1)
