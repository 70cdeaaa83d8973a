"""PDOs that came before: told like those that are looked at closely, and decoded only when somebody asks."""

from __future__ import annotations

import struct
from typing import Any, Final

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dissect.meaning.bindings.binding import Binding, Bindings
from dissect.meaning.bindings.engine import ScdCarrier
from dissect.scd.packing import Packing
from tests.engine.transactions.talk import CLIENT, SERVER, Talk
from tests.meaning.bindings import plant
from tests.scd.making import FLOAT32, pdo

#: Somebody switches T1 off.
REWRITE: Final = plant.ask("0x1a00:0", 0, tid=10)
REWRITTEN: Final = plant.tell("0x1a00:0", tid=10)
#: PDOs, units in which something is odd, and writes to the mapping of T1.
UNITS: Final = (
    plant.pdo("T1", 1),
    plant.pdo("T1", 2),
    plant.pdo("T1", 9),
    plant.pdo("T65", 3),
    plant.pdo("T1", 3, err=4),
    plant.pdo("T1", 4, err=-4),
    plant.pdo("T1", 5)[:-1],
    plant.pdo("T1", 5)[:-1] + b"\x00",
    plant.pdo("T1", 5) + b"\0",
    plant.pdo("T1", 6) + plant.pdo("T1", 7),
    plant.ask("Расход 1", tid=8),
    plant.tell("Расход 1", 5, tid=8),
    REWRITE,
    REWRITTEN,
    b"",
)


class Careful:
    """Knows nothing, so that every unit is looked at closely."""

    bare = True

    def take(self, *_: object) -> bool:
        return False

    take_again = take

    def learn(self, *_: object) -> None: ...


def heard(port: int, said: list[tuple[int, bytes]], *, careful: bool) -> tuple[object, ...]:
    """Return all that is told of datagrams."""
    talk = Talk(server_port=port)
    carrier = plant.carrier()
    talk.carry(carrier)
    if careful:
        carrier._pushes = [Careful() for _ in carrier.bindings.all]  # type: ignore[misc]
    for side, unit in said:
        talk.datagram(side, unit, (49200, port))
    talk.pipeline.finish()
    transactions = [_told(transaction) for transaction in talk.transactions]
    findings = [(one.slug, one.frames, one.detail) for one in talk.findings]
    return transactions, findings, carrier.as_dict()


def _told(transaction: Any) -> tuple[object, ...]:
    scd = [
        (
            repr(one.message),
            one.octets,
            one.frame,
            one.time_ns,
            one.side,
            one.connection,
            one.offset,
            one.place,
            repr(one.mapping),  # one that was rewritten is an object of its own in each of two runs
        )
        for one in transaction.scd
    ]
    parameters = transaction.parameters
    return (
        *(transaction.function_name, transaction.outcome, transaction.pdu_ref, transaction.connection.pdus),
        *(parameters.function, parameters.index, parameters.sub, parameters.err, parameters.refused, scd),
    )


@settings(max_examples=30)
@given(st.lists(st.tuples(st.sampled_from((CLIENT, SERVER)), st.sampled_from(UNITS)), max_size=12))
@example([(CLIENT, REWRITE), (SERVER, REWRITTEN), (CLIENT, plant.pdo("T1", 1))])
def test_messages_are_told_like_those_that_are_looked_at_closely(said: list[tuple[int, bytes]]) -> None:
    assert heard(plant.MESSAGES, said, careful=False) == heard(plant.MESSAGES, said, careful=True)


@settings(max_examples=30)
@given(st.lists(st.tuples(st.sampled_from((CLIENT, SERVER)), st.binary(min_size=3, max_size=5)), max_size=12))
def test_bare_pdos_are_told_like_those_that_are_looked_at_closely(said: list[tuple[int, bytes]]) -> None:
    assert heard(plant.BARE, said, careful=False) == heard(plant.BARE, said, careful=True)


def test_values_are_decoded_when_somebody_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    unpack = Packing.unpack
    decoded: list[bytes] = []

    def counting(self: Packing, octets: bytes, *rest: Any) -> Any:
        decoded.append(octets)
        return unpack(self, octets, *rest)

    monkeypatch.setattr(Packing, "unpack", counting)
    talk = Talk(server_port=plant.MESSAGES)
    talk.carry(plant.carrier())
    for counter in range(5):
        talk.datagram(SERVER, plant.pdo("T1", counter))
    assert len(decoded) == 1
    last = talk.transactions[-1]
    assert last.scd[0].message.tid == 4
    assert list(last.scd[0].message.values.values()) == [0, 0, 0]
    assert last.scd[0].message is last.scd[0].message
    assert len(decoded) == 2


def test_an_infinity_in_a_known_pdo_is_reported() -> None:
    codec = pdo(FLOAT32)
    bound = Binding("x", "udp", "pdo", "T1", "T1", size=4, port=5602)
    talk = Talk(server_port=5602)
    talk.carry(ScdCarrier(codec.dictionary, Bindings([bound])))
    for value in (1.0, 2.0, float("inf"), 3.0):
        talk.datagram(SERVER, struct.pack("<f", value), (49200, 5602))
    talk.pipeline.finish()
    assert [(one.slug, one.frames) for one in talk.findings] == [("scd.odd_value", [3])]
