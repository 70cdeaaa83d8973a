"""Transfers of which the capture has one direction only, or begins in the middle: what is there is told, nothing is guessed."""

from __future__ import annotations

import pytest

from captures.craft.mc7 import FC3, OB1, OB1_CHANGED
from dissect.engine.findings.block_rules import BlockWatch
from dissect.engine.findings.reporter import Reporter
from dissect.engine.program.carved import CarvedBlock, carve
from dissect.engine.transactions import transfers
from dissect.engine.transactions.operation import Operation
from dissect.wire.build import COMPILED
from tests.engine.findings import events
from tests.engine.program.transfers import Said, activate, download, upload
from tests.engine.transactions.talk import CLIENT, FIN, SECOND, SERVER, SYN, Talk, dt, granted, setup

NAME = "_0C00003P"
LOADED = download(FC3, NAME, 20)
READ_OUT = upload(OB1, "_0800001A", 7, 40)
#: What is said of a transfer that really went wrong.
FAILURES = {"operation.unfinished", "operation.upload_unfinished", "operation.not_loaded", "block.not_activated"}


def heard(side: int, said: list[Said], pause_ns: int = 0) -> Talk:
    """Both ends talk, but of one of them nothing is captured."""
    talk = Talk()
    first = SYN if side == CLIENT else SYN | 16
    talk.packet(side, flags=first)
    for whose, pdu in [(CLIENT, setup(0)), (SERVER, granted(0)), *said]:
        talk.wait(pause_ns)
        if whose == side:
            talk.packet(side, dt(pdu))
        else:
            talk.lose(whose, pdu)
    talk.packet(side, flags=FIN | 16)
    talk.finish()
    return talk


def late(said: list[Said], skipped: int) -> Talk:
    """The capture begins behind the first PDUs."""
    talk = Talk()
    for number, (side, pdu) in enumerate(said):
        if number < skipped:
            talk.lose(side, pdu)
        else:
            talk.packet(side, dt(pdu))
    talk.packet(CLIENT, flags=FIN | 16)
    talk.finish()
    return talk


def transfer(talk: Talk) -> Operation:
    (found,) = [one for one in talk.operations if one.kind in {"download", "upload"}]
    return found


def asked_by_client(told: Operation) -> bool:
    return int(told.connection.tcp.ends[told.asked_by].port) == 50000


def block(talk: Talk) -> CarvedBlock:
    (found,) = carve(transfer(talk))
    return found


@pytest.mark.parametrize("asks", [SERVER, CLIENT])
@pytest.mark.parametrize("pause_ns", [0, 2 * SECOND])
def test_a_download_of_which_the_client_was_heard(asks: int, pause_ns: int) -> None:
    """All of the block is in what the client sent, in its answers or its jobs, however late these are given up."""
    talk = heard(CLIENT, [*download(FC3, NAME, 20, asks=asks), *activate("0C00003P", 50)], pause_ns)
    told = transfer(talk)
    assert (told.subject, told.result, told.reason, asked_by_client(told)) == (
        "FC 3, passive",
        "not_captured",
        "",
        True,
    )
    assert (told.octets, told.announced, told.begun, told.oddities) == (len(FC3), len(FC3), True, [])
    found = block(talk)
    assert (found.label, found.octets, found.missing, found.activated) == ("FC3", FC3, "", None)
    assert not FAILURES & set(talk.slugs())


@pytest.mark.parametrize(("side", "found"), [(CLIENT, ["block.changed"]), (None, ["block.changed", "block.differs"])])
def test_whether_a_block_runs_of_which_the_client_was_heard_nobody_knows(side: int | None, found: list[str]) -> None:
    """Neither the block that was loaded nor the one before it is what an upload is compared with."""
    judge = Reporter()
    watch = BlockWatch(judge)
    changed = [*download(OB1_CHANGED, "_0800001P", 40), *activate("0800001P", 50)]
    read_out = upload(OB1, "_0800001A", 7, 40)
    for talk in (late(read_out, 0), late(changed, 0) if side is None else heard(side, changed), late(read_out, 0)):
        watch.take(transfer(talk))
    assert [one.slug for one in judge.fresh if one.slug in {"block.changed", "block.differs"}] == found


