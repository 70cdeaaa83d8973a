"""Downloads and uploads: pieces, sizes, ids, and the way python-snap7 does it."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.connection import MAX_REMEMBERED
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.results import NOT_LOADED
from dissect.protocols.s7.tables import DOWNLOAD_BLOCK, UPLOAD
from tests.engine.findings import events
from tests.engine.findings.operation_scenarios import load, read_out
from tests.engine.transactions.talk import CLIENT, FIN, RST, SERVER, Talk, ack_data, job


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


# ---- blocks that a service names ------------------------------------------------------------------------------------


def serve(talk: Talk, name: str, blocks: bytes, code: int = 0) -> int:
    """A PI service and its answer; return its flag of a block that was not loaded."""
    talk.ask(events.service(95, name, blocks))
    talk.tell(events.answered(95, 0x28, code))
    return talk.transactions[-1]._flags & NOT_LOADED


@pytest.mark.parametrize("code", [0, 0xD241])
@pytest.mark.parametrize(
    ("names", "not_loaded"),
    [
        (("0A00001P",), False),
        (("0A00002P",), True),
        (("0A00001P", "0A00002P"), True),
        (("0A00002P", "0A00001P"), True),
    ],
)
def test_the_activation_of_a_block_that_was_not_loaded(
    talk: Talk, names: tuple[str, ...], not_loaded: bool, code: int
) -> None:
    """Whether it is refused or not, and wherever that block stands among others."""
    load(talk)
    assert bool(serve(talk, "_INSE", events.blocks(*names), code)) is not_loaded
    loaded = talk.transactions[-1].connection.traits.loaded
    activated = "0A00001P" in names and not code
    assert [one.due for one in loaded.values()] == [not activated]
    assert [bool(one.frame) for one in loaded.values()] == [activated]
    assert (", not activated" in repr(next(iter(loaded.values())))) is not activated


def test_a_service_of_another_kind_activates_nothing(talk: Talk) -> None:
    load(talk)
    serve(talk, "_GARB", events.blocks("0A00001P"))
    (loaded,) = talk.transactions[-1].connection.traits.loaded.values()
    assert (loaded.due, loaded.frame, loaded.deleted) == (True, 0, False)


def test_a_block_counts_as_activated_by_the_packet_of_the_request(talk: Talk) -> None:
    load(talk)
    serve(talk, "_INSE", events.blocks("0A00001P"))
    (loaded,) = talk.transactions[-1].connection.traits.loaded.values()
    download = only(talk)
    assert loaded.frame == talk.transactions[-1].request_frame
    assert (loaded.frames, loaded.time_ns) == ([download.first_frame, download.last_frame], download.end_ns)
    assert repr(loaded) == f"Activation(DB 1, passive, packet {loaded.frame})"


@pytest.mark.parametrize("captured", [True, False])
def test_what_was_loaded_before_the_capture_is_not_missed(captured: bool) -> None:
    talk = Talk()
    if captured:
        talk.open()
    else:
        talk.ask(events.start_upload(1))
        talk.tell(events.upload_started(1))
    assert bool(serve(talk, "_INSE", events.blocks("0A00001P"))) is captured


# ---- pieces ---------------------------------------------------------------------------------------------------------


def test_the_content_of_a_download_and_an_upload_is_that_of_its_pieces(talk: Talk) -> None:
    load(talk)
    read_out(talk)
    down, up = talk.operations
    assert down.content == b"".join(bytes(index & 0xFF for index in range(1, size + 1)) for size in (222, 222, 56))
    assert up.content == b"".join(bytes(index & 0xFF for index in range(1, size + 1)) for size in (222, 78))
    assert (down.gap, up.gap, down.begun, up.begun) == (-1, -1, True, True)


def test_a_piece_that_is_shorter_than_it_says_leaves_a_gap(talk: Talk) -> None:
    talk.ask(events.request_download(1, size=100))
    talk.tell(events.answered(1, 0x1A))
    talk.tell(events.download_block(10))
    talk.ask(ack_data(10, b"\x1b\0", b"\0\x64\0\xfb" + bytes(30)))
    talk.tell(events.download_ended(90))
    talk.ask(events.answered(90, 0x1C))
    told = only(talk)
    assert (told.octets, told.gap, len(told.content)) == (100, 30, 30)


def test_pieces_on_both_sides_of_a_gap_are_told_apart(talk: Talk) -> None:
    talk.ask(events.request_download(1, size=150))
    talk.tell(events.answered(1, 0x1A))
    for number in (10, 11, 12):
        talk.tell(events.download_block(number))
        piece = events.piece(number, 0x1B, 50, number < 12)
        if number == 11:
            talk.lose(CLIENT, piece)
        else:
            talk.ask(piece)
    talk.tell(events.download_ended(90))
    talk.ask(events.answered(90, 0x1C))
    talk.finish()
    told = only(talk)
    assert (told.octets, told.gap, oddities(told)) == (100, 50, [])


def test_a_piece_that_is_refused_ends_the_transfer(talk: Talk) -> None:
    talk.ask(events.start_upload(1))
    talk.tell(events.upload_started(1, 7))
    talk.ask(events.upload(2, 7))
    talk.tell(events.answered(2, 0x1E, 0xD241))
    assert (only(talk).result, only(talk).error_code) == ("failed", 0xD241)
    talk.ask(events.request_download(3))
    talk.tell(events.answered(3, 0x1A))
    talk.tell(events.download_block(10))
    talk.ask(events.answered(10, 0x1B, 0xD242))
    assert (talk.operations[1].result, talk.operations[1].error_code) == ("failed", 0xD242)


def test_an_upload_asks_on_after_its_last_piece(talk: Talk) -> None:
    talk.ask(events.start_upload(1))
    talk.tell(events.upload_started(1, 7, 444))
    for number, more in ((2, False), (3, True)):
        talk.ask(events.upload(number, 7))
        talk.tell(events.piece(number, 0x1E, 222, more))
    talk.ask(events.end_upload(5, 7))
    talk.tell(events.answered(5, 0x1F))
    told = only(talk)
    assert [(one.name, one.frame) for one in told.oddities] == [("beyond_end", 12), ("cut_short", 14)]
    assert told.oddities[1].detail == "ended after 444 bytes although more was announced"


def test_a_transfer_of_another_size_than_announced_is_said_with_both(talk: Talk) -> None:
    read_out(talk, announced=301)
    told = only(talk)
    assert [(one.name, one.detail) for one in told.oddities] == [("wrong_size", "300 bytes, 301 announced")]


@pytest.mark.parametrize(("text", "announced"), [("0000300", 300), ("00003x0", -1), ("\u0663", -1)])
def test_a_size_that_is_no_number_is_not_believed(talk: Talk, text: str, announced: int) -> None:
    octets = text.encode("utf-8")
    talk.ask(events.start_upload(1))
    talk.tell(ack_data(1, b"\x1d\0\x01\0\0\0\0\x07" + bytes((len(octets),)) + octets))
    talk.close()
    assert only(talk).announced == announced


def test_two_uploads_of_one_id_are_two(talk: Talk) -> None:
    for number in (1, 5):
        talk.ask(events.start_upload(number))
        talk.tell(events.upload_started(number, 7))
    talk.ask(events.end_upload(9, 7))
    talk.tell(events.answered(9, 0x1F))
    assert [(one.result, one.reason) for one in talk.operations] == [("unfinished", "restarted"), ("done", "")]


def test_an_upload_that_is_refused(talk: Talk) -> None:
    talk.ask(events.start_upload(1))
    talk.tell(events.answered(1, 0x1D, 0xD241))
    assert (only(talk).result, only(talk).error_code) == ("refused", 0xD241)


def test_a_gap_before_a_transfer_is_none_in_it(talk: Talk) -> None:
    talk.lose(CLIENT, job(7, b"\x29" + bytes(5)))
    talk.packet(SERVER)
    talk.ask(events.service(8, "_GARB", b""))
    talk.tell(events.answered(8, 0x28))
    for _ in range(2):
        talk.packet(CLIENT)
        talk.packet(SERVER, after_ns=60_000_000)
    load(talk)
    (told,) = [one for one in talk.operations if one.kind == "download"]
    assert told.connection.tcp.has_holes
    assert (told.result, told.octets, told.gap) == ("done", 500, -1)
