"""Requests and answers as octets."""

from __future__ import annotations

import pytest

from dissect.protocols.s7.message import parse_pdu
from dissect.testing.messages import (
    Ask,
    Tell,
    answer,
    data,
    dints,
    done,
    done_item,
    dwords,
    error,
    granted,
    ints,
    items,
    job,
    octets,
    push,
    read,
    reals,
    refused,
    setup,
    szl,
    userdata,
    values,
    words,
    write,
)


def said(ask: Ask, tell: Tell) -> str:
    return tell.build(parse_pdu(ask.octets)).hex()


@pytest.mark.parametrize(
    ("ask", "octets_of_it"),
    [
        (read("DB10.DBW4"), "32010000000000 0e0000 0401 120a10040001000a84000020"),
        (read("DB10.DBW4 WORD"), "32010000000000 0e0000 0401 120a10040001000a84000020"),
        (read("DB10.DBX4.1", "MB20 x3"), "32010000000000 1a0000 0402 120a10010001000a84000021 120a10020003000083 0000a0"),
        (read("T5", "C3 x2"), "32010000000000 1a0000 0402 120a101d000100001d000005 120a101c000200001c000003"),
        (write("DB10.DBW4 INT = -5"), "32010000000000 0e0006 0501 120a10050001000a84000020 00050010 fffb"),
        (
            write("M0.0 = true", "MB2 = 7"),
            "32010000000000 1a000b 0502 120a10010001000083000000 120a10020001000083000010 00030001 01 00 00040008 07",
        ),
        (setup(960, 8, 8), "32010000000000 080000 f000 0008 0008 03c0"),
        (szl(0x11, 2), "32070000000000 080008 0001120411440100 ff090004 0011 0002"),
        (userdata(7, 1), "32070000000000 080004 0001120411470100 0a000000"),
        (push(4, 6, b"\x01"), "32070000000000 0c0005 000112081204060000000000 ff090001 01"),
        (job(b"\x29\x00", b"\x01"), "32010000000000 020001 2900 01"),
    ],
)  # fmt: skip
def test_requests_as_octets(ask: Ask, octets_of_it: str) -> None:
    assert ask.octets.hex() == octets_of_it.replace(" ", "")
    assert parse_pdu(ask.octets).malformed == []


TWO = read("DB1.DBW0", "DB1.DBX2.0")


@pytest.mark.parametrize(
    ("ask", "tell", "octets_of_it"),
    [
        (read("MW0"), words(1234), "0401 ff040010 04d2"),
        (read("MW0 x2"), words(1, 65535), "0401 ff040020 0001ffff"),
        (read("MW0 INT"), ints(-1), "0401 ff050010 ffff"),
        (read("MD0"), dwords(1), "0401 ff040020 00000001"),
        (read("MD0 DINT"), dints(-2), "0401 ff050020 fffffffe"),
        (read("MD0 REAL"), reals(1.5), "0401 ff070004 3fc00000"),
        (read("MD0 REAL"), values(1.5), "0401 ff070004 3fc00000"),
        (read("MB0 CHAR x2"), values("OK"), "0401 ff090002 4f4b"),
        (read("M0.1"), values(True), "0401 ff030001 01"),
        (read("MB0 x3"), octets(b"\x01\x02\x03"), "0401 ff040018 010203"),
        (read("MW0"), refused(), "0401 0a000000"),
        (TWO, items(words(1), refused(0x05)), "0402 ff040010 0001 05000000"),
        (write("MW0 = 1", "MW2 = 2"), done(), "0502 ff ff"),
        (write("MW0 = 1", "MW2 = 2"), items(done_item(), refused(0x05)), "0502 ff 05"),
        (setup(960), granted(240), "f000 0001 0001 00f0"),
        (job(b"\x29\x00"), done(), "29"),
    ],
)
def test_answers_as_octets(ask: Ask, tell: Tell, octets_of_it: str) -> None:
    told = said(ask, tell)
    assert told[24:] == octets_of_it.replace(" ", "")
    assert told.startswith("320300000000")
    assert parse_pdu(bytes.fromhex(told)).malformed == []


def test_answers_to_userdata_and_refusals() -> None:
    assert said(szl(0x11), data(b"\x01\x02")) == "32070000000000 0c0006 000112081284010000000000 ff090002 0102".replace(
        " ", ""
    )
    assert said(szl(0x11), data(code=0xD402))[-12:] == "d402" + "0a000000"
    assert said(szl(0x11), error(0xD402)) == said(szl(0x11), data(code=0xD402))
    assert said(read("MW0"), error()) == "320200000000000000008104"
    assert said(read("MW0"), answer(b"\x32" * 12)) == "32" * 12


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (lambda: read("DB10.DBW4 = 5"), "a read has no values"),
        (lambda: write("DB10.DBW4"), "each item of a write needs a value"),
        (lambda: write("DB10.DBW4 INT = 40000"), "out of range for the type"),
        (lambda: read("X7"), "is not an item|is not an address"),
        (lambda: read("DB1.DBD4 LONG"), "is not a type"),
        (lambda: words(-1), "out of range for the type"),
        (lambda: refused(0xFF), "is not a return code for a refusal"),
        (lambda: Ask(b"\x32"), "at least 10 bytes"),
        (lambda: said(TWO, words(1)), "2 items were requested, the answer has 1"),
        (lambda: said(read("MW0"), words(1, 2)), "MW0 has 2 bytes, the answer 4"),
        (lambda: said(szl(1), words(1)), "only a read or a write has items"),
        (lambda: said(read("MW0"), data(b"\x01")), "is not userdata"),
    ],
)
def test_what_is_written_wrongly_is_told(wrong: object, why: str) -> None:
    assert callable(wrong)
    with pytest.raises(ValueError, match=why):
        wrong()
