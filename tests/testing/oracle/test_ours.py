"""Our side: facts of messages made up octet by octet, against values written down here."""

from __future__ import annotations

import struct
from pathlib import Path
from random import Random

from dissect.testing.oracle.facts import (
    IN_BODY,
    IN_DATA,
    IN_DATA_ITEM,
    IN_HEADER,
    IN_ITEM,
    IN_JOINED,
    IN_PARAMETER,
    IN_PARAMETERS,
    IN_TPDU,
    IN_TPKT,
    PDU,
    TPDU,
    FieldPlace,
    LocatedValue,
)
from dissect.testing.oracle.ours import Witness, pdu_record, take_joined, tpdu_record
from tests.build import dt, pdu, tpdu
from tests.testing.oracle.traffic import PUSH_ACK, Connection, connect, parameter, setup, write_capture


def at(part: str, name: str, number: int = 0) -> FieldPlace:
    return FieldPlace(part, number, name)


def test_connect_request() -> None:
    octets = tpdu(
        struct.pack(">BHHB", 0xE0, 0, 0x1234, 0),
        parameter(0xC0, b"\x0a") + parameter(0xC1, b"\x01\x00") + parameter(0xF0, b"\x04") + parameter(0xC2, b""),
    )
    record = tpdu_record(4, octets)
    assert (record.kind, record.frame, record.octets) == (TPDU, 4, octets)
    assert record.facts == {
        at(IN_TPKT, "tpkt.version"): LocatedValue(3, 0),
        at(IN_TPKT, "tpkt.reserved"): LocatedValue(0, 1),
        at(IN_TPKT, "tpkt.length"): LocatedValue(len(octets), 2),
        at(IN_TPDU, "cotp.li"): LocatedValue(18, 0),
        at(IN_TPDU, "cotp.type"): LocatedValue(0xE, 1),
        at(IN_TPDU, "cotp.destref"): LocatedValue(0, 2),
        at(IN_TPDU, "cotp.srcref"): LocatedValue(0x1234, 4),
        at(IN_TPDU, "cotp.class"): LocatedValue(0, 6),
        at(IN_PARAMETER, "cotp.parameter_code", 1): LocatedValue(0xC0, 7),
        at(IN_PARAMETER, "cotp.parameter_length", 1): LocatedValue(1, 8),
        at(IN_TPDU, "cotp.tpdu_size"): LocatedValue(1024, 9),
        at(IN_PARAMETER, "cotp.parameter_code", 2): LocatedValue(0xC1, 10),
        at(IN_PARAMETER, "cotp.parameter_length", 2): LocatedValue(2, 11),
        at(IN_TPDU, "cotp.src-tsap-bytes"): LocatedValue(b"\x01\x00", 12),
        at(IN_PARAMETER, "cotp.parameter_code", 3): LocatedValue(0xF0, 14),
        at(IN_PARAMETER, "cotp.parameter_length", 3): LocatedValue(1, 15),
        at(IN_TPDU, "cotp.preferred_maximum_tpdu_size"): LocatedValue(512, 16),
        at(IN_PARAMETER, "cotp.parameter_code", 4): LocatedValue(0xC2, 17),
        at(IN_PARAMETER, "cotp.parameter_length", 4): LocatedValue(0, 18),
    }


def test_user_data_is_no_part_of_a_tpdu() -> None:
    record = tpdu_record(1, dt(b"2payload", number=5))
    assert record.octets == bytes.fromhex("0300000f02f085")
    assert record.value(IN_TPDU, "cotp.eot") == 1
    assert record.value(IN_TPDU, "cotp.tpdu-number") == 5


