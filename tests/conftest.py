"""What every test shares: which build is under test, where captures are, how hard the property tests try."""

from __future__ import annotations

import atexit
import gc
import io
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Final, TextIO

import hypothesis
import pytest

ROOT: Final = Path(__file__).resolve().parent.parent
#: The build that must be under test. By default it is this tree, so that a change is tested directly.
EXPECTED: Final = os.environ.get("S7DISSECT_EXPECT")
if EXPECTED is None:
    sys.path.insert(0, str(ROOT))

import dissect  # noqa: E402 - which package that is was decided above
from dissect.wire.build import COMPILED  # noqa: E402

pytest_plugins: Final = ("dissect.testing.plugin", "tests.skips")
#: The plugins of others that the tests use, by the names of their entry points. No other is loaded (pyproject.toml).
OTHERS: Final = ("hypothesispytest", "xdist")

LOCATION: Final = Path(dissect.__file__).resolve().parent
MODE: Final = "compiled" if COMPILED else "interpreted"

# At the end of the path, after `dissect` is imported: tests may import `tests.…` and `benchmarks.…`, and still test the
# installed package.
sys.path.append(str(ROOT))

# Processes that tests start find the same package, in whatever folder they run.
os.environ["PYTHONSAFEPATH"] = "1"
# Nor do pytest runs that tests start load plugins that happen to be installed.
os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
if LOCATION.parent == ROOT:
    os.environ["PYTHONPATH"] = str(ROOT)


# Files that would wait on this machine for the next start are put in a folder of the run instead.
os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="s7dissect-state-")
os.environ.pop("STATE_DIRECTORY", None)
# Workers ask tshark the same questions: they share the folder of the process that starts them (tests/tshark.py).
os.environ.setdefault("S7DISSECT_TSHARK_ANSWERS", os.environ["XDG_STATE_HOME"])
# The same for settings: those of the user who runs the tests must not be used.
os.environ["XDG_CONFIG_HOME"] = os.environ["XDG_STATE_HOME"]
os.environ["XDG_CACHE_HOME"] = os.environ["XDG_STATE_HOME"]
atexit.register(shutil.rmtree, os.environ["XDG_STATE_HOME"], ignore_errors=True)


def pytest_addoption(pluginmanager: pytest.PytestPluginManager) -> None:
    """Load the plugins that are used, if they are installed and `-p no:NAME` does not forbid it."""
    for name in OTHERS:
        pluginmanager.load_setuptools_entrypoints("pytest11", name)


def pytest_configure(config: pytest.Config) -> None:
    """Refuse to test another build than the requested one, or an installed package that differs from this tree."""
    if EXPECTED is not None and EXPECTED != MODE:
        message = f"S7DISSECT_EXPECT={EXPECTED}, but the package in {LOCATION} runs {MODE}"
        raise pytest.UsageError(message)
    stale = _differing()
    if stale:
        message = (
            f"the package in {LOCATION} is not this tree ({', '.join(stale[:5])}): install it again, or run `make test`"
        )
        raise pytest.UsageError(message)
    examples = os.environ.get("S7DISSECT_EXAMPLES")
    slow = [hypothesis.HealthCheck.too_slow]  # two workers on two cores also wait for each other
    hypothesis.settings.register_profile(
        "ci",
        max_examples=int(examples or 100),
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=slow,
    )
    hypothesis.settings.register_profile(
        "dev", max_examples=int(examples or 100), deadline=None, suppress_health_check=slow
    )
    hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "dev")


#: Random choices can be repeated with this number: in CI it is always the same, elsewhere a new one each time (the header shows
#: it).
SEED: Final = os.environ.setdefault("S7DISSECT_SEED", "0" if os.environ.get("CI") else str(random.randrange(1_000_000)))


@pytest.fixture(autouse=True)
def _dice(request: pytest.FixtureRequest) -> None:
    """Let each test draw its own numbers, whichever tests ran before it: Scapy's ``fuzz()`` draws from ``random``."""
    random.seed(f"{SEED} {request.node.nodeid}")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Pause Python's collector while tests are collected, never scan the objects made then, and scan the rest seldom.

    Everything that is imported and collected stays until the end. Scanning it again and again took a seventh of the run.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()
        gc.set_threshold(20_000, 20, 100)


