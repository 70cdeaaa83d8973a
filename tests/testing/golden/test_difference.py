from __future__ import annotations

import pytest

from dissect.testing.golden.difference import KINDS, Difference, DiffOptions


@pytest.mark.parametrize("text", ["value", "values:", ":DB10", "", "VALUES"])
def test_what_cannot_be_ignored_is_told_with_what_can(text: str) -> None:
    with pytest.raises(ValueError, match="connections, tsaps, negotiation"):
        DiffOptions([text])


@pytest.mark.parametrize("text", ["20", "%", "-5ms", "5 min", "5ms,", "fast"])
def test_a_tolerance_that_is_none_is_told(text: str) -> None:
    with pytest.raises(ValueError, match="is not a tolerance such as 20% or 5ms"):
        DiffOptions(latency=text)


def test_patterns() -> None:
    options = DiffOptions(["values:DB10.*", "values:MB?", "values:Motors[12].Speed*", "codes"])
    assert options.ignores("values", "Motors[12].Speed")
    assert options.ignores("values", "Motors[12].SpeedSet[1]")
    assert not options.ignores("values", "Motors1.Speed")
    assert options.ignores("values", "DB10.DBW4")
    assert options.ignores("values", "nothing", "MB7")
    assert not options.ignores("values", "MB77")
    assert not options.ignores("values")
    assert options.ignores("codes", "anything")
    assert options.ignores("codes")
    assert not options.ignores("order", "DB10.DBW4")


def test_every_kind_can_be_ignored() -> None:
    assert all([DiffOptions([kind]).ignores(kind, "x") for kind in KINDS])


def test_json_has_null_where_there_is_nothing() -> None:
    told = Difference("added", "text", (1, 1), (0, 5), "READ MB0", values=("", "7")).as_dict()
    assert (told["transaction"], told["transaction_b"], told["address"], told["is"]) == (None, 5, None, "7")
