from __future__ import annotations

import pytest

from dissect.engine.transactions.aside import MAX_ASIDE, MAX_OCTETS, Aside, Held
from dissect.engine.transactions.connection import (
    FOLLOWED,
    FOREIGN,
    ISO,
    LEFT_OUT,
    MAX_EARLY,
    NO_LIMIT,
    PROBING,
    Connection,
    Traits,
)
from dissect.engine.transactions.ending import Ending
from dissect.engine.transactions.operation import Activation, OperationBook
from dissect.engine.transactions.plus_operations import PlusOpen
from dissect.engine.transactions.results import Subscription
from dissect.engine.transactions.transaction import Transaction
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.s7.parameters import Parameters, Setup, UserdataHead, parse_parameters
from dissect.protocols.s7.tables import ACK_DATA, JOB, USERDATA
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


# ---- what is counted and kept ---------------------------------------------------------------------------------------


def test_answers_that_are_missing_are_those_that_nothing_explains() -> None:
    one = connection()
    one.unanswered, one.still_open, one.not_captured = 7, 2, 1
    assert one.missed == 4


def test_an_error_is_counted_and_the_latest_kept() -> None:
    one = connection()
    first, second = Parameters(b"\x04", JOB), Parameters(b"\x05", JOB)
    one._note_error(first, 5, 0x8104)
    one._note_error(second, 6, 0)
    assert (one.errors, one.last_error, one.last_error_ns, one.last_error_code) == (2, second, 6, 0)


def test_requests_that_need_no_answer_are_also_unsolicited() -> None:
    one = connection()
    one.unsolicited = 3
    one._note_one_way()
    assert (one.unsolicited, one.one_way) == (4, 1)


def test_a_grant_is_kept_with_what_was_asked_for() -> None:
    one = connection()
    one.setup_asked = Setup(8, 8, 960)
    granted = Setup(2, 5, 240)
    one._grant(granted, 0)
    assert (one.granted, one.granted_for, one.pdu_length) == (granted, one.setup_asked, 240)


def test_a_connect_request_is_kept_with_its_reference_and_class() -> None:
    one = connection(50000, 50001)
    assert (one.cr_ref, one.cr_class, one.class_, one.tsap_frame) == (0, 0, -1, 0)
    one._note_cr(0, parse_tpdu(bytes.fromhex("11e00000123421c1020100c2020102c0010a")), 4)
    assert (one.cr_ref, one.cr_class, one.tsap_frame) == (0x1234, 2, 4)
    one._note_cc(1, parse_tpdu(bytes.fromhex("11d00001000220c1020100c2020102c0010a")), 5)
    assert (one.class_, one._dt_limit, one.tsap_frame) == (2, 1024, 4)


def test_a_confirm_names_the_tsap_that_the_request_lacked() -> None:
    """The packet with the TSAPs stays the request's, because one of them was there."""
    one = connection(50000, 50001)
    one._note_cr(0, parse_tpdu(bytes.fromhex("0de00000000100c1020100c0010a")), 4)
    assert one.tsap_called is None
    one._note_cc(1, parse_tpdu(CONFIRM[4:]), 5)
    assert ([str(one.tsap_calling), str(one.tsap_called)], one.tsap_frame) == (["01.00", "01.02"], 4)


def test_after_the_end_of_the_transport_connection_each_dt_is_looked_at() -> None:
    one = connection(initiator=0)
    assert one._dt_limit == -1  # it is not set up yet
    assert connection()._dt_limit == NO_LIMIT  # its beginning is not known
    one._note_cc(1, parse_tpdu(CONFIRM[4:]), 5)
    assert one._dt_limit == 1024
    one._note_iso_end("DR: normal", "disconnect", 1, 9, 90)
    assert one._dt_limit == -1
    found = (one.iso_ended, one.iso_ended_how, one.iso_ended_by, one.iso_ended_frame, one.iso_ended_ns)
    assert found == ("DR: normal", "disconnect", 1, 9, 90)


@pytest.mark.parametrize(
    ("port", "other", "known"), [(102, 50000, True), (50000, 102, False), (102, 102, False), (50000, 50001, False)]
)
def test_an_answer_tells_who_is_the_client_by_the_port_it_comes_from(port: int, other: int, known: bool) -> None:
    one = connection(other, port)
    one._note_answer(1, parse_parameters(b"\x04\x01", ACK_DATA))
    assert (one.client_known, one.client_side) == (known, 1 if other == 102 and port != 102 else 0)


