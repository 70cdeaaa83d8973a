"""Requests that the capture cut: what is missing of them makes no finding."""

from __future__ import annotations

import pytest

from tests.engine.findings import events
from tests.engine.transactions.talk import CLIENT, Talk, dt


@pytest.mark.parametrize(
    ("name", "cut", "told"),
    [
        ("_INSE", 0, ["security.program_change"]),
        ("_INSE", 3, []),  # "_I" begins a name that is known
        ("XYZZY", 0, ["security.unknown_service"]),
        ("XYZZY", 3, ["security.unknown_service"]),
    ],
)
def test_the_beginning_of_the_name_of_a_service_is_no_unknown_one(name: str, cut: int, told: list[str]) -> None:
    talk = Talk()
    talk.open()
    talk.packet(CLIENT, dt(events.service(1, name, events.blocks("0800001P"))), cut=cut)
    talk.tell(events.answered(1, 0x28))
    assert [slug for slug in talk.slugs() if slug.startswith("security.")] == told