def test_several_downloads_of_which_the_client_was_heard() -> None:
    talk = heard(CLIENT, [*LOADED, *download(OB1, "_0800001P", 33, ref=100)])
    loaded = [one for one in talk.operations if one.kind == "download"]
    assert [(one.subject, one.result, one.content) for one in loaded] == [
        ("FC 3, passive", "not_captured", FC3),
        ("OB 1, passive", "not_captured", OB1),
    ]


def test_a_download_of_which_the_plc_was_heard() -> None:
    """Its jobs name the block, its answer says that a download was accepted; the block is in what was not captured."""
    talk = heard(SERVER, [*LOADED, *activate("0C00003P", 50)])
    told = transfer(talk)
    assert (told.subject, told.result, told.octets, asked_by_client(told)) == ("FC 3, passive", "not_captured", 0, True)
    assert (block(talk).label, block(talk).missing) == ("FC3", "no contents captured")
    assert not FAILURES & set(talk.slugs())
    (change,) = [one.detail for one in talk.findings if one.slug == "security.program_change"]
    assert change.endswith(": Request download, accepted, request not captured")


def test_the_plc_says_that_a_download_failed() -> None:
    said = [*LOADED[:-2], (SERVER, events.download_ended(90, NAME, 0xD2A0)), (CLIENT, events.answered(90, 0x1C))]
    assert transfer(heard(SERVER, said)).error_code == 0xD2A0
    assert transfer(heard(CLIENT, said)).result == "not_captured"


def test_a_download_of_which_a_refusal_was_heard() -> None:
    told = transfer(heard(SERVER, [LOADED[0], (SERVER, events.answered(1, 0x1A, 0xD241))]))
    assert (told.subject, told.result, told.error_code) == ("name not captured", "refused", 0xD241)
    assert carve(told) == []


def test_an_upload_of_which_the_plc_was_heard() -> None:
    """The block is in its answers, and names itself."""
    talk = heard(SERVER, READ_OUT)
    told = transfer(talk)
    assert (told.subject, told.result, told.announced) == ("OB 1", "done", len(OB1))
    assert (block(talk).label, block(talk).octets, block(talk).missing, block(talk).title) == ("OB1", OB1, "", "")


