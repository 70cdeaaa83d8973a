"""S7comm-plus from TSDUs to transactions."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

import dissect
from dissect.protocols.s7plus.assembly import MAX_PDU
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.objects import PlusObject
from dissect.protocols.s7plus.tables import SET_VAR_SUBSTREAMED
from dissect.protocols.s7plus.value_tables import INT, UDINT
from dissect.protocols.s7plus.values import Value, build_value
from tests.engine.transactions.talk import ACK, CLIENT, FIN, MS, RST, SECOND, SERVER, Talk, dt, read, words
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import end, get_stream, number
from tests.protocols.s7plus.pdus import (
    CREATE_OBJECT,
    ERROR,
    GET_MULTI,
    INIT_SSL,
    KEEP_ALIVE,
    SET_VARIABLE,
    asked,
    event,
    framed,
    notified,
    told,
)

HELLO = bytes.fromhex("1603010005010000010a")


def begun() -> Talk:
    talk = Talk()
    talk.hello()
    talk.connect()
    return talk


def slugs(talk: Talk) -> list[str]:
    """Give the slugs of what was found, but for contents that do not fit: most PDUs here are nothing but a head."""
    return [slug for slug in talk.slugs() if slug != "s7plus.malformed"]


def facts(talk: Talk) -> list[tuple[str, str, int]]:
    return [(one.outcome, one.function_name, one.pdu_ref) for one in talk.transactions]


@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_request_and_its_response(version: int) -> None:
    talk = begun()
    request = talk.ask(framed(asked(5, body=b"what"), version))
    answer = talk.tell(framed(told(5), version), after_ns=7 * MS)
    talk.close()
    assert facts(talk) == [("answered", "S7comm-plus GetMultiVariables", 5)]
    assert talk.pairs() == [(request, answer)]
    assert slugs(talk) == []
    (transaction,) = talk.transactions
    assert transaction.is_plus
    assert (transaction.function, transaction.latency_ns, transaction.errors) == (GET_MULTI, 7 * MS, [])
    assert (transaction.request, transaction.response, transaction.s7_results) == (None, None, [])
    assert transaction.plus_request is not None
    assert (transaction.plus_request.session_id, transaction.plus_request.body) == (0x386, b"what")
    assert transaction.plus_response is not None
    assert transaction.plus_response.return_value == 0
    (connection,) = talk.connections
    assert (connection.protocol, connection.pdus, connection.answered) == ("s7comm_plus", 2, 1)


def test_responses_in_another_order() -> None:
    talk = begun()
    talk.ask(framed(asked(1)), framed(asked(2, CREATE_OBJECT)), framed(asked(3)))
    talk.tell(framed(told(3)), framed(told(2, CREATE_OBJECT)), framed(told(1)))
    talk.close()
    assert [entry[2] for entry in facts(talk)] == [3, 2, 1]
    assert set(talk.outcomes()) == {"answered"}


def test_what_has_no_other_half() -> None:
    talk = begun()
    talk.ask(framed(asked(1)))
    talk.tell(framed(told(9)))
    talk.wait(2_000 * MS)
    talk.ask(framed(asked(2)))
    talk.tell(framed(told(2)))
    talk.close()
    assert Counter(talk.outcomes()) == {"unanswered": 1, "orphan_answer": 1, "answered": 1}
    assert sorted(slugs(talk)) == ["transaction.orphan", "transaction.unanswered"]
    orphan = next(one for one in talk.transactions if one.outcome == "orphan_answer")
    assert (orphan.is_plus, orphan.pdu_ref, orphan.function) == (True, 9, GET_MULTI)


def test_requests_that_want_no_response_and_notifications() -> None:
    talk = begun()
    credit = bodies.set_variable(0x70000E51, [1053], Value(0, INT, 5))
    one_way = talk.ask(framed(asked(1, SET_VARIABLE, flags=0x74, body=credit), 3))
    push = talk.tell(framed(notified(), 3))
    late = talk.tell(framed(told(1, SET_VARIABLE, opcode=2), 3))
    talk.close()
    assert talk.pairs() == [(one_way, 0), (0, push), (0, late)]
    assert talk.outcomes() == ["unsolicited"] * 3
    assert [one.function for one in talk.transactions] == [SET_VARIABLE, -1, SET_VARIABLE]
    assert [one.asked_by for one in talk.transactions] == [CLIENT] * 3
    assert slugs(talk) == []
    assert (talk.connections[0].unsolicited, talk.connections[0].one_way) == (3, 1)


@pytest.mark.parametrize("version", [1, 2])
def test_before_version_3_a_request_that_wants_no_response_gets_one(version: int) -> None:
    talk = begun()
    first = talk.ask(framed(asked(1, SET_VARIABLE, flags=0x74), version))
    talk.wait(10 * MS)
    answer = talk.tell(framed(told(1, SET_VARIABLE, opcode=2), version))
    last = talk.ask(framed(asked(2, SET_VARIABLE, flags=0x74), version))
    talk.close()
    assert talk.pairs() == [(first, answer), (last, 0)]
    assert talk.outcomes() == ["answered", "unsolicited"]  # the last got none, and nobody waits for it
    assert slugs(talk) == []
    (connection,) = talk.connections
    assert (connection.answered, connection.unanswered, connection.one_way, connection.open_at_end) == (1, 0, 1, 0)


def test_a_response_of_the_other_form_to_nothing_is_an_answer_without_request() -> None:
    talk = begun()
    talk.ask(framed(asked(1)))
    talk.tell(framed(told(1)), framed(told(5, SET_VARIABLE, opcode=2)))
    talk.close()
    assert talk.outcomes() == ["answered", "orphan_answer"]


@pytest.mark.parametrize("kind", [0x13, 0x03])
def test_an_item_that_a_notification_refuses_is_an_error(kind: int) -> None:
    talk = begun()
    refused = bytes((kind, 0, 0, 0, 9)) + b"\0" + bytes(4)
    values = b"\x92\0\0\0\x13\0\x07\0\x03\0" + bytes(4)
    head = notified()[:-1]
    talk.tell(framed(head + refused, 3), framed(head.replace(b"\5\1", b"\6\1") + values, 3))
    talk.close()
    first, second = talk.transactions
    assert [(one.part, one.code, one.name, one.item) for one in first.errors] == [("item", kind, "refused", 9)]
    assert [one.address for one in first.errors] == [item.label for item in first.plus_results] == ["item 9"]
    assert (second.has_errors, second.errors) == (False, [])
    assert "transaction.errors" not in slugs(talk)


def test_a_response_of_the_other_form_answers_too() -> None:
    talk = begun()
    talk.ask(framed(asked(1)))
    talk.tell(framed(told(1, opcode=2)))
    talk.close()
    assert talk.outcomes() == ["answered"]


@pytest.mark.parametrize(
    ("body", "code", "name"),
    [
        (b"\xff" * 8 + b"\xf4", 0xFFF4, "Object not found"),
        (b"\x13", 19, "Service executed with partial error"),
        (b"\xff" * 7 + b"\xfe\x20", 0xFE20, "0xfe20"),
    ],
)
@pytest.mark.parametrize("function", [GET_MULTI, ERROR])
def test_an_answer_that_says_no(body: bytes, code: int, name: str, function: int) -> None:
    talk = begun()
    talk.ask(framed(asked(1)))
    talk.tell(framed(told(1, function, body)))
    talk.close()
    (transaction,) = talk.transactions
    assert transaction.has_errors
    assert [(error.where, error.code, error.name) for error in transaction.errors] == [("return value", code, name)]
    assert slugs(talk) == ["transaction.refused"]


def test_a_warning_is_no_error() -> None:
    talk = begun()
    session = bodies.create_object(285, Value(0, INT, 5), PlusObject(211, 287, 0, 0, 0, []))
    talk.ask(framed(asked(1, CREATE_OBJECT, body=session)))
    talk.tell(framed(told(1, CREATE_OBJECT, b"\x11\1\x87\x07" + bodies.end(2))))
    talk.close()
    assert not talk.transactions[0].has_errors
    assert slugs(talk) == []


def test_an_answer_to_something_else_is_told() -> None:
    talk = begun()
    talk.ask(framed(asked(1)))
    talk.tell(framed(told(1, CREATE_OBJECT)))
    talk.close()
    assert talk.outcomes() == ["answered"]
    assert slugs(talk) == ["transaction.function_mismatch"]


@pytest.mark.parametrize("code", [0x0004, 0x0005, 0x00F0])
def test_no_function_is_taken_for_one_of_s7comm(code: int) -> None:
    talk = begun()
    talk.ask(framed(asked(1, code)))
    talk.tell(framed(told(1, code)))
    talk.close()
    assert facts(talk) == [("answered", f"S7comm-plus 0x{code:04x}", 1)]
    assert slugs(talk) == []


def test_references_of_both_protocols_are_independent() -> None:
    talk = Talk()
    talk.open()
    talk.ask(read(1, b""), framed(asked(1)))
    talk.tell(framed(told(1)), words(1, 1))
    talk.close()
    assert [one.is_plus for one in talk.transactions if one.outcome == "answered"] == [True, False]


def test_a_pdu_in_frames_and_fragments() -> None:
    talk = begun()
    talk.ask(framed(asked(1)))
    first, last = framed(told(1, body=bytes(900)), 3, trailer=False), framed(bytes(500), 3)
    talk.packet(SERVER, dt(first[:400])[:6] + b"\x00" + first[:400])
    talk.packet(SERVER, dt(first[400:]))
    end = talk.tell(last)
    talk.close()
    assert talk.pairs()[0][1] == end
    response = talk.transactions[0].plus_response
    assert response is not None
    assert (response.frames, len(response.data), response.malformed) == (2, 10 + 900 + 500, [])
    assert talk.pipeline.plus.pdus == 2


def test_a_pdu_that_is_too_long_is_paired_all_the_same() -> None:
    talk = begun()
    talk.ask(framed(asked(1)))
    talk.tell(framed(told(1), trailer=False))
    for _ in range(MAX_PDU // 54_000 + 2):
        talk.tell(*[framed(bytes(900), trailer=False)] * 60)
    talk.tell(framed(b"end"))
    talk.close()
    assert talk.outcomes() == ["answered"]
    assert slugs(talk) == ["s7.plus_too_long"]
    assert MAX_PDU - 60 * 904 < talk.transactions[0].response_size <= MAX_PDU == 8 * 1024 * 1024
    assert talk.pipeline.plus.cut_pdus == 1


def test_what_was_left_out_is_reported_of_a_pdu_without_end_too() -> None:
    """Frames that never stop: another request, or the end of the connection, is the end of what there is."""
    talk = begun()
    for sequence in (1, 2):
        talk.ask(framed(asked(sequence), trailer=False))
        for _ in range(MAX_PDU // 60_000 + 2):
            talk.ask(framed(b"\xab" * 60_000, trailer=False))
    talk.close()
    details = [one.detail for one in talk.findings if one.slug == "s7.plus_too_long"]
    kept = 18 + 139 * 60_004
    assert MAX_PDU - 60_004 < kept <= MAX_PDU
    assert details == [f"{kept} bytes from 10.0.0.1:50000 kept, {2 * 60_004} left out"] * 2


def test_a_hole_inside_a_pdu_leaves_its_head() -> None:
    talk = begun()
    talk.ask(framed(asked(1)))
    talk.tell(framed(told(1), trailer=False))
    talk.lose(SERVER, framed(bytes(100), trailer=False))
    talk.packet(CLIENT, flags=ACK)
    talk.tell(framed(b"the end of what is missing"))
    talk.ask(framed(asked(2)))
    talk.tell(framed(told(2)))
    talk.close()
    assert talk.outcomes() == ["answered", "answered"]
    assert slugs(talk) == ["stream.hole"]
    assert (talk.pipeline.plus.cut_pdus, talk.pipeline.plus.unpaired) == (1, 1)


@pytest.mark.parametrize("ends", ["a gap", "a reset", "a new one"])
def test_what_is_left_of_a_pdu_has_the_packet_of_its_last_frame(ends: str) -> None:
    """Not the one that shows that no more of it comes, which may be another request's."""
    talk = begun()
    talk.ask(framed(asked(1)))
    first = talk.packet(SERVER, dt(framed(told(1), trailer=False)))
    last = talk.packet(SERVER, dt(framed(bytes(100), trailer=False)))
    if ends == "a reset":
        talk.packet(CLIENT, flags=RST)
    else:
        if ends == "a gap":
            talk.lose(SERVER, framed(bytes(100), trailer=False))
        talk.ask(framed(asked(2)))
        talk.tell(framed(told(2)))
    talk.close()
    answer = talk.transactions[0]
    assert (last, answer.response_frame, answer.response_ns - answer.request_ns) == (first + 1, last, 2 * MS)


