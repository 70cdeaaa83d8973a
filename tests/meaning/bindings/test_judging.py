"""What SCD in traffic is judged by; that each rule speaks and keeps silent is in tests/engine/findings/scd_scenarios.py."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.results import ALIKE, GAPS
from dissect.engine.transactions.transaction import ANSWERED, Transaction
from dissect.meaning.bindings.engine import ScdCarrier
from dissect.meaning.bindings.judging import MAX_COUNTERS, MAX_COUNTERS_ALL, ScdJudge
from tests.engine.findings.scd_scenarios import remap
from tests.engine.transactions.talk import CLIENT, SERVER, Talk, ack_data, good, item, read, write, written
from tests.meaning.bindings import plant


def listening() -> Talk:
    talk = Talk()
    talk.carry(plant.carrier())
    return talk


def details(talk: Talk) -> list[tuple[str, str]]:
    talk.pipeline.exchange.report_findings()
    return [(finding.slug, finding.detail) for finding in talk.findings]


@pytest.mark.parametrize(
    ("counters", "lost"),
    [
        ([0, 1, 2], []),
        ([254, 255, 0], []),
        ([7, 7, 7], []),
        ([0, 2], ["1 before this one: the counter went from 0 to 2"]),
        ([255, 2], ["2 before this one: the counter went from 255 to 2"]),
        ([5, 4], ["254 before this one: the counter went from 5 to 4"]),
    ],
)
def test_gaps_of_a_counter(counters: list[int], lost: list[str]) -> None:
    talk = listening()
    for counter in counters:
        talk.datagram(SERVER, plant.pdo(counter=counter))
    assert details(talk) == [("scd.pdo_gap", f"PDO T1 Состояние 1: {text}") for text in lost]


def test_each_direction_and_pdo_counts_for_itself() -> None:
    talk = listening()
    for counter in (0, 1):
        talk.datagram(SERVER, plant.pdo(counter=counter))
        talk.datagram(CLIENT, plant.pdo(counter=100 + counter))
        talk.datagram(SERVER, plant.pdo("T65", counter=200 + counter))
    assert details(talk) == []


def test_counters_are_bounded_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    assert (MAX_COUNTERS, MAX_COUNTERS_ALL) == (1024, 65536)
    monkeypatch.setattr("dissect.meaning.bindings.judging.MAX_COUNTERS", 1)
    monkeypatch.setattr("dissect.meaning.bindings.judging.MAX_COUNTERS_ALL", 3)
    talk = listening()
    for client in range(5):
        talk.datagram(SERVER, plant.pdo() + plant.pdo("T65"), (49200 + client, plant.MESSAGES))
    carrier = talk.pipeline.exchange.decoder
    assert isinstance(carrier, ScdCarrier)
    assert carrier.as_dict()["counters_forgotten"] == 5 + 2  # the second one of each, then two connections
    talk.pipeline.finish()
    assert carrier._judge._counters == {}
    assert carrier._judge._kept == 0


@pytest.mark.parametrize(("flags", "mapped"), [(0, True), (GAPS, False), (ALIKE, False)])
def test_a_write_is_acknowledged_where_the_pair_is_sure(flags: int, mapped: bool) -> None:
    """The answer to a likely pair may belong to another request: the device may still map as it did."""
    talk = listening()
    talk.datagram(CLIENT, plant.ask("0x1a00:0", 0))
    talk.pipeline.finish()
    (write_,) = [one for one in talk.transactions if one.function_name == "SCD write"]
    write_._outcome, write_._flags, write_.response_frame = ANSWERED, write_._flags | flags, 2
    carrier = talk.pipeline.exchange.decoder
    assert isinstance(carrier, ScdCarrier)
    carrier.transaction(write_)
    assert ("scd.remapped" in [slug for slug, _ in details(talk)]) is mapped


@pytest.mark.parametrize("flags", [0, GAPS, ALIKE])
@pytest.mark.parametrize("wrote", [False, True])
def test_contents_of_a_likely_pair_are_not_held_against_the_device(
    monkeypatch: pytest.MonkeyPatch, flags: int, wrote: bool
) -> None:
    """What a client wrote is known whoever answered it; what a server answered may be the content of another place."""
    talk = listening()
    talk.open()
    octets = bytes.fromhex("01C805")
    place = item(0x84, 10, 0, 2, 3)
    talk.ask(write(1, [place], written(4, octets)) if wrote else read(1, place))
    talk.tell(ack_data(1, b"\x05\x01", b"\xff") if wrote else ack_data(1, b"\x04\x01", good(4, octets)))
    pair = talk.transactions[-1]
    pair._flags |= flags
    judged: list[bool] = []
    monkeypatch.setattr(ScdJudge, "content", lambda _self, _device, _found, *, accepted: judged.append(accepted))
    carrier = talk.pipeline.exchange.decoder
    assert isinstance(carrier, ScdCarrier)
    carrier.transaction(pair)
    assert len(pair.scd) == 1
    assert judged == ([not flags] if wrote else [True] * (not flags))


def test_a_mapping_is_told_with_what_it_holds() -> None:
    talk = listening()
    remap(talk, plant.entry("Режим 1", 8, 0), plant.entry("Расход 1", 32, 8))
    assert details(talk) == [
        ("scd.remapped", "write 0x1a00:0 mapping of T1: 0 written, now switched off"),
        ("scd.remapped", "write 0x1a00:0 mapping of T1: 2 written, now 0x6061:0 Режим 1, 0x6044:0 Расход 1"),
    ]


def test_what_is_told_of_an_access_is_told_once() -> None:
    talk = listening()
    talk.datagram(CLIENT, plant.ask("Давление 1", 1))
    talk.datagram(SERVER, plant.refuse("Давление 1", -4, service="write"))
    assert [slug for slug, _ in details(talk)] == ["scd.access", "transaction.refused"]


def written_block(octets: bytes, code: int) -> tuple[Talk, Transaction]:
    talk = listening()
    talk.open()
    talk.ask(write(1, [item(0x84, 10, 8 * 8, 2, len(octets))], written(4, octets)))
    talk.tell(ack_data(1, b"\x05\x01", bytes((code,))))
    return talk, talk.transactions[-1]


def test_contents_in_s7_are_judged_with_their_place() -> None:
    talk, _ = written_block(b"\x37\x02\0\0\0\0\x08", 0xFF)
    assert [slug for slug, _ in details(talk) if slug.startswith("scd")] == []
    talk = listening()
    message = plant.codec().encode("T2", {}, partial=True)
    talk.datagram(SERVER, message + b"\x00\x01", (49200, plant.BARE))
    assert details(talk) == [("scd.odd_value", "PDO T2 Насос и давление 1: bytes are left over")]


def test_an_error_names_code_and_place() -> None:
    talk = listening()
    talk.datagram(SERVER, plant.pdo()[:12])
    talk.datagram(CLIENT, plant.ask("0x6fff"))
    assert details(talk) == [
        ("scd.malformed", "PDO: E_SHORT envelope: 12 bytes of 19"),
        ("scd.unknown_object", "read 0x6fff:0: E_INDEX 0x6fff: no object 0x6fff"),
    ]


def test_the_device_says_which_dictionary_it_has() -> None:
    """Profile 3.4: 1020h:03 is the first four octets of the wire id; 0 says nothing."""
    own = int.from_bytes(plant.dictionary().wire_id[:4], "little")
    talk = listening()
    for value in (0, own, own ^ 1):
        talk.datagram(CLIENT, plant.ask("0x1020:3"))
        talk.datagram(SERVER, plant.tell("0x1020:3", value))
    ((slug, detail),) = details(talk)
    assert slug == "scd.other_dictionary"
    assert detail.endswith(f"{own ^ 1:#010x}, that of 'Насосная' is {own:#010x}")
