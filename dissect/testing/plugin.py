"""The pytest plugin: fixtures ``s7_capture``, ``s7_golden``, ``s7_server`` and ``s7_record`` (docs/pytest.md).

The engine is only imported when a fixture is used.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest

from dissect.testing.golden_files import ALL, NEW, NONE, GoldenFiles

if TYPE_CHECKING:
    from dissect.engine.transactions.naming import Naming
    from dissect.testing.captures import CaptureFolder
    from dissect.testing.golden_check import GoldenCheck
    from dissect.testing.recorder import Recorders
    from dissect.testing.servers import Servers

#: Key of a worker's results on their way to the controller.
_ACCOUNT: Final = "s7dissect"
#: Maximum number of goldens of each kind in the summary.
_MOST: Final = 20
#: Entries of the summary: the prefix of a path, and the advice.
_WRITTEN: Final = "written"
_CHANGED: Final = "changed"
_UNUSED: Final = "unused"

_LEDGER: Final = pytest.StashKey[GoldenFiles]()
_SERVERS: Final = pytest.StashKey["Servers"]()
_RECORDERS: Final = pytest.StashKey["Recorders"]()
_TAGS: Final = pytest.StashKey["Naming"]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option and the settings."""
    group = parser.getgroup("s7dissect", "S7 sessions (s7dissect)")
    group.addoption(
        "--s7-update",
        choices=(NONE, NEW, ALL),
        default=NONE,
        help="Goldens to write: none (the default: a missing one fails), new (missing goldens), all (also "
        "goldens that differ). Goldens are never deleted.",
    )
    parser.addini("s7_captures", "Folder of captures, from the ini file.", default="tests/captures")
    parser.addini(
        "s7_tags", "Files of tags, from the ini file: failures show values by their names.", "linelist", default=[]
    )
    parser.addini("s7_goldens", "Folder of goldens, from the ini file.", default="tests/goldens")


def pytest_configure(config: pytest.Config) -> None:
    """Watch which tests run, but only if there are goldens that may be unused."""
    ledger = config.stash[_LEDGER] = GoldenFiles(_folder(config, "s7_goldens"))
    if ledger.goldens.is_dir():
        config.pluginmanager.register(_Watch(ledger), "s7dissect-watch")


def _folder(config: pytest.Config, setting: str) -> Path:
    # Without an ini file, pytest's root depends on its arguments.
    root = config.inipath.parent if config.inipath is not None else config.invocation_params.dir
    return root / str(config.getini(setting))


# ---- fixtures -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def s7_capture(pytestconfig: pytest.Config) -> CaptureFolder:
    """Open a capture of the project: ``s7_capture("pump").transactions()``."""
    from dissect.testing.captures import CaptureFolder

    return CaptureFolder(_folder(pytestconfig, "s7_captures"))


@pytest.fixture
def s7_golden(request: pytest.FixtureRequest, s7_capture: CaptureFolder) -> GoldenCheck:
    """Compare a session with the golden of this test: ``s7_golden.check(recorder)``."""
    from dissect.testing.golden_check import GoldenCheck

    config = request.config
    test = (request.node.nodeid, request.node.path)
    update = str(config.getoption("--s7-update"))
    naming = _naming(config)
    return GoldenCheck(config.stash[_LEDGER], s7_capture, test, update, lambda: _has_unmatched(request.node), naming)


def _naming(config: pytest.Config) -> Naming | None:
    """Return the names of values from the files of ``s7_tags``, read once; None without files."""
    files = config.getini("s7_tags")
    if not files:
        return None
    if _TAGS not in config.stash:
        from dissect.meaning.tags import load_tags

        root = config.inipath.parent if config.inipath is not None else config.invocation_params.dir
        config.stash[_TAGS] = load_tags([root / file for file in files]).naming()
    return config.stash[_TAGS]


@pytest.fixture
def s7_server(request: pytest.FixtureRequest, s7_capture: CaptureFolder) -> Iterator[Servers]:
    """Start a fake PLC from a capture: ``s7_server("pump").port``; a request it cannot answer fails the test."""
    from dissect.testing.servers import Servers

    servers = Servers(s7_capture)
    request.node.stash[_SERVERS] = servers
    yield servers
    servers.close()
    complaint = servers.complaint()
    if complaint:
        pytest.fail(complaint, pytrace=False)


