"""The wheel as people get it: what is in it, beside another project's `dissect.…`, with and without a compiler."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import zipfile
from importlib.metadata import distribution
from pathlib import Path
from typing import Final

import pytest

import dissect

ROOT: Final = Path(__file__).resolve().parent.parent
SOURCES: Final = ("dissect", "setup.py", "pyproject.toml", "MANIFEST.in", "README.md", "LICENSE", "docs", "scripts")

#: The namespace of another project that responders to incidents have installed too.
FOREIGN: Final = "dissect.util"


def run(*arguments: str | Path, **environment: str) -> str:
    """Run a program away from this tree, give what it printed; a failure shows everything it said."""
    ran = subprocess.run(
        list(map(str, arguments)),
        cwd=Path(sys.prefix),
        env={**without_path(), **environment},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout
    return ran.stdout


def without_path() -> dict[str, str]:
    chosen = {"PYTHONPATH", "S7DISSECT_COMPILED", "S7DISSECT_RELEASE", "CC"}
    return {name: value for name, value in os.environ.items() if name not in chosen}


#: What `pip --python` has another interpreter run; to have it run at once spares the first pip. Found without importing pip,
#: after which setuptools would take the distutils of Python for its own in this process.
PIP: Final = Path(str(distribution("pip").locate_file("pip/__pip-runner__.py")))


def pip(*arguments: str | Path, python: Path | str = sys.executable, **environment: str) -> str:
    return run(python, PIP, "--disable-pip-version-check", "--no-input", *arguments, **environment)


def build_wheel(into: Path, **environment: str) -> Path:
    """Build a wheel from a copy of the sources, so that nothing is left in this tree nor taken from an earlier build."""
    tree = into / "tree"
    tree.mkdir(parents=True)
    for name in SOURCES:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, tree / name, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
        elif source.exists():
            shutil.copy(source, tree / name)
    (into / "log").write_text(
        pip("-v", "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", into, tree, **environment),
        encoding="utf-8",
    )
    (wheel,) = into.glob("*.whl")
    return wheel


def environment(folder: Path, dependencies: Path) -> Path:
    """Make an empty virtual environment that sees the dependencies; give its Python."""
    run(sys.executable, "-m", "venv", "--without-pip", folder)
    python = folder / "bin" / "python"
    packages = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip()
    Path(packages, "dependencies.pth").write_text(f"{dependencies}\n", encoding="utf-8")
    return python


def install(python: Path, *what: str | Path) -> None:
    """Install wheels; bytecode of all their modules, for the few that are imported, would take most of the time."""
    pip("install", "--no-deps", "--no-compile", *what, python=python)


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this tree: the one under test where there is one, else built here."""
    given = os.environ.get("S7DISSECT_WHEEL")
    return Path(given) if given else build_wheel(tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="session")
