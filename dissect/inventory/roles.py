"""What a device is, by what it says, what it does and which TSAP it uses; each piece of evidence with a packet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from dissect.inventory.model import BEHAVIOUR, CPU, ENGINEERING, OPC, PANEL, STATED, TSAP, Device
from dissect.iso.tsap import SIEMENS
from dissect.stations import facts
from dissect.transactions.connection import Connection
from dissect.transactions.operation import CYCLIC, DELETE, DOWNLOAD, MESSAGES, SESSION, TEST_JOB, UPLOAD

#: Facts that only a PLC states, in the order of their weight.
_OF_CPU: Final = (facts.ORDER_NUMBER, facts.OPERATING_MODE, facts.PROTECTION)
_PG: Final = 1
_OP: Final = 2
#: Beside operations: block functions.
LISTS_BLOCKS: Final = "lists_blocks"
#: What engineering stations do, and what panels do.
_ENGINEERING: Final = {
    DOWNLOAD: "loads blocks",
    UPLOAD: "reads blocks out",
    DELETE: "deletes blocks",
    TEST_JOB: "runs test functions",
    LISTS_BLOCKS: "asks which blocks there are",
}
_PANEL: Final = {CYCLIC: "subscribes to values", MESSAGES: "subscribes to messages"}
#: In the text of a TSAP of S7comm-plus or of a configured connection.
_TSAP_TEXTS: Final = (("OPC", OPC), ("ROOT-ES", ENGINEERING), ("ROOT-HMI", PANEL))
#: The application of SIMATIC NET's OPC server in a session of S7comm-plus.
_SIMATIC_NET: Final = "SIMATIC NET"
#: Names of roles in S7comm-plus sessions.
_SESSIONS: Final = {"engineering": ENGINEERING, "HMI": PANEL}


def judge_server(device: Device) -> None:
    """Look at what a device said of itself."""
    for key in _OF_CPU:
        found = device.history(key)
        if found:
            text = f"states its {facts.KEYS[key]} ({found[0].source})"
            device.because(CPU, STATED, text, found[0].first_frame)
            return


def judge_client(
    client: Device,
    server: Device,
    connection: Connection,
    deeds: Mapping[str, int],
    answer_frames: Sequence[int],
) -> None:
    """Look at a connection that is over: what both ends did there. ``deeds`` are kinds of operations, each with a packet."""
    tcp = connection.tcp
    first = int(tcp.first_frame)
    answered = answer_frames[1 - connection.client_side]
    if answered and connection.protocol in {"s7comm", "s7comm_plus"}:
        protocol = "S7comm" if connection.protocol == "s7comm" else "S7comm-plus"
        server.because(CPU, BEHAVIOUR, f"answers {protocol} requests", answered)
    for kind, deed in _ENGINEERING.items():
        if kind in deeds:
            client.because(ENGINEERING, BEHAVIOUR, deed, deeds[kind])
    for kind, deed in _PANEL.items():
        if kind in deeds:
            client.because(PANEL, BEHAVIOUR, deed, deeds[kind])
    session = connection.plus
    if session is not None:
        first = deeds.get(SESSION, first)
        who = session.application or session.session_name
        where = " on ".join([text for text in (who, session.host) if text])
        client.sessions.add(" ".join([text for text in (where, session.user) if text]))
        if who.startswith(_SIMATIC_NET) or "OPC" in f"{who} {session.host}".upper():
            client.because(OPC, STATED, f"its session says {where}", first)
        elif session.role_name in _SESSIONS:
            client.because(_SESSIONS[session.role_name], STATED, f"its session says {session.role_name}", first)
    _judge_tsaps(client, connection)


def _judge_tsaps(client: Device, connection: Connection) -> None:
    frame = int(connection.tcp.first_frame)
    for tsap in (connection.tsap_called, connection.tsap_calling):
        if tsap is None:
            continue
        for mark, role in _TSAP_TEXTS:
            if mark in str(tsap).upper():
                client.because(role, TSAP, f"TSAP {tsap}", frame)
                return
        if tsap.connection_type in {_PG, _OP} and connection.protocol in SIEMENS:
            role = ENGINEERING if tsap.connection_type == _PG else PANEL
            client.because(role, TSAP, f"TSAP {tsap.describe(False)}", frame)
            return