def test_write_request() -> None:
    item = b"\x12\x0a\x10\x02\x00\x03\x00\x01\x84\x00\x00\x50"
    record = pdu_record(
        9, pdu(1, 0x0203, b"\x05\x02" + item + b"\x12\x03\x55ab", b"\x00\x09\x00\x03abc\x77\x00\x04\x00\x10de")
    )
    item_at, data_at = 12, 29
    assert record.octets[:1] == b"2"
    assert {place: fact for place, fact in record.facts.items() if place.part != IN_HEADER} == {
        at(IN_PARAMETERS, "s7comm.param.func"): LocatedValue(5, 10),
        at(IN_PARAMETERS, "s7comm.param.itemcount"): LocatedValue(2, 11),
        at(IN_ITEM, "s7comm.param.item.varspec", 1): LocatedValue(0x12, item_at),
        at(IN_ITEM, "s7comm.param.item.varspec_length", 1): LocatedValue(10, item_at + 1),
        at(IN_ITEM, "s7comm.param.item.syntaxid", 1): LocatedValue(0x10, item_at + 2),
        at(IN_ITEM, "s7comm.param.item.transp_size", 1): LocatedValue(2, item_at + 3),
        at(IN_ITEM, "s7comm.param.item.length", 1): LocatedValue(3, item_at + 4),
        at(IN_ITEM, "s7comm.param.item.db", 1): LocatedValue(1, item_at + 6),
        at(IN_ITEM, "s7comm.param.item.area", 1): LocatedValue(0x84, item_at + 8),
        at(IN_ITEM, "s7comm.param.item.address", 1): LocatedValue(0x50, item_at + 9),
        at(IN_ITEM, "s7comm.param.item.varspec", 2): LocatedValue(0x12, item_at + 12),
        at(IN_ITEM, "s7comm.param.item.varspec_length", 2): LocatedValue(3, item_at + 13),
        at(IN_ITEM, "s7comm.param.item.syntaxid", 2): LocatedValue(0x55, item_at + 14),
        at(IN_DATA_ITEM, "s7comm.data.returncode", 1): LocatedValue(0, data_at),
        at(IN_DATA_ITEM, "s7comm.data.transportsize", 1): LocatedValue(9, data_at + 1),
        at(IN_DATA_ITEM, "s7comm.data.length", 1): LocatedValue(3, data_at + 2),
        at(IN_DATA_ITEM, "s7comm.resp.data", 1): LocatedValue(b"abc", data_at + 4),
        at(IN_DATA_ITEM, "s7comm.data.fillbyte", 1): LocatedValue(0x77, data_at + 7),
        at(IN_DATA_ITEM, "s7comm.data.returncode", 2): LocatedValue(0, data_at + 8),
        at(IN_DATA_ITEM, "s7comm.data.transportsize", 2): LocatedValue(4, data_at + 9),
        at(IN_DATA_ITEM, "s7comm.data.length", 2): LocatedValue(16, data_at + 10),
        at(IN_DATA_ITEM, "s7comm.resp.data", 2): LocatedValue(b"de", data_at + 12),
    }


def test_write_answer_has_return_codes_only() -> None:
    record = pdu_record(1, pdu(3, 1, b"\x05\x02", b"\xff\x05", error=0x8104))
    assert record.value(IN_HEADER, "s7comm.header.errcls") == 0x81
    assert record.value(IN_HEADER, "s7comm.header.errcod") == 0x04
    assert {place: fact for place, fact in record.facts.items() if place.part == IN_DATA_ITEM} == {
        at(IN_DATA_ITEM, "s7comm.data.returncode", 1): LocatedValue(0xFF, 14),
        at(IN_DATA_ITEM, "s7comm.data.returncode", 2): LocatedValue(0x05, 15),
    }


def test_userdata() -> None:
    parameters = b"\x00\x01\x12\x08\x12\xa0\x03\x07\x09\x01\xd4\x02"
    record = pdu_record(1, pdu(7, 1, parameters, b"\xff\x09\x00\x02xy"))
    told = {place.name: fact for place, fact in record.facts.items() if place.part in {IN_PARAMETERS, IN_DATA}}
    assert told == {
        "s7comm.param.func": LocatedValue(0, 10),
        "s7comm.param.itemcount": LocatedValue(1, 11),
        "s7comm.param.item.varspec": LocatedValue(0x12, 12),
        "s7comm.param.item.varspec_length": LocatedValue(8, 13),
        "s7comm.param.item.syntaxid": LocatedValue(0x12, 14),
        "s7comm.param.userdata.type": LocatedValue(2, 15),
        "s7comm.param.userdata.funcgroup": LocatedValue(0x20, 15),
        "s7comm.param.userdata.subfunc": LocatedValue(3, 16),
        "s7comm.param.userdata.seq_num": LocatedValue(7, 17),
        "s7comm.param.userdata.dataunitref": LocatedValue(9, 18),
        "s7comm.param.userdata.lastdataunit": LocatedValue(1, 19),
        "s7comm.param.errcod": LocatedValue(0xD402, 20),
        "s7comm.data.returncode": LocatedValue(0xFF, 22),
        "s7comm.data.transportsize": LocatedValue(9, 23),
        "s7comm.data.length": LocatedValue(2, 24),
    }


