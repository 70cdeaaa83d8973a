"""Blocks of an S7-300 that are uploaded and downloaded, piece by piece (`captures.craft.mc7` has the blocks)."""

from __future__ import annotations

from typing import Final

from captures.craft.case import Case, crafts
from captures.craft.mc7 import DB2, FC3, OB1, OB1_CHANGED
from captures.craft.pdus import (
    DOWNLOAD_BLOCK,
    DOWNLOAD_ENDED,
    PI_SERVICE,
    REQUEST_DOWNLOAD,
    ack_data,
    job,
)
from captures.craft.talk import SERVER, Talk
from captures.craft.worked import END_UPLOAD, START_UPLOAD, UPLOAD

PIECE: Final = 90


@crafts(
    "A program is read out, two blocks at once, changed, loaded and read out again; one block is loaded and never "
    "activated, of one only the beginning is read."
)
def program(case: Case) -> None:
    talk = Talk(case)
    talk.begin()
    first, second = Upload(talk, "0800001A", 7, OB1), Upload(talk, "0A00002A", 8, DB2)
    while first.step() | second.step():
        pass
    download(talk, "0800001P", OB1_CHANGED)
    activate(talk, "0800001P")
    download(talk, "0C00003P", FC3)
    again = Upload(talk, "0800001A", 9, OB1_CHANGED)
    while again.step():
        pass
    cut = Upload(talk, "0A00002A", 10, DB2)
    cut.step()
    cut.step()
    talk.close()
    case.find("security.program_read", 4)
    case.find("security.program_change", 3)  # two downloads, _INSE
    case.find("block.changed")
    case.find("block.system_call")
    case.find("block.not_activated")
    case.find("operation.upload_unfinished")


class Upload:
    """A block that comes from the PLC piece by piece; `step` captures the next request with its answer."""

    def __init__(self, talk: Talk, name: str, number: int, octets: bytes) -> None:
        self.talk = talk
        self.name = name
        self.session = number.to_bytes(4, "big")
        self.octets = octets
        self.at = -1

    def step(self) -> bool:
        """Capture a step; return False if there is none left."""
        talk, ref, octets = self.talk, self.talk.next_ref(), self.octets
        if self.at < 0:
            asked = job(ref, START_UPLOAD, bytes(7) + text_of(f"_{self.name}"))
            length = b"\x00\x01\x00" + self.session + text_of(f"{len(octets):07d}")
            talk.exchange(START_UPLOAD, asked, ack_data(ref, START_UPLOAD, length))
            self.at = 0
        elif self.at < len(octets):
            piece = octets[self.at : self.at + PIECE]
            self.at += len(piece)
            more = bytes((self.at < len(octets),))
            given = len(piece).to_bytes(2, "big") + b"\x00\xfb" + piece
            talk.exchange(UPLOAD, job(ref, UPLOAD, bytes(3) + self.session), ack_data(ref, UPLOAD, more, given))
        elif self.at == len(octets):
            talk.exchange(END_UPLOAD, job(ref, END_UPLOAD, bytes(3) + self.session), ack_data(ref, END_UPLOAD))
            self.at += 1
        else:
            return False
        return True


def download(talk: Talk, name: str, octets: bytes) -> None:
    """A block goes to the PLC, which requests it piece by piece."""
    named = text_of(f"_{name}")
    number = talk.next_ref()
    mc7 = int.from_bytes(octets[34:36], "big")
    lengths = text_of(f"1{len(octets):06d}{mc7:06d}")
    asked = job(number, REQUEST_DOWNLOAD, bytes.fromhex("00010000000000") + named + lengths)
    talk.exchange(REQUEST_DOWNLOAD, asked, ack_data(number, REQUEST_DOWNLOAD))
    for at in range(0, len(octets), PIECE):
        piece = octets[at : at + PIECE]
        number = talk.next_ref()
        given = len(piece).to_bytes(2, "big") + b"\x00\xfb" + piece
        answer = ack_data(number, DOWNLOAD_BLOCK, bytes((at + PIECE < len(octets),)), given)
        talk.exchange(DOWNLOAD_BLOCK, job(number, DOWNLOAD_BLOCK, bytes(7) + named), answer, SERVER)
    number = talk.next_ref()
    talk.exchange(
        DOWNLOAD_ENDED, job(number, DOWNLOAD_ENDED, bytes(7) + named), ack_data(number, DOWNLOAD_ENDED), SERVER
    )


def activate(talk: Talk, name: str) -> None:
    """The PI service _INSE with one block."""
    number = talk.next_ref()
    insert = bytes(6) + b"\xfd\x00\x0a\x01\x00" + name.encode("ascii") + text_of("_INSE")
    talk.exchange(PI_SERVICE, job(number, PI_SERVICE, insert), ack_data(number, PI_SERVICE))


def text_of(text: str) -> bytes:
    """A text with its length before it."""
    return bytes([len(text)]) + text.encode("ascii")
