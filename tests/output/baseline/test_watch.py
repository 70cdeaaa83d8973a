"""What is not in a baseline is told; what is, is not."""

from __future__ import annotations

import pytest

from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.output.baseline import Baseline, BaselineWatch, PairNorm
from dissect.output.baseline.subjects import Pairs
from tests.meaning.report.support import ROOT
from tests.output.baseline.wire import Client, Wire

NORMAL = {
    "server_ports": frozenset((102,)),
    "tsaps": frozenset(("01.00 > 01.02",)),
    "functions": frozenset(("Setup communication", "Read Var", "Write Var")),
    "reads": frozenset(("DB10",)),
    "writes": frozenset(("DB10",)),
}


class Seen(Observer):
    def __init__(self, baseline: Baseline, unknown: str = "") -> None:
        super().__init__()
        self.unknown = unknown
        self.watch = BaselineWatch(baseline)
        self.pairs = Pairs()
        self.told: list[tuple[str, str]] = []

    def transaction(self, transaction: Transaction) -> None:
        pair = self.pairs.of(transaction.connection)
        self.told += [(one.kind, one.what) for one in self.watch.transaction(pair, transaction)]

    def connection_closed(self, connection: Connection) -> None:
        if self.unknown:
            setattr(connection, self.unknown, None)
        self.told += [(one.kind, one.what) for one in self.watch.connection(self.pairs.of(connection), connection)]


def seen(
    changed: dict[str, frozenset[str] | frozenset[int] | None], client: str = "10.0.0.1", unknown: str = ""
) -> list[tuple[str, str]]:
    norm = PairNorm("10.0.0.1", "10.0.0.2")
    for key, value in {**NORMAL, **changed}.items():
        setattr(norm, key, value)
    observer = Seen(
        Baseline({("10.0.0.1", "10.0.0.2"): norm, ("10.0.0.9", "10.0.0.8"): PairNorm("10.0.0.9", "10.0.0.8")}),
        unknown,
    )
    wire = Wire(observer)
    one = Client(wire, 0.0, client)
    one.read(1.0)
    one.write(2.0)
    wire.finish()
    return observer.told


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({}, []),
        (dict.fromkeys(NORMAL), []),
        ({"functions": frozenset(("Setup communication", "Read Var"))}, [("function", "Write Var")]),
        ({"reads": frozenset()}, [("read", "DB10")]),
        ({"writes": frozenset(("DB11",))}, [("write", "DB10")]),
        ({"tsaps": frozenset(("01.00 > 01.01",))}, [("tsap", "01.00 > 01.02")]),
        ({"server_ports": frozenset((1102,))}, [("port", "102")]),
    ],
)
def test_what_a_known_pair_does(
    changed: dict[str, frozenset[str] | frozenset[int] | None], told: list[tuple[str, str]]
) -> None:
    assert seen(changed) == told


@pytest.mark.parametrize(
    ("unknown", "known", "told"),
    [
        ("tsap_called", "01.00 > 01.02", []),
        ("tsap_calling", "01.00 > 01.02", []),
        ("tsap_called", "02.00 > 01.02", [("tsap", "01.00 > ?")]),
        ("tsap_calling", "01.00 > 01.03", [("tsap", "? > 01.02")]),
    ],
)
def test_a_tsap_that_was_not_captured_may_be_the_usual_one(
    unknown: str, known: str, told: list[tuple[str, str]]
) -> None:
    assert seen({"tsaps": frozenset((known,))}, unknown=unknown) == told


@pytest.mark.parametrize(
    ("client", "told"),
    [("10.0.0.7", ("client", "10.0.0.7")), ("10.0.0.9", ("pair", "10.0.0.9 > 10.0.0.2"))],
)
def test_who_is_not_known(client: str, told: tuple[str, str]) -> None:
    found = seen({}, client)
    assert found[-1] == told
    assert {kind for kind, _ in found[:-1]} == {"function", "read", "write"}


def test_s7comm_plus_by_its_blocks_and_what_the_cpu_sends_by_itself() -> None:
    """Blocks that are read and written are learned; a notification is the CPU's, no request of the panel."""
    texts: list[str] = []

    class Watch(Observer):
        watch = BaselineWatch(Baseline({}))
        pairs = Pairs()

        def transaction(self, transaction: Transaction) -> None:
            texts.extend(one.text for one in self.watch.transaction(self.pairs.of(transaction.connection), transaction))

    run = Run([str(ROOT / "captures" / "crafted" / "plus-plant.pcapng")], Watch())
    while run.step():
        pass
    assert "first S7comm-plus notification from 192.0.2.20 to 192.0.2.30" in texts
    assert "first S7comm-plus GetMultiVariables request to 192.0.2.20 by 192.0.2.30" in texts
    assert "first read of DB1 on 192.0.2.20 by 192.0.2.30" in texts
    assert "first write of DB1 on 192.0.2.20 by 192.0.2.30" in texts
    assert not [text for text in texts if "notification request" in text]
