from __future__ import annotations

import pytest

from tests.testing.projects import PLUGIN, Project, section

pytest_plugins = ["pytester"]

TWO = """
def test_pump(s7_golden):
    s7_golden.check("pump")

def test_valve(s7_golden):
    s7_golden.check("pump", name="open")
"""
ADVICE = "  no test uses them: delete them if that is intended"


@pytest.fixture
def two(project: Project) -> Project:
    """A project of two tests and their goldens, and one golden more."""
    project.test(TWO)
    project.run("--s7-update", "new").assert_outcomes(passed=2)
    project.golden("test_pump/test_gone").write_text("s7dissect golden 1\n")
    return project


UNUSED = ["unused tests/goldens/test_pump/test_gone.s7.txt", ADVICE]


def test_an_unused_golden_is_reported_and_stays(two: Project) -> None:
    for update in ("none", "new", "all"):
        result = two.run("--s7-update", update)
        result.assert_outcomes(passed=2)
        assert section(result) == UNUSED
        assert result.ret == 0
    assert two.golden("test_pump/test_gone").is_file()


@pytest.mark.parametrize(
    "arguments",
    [
        ["-k", "pump and not valve"],
        ["tests/test_pump.py::test_pump"],
        ["tests/test_pump.py::test_pump", "tests/test_pump.py::test_valve"],
        ["--deselect", "tests/test_pump.py::test_valve"],
        ["--collect-only"],
        ["--ignore=tests/test_pump.py"],
    ],
    ids=str,
)
def test_where_not_all_of_a_module_ran_nothing_is_said_of_it(two: Project, arguments: list[str]) -> None:
    assert section(two.run(*arguments)) == []


def test_other_modules_are_told_of_all_the_same(two: Project) -> None:
    two.test(TWO, "tests/test_line.py")
    two.run("--s7-update", "new").assert_outcomes(passed=4)
    assert section(two.run("tests/test_line.py")) == []
    assert section(two.run("tests/test_pump.py")) == UNUSED
    assert section(two.run("tests/test_pump.py", "tests/test_line.py::test_valve")) == UNUSED
    assert section(two.run("--deselect", "tests/test_line.py::test_valve")) == UNUSED


def test_a_run_that_was_broken_off_says_nothing(two: Project) -> None:
    two.test("def test_first():\n    assert False\n" + TWO)
    result = two.run("-x")
    result.assert_outcomes(failed=1)
    assert section(result) == []
    assert section(two.run()) == UNUSED


@pytest.mark.parametrize("line", ["assert False", "import pytest; pytest.skip()", "import pytest; pytest.xfail()"])
def test_goldens_of_tests_that_did_not_come_to_them_are_not_unused(two: Project, line: str) -> None:
    two.test(TWO.replace("    s7", f"    {line}\n    s7"))
    assert section(two.run()) == UNUSED
    two.test(TWO.replace("    s7", "    return\n    s7"))
    assert len(section(two.run("-W", "ignore"))) == 4


def test_after_failures_only_those_are_run_and_nothing_is_said(two: Project) -> None:
    two.test("import os\n" + TWO.replace("    s7", "    assert 'FAIL' not in os.environ\n    s7"))
    project, arguments = two.pytester, ("-p", "cacheprovider", "--lf")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FAIL", "1")
        project.runpytest_inprocess(*PLUGIN).assert_outcomes(failed=2)
    result = project.runpytest_inprocess(*PLUGIN, *arguments)
    result.assert_outcomes(passed=2)
    assert section(result) == []


def test_goldens_of_a_module_that_is_gone_are_unused(two: Project) -> None:
    two.golden("test_pump/test_gone").unlink()
    two.test(TWO, "tests/io/test_line.py")
    two.run("--s7-update", "new").assert_outcomes(passed=4)
    (two.path / "tests/io/test_line.py").unlink()
    kept = two.goldens / "by hand" / "line.s7.txt"
    kept.parent.mkdir()
    kept.write_text("s7dissect golden 1\n")
    gone = [f"unused tests/goldens/io/test_line/{name}.s7.txt" for name in ("test_pump", "test_valve-open")]
    assert section(two.run()) == [*gone, ADVICE]
    assert section(two.run("tests/io", "tests/test_pump.py")) == [*gone, ADVICE]
    assert section(two.run("tests/test_pump.py")) == []
    assert section(two.run("-k", "valve")) == []


def test_many_unused_are_counted(two: Project) -> None:
    for number in range(30):
        two.golden(f"test_pump/test_old{number:02}").write_text("")
    lines = section(two.run())
    assert lines[0] == UNUSED[0]
    assert lines[-2:] == ["unused 11 more", ADVICE]
    assert len(lines) == 22


def distributed(project: Project, *arguments: str) -> pytest.RunResult:
    """Run with workers."""
    plugins = ["-p", "xdist.plugin", "-p", "dissect.testing.plugin", "-p", "no:cacheprovider"]
    return project.pytester.runpytest_inprocess(*plugins, *arguments)


def test_under_xdist_workers_write_and_the_controller_tells(project: Project) -> None:
    names = [f"test_{number}" for number in range(6)]
    project.test("".join([f"def {name}(s7_golden):\n    s7_golden.check('pump')\n" for name in names]))
    result = distributed(project, "-n", "2", "--s7-update", "new")
    result.assert_outcomes(passed=6)
    told = [f"written tests/goldens/test_pump/{name}.s7.txt" for name in names]
    assert section(result) == [*told, "  review and commit them"]
    assert project.listed() == [f"test_pump/{name}.s7.txt" for name in names]
    project.golden("test_pump/test_gone").write_text("")
    project.change("BYTE = 116", "BYTE = 117", "test_pump/test_3")
    result = distributed(project, "-n", "2")
    result.assert_outcomes(passed=5, failed=1)
    result.stdout.fnmatch_lines(["  transaction 2, READ DB1.DBB116: was 117, is 116"])
    assert section(result) == UNUSED


def test_a_worker_that_dies_leaves_nothing_to_be_told(two: Project) -> None:
    two.test(TWO + "\ndef test_end():\n    import os\n    os._exit(3)\n")
    result = distributed(two, "-n", "1", "--max-worker-restart", "0")
    result.stdout.fnmatch_lines(["*worker 'gw0' crashed*"])
    assert section(result) == []