def test_uploads_of_which_the_client_was_heard() -> None:
    """Whether a first request was refused, so that the client asked again, is not in the capture."""
    talk = heard(CLIENT, [(CLIENT, events.start_upload(40 + number)) for number in range(3)])
    assert [(one.kind, one.result) for one in talk.operations[1:]] == [("upload", "not_captured")] * 3
    assert not FAILURES & set(talk.slugs())
    talk = heard(CLIENT, READ_OUT)
    told = transfer(talk)
    assert (told.result, told.parts, told.oddities) == ("not_captured", len(READ_OUT) // 2, [])
    assert block(talk).missing == "no contents captured"


def test_a_setup_of_which_the_client_was_heard() -> None:
    (told,) = heard(CLIENT, []).operations
    assert (told.kind, told.result, told.reason) == ("connect", "not_captured", "")


@pytest.mark.parametrize(("skipped", "whole"), [(2, True), (3, True), (4, False), (5, False)])
def test_a_capture_that_begins_in_a_download(skipped: int, whole: bool) -> None:
    """Behind request and answer, the first job of the PLC, its answer, or the second job."""
    talk = late([*LOADED, *activate("0C00003P", 50)], skipped)
    told = transfer(talk)
    assert (told.subject, told.result, told.begun, told.oddities) == ("FC 3, passive", "done", False, [])
    assert asked_by_client(told)
    content = FC3 if whole else FC3[20:] if skipped < 6 else b""
    assert block(talk).octets == content
    assert block(talk).missing == ("" if whole else "its beginning was not captured")
    assert block(talk).activated
    changes = [one.detail for one in talk.findings if one.slug == "security.program_change"]
    assert changes[0].endswith(f": download FC 3, passive, {len(content)} bytes, beginning not captured")


@pytest.mark.parametrize(("skipped", "whole"), [(2, True), (3, True), (4, False)])
def test_a_capture_that_begins_in_an_upload(skipped: int, whole: bool) -> None:
    talk = late(READ_OUT, skipped)
    told = transfer(talk)
    assert (told.result, told.begun, told.subject) == ("done", False, "OB 1" if whole else "name not captured")
    assert block(talk).octets == (OB1 if whole else OB1[40:])
    assert (block(talk).label, block(talk).complete) == ("OB1" if whole else "file", whole)


def test_a_capture_that_begins_behind_the_last_piece() -> None:
    """That a download ended says nothing of what was loaded."""
    talk = late(LOADED, len(LOADED) - 2)
    assert talk.operations == []


def test_pieces_without_a_beginning_where_all_was_captured() -> None:
    talk = Talk()
    talk.open()
    for side, pdu in [*LOADED[2:], *READ_OUT[2:], (CLIENT, events.piece(77, 0x1B, 20, more=True))]:
        talk.packet(side, dt(pdu))
    talk.close()
    assert [one.kind for one in talk.operations] == ["connect"]


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_steps_that_wait_for_the_end_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transfers, "MAX_HALVES", 4)
    talk = heard(CLIENT, [*LOADED, *[(CLIENT, events.answered(number, 0x1C)) for number in range(200, 230)]])
    assert len(transfer(talk).content) <= len(FC3)
    monkeypatch.setattr(transfers, "MAX_HALF_OCTETS", 2000)
    talk = Talk()
    for number in range(20):
        talk.packet(CLIENT, dt(events.piece(number, 0x1B, 100, more=True)), after_ns=2 * SECOND)
        waiting = talk.transactions[0].connection.operations.halves if talk.transactions else []
        assert sum([len(one._response_buf) + 512 for one in waiting]) <= 2000
    talk.finish()
    assert transfer(talk).octets == 2000


def test_once_an_answer_met_its_request_nothing_waits() -> None:
    talk = Talk()
    for side, pdu in LOADED[:3]:
        talk.lose(side, pdu)
    for side, pdu in LOADED[3:]:
        talk.packet(side, dt(pdu))
    assert transfer(talk).result == "done"  # before the connection is over


def heard_answers(*pdus: bytes) -> list[str]:
    """Return what is said of security where nothing but these answers was captured."""
    talk = Talk()
    talk.tell(*pdus)
    talk.finish()
    return [f"{one.slug} {one.detail.partition(': ')[2]}" for one in talk.findings if one.slug.startswith("security.")]


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (events.answered(1, 0x29), ["security.plc_stop PLC stop, accepted, request not captured"]),
        (
            events.answered(1, 0x29, 0xD241),
            [
                "security.plc_stop PLC stop, refused: 0xd241 Not permitted in current protection level, request not captured",
                "security.protected PLC stop, refused: 0xd241 Not permitted in current protection level, request not captured",
            ],
        ),
        (
            events.tells(1, 7, 2),
            ["security.clock_set time functions: set clock, accepted, request not captured"],
        ),
        (
            events.tells(1, 5, 1),
            ["security.password password, accepted, request not captured"],
        ),
        (events.answered(1, 0x28), []),  # which service, only the request says
        (events.tells(1, 7, 1), []),
    ],
)
def test_an_answer_that_names_what_was_asked(answer: bytes, said: list[str]) -> None:
    assert heard_answers(answer) == said


def test_a_stop_is_an_operation_from_its_answer() -> None:
    talk = Talk()
    talk.tell(events.answered(1, 0x29))
    talk.finish()
    assert [(one.kind, one.subject, one.result) for one in talk.operations] == [("control", "PLC stop", "done")]


def test_an_answer_nobody_asked_for_is_no_command() -> None:
    """Where all was captured there was no request, so that nothing is said of one."""
    talk = Talk()
    talk.open()
    talk.tell(events.answered(9, 0x29))
    talk.close()
    assert "security.plc_stop" not in talk.slugs()
    assert [one.kind for one in talk.operations] == ["connect"]