def pytest_report_header(config: pytest.Config) -> str:
    """Say what is tested."""
    return f"s7dissect {dissect.__version__} ({MODE}) from {LOCATION}, S7DISSECT_SEED={SEED}"


def _differing() -> list[str]:
    """Return the modules that differ between this tree and the package under test (none if it is the tree)."""
    tree = {path.relative_to(ROOT / "dissect"): path for path in (ROOT / "dissect").rglob("*.py")}
    tested = {path.relative_to(LOCATION): path for path in LOCATION.rglob("*.py")}
    # A site-packages shared with another project's `dissect.…` has more folders than ours.
    rooms = {name.parts[0] for name in tree}
    return sorted(
        name.as_posix()
        for name in tree.keys() | {name for name in tested if name.parts[0] in rooms}
        if name not in tree or name not in tested or tree[name].read_bytes() != tested[name].read_bytes()
    )


def _output() -> TextIO:
    """Return a replacement for standard output: a text stream with a descriptor, into a file without a name."""
    return io.TextIOWrapper(tempfile.TemporaryFile(), encoding="utf-8", newline="")


def _written(stream: TextIO) -> bytes:
    stream.flush()
    stream.buffer.seek(0)
    return stream.buffer.read()


class Command:
    """The command line: in this process, or in its own if standard input or output matter."""

    def __call__(
        self, *arguments: str | Path, stdin: bytes = b"", stdout: int | None = None
    ) -> subprocess.CompletedProcess[bytes]:
        """Run ``s7dissect`` with ``arguments``; ``stdout`` is a file descriptor to write to instead of being collected."""
        if stdin or stdout is not None:
            return self.process(*arguments, stdin=stdin, stdout=stdout)
        from dissect.cli.main import main

        with _output() as out, _output() as err:
            standing = sys.stdout, sys.stderr
            sys.stdout, sys.stderr = out, err
            try:
                main([str(argument) for argument in arguments])
                code: object = "it returned"
            except SystemExit as end:
                code = end.code
            finally:
                sys.stdout, sys.stderr = standing
            assert isinstance(code, int), code
            written = [_written(stream) for stream in (out, err)]
        return subprocess.CompletedProcess(arguments, code, *written)

    def process(
        self, *arguments: str | Path, stdin: bytes = b"", stdout: int | None = None
    ) -> subprocess.CompletedProcess[bytes]:
        """Run it as a separate process."""
        from tests.forked import Forked

        with Forked(list(map(str, arguments)), stdout=subprocess.PIPE if stdout is None else stdout) as process:
            out, err = process.communicate(stdin)
            return subprocess.CompletedProcess(arguments, process.wait(), out if stdout is None else None, err)


@pytest.fixture(scope="session")
def s7dissect() -> Command:
    """Run the command line: ``s7dissect("analyze", path).stdout``."""
    return Command()


@pytest.fixture(scope="session")
def corpus() -> Path:
    """The folder of the shared public captures, which are not part of this repository."""
    path = Path(os.environ.get("S7DISSECT_CORPUS") or ROOT.parent / "shared" / "captures")
    if not path.is_dir():
        if os.environ.get("S7DISSECT_CORPUS"):
            pytest.fail(f"S7DISSECT_CORPUS names {path}, which is no folder")
        pytest.skip(f"no shared captures in {path} (S7DISSECT_CORPUS names their folder)")
    return path


@pytest.fixture(scope="session")
def reference(corpus: Path) -> Path:
    """The folder of the protocol reference, beside the shared captures."""
    path = corpus.parent / "reference"
    if not path.is_dir():
        pytest.skip(f"no protocol reference in {path}")
    return path


@pytest.fixture(scope="session")
def capture() -> Callable[[str], Path]:
    """Return the path of one of our own captures by its file name."""

    def path_of(name: str) -> Path:
        path = ROOT / "captures" / name
        assert path.is_file(), f"captures/{name} is part of the repository and missing"
        return path

    return path_of
