from __future__ import annotations

from typing import Any

import pytest

from dissect.engine.observer import Observer
from dissect.online.live.run import Fanout
from tests.meaning.report.support import begun, observed, read
from tests.properties.packets import Packet

#: Every method of an observer; a new one must be handed on as well.
METHODS = sorted(name for name, value in vars(Observer).items() if callable(value) and not name.startswith("_"))


class Counting(Observer):
    """Counts what it is told, and fails at one method."""

    def __init__(self, pdus: bool = False, tpdus: bool = False, fails_at: str = "") -> None:
        super().__init__()
        self.wants_pdus = pdus
        self.wants_tpdus = tpdus
        self.told: dict[str, int] = {}
        self.fails_at = fails_at

    def _count(self, name: str) -> None:
        self.told[name] = self.told.get(name, 0) + 1
        if name == self.fails_at:
            raise ValueError("disk full")


def _counted(name: str) -> Any:
    def method(self: Counting, *_: object) -> None:
        self._count(name)

    return method


for _name in METHODS:
    setattr(Counting, _name, _counted(_name))

Failure = tuple[Observer, Exception]


def packets() -> list[Packet]:
    return read(read(begun(), 1), 2, content=0x0A).close().packets()


def test_everybody_is_told_everything() -> None:
    alone, one, other = Counting(), Counting(), Counting()
    observed(alone, packets())
    observed(Fanout([one, other], failures_are_bugs), packets())
    assert one.told == other.told == alone.told
    assert {"connection_opened", "connection_closed", "transaction", "finding", "operation"} <= one.told.keys()


def failures_are_bugs(observer: Observer, error: Exception) -> None:
    raise error


def test_pdus_go_only_to_those_who_want_them() -> None:
    pdus, tpdus, neither = Counting(pdus=True), Counting(tpdus=True), Counting()
    fanout = Fanout([pdus, tpdus, neither], failures_are_bugs)
    assert (fanout.wants_pdus, fanout.wants_tpdus) == (True, True)
    observed(fanout, packets())
    assert pdus.told["pdu"] == 6
    assert tpdus.told["tpdu"] == 8
    assert not {"pdu", "tpdu"} & neither.told.keys()
    assert "tpdu" not in pdus.told
    assert "pdu" not in tpdus.told


def test_nobody_wants_pdus() -> None:
    fanout = Fanout([Counting(), Counting()], failures_are_bugs)
    assert (fanout.wants_pdus, fanout.wants_tpdus) == (False, False)


@pytest.mark.parametrize("method", METHODS)
def test_every_method_is_handed_on(method: str) -> None:
    one = Counting(pdus=True, tpdus=True)
    fanout = Fanout([one], failures_are_bugs)
    for size in range(1, 6):
        try:
            getattr(fanout, method)(*[None] * size)
        except TypeError:  # it takes more
            continue
        break
    assert one.told == {method: 1}


@pytest.mark.parametrize("method", ["connection_opened", "transaction", "operation", "finding", "pdu"])
def test_one_that_fails_is_reported_once_and_dropped(method: str) -> None:
    failing, good = Counting(pdus=True, fails_at=method), Counting(pdus=True)
    alone = Counting(pdus=True)
    failures: list[Failure] = []
    fanout = Fanout([failing, good], lambda observer, error: failures.append((observer, error)))
    observed(fanout, packets())
    observed(alone, packets())
    assert [(observer, str(error)) for observer, error in failures] == [(failing, "disk full")]
    assert failing.told[method] == 1
    assert fanout.observers == [good]
    assert good.told == alone.told


def test_one_is_dropped_once() -> None:
    one = Counting()
    failures: list[Failure] = []
    fanout = Fanout([one], lambda observer, error: failures.append((observer, error)))
    fanout.drop(one, ValueError("a"))
    fanout.drop(one, ValueError("b"))
    assert [str(error) for _, error in failures] == ["a"]
