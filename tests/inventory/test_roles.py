"""What makes a device a CPU, an engineering station, a panel or an OPC server: one case for each rule, and how they weigh."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import pytest

from dissect.inventory.model import BEHAVIOUR, CPU, ENGINEERING, OPC, PANEL, STATED, TSAP, Device
from dissect.inventory.roles import judge_client
from dissect.iso.tsap import Tsap
from dissect.s7plus.program import Program
from dissect.s7plus.session import Identity, PlusSession
from dissect.transactions.connection import Connection
from tests.findings import events
from tests.findings.operation_scenarios import load
from tests.inventory.support import inventory_of
from tests.stations.answers import answered, identification, mode, protection, szl
from tests.transactions.talk import CLIENT, Talk, dbw, dt, read, tpkt, words

CONFIRM: Final = tpkt(bytes.fromhex("11d00001000200c1020100c2020102c0010a"))


def called(tsap: bytes, calling: bytes = b"\1\0") -> Callable[[Talk], None]:
    """A client connects to a TSAP and is not answered any further."""

    def scene(talk: Talk) -> None:
        talk.hello()
        variable = bytes((0xC1, len(calling))) + calling + bytes((0xC2, len(tsap))) + tsap
        talk.packet(0, tpkt(bytes((6 + len(variable), 0xE0, 0, 0, 0, 1, 0)) + variable))
        talk.packet(1, CONFIRM)

    return scene


def lists_blocks(talk: Talk) -> None:
    talk.open()
    answered(talk, 1, 3, 1, b"", b"08\x00\x02")


def subscribes(talk: Talk) -> None:
    talk.open()
    talk.ask(events.asks(1, 4, 2, bytes.fromhex("800000") + b"HmiRtm  \x00"))
    talk.tell(events.tells(1, 4, 2, bytes.fromhex("0200000000000000")))


def loads(talk: Talk) -> None:
    talk.open()
    load(talk)


@pytest.mark.parametrize(
    ("scene", "role", "certainty", "text"),
    [
        (lists_blocks, ENGINEERING, BEHAVIOUR, "asks which blocks there are"),
        (loads, ENGINEERING, BEHAVIOUR, "loads blocks"),
        (subscribes, PANEL, BEHAVIOUR, "subscribes to messages"),
        (called(b"\1\2"), ENGINEERING, TSAP, "TSAP 01.02 (PG)"),
        (called(b"\2\2"), PANEL, TSAP, "TSAP 02.02 (OP)"),
        (called(b"\3\2", b"\2\0"), PANEL, TSAP, "TSAP 02.00 (OP)"),
        (called(b"SIMATIC-ROOT-ES"), ENGINEERING, TSAP, "TSAP SIMATIC-ROOT-ES"),
        (called(b"SIMATIC-ROOT-HMI"), PANEL, TSAP, "TSAP SIMATIC-ROOT-HMI"),
        (called(b"\3\2", b"OPC-1"), OPC, TSAP, "TSAP OPC-1"),
    ],
)
def test_a_client(scene: Callable[[Talk], None], role: str, certainty: str, text: str) -> None:
    devices = {device.address: device for device in inventory_of(scene).devices}
    client = devices["10.0.0.1"]
    assert (client.role, client.certainty) == (role, certainty)
    assert client.reasons[role, text].frame > 0


def test_a_client_of_which_nothing_speaks_for_anything() -> None:
    devices = inventory_of(called(b"\3\2", b"\3\0")).devices
    assert [(device.role, device.certainty, device.reasons) for device in devices] == [("unknown", "", {})] * 2


def polled(talk: Talk) -> None:
    talk.open()
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 5))


def states(content: bytes) -> Callable[[Talk], None]:
    def scene(talk: Talk) -> None:
        talk.open()
        szl(talk, 1, content)

    return scene


@pytest.mark.parametrize(
    ("scene", "certainty", "text", "frame"),
    [
        (polled, BEHAVIOUR, "answers S7comm requests", 7),
        (states(identification("6ES7", (1, 2, 3))), STATED, "states its order number (SZL 0x0011)", 9),
        (states(mode(8)), STATED, "states its operating mode (SZL 0x0424)", 9),
        (states(protection(1)), STATED, "states its protection level (SZL 0x0232)", 9),
    ],
)
def test_a_cpu(scene: Callable[[Talk], None], certainty: str, text: str, frame: int) -> None:
    server = inventory_of(scene).devices[0]
    assert (server.address, server.role, server.certainty) == ("10.0.0.2", CPU, certainty)
    assert server.reasons[CPU, text].frame == frame


def test_the_same_evidence_is_counted() -> None:
    server, client = inventory_of(polled, polled, polled).devices
    assert server.reasons[CPU, "answers S7comm requests"].count == 3
    assert client.reasons[ENGINEERING, "TSAP 01.02 (PG)"].count == 3


@pytest.mark.parametrize(
    ("application", "host", "number", "role"),
    [
        ("TIA Portal", "ES-07", 1, ENGINEERING),
        ("HMI RT OMS+", "PANEL", 2, PANEL),
        ("SIMATIC NET PC Software", "VM", 536870914, OPC),
        ("", ':::"OPC Server_1"::VM/', 536870914, OPC),
        ("something", "X", 0, "unknown"),
    ],
)
def test_a_session_says_who_it_is(application: str, host: str, number: int, role: str) -> None:
    talk = Talk()
    talk.hello()
    talk.connect()
    talk.close()
    connection: Connection = talk.connections[0]
    connection.tsap_called = connection.tsap_calling = Tsap(b"\3\0")
    session = PlusSession(Program(), Identity())
    session.application, session.host, session.role = application, host, number
    connection.plus = session
    client, server = Device("10.0.0.1"), Device("10.0.0.2")
    judge_client(client, server, connection, {"session": 17}, [0, 0])
    assert (client.role, server.role) == (role, "unknown")
    assert all(reason.frame == 17 and reason.certainty == STATED for reason in client.reasons.values())


def test_what_is_stated_counts_more_than_what_is_done_and_that_more_than_a_tsap() -> None:
    device = Device("10.0.0.1")
    for role, certainty, best in (
        (PANEL, TSAP, PANEL),
        (ENGINEERING, TSAP, ENGINEERING),
        (OPC, BEHAVIOUR, OPC),
        (CPU, BEHAVIOUR, CPU),
        (PANEL, STATED, PANEL),
    ):
        device.because(role, certainty, f"{role} {certainty}", 1)
        assert device.role == best
    assert device.certainty == STATED


def test_a_tsap_of_another_protocol_says_no_role_rack_or_slot() -> None:
    def mms(talk: Talk) -> None:
        talk.hello()
        talk.connect()
        talk.packet(CLIENT, dt(bytes.fromhex("0d09050613010016010214020002")))
        talk.close()

    inventory = inventory_of(mms)
    server, client = sorted(inventory.devices, key=lambda device: device.address, reverse=True)
    assert inventory.talks[0].protocols.texts == ["mms"]
    assert (client.tsaps.texts, server.tsaps.texts) == (["01.00"], ["01.02"])
    assert (client.role, server.role) == ("unknown", "unknown")
