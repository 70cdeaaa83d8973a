"""Scenarios of the rules about operations."""

from __future__ import annotations

from tests.engine.findings import events
from tests.engine.findings.registry import silent, speaks
from tests.engine.transactions.talk import CLIENT, FIN, RST, SERVER, Talk


def load(
    talk: Talk, *, sizes: tuple[int, ...] = (222, 222, 56), announced: int = 500, last: int = -1, code: int = 0
) -> None:
    """Load DB 1: the PLC requests each piece, the last of which is marked as such, unless ``last`` names another."""
    talk.ask(events.request_download(1, size=announced))
    talk.tell(events.answered(1, 0x1A))
    for number, size in enumerate(sizes):
        talk.tell(events.download_block(number + 10))
        more = number != (len(sizes) - 1 if last < 0 else last)
        talk.ask(events.piece(number + 10, 0x1B, size, more))
    talk.tell(events.download_ended(90, code=code))
    talk.ask(events.answered(90, 0x1C))


def read_out(talk: Talk, *, sizes: tuple[int, ...] = (222, 78), announced: int = 300, upload_id: int = 7) -> None:
    """Read DB 1 out."""
    talk.ask(events.start_upload(1))
    talk.tell(events.upload_started(1, upload_id, announced))
    for number, size in enumerate(sizes):
        talk.ask(events.upload(2 + number, upload_id))
        talk.tell(events.piece(2 + number, 0x1E, size, number + 1 < len(sizes)))
    talk.ask(events.end_upload(50, upload_id))
    talk.tell(events.answered(50, 0x1F))


@silent(
    "operation.beyond_end",
    "operation.cut_short",
    "operation.failed",
    "operation.not_loaded",
    "operation.unfinished",
    "operation.upload_unfinished",
    "operation.wrong_id",
    "operation.wrong_size",
    "operation.stray_push",
)
def all_goes_well(talk: Talk) -> None:
    """A block is loaded and activated, another read out twice, values and messages are subscribed to."""
    talk.open()
    load(talk)
    talk.ask(events.service(2, "_INSE", events.blocks("0A00001P")))
    talk.tell(events.answered(2, 0x28))
    read_out(talk)
    read_out(talk, upload_id=8)
    talk.ask(events.asks(3, 2, 1, events.CYCLIC))
    talk.tell(events.tells(3, 2, 1, events.CYCLIC_VALUES, sequence=5))
    talk.tell(events.pushes(2, 1, events.CYCLIC_VALUES, sequence=5))
    talk.ask(events.asks(4, 4, 2, events.SUBSCRIBE))
    talk.tell(events.tells(4, 4, 2, b"\x02\x00", sequence=6))
    talk.tell(events.mode(2))
    talk.close()
    results = [(one.kind, one.result, one.octets, one.announced) for one in talk.operations]
    assert results == [
        ("connect", "done", 0, -1),
        ("download", "done", 500, 500),
        ("upload", "done", 300, 300),
        ("upload", "done", 300, 300),
        ("cyclic", "running", 16, -1),
        ("messages", "running", 0, -1),
    ]


@speaks("operation.failed")
def the_plc_cannot_store_it(talk: Talk) -> None:
    talk.open()
    load(talk, code=0xD2A0)
    load(talk, code=0x8104)
    talk.pipeline.exchange.report_findings()
    details = [finding.detail for finding in talk.findings if finding.slug == "operation.failed"]
    assert [detail.partition(": ")[2] for detail in details] == [
        "0xd2a0 block functions (error class 0xd2)",
        "0x8104 Service not implemented or frame error",
    ]


@speaks("operation.unfinished")
def the_line_breaks_in_between(talk: Talk) -> None:
    talk.open()
    talk.ask(events.request_download(1))
    talk.tell(events.answered(1, 0x1A))
    talk.tell(events.download_block(10))
    talk.ask(events.piece(10, 0x1B, 222, more=True))
    talk.packet(SERVER, flags=RST)


@speaks("operation.upload_unfinished")
def the_line_breaks_while_a_block_is_read(talk: Talk) -> None:
    talk.open()
    talk.ask(events.start_upload(1))
    talk.tell(events.upload_started(1))
    talk.ask(events.upload(2))
    talk.tell(events.piece(2, 0x1E, 222, more=True))
    talk.packet(SERVER, flags=RST)


@speaks("operation.wrong_id")
def another_upload_is_named(talk: Talk) -> None:
    talk.open()
    talk.ask(events.start_upload(1))
    talk.tell(events.upload_started(1, 7))
    talk.ask(events.upload(2, 8))
    talk.tell(events.answered(2, 0x1E, 0xD203))
    talk.packet(CLIENT, flags=FIN)


@speaks("operation.beyond_end")
def more_than_the_last_piece(talk: Talk) -> None:
    talk.open()
    load(talk, last=1)


@speaks("operation.wrong_size")
def less_than_announced(talk: Talk) -> None:
    talk.open()
    load(talk, announced=600)


@speaks("operation.cut_short")
def ended_before_the_last_piece(talk: Talk) -> None:
    talk.open()
    load(talk, last=9)


@speaks("operation.not_loaded")
def somebody_elses_block_is_activated(talk: Talk) -> None:
    talk.open()
    talk.ask(events.service(2, "_INSE", events.blocks("0A00002P")))
    talk.tell(events.answered(2, 0x28))


@speaks("operation.stray_push")
def values_nobody_wants(talk: Talk) -> None:
    talk.open()
    talk.tell(events.pushes(2, 1, events.CYCLIC_VALUES, sequence=5))
