"""Nothing malformed hides something sound: one odd frame of each kind between good ones, and no good PDU goes missing."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Final

import pytest

from dissect.engine.transactions.side import Side
from tests.cases import each
from tests.cli.support import run
from tests.engine.test_ibh import Link
from tests.engine.transactions.talk import (
    CLIENT,
    Talk,
    ack_data,
    dbw,
    dt,
    job,
    read,
    tpkt,
    words,
    write,
    written,
)
from tests.meaning.bindings import plant
from tests.meaning.bindings.test_streams import a_side
from tests.meaning.bindings.test_streams import cut as cut_messages
from tests.meaning.report.support import begun, saved
from tests.protocols.ibh import packets as ibh
from tests.protocols.s7plus import pdus as plus

FIRST: Final = read(1, dbw(1, 0))
STOP: Final = job(2, b"\x29" + bytes(5) + b"\x09P_PROGRAM")
STOPPED: Final = ack_data(2, b"\x29")
LAST: Final = read(3, dbw(1, 4))


def lying(pdu: bytes, more: int) -> bytes:
    """A TPKT with a DT whose length is wrong by ``more``."""
    made = dt(pdu)
    return made[:2] + struct.pack(">H", len(made) + more) + made[4:]


def changed(packet: bytes, more: int) -> bytes:
    """An IBH-NetLink packet whose length is wrong by ``more``."""
    return packet[:2] + bytes((packet[2] + more,)) + packet[3:]


def with_li(li: int, rest: bytes) -> bytes:
    return tpkt(bytes((li, 0xF0)) + rest)


#: A write of 600 octets of which a part is sent: a client that gave up and began anew.
LONG: Final = dt(write(9, [dbw(1, 0, 300)], written(4, bytes(600))))

_WRONG: Final = (-24, -20, -10, -1, 1, 4, 7, 10, 16, 17, 30, 31, 62, 300, 4000, 60000)
ODD: Final[dict[str, bytes]] = {
    **{f"empty DT with LI {li}": with_li(li, b"\x80") for li in (0, 1, *range(3, 17), 254, 255)},
    **{f"DT with LI {li} and octets": with_li(li, b"\x80" + b"\x01\x02\x03" * 9) for li in (0, 1, *range(3, 17), 255)},
    **{f"DT with LI {li}, EOT clear": with_li(li, b"\x00" + b"\x01\x02\x03" * 9) for li in (0, 1, *range(3, 17), 255)},
    **{f"TPDU of type {code}": tpkt(bytes((2, code << 4, 0x80))) for code in range(15)},
    **{f"TPDU of type {code}, LI 6": tpkt(bytes((6, code << 4, 0, 0, 0, 0, 0))) for code in range(15) if code != 0xE},
    "TPDU of one octet and one": tpkt(b"\x01\xf0"),
    "RDP negotiation": tpkt(b"\x0e\xd0\x00\x00\x12\x34\x00\x02\x00\x08\x00\x02\x00\x00\x00"),
    "EOT clear and never set": dt(b"\x01\x02\x03")[:6] + b"\x00\x01\x02\x03",
    "a whole PDU, EOT clear": dt(read(8, dbw(2, 0)))[:6] + b"\x00" + read(8, dbw(2, 0)),
    **{f"TPKT length {length}": b"\x03\x00" + struct.pack(">H", length) for length in range(7)},
    **{f"TPKT length {length} with a TPDU": b"\x03\x00" + struct.pack(">H", length) + b"\x02\xf0\x80" for length in range(7)},
    **{f"TPKT length wrong by {more}": lying(FIRST, more) for more in _WRONG},
    **{f"empty DT, length wrong by {more}": lying(b"", more) for more in (1, 4, 10, 16, 17, 23, 30, 4000, 65528)},
    **{f"header only, length {length}": b"\x03\x00" + struct.pack(">H", length) for length in (7, 20, 27, 35, 4096, 65535)},
    **{f"{size} octets of a header": b"\x03\x00\x00\x1f\x02\xf0"[:size] for size in range(1, 7)},
    "TPKT with reserved octet": b"\x03\x01\x00\x07\x02\xf0\x80",
    "TPKT version 4": b"\x04\x00\x00\x07\x02\xf0\x80",
    "junk": b"\x55" * 9,
    "half a write": LONG[:200],
    "S7 header alone": dt(b"\x32\x01"),
    "S7 lengths too long": dt(b"\x32\x01\x00\x00\x00\x09\x00\xff\x00\xff\x04\x00"),
    "unknown ROSCTR": dt(b"\x32\x05\x00\x00\x00\x09\x00\x00\x00\x00"),
    "unexpected bytes after a PDU": dt(read(8, dbw(2, 0)) + b"\x99" * 7),
    "unknown protocol": dt(b"\x99" * 40),
}  # fmt: skip
#: Of these nothing is wrong for itself, or nobody can tell.
FINE: Final = frozenset(("empty DT with LI 3", "unknown protocol"))


class Watch(Talk):
    """A talk that keeps the PDUs it was told of."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_pdus = True
        self.pdus: list[bytes] = []

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        self.pdus.append(octets)

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        self.pdus.append(octets)


