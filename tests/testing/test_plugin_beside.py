"""The plugin beside plugins of others that change how tests are run and shown."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest

from tests.foreign import install
from tests.testing.projects import Project, section

pytest_plugins = ["pytester"]

#: Runs tests in another order, and one that fails a second time; a fixture of its own is around each.
ORDER: Final = """
import random
import pytest
from _pytest.runner import runtestprotocol

@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    items.reverse()

@pytest.fixture(autouse=True)
def _seeded():
    random.seed(1)
    yield

def pytest_runtest_protocol(item, nextitem):
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for attempt in range(2):
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        if not any(report.failed for report in reports):
            break
        item._initrequest()
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True
"""
#: Takes the place of what pytest writes with.
SHOWING: Final = """
import pytest
from _pytest.terminal import TerminalReporter

class Reporter(TerminalReporter):
    pass

@pytest.hookimpl(trylast=True)
def pytest_configure(config):
    standing = config.pluginmanager.getplugin("terminalreporter")
    config.pluginmanager.unregister(standing)
    config.pluginmanager.register(Reporter(standing.config), "terminalreporter")
"""
TESTS: Final = """
def test_pump(s7_golden):
    s7_golden.check("pump")

def test_valve(s7_golden):
    s7_golden.check("pump")
"""


def test_goldens_are_kept_beside_foreign_plugins(
    project: Project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD")
    monkeypatch.syspath_prepend(str(install(tmp_path / "site", order=ORDER, showing=SHOWING)))
    project.test(TESTS)
    result = project.run("--s7-update", "new", "-v")
    result.assert_outcomes(passed=2)
    result.stdout.fnmatch_lines(["*::test_valve PASSED*", "*::test_pump PASSED*"])
    names = [f"test_pump/{name}.s7.txt" for name in ("test_pump", "test_valve")]
    assert project.listed() == names
    assert [line for line in section(result) if "written" in line] == [
        f"written tests/goldens/{name}" for name in names
    ]
    project.change("BYTE = 116", "BYTE = 117")
    result = project.run()
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*session differs from golden tests/goldens/test_pump/test_pump.s7.txt*"])
    assert project.listed() == names
