"""Finds the role of a device from its statements, its actions, and its TSAP; each reason comes with a packet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from dissect.engine.acts.act import Act
from dissect.engine.acts.tables import DEEDS, UNANSWERED
from dissect.engine.acts.tables import REFUSED as ACT_REFUSED
from dissect.engine.stations import facts
from dissect.engine.stations.evidence import asked_payload
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import (
    CYCLIC,
    MESSAGES,
    REFUSED,
    SESSION,
    UNFINISHED,
    Operation,
)
from dissect.engine.transactions.transaction import ANSWERED, Transaction
from dissect.meaning.inventory.model import BEHAVIOUR, CPU, ENGINEERING, OPC, PANEL, SERVER, STATED, TSAP, Device
from dissect.protocols.iso.tsap import SIEMENS
from dissect.protocols.s7.alarm_layouts import MESSAGE_REQUEST
from dissect.protocols.s7.tables import BLOCK_INFO, GROUP_BLOCKS, GROUP_CPU, MESSAGE_SERVICE, READ_SZL
from dissect.protocols.s7plus.session import PANEL_ORDER_NUMBERS

#: Facts that only a PLC states, the most important first.
_OF_CPU: Final = (facts.ORDER_NUMBER, facts.OPERATING_MODE, facts.PROTECTION)
_PG: Final = 1
_OP: Final = 2
#: Actions of panels, as text, and the text for actions that the PLC refused. A notification shows a subscription as well as a
#: request does.
_PANEL: Final = {
    CYCLIC: ("is subscribed to values", "tried to subscribe to values"),
    MESSAGES: ("is subscribed to alarms", "tried to subscribe to alarms"),
}
_LISTS_BLOCKS: Final = "asks which blocks there are"
_BLOCK_INFO: Final = "asks what is known of a block"
#: Actions that some panels perform rarely, to show diagnostics.
_DIAGNOSTICS: Final = "subscribes to diagnostics, not to alarms"
_BUFFER: Final = "reads the diagnostic buffer"
#: The partial list of the diagnostic buffer and its extracts.
_BUFFER_LIST: Final = 0xA0
#: Parts of TSAP texts, in S7comm-plus or in configured connections.
_TSAP_TEXTS: Final = (("OPC", OPC), ("ROOT-ES", ENGINEERING), ("SCS-ES", ENGINEERING), ("ROOT-HMI", PANEL))
#: Names given by a project, and parts of them that only panels have: TIA Portal names the runtime of a panel HMI_RT_1.
_NAMES: Final = (facts.MODULE_TYPE, facts.STATION_NAME, facts.MODULE_NAME)
_PANEL_NAMES: Final = ("HMI_RT", "WINCC", "SIMATIC HMI", "SIMATIC PANEL")


class Deeds:
    """Actions of the client of a connection that show its role, each with the first packet that shows it.

    ``done`` are kinds of operations that the server did not refuse, ``tried`` those that it refused or did not answer; both
    include acts, too. ``texts`` describe actions that are neither an act nor an operation. ``hints`` are weak signs, which
    other devices occasionally show as well.
    """

    __slots__ = ("done", "hints", "texts", "tried")

    def __init__(self) -> None:
        self.done: dict[str, int] = {}
        self.tried: dict[str, int] = {}
        self.texts: dict[str, int] = {}
        self.hints: dict[str, int] = {}

    def does(self, operation: Operation, frame: int) -> None:
        """Note an operation, which packet ``frame`` shows."""
        kind = operation.kind
        if kind == MESSAGES and operation.connection.plus is None:
            return  # its events are judged from its request
        (self.tried if operation.result in {REFUSED, UNFINISHED} else self.done).setdefault(kind, frame)

    def did(self, act: Act) -> None:
        """Note what an act shows (`dissect.engine.acts.tables`)."""
        deed = act.row.deed
        if deed:
            (self.tried if act.outcome in {ACT_REFUSED, UNANSWERED} else self.done).setdefault(deed, act.shown)

    def asks(self, transaction: Transaction) -> None:
        """Note a userdata request."""
        head = transaction.parameters.userdata
        frame = int(transaction.request_frame)
        if head is None or not frame:
            return
        if head.group == GROUP_BLOCKS:
            self.texts.setdefault(_BLOCK_INFO if head.subfunction == BLOCK_INFO else _LISTS_BLOCKS, frame)
        elif head.group != GROUP_CPU:
            return
        elif head.subfunction == READ_SZL:
            if _BUFFER not in self.hints and asked_payload(transaction)[1:2] == bytes((_BUFFER_LIST,)):
                self.hints[_BUFFER] = frame
        elif head.subfunction == MESSAGE_SERVICE:
            self._subscribes(transaction, frame)

    def _subscribes(self, transaction: Transaction, frame: int) -> None:
        """Note a subscription to events.

        A subscription to mode transitions is ignored, because clients of all kinds have one.
        """
        body = transaction.request_body
        asked = body.find(MESSAGE_REQUEST) if body is not None else None
        if asked is None:
            return
        if asked.number("alarms") > 0:
            refused = transaction._outcome != ANSWERED or transaction.refused
            (self.tried if refused else self.done).setdefault(MESSAGES, frame)
        elif asked.number("system_diagnostics") > 0 or asked.number("user_diagnostics") > 0:
            self.hints.setdefault(_DIAGNOSTICS, frame)


def judge_server(device: Device) -> None:
    """Add reasons from a device's statements about itself.

    Panels answer some of the requests that CPUs answer, but state that they are panels.
    """
    for stretch in device.history(facts.ORDER_NUMBER):
        if stretch.value.startswith(PANEL_ORDER_NUMBERS):
            text = f"states the order number of a panel ({stretch.source})"
            device._because(PANEL, STATED, text, stretch.first_frame)
            return
    for key in _NAMES:
        for stretch in device.history(key):
            if any([mark in stretch.value.upper() for mark in _PANEL_NAMES]):
                text = f"states the {facts.KEYS[key]} of a panel ({stretch.source})"
                device._because(PANEL, STATED, text, stretch.first_frame)
                return
    for key in _OF_CPU:
        found = device.history(key)
        if found:
            text = f"states its {facts.KEYS[key]} ({found[0].source})"
            device._because(CPU, STATED, text, found[0].first_frame)
            return


def judge_client(
    client: Device,
    server: Device,
    connection: Connection,
    deeds: Deeds,
    answer_frames: Sequence[int],
) -> None:
    """Add reasons from the actions of both ends of a closed connection."""
    answered = answer_frames[1 - connection.client_side]
    if answered and connection.protocol in {"s7comm", "s7comm_plus"}:
        protocol = "S7comm" if connection.protocol == "s7comm" else "S7comm-plus"
        server._because(SERVER, BEHAVIOUR, f"answers {protocol} requests", answered)
    for deed, tried in DEEDS.items():
        _judge_deed(client, ENGINEERING, deeds, deed, deed, tried)
    for kind, (done, tried) in _PANEL.items():
        _judge_deed(client, PANEL, deeds, kind, done, tried)
    for text, frame in deeds.texts.items():
        client._because(ENGINEERING, BEHAVIOUR, text, frame)
    for text, frame in deeds.hints.items():
        client._because(ENGINEERING, BEHAVIOUR, text, frame, True)
    session = connection.plus
    if session is not None:
        first = deeds.done.get(SESSION, deeds.tried.get(SESSION, int(connection.tcp.first_frame)))
        client.sessions.add(session.who)
        kind = session.client_kind
        if kind == OPC:
            who = " on ".join([text for text in (session.application or session.session_name, session.host) if text])
            client._because(OPC, STATED, f"its session says {who}", first)
        elif kind:
            client._because(kind, STATED, f"its session says {session.role_name}", first)
        if answered and session.identity.kind == PANEL:
            server._because(PANEL, STATED, "states in its sessions that it is a panel", answered)
    _judge_tsaps(client, connection)
    called = connection.tsap_called
    if answered and called is not None and called.of_panel:
        server._because(PANEL, STATED, f"answers at TSAP {called}, that of a panel's runtime", answered)


def _judge_deed(client: Device, role: str, deeds: Deeds, key: str, done: str, tried: str) -> None:
    """Add an action of a client as a reason for its role; a mere attempt is a weaker reason."""
    if key in deeds.done:
        client._because(role, BEHAVIOUR, done, deeds.done[key])
    elif key in deeds.tried:
        client._because(role, BEHAVIOUR, tried, deeds.tried[key], True)


def _judge_tsaps(client: Device, connection: Connection) -> None:
    frame = int(connection.tsap_frame)
    for tsap in (connection.tsap_called, connection.tsap_calling):
        if tsap is None:
            continue
        for mark, role in _TSAP_TEXTS:
            if mark in str(tsap).upper():
                client._because(role, TSAP, f"TSAP {tsap}", frame)
                return
        if tsap.connection_type in {_PG, _OP} and connection.protocol in SIEMENS:
            role = ENGINEERING if tsap.connection_type == _PG else PANEL
            client._because(role, TSAP, f"TSAP {tsap.describe(False)}", frame)
            return