def test_a_body_is_told_by_position() -> None:
    parameters = b"\x00\x01\x12\x08\x12\x87\x01\x02\x00\x00\x00\x00"
    clock = b"\x00\x19" + bytes.fromhex("1602081451379162")
    record = pdu_record(1, pdu(7, 1, parameters, b"\xff\x09\x00\x0a" + clock))
    assert {place: fact for place, fact in record.facts.items() if place.part == IN_BODY} == {
        at(IN_BODY, "s7comm.data.ts_reserved", 26): LocatedValue(b"\x00", 26),
        at(IN_BODY, "s7comm.data.ts_year1", 27): LocatedValue(b"\x19", 27),
        at(IN_BODY, "s7comm.data.ts", 28): LocatedValue(clock[2:], 28),
    }


def test_an_answer_in_parts_is_read_from_the_joined_octets() -> None:
    """The last part of two: alone it has no structure, and its own octets no names."""
    parameters = b"\x00\x01\x12\x08\x12\x87\x01\x02\xd5\x00\x00\x00"
    clock = b"\x00\x19" + bytes.fromhex("1602081451379162")
    record = pdu_record(1, pdu(7, 1, parameters, b"\xff\x09\x00\x04" + clock[6:]))
    before = {place: fact for place, fact in record.facts.items() if place.part != IN_BODY}
    take_joined(record, clock)
    assert {place: fact for place, fact in record.facts.items() if place not in before} == {
        at(IN_JOINED, "s7comm.data.ts_reserved", 0): LocatedValue(b"\x00", 0),
        at(IN_JOINED, "s7comm.data.ts_year1", 1): LocatedValue(b"\x19", 1),
        at(IN_JOINED, "s7comm.data.ts", 2): LocatedValue(clock[2:], 2),
    }
    assert before.items() <= record.facts.items()


def test_values_are_those_of_the_objects_people_get() -> None:
    """A field whose object says something else than its octets is told as the object has it."""
    record = pdu_record(1, pdu(1, 1, b"\x04\x01\x12\x0a\x10\x1d\x00\x01\x00\x00\x1d\xff\x00\x05"))
    assert record.value(IN_ITEM, "s7comm.param.item.address", 1) == 0xFF0005


def test_witness_keeps_everything_in_order_and_finds_the_port(tmp_path: Path) -> None:
    rng = Random(3)
    connection = Connection(rng, 1, port=10102)
    connection.open()
    messages = [
        connect(rng, 0xE0, 0),
        connect(rng, 0xD0, 1),
        dt(setup(rng, 1, 1)),
        dt(b"", eot=False) + dt(setup(rng, 3, 1)),
    ]
    for number, message in enumerate(messages):
        connection.put(number % 2, PUSH_ACK, message)
    witness = Witness(str(write_capture(tmp_path / "made.pcap", connection.packets)))
    assert witness.ports == {10102}
    assert [frame for frame, _ in witness.messages[TPDU]] == [4, 5, 6, 7, 7]
    assert b"".join(octets for _, octets in witness.messages[TPDU]) == b"".join(messages)
    assert [frame for frame, _ in witness.messages[PDU]] == [6, 7]
    first, second = witness.records(PDU, [0, 1])
    assert (first.number, first.frame, second.number, second.frame) == (0, 6, 1, 7)


def test_port_102_needs_no_telling(tmp_path: Path) -> None:
    connection = Connection(Random(1), 1)
    connection.put(0, PUSH_ACK, connect(Random(1), 0xE0, 0))
    witness = Witness(str(write_capture(tmp_path / "made.pcap", connection.packets)))
    assert witness.ports == set()
    assert len(witness.messages[TPDU]) == 1
