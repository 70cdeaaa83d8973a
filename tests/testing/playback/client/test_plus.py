"""Sessions of S7comm-plus without digests are played: as recorded, but for the numbers of this session."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.protocols.s7.tables import CONTROL, READ, WRITE
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import PlusObject
from dissect.protocols.s7plus.session import SERVER_SESSION
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    DELETE_OBJECT,
    EXPLORE,
    GET_MULTI_VARIABLES,
    INVOKE,
    SET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.testing.golden import diff_sessions, golden_text, read_session
from dissect.testing.playback.client import Permissions, load_recorded
from dissect.testing.playback.client.permissions import NO_CONTROL, NO_WRITE
from dissect.testing.playback.client.plan import make_plan, plan_lines
from dissect.testing.playback.client.plus import PlusRenewal, plus_kind
from dissect.testing.playback.server import Recording, Server, load_recording
from tests.protocols.s7plus.bodies import create_object, delete_object, get_multi, rid, set_multi, set_variable
from tests.protocols.s7plus.pdus import asked, framed
from tests.testing.playback.client.support import ALL, CAPTURES, play, texts
from tests.testing.playback.plus_talk import CONTAINER, SESSION, PlusTalk, plant, value, word

RECORDED = [CAPTURES / "s7plus" / name for name in ("s7commplus.pcapng", "s7commplus-tls.pcapng")]


@pytest.mark.parametrize("form", ["capture", "golden"])
@pytest.mark.parametrize("name", ["s7commplus", "s7commplus-tls", "plant"])
def test_the_round_changes_nothing(name: str, form: str, tmp_path: Path) -> None:
    path = plant(tmp_path / "plant.pcapng") if name == "plant" else CAPTURES / "s7plus" / f"{name}.pcapng"
    if form == "golden":
        golden = tmp_path / "x.s7.txt"
        golden.write_text(golden_text(read_session(path)), encoding="utf-8")
        path = golden
    again = tmp_path / "again.pcapng"
    with Server(path) as server:
        outcome = play(path, server, ALL, writer=PcapngWriter(str(again)))
        assert server.unmatched == []
    assert texts(outcome) == []
    assert outcome.requests == outcome.answered == sum([bool(one.request) for one in read_session(path).transactions])
    assert [one.text for one in diff_sessions(read_session(path), read_session(again))] == []


def test_without_permission_only_reads_are_sent(tmp_path: Path) -> None:
    path = plant(tmp_path / "plant.pcapng")
    with Server(path) as server:
        outcome = play(path, server, Permissions())
        assert {request.function.split()[1] for request in server.requests} == {
            "CreateObject",
            "GetMultiVariables",
            "DeleteObject",
        }
    assert texts(outcome) == []
    assert [one.reason for one in outcome.withheld] == [NO_WRITE]
    lines = plan_lines(make_plan(load_recorded(path)), Permissions())
    assert [line for line in lines if "withhold" in line] == [
        f"  withhold transaction 2, S7comm-plus SetMultiVariables DB1.DBW0 = Int 7: {NO_WRITE}"
    ]


def another_session(path: Path, was: int, now: int) -> Recording:
    """Return a recording whose server gives the session another id."""
    recording = load_recording(path)
    step = recording.scripts[0].steps[0]
    ids = parse_contents(parse_plus(step.answer))
    assert ids.ids[0] == was
    changed = plant(path.with_name("other.pcapng"), now)
    step.answer = load_recording(changed).scripts[0].steps[0].answer
    return recording


def test_a_session_has_the_ids_that_the_server_gives_it(tmp_path: Path) -> None:
    path = plant(tmp_path / "plant.pcapng")
    with Server(another_session(path, SESSION, 0x70001234)) as server:
        outcome = play(path, server, ALL)
        seen = [parse_plus(request.octets) for request in server.requests]
    assert [pdu.session_id for pdu in seen] == [0x120] + [0x70001234] * 6
    assert [pdu.sequence for pdu in seen] == list(range(1, 8))
    assert texts(outcome) == []


def test_integrity_ids_are_counted_in_two_rows(tmp_path: Path) -> None:
    path = plant(tmp_path / "plant.pcapng")
    with Server(path) as server:
        play(path, server, ALL)
        seen = [parse_plus(request.octets) for request in server.requests]
    ids: dict[bool, list[int]] = {}
    for pdu in seen:
        found = parse_contents(pdu)
        assert found.whole
        ids.setdefault(pdu.function == GET_MULTI_VARIABLES, []).append(found.integrity_id)
    assert ids == {True: [1, 2, 3], False: [-1, 1, 2, 3]}  # the first begins the session


def test_an_object_made_here_stands_for_the_recorded_one() -> None:
    renewal = PlusRenewal()
    renewal.own.add(5)
    renewal._objects[SESSION] = 0x70009999
    for body, place in ((delete_object(SESSION), 14), (delete_object(CONTAINER), 14)):
        _, octets = renewal.renewed(framed(asked(9, DELETE_OBJECT, body=body)))
        now = int.from_bytes(parse_plus(octets).data[place : place + 4], "big")
        assert now == (0x70009999 if body == delete_object(SESSION) else CONTAINER)


HERE = frozenset((SESSION, CONTAINER))
STATE = VariableAddress(0, 52, 2167, [])


@pytest.mark.parametrize(
    ("function", "body", "kind"),
    [
        (EXPLORE, rid(3) + b"\0\1\1\0\0" + bytes(4), READ),
        (GET_MULTI_VARIABLES, get_multi(word(0)), READ),
        (GET_MULTI_VARIABLES, get_multi(word(0)) + bytes(4), READ),  # s7commplus fills it up
        (CREATE_OBJECT, create_object(285, value(0), PlusObject(211, SERVER_SESSION, 0, 0, 0, [])), READ),
        (CREATE_OBJECT, create_object(285, value(0), PlusObject(211, 2520, 0, 0, 0, [])), CONTROL),
        (DELETE_OBJECT, delete_object(SESSION), READ),
        (DELETE_OBJECT, delete_object(0x8A0E0001), CONTROL),
        (SET_MULTI_VARIABLES, set_multi([(word(0), value(1))]), WRITE),
        (SET_MULTI_VARIABLES, set_multi([(word(0), value(1))]) + bytes(4), CONTROL),
        (SET_MULTI_VARIABLES, set_multi([(STATE, value(1))]), CONTROL),
        (SET_MULTI_VARIABLES, set_multi([(word(0), value(1)), (STATE, value(1))]), CONTROL),
        (SET_VARIABLE, set_variable(SESSION, [306], value(1)), READ),
        (SET_VARIABLE, set_variable(CONTAINER, [1053], value(1)), READ),
        (SET_VARIABLE, set_variable(SESSION, [1846], value(1)), CONTROL),
        (SET_VARIABLE, set_variable(52, [2167], value(1)), CONTROL),
        (SET_VARIABLE, set_variable(52, [306], value(1)), CONTROL),
        (INVOKE, rid(52) + rid(1) + bytes(4), CONTROL),
        (0x0506, bytes(20), CONTROL),
    ],
)
def test_what_is_not_surely_a_read_takes_permission(function: int, body: bytes, kind: str) -> None:
    octets = framed(asked(1, function, body=body))
    assert plus_kind(octets, HERE) == kind
    for cut in range(len(octets)):  # and what is cut off is never less than it was
        if kind != READ:
            assert plus_kind(octets[:cut], HERE) == CONTROL


def test_a_stop_is_not_sent_without_permission(tmp_path: Path) -> None:
    talk = PlusTalk()
    talk.ask(SET_VARIABLE, set_variable(52, [2167], value(1)), b"\0" + bytes(4))
    talk.ask(GET_MULTI_VARIABLES, get_multi(word(0)), b"\0\0\0" + bytes(4))
    path = talk.save(tmp_path / "stop.pcapng")
    with Server(path) as server:
        outcome = play(path, server, Permissions(write=True))
        assert [parse_plus(request.octets).function for request in server.requests] == [GET_MULTI_VARIABLES]
        assert [one.reason for one in outcome.withheld] == [NO_CONTROL]