def test_a_gap_excuses_the_next_request_and_no_more() -> None:
    """The numbers of the first one are those of anything: it may be the rest of another."""
    talk = begun()
    talk.ask(framed(asked(1)))
    talk.tell(framed(told(1)))
    talk.lose(CLIENT, framed(asked(2)))
    for at in (2, 900, 3, 4, 3):
        if at != 2:
            talk.ask(framed(asked(at)))
        talk.tell(framed(told(at)))
    talk.close()
    found = [one.detail for one in talk.findings if one.rule.slug == "security.replay"]
    assert found == ["10.0.0.1:50000 to 10.0.0.2:102: GetMultiVariables with sequence number 3 follows 4"]


def test_a_gap_excuses_the_next_notification_and_no_more() -> None:
    talk = begun()
    talk.tell(framed(notified(5)))
    talk.lose(SERVER, framed(notified(6)))
    talk.packet(CLIENT, flags=ACK)
    for at in (7, 8, 9, 11):
        talk.tell(framed(notified(at)))
    talk.close()
    found = [one.detail for one in talk.findings if one.rule.slug == "s7plus.notifications_lost"]
    assert found == ["10.0.0.2:102, subscription 0x70000e51: number 11 follows 9"]


@pytest.mark.parametrize("version", [2, 3])
def test_the_rest_of_a_pdu_behind_a_gap_is_no_notification(version: int) -> None:
    """It begins with the octet of one, as one rest in 256 does; a notification is one behind a gap, too."""
    for data, pushes in ((b"\x33" + bytes(range(40)), 0), (notified(7), 1)):
        talk = begun()
        talk.lose(SERVER, framed(told(1), version, trailer=False))
        talk.packet(CLIENT, flags=ACK)
        talk.tell(framed(data, version))
        talk.close()
        assert (len(talk.transactions), talk.pipeline.plus.unpaired) == (pushes, 1 - pushes)


