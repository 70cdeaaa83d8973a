"""`Transaction.items`, `as_dict` and `str`: the first program that everybody writes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import dissect
from dissect.report.writers.jsonl import TransactionLines

CAPTURES = Path(__file__).parents[2] / "captures"
PLANT = CAPTURES / "scd" / "plant.toml"


def transactions_of(path: Path, **given: Any) -> list[dissect.Transaction]:
    return [event for event in dissect.open(path, pdus=False, **given) if isinstance(event, dissect.Transaction)]


def test_items_of_s7comm_with_refused_ones() -> None:
    found = transactions_of(CAPTURES / "item-errors.pcapng")
    for transaction in found:
        results = transaction.results()
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


def test_requests_without_answer_say_so() -> None:
    found = [one for one in transactions_of(CAPTURES / "answer-lost.pcapng") if one.outcome_name == "unanswered"]
    results = {item.result for one in found for item in one.items}
    assert results
    assert results <= {"not answered", "answer not captured"}
    assert {item.ok for one in found for item in one.items} == {False}


def test_as_dict_is_the_json_line() -> None:
    for path in (CAPTURES / "item-errors.pcapng", *sorted((CAPTURES / "s7plus").glob("*.pcapng"))[:2]):
        for transaction in transactions_of(path):
            assert transaction.as_dict() == json.loads(TransactionLines().line(transaction))


def test_a_transaction_reads_like_words() -> None:
    said = [str(one) for one in transactions_of(CAPTURES / "item-errors.pcapng")]
    assert any(text.startswith("Setup communication") and text.endswith(": answered") for text in said)
    assert any(": answered, Object does not exist" in text for text in said)
    (lost,) = [str(one) for one in transactions_of(CAPTURES / "answer-lost.pcapng") if one.missed]
    assert ": no answer, the connection ended before an answer came" in lost
