"""Scenarios of the rules about SCD."""

from __future__ import annotations

from dissect import scd
from dissect.scd.codec import Codec
from tests.engine.findings.registry import silent, speaks
from tests.engine.transactions.talk import CLIENT, SERVER, Talk
from tests.meaning.bindings import plant


def listening(talk: Talk) -> Talk:
    talk.carry(plant.carrier())
    return talk


@silent(
    "scd.malformed",
    "scd.crc",
    "scd.unknown_object",
    "scd.access",
    "scd.garbage",
    "scd.odd_value",
    "scd.status",
    "scd.pdo_error",
    "scd.pdo_gap",
    "scd.constant_changed",
    "scd.other_dictionary",
    "scd.limits",
    "scd.remapped",
    "scd.bad_mapping",
)
def all_goes_well(talk: Talk) -> None:
    """Counters wrap and stand still, a constant and the dictionary are read twice, something is refused, a stream is cut."""
    listening(talk)
    conf_id = int.from_bytes(plant.dictionary().wire_id[:4], "little")
    for counter in (254, 255, 0, 1):
        talk.datagram(SERVER, plant.pdo(counter=counter))
        talk.datagram(SERVER, plant.pdo("T65"))
    for tid in (1, 2):
        for where, value in (("Тип устройства", 0x10002), ("0x1020:3", conf_id), ("0x1020:1", 5 + tid)):
            talk.datagram(CLIENT, plant.ask(where, tid=tid))
            talk.datagram(SERVER, plant.tell(where, value, tid=tid))
    talk.datagram(CLIENT, plant.ask("Насос 1.run", value=True))
    talk.datagram(SERVER, plant.refuse("Насос 1.run", -19, service="write"))
    talk.datagram(CLIENT, plant.ask("0x1a00:0", value=0))
    talk.datagram(SERVER, plant.refuse("0x1a00:0", -19, service="write"))
    talk.datagram(SERVER, plant.pdo(counter=2))
    talk.ports = [50000, plant.STREAM]
    talk.hello()
    request = plant.ask("Расход 1")
    talk.packet(CLIENT, request[:5])
    talk.packet(CLIENT, request[5:] + request)
    talk.packet(SERVER, plant.tell("Расход 1", -1) * 2)
    talk.close()
    assert len(talk.transactions) == 9 + 6 + 2 + 2
    assert all(transaction.scd and transaction.scd[0].message.error is None for transaction in talk.transactions)


@speaks("scd.malformed")
def a_value_of_another_size(talk: Talk) -> None:
    listening(talk).datagram(SERVER, _with_data(b"\x01", index=0x6044, kind=0x82))


@speaks("scd.crc")
def an_octet_changed(talk: Talk) -> None:
    octets = bytearray(plant.pdo())
    octets[11] ^= 1
    listening(talk).datagram(SERVER, bytes(octets))


@speaks("scd.unknown_object")
def nobody_knows_it(talk: Talk) -> None:
    listening(talk).datagram(CLIENT, plant.ask("0x6fff"))


@speaks("scd.access")
def a_constant_is_written(talk: Talk) -> None:
    listening(talk).datagram(CLIENT, plant.ask("Тип устройства", value=1))


@speaks("scd.garbage")
def something_else_in_the_stream(talk: Talk) -> None:
    listening(talk).ports = [50000, plant.STREAM]
    talk.hello()
    talk.packet(CLIENT, plant.ask("Расход 1") + b"GET / HTTP/1.1\r\n" + plant.ask("Расход 2", tid=2))
    assert talk.transactions == []
    talk.close()
    assert len(talk.transactions) == 2


@speaks("scd.odd_value")
def octets_behind_a_pdo(talk: Talk) -> None:
    listening(talk).datagram(SERVER, plant.codec().encode("T2", {}, partial=True) + b"\0", (49200, plant.BARE))


@speaks("scd.status")
def a_status(talk: Talk) -> None:
    listening(talk).datagram(CLIENT, plant.ask("Расход 1"))
    talk.datagram(SERVER, plant.tell("Расход 1", 5, err=3))


@speaks("scd.pdo_error")
def a_pdo_in_trouble(talk: Talk) -> None:
    listening(talk).datagram(SERVER, plant.pdo(err=-16))


@speaks("scd.pdo_gap")
def a_pdo_is_lost(talk: Talk) -> None:
    listening(talk).datagram(SERVER, plant.pdo(counter=255))
    talk.datagram(SERVER, plant.pdo(counter=1))
    talk.pipeline.exchange.report_findings()
    (finding,) = talk.findings
    assert finding.detail == "PDO T1 Состояние 1: 1 before this one: the counter went from 255 to 1"


@speaks("scd.constant_changed")
def another_device(talk: Talk) -> None:
    listening(talk)
    for value in (1, 2):
        talk.datagram(CLIENT, plant.ask("Тип устройства"))
        talk.datagram(SERVER, plant.tell("Тип устройства", value))


@speaks("scd.other_dictionary")
def it_has_another_one(talk: Talk) -> None:
    listening(talk).datagram(CLIENT, plant.ask("0x1020:3"))
    talk.datagram(SERVER, plant.tell("0x1020:3", 0xDEADBEEF))


@speaks("scd.limits")
def it_runs_too_fast(talk: Talk) -> None:
    fast = Codec(plant.dictionary(), limits=False)
    answer = scd.Message(service="read", phase="response", tid=1, index=0x6000, sub=4, values={(0x6000, 4): 3001})
    listening(talk).datagram(CLIENT, plant.ask("0x6000:4"))
    talk.datagram(SERVER, fast.encode_message(answer))


def remap(talk: Talk, *entries: int) -> None:
    """Write the mapping of T1 as POWERLINK wants it: switched off, entries, switched on."""
    writes = [(0, 0), *enumerate(entries, 1), (0, len(entries))]
    for tid, (sub, value) in enumerate(writes):
        talk.datagram(CLIENT, plant.ask(f"0x1a00:{sub}", value=value, tid=tid))
        talk.datagram(SERVER, plant.tell(f"0x1a00:{sub}", tid=tid))


@speaks("scd.remapped")
def it_sends_something_else_now(talk: Talk) -> None:
    remap(listening(talk), plant.entry("Режим 1", 8, 0))


@speaks("scd.bad_mapping")
def a_mapping_that_cannot_be(talk: Talk) -> None:
    remap(listening(talk), plant.entry("Режим 1", 7, 0))


def _with_data(data: bytes, *, index: int, kind: int) -> bytes:
    """A message whose data are these octets, whatever the dictionary says of them."""
    numbers = {"response": kind >> 7, "kind": kind & 0x3F, "index": index}
    return plant.codec().envelope.build(numbers, data)