def test_a_gap_excuses_the_rest_behind_it_and_no_more() -> None:
    """What stands between the frames of a PDU may come before its rest."""
    talk = begun()
    talk.lose(CLIENT, framed(asked(1), trailer=False))
    talk.tell(framed(told(1)))
    talk.ask(KEEP_ALIVE, framed(b"\x44rest"), framed(b"\x44what"))
    talk.close()
    assert [one for one in slugs(talk) if one != "transaction.orphan"] == ["stream.hole", "s7plus.unknown_kind"]


def test_a_capture_that_begins_amid_a_pdu_excuses_that_and_no_more() -> None:
    talk = Talk()
    talk.ask(KEEP_ALIVE, framed(b"\x44rest"), framed(asked(2)))
    talk.tell(framed(b"\x44rest"), framed(told(2)))
    assert slugs(talk) == []
    talk.ask(framed(b"\x44what"))
    talk.tell(framed(b"\x44what"))
    talk.close()
    assert slugs(talk) == ["s7plus.unknown_kind"]  # once for a connection
    assert talk.outcomes() == ["answered"]


def test_the_end_inside_a_pdu() -> None:
    talk = begun()
    talk.ask(framed(asked(1)), framed(asked(2), trailer=False))
    talk.close()
    assert talk.outcomes() == ["unanswered", "unanswered"]
    assert talk.pipeline.plus.cut_pdus == 1


