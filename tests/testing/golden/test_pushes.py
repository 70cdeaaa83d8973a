"""Pushes in a golden: which request they belong to, and what they say."""

from __future__ import annotations

import pytest

from dissect.testing.golden.model import GoldenError, Session
from dissect.testing.golden.parsing import parse_golden
from dissect.testing.golden.reading import SessionReader
from dissect.testing.golden.writing import golden_text
from tests.engine.transactions.talk import Talk, head, userdata
from tests.engine.transactions.test_results import AREAS, CYCLIC, ON_CHANGE, PUSH, RESPONSE, content, sent, subscribe


def talk(*pushes: str) -> Session:
    """Return the session of one who subscribed to two areas and got these pushes."""
    said = Talk()
    said.open(8, 8)
    said.ask(subscribe(1, ON_CHANGE, AREAS))
    said.tell(sent(RESPONSE, ON_CHANGE, 3, content(bytes.fromhex("ff0001ff7a")), reference=1))
    for push in pushes:
        said.tell(sent(PUSH, ON_CHANGE, 3, content(bytes.fromhex(push))))
    said.tell(userdata(0, head(PUSH, CYCLIC, ON_CHANGE, 9, 0), content(b"\x00\x01\xff\x09\x00\x01\x07")))
    said.finish()
    reader = SessionReader("talk")
    for transaction in said.transactions:
        reader.transaction(transaction)
    for connection in said.connections:
        reader.connection_closed(connection)
    return reader.finish()


def test_a_push_names_its_request_and_its_items() -> None:
    text = golden_text(talk("feff7b"))
    push = text.split("\n2 server ")[1].split("\n3 ")[0]
    assert "  job of 1\n" in push
    assert "    # DB68.DBB352 x2: unchanged\n" in push
    assert "    # DB72.DBB48 = 123\n" in push
    assert "job of" not in text.split("\n3 server ")[1]  # nobody asked for it here


def test_what_is_read_back_says_the_same() -> None:
    session = talk("feff7b", "ff0002fe")
    text = golden_text(session)
    again = parse_golden(text)
    assert golden_text(again) == text
    for one, other in zip(session.transactions, again.transactions, strict=True):
        assert [(item.label, item.data, item.return_code) for item in one.items] == [
            (item.label, item.data, item.return_code) for item in other.items
        ]
    assert [item.label for item in again.transactions[1].items] == ["DB68.DBB352 x2", "DB72.DBB48"]


def test_a_push_that_is_only_likely_of_its_job_is_marked() -> None:
    text = golden_text(talk("feff7b"))
    before = "\n2 server "
    head = before + text.split(before)[1].split("\n")[0]
    marked = text.replace(head, f"{head}\n  likely: alike", 1)
    push = parse_golden(marked).transactions[1]
    assert (push.outcome, push.certainty, push.doubt) == ("unsolicited", "likely", "alike")
    assert f"{head}\n  likely: alike  # the answer fits" in golden_text(parse_golden(marked))
    assert "likely" not in text


def test_a_request_that_does_not_stand_before_it_is_told_with_its_line() -> None:
    text = golden_text(talk("feff7b")).replace("job of 1", "job of 3")
    with pytest.raises(GoldenError, match=r"line [0-9]+: 'job of 3', but no transaction 3 precedes it here"):
        parse_golden(text)