@pytest.fixture
def s7_record(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Recorders]:
    """Record the traffic to a PLC: ``s7_record(to=("127.0.0.1", 102)).port``."""
    from dissect.testing.recorder import Recorders

    recorders = Recorders(tmp_path)
    request.node.stash[_RECORDERS] = recorders
    yield recorders
    recorders.close()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Fail a test whose fake PLC received a request that was not recorded; if it fails anyway, add a report section.

    The problems of recorders are reported there, too: the client sees an unreachable PLC only as a reset.
    """
    try:
        result = yield
    except BaseException as error:
        complaint = _complaint(item)
        if complaint:
            item.add_report_section("call", "s7_server", complaint)
        problems = "\n".join([problem for problem in _problems(item) if problem not in str(error)])
        if problems:
            item.add_report_section("call", "s7_record", problems)
        raise
    complaint = _complaint(item)
    if complaint:
        pytest.fail(complaint, pytrace=False)
    return result


def _has_unmatched(item: pytest.Item) -> bool:
    servers = item.stash.get(_SERVERS, None)
    return servers is not None and servers.has_unmatched()


def _problems(item: pytest.Item) -> list[str]:
    recorders = item.stash.get(_RECORDERS, None)
    return recorders.problems() if recorders is not None else []


def _complaint(item: pytest.Item) -> str:
    servers = item.stash.get(_SERVERS, None)
    return servers.complaint() if servers is not None else ""


# ---- which goldens are used -----------------------------------------------------------------------------------------


class _Watch:
    """Observes which tests were found and how they ended, to find unused goldens."""

    def __init__(self, ledger: GoldenFiles) -> None:
        self._ledger = ledger

    def pytest_itemcollected(self, item: pytest.Item) -> None:
        """Note a test that was found."""
        self._ledger.collected(item.nodeid, item.path)

    def pytest_deselected(self, items: Sequence[pytest.Item]) -> None:
        """Note tests that are not run."""
        for module in {item.path for item in items}:
            self._ledger.left_out(module)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note the end of a phase of a test; a controller gets it from its workers."""
        self._ledger.ended(report.nodeid, report.passed, report.when == "teardown")


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Pass the results of a worker to its controller."""
    output = getattr(session.config, "workeroutput", None)
    if output is not None:
        output[_ACCOUNT] = session.config.stash[_LEDGER].results()


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Take the results of a worker; there are none if it crashed."""
    ledger = node.config.stash[_LEDGER]
    results = getattr(node, "workeroutput", {}).get(_ACCOUNT)
    if results is None:
        ledger.whole = False
    else:
        ledger.add(results)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Report which goldens were written, and which are unused."""
    ledger = config.stash[_LEDGER]
    kinds = (
        (_WRITTEN, sorted(ledger.written), "review and commit them"),
        (_CHANGED, sorted(ledger.changed), "review and commit the changes"),
        (_UNUSED, _unused(ledger, config), "no test uses them: delete them if that is intended"),
    )
    if not any([paths for _, paths, _ in kinds]):
        return
    terminalreporter.write_sep("=", "s7dissect goldens")
    for kind, paths, advice in kinds:
        for path in paths[:_MOST]:
            terminalreporter.write_line(f"{kind} {_shown(ledger.goldens / path, config)}")
        if len(paths) > _MOST:
            terminalreporter.write_line(f"{kind} {len(paths) - _MOST} more")
        if paths:
            terminalreporter.write_line(f"  {advice}")


def _unused(ledger: GoldenFiles, config: pytest.Config) -> list[str]:
    if not ledger.goldens.is_dir() or config.getoption("lf", False):
        return []
    start = config.invocation_params.dir
    searched = []
    for argument in config.args:
        path, single, _ = argument.partition("::")
        place = start / path
        if not single:
            searched.append(place)
        elif place.is_file():
            ledger.left_out(place)
        else:
            return []
    return ledger.unused(searched, config.getini("python_files"))


def _shown(path: Path, config: pytest.Config) -> str:
    start = config.invocation_params.dir
    return str(path.relative_to(start) if path.is_relative_to(start) else path)
