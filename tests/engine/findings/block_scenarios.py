"""Scenarios of the rules about blocks."""

from __future__ import annotations

from captures.craft.mc7 import DAY, DB2, OB1, OB1_CHANGED, Network, code_block
from tests.engine.findings import events
from tests.engine.findings.registry import silent, speaks
from tests.engine.transactions.talk import CLIENT, FIN, Talk, ack_data

#: A call of FC 9, the same with a jump around it, and a write to an output.
CALLS = code_block(0x08, 1, [Network("FB700009 700B0002")], "")
SKIPS = code_block(0x08, 1, [Network("C000 FFB80006 FB700009 700B0002 0000", 2)], "")
WRITES = code_block(0x08, 1, [Network("FB700009 700B0002 D884")], "")
#: The block as it was two months before.
OLDER = code_block(0x08, 1, [], "", changed=(DAY - 60, DAY - 60))


def pieces(talk: Talk, function: int, octets: bytes, asks: bool) -> None:
    """Carry a block in pieces of 60 octets, each requested by the PLC (``asks``) or by the client."""
    for number, at in enumerate(range(0, len(octets), 60), 100):
        piece = octets[at : at + 60]
        more = int(at + 60 < len(octets))
        answer = ack_data(number, bytes((function, more)), len(piece).to_bytes(2, "big") + b"\0\xfb" + piece)
        if asks:
            talk.tell(events.download_block(number, "_0800001P"))
            talk.ask(answer)
        else:
            talk.ask(events.upload(number))
            talk.tell(answer)


def load(talk: Talk, octets: bytes, activate: bool = True) -> None:
    """Load a block as OB 1, and activate it."""
    talk.ask(events.request_download(1, "_0800001P", len(octets)))
    talk.tell(events.answered(1, 0x1A))
    pieces(talk, 0x1B, octets, True)
    talk.tell(events.download_ended(90, "_0800001P"))
    talk.ask(events.answered(90, 0x1C))
    if activate:
        talk.ask(events.service(2, "_INSE", events.blocks("0800001P")))
        talk.tell(events.answered(2, 0x28))


def read_out(talk: Talk, octets: bytes, name: str = "_0800001A") -> None:
    """Read a block out."""
    talk.ask(events.start_upload(1, name))
    talk.tell(events.upload_started(1, 7, len(octets)))
    pieces(talk, 0x1E, octets, False)
    talk.ask(events.end_upload(50, 7))
    talk.tell(events.answered(50, 0x1F))


@silent(
    "block.changed", "block.differs", "block.older", "block.not_activated", "block.inconsistent", "block.system_call",
    "block.output_write", "block.skipped_call",
)  # fmt: skip
def the_same_program(talk: Talk) -> None:
    """The loaded program equals the one read out before except for time and author, and a later read-out has other values."""
    talk.open()
    read_out(talk, OB1)
    load(talk, OB1[:20] + b"\x38\xa5" + OB1[22:-36] + b"huber\0\0\0" + OB1[-28:])
    read_out(talk, OB1)
    read_out(talk, DB2, "_0A00002A")
    read_out(talk, DB2[:36] + b"\xff" + DB2[37:], "_0A00002A")
    talk.packet(CLIENT, flags=FIN)
    talk.close()


@speaks("block.not_activated")
def loaded_and_left(talk: Talk) -> None:
    talk.open()
    load(talk, OB1, activate=False)
    read_out(talk, OB1_CHANGED)  # which still runs
    talk.packet(CLIENT, flags=FIN)
    talk.close()


@speaks("block.changed")
def another_logic_is_loaded(talk: Talk) -> None:
    talk.open()
    read_out(talk, OB1)
    load(talk, OB1_CHANGED)


@speaks("block.differs")
def another_one_runs(talk: Talk) -> None:
    talk.open()
    load(talk, OB1)
    read_out(talk, OB1_CHANGED)


@speaks("block.older")
def an_old_backup_is_loaded(talk: Talk) -> None:
    talk.open()
    read_out(talk, OB1)
    load(talk, OLDER)


@speaks("block.inconsistent")
def code_was_injected(talk: Talk) -> None:
    """A call before the code; lengths of block and code are corrected, tables left unchanged."""
    injected = bytes.fromhex("FB70 0063 700B 0002")
    size, code = len(OB1) + len(injected), 30 + len(injected)
    talk.open()
    load(talk, OB1[:8] + size.to_bytes(4, "big") + OB1[12:34] + code.to_bytes(2, "big") + injected + OB1[36:])


@speaks("block.system_call")
def it_stops_the_cpu(talk: Talk) -> None:
    talk.open()
    read_out(talk, OB1)
    load(talk, OB1_CHANGED)


@speaks("block.output_write")
def it_writes_an_output(talk: Talk) -> None:
    talk.open()
    read_out(talk, CALLS)
    load(talk, WRITES)


@speaks("block.skipped_call")
def a_call_is_jumped_over(talk: Talk) -> None:
    talk.open()
    read_out(talk, CALLS)
    load(talk, SKIPS)
