"""What is known of a device: constants, mappings rewritten while somebody watched; nothing of it reaches another device."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.meaning.bindings.binding import Binding, Bindings
from dissect.meaning.bindings.devices import MAX_CONSTANTS, MAX_DEVICES, ScdDevice, ScdDevices, is_rewritten
from dissect.meaning.bindings.engine import ScdCarrier
from dissect.packets.tcp.stream import Endpoint
from dissect.scd.errors import Error
from tests.engine.transactions.talk import CLIENT, SERVER, Talk
from tests.meaning.bindings import plant

T1: Final = 0x1A00
MODE: Final = plant.entry("Режим 1", 8, 0)
FLOW: Final = plant.entry("Расход 1", 32, 8)


def devices() -> ScdDevices:
    return ScdDevices(plant.dictionary())


def device(host: int = 1, port: int = 5600, of: ScdDevices | None = None) -> ScdDevice:
    return (of or devices()).at(Endpoint(host.to_bytes(4, "big"), port))


def test_a_device_is_an_address_and_a_port() -> None:
    book = devices()
    one = device(1, of=book)
    assert device(1, of=book) is one
    assert device(2, of=book) is not one
    assert device(1, 5601, of=book) is not one


def test_the_device_heard_of_longest_ago_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    assert MAX_DEVICES == 4096
    monkeypatch.setattr("dissect.meaning.bindings.devices.MAX_DEVICES", 2)
    book = devices()
    first, second = device(1, of=book), device(2, of=book)
    assert device(1, of=book) is first
    device(3, of=book)
    assert book.forgotten == 1
    assert device(1, of=book) is first
    assert device(2, of=book) is not second
    assert book.forgotten == 2


def test_constants() -> None:
    one = device()
    key = (0x1000, 0)
    assert [one.constant(key, value) for value in (1, 1, 2, 2, 1)] == [None, None, 1, None, 2]
    assert one.constant((0x1001, 0), float("nan")) is None
    assert one.constant((0x1001, 0), float("nan")) is None
    assert one.constant((0x1001, 0), 1.0) is not None


def test_constants_of_a_device_are_bounded_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    assert MAX_CONSTANTS == 1024
    monkeypatch.setattr("dissect.meaning.bindings.devices.MAX_CONSTANTS", 2)
    monkeypatch.setattr("dissect.meaning.bindings.devices.MAX_DEVICES", 1)
    book = devices()
    one = device(1, of=book)
    assert [one.constant((index, 0), value) for index in (1, 2, 3) for value in (1, 2)] == [
        None,
        1,
        None,
        1,
        None,
        None,
    ]
    assert book.overlooked == 2
    device(2, of=book)
    assert (book.forgotten, book.overlooked) == (1, 2)


def test_a_mapping_is_rewritten_in_steps() -> None:
    """Switched off, entries, switched on (POWERLINK); one entry alone changes nothing while it is switched off."""
    one = device()
    assert one.write_mapping(T1, 0, 0) is None
    assert one.codec.pdo("T1").map == ()
    assert one.write_mapping(T1, 1, MODE) is None
    assert one.write_mapping(T1, 2, FLOW) is None
    pdo = one.write_mapping(T1, 0, 2)
    assert pdo is not None
    assert [(row.variable.name, row.offset, row.bits) for row in pdo.map] == [("Режим 1", 0, 8), ("Расход 1", 8, 32)]
    assert one.codec.decode("T1", b"\x08\xe8\x03\0\0").values == {(0x6061, 0): 8, (0x6044, 0): 1000}


def test_an_element_of_a_mapping_in_use_counts_at_once() -> None:
    one = device()
    state = plant.dictionary().variable("Режим 2").address
    last = state[0] | state[1] << 16 | 48 << 32 | 8 << 48
    pdo = one.write_mapping(T1, 3, last)
    assert pdo is not None
    assert [row.variable.name for row in pdo.map] == ["Слово состояния 1", "Расход 1", "Режим 2"]


@pytest.mark.parametrize("entry", [1 << 48 | 0x6FFF, 7 << 48 | 0x6061, 0x6061, (1 << 64) - 1])
def test_an_impossible_mapping_leaves_the_one_before(entry: int) -> None:
    one = device()
    before = one.codec.pdo("T1").map
    with pytest.raises(Error):
        one.write_mapping(T1, 1, entry)
    assert one.codec.pdo("T1").map == before


def test_a_device_has_its_own_codec_from_the_first_rewrite_on() -> None:
    book = devices()
    one, two = device(1, of=book), device(2, of=book)
    assert one.codec is two.codec is book.codec
    one.write_mapping(T1, 0, 0)
    assert one.codec is not two.codec
    assert two.codec is book.codec
    assert len(two.codec.pdo("T1").map) == 3


@pytest.mark.parametrize(
    ("key", "rewritten"),
    [((T1, 0), True), ((T1, 3), True), ((T1, 255), False), ((0x6000, 1), False), ((0x1BFF, 0), False), ("run", False)],
)
def test_what_is_a_mapping(key: tuple[int, int] | str, rewritten: bool) -> None:
    assert is_rewritten(plant.dictionary(), key) is rewritten


# ---- in traffic -----------------------------------------------------------------------------------------------------


def rewrite(talk: Talk, ports: tuple[int, int] = (49200, plant.MESSAGES), answer: bool = True) -> None:
    """Map the mode alone to T1."""
    for tid, (sub, value) in enumerate(((0, 0), (1, MODE), (0, 1))):
        talk.datagram(CLIENT, plant.ask(f"0x1a00:{sub}", value, tid), ports)
        if answer:
            talk.datagram(SERVER, plant.tell(f"0x1a00:{sub}", tid=tid), ports)


def states(talk: Talk) -> list[list[str]]:
    """The variables of every PDO T1."""
    return [[row.name for row in one.scd[0].values] for one in talk.transactions if one.function_name == "SCD PDO T1"]


ALL: Final = ["Слово состояния 1", "Расход 1", "Режим 1"]


def short(counter: int = 0) -> bytes:
    """T1 by the new mapping."""
    envelope = plant.codec().envelope
    return envelope.build({"kind": 0x10, "tid": counter, "index": T1}, b"\x08")


def test_a_rewritten_mapping_holds_from_then_on_for_this_device_alone() -> None:
    talk = Talk()
    talk.carry(plant.carrier())
    talk.datagram(SERVER, plant.pdo())
    rewrite(talk)
    talk.datagram(SERVER, short(1))
    talk.hosts = [1, 3]
    talk.datagram(SERVER, plant.pdo())
    talk.hosts = [4, 2]  # another one talks to the device
    talk.datagram(SERVER, short())
    assert states(talk) == [ALL, ["Режим 1"], ALL, ["Режим 1"]]
    assert [finding.slug for finding in talk.findings] == ["scd.remapped", "scd.remapped"]
    (pdo,) = {one.scd[0].mapping for one in talk.transactions if one.scd[0].octets == short(1)}
    assert pdo is not None
    assert len(pdo.map) == 1


def test_what_is_not_acknowledged_is_not_believed() -> None:
    talk = Talk()
    talk.carry(plant.carrier())
    rewrite(talk, answer=False)
    talk.datagram(SERVER, plant.pdo())
    assert states(talk) == [ALL]
    assert [finding.slug for finding in talk.findings] == ["transaction.unanswered"] * len(talk.findings)


def test_where_the_asking_end_owns_the_dictionary() -> None:
    """device = "peer": a master on the bound port polls slaves that send from anywhere."""
    bound = Binding("m", "udp", "messages", port=5600, device="peer")
    talk = Talk()
    talk.carry(ScdCarrier(plant.dictionary(), Bindings([bound])))
    for tid, (sub, value) in enumerate(((0, 0), (1, MODE), (0, 1))):
        talk.datagram(SERVER, plant.ask(f"0x1a00:{sub}", value, tid))
        talk.datagram(CLIENT, plant.tell(f"0x1a00:{sub}", tid=tid))
    talk.datagram(CLIENT, short())
    talk.hosts = [3, 2]
    talk.datagram(CLIENT, plant.pdo())
    assert states(talk) == [["Режим 1"], ALL]


def test_constants_are_those_of_the_device_that_says_them() -> None:
    talk = Talk()
    talk.carry(plant.carrier())
    for host, value in ((2, 1), (3, 2), (2, 1), (3, 2)):
        talk.hosts = [1, host]
        talk.datagram(CLIENT, plant.ask("Тип устройства"))
        talk.datagram(SERVER, plant.tell("Тип устройства", value))
    # Neither is what the dictionary says, and none has changed.
    assert {finding.slug for finding in talk.findings} == {"scd.other_dictionary"}
    assert len(talk.transactions) == 4
