from __future__ import annotations

import pytest

from dissect.engine.transactions.connection import ISO, Connection
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.s7.parameters import Setup, parse_parameters
from dissect.protocols.s7.tables import JOB, USERDATA
from tests.engine.transactions.talk import CONFIRM, CONNECT, head


def connection(port0: int = 50000, port1: int = 102, initiator: int = -1) -> Connection:
    tcp = TcpConnection(Endpoint(b"\x0a\0\0\1", port0), Endpoint(b"\x0a\0\0\2", port1), 0, 1, 0)
    tcp.initiator = initiator
    return Connection(1, tcp)


@pytest.mark.parametrize(
    ("port0", "port1", "initiator", "client", "known"),
    [
        (50000, 102, -1, 0, False),
        (102, 50000, -1, 1, False),
        (102, 102, -1, 0, False),
        (50000, 50001, -1, 0, False),
        (50000, 102, 0, 0, True),
        (50000, 102, 1, 1, True),
        (102, 50000, 0, 0, True),
    ],
)
def test_who_is_the_client(port0: int, port1: int, initiator: int, client: int, known: bool) -> None:
    one = connection(port0, port1, initiator)
    assert (one.client_side, one.client_known, one.mid_stream) == (client, known, not known)
    assert (one.client, one.server) == (one.tcp.ends[client], one.tcp.ends[1 - client])


def test_it_says_who_asks_whom_as_far_as_that_is_known() -> None:
    assert repr(connection(initiator=0)) == "Connection(1, 10.0.0.1:50000 → 10.0.0.2:102, 0 PDUs)"
    assert repr(connection()) == "Connection(1, 10.0.0.1:50000 ↔ 10.0.0.2:102, 0 PDUs)"


def test_the_first_evidence_counts() -> None:
    one = connection()
    one._set_client(1)
    one._set_client(0)
    assert one.client_side == 1


def test_what_is_unknown_stays_unknown() -> None:
    one = connection()
    assert (one.tsap_calling, one.tsap_called, one.tpdu_size, one.pdu_length) == (None, None, 0, 0)
    assert (one.granted, one.jobs_allowed(0), one.jobs_allowed(1), one.established) == (None, 0, 0, False)


def test_a_handshake_names_the_sides_and_the_size() -> None:
    one = connection(50000, 50001)
    one._note_cr(1, parse_tpdu(CONNECT[4:]), 4)
    assert (one.cr_seen, one.client_side, one.client_known, one.tpdu_size_asked, one.tpdu_size) == (
        True,
        1,
        True,
        1024,
        0,
    )
    one._note_cc(0, parse_tpdu(CONFIRM[4:]), 5)
    assert one.tpdu_size == 1024
    assert [str(one.tsap_calling), str(one.tsap_called)] == ["01.00", "01.02"]
    assert one.tsap_frame == 4


def test_what_the_request_said_is_not_changed_by_the_confirm() -> None:
    one = connection(50000, 50001)
    one._note_cr(0, parse_tpdu(CONNECT[4:]), 4)
    one._note_cc(1, parse_tpdu(bytes.fromhex("11d00001000200c1020301c2020302c0010a")), 5)
    assert [str(one.tsap_calling), str(one.tsap_called)] == ["01.00", "01.02"]


def test_a_confirm_alone_tells_as_much() -> None:
    one = connection(50000, 50001)
    one._note_cc(0, parse_tpdu(CONFIRM[4:]), 5)
    assert (one.client_side, one.client_known, one.cr_seen, one.tsap_frame) == (1, True, False, 5)
    assert [str(one.tsap_calling), str(one.tsap_called)] == ["01.00", "01.02"]


def test_a_confirm_without_a_size_means_the_largest() -> None:
    one = connection()
    one._note_cc(1, parse_tpdu(bytes.fromhex("06d00001000200")), 5)
    assert one.tpdu_size == 65531


def test_established() -> None:
    one = connection()
    one.pdus = 1
    assert not one.established
    one._state = ISO
    assert one.established
    one.pdus = 0
    assert not one.established
    one.tpdu_size = 1024
    assert one.established


@pytest.mark.parametrize("asked_by", [0, 1])
def test_jobs_allowed_by_who_sent_the_setup(asked_by: int) -> None:
    one = connection()
    one._grant(Setup(2, 5, 240), asked_by)
    assert one.pdu_length == 240
    assert (one.jobs_allowed(asked_by), one.jobs_allowed(1 - asked_by)) == (5, 2)


@pytest.mark.parametrize(
    ("function", "client"),
    [(code, 1) for code in (0x04, 0x05, 0x1A, 0x1D, 0x1E, 0x1F, 0x28, 0x29, 0xF0)]
    + [(0x1B, 0), (0x1C, 0), (0x00, -1), (0x77, -1)],
)
def test_a_job_tells_who_is_the_client(function: int, client: int) -> None:
    one = connection(50000, 50001)
    one._note_request(1, parse_parameters(bytes((function, 0)), JOB))
    assert (one.client_known, one.client_side) == (client >= 0, max(client, 0))


@pytest.mark.parametrize(("group", "known"), [(1, True), (4, True), (6, False), (7, True)])
def test_userdata_tells_who_is_the_client_except_bsend(group: int, known: bool) -> None:
    one = connection(50000, 50001)
    one._note_request(1, parse_parameters(head(1, group, 1), USERDATA))
    assert one.client_known is known
