"""Downloads and uploads: pieces, sizes, ids, and the way python-snap7 does it."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.connection import MAX_REMEMBERED
from dissect.engine.transactions.operation import Operation
from dissect.protocols.s7.tables import DOWNLOAD_BLOCK, UPLOAD
from tests.engine.findings import events
from tests.engine.findings.operation_scenarios import load, read_out
from tests.engine.transactions.talk import CLIENT, FIN, RST, SERVER, Talk, job


@pytest.fixture
def talk() -> Talk:
    talk = Talk()
    talk.open()
    talk.operations.clear()
    return talk


def only(talk: Talk) -> Operation:
    (operation,) = talk.operations
    return operation


def oddities(operation: Operation) -> list[str]:
    return [oddity.name for oddity in operation.oddities]


def test_a_download_with_the_jobs_of_the_plc(talk: Talk) -> None:
    load(talk)
    told = only(talk)
    assert (told.kind, told.subject, told.result) == ("download", "DB 1, passive", "done")
    assert (told.octets, told.announced, told.parts, oddities(told)) == (500, 500, 5, [])
    assert told.asked_by == CLIENT


@pytest.mark.parametrize(
    ("name", "code", "told"),
    [("0A00001P", 0, False), ("0A00001B", 0, False), ("0A00001P", 0xD241, True), ("0A00001A", 0, True)],
)
def test_a_loaded_block_that_is_deleted(talk: Talk, name: str, code: int, told: bool) -> None:
    """A refused deletion changes nothing; what is deleted from both file systems is gone from the passive one."""
    load(talk)
    talk.ask(events.service(95, "_DELE", events.blocks(name)))
    talk.tell(events.answered(95, 0x28, code))
    talk.packet(CLIENT, flags=FIN)
    talk.close()
    assert ("block.not_activated" in talk.slugs()) is told


@pytest.mark.parametrize(("code", "result"), [(0, "done"), (0xD241, "refused")])
def test_a_deletion_is_an_operation(talk: Talk, code: int, result: str) -> None:
    names = events.blocks("0A00001P", "0800002A")
    talk.ask(events.service(95, "_DELE", names))
    talk.tell(events.answered(95, 0x28, code))
    told = only(talk)
    assert (told.kind, told.subject, told.result) == ("delete", "DB 1, passive, OB 2, active", result)
    assert (told.asked_by, told.first_frame + 1, told.parts) == (CLIENT, told.last_frame, 1)


def test_an_upload(talk: Talk) -> None:
    read_out(talk)
    told = only(talk)
    assert (told.kind, told.subject, told.result) == ("upload", "DB 1, active", "done")
    assert (told.octets, told.announced, told.parts, oddities(told)) == (300, 300, 4, [])


def test_a_client_that_sends_the_pieces_unasked(talk: Talk) -> None:
    """python-snap7: jobs 0x1b and 0x1c of its own, names of eight characters."""
    name = b"0A00001P"
    talk.ask(job(1, b"\x1a\0\x01\0\0\0\0\0\x08" + name + b"\x0d1000050000040"))
    talk.tell(events.answered(1, 0x1A))
    content = bytes(50)
    talk.ask(job(2, b"\x1b\0\0\0\0\0\0\0\x08" + name, len(content).to_bytes(2, "big") + b"\0\xfb" + content))
    talk.tell(events.answered(2, 0x1B))
    talk.ask(job(3, b"\x1c\0\0\0\0\0\0\0\x08" + name))
    talk.tell(events.answered(3, 0x1C))
    told = only(talk)
    assert (told.result, told.octets, told.announced, oddities(told)) == ("done", 50, 50, [])


def test_loaded_blocks_are_remembered_up_to_a_bound(talk: Talk) -> None:
    """Names of blocks come from the wire: a client that loads more of them than any plant has costs no more memory."""
    for block in range(257):
        name = f"_0A{block:05d}P"
        talk.ask(events.request_download(1, name, size=10))
        talk.tell(events.answered(1, 0x1A))
        talk.tell(events.download_block(2, name))
        talk.ask(events.piece(2, 0x1B, 10, False))
        talk.tell(events.download_ended(3, name))
        talk.ask(events.answered(3, 0x1C))
    assert [one.result for one in talk.operations] == ["done"] * 257
    (connection,) = {one.connection for one in talk.operations}
    assert len(connection.traits.loaded) == MAX_REMEMBERED == 256


def test_requests_with_the_same_parameters_share_what_they_were_cut_into(talk: Talk) -> None:
    """Each piece of a block is asked for with the same bytes; a job with data of its own is never taken for another."""
    read_out(talk)
    pieces = [one for one in talk.transactions if one.function == UPLOAD]
    assert len(pieces) == 2
    bodies = {id(one.request_body) for one in pieces}
    assert len(bodies) == 1
    for number in (1, 2):
        parameters = b"\x1b\0\0\0\0\0\0\0\x08" + b"0A00001P"
        talk.ask(job(number, parameters, b"\0\x0a\0\xfb" + bytes(10)))
        talk.tell(events.answered(number, 0x1B))
    one, other = [one for one in talk.transactions if one.function == DOWNLOAD_BLOCK]
    assert one.request_body is not None
    assert one.request_body is not other.request_body


@pytest.mark.parametrize(
    ("sizes", "announced", "last", "odd"),
    [
        ((222, 222), 500, -1, ["wrong_size"]),
        ((222, 222, 56), 500, 1, ["beyond_end", "cut_short"]),
        ((222, 222), 500, 5, ["cut_short"]),
        ((), 500, -1, ["cut_short"]),
    ],
)
def test_a_download_that_does_not_add_up(
    talk: Talk, sizes: tuple[int, ...], announced: int, last: int, odd: list[str]
) -> None:
    load(talk, sizes=sizes, announced=announced, last=last)
    assert oddities(only(talk)) == odd


def test_holes_excuse_what_does_not_add_up(talk: Talk) -> None:
    talk.ask(events.request_download(1))
    talk.tell(events.answered(1, 0x1A))
    talk.tell(events.download_block(10))
    talk.lose(CLIENT, events.piece(10, 0x1B, 444, more=True))
    talk.tell(events.download_block(12))
    talk.ask(events.piece(12, 0x1B, 56, more=False))
    talk.tell(events.download_ended(14))
    talk.ask(events.answered(14, 0x1C))
    talk.finish()
    assert [(one.result, oddities(one)) for one in talk.operations] == [("done", [])]


def test_the_plc_says_why_it_failed(talk: Talk) -> None:
    load(talk, code=0xD2A0)
    assert (only(talk).result, only(talk).error_code) == ("failed", 0xD2A0)


def test_a_download_that_is_refused(talk: Talk) -> None:
    talk.ask(events.request_download(1))
    talk.tell(events.answered(1, 0x1A, 0xD241))
    assert (only(talk).result, only(talk).error_code) == ("refused", 0xD241)


def test_a_download_that_breaks_off(talk: Talk) -> None:
    talk.ask(events.request_download(1))
    talk.tell(events.answered(1, 0x1A))
    talk.packet(SERVER, flags=RST)
    talk.finish()
    assert (only(talk).result, only(talk).reason) == ("unfinished", "connection_closed")


def test_a_download_that_is_begun_again(talk: Talk) -> None:
    talk.ask(events.request_download(1))
    talk.tell(events.answered(1, 0x1A))
    load(talk)
    assert [one.result for one in talk.operations] == ["unfinished", "done"]


def test_an_upload_whose_step_names_another_id(talk: Talk) -> None:
    talk.ask(events.start_upload(1))
    talk.tell(events.upload_started(1, 7))
    talk.ask(events.upload(2, 8))
    talk.tell(events.answered(2, 0x1E))
    talk.close()
    assert oddities(only(talk)) == ["wrong_id"]
    assert only(talk).oddities[0].detail == "upload 8, the PLC assigned 7"


def test_an_upload_that_is_ended_at_once(talk: Talk) -> None:
    talk.ask(events.start_upload(1))
    talk.tell(events.upload_started(1, 7))
    talk.ask(events.end_upload(2, 7))
    talk.tell(events.answered(2, 0x1F))
    assert (only(talk).result, oddities(only(talk))) == ("done", ["cut_short"])


def test_steps_without_a_beginning_are_no_operation(talk: Talk) -> None:
    talk.tell(events.download_block(10))
    talk.ask(events.piece(10, 0x1B, 222, more=True))
    talk.ask(events.upload(2, 8))
    talk.tell(events.piece(2, 0x1E, 222, more=True))
    talk.close()
    assert talk.operations == []
