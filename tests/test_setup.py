"""How the package is built: what is compiled and how, asked of setup.py without building anything."""

from __future__ import annotations

import ast
import ctypes
import importlib.util
import io
import json
import os
import re
import shutil
import sys
import tarfile
from collections import Counter
from collections.abc import Iterator
from functools import partial
from importlib.machinery import ExtensionFileLoader
from pathlib import Path
from threading import Event
from types import ModuleType, SimpleNamespace
from typing import Any, Final

import pytest
from setuptools import Distribution, Extension  # type: ignore[import-untyped]

from scripts.container_steps import CONTAINERS, ignored, instructions

# Only importable once setuptools has put its own copy in place.
from distutils.ccompiler import new_compiler  # isort: skip
from distutils.sysconfig import customize_compiler, get_python_inc  # isort: skip

ROOT: Final = Path(__file__).resolve().parent.parent


@pytest.fixture
def setup(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module setup.py, which builds only when it is run."""
    monkeypatch.chdir(ROOT)
    for name in ("S7DISSECT_COMPILED", "S7DISSECT_RELEASE"):
        monkeypatch.delenv(name, raising=False)
    spec = importlib.util.spec_from_file_location("s7dissect_setup", ROOT / "setup.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_pattern_names_a_module(setup: ModuleType) -> None:
    """A module that was renamed would silently change sides."""
    unused = [pattern for pattern in (*setup.HOT, *setup.COLD) if not list(ROOT.glob(pattern))]
    assert unused == []
    hot = {path for pattern in setup.HOT for path in ROOT.glob(pattern)}
    assert [pattern for pattern in setup.COLD if hot.isdisjoint(ROOT.glob(pattern))] == []
    compiled = {Path(path) for path in setup.hot_modules()}
    ranked = (*setup.BUSIEST, *setup.BUSY)
    assert [pattern for pattern in ranked if not any(path.match(pattern) for path in compiled)] == []


def test_an_image_gets_all_that_a_build_reads(setup: ModuleType) -> None:
    """Where the shim is missing, nothing is compiled, and the build goes on: only its log would say so."""
    read = {
        "setup.py",
        "pyproject.toml",
        "README.md",
        "LICENSE",
        setup.SHIM,
        "scripts/man_pages.py",
        *setup.hot_modules(),
    }
    read |= {path.relative_to(ROOT).as_posix() for path in ROOT.glob("docs/*.md")}
    assert [path for path in sorted(read) if not (ROOT / path).is_file() or ignored(path)] == []


def test_a_change_of_what_a_build_reads_makes_another_one(setup: ModuleType) -> None:
    """The environment is made anew where its fingerprint differs."""
    script = (ROOT / "scripts" / "environment.sh").read_text("utf-8")
    program = script[script.index("fingerprint()") : script.index("hexdigest()")]
    read = ("setup.py", "pyproject.toml", setup.SHIM, setup.TRAINING, "scripts/man_pages.py")
    assert [path for path in read if f'"{path}"' not in program] == []


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """Give every statement below a node; `ast.walk` would look into each expression as well."""
    for part in ("body", "orelse", "finalbody", "handlers", "cases"):
        for below in getattr(node, part, ()):
            yield below
            yield from statements(below)


def classes(path: Path) -> Iterator[tuple[ast.ClassDef, dict[str, tuple[str, str]]]]:
    """Give every class of a module, and where the names come from that the module imports from others of ours."""
    found = list(statements(ast.parse(path.read_bytes())))
    names = {
        alias.asname or alias.name: (f"{node.module.replace('.', '/')}.py", alias.name)
        for node in found
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("dissect")
        for alias in node.names
    }
    for node in found:
        if isinstance(node, ast.ClassDef):
            yield node, names


def is_open(node: ast.ClassDef) -> bool:
    return any("allow_interpreted_subclasses=True" in ast.unparse(decorator) for decorator in node.decorator_list)


def test_interpreted_classes_derive_from_no_compiled_one_that_is_not_marked_for_it(setup: ModuleType) -> None:
    """Python refuses to import such a module when the engine is compiled."""
    compiled = set(setup.hot_modules())
    closed = {
        (name, node.name)
        for name in compiled
        for node, _ in classes(ROOT / name)
        if not is_open(node) and not any(ast.unparse(base).endswith(("Error", "Exception")) for base in node.bases)
    }
    assert ("dissect/wire/layout.py", "Field") in closed
    wrong = [
        f"{name}: class {node.name}({ast.unparse(base)})"
        for path in sorted((ROOT / "dissect").rglob("*.py"))
        if (name := path.relative_to(ROOT).as_posix()) not in compiled
        for node, names in classes(path)
        for base in node.bases
        if names.get(ast.unparse(base)) in closed
    ]
    assert wrong == []


def test_what_is_tried_with_the_wheel_alone_is_interpreted_there_as_well(setup: ModuleType) -> None:
    """A module of theirs that gets compiled has to be tried both ways."""
    (listed,) = re.findall(
        r"^ONCE := \$\(wildcard (.*)\)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE
    )
    tests = [path for pattern in listed.split() for path in ROOT.glob(pattern)]
    assert len(tests) >= 9
    compiled = set(setup.hot_modules()) - {"dissect/packets/source/packet.py"}  # what errors and packets are
    for path in tests:
        found = [node for node in ast.walk(ast.parse(path.read_bytes())) if isinstance(node, ast.ImportFrom)]
        names = {f"{node.module}.{alias.name}" for node in found for alias in node.names} | {
            node.module for node in found
        }
        ours = {f"{name.replace('.', '/')}.py" for name in names if name and name.startswith("dissect.")}
        assert ours
        assert ours & compiled == set(), path.name


class Mypyc(ModuleType):
    """What stands for mypyc.build: notes how it is called."""

    def __init__(self, extensions: list[Any]) -> None:
        super().__init__("mypyc.build")
        self.extensions = extensions
        self.options: dict[str, Any] = {}

    def mypycify(self, paths: list[str], **options: Any) -> list[Any]:
        self.options = options
        return self.extensions


@pytest.mark.parametrize(("release", "level", "many"), [("", "1", True), ("0", "1", True), ("1", "3", True)])
def test_a_checkout_builds_fast_and_a_release_builds_for_speed(
    release: str, level: str, many: bool, setup: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    mypyc = Mypyc([])
    monkeypatch.setitem(sys.modules, "mypyc.build", mypyc)
    monkeypatch.setattr(setup, "compiler_trouble", str)
    monkeypatch.setenv("S7DISSECT_RELEASE", release)
    assert setup.extensions() == []
    options = mypyc.options
    assert (options["opt_level"], options["multi_file"], options["debug_level"]) == (level, many, "0")


def test_interpreted_on_purpose(
    setup: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("S7DISSECT_COMPILED", "0")
    assert setup.extensions() == []
    assert capsys.readouterr().err == (
        "s7dissect: the engine is NOT compiled and runs interpreted, slower: asked for with S7DISSECT_COMPILED=0\n"
    )


@pytest.mark.parametrize("trouble", ["no compiler", ""])
def test_a_fallback_is_an_error_where_it_must_not_happen(
    trouble: str, setup: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a compiler, and when mypyc rejects the code."""
    monkeypatch.setenv("S7DISSECT_COMPILED", "1")
    monkeypatch.setattr(setup, "compiler_trouble", lambda: trouble)
    monkeypatch.setitem(sys.modules, "mypyc.build", None)
    with pytest.raises(SystemExit, match=r"S7DISSECT_COMPILED=1 demands it: .") as caught:
        setup.extensions()
    assert trouble in str(caught.value)


def test_the_parts_hold_every_source_once_and_are_alike(setup: ModuleType, tmp_path: Path) -> None:
    sources = []
    for number in range(50):
        path = tmp_path / f"module_{number}.c"
        path.write_text("/* */" * (number * number), encoding="ascii")
        sources.append(str(path))
    parts = setup.united(sources, "part", 8)
    assert [Path(part).name for part in parts] == [f"part_{number}.c" for number in range(8)]
    included = [line for part in parts for line in Path(part).read_text("ascii").splitlines()]
    assert sorted(included) == sorted(f'#include "module_{number}.c"' for number in range(50))
    sizes = [
        sum((tmp_path / line.split('"')[1]).stat().st_size for line in Path(part).read_text("ascii").splitlines())
        for part in parts
    ]
    assert max(sizes) < 1.5 * min(sizes)
    before = [Path(part).read_bytes() for part in parts]
    assert setup.united(sources[::-1], "part", 8) == parts
    assert [Path(part).read_bytes() for part in parts] == before


def test_compilers_side_by_side_give_their_objects_in_order(setup: ModuleType) -> None:
    compile_all = setup.SideBySide(lambda sources, suffix: [f"{source}{suffix}" for source in sources])
    assert compile_all([str(number) for number in range(20)], suffix=".o") == [f"{number}.o" for number in range(20)]


def test_what_a_packet_passes_through_is_optimized_and_the_rest_is_not(
    setup: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled = setup.hot_modules()
    kinds = {name: setup.kind(f"build/__native_{name.removesuffix('.py').replace('/', '___')}.c") for name in compiled}
    for name in ("wire/octets", "engine/pipeline", "engine/transactions/transaction", "meaning/report/writers/jsonl"):
        assert kinds[f"dissect/{name}.py"] == "busiest"
    assert setup.kind("/lib-rt/str_ops.c") == "busiest"
    assert setup.kind("build/__native_s7dissect.c") == "busiest"
    assert kinds["dissect/packets/tcp/stream.py"] == "busy"
    assert kinds["dissect/protocols/s7plus/alarms.py"] == "plain"
    counts = Counter(kinds.values())
    assert counts["busiest"] < 0.2 * len(compiled)
    assert counts["plain"] > 0.3 * len(compiled)
    patterns = (*setup.BUSIEST, *setup.BUSY)
    assert [pattern for pattern in patterns if not any(Path(name).match(pattern) for name in compiled)] == []
    assert len(set(patterns)) == len(patterns)

    asked: list[tuple[str, list[str]]] = []

    def compile_all(sources: list[str], extra_postargs: list[str]) -> list[str]:
        asked.append((sources[0], extra_postargs))
        return sources

    setup.SideBySide(compile_all)(
        ["busiest_1.c", "busy_0.c", "plain_0.c", "__native_s7dissect.c"], extra_postargs=["-O1"]
    )
    assert sorted(asked) == [
        ("__native_s7dissect.c", ["-O1"]),
        ("busiest_1.c", ["-O1", "-finline-small-functions"]),
        ("busy_0.c", ["-O1", "-Og"]),
        ("plain_0.c", ["-O1", "-O0", "-U_FORTIFY_SOURCE"]),
    ]
    asked.clear()
    monkeypatch.setenv("S7DISSECT_RELEASE", "1")
    setup.SideBySide(compile_all)(["busiest_1.c", "busy_0.c", "plain_0.c"], extra_postargs=["-O3"])
    assert sorted(asked) == [("busiest_1.c", ["-O3"]), ("busy_0.c", ["-O3"]), ("plain_0.c", ["-O3", "-O1"])]


def test_the_pages_of_man_are_made_while_mypyc_runs(
    setup: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    begun = Event()
    packed: list[list[str]] = []

    def man_pages() -> list[str]:
        begun.set()
        return ["s7dissect.1"]

    def extensions() -> list[Extension]:
        assert begun.wait(60)
        return []

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "315532800")
    monkeypatch.setattr(setup.os, "umask", lambda _: None)
    monkeypatch.setattr(sys, "argv", ["setup.py", "bdist_wheel"])
    monkeypatch.setattr(setup, "man_pages", man_pages)
    monkeypatch.setattr(setup, "extensions", extensions)
    monkeypatch.setattr(setup, "setup", lambda **options: packed.append(options["cmdclass"]["build_py"].pages()))
    setup.build()
    assert packed == [["s7dissect.1"]]


@pytest.fixture
def building(setup: ModuleType, tmp_path: Path) -> Any:
    """The command that builds a library and what makes three modules of it importable; no compiler is started."""
    names = (setup.LIBRARY, "pack.one.items", "pack.two.items", "pack.two.values")
    extensions = [Extension(name, [setup.SHIM if "." in name else "part_0.c"], optional=True) for name in names]
    command = setup.AllOrNothing(Distribution({"ext_modules": extensions}))
    command.build_lib = str(tmp_path)
    command.ensure_finalized()
    command.compiler = SimpleNamespace(compiler_type="none")
    return command


def test_what_makes_modules_importable_is_built_once_and_copied(
    building: Any, setup: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    built: list[str] = []

    def build(extension: Extension) -> None:
        built.append(extension.name)
        path = Path(building.get_ext_fullpath(extension.name))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(extension.sources[0], encoding="ascii")

    monkeypatch.setattr(building, "build_extension", build)
    every = list(building.extensions)
    building.build_extensions()
    assert built == [setup.LIBRARY, "pack.one.items"]
    assert building.extensions == every
    made = {extension.name: Path(building.get_ext_fullpath(extension.name)) for extension in every}
    assert {name: path.read_text("ascii") for name, path in made.items()} == {
        each.name: each.sources[0] for each in every
    }


@pytest.mark.parametrize(
    ("said", "code", "passes"),
    [
        ("gcc (Debian 12.2.0-14) 12.2.0 … Free Software Foundation, Inc.", 0, ["counts", "trained", "counted"]),
        ("clang version 14.0.6", 0, ["plain"]),
        ("gcc 12 … Free Software Foundation, Inc.", 1, ["counts", "trained"]),
    ],
)
def test_a_release_is_built_with_what_its_first_build_counted(
    said: str, code: int, passes: list[str], building: Any, setup: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []

    def build(extension: Extension) -> None:
        path = Path(building.get_ext_fullpath(extension.name))
        path.parent.mkdir(parents=True, exist_ok=True)
        assert not path.exists(), "what the first build left would be taken for that of the second one"
        path.touch()
        if extension.name != setup.LIBRARY:
            assert extension.extra_compile_args == []
        elif set(setup.COUNTING) <= set(extension.extra_compile_args):
            assert extension.extra_link_args == list(setup.COUNTING)
            done.append("counts")
        else:
            assert extension.extra_link_args == []
            done.append("counted" if set(setup.COUNTED) <= set(extension.extra_compile_args) else "plain")

    def run(command: list[str], **options: Any) -> SimpleNamespace:
        if "--version" in command:
            return SimpleNamespace(stdout=said, returncode=0)
        assert command[1:] == ["-P", setup.TRAINING]
        assert options["env"]["PYTHONPATH"].startswith(str(Path(building.build_lib).resolve()))
        assert all(Path(path).exists() for path in building.get_outputs()), "all of it can be imported"
        done.append("trained")
        return SimpleNamespace(returncode=code)

    building.compiler.compiler = ["gcc", "-Wall"]
    monkeypatch.setenv("S7DISSECT_RELEASE", "1")
    monkeypatch.setattr(building, "build_extension", build)
    monkeypatch.setattr(setup, "subprocess", SimpleNamespace(run=run))
    if code:
        with pytest.raises(SystemExit, match=r"scripts/train\.py failed"):
            building.build_extensions()
    else:
        building.build_extensions()
    assert done == passes


def test_the_training_reads_sound_and_damaged_captures(tmp_path: Path) -> None:
    """It is what the first build of a release runs; here it is asked for less, and refuses what fails."""
    spec = importlib.util.spec_from_file_location("s7dissect_train", ROOT / "scripts" / "train.py")
    assert spec is not None
    assert spec.loader is not None
    train = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(train)
    assert train.run(["analyze", str(ROOT / "captures" / "answer-lost.pcapng")]) == 0
    assert train.run(["analyze", str(tmp_path / "missing.pcap")]) == 2
    assert all(path.is_file() for path in train.shipped())
    assert len(train.shipped()) > 20


@pytest.mark.parametrize("failing", [0, 1])
def test_half_an_engine_is_not_left_behind(
    failing: int, building: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def build(extension: Extension) -> None:
        path = Path(building.get_ext_fullpath(extension.name))
        path.parent.mkdir(parents=True, exist_ok=True)
        if extension is not building.extensions[failing]:
            path.touch()

    monkeypatch.setattr(building, "build_extension", build)
    building.build_extensions()
    assert not any(Path(path).exists() for path in building.get_outputs())
    assert "NOT compiled" in capsys.readouterr().err


def test_one_file_makes_every_module_importable(
    setup: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each copy finds its own module in the library, also where two have the same last name."""
    if setup.compiler_trouble():
        pytest.skip("there is no C compiler")
    shims = [Extension(name, ["mypyc's.c"]) for name in ("pack.one.items", "pack.two.items", "pack.two.lost")]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "build").mkdir()
    setup.share_shim(shims)
    assert {tuple(shim.sources) for shim in shims} == {(setup.SHIM,)}
    compiler = new_compiler()
    customize_compiler(compiler)
    includes = [get_python_inc(), str(tmp_path / "build")]
    # Where it is read from does not matter to it; the path of the result follows that of the source.
    shutil.copyfile(ROOT / setup.SHIM, tmp_path / "shim.c")
    objects = compiler.compile(["shim.c"], include_dirs=includes, extra_preargs=["-Wall", "-Werror"])
    compiler.link_shared_object(objects, "shim.so")

    library = ModuleType(setup.LIBRARY)
    monkeypatch.setitem(sys.modules, setup.LIBRARY, library)
    capsule = ctypes.pythonapi.PyCapsule_New
    capsule.restype, capsule.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
    kept: list[Any] = []
    for name in ("pack.one.items", "pack.two.items"):
        flat = f"init_{name.replace('.', '___')}"
        make = ctypes.PYFUNCTYPE(ctypes.py_object)(partial(ModuleType, name, f"made for {name}"))
        path = f"{setup.LIBRARY}.{flat}".encode()
        kept += make, path  # a capsule keeps neither
        setattr(library, flat, capsule(ctypes.cast(make, ctypes.c_void_p), path, None))
    for shim in shims[:2]:
        module = imported(shim.name, tmp_path)
        assert (module.__name__, module.__doc__) == (shim.name, f"made for {shim.name}")
        assert module.__file__ == str(tmp_path / f"{shim.name}.so")
    with pytest.raises(AttributeError, match="init_pack___two___lost"):
        imported("pack.two.lost", tmp_path)


def imported(name: str, folder: Path) -> ModuleType:
    """Import a copy of shim.so as the module of that name."""
    path = shutil.copyfile(folder / "shim.so", folder / f"{name}.so")
    spec = importlib.util.spec_from_file_location(name, path, loader=ExtensionFileLoader(name, str(path)))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_compiler_that_fails_is_not_overlooked(setup: ModuleType) -> None:
    def fail(sources: list[str]) -> list[str]:
        raise ValueError(sources[0])

    with pytest.raises(ValueError, match="first"):
        setup.SideBySide(fail)(["first", "second"])


def test_a_build_without_what_makes_the_pages_of_man_says_so(
    setup: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scripts").mkdir()
    (tmp_path / "scripts" / "man_pages.py").write_text("import no_such_library\n", encoding="ascii")
    assert setup.man_pages() == []
    told = capfd.readouterr().err
    assert told == (
        "s7dissect: the pages of man are NOT built: ModuleNotFoundError: No module named 'no_such_library'\n"
    )


def sources(folder: Path, mode: int, times: tuple[int, int]) -> str:
    """Make a small tree as a checkout with this mode and time leaves it, and return its name."""
    for name in ("pack-1/b.py", "pack-1/a/run.sh", "pack-1/a/é.txt"):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name, encoding="utf-8")
        path.chmod(mode | (0o100 if name.endswith(".sh") else 0))
        os.utime(path, times)
    (folder / "pack-1" / "a").chmod(mode | 0o100)
    return "pack-1"


def packed(setup: ModuleType, folder: Path, monkeypatch: pytest.MonkeyPatch) -> bytes:
    monkeypatch.chdir(folder)
    command = setup.SameArchive(Distribution({"name": "pack"}))
    return Path(command.make_archive("made", "gztar", base_dir="pack-1")).read_bytes()


def test_the_same_sources_make_the_same_archive(
    setup: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Of two checkouts that differ in time and umask."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    sources(tmp_path / "one", 0o644, (10**9, 10**9))
    sources(tmp_path / "two", 0o600, (10**9 + 5, 10**9 + 7))
    one, two = [packed(setup, tmp_path / name, monkeypatch) for name in ("one", "two")]
    assert one == two
    with tarfile.open(fileobj=io.BytesIO(one)) as archive:
        entries = archive.getmembers()
    assert [entry.name for entry in entries] == sorted(entry.name for entry in entries)
    assert {entry.mtime for entry in entries} == {1700000000}
    assert {entry.name: oct(entry.mode) for entry in entries} == {
        "pack-1": "0o755",
        "pack-1/a": "0o755",
        "pack-1/a/run.sh": "0o755",
        "pack-1/a/é.txt": "0o644",
        "pack-1/b.py": "0o644",
    }
    assert {(entry.uid, entry.uname) for entry in entries} == {(0, "")}
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000001")
    assert packed(setup, tmp_path / "one", monkeypatch) != one


def test_a_wheel_keeps_no_umask(setup: ModuleType, tmp_path: Path) -> None:
    sources(tmp_path, 0o600, (0, 0))
    setup.usual_modes(tmp_path)
    modes = {path.name: oct(path.stat().st_mode & 0o777) for path in tmp_path.rglob("*")}
    assert modes == {
        "pack-1": "0o755",
        "a": "0o755",
        "run.sh": "0o755",
        "é.txt": "0o644",
        "b.py": "0o644",
    }


@pytest.mark.parametrize("name", CONTAINERS)
def test_a_container_runs_what_was_installed_and_not_as_root(name: str) -> None:
    steps = instructions(CONTAINERS[name])
    found = dict(steps)
    assert re.fullmatch(r"[1-9]\d+:[1-9]\d+", found["USER"])
    program, *_ = json.loads(found["ENTRYPOINT"])
    folder = program.removesuffix("/bin/s7dissect")
    assert ("COPY", f"--from=build {folder} {folder}") in steps
    built = next(rest for word, rest in steps if word == "RUN" and "pip install" in rest)
    assert built.startswith(f"python -m venv {folder} && {folder}/bin/pip install")
    assert ("ENV", "S7DISSECT_COMPILED=1") in steps
    assert ("setcap" in str(steps)) == (name == "probe")
