"""`Transaction.items`, `as_dict` and `str`: the first program that everybody writes."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import pytest

import dissect
from dissect.engine.transactions.old_names import OldNames
from dissect.meaning.report.writers.jsonl import TransactionLines
from dissect.wire.attribute_tables import ATTRIBUTES
from dissect.wire.copies import attributes
from tests.cli.support import run

CAPTURES = Path(__file__).parents[3] / "captures"
PLANT = CAPTURES / "scd" / "plant.toml"


def transactions_of(path: Path, **given: Any) -> list[dissect.Transaction]:
    return [event for event in dissect.open(path, pdus=False, **given) if isinstance(event, dissect.Transaction)]


def test_items_of_s7comm_with_refused_ones() -> None:
    found = transactions_of(CAPTURES / "item-errors.pcapng")
    for transaction in found:
        results = transaction.s7_results
        items = transaction.items
        assert len(items) == len(results)
        for item, result in zip(items, results, strict=True):
            assert item.address == (result.item.address if result.item is not None else "")
            assert item.ok == (result.return_code == 0xFF)
            assert item.value == (result.value if item.ok or transaction.function == 5 else None)
            assert item.tag == ""
            assert item.name == item.address
    refused = [item for transaction in found for item in transaction.items if not item.ok]
    assert [item.result for item in refused] == [error.name for transaction in found for error in transaction.errors]
    assert {item.type for transaction in found for item in transaction.items} >= {"3 x BYTE"}


def test_items_have_tags(tmp_path: Path) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text("Name,Address,Type\nLevel,DB1.DBB0,BYTE\n", encoding="utf-8")
    found = transactions_of(CAPTURES / "item-errors.pcapng", tags=tags)
    named = [item for transaction in found for item in transaction.items if item.tag]
    assert {(item.tag, item.address, item.type, item.name) for item in named} == {
        ("Level", "DB1.DBB0", "BYTE", "Level")
    }


def test_items_of_s7comm_plus_and_of_scd() -> None:
    paths = sorted((CAPTURES / "s7plus").glob("*.pcapng"))
    items = [item for path in paths for one in transactions_of(path) if one.is_plus for item in one.items]
    assert [item for item in items if item.ok and item.value is not None and item.type]
    scd = transactions_of(PLANT.with_suffix(".pcapng"), scd=PLANT, bind=PLANT.with_suffix(".bind.toml"))
    items = [item for one in scd if one.is_scd for item in one.items]
    assert [item for item in items if item.ok and item.address.startswith("0x") and item.tag]
    assert {("Слово состояния 1", "uint16"), ("Расход 2", "int32")} <= {(item.tag, item.type) for item in items}
    without = [item for item in items if item.value is None]
    assert [(item.address, item.tag, item.type, item.result) for item in without] == [
        ("0x6fff:0", "", "", "abort"),
        ("0x6844:0", "Расход 2", "int32", "not answered"),
    ]


def test_requests_without_answer_say_so() -> None:
    found = [one for one in transactions_of(CAPTURES / "answer-lost.pcapng") if one.outcome == "unanswered"]
    results = {item.result for one in found for item in one.items}
    assert results
    assert results <= {"not answered", "answer not captured"}
    assert {item.ok for one in found for item in one.items} == {False}


@pytest.mark.parametrize("path", sorted(CAPTURES.rglob("*.pcapng")), ids=lambda path: str(path.relative_to(CAPTURES)))
def test_as_dict_is_the_json_line(path: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    """As the command writes it: each transaction of each capture. Pushes and lost answers may come in another order."""
    dicts = [transaction.as_dict() for transaction in transactions_of(path)]
    out = run(capfdbinary, "transactions", "-T", "jsonl", str(path)).out
    lines = [json.loads(line) for line in out.splitlines()]
    assert sorted(dicts, key=lambda one: str(one["number"])) == sorted(lines, key=lambda one: str(one["number"]))


def test_as_dict_has_names_of_dictionaries_and_tags(tmp_path: Path) -> None:
    for transaction in transactions_of(PLANT.with_suffix(".pcapng"), scd=PLANT, bind=PLANT.with_suffix(".bind.toml")):
        assert transaction.as_dict() == json.loads(TransactionLines().line(transaction))
    tags = tmp_path / "tags.csv"
    tags.write_text("Name,Address,Type\nLevel,DB1.DBB0,BYTE\n", encoding="utf-8")
    found = transactions_of(CAPTURES / "item-errors.pcapng", tags=tags)
    assert "Level" in json.dumps([transaction.as_dict() for transaction in found])


#: Names that documentation of this version had, and what each is now.
OLD_NAMES: Final[dict[str, tuple[Callable[[dissect.Transaction], object], Callable[[dissect.Transaction], object]]]] = {
    "outcome_name": (lambda one: one.outcome_name, lambda one: one.outcome),
    "results": (lambda one: one.results(), lambda one: one.s7_results),
    "plus_items": (lambda one: one.plus_items(), lambda one: one.plus_results),
    "answered_items": (lambda one: one.answered_items(), lambda one: one._answered_items()),
    "written_items": (lambda one: one.written_items(), lambda one: one._written_items()),
}


def said(found: object) -> object:
    """Say what can be compared of objects that are made anew at each access."""
    return [(type(one), one.return_code, one.data) for one in found] if isinstance(found, list) else found


@pytest.mark.parametrize("name", OLD_NAMES)
def test_an_old_name_is_an_alias_that_warns_at_the_line_of_the_user(name: str) -> None:
    old, new = OLD_NAMES[name]
    paths = (CAPTURES / "item-errors.pcapng", *sorted((CAPTURES / "s7plus").glob("*.pcapng"))[:1])
    for one in [transaction for path in paths for transaction in transactions_of(path)]:
        with pytest.warns(DeprecationWarning, match=rf"Transaction\.{name}") as warned:
            found = old(one)
        assert [(each.filename, each.lineno) for each in warned] == [(__file__, old.__code__.co_firstlineno)]
        assert said(found) == said(new(one))


def test_nothing_of_this_package_uses_an_old_name() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        for one in transactions_of(CAPTURES / "item-errors.pcapng"):
            assert all((str(one), repr(one), one.as_dict()))


def test_names_are_attributes_for_what_is_known_and_methods_for_what_takes_arguments() -> None:
    """Machinery is private; `as_dict` makes something new at each call."""
    kind = dissect.Transaction
    old = {name for name in dir(OldNames) if not name.startswith("_")}
    methods = {name for name in dir(kind) if not name.startswith("_") and callable(getattr(kind, name))}
    assert methods - old == {"as_dict"}
    public = {name for name in attributes(kind) if not name.startswith("_")}
    assert public == set(ATTRIBUTES["Transaction"])


def test_a_transaction_reads_like_words() -> None:
    said = [str(one) for one in transactions_of(CAPTURES / "item-errors.pcapng")]
    assert any(text.startswith("Setup communication") and text.endswith(": answered") for text in said)
    assert any(": answered, Object does not exist" in text for text in said)
    (lost,) = [str(one) for one in transactions_of(CAPTURES / "answer-lost.pcapng") if one.missed]
    assert ": no answer, the connection ended before an answer came" in lost
    words = {one.outcome for one in transactions_of(CAPTURES / "answer-lost.pcapng")}
    assert words == {"answered", "unanswered"}
    assert {repr(one).rpartition(" ")[2] for one in transactions_of(CAPTURES / "answer-lost.pcapng")} == {
        "answered)",
        "unanswered)",
    }
