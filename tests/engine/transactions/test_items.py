"""`Transaction.items`, `as_dict` and `str`: the first program that everybody writes."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import pytest

import dissect
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.items import TransactionItem
from dissect.engine.transactions.naming import NamedValue, named_values
from dissect.engine.transactions.old_names import OldNames
from dissect.meaning.report.writers.jsonl import TransactionLines
from dissect.meaning.tags.loading import load_tags
from dissect.protocols.s7.tables import RETURN_CODES
from dissect.wire.attribute_tables import ATTRIBUTES
from dissect.wire.copies import attributes
from tests import build
from tests.cli.support import run
from tests.engine.transactions.talk import (
    CLIENT,
    SERVER,
    Talk,
    ack,
    ack_data,
    dbw,
    good,
    head,
    item,
    read,
    refused,
    userdata,
    words,
    write,
    written,
)

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
        for one, result in zip(items, results, strict=True):
            assert one.address == (result.item.address if result.item is not None else "")
            assert one.ok == (result.return_code == 0xFF)
            assert one.value == (result.value if one.ok or transaction.function == 5 else None)
            assert one.tag == ""
            assert one.name == one.address
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


# ---- what each item is ----------------------------------------------------------------------------------------------


def of_scd() -> list[dissect.Transaction]:
    return transactions_of(PLANT.with_suffix(".pcapng"), scd=PLANT, bind=PLANT.with_suffix(".bind.toml"))


def the_only(octets: bytes, *answers: bytes, then: bytes = b"") -> dissect.Transaction:
    """The transaction of a request and its answer, or of one of both alone; ``then`` is one more request."""
    talk = Talk()
    talk.open(8, 8)
    if octets:
        talk.ask(octets)
    for answer in answers:
        talk.tell(answer)
    if then:
        talk.ask(then)
    talk.finish()
    return talk.transactions[0]


Item = TransactionItem
REAL = item(0x84, 2, 32, 8, 1)
ASKED = read(1, dbw(1, 0), dbw(1, 4, 3), REAL)
ANSWERED = good(4, b"\x00\x07") + good(4, b"\x00\x01\x00\x02\x00\x03")


def test_items_of_a_read_have_their_type_value_and_octets() -> None:
    found = the_only(ASKED, ack_data(1, b"\x04\x03", ANSWERED + refused(10))).items
    assert found == [
        Item("DB1.DBW0", "", "WORD", 7, "", "ok", b"\x00\x07"),
        Item("DB1.DBW4", "", "3 x WORD", [1, 2, 3], "", "ok", b"\x00\x01\x00\x02\x00\x03"),
        Item("DB2.DBD4", "", "REAL", None, "", "Object does not exist", None),
    ]
    assert [(one.ok, one.name) for one in found] == [(True, "DB1.DBW0"), (True, "DB1.DBW4"), (False, "DB2.DBD4")]


def test_items_of_a_write_have_the_written_value_whatever_became_of_it() -> None:
    asked = write(1, [dbw(1, 0), dbw(1, 2)], written(4, b"\x00\x07") + written(4, b"\x00\x08"))
    assert the_only(asked, ack_data(1, b"\x05\x02", b"\xff\x03")).items == [
        Item("DB1.DBW0", "", "WORD", 7, "", "ok", b"\x00\x07"),
        Item("DB1.DBW2", "", "WORD", 8, "", "Access not allowed", b"\x00\x08"),
    ]
    (first, second) = the_only(asked, ack_data(1, b"\x05\x02", b"\xff")).items
    assert (first.result, second.result) == ("ok", "No return code")


def test_items_of_a_request_that_is_refused_as_a_whole_have_its_error() -> None:
    answered = the_only(read(1, dbw(1, 0), dbw(1, 2)), ack(1, 0x8104)).items
    assert [(one.address, one.value, one.result, one.data) for one in answered] == [
        ("DB1.DBW0", None, "Service not implemented or frame error", None),
        ("DB1.DBW2", None, "Service not implemented or frame error", None),
    ]


def test_items_without_an_answer_say_whether_one_was_sent() -> None:
    assert [one.result for one in the_only(read(1, dbw(1, 0))).items] == ["not answered"]
    talk = Talk()
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.lose(SERVER, words(1, 1))
    talk.packet(CLIENT)
    talk.finish()
    assert [one.result for one in talk.transactions[0].items] == ["answer not captured"]


def test_items_of_an_answer_alone_have_no_address() -> None:
    (first, second) = the_only(b"", ack_data(5, b"\x04\x02", good(4, b"\x00\x2a") + refused(10))).items
    assert first == Item("", "", "", None, "", "ok", b"\x00\x2a")
    assert second == Item("", "", "", None, "", "Object does not exist", None)


def test_items_of_a_push_say_what_did_not_change() -> None:
    def sent(kind: int, ref: int, *values: bytes) -> bytes:
        said = bytes((0, len(values))) + b"".join(values)
        return userdata(ref, head(kind, 2, 1, 3, 0), build.payload(said))

    talk = Talk()
    talk.open(8, 8)
    items = dbw(1, 0) + dbw(1, 2) + dbw(1, 4)
    talk.ask(userdata(1, head(1, 2, 1), build.payload(bytes((0, 3, 1, 2)) + items)))
    word = b"\xff\x04\x00\x10\x00"
    talk.tell(sent(2, 1, word + b"\x05", word + b"\x06", word + b"\x07"))
    talk.tell(sent(0, 0, b"\xfe\0\0\0", word + b"\x09"))
    assert [(one.address, one.value, one.result, one.ok) for one in talk.transactions[-1].items] == [
        ("DB1.DBW0", None, "unchanged", True),
        ("DB1.DBW2", 9, "ok", True),
        ("DB1.DBW4", None, "answer not captured", False),
    ]


def test_with_tags_each_tag_of_an_item_is_one(tmp_path: Path) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text("name,address,type,unit,scale\nTemp,DB1.DBW0,INT,°C,0.1\n", encoding="utf-8")
    talk = Talk()
    talk.pipeline = Pipeline(talk, Options(strict=True, naming=load_tags([tags]).naming()))
    talk.open()
    talk.ask(read(1, item(0x84, 1, 0, 2, 4), dbw(2, 0)))
    talk.tell(ack_data(1, b"\x04\x02", good(4, b"\0\xd7\0\3") + good(4, b"\0\5")))
    assert talk.transactions[0].items == [
        Item("DB1.DBW0", "Temp", "INT", 21.5, "°C", "ok", b"\0\xd7"),
        Item("DB1.DBB2", "", "", None, "", "ok", b"\0\3"),
        Item("DB2.DBW0", "", "WORD", 5, "", "ok", b"\0\5"),
    ]
    assert talk.transactions[0].items[0].name == "Temp"


def test_items_of_s7comm_plus_are_named_by_their_places() -> None:
    """Read as octets, because the capture has no symbols."""
    found = transactions_of(CAPTURES / "s7plus" / "s7commplus.pcapng")
    items = [one for one in found if one.is_plus and one.function_name.endswith("GetMultiVariables")]
    (written_twice,) = [one.items for one in items if [each.address for each in one.items] == ["DB1.DBD0", "DB1.DBD4"]]
    assert written_twice == [
        Item("DB1.DBD0", "", "Blob", "41ac0000", "", "ok", bytes.fromhex("000441ac0000")),
        Item("DB1.DBD4", "", "Blob", "00000000", "", "ok", bytes.fromhex("000400000000")),
    ]
    refusals = [one.items for one in items if one.items[0].address == "DB7.DBD0"]
    assert refusals == [[Item("DB7.DBD0", "", "", None, "", "0x8104", None)]]


def test_items_of_scd_are_the_values_of_the_answer_or_else_of_the_request() -> None:
    """As the dictionary has them: the pressure counts halves of a kilopascal."""
    found = [one for one in of_scd() if one.is_scd]
    pushed = {one.tag: one for each in found if each.outcome == "unsolicited" for one in each.items if one.value != 0}
    assert pushed["Давление 1"] == Item("0x6001:0", "Давление 1", "uint12", 1350.0, "кПа", "ok", None)
    assert pushed["Режим 1"] == Item("0x6061:0", "Режим 1", "int8", 1, "", "ok", None)
    set_by_client = {one.tag: one for each in found if each.outcome == "answered" for one in each.items}
    assert set_by_client["Расход 2"] == Item("0x6844:0", "Расход 2", "int32", 77, "", "ok", None)
    (refused_write,) = [one for one in found if one.items[0].address == "0x6001:0" and one.has_errors]
    assert refused_write.items == [Item("0x6001:0", "Давление 1", "uint12", 50.0, "кПа", "abort", None)]
    (unknown,) = [one for one in found if one.items[0].address == "0x6fff:0"]
    assert unknown.items == [Item("0x6fff:0", "", "", None, "", "abort", None)]
    (lost,) = [one for one in found if one.outcome == "unanswered"]
    assert lost.items == [Item("0x6844:0", "Расход 2", "int32", None, "", "not answered", None)]


def test_values_of_scd_have_names_units_texts_and_what_is_wrong_with_them() -> None:
    def row(number: int, one: NamedValue) -> tuple[object, ...]:
        return number, one.name, one.address, one.value, one.raw, one.unit, one.text, one.remark, one.origin

    found = {(one.name, str(one.value)): row(number, one) for each in of_scd() for number, one in named_values(each)}
    assert found["Давление 1", "1374.0"] == (0, "Давление 1", "0x6001:0", 1374.0, 2748, "кПа", "", "", "scd")
    assert found["Режим 1", "8"] == (0, "Режим 1", "0x6061:0", 8, 8, "", "автомат", "", "scd")
    assert found["Давление 1", "50.0"][3:8] == (50.0, 100, "кПа", "", "access")
    assert found["Последняя авария.time", "2015-10-18T00:00:00.123456789Z"][0] == 0


def test_what_scd_refuses_is_an_error_of_the_message() -> None:
    found = [one for one in of_scd() if one.is_scd and one.has_errors]
    assert {(error.part, error.where, error.name) for one in found for error in one.errors} == {
        ("message", "message", "abort")
    }
    (one,) = [one for one in found if one.items[0].address == "0x6001:0"]
    (error,) = one.errors
    assert error.code == one.error_code != 0
    assert error.text == one.scd[-1].dictionary.error_text(error.code) != ""
    assert [message.frame for message in one.scd] == [one.request_frame, one.response_frame]


def test_each_refused_item_has_the_name_of_its_own_code() -> None:
    found = the_only(read(1, dbw(1, 0), dbw(1, 2)), ack_data(1, b"\x04\x02", refused(10) + refused(0))).items
    assert [one.result for one in found] == ["Object does not exist", RETURN_CODES.name(0)]
