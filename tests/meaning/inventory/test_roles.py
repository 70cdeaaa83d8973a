"""What makes a device a CPU, an engineering station, a panel or an OPC server: one case for each rule, and how they weigh."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import pytest

from dissect.engine.stations import facts
from dissect.engine.stations.facts import Fact
from dissect.engine.transactions.connection import Connection
from dissect.meaning.inventory.model import BEHAVIOUR, CPU, ENGINEERING, OPC, PANEL, SERVER, STATED, TSAP, Device
from dissect.meaning.inventory.roles import Deeds, judge_client, judge_server
from dissect.protocols.iso.tsap import Tsap
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import Identity, PlusSession
from tests.engine.findings import events
from tests.engine.findings.operation_scenarios import load
from tests.engine.stations.answers import answered, identification, mode, protection, szl
from tests.engine.transactions.talk import CLIENT, Talk, ack_data, dbw, dt, read, tpkt, words
from tests.meaning.inventory.support import inventory_of

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


def subscribes(mask: int, user: bytes = b"HmiRtm  ", error: int = 0) -> Callable[[Talk], None]:
    """A client subscribes to the events of a mask, and is refused when there is an ``error``."""

    def scene(talk: Talk) -> None:
        talk.open()
        talk.ask(events.asks(1, 4, 2, bytes((mask, 0)) + user + bytes(mask >> 7)))
        talk.tell(events.tells(1, 4, 2, bytes.fromhex("0200000000000000"), code=error))

    return scene


def reads_list(szl_id: int) -> Callable[[Talk], None]:
    """A client reads a partial list, which is refused."""

    def scene(talk: Talk) -> None:
        talk.open()
        talk.ask(events.asks(1, 4, 1, szl_id.to_bytes(2, "big") + b"\0\0"))
        talk.tell(events.tells(1, 4, 1, b"", code=0xD401))

    return scene


def stops(talk: Talk) -> None:
    talk.open()
    talk.ask(events.stop(1))
    talk.tell(events.answered(1, 0x29))


def is_not_let(request: bytes) -> Callable[[Talk], None]:
    """A client sends a job, which the PLC does not permit at its protection level."""

    def scene(talk: Talk) -> None:
        talk.open()
        talk.ask(request)
        talk.tell(ack_data(1, b"", b"", 0xD241))

    return scene


def is_not_answered(request: bytes) -> Callable[[Talk], None]:
    """A client sends a job, and closes the connection without an answer."""

    def scene(talk: Talk) -> None:
        talk.open()
        talk.ask(request)
        talk.close()

    return scene


def looks_at_a_block(talk: Talk) -> None:
    talk.open()
    answered(talk, 1, 3, 3, b"0800001A", b"")


def loads(talk: Talk) -> None:
    talk.open()
    load(talk)


@pytest.mark.parametrize(
    ("scene", "role", "certainty", "text"),
    [
        (lists_blocks, ENGINEERING, BEHAVIOUR, "asks which blocks there are"),
        (loads, ENGINEERING, BEHAVIOUR, "loads blocks"),
        (looks_at_a_block, ENGINEERING, BEHAVIOUR, "asks what is known of a block"),
        (stops, ENGINEERING, BEHAVIOUR, "stops, starts or resets the PLC"),
        (is_not_let(events.stop(1)), ENGINEERING, BEHAVIOUR, "tried to stop, start or reset the PLC"),
        (is_not_let(events.start_upload(1)), ENGINEERING, BEHAVIOUR, "tried to read blocks out"),
        (is_not_answered(events.stop(1)), ENGINEERING, BEHAVIOUR, "tried to stop, start or reset the PLC"),
        (is_not_answered(events.start_upload(1)), ENGINEERING, BEHAVIOUR, "tried to read blocks out"),
        (is_not_answered(events.request_download(1)), ENGINEERING, BEHAVIOUR, "tried to load blocks"),
        (reads_list(0x00A0), ENGINEERING, BEHAVIOUR, "reads the diagnostic buffer"),
        (reads_list(0x01A0), ENGINEERING, BEHAVIOUR, "reads the diagnostic buffer"),
        (subscribes(0x03, b"asmess  "), ENGINEERING, BEHAVIOUR, "subscribes to diagnostics, not to alarms"),
        (subscribes(0x80), PANEL, BEHAVIOUR, "is subscribed to alarms"),
        (subscribes(0x80, error=0x8104), PANEL, BEHAVIOUR, "tried to subscribe to alarms"),
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
        (states(identification("6ES7", (1, 2, 3))), STATED, "states its order number (SZL 0x0011)", 9),
        (states(mode(8)), STATED, "states its operating mode (SZL 0x0424)", 9),
        (states(protection(1)), STATED, "states its protection level (SZL 0x0232)", 9),
    ],
)
def test_a_cpu(scene: Callable[[Talk], None], certainty: str, text: str, frame: int) -> None:
    server = inventory_of(scene).devices[0]
    assert (server.address, server.role, server.certainty) == ("10.0.0.2", CPU, certainty)
    assert server.reasons[CPU, text].frame == frame


@pytest.mark.parametrize("answers", [1, 3])
def test_who_only_answers_is_a_server_of_unknown_kind(answers: int) -> None:
    server = inventory_of(*[polled] * answers).devices[0]
    assert (server.address, server.role, server.certainty) == ("10.0.0.2", SERVER, BEHAVIOUR)
    assert server.reasons[SERVER, "answers S7comm requests"].frame == 7


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (identification("6AV2124-0GC01-0AX0", (1, 2, 3)), "states the order number of a panel (SZL 0x0011)"),
        (identification("6AV6643", (1, 2, 3)), "states the order number of a panel (SZL 0x0011)"),
    ],
)
def test_an_order_number_makes_a_panel(content: bytes, text: str) -> None:
    server = inventory_of(states(content)).devices[-1]
    assert (server.address, server.role, server.certainty) == ("10.0.0.2", PANEL, STATED)
    assert server.reasons[PANEL, text].frame == 9


@pytest.mark.parametrize("name", ["HMI_RT_1", "WinCC RT Advanced", "Pump 3 (SIMATIC HMI)"])
def test_a_name_of_its_project_makes_a_panel(name: str) -> None:
    device = Device("10.0.0.2")
    device.station.note(Fact("10.0.0.2", "", facts.MODULE_NAME, name, "SZL 0x001c", 1, [9], 5))
    judge_server(device)
    assert (device.role, device.certainty) == (PANEL, STATED)
    other = Device("10.0.0.3")
    other.station.note(Fact("10.0.0.3", "", facts.MODULE_NAME, "CPU 315-2 PN/DP", "SZL 0x001c", 1, [9], 5))
    judge_server(other)
    assert other.role == "unknown"


def plus(tsap: bytes, answered: int) -> tuple[Device, Device]:
    """A client opens a session at a TSAP; the server answers with a role of its own (-1: none)."""
    talk = Talk()
    talk.hello()
    talk.connect()
    talk.close()
    connection: Connection = talk.connections[0]
    connection.protocol = "s7comm_plus"
    connection.tsap_called = connection.tsap_calling = Tsap(tsap)
    identity = Identity()
    identity.role = answered
    session = connection.plus = PlusSession(Program(), identity)
    session.application, session.role = "WinCC ES", 1
    client, server = Device("10.0.0.1"), Device("10.0.0.2")
    judge_client(client, server, connection, Deeds(), [0, 8] if not connection.client_side else [8, 0])
    return client, server


@pytest.mark.parametrize(
    ("tsap", "answered", "role"),
    [
        (b"WINCCRT-SCS-ES", -1, PANEL),
        (b"WinCCRT-SCS-X", 0x20000000, PANEL),
        (b"SIMATIC-ROOT-ES", 2, PANEL),
        (b"SIMATIC-ROOT-ES", 0x20000002, SERVER),
        (b"SIMATIC-ROOT-ES", 1, SERVER),
        (b"SIMATIC-ROOT-ES", -1, SERVER),
    ],
)
def test_a_panel_states_what_it_is_in_its_sessions(tsap: bytes, answered: int, role: str) -> None:
    client, server = plus(tsap, answered)
    assert (client.role, client.certainty, server.role) == (ENGINEERING, STATED, role)
    assert server.reasons[SERVER, "answers S7comm-plus requests"].frame == 8


def test_operations_and_devices_give_one_client_one_name() -> None:
    for number, application, role in ((1, "TIA Portal", ENGINEERING), (2, "HMI RT", PANEL), (2, "SIMATIC NET PC", OPC)):
        session = PlusSession(Program(), Identity())
        session.application, session.role = application, number
        assert (session.client_kind, session.describe()) == (role, f"{application} ({role})")


def test_what_all_sorts_of_clients_do_says_no_role() -> None:
    for scene in (subscribes(0x01), reads_list(0x0424)):
        assert {reason.certainty for reason in inventory_of(scene).devices[1].reasons.values()} == {TSAP}


def test_a_panel_that_looks_at_diagnostics_stays_a_panel() -> None:
    server, client = inventory_of(subscribes(0x81), reads_list(0x00A0), subscribes(0x02)).devices
    assert (client.role, client.certainty) == (PANEL, BEHAVIOUR)
    assert {reason.text for reason in client.reasons.values() if reason.role == ENGINEERING} == {
        "reads the diagnostic buffer",
        "subscribes to diagnostics, not to alarms",
        "TSAP 01.02 (PG)",
    }
    assert server.role == SERVER


def test_a_tsap_is_shown_by_the_packet_that_holds_it() -> None:
    _, client = inventory_of(polled).devices
    assert client.reasons[ENGINEERING, "TSAP 01.02 (PG)"].frame == 4  # behind the three packets of the TCP handshake


def test_the_same_evidence_is_counted() -> None:
    server, client = inventory_of(polled, polled, polled).devices
    assert server.reasons[SERVER, "answers S7comm requests"].count == 3
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
    deeds = Deeds()
    deeds.done["session"] = 17
    judge_client(client, server, connection, deeds, [0, 0])
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
        device._because(role, certainty, f"{role} {certainty}", 1)
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