@pytest.mark.parametrize(
    ("state", "established", "followed"),
    [
        (PROBING, False, False),
        (ISO, True, True),
        (FOREIGN, False, False),
        (FOLLOWED, False, True),
        (LEFT_OUT, True, False),
    ],
)
def test_what_is_read_and_what_is_established(state: int, established: bool, followed: bool) -> None:
    one = connection()
    one._state = state
    one.pdus = 1
    assert (one.established, one.followed) == (established, followed)


def test_the_roles_of_the_sides() -> None:
    assert [connection().role(side) for side in (0, 1)] == ["client", "server"]
    assert [connection(102, 50000).role(side) for side in (0, 1)] == ["server", "client"]


def test_until_its_end_its_latest_packet_is_that_of_tcp() -> None:
    one = connection()
    one.tcp.last_frame, one.tcp.last_ns = 9, 90
    assert (one.ended, one.last_frame, one.last_ns) == ("open", 9, 90)
    one.ending = Ending(one, [], 9, 95)
    one.tcp.last_frame, one.tcp.last_ns = 12, 120  # a new conversation on the same TCP connection
    assert (one.ended, one.last_frame, one.last_ns) == ("open", 9, 90)
    one.tcp.ended = "fin"
    one.ending = Ending(one, [], 12, 125)
    assert (one.ended, one.last_frame, one.last_ns) == ("fin", 12, 120)


def test_whether_an_operation_is_under_way() -> None:
    one = connection()
    assert not one.has_open_operations
    going = one.operations
    assert one.operations is going
    assert not one.has_open_operations
    transaction = Transaction(1, one, 0, JOB, 1, Parameters(b"\x04", JOB))
    going.halves.append(transaction)
    assert one.has_open_operations
    going.halves.clear()
    operation = OperationBook().begin("upload", "x", transaction, "DB 1")
    assert one.has_open_operations
    going.these.remove(operation)
    assert not one.has_open_operations
    going.plus = PlusOpen(1)
    assert not one.has_open_operations
    going.plus.objects[1] = operation
    assert one.has_open_operations


def test_what_was_used_is_forgotten_once_it_is_reported() -> None:
    one = connection()
    one.subscriptions[1] = Subscription(UserdataHead(1, 2, 1, 0), b"")
    assert one.subscribes
    one.open_requests[0].count = 1
    one.traits.loaded["DB 1"] = Activation("DB 1", [1, 2], 3)
    assert one.has_loaded
    one._let_go()
    assert (one.subscribes, one.has_loaded, one.has_open_operations) == (False, False, False)
    assert [requests.count for requests in one.open_requests] == [0, 0]


# ---- traits ---------------------------------------------------------------------------------------------------------


def test_an_empty_dt_acknowledges_the_request_that_it_follows() -> None:
    traits = Traits()
    assert traits.early_ack(1, 0, 99) is None
    for side, frame in ((1, 5), (0, 7), (1, 8)):
        traits.note_early(side, frame, frame * 10)
    for side, since, until, expected in (
        (1, 4, 9, 5), (1, 5, 9, 8), (1, 4, 5, 0), (1, 4, 6, 5), (1, 7, 8, 0), (0, 4, 9, 7), (1, 8, 99, 0), (0, 7, 9, 0),
    ):  # fmt: skip
        found = traits.early_ack(side, since, until)
        assert (found.frame if found is not None else 0) == expected
        assert found is None or (found.side, found.time_ns) == (side, 10 * expected)


def test_the_latest_empty_dts_are_kept() -> None:
    traits = Traits()
    for frame in range(1, MAX_EARLY + 3):
        traits.note_early(1, frame, frame)
    oldest = traits.early_ack(1, 0, 99)
    assert oldest is not None
    assert oldest.frame == 3
    assert traits.early_ack(1, MAX_EARLY + 1, 99) is not None


def test_an_empty_dt_of_the_answering_side_between_request_and_answer() -> None:
    one = connection()
    transaction = Transaction(1, one, 0, JOB, 1, Parameters(b"\x04", JOB))
    transaction.request_frame, transaction.response_frame = 5, 8
    assert one.early_ack(transaction) is None
    one.traits.note_early(1, 6, 60)
    found = one.early_ack(transaction)
    assert found is not None
    assert found.frame == 6
    transaction.asked_by = 1
    assert one.early_ack(transaction) is None


def test_a_rule_speaks_once_for_a_connection() -> None:
    traits = Traits()
    assert [traits.first("a"), traits.first("b"), traits.first("a"), traits.first("b")] == [True, True, False, False]
    assert traits.told == {"a", "b"}
    traits.szl_ids.add(0x11)
    assert traits.szl_ids == {0x11}
    assert not traits.has_loaded
    assert traits.loaded == {}
    assert not traits.has_loaded