def test_a_pdu_that_the_capture_cut() -> None:
    talk = begun()
    talk.packet(CLIENT, dt(framed(asked(1, body=bytes(100)))), cut=80)
    talk.tell(framed(told(1)))
    talk.close()
    assert talk.outcomes() == ["answered"]
    assert talk.pipeline.plus.cut_pdus == 1


def test_without_opcode() -> None:
    talk = begun()
    talk.ask(event(100), KEEP_ALIVE, event(200, b"LOGOUT"))
    talk.close()
    assert talk.connections[0].system_events == 2
    assert talk.transactions == []
    assert slugs(talk) == []
    assert (talk.pipeline.plus.pdus, talk.pipeline.plus.unpaired) == (3, 3)
    versions = talk.pipeline.plus.versions.counts()
    assert (versions[0xFE], versions[0xFF]) == (2, 1)


def test_a_damaged_pdu_is_told() -> None:
    talk = begun()
    talk.ask(framed(b"\x44what"), framed(asked(1)) + b"more")
    talk.tell(framed(told(1)))
    talk.close()
    assert slugs(talk) == ["s7plus.unknown_kind", "s7.malformed"]
    said = "S7comm-plus 0x44 from 10.0.0.1:50000: s7plus: opcode at byte 4 is 68, which is unknown"
    assert said in talk.findings[0].detail
    assert talk.outcomes() == ["answered"]


