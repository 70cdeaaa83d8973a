from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from dissect.testing.golden_files import SUFFIX, GoldenFiles, folder_of, golden_of, module_of, stem_of

NAME = st.from_regex(r"[A-Za-z_][A-Za-z_0-9]{0,8}", fullmatch=True)
TEST = st.builds(
    lambda classes, name, parameters: "::".join(["tests/test_x.py", *classes, name + parameters]),
    st.lists(NAME, max_size=2),
    NAME,
    st.one_of(st.just(""), st.text(max_size=300).map(lambda text: f"[{text}]")),
)
STEPS = st.lists(NAME, min_size=1, max_size=4)


@given(TEST, TEST, st.none() | st.text(min_size=1, max_size=99), st.none() | st.text(min_size=1, max_size=99))
def test_each_golden_has_a_file_of_its_own(one: str, other: str, name: str | None, another: str | None) -> None:
    paths = {golden_of("test_x", stem_of(test), called) for test, called in ((one, name), (other, another))}
    assert len(paths) == len({(one, name), (other, another)})
    for path in paths:
        assert path.count("/") == 1
        assert path.isprintable()
        assert path.isascii()
        assert not set(path.rpartition("/")[2]) & set('<>:"\\|?*')  # what Windows has no files of
        assert len(path.rpartition("/")[2]) <= 255
        assert path.endswith(SUFFIX)


def test_parameters_do_not_make_other_classes() -> None:
    assert stem_of("a.py::TestX::test_y[b::c]") == "TestX.test_y[b%3A%3Ac]"
    assert stem_of("a.py::test_y[b/..\\c]") == "test_y[b%2F..%5Cc]"


@given(STEPS, STEPS)
def test_a_folder_names_its_module(goldens: list[str], module: list[str]) -> None:
    place = Path("/project", *goldens)
    path = Path("/project", *module[:-1], f"{module[-1]}.py")
    folder = folder_of(place, path)
    assert ".." not in folder.split("/")
    assert module_of(place, folder) == path


def test_a_module_that_is_no_python_keeps_its_suffix() -> None:
    goldens = Path("/p/tests/goldens")
    assert folder_of(goldens, Path("/p/tests/io/test_x.py")) == "io/test_x"
    assert folder_of(goldens, Path("/p/tests/io/test_x.txt")) == "io/test_x.txt"
    assert folder_of(goldens, Path("/p/README.rst")) == "__/README.rst"


def test_what_workers_tell_adds_up(tmp_path: Path) -> None:
    (tmp_path / "goldens/test_x").mkdir(parents=True)
    for name in ("test_a", "test_b", "test_c", "test_d"):
        (tmp_path / f"goldens/test_x/{name}{SUFFIX}").touch()
    total, workers = GoldenFiles(tmp_path / "goldens"), [GoldenFiles(tmp_path / "goldens") for _ in range(2)]
    for worker in workers:
        for name in ("test_a", "test_b"):
            worker.collected(f"test_x.py::{name}", tmp_path / "test_x.py")
    workers[0].used.add(f"test_x/test_a{SUFFIX}")
    workers[1].written.add(f"test_x/test_c{SUFFIX}")
    total.ended("test_x.py::test_a", True, True)
    total.add(workers[0].results())
    assert total.unused() == []  # test_b has not ended
    total.ended("test_x.py::test_b", True, True)
    total.add(workers[1].results())
    assert total.unused() == [f"test_x/test_b{SUFFIX}", f"test_x/test_d{SUFFIX}"]
    total.ended("test_x.py::test_b", False, False)
    assert total.unused() == [f"test_x/test_d{SUFFIX}"]
    total.left_out(tmp_path / "test_x.py")
    assert total.unused() == []
