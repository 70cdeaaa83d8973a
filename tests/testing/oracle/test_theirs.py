"""Wireshark's side: its JSON trees, as tshark writes them, turned into facts."""

from __future__ import annotations

from typing import Any

import pytest

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
    FieldPlace,
    LocatedValue,
)
from dissect.testing.oracle.theirs import Frame, Tree, listed

FRAME: Tree = {
    "frame.number": "12",
    "frame.protocols": "eth:ethertype:ip:tcp:tpkt:cotp:s7comm",
    "frame.len": "80",
    "frame.cap_len": "80",
}


def raw(octets: str, at: int, mask: int = 0) -> list[Any]:
    return [octets, at, len(octets) // 2, mask, 4]


def tpkt(at: int, length: int) -> tuple[Tree, list[Any]]:
    header = f"0300{length:04x}"
    tree: Tree = {
        "tpkt.version_raw": raw("03", at),
        "tpkt.version": "3",
        "tpkt.reserved_raw": raw("00", at + 1),
        "tpkt.reserved": "0",
        "tpkt.length_raw": raw(header[4:], at + 2),
        "tpkt.length": str(length),
    }
    return tree, raw(header, at)


def data_tpdu(at: int) -> tuple[Tree, list[Any]]:
    tree: Tree = {
        "cotp.li_raw": raw("02", at),
        "cotp.li": "2",
        "cotp.type_raw": raw("f0", at + 1),
        "cotp.type": "0x0f",
        "cotp.destref": "0x0001",
        "cotp.tpdu-number_raw": raw("0", at + 2, 127),
        "cotp.tpdu-number": "0x00",
        "cotp.eot_raw": raw("1", at + 2, 128),
        "cotp.eot": "1",
    }
    return tree, raw("02f080", at)


def layers(tpkts: list[tuple[Tree, list[Any]]], cotps: list[tuple[Tree, list[Any]]]) -> Tree:
    """The layers of a packet as tshark prints them: a list only where there are several."""
    tree: Tree = {"frame": FRAME}
    for name, found in (("tpkt", tpkts), ("cotp", cotps)):
        if len(found) == 1:
            tree[name], tree[f"{name}_raw"] = found[0]
        elif found:
            tree[name] = [one for one, _ in found]
            tree[f"{name}_raw"] = [its for _, its in found]
    return tree


def s7(parameters: Tree, data: Tree) -> Tree:
    """The layers of a packet with one S7 PDU, at octet 61, of this parameter block and data block."""
    tree = layers([tpkt(54, 7)], [data_tpdu(58)])
    tree["s7comm_raw"] = raw("32", 61)
    tree["s7comm"] = {
        "s7comm.param_raw": raw("00", 71),
        "s7comm.param": parameters,
        "s7comm.data_raw": raw("00", 80),
        "s7comm.data": data,
    }
    return tree


HEADING: list[Any] = ["00", 90, 1, 0, 0]


def test_a_body_is_taken_whole() -> None:
    """Fields in trees in lists of trees, bits by their number, others by their octets; each by its position."""
    parameters: Tree = {"s7comm.param.func_raw": raw("1d", 71), "s7comm.param.func": "0x1d"}
    record: Tree = {
        "s7comm.data.ts_raw": raw("0019200102030405", 86),
        "s7comm.data.ts": "Jan  1, 2020",
        "s7comm.data.ts_tree": {"s7comm.data.ts_reserved_raw": raw("00", 86), "s7comm.data.ts_reserved": "0x00"},
    }
    second: Tree = {"s7comm.data.ts_reserved_raw": raw("01", 96), "s7comm.data.ts_reserved": "0x01"}
    data: Tree = {
        "Some text": record,
        "s7comm.data.userdata.szl_data_tree_raw": [HEADING, HEADING],
        "s7comm.data.userdata.szl_data_tree": [{}, second],
        "s7comm.data.fillbyte_raw": ["3", 99, 1, 0x0F, 4],
        "s7comm.data.fillbyte": "3",
        "s7comm.data.transportsize_raw": ["field length invalid!", 103, 1, 0, 4],
        "s7comm.data.transportsize": "0x00",
        "s7comm.resp.data_raw": ["", 100, 0, 0, 30],
        "s7comm.resp.data": "",
        "s7comm.of.a.newer.version_raw": [raw("01", 101), raw("02", 102)],
        "s7comm.of.a.newer.version": ["1", "2"],
    }
    (found,) = Frame(s7(parameters, data)).pdus
    assert found.facts == {
        FieldPlace(IN_PARAMETERS, 0, "s7comm.param.func"): LocatedValue(0x1D, 10),
        FieldPlace(IN_BODY, 25, "s7comm.data.ts_reserved"): LocatedValue(b"\x00", 25),
        FieldPlace(IN_BODY, 35, "s7comm.data.ts_reserved"): LocatedValue(b"\x01", 35),
        FieldPlace(IN_BODY, 38, "s7comm.data.fillbyte"): LocatedValue(3, 38),
        **{place: fact for place, fact in found.facts.items() if place.name == "s7comm.data.ts"},
    }
    assert found.other["s7comm.of.a.newer.version"] == 2
    assert "s7comm.data.userdata.szl_data_tree" not in +found.other, "a heading is no field"
    assert found.joined == b""


def test_what_wireshark_joins_counts_from_its_own_beginning() -> None:
    data: Tree = {"s7comm.data.ts_reserved_raw": raw("00", 4), "s7comm.data.ts_reserved": "0x00"}
    tree = s7({}, data)
    tree["s7comm"]["s7comm.fragments_raw"] = raw("0011223344", 0)
    (found,) = Frame(tree).pdus
    assert found.joined == bytes.fromhex("0011223344")
    assert found.facts == {FieldPlace(IN_JOINED, 4, "s7comm.data.ts_reserved"): LocatedValue(b"\x00", 4)}


@pytest.mark.parametrize(("value", "expected"), [(None, []), ("1", ["1"]), (["1", "2"], ["1", "2"]), ({}, [{}])])
def test_listed(value: object, expected: list[object]) -> None:
    assert listed(value) == expected


def test_data_tpdu() -> None:
    frame = Frame(layers([tpkt(54, 9)], [data_tpdu(58)]))
    assert (frame.number, frame.cut, "s7comm" in frame.protocols) == (12, False, True)
    (record,) = frame.tpdus
    assert record.octets == bytes.fromhex("0300000902f080")
    assert record.facts == {
        FieldPlace(IN_TPKT, 0, "tpkt.version"): LocatedValue(3, 0),
        FieldPlace(IN_TPKT, 0, "tpkt.reserved"): LocatedValue(0, 1),
        FieldPlace(IN_TPKT, 0, "tpkt.length"): LocatedValue(9, 2),
        FieldPlace(IN_TPDU, 0, "cotp.li"): LocatedValue(2, 0),
        FieldPlace(IN_TPDU, 0, "cotp.type"): LocatedValue(15, 1),
        FieldPlace(IN_TPDU, 0, "cotp.tpdu-number"): LocatedValue(0, 2),
        FieldPlace(IN_TPDU, 0, "cotp.eot"): LocatedValue(1, 2),
    }, "what was not read from the wire, as the reference of a class 0 DT, is no fact"


def test_several_messages_of_a_packet() -> None:
    frame = Frame(layers([tpkt(54, 7), tpkt(61, 7)], [data_tpdu(58), data_tpdu(65)]))
    assert [record.octets.hex() for record in frame.tpdus] == ["0300000702f080", "0300000702f080"]
    assert [record.facts[FieldPlace(IN_TPDU, 0, "cotp.type")] for record in frame.tpdus] == [LocatedValue(15, 1)] * 2


def test_a_tpkt_without_tpdu_does_not_take_that_of_the_next() -> None:
    frame = Frame(layers([tpkt(54, 5), tpkt(59, 7)], [data_tpdu(63)]))
    assert [record.octets.hex() for record in frame.tpdus] == ["03000005", "0300000702f080"]
    assert frame.tpdus[0].value(IN_TPDU, "cotp.li") is None


def test_what_is_no_tpkt_is_no_record() -> None:
    tree = layers([tpkt(54, 5), ({"tpkt.continuation_data": "d0:80"}, raw("d080", 59))], [])
    assert len(Frame(tree).tpdus) == 1


def test_cut_packet() -> None:
    tree = layers([tpkt(54, 7)], [data_tpdu(58)])
    tree["frame"] = {**FRAME, "frame.cap_len": "60"}
    assert Frame(tree).cut


@pytest.mark.parametrize("text", ["1", "True", "true", "0x01"])
def test_newer_versions_write_booleans_as_words(text: str) -> None:
    tree = layers([tpkt(54, 7)], [data_tpdu(58)])
    tree["cotp"]["cotp.eot"] = text
    assert Frame(tree).tpdus[0].value(IN_TPDU, "cotp.eot") == 1


def test_parameters_of_a_connect_request() -> None:
    cotp: Tree = {
        "cotp.li_raw": raw("0e", 58),
        "cotp.li": "14",
        "cotp.parameter_code_raw": [raw("c1", 65), raw("c1", 69)],
        "cotp.parameter_code": ["0xc1", "0xc1"],
        "cotp.parameter_length_raw": [raw("02", 66), raw("02", 70)],
        "cotp.parameter_length": ["2", "2"],
        "cotp.src-tsap-bytes_raw": [raw("0100", 67), raw("0200", 71)],
        "cotp.src-tsap-bytes": ["01:00", "02:00"],
    }
    record = Frame(layers([tpkt(54, 19)], [(cotp, raw("0e" + "00" * 14, 58))])).tpdus[0]
    assert record.facts[FieldPlace(IN_PARAMETER, 1, "cotp.parameter_code")] == LocatedValue(0xC1, 7)
    assert record.facts[FieldPlace(IN_PARAMETER, 2, "cotp.parameter_length")] == LocatedValue(2, 12)
    assert record.facts[FieldPlace(IN_TPDU, 0, "cotp.src-tsap-bytes")] == LocatedValue(b"\x02\x00", 13), (
        "the last one counts"
    )


def pdu(rosctr: str, parameters: Tree, data: Tree | None = None) -> Tree:
    tree: Tree = {
        "s7comm.header_raw": raw("32" + "00" * 9, 61),
        "s7comm.header": {
            "s7comm.header.rosctr_raw": raw("01", 62),
            "s7comm.header.rosctr": rosctr,
            "s7comm.header.pduref_raw": raw("0102", 65),
            "s7comm.header.pduref": "258",
        },
        "s7comm.param_raw": raw("00", 71),
        "s7comm.param": parameters,
    }
    if data is not None:
        tree["s7comm.data_raw"] = raw("00", 90)
        tree["s7comm.data"] = data
    return {"frame": FRAME, "s7comm": tree, "s7comm_raw": raw("320000", 61)}


def test_items_of_a_request() -> None:
    items = [
        {"s7comm.param.item.db_raw": raw("0001", at + 6), "s7comm.param.item.db": str(number)}
        for number, at in enumerate((73, 85), 1)
    ]
    parameters: Tree = {
        "s7comm.param.itemcount_raw": raw("02", 72),
        "s7comm.param.itemcount": "2",
        "s7comm.param.item_raw": [raw("12", 73), raw("12", 85)],
        "s7comm.param.item": items,
    }
    (record,) = Frame(pdu("1", parameters)).pdus
    assert record.octets == b"\x32\x00\x00"
    assert record.facts == {
        FieldPlace(IN_HEADER, 0, "s7comm.header.rosctr"): LocatedValue(1, 1),
        FieldPlace(IN_HEADER, 0, "s7comm.header.pduref"): LocatedValue(258, 4),
        FieldPlace(IN_PARAMETERS, 0, "s7comm.param.itemcount"): LocatedValue(2, 11),
        FieldPlace(IN_ITEM, 1, "s7comm.param.item.db"): LocatedValue(1, 18),
        FieldPlace(IN_ITEM, 2, "s7comm.param.item.db"): LocatedValue(2, 30),
    }


def test_data_items_of_an_answer() -> None:
    item = {
        "s7comm.data.returncode_raw": raw("ff", 90),
        "s7comm.data.returncode": "0xff",
        "s7comm.resp.data_raw": raw("0a0b", 94),
        "s7comm.resp.data": "0a:0b",
    }
    data: Tree = {"s7comm.data.item_raw": raw("ff", 90), "s7comm.data.item": item}
    record = Frame(pdu("3", {}, data)).pdus[0]
    assert {place: fact for place, fact in record.facts.items() if place.part != IN_HEADER} == {
        FieldPlace(IN_DATA_ITEM, 1, "s7comm.data.returncode"): LocatedValue(0xFF, 29),
        FieldPlace(IN_DATA_ITEM, 1, "s7comm.resp.data"): LocatedValue(b"\x0a\x0b", 33),
    }


def test_the_old_head_of_userdata_counts_as_the_new_one() -> None:
    old: Tree = {
        "s7comm.param.userdata.head_raw": raw("000112", 71),
        "s7comm.param.userdata.head": "0x000112",
        "s7comm.param.userdata.length_raw": raw("04", 74),
        "s7comm.param.userdata.length": "4",
        "s7comm.param.userdata.reqres1_raw": raw("11", 75),
        "s7comm.param.userdata.reqres1": "0x11",
    }
    new: Tree = {
        "s7comm.param.func_raw": raw("00", 71),
        "s7comm.param.func": "0x00",
        "s7comm.param.itemcount_raw": raw("01", 72),
        "s7comm.param.itemcount": "1",
        "s7comm.param.item.varspec_raw": raw("12", 73),
        "s7comm.param.item.varspec": "0x12",
        "s7comm.param.item.varspec_length_raw": raw("04", 74),
        "s7comm.param.item.varspec_length": "4",
        "s7comm.param.item.syntaxid_raw": raw("11", 75),
        "s7comm.param.item.syntaxid": "0x11",
    }
    told = [Frame(pdu("7", parameters)).pdus[0].facts for parameters in (old, new)]
    assert told[0] == told[1]
    assert len(told[0]) == 7


def test_of_userdata_the_first_head_is_that_of_the_data() -> None:
    data: Tree = {
        "s7comm.data.returncode_raw": [raw("ff", 90), raw("0a", 101)],
        "s7comm.data.returncode": ["0xff", "0x0a"],
        "s7comm.data.item_raw": raw("ff", 96),
        "s7comm.data.item": {"s7comm.data.returncode_raw": raw("05", 96), "s7comm.data.returncode": "0x05"},
    }
    record = Frame(pdu("7", {}, data)).pdus[0]
    assert {place: fact for place, fact in record.facts.items() if place.part != IN_HEADER} == {
        FieldPlace(IN_DATA, 0, "s7comm.data.returncode"): LocatedValue(0xFF, 29),
        FieldPlace(IN_BODY, 35, "s7comm.data.returncode"): LocatedValue(b"\x05", 35),
        FieldPlace(IN_BODY, 40, "s7comm.data.returncode"): LocatedValue(b"\x0a", 40),
    }
