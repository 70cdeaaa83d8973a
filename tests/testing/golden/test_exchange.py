"""What an exchange keeps of what was parsed."""

from __future__ import annotations

from dissect.testing.golden import exchange as module
from dissect.testing.golden.exchange import S7, Exchange
from tests.engine.transactions.talk import dbw, read, words


def exchange(number: int) -> Exchange:
    return Exchange(S7, read(0, dbw(10, 2 * number)), words(0, number))


def test_what_was_parsed_longest_ago_is_forgotten_and_read_again() -> None:
    first = exchange(7)
    request, items = first.request_pdu, first.items
    assert first.request_pdu is request
    assert first.items is items
    others = [exchange(number) for number in range(module._KEPT)]
    assert [one.items[0].value for one in others] == list(range(module._KEPT))
    assert first.request_pdu is not request
    assert (first.items[0].address, first.items[0].value) == (items[0].address, items[0].value) == ("DB10.DBW14", 7)
    kept = sum([one._request is not None for one in [first, *others]])
    assert kept == len(module._kept) == module._KEPT
