from __future__ import annotations

from dissect.engine.transactions import accounts
from dissect.engine.transactions.accounts import CATEGORIES, FIRST_IGNORED, OctetAccount


def test_every_category_is_named_by_its_number() -> None:
    numbers = {
        name.lower(): value
        for name, value in vars(accounts).items()
        if name.isupper() and isinstance(value, int) and name != "FIRST_IGNORED"
    }
    assert [name for name, _ in sorted(numbers.items(), key=lambda row: row[1])] == CATEGORIES
    assert sorted(numbers.values()) == [*range(len(CATEGORIES))]


def test_what_was_used_stands_before_what_was_not() -> None:
    assert CATEGORIES[:FIRST_IGNORED] == ["payload", "no_payload", "retransmission", "keep_alive", "fragment_used"]


def test_an_account_begins_empty_and_is_written_by_name() -> None:
    account = OctetAccount()
    account.delivered = 7
    account.framed = 4
    account.skipped = 2
    account.buffered = 1
    assert account.as_dict() == {
        "delivered": 7,
        "framed": 4,
        "skipped": 2,
        "buffered": 1,
        "missing": 0,
        "holes": 0,
        "holes_inside_messages": 0,
        "failed": 0,
    }


def test_what_nothing_accounts_for_is_told() -> None:
    account = OctetAccount()
    account.delivered = 7
    account.framed = 4
    assert (account.failed, account.as_dict()["failed"]) == (3, 3)