def split(pieces: list[bytes], how: str) -> list[bytes]:
    if how == "segments":
        return pieces
    octets = b"".join(pieces)
    return [octets] if how == "one segment" else [bytes((octet,)) for octet in octets]


HOW: Final = ("segments", "one segment", "octets")


@each("how", HOW)
@each("odd", ODD)
def test_no_good_pdu_goes_missing(odd: str, how: str) -> None:
    talk = Watch()
    talk.open()
    talk.findings.clear()
    for piece in split([dt(FIRST), ODD[odd], dt(STOP), dt(LAST)], how):
        talk.packet(CLIENT, piece)
    talk.tell(words(1, 7), STOPPED, words(3, 8))
    talk.close()
    if odd == "half a write" and how != "segments":
        return  # no segment begins anew in it: the device as well reads on
    told = [pdu for pdu in talk.pdus if pdu in {FIRST, STOP, LAST}]
    assert told[:1] + told[-2:] == [FIRST, STOP, LAST]
    assert [found.slug for found in talk.findings].count("security.plc_stop") == 1
    if odd not in FINE:
        assert {slug.split(".")[0] for slug in talk.slugs()} & {"tpkt", "cotp", "s7", "session"}, "no anomaly is told"


@pytest.mark.parametrize("odd", ["TPKT length wrong by 31", "empty DT with LI 1", "half a write", "RDP negotiation"])
def test_fail_on_sees_a_stop_behind_an_odd_frame(
    capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path, odd: str
) -> None:
    talk = begun().send(0, ODD[odd]).send(0, dt(STOP)).send(1, dt(STOPPED))
    ran = run(capfdbinary, "analyze", "--fail-on", "security.plc_stop", saved(tmp_path / "x.pcapng", talk.packets()))
    assert ran.code == 1


@pytest.mark.parametrize(
    "before",
    [
        [(CLIENT, tpkt(b"\x0e\xe0\x00\x00\x12\x34\x00\x01\x00\x08\x00\x02\x00\x00\x00"))],
        [(CLIENT, b"GET / HTTP/1.1\r\n\r\n")] * 70,
    ],
    ids=["an RDP connect request", "something else"],
)
def test_no_other_protocol_hides_what_follows(before: list[tuple[int, bytes]]) -> None:
    talk = Watch()
    talk.hello()
    for side, octets in before:
        talk.packet(side, octets)
    talk.ask(STOP)
    talk.tell(STOPPED)
    talk.close()
    assert talk.pdus == [STOP, STOPPED]
    assert "security.plc_stop" in talk.slugs()


# ---- IBH-NetLink ----------------------------------------------------------------------------------------------------

IBH_ODD: Final = {
    **{f"length wrong by {more}": changed(ibh.ACK, more) for more in (-7, -3, -1, 1, 5, 8, 20, 100, 200)},
    **{
        f"data, length wrong by {more}": changed(ibh.short(0xF1, read(8, dbw(2, 0))), more)
        for more in (-9, -1, 1, 8, 20, 100)
    },
    "junk": b"\x55" * 9,
    "header alone": b"\x07\xff\xff",
    "half a packet": ibh.short(0xF1, bytes(200))[:90],
    "part of a message": ibh.short(0xF0, b"\x01\x02\x03"),
    "unknown service": ibh.packet(b"\x01\x02", 0x7777),
}


