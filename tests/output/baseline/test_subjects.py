"""What a transaction is about: functions, areas, who asks whom. Bounded, and the same for what is repeated."""

from __future__ import annotations

import pytest

from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.output.baseline import subjects
from dissect.output.baseline.subjects import Pair, Pairs, Subject, Subjects, area_names
from dissect.protocols.s7.items import parse_item
from tests.meaning.report.support import ROOT
from tests.output.baseline.wire import Client, Wire


class Seen(Observer):
    def __init__(self) -> None:
        super().__init__()
        self.subjects = Subjects()
        self.pairs = Pairs()
        self.found: list[Subject] = []
        self.who: list[Pair] = []

    def connection_opened(self, connection: Connection) -> None:
        self.who.append(self.pairs.of(connection))

    def transaction(self, transaction: Transaction) -> None:
        self.found.append(self.subjects.of(transaction))


def test_polling_is_one_subject() -> None:
    seen = Seen()
    wire = Wire(seen)
    client = Client(wire)
    for second in range(5):
        client.read(second)
    assert [one.function for one in seen.found] == ["Setup communication", *["Read Var"] * 5]
    assert len({id(one) for one in seen.found}) == 2
    assert (seen.found[1].reads, seen.found[1].writes) == (("DB10",), ())


def test_polling_in_s7comm_plus_is_one_subject() -> None:
    seen = Seen()
    run = Run([str(ROOT / "captures" / "crafted" / "plus-plant.pcapng")], seen)
    while run.step():
        pass
    reads = [one for one in seen.found if one.function == "S7comm-plus GetMultiVariables"]
    assert [(one.reads, one.writes, one.is_push) for one in reads] == [(("DB1",), (), False)] * 4
    assert len({id(one) for one in reads}) == 1
    pushes = [one for one in seen.found if one.is_push and one.reads]
    assert len(pushes) > 4
    assert len({id(one) for one in pushes}) == len({one.reads for one in pushes})


def test_what_is_remembered_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subjects, "_MAX_CACHED", 2)
    monkeypatch.setattr(subjects, "_MAX_CONNECTIONS", 3)
    seen = Seen()
    for path in [*sorted((ROOT / "captures").glob("*.pcapng")), ROOT / "captures" / "crafted" / "plus-plant.pcapng"]:
        run = Run([str(path)], seen)
        while run.step():
            known = seen.subjects
            assert max(len(known._known), len(known._read), len(known._said)) <= 2
    wire = Wire(seen)
    seen.pairs = Pairs()
    for number in range(5):
        Client(wire, number, f"10.0.1.{number}", ports=(5000 + number, 102))
    assert [seen.pairs.numbered(number) for number in (1, 2, 5)] == [None, None, ("10.0.1.4", "10.0.0.2")]


@pytest.mark.parametrize(
    ("octets", "names"),
    [
        ("120a10020001000c84000000", ["DB12"]),
        ("120a10020001000085000000", ["DI0"]),
        ("120a10020001000083000000", ["M"]),
        ("120a101c000100001c000005", ["C"]),
        ("120a10020001000077000000", ["area0x77"]),
        ("120cb0020400010000080002000a", ["DB1", "DB2"]),
        ("1208824100010002", ["NCK"]),
        ("1203ee0001", ["0xee"]),
    ],
)
def test_areas(octets: str, names: list[str]) -> None:
    assert area_names(parse_item(bytes.fromhex(octets), 0)) == names