def interpreted_build(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a build on a machine whose C compiler does not work: its wheel and its log."""
    folder = tmp_path_factory.mktemp("interpreted")
    build_wheel(folder, CC="false")
    return folder


@pytest.fixture(scope="session")
def dependencies(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the package needs at run time, and without the package: links to what is installed here."""
    with zipfile.ZipFile(wheel) as archive:
        (metadata,) = [name for name in archive.namelist() if name.endswith(".dist-info/METADATA")]
        lines = archive.read(metadata).decode().splitlines()
    waiting = needs([line.removeprefix("Requires-Dist: ") for line in lines if line.startswith("Requires-Dist: ")])
    folder = tmp_path_factory.mktemp("dependencies")
    for name in waiting:  # which grows
        found = distribution(name)
        waiting += [other for other in needs(found.requires or []) if other not in waiting]
        for top in {Path(file).parts[0] for file in found.files or []} - {"..", "__pycache__"}:
            (folder / top).symlink_to(str(found.locate_file(top)))
    return folder


def needs(requirements: list[str]) -> list[str]:
    """Return the names of what is required without a condition."""
    return [re.split(r"[^\w.-]", line)[0] for line in requirements if ";" not in line]


@pytest.fixture(scope="session")
def theirs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of the other project."""
    folder = tmp_path_factory.mktemp("theirs")
    pip("download", "--no-deps", "--dest", folder, FOREIGN)
    (found,) = folder.glob("*.whl")
    return found


def contents(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def sources() -> set[str]:
    return {path.relative_to(ROOT).as_posix() for path in (ROOT / "dissect").rglob("*.py")}


def test_wheel_holds_the_package_and_nothing_else(wheel: Path) -> None:
    names = contents(wheel)
    assert {name for name in names if name.endswith(".py")} == sources()
    assert "dissect/py.typed" in names
    schemas = {path.relative_to(ROOT).as_posix() for path in (ROOT / "dissect" / "meaning" / "schema").iterdir()}
    assert {name for name in names if name.endswith(".json")} == schemas | {"dissect/output/browser/lock.json"}
    assert {name for name in names if name.startswith("dissect/output/browser/")} == {
        path.relative_to(ROOT).as_posix() for path in (ROOT / "dissect" / "output" / "browser").glob("*.*")
    }
    pages = {f"dissect/help/{path.name}" for path in (ROOT / "docs").glob("*.md")}
    assert {name for name in names if name.endswith(".md")} == pages
    release = f"s7dissect-{dissect.__version__}"
    tops = {name.split("/")[0] for name in names if "/" in name}
    assert tops == {"dissect", f"{release}.dist-info", f"{release}.data"}
    manual = f"{release}.data/data/share/man/man1"
    assert {f"{manual}/s7dissect.1", f"{manual}/s7dissect-analyze.1", f"{manual}/s7dissect-scd-encode.1"} <= names
    assert [name for name in names if ".data/" in name and not name.startswith(f"{manual}/s7dissect")] == []
    assert {name for name in names if "/" not in name and not name.startswith("s7dissect__mypyc.")} == set()


def patterns(name: str) -> list[str]:
    """Return a list of patterns that setup.py holds, without running it."""
    for statement in ast.parse((ROOT / "setup.py").read_text(encoding="utf-8")).body:
        if (
            isinstance(statement, ast.AnnAssign)
            and isinstance(statement.target, ast.Name)
            and statement.target.id == name
        ):
            assert statement.value is not None
            return list(ast.literal_eval(statement.value))
    pytest.fail(f"setup.py holds no {name}")


def test_every_hot_module_is_compiled_and_keeps_its_source(wheel: Path) -> None:
    if not wheel_is_compiled(wheel):
        pytest.skip("no C compiler here, so the wheel is the interpreted one (CI refuses that)")
    compiled = {
        re.sub(r"\.[^/]*\.so$", ".py", name) for name in contents(wheel) if name.endswith(".so") and "/" in name
    }
    hot, cold = (
        {path.relative_to(ROOT).as_posix() for pattern in patterns(name) for path in ROOT.glob(pattern)}
        for name in ("HOT", "COLD")
    )
    assert compiled == {name for name in hot - cold if not name.endswith("__init__.py")}
    # Every packet passes through these.
    assert {
        f"dissect/{name}.py"
        for name in ("wire/build", "engine/pipeline", "protocols/iso/tpkt", "meaning/report/writers/jsonl")
    } <= compiled


def test_both_builds_hold_the_same_sources(wheel: Path, interpreted_build: Path) -> None:
    (plain,) = interpreted_build.glob("*.whl")
    assert plain.name.endswith("-py3-none-any.whl")
    with zipfile.ZipFile(wheel) as one, zipfile.ZipFile(plain) as other:
        for name in sources():
            assert one.read(name) == other.read(name), name


def test_without_a_compiler_the_build_says_why_in_one_line(interpreted_build: Path) -> None:
    log = (interpreted_build / "log").read_text(encoding="utf-8")
    lines = [line.strip() for line in log.splitlines() if "NOT compiled" in line]
    reason = "the C compiler 'false' is missing or does not find Python's headers"
    assert lines == [f"s7dissect: the engine is NOT compiled and runs interpreted, slower: {reason}"]


def test_with_a_switch_a_build_that_cannot_compile_fails(tmp_path: Path) -> None:
    with pytest.raises(AssertionError) as caught:
        build_wheel(tmp_path, CC="false", S7DISSECT_COMPILED="1")
    reason = "the C compiler 'false' is missing or does not find Python's headers"
    assert f"s7dissect: the engine cannot be compiled, and S7DISSECT_COMPILED=1 demands it: {reason}" in str(
        caught.value
    )
    assert not list(tmp_path.glob("*.whl"))


def test_without_a_compiler_it_runs_interpreted(interpreted_build: Path, dependencies: Path, tmp_path: Path) -> None:
    (wheel,) = interpreted_build.glob("*.whl")
    python = environment(tmp_path / "venv", dependencies)
    install(python, wheel)
    assert run(python.parent / "s7dissect", "--version") == f"s7dissect {dissect.__version__} (interpreted)\n"
    assert run(python, "-m", "dissect", "--version") == f"s7dissect {dissect.__version__} (interpreted)\n"


IMPORT_BOTH: Final = f"""
import {FOREIGN}, dissect, dissect.wire.codes, dissect.files.session, dissect.wire.build
import {FOREIGN}.compression
print(dissect.__version__, callable(dissect.analyze), dissect.wire.build.COMPILED)
"""


@pytest.mark.parametrize("order", [("ours", "theirs"), ("theirs", "ours")])
def test_beside_another_dissect_in_one_environment(
    order: tuple[str, str], wheel: Path, theirs: Path, dependencies: Path, tmp_path: Path
) -> None:
    python = environment(tmp_path / "venv", dependencies)
    for which in order:
        install(python, wheel if which == "ours" else theirs)
    assert run(python, "-c", IMPORT_BOTH) == f"{dissect.__version__} True {wheel_is_compiled(wheel)}\n"
    # Neither takes anything of the other along when it goes.
    pip("uninstall", "--yes", "s7dissect", python=python)
    run(python, "-c", f"import {FOREIGN}")


def test_beside_another_dissect_elsewhere_on_the_path(
    wheel: Path, theirs: Path, dependencies: Path, tmp_path: Path
) -> None:
    for folder, what in (("ours", wheel), ("theirs", theirs)):
        pip("install", "--no-deps", "--no-compile", "--target", tmp_path / folder, what)
    python = environment(tmp_path / "venv", dependencies)
    for order in (("ours", "theirs"), ("theirs", "ours")):
        path = os.pathsep.join(str(tmp_path / folder) for folder in order)
        said = run(python, "-c", IMPORT_BOTH, PYTHONPATH=path)
        assert said == f"{dissect.__version__} True {wheel_is_compiled(wheel)}\n", order


def wheel_is_compiled(wheel: Path) -> bool:
    return any(name.endswith(".so") for name in contents(wheel))


@pytest.fixture(scope="session")
def others(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Small packages of the other project, from PyPI; the test needs them and is skipped without a network."""
    folder = tmp_path_factory.mktemp("others")
    try:
        pip("download", "--no-deps", "--only-binary", ":all:", "-q", "-d", folder, "dissect.cstruct", "dissect.util")
    except AssertionError:
        pytest.skip("the packages dissect.cstruct and dissect.util are not to be had here")
    return sorted(folder.glob("*.whl"))


@pytest.mark.parametrize("first", ["others", "ours"])
def test_the_forensic_framework_lives_beside_it(
    wheel: Path, dependencies: Path, others: list[Path], tmp_path: Path, first: str
) -> None:
    python = environment(tmp_path / "venv", dependencies)
    for what in [others, [wheel]] if first == "others" else [[wheel], others]:
        install(python, *what)
    program = (
        "from dissect.cstruct import cstruct; import dissect.util.ts, dissect;"
        "print(cstruct().uint16(b'\\1\\0'), dissect.util.ts.from_unix(0).year, dissect.Options(slow_ns=7).slow_ns)"
    )
    assert run(python, "-c", program).split() == ["1", "1970", "7"]
    reversed_order = (
        "import dissect; dissect.Options; import dissect.cstruct, dissect.util.ts; print(dissect.__version__)"
    )
    assert run(python, "-c", reversed_order).strip() == dissect.__version__
