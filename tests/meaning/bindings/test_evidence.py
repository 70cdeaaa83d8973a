"""What shows another dictionary, each thing once with the value that shows it and once with the one that does not."""

from __future__ import annotations

import pytest

from dissect.meaning.bindings.evidence import Evidence
from dissect.scd.messages import Message
from dissect.scd.types import Value
from tests.engine.transactions.talk import CLIENT, SERVER, Talk
from tests.meaning.bindings import plant

EVIDENCE = Evidence(plant.dictionary())


@pytest.mark.parametrize(
    ("key", "same", "other", "said"),
    [
        ((0x1000, 0), 0x10002, 0x10003, "constant 0x1000:0 = 65539, the dictionary has 65538"),
        ((0x6000, 0), 4, 5, "number of sub-indices 0x6000:0 = 5, the dictionary has 4"),
        ((0x2001, 0), 3, 2, "number of sub-indices 0x2001:0 = 2, the dictionary has 3"),
        ((0x0040, 4), 3, 4, "constant 0x0040:4 = 4, the dictionary has 3"),
        (
            (0x6001, 255),
            7 | 0x60 << 8,
            7 | 5 << 8,
            "0x6001 is VAR of type 0x0005 there, VAR of type 0x0060 in the dictionary",
        ),
        ((0x2001, 255), 8 | 3 << 8, 9 | 3 << 8, "0x2001 is RECORD of type 0x0003 there, ARRAY of type 0x0003"),
        ((0x1020, 255), 9, 8, "0x1020 is ARRAY of type 0x0000 there"),
        ((0x6000, 255), 9 | 0x40 << 8, 9 | 0x41 << 8, "0x6000 is RECORD of type 0x0041 there"),
    ],
)
def test_values_that_the_dictionary_has(key: tuple[int, int], same: Value, other: Value, said: str) -> None:
    assert EVIDENCE.shown(key, same) == ""
    assert EVIDENCE.shown(key, other).startswith(said)


@pytest.mark.parametrize("key", [(0x6041, 0), (0x1A00, 0), (0x1A00, 1), (0x9999, 255), (0x6000, 4)])
def test_what_may_have_any_value_shows_nothing(key: tuple[int, int]) -> None:
    """A variable, a mapping that can be rewritten, the structure of something that is not there."""
    assert EVIDENCE.shown(key, 1) == ""


@pytest.mark.parametrize(
    ("index", "sub", "err", "said"),
    [
        (0x1000, 0, -5, "it has no object 0x1000 Тип устройства, which is mandatory"),
        (0x6000, 4, -6, "it has no sub-index 4 of 0x6000 Насос 1, which is mandatory"),
        (0x6000, 9, -6, ""),
        (0x6041, 0, -5, ""),
        (0x1000, 0, -4, ""),
        (0x9999, 0, -5, ""),
    ],
)
def test_what_a_device_denies(index: int, sub: int, err: int, said: str) -> None:
    message = Message(
        service="read", phase="abort", index=index, sub=sub, err=err, numbers={"index": index, "sub": sub}
    )
    assert EVIDENCE.denied(message) == said


def test_all_of_it_is_found_in_traffic() -> None:
    talk = Talk()
    talk.carry(plant.carrier())
    for where, value in (("0x1000:0", 65539), ("0x2001:0", 2)):
        talk.datagram(CLIENT, plant.ask(where))
        talk.datagram(SERVER, plant.tell(where, value))
    talk.datagram(CLIENT, plant.ask("0x6000:4"))
    talk.datagram(SERVER, plant.refuse("0x6000:4", -5))
    talk.datagram(CLIENT, plant.ask("0x6001:255"))
    talk.datagram(SERVER, plant.tell("0x6001:255", 7 | 5 << 8))
    talk.pipeline.exchange.report_findings()
    told = [finding for finding in talk.findings if finding.slug == "scd.other_dictionary"]
    assert [finding.frames for finding in told] == [[2], [4], [6], [8]]