def test_met_in_its_midst_the_sides_are_known_by_their_roles() -> None:
    talk = Talk(4000, 4102)
    talk.tell(framed(told(1)))
    talk.finish()
    (connection,) = talk.connections
    assert (connection.client_known, str(connection.client)) == (True, "10.0.0.1:4000")
    assert slugs(talk) == ["session.unusual_port"]


def test_tls_after_init_ssl() -> None:
    talk = begun()
    talk.ask(framed(asked(1, INIT_SSL, 0, 0x30, bytes(4)), 1))
    talk.tell(framed(told(1, INIT_SSL), 1))
    talk.ask(HELLO)
    for _ in range(3):
        talk.tell(HELLO)
    talk.close()
    assert facts(talk) == [("answered", "S7comm-plus InitSSL", 1)]
    (connection,) = talk.connections
    assert connection.protocol == "s7comm_plus"
    assert connection.identified_by == "InitSSL, then TLS 1.0 ClientHello"
    assert [(one.slug, one.detail) for one in talk.findings] == [
        ("session.encrypted", "TLS 1.0 ClientHello, after InitSSL")
    ]


def test_a_tls_session_tells_its_version_and_when_the_plc_spoke_last() -> None:
    talk = begun()
    talk.ask(framed(asked(1, INIT_SSL, 0, 0x30, bytes(4)), 1))
    talk.tell(framed(told(1, INIT_SSL), 1))
    talk.ask(HELLO)
    body = b"\x03\x03" + bytes(32) + b"\x00\x13\x01\x00\x00\x06\x00\x2b\x00\x02\x03\x04"  # chooses TLS 1.3
    hello = b"\x02" + len(body).to_bytes(3, "big") + body
    talk.tell(b"\x16\x03\x03" + len(hello).to_bytes(2, "big") + hello)
    record = b"\x17\x03\x03\x00\x04abcd"
    talk.ask(record, after_ns=5 * SECOND)
    last = talk.tell(record, after_ns=SECOND)
    talk.packet(0, flags=FIN | ACK, after_ns=800_000)
    talk.packet(1, flags=FIN | ACK)
    talk.finish()
    assert last
    (connection,) = talk.connections
    assert connection.identified_by == "InitSSL, then TLS 1.0 ClientHello, the server chose TLS 1.3"
    ending = connection.ending
    assert ending is not None
    assert ending.silence_ns == 800_000
    assert ending.last_heard() == "; last encrypted message of the server 800 µs earlier"
    assert slugs(talk) == ["session.encrypted"]