@each("how", HOW)
@each("odd", IBH_ODD)
def test_no_good_pdu_goes_missing_in_a_gateway(odd: str, how: str) -> None:
    link = Link()
    link.begin()
    for piece in split([ibh.short(0xF1, FIRST), IBH_ODD[odd], ibh.short(0xF1, STOP), ibh.short(0xF1, LAST)], how):
        link.packet(CLIENT, piece)
    if odd == "half a packet" and how != "segments":
        return
    told = [pdu for pdu, _ in link.pdus if pdu in {FIRST, STOP, LAST}]
    assert told == [FIRST, STOP, LAST]


# ---- S7comm-plus ----------------------------------------------------------------------------------------------------

PLUS_GOOD: Final = [plus.framed(plus.asked(number)) for number in (1, 2, 3)]
PLUS_ODD: Final = {
    "no trailer": plus.framed(b"\x01\x02\x03", trailer=False),
    "a beginning without its end": plus.framed(plus.asked(9), trailer=False),
    "a beginning of another version": plus.framed(plus.asked(9), version=3, trailer=False),
    "length too long": b"\x72\x02\x00\xff" + plus.asked(9),
    "length too short": b"\x72\x02\x00\x02" + plus.asked(9),
    "header alone": b"\x72\x02",
    "empty": b"\x72\x02\x00\x00",
    "keep-alive": plus.KEEP_ALIVE,
    "event": plus.event(7),
}


@pytest.mark.parametrize("odd", PLUS_ODD)
def test_no_good_pdu_goes_missing_in_s7comm_plus(odd: str) -> None:
    talk = Watch()
    talk.open()
    talk.pdus.clear()
    for pdu in (PLUS_GOOD[0], PLUS_ODD[odd], PLUS_GOOD[1], PLUS_GOOD[2]):
        talk.ask(pdu)
    talk.close()
    told = [
        pdu.removeprefix(PLUS_ODD["empty"]) for pdu in talk.pdus
    ]  # an empty frame belongs to the PDU that comes next
    assert [pdu for pdu in told if pdu in PLUS_GOOD] == PLUS_GOOD


@pytest.mark.parametrize("version", [2, 3])
def test_a_pdu_in_several_frames_is_still_one(version: int) -> None:
    talk = Watch()
    talk.open()
    talk.pdus.clear()
    data = plus.asked(4, body=bytes(range(200)))
    parts = [plus.framed(data[:90], version, False), plus.framed(data[90:150], version, False)]
    parts.append(plus.framed(data[150:], version))
    for part in parts:
        talk.ask(part)
    talk.close()
    assert talk.pdus == [b"".join(parts)]


# ---- SCD over TCP ---------------------------------------------------------------------------------------------------

ASK_SCD: Final = plant.ask("\u0420\u0430\u0441\u0445\u043e\u0434 1")
_SIZE_AT: Final = 4


def resized(more: int) -> bytes:
    """A message whose size field is wrong, and with it its checksum."""
    size = int.from_bytes(ASK_SCD[_SIZE_AT : _SIZE_AT + 2], "little") + more
    return ASK_SCD[:_SIZE_AT] + size.to_bytes(2, "little") + ASK_SCD[_SIZE_AT + 2 :]


SCD_ODD: Final = {
    "junk": b"\x55" * 9,
    "opening alone": ASK_SCD[:3],
    "half a message": ASK_SCD[:-4],
    "a wrong checksum": ASK_SCD[:-1] + bytes((ASK_SCD[-1] ^ 1,)),
    **{f"size wrong by {more}": resized(more) for more in (-5, -1, 1, 3, 8, len(ASK_SCD), 1000)},
}


@each("how", ["segments", "one segment"])
@each("odd", SCD_ODD)
def test_no_good_message_goes_missing(odd: str, how: str) -> None:
    side = a_side(synced=True)
    found, _ = cut_messages(side, *split([ASK_SCD, SCD_ODD[odd], ASK_SCD, ASK_SCD], how))
    assert found.count(ASK_SCD) == 3
