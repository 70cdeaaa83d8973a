"""One family of exceptions: whoever catches `dissect.Error` catches whatever is wrong with what was given."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from pathlib import Path

import pytest

import dissect
from dissect import scd

CAPTURES = Path(__file__).parents[1] / "captures"
CAPTURE = CAPTURES / "item-errors.pcapng"
PLANT = CAPTURES / "scd" / "plant.toml"


def text_file(folder: Path) -> Path:
    path = folder / "notes.txt"
    path.write_text("this is a text, and no capture at all\n", encoding="utf-8")
    return path


WRONG: dict[str, tuple[type, type | None, Callable[[Path], object]]] = {
    "no file": (dissect.CaptureError, FileNotFoundError, lambda folder: dissect.analyze(folder / "missing.pcap")),
    "a folder": (dissect.CaptureError, None, dissect.analyze),
    "a text": (dissect.CaptureError, None, lambda folder: list(dissect.open(text_file(folder)))),
    "an expression": (dissect.SelectError, ValueError, lambda _: dissect.Where("nothing ==")),
    "tags": (dissect.TagError, None, lambda folder: dissect.open(CAPTURE, tags=text_file(folder))),
    "keys": (dissect.KeyLogError, ValueError, lambda folder: dissect.open(CAPTURE, tls_keys=text_file(folder))),
    "no tags": (dissect.Error, FileNotFoundError, lambda folder: dissect.open(CAPTURE, tags=folder / "missing.csv")),
    "no keys": (dissect.Error, FileNotFoundError, lambda folder: dissect.live("lo", tls_keys=folder / "missing.log")),
    "no bindings": (
        dissect.Error,
        FileNotFoundError,
        lambda folder: dissect.analyze(CAPTURE, scd=PLANT, bind=folder / "missing.toml"),
    ),
    "no dictionary": (
        dissect.Error,
        FileNotFoundError,
        lambda folder: list(dissect.values(CAPTURE, scd=folder / "missing.toml", bind=PLANT.with_suffix(".bind.toml"))),
    ),
    "tags that are a folder": (dissect.Error, OSError, lambda folder: dissect.open(CAPTURE, tags=folder)),
    "an address without a port": (dissect.Error, ValueError, lambda _: dissect.stream("10.0.0.1")),  # type: ignore[arg-type]
    "a name of a host": (dissect.Error, ValueError, lambda _: dissect.stream(server=("plc.example", 102))),
    "a port beyond the last": (dissect.Error, ValueError, lambda _: dissect.stream(("10.0.0.1", 70_000))),
    "no table": (dissect.Error, ValueError, lambda _: dissect.frames(CAPTURE, tables="nothing")),
    "a dictionary": (scd.Error, None, lambda folder: scd.load(text_file(folder))),
    "a wanted value": (dissect.Error, ValueError, lambda _: list(dissect.values(CAPTURE, of="no such thing"))),
}


@pytest.mark.parametrize("name", WRONG)
def test_every_error_is_of_the_family(name: str, tmp_path: Path) -> None:
    kind, also, wrong = WRONG[name]
    with pytest.raises(dissect.Error) as caught:
        wrong(tmp_path)
    assert isinstance(caught.value, kind)
    assert also is None or isinstance(caught.value, also)
    assert str(caught.value).strip()


def test_errors_leave_the_process(tmp_path: Path) -> None:
    for _, _, wrong in WRONG.values():
        with pytest.raises(dissect.Error) as caught:
            wrong(tmp_path)
        for taken in (copy.copy(caught.value), pickle.loads(pickle.dumps(caught.value))):
            assert type(taken) is type(caught.value)
            assert str(taken) == str(caught.value)


def test_values_include_refusals() -> None:
    without = list(dissect.values(CAPTURE))
    rows = list(dissect.values(CAPTURE, refusals=True))
    refused = [row for row in rows if row.refused]
    assert [repr(row) for row in rows if not row.refused] == [repr(row) for row in without]
    assert not [row for row in without if row.refused]
    errors = [
        error
        for event in dissect.open(CAPTURE, pdus=False)
        if isinstance(event, dissect.Transaction)
        for error in event.errors
    ]
    assert [row.refused for row in refused] == [error.name for error in errors]
    assert {row.value for row in refused} == {None}
    one = refused[0]
    assert (repr(one), one.how, one.host) == (f"RefusedRow(read {one.name!r}: {one.refused})", "read", "127.0.0.1")
    for taken in (copy.copy(one), pickle.loads(pickle.dumps(one))):
        assert (repr(taken), taken.refused, taken.time_ns) == (repr(one), one.refused, one.time_ns)