def test_functions_are_counted() -> None:
    talk = begun()
    talk.ask(framed(asked(1)), framed(asked(2, 0x9999)))
    talk.tell(framed(told(1)), framed(told(2, 0x9999)), framed(notified()))
    talk.close()
    assert talk.pipeline.plus.functions == {GET_MULTI: 2, 0x9999: 2}
    assert {code: count for code, count in enumerate(talk.pipeline.plus.opcodes.counts()) if count} == {
        0x31: 2,
        0x32: 2,
        0x33: 1,
    }
    assert {code: count for code, count in enumerate(talk.pipeline.plus.versions.counts()) if count} == {2: 5}
    assert talk.pipeline.s7.pdus == 0


@pytest.mark.parametrize(
    ("name", "pdus", "opcodes", "answered", "one_way"),
    [
        ("s7commplus_1511_opc_all_types.pcap", 18, {0x31: 9, 0x32: 9}, 9, 0),
        ("s7comm_and_s7commplus_sll.pcap", 121, {0x31: 34, 0x32: 8, 0x33: 79}, 8, 26),
    ],
)
def test_shared_captures(
    corpus: Path, name: str, pdus: int, opcodes: dict[int, int], answered: int, one_way: int
) -> None:
    """The numbers are those of tshark's TPDUs, counted apart from this package."""
    analysis = dissect.analyze(str(corpus / name))
    assert analysis.pipeline is not None
    assert analysis.pipeline.plus.pdus == analysis.pipeline.iso.tsdus.counts()[1] == pdus
    assert {code: count for code, count in enumerate(analysis.pipeline.plus.opcodes.counts()) if count} == opcodes
    assert analysis.pipeline.plus.unpaired == analysis.pipeline.plus.cut_pdus == 0
    (connection,) = [one for one in analysis.connections if one.protocol == "s7comm_plus"]
    assert (connection.answered, connection.unanswered, connection.orphans) == (answered, 0, 0)
    assert connection.unsolicited == one_way + opcodes.get(0x33, 0)
    assert analysis.unanswered == 0
    odd = {
        slug for slug in analysis.pipeline.finding_counts if not slug.startswith("security.")
    }  # of S7comm in the same file
    assert odd <= {"session.idle"}  # keep-alive probes of connections that say nothing


def test_a_stream_of_pieces_with_keep_alives_and_events_between() -> None:
    """SetVarSubStreamed: a complete request in the first frame, a piece of the stream in each further one."""
    head = asked(1, SET_VAR_SUBSTREAMED, body=get_stream(52, [7]) + build_value(Value(0, UDINT, 9)))
    sizes = [900, 3, 600]
    pieces = [framed(number(size) + bytes(size), 3, trailer=False) for size in sizes]
    last = framed(number(5) + b"piece" + end(9), 3)
    talk = begun()
    talk.ask(framed(head, 3, trailer=False), pieces[0])
    talk.tell(event(1000), KEEP_ALIVE)
    talk.ask(KEEP_ALIVE, pieces[1], event(7, b"LOGOUT"), pieces[2], last)
    talk.tell(framed(told(1, SET_VAR_SUBSTREAMED, body=b"\0" + end(10)), 3))
    talk.close()
    assert facts(talk) == [("answered", "S7comm-plus SetVarSubStreamed", 1)]
    assert slugs(talk) == []
    request = talk.transactions[0].plus_request
    assert request is not None
    found = parse_contents(request)
    assert (request.frames, found.malformed, found.whole, found.integrity_id) == (5, [], True, 9)
    assert [ends - begin for begin, ends in found.pieces] == [*sizes, 5]
    plus = talk.pipeline.plus
    assert (plus.pdus, plus.cut_pdus, plus.unpaired) == (6, 0, 4)
    versions = plus.versions.counts()
    assert (versions[0xFE], versions[0xFF]) == (2, 2)