def test_writes_are_counted_with_the_first_and_the_last_of_them() -> None:
    one = connection()
    assert (one._counted_writes, one._hasty_writes) == (None, None)
    traits = one.traits
    assert (one._counted_writes, one._hasty_writes, traits.hasty, traits.counted) == (None, None, None, None)
    writes = traits.writes
    assert (one._counted_writes, one._hasty_writes) == (None, None)
    for frame in (4, 6, 9):
        writes.note(frame, frame * 10)
    assert one._counted_writes is traits.counted is traits.writes is writes
    found = (writes.again, writes.first_frame, writes.first_ns, writes.last_frame, writes.last_ns, writes.count)
    assert found == (3, 4, 40, 9, 90, 0)
    assert one._hasty_writes is None
    writes.hasty = Transaction(1, one, 0, JOB, 1, Parameters(b"\x05", JOB))
    assert one._hasty_writes is traits.hasty is writes


def test_only_what_waits_is_aside() -> None:
    one = connection()
    assert one._aside is None
    one.traits.aside = Aside()
    assert one._aside is None
    transaction = Transaction(1, one, 0, JOB, 1, Parameters(b"\x04", JOB))
    transaction.request_size, transaction.response_size = 30, 12
    aside = one.traits.aside
    assert aside.add(Held(transaction, None, 1)) == []
    assert one._aside is aside
    assert (aside.octets, aside.answers()) == (42, [])
    aside.add(Held(transaction, transaction, 1))
    assert (aside.octets, aside.answers()) == (84, [transaction])


@pytest.mark.parametrize(
    ("sizes", "gone"),
    [
        ([1] * MAX_ASIDE, []),
        ([1] * (MAX_ASIDE + 1), [0]),
        ([MAX_OCTETS], []),
        ([MAX_OCTETS, 1], [0]),
        ([1, MAX_OCTETS], [0]),
        ([2, 2, MAX_OCTETS - 3], [0]),
        ([2, 2, MAX_OCTETS - 1], [0, 1]),
        ([1, MAX_OCTETS + 1], [0, 1]),
    ],
)
def test_the_oldest_of_what_waits_aside_gives_way(sizes: list[int], gone: list[int]) -> None:
    """Where there are too many, or they are too large; one that is too large itself is not kept either."""
    one = connection()
    aside = Aside()
    left: list[int] = []
    for number, size in enumerate(sizes):
        transaction = Transaction(number, one, 0, JOB, 1, Parameters(b"\x04", JOB))
        transaction.response_size = size
        left += [int(held.transaction.number) for held in aside.add(Held(transaction, None, 1))]
    assert left == gone
    assert [int(held.transaction.number) for held in aside.held] == [n for n in range(len(sizes)) if n not in gone]


def test_nothing_is_counted_or_known_at_first() -> None:
    """Numbers of packets are 0 for none, sides and classes -1; what was not negotiated is None."""
    one = connection()
    numbers = [
        "pdus",
        "behind",
        "answered",
        "unanswered",
        "still_open",
        "not_captured",
        "orphans",
        "unsolicited",
        "one_way",
        "system_events",
        "errors",
        "open_at_end",
        "tsap_frame",
        "iso_ended_frame",
        "iso_ended_ns",
        "last_request_ns",
        "last_answer_ns",
        "last_encrypted_ns",
        "last_error_ns",
        "cr_ref",
        "cr_class",
        "tpdu_size_asked",
        "tpdu_size",
        "pdu_length",
        "last_error_code",
        "missed",
        "_told",
        "_probed",
        "_probed_frame",
        "_probed_ns",
    ]
    assert {name: getattr(one, name) for name in numbers} == dict.fromkeys(numbers, 0)
    assert (one.class_, one.iso_ended_by, one._bound) == (-1, -1, -1)
    flags = (one.udp, one.cr_seen, one.setup_seen, one.setup_open, one.subscribes, one.has_loaded, one.followed)
    assert flags == (False,) * 7
    texts = (one.protocol, one.identified_by, one.refused, one.iso_ended, one.iso_ended_how, one.closed_reason)
    assert texts == ("",) * 6
    unknown = (
        one.setup_asked,
        one.granted,
        one.granted_for,
        one.last_request,
        one.last_answer,
        one.last_error,
        one.ending,
    )
    assert unknown == (None,) * 7
    assert (one.naming, one.plus, one.tls, one.tsap_calling, one.tsap_called) == (None,) * 5
    traits = one.traits
    found = (traits.written, traits.sent, traits.pace_ns, traits.inquiries, traits.refusals, traits.stop_event)
    assert found == (0, 0, 0, 0, 0, None)


def test_a_connection_without_jobs_subscribes_to_nothing() -> None:
    one = connection()
    assert (one.subscriptions, one.subscribes) == ({}, False)
