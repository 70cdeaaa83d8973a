"""What a cluster is made of, without one: addresses, what a worker lacks, processes that do tasks."""

from __future__ import annotations

import os
import pickle
import re
import tomllib
from pathlib import Path

import pytest

from dissect.files.cluster import onworker
from dissect.files.cluster.connect import checked_address
from dissect.files.cluster.probe import facts
from dissect.files.cluster.reader import DEFECT, FOUND, REFUSED, Order, carried_out, digest
from dissect.files.cluster.workers import EXTRAS, Machine, Worker, here, lacks, obstacle
from dissect.files.jobs.tasks import FileError
from tests.cases import each
from tests.meaning.report.schemas import ROOT

OURS = Machine("desk", 1, "3.12.1", "2.0", True, "", ["remote", "tls", "zstd"])


@each("text", ["tcp://h:8786", "tls://h.example:1", "tcp://[::1]:8786", "tcp://10.0.0.1:65535"])
def test_an_address_of_a_scheduler(text: str) -> None:
    assert checked_address(text) == text
    assert checked_address(f"{text}/") == text


@each(
    "text",
    [
        "",
        "h",
        "h:8786",
        "tcp://h",
        "tcp://h:0",
        "tcp://h:65536",
        "http://h:8786",
        "tcp://a b:1",
        "tcp://u@h:1",
        "tcp://h:1/x",
    ],
)
def test_what_is_no_address(text: str) -> None:
    with pytest.raises(ValueError, match=re.escape("expected tcp://HOST:PORT")):
        checked_address(text)


def test_the_extras_are_those_of_the_package() -> None:
    with (ROOT / "pyproject.toml").open("rb") as file:
        extras = tomllib.load(file)["project"]["optional-dependencies"]
    for name, distributions in EXTRAS.items():
        assert sorted(re.split(r"[\[><=;]", each)[0] for each in extras[name]) == sorted(distributions)


def worker(machine: Machine | None, name: str = "rack1", silence: str = "") -> Worker:
    return Worker("tcp://10.0.0.5:41000", name, 4, 0, "2026.8.0", machine, silence)


@each(("machine", "why"), [
    (OURS, ""),
    (OURS._replace(python="3.11.2", compiled=False, host="rack"), ""),
    (OURS._replace(extras=["tls"]), ""),
    (OURS._replace(version="1.9"), "has s7dissect 1.9, here is 2.0; pip install s7dissect==2.0"),
    (OURS._replace(version="", problem="No module named 'dissect'"),
     "does not have s7dissect: No module named 'dissect'; pip install s7dissect==2.0"),
    (OURS._replace(extras=["zstd"]), "has no extra tls, which is installed here; pip install 's7dissect[tls]'"),
])  # fmt: skip
def test_what_stands_in_the_way(machine: Machine, why: str) -> None:
    assert obstacle(worker(machine), OURS) == why


def test_who_does_not_answer() -> None:
    silent = worker(None, silence="does not answer within 8 seconds")
    assert obstacle(silent, OURS) == "does not answer within 8 seconds"
    assert lacks(silent, OURS) == []
    assert silent.label == "worker rack1"
    assert worker(OURS, "tcp://10.0.0.5:41000").label == "worker tcp://10.0.0.5:41000 on desk"
    assert lacks(worker(OURS._replace(extras=["tls"])), OURS) == ["remote", "zstd"]


def test_what_is_here() -> None:
    assert obstacle(worker(here()), here()) == ""
    found = facts({"none": ["no-such-distribution-of-anybody"], "some": ["click"]})
    assert (found["extras"], found["problem"], found["version"]) == (["some"], "", here().version)


def order(
    work: object, *arguments: object, folder: str = os.sep, files: dict[str, str] | None = None, needs: bool = False
) -> Order:
    return Order(folder, needs, files or {}, work, arguments)  # type: ignore[arg-type]


def raising(kind: str) -> None:
    """Be a task that ends with an exception."""
    raise {"file": FileError("x: not a capture"), "memory": MemoryError(), "defect": KeyError("k")}[kind]


def test_answers_of_a_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert carried_out(order(os.getcwd, folder=str(tmp_path))) == (FOUND, str(tmp_path))
    assert carried_out(order(raising, "file")) == (REFUSED, "x: not a capture")
    assert carried_out(order(raising, "memory")) == (REFUSED, "there is not enough memory")
    assert carried_out(order(os.listdir, "/no/such")) == (REFUSED, "/no/such: No such file or directory")
    kind, text = carried_out(order(raising, "defect"))
    assert (kind, text.splitlines()[-1]) == (DEFECT, "KeyError: 'k'")


def test_a_folder_that_is_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only names that count from it need it."""
    monkeypatch.chdir(tmp_path)
    assert carried_out(order(len, "abc", folder="/no/such")) == (FOUND, 3)
    said = (REFUSED, "the folder /no/such cannot be entered: No such file or directory")
    assert carried_out(order(len, "abc", folder="/no/such", needs=True)) == said


def test_files_that_are_not_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    tags = tmp_path / "tags.csv"
    tags.write_text("a")
    files = {"tags.csv": digest(tags)}
    task = order(len, "abc", folder=str(tmp_path), files=files)
    assert carried_out(task) == (FOUND, 3)
    tags.write_text("b")
    assert carried_out(task) == (REFUSED, "tags.csv: not what it is where the command was started")
    tags.unlink()
    assert carried_out(task) == (REFUSED, "tags.csv: No such file or directory; the command reads it as well")


def test_a_process_does_one_task_after_another_and_dies_alone() -> None:
    """What it prints gets in nobody's way; one that gave its memory back is replaced without a word."""
    asked = [onworker.answer(order(os.system, "echo noise; exit 3")) for _ in range(2)]
    assert [(how, pickle.loads(sent)) for how, sent in asked] == [(onworker.ANSWERED, (FOUND, 3 << 8))] * 2
    (process,) = onworker._idle
    with open(os.devnull, "wb") as nothing:  # noqa: PTH123 - for its descriptor
        os.dup2(nothing.fileno(), process._orders.fileno())  # it reads an end, as when nobody is there any more
    assert process._process.wait(60) == 0
    how, sent = onworker.answer(order(len, "abc"))
    assert (how, pickle.loads(sent)) == (onworker.ANSWERED, (FOUND, 3))
    assert onworker.answer(order(os._exit, 9)) == (onworker.DIED, b"9")
    assert onworker._idle == []
