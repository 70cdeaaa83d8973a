"""What a test says wrongly, and sessions that are none to keep."""

from __future__ import annotations

import pytest

from tests.testing.projects import CLIENT, Project

pytest_plugins = ["pytester"]

REFUSED = """
import pytest

def test_pump(s7_server, s7_record, s7_golden):
    line = s7_record(to=s7_server("pump"ALLOWED))
    with connected(line) as client:
        client.db_read(1, 116, 1)
        with pytest.raises(Exception):
            client.db_read(1, 4000, 2)
    s7_golden.check(line)
"""


@pytest.mark.parametrize("update", ["new", "all"])
def test_a_session_that_was_not_recorded_is_no_golden(project: Project, update: str) -> None:
    project.test(CLIENT + REFUSED.replace("ALLOWED", ""))
    golden = project.golden()
    if update == "all":
        golden.parent.mkdir(parents=True)
        golden.write_text("s7dissect golden 1\n")
    result = project.run("--s7-update", update)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            "*test_pump.s7.txt is not written: a fake PLC received a request that was not recorded, *",
            "*s7_server call*",
            "*: not recorded: DB1.DBB4000 x2 (nearest recorded: *)",
        ]
    )
    assert "written tests" not in result.stdout.str()
    assert golden.read_text() == "s7dissect golden 1\n" if update == "all" else not golden.exists()
    project.test(CLIENT + REFUSED.replace("ALLOWED", ", unmatched='allow'"))
    project.run("--s7-update", update).assert_outcomes(passed=1)
    assert "DB1.DBB4000" in golden.read_text()


MISTAKES = """
def test_pump(s7_golden, s7_server, s7_record, tmp_path):
    {}
"""


@pytest.mark.parametrize(
    ("mistake", "told"),
    [
        ("s7_golden.check('pomp')", "FileNotFoundError: no capture tests/captures/pomp; *"),
        ("s7_golden.check(None)", "TypeError: None is not a capture, a session or a path"),
        ("s7_golden.check('pump', name=3)", "TypeError: name=3: the name of a golden must be a string"),
        ("s7_golden.check('pump', ignore='all')", "ValueError: 'all' is not a kind of difference; known kinds: *"),
        ("s7_golden.check('../test_pump.py')", "*CaptureError: *test_pump.py: not a capture file *"),
        ("s7_golden.check('../bad.s7.txt')", "*GoldenError: *bad.s7.txt*"),
        ("s7_server('pomp')", "FileNotFoundError: no capture tests/captures/pomp; *"),
        ("s7_server('../test_pump.py')", "*Error: *test_pump.py: not a capture file *"),
        ("s7_server('pump', faults=['drop'])", "ValueError: 'drop' is not a fault: expected KIND:WHERE, *"),
        ("s7_server('pump', faults='drop')", "ValueError: 'drop' is not a fault: expected KIND:WHERE, *"),
        ("s7_server('pump', latency_ms=-1)", "ValueError: latency_ms=-1: give 0 to 3600000, or None for *"),
        ("s7_golden.check('pump', latency=20)", "ValueError: latency=20: a tolerance is a text such as '20%', *"),
        ("s7_record(to=None)", "TypeError: to=None: give the address of the PLC: *"),
        ("s7_record(to='127.0.0.1:x')", "*AddressError: '127.0.0.1:x' is not an address: expected HOST:PORT, *"),
    ],
)
def test_a_mistake_is_told_at_its_line_and_not_inside_the_plugin(project: Project, mistake: str, told: str) -> None:
    (project.path / "tests" / "bad.s7.txt").write_text("s7dissect golden 1\nnonsense\n")
    project.test(MISTAKES.format(mistake))
    result = project.run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines([f">   *{mistake.replace('[', '[[]')}", f"E   *{told}", "", "tests/test_pump.py:3: *"])
    assert "dissect/" not in result.stdout.str()
