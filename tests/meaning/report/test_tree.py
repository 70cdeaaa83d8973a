from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.meaning.report import tree as tree_module
from dissect.meaning.report.tree import tpdu_tree_lines, tree_lines
from dissect.protocols.s7 import layouts
from dissect.protocols.s7.message import parse_pdu
from tests.meaning.report.support import UNSAFE, WORD
from tests.properties import messages
from tests.properties.messages import Item, dt

ROW = re.compile(r" {6} *(?:(\d+)(?:-(\d+))?)? {2}(\S.{15,}?) (.*)")


def tree(pdu: bytes, cut: bool = False) -> list[str]:
    """Return the tree of a PDU that one DT carries."""
    return list(tree_lines(parse_pdu(pdu, cut=cut), b"" if cut else dt(pdu)))


def forget() -> None:
    """Forget what the trees before have left to those that come."""
    for kept in (tree_module._heads, tree_module._headers_kept, tree_module._bodies, tree_module._parts):
        kept.clear()


def rows(lines: list[str]) -> list[tuple[range, str, str]]:
    """Return the fields of a tree: octets, name, what they say."""
    found = []
    for line in lines[: lines.index("")]:  # the hex view stands below
        match = ROW.fullmatch(line)
        if match:
            first = int(match[1]) if match[1] else -1
            found.append((range(first, int(match[2] or first) + 1), match[3].strip(), match[4]))
    return found


#: A line of the hex view; bytes that are hidden are stars in it.
_HEX_ROW = r" {4} *\d+ {2}(?:[0-9a-f]{2}|\*\*) "


def value_of(lines: list[str], name: str) -> list[str]:
    return [said for _, field, said in rows(lines) if field == name]


def covered(lines: list[str]) -> list[int]:
    """Return the octets that fields stand for, in order, each once however many fields share it."""
    told: list[int] = []
    for octets, _, _ in rows(lines):
        if octets.start >= 0:
            told.extend([octet for octet in octets if octet not in told])
    return told


def view(lines: list[str]) -> bytes:
    """Return the octets of the hex view."""
    return bytes.fromhex("".join([line[11:59] for line in lines if re.match(_HEX_ROW, line)]))


def test_a_read_request_field_by_field() -> None:
    lines = tree(messages.read_job(0x0102, [WORD]))
    assert [(octets.start, octets.stop - 1, name, said) for octets, name, said in rows(lines)] == [
        (0, 0, "version", "3"),
        (1, 1, "reserved", "0x00"),
        (2, 3, "length", "31"),
        (4, 4, "li", "2"),
        (5, 5, "type", "0xf DT"),
        (5, 5, "credit", "0"),
        (6, 6, "eot", "1"),
        (6, 6, "tpdu_nr", "0"),
        (7, 7, "protocol_id", "0x32"),
        (8, 8, "rosctr", "0x01 Job"),
        (9, 10, "redundancy_id", "0x0000"),
        (11, 12, "pdu_ref", "0x0102"),
        (13, 14, "param_length", "14"),
        (15, 16, "data_length", "0"),
        (17, 17, "function", "0x04 Read Var"),
        (18, 18, "item_count", "1"),
        (19, 19, "specification", "0x12"),
        (20, 20, "length", "10"),
        (21, 21, "syntax_id", "0x10 S7ANY"),
        (22, 22, "transport_size", "0x04 WORD"),
        (23, 24, "count", "1"),
        (25, 26, "db", "10"),
        (27, 27, "area", "0x84 data block"),
        (28, 30, "address", "0x000020"),
    ]
    assert "    item 1: DB10.DBW4" in lines
    assert view(lines) == dt(messages.read_job(0x0102, [WORD]))


ODD = Item(0x02, 3, 1, 0x84, 0)
PDUS = {
    "setup": messages.setup(messages.JOB, 1),
    "setup answer": messages.setup(messages.ACK_DATA, 1),
    "read": messages.read_job(1, [WORD, ODD]),
    "read answer": messages.read_answer(1, [WORD, WORD], [b"\x00\x01", b"\x00\x02"]),
    "write": messages.write_job(1, [WORD, WORD], [b"\x00\x01", b"\x00\x02"]),
    "write answer": messages.write_answer(1, [255, 10]),
    "refusal": messages.pdu(messages.ACK, 1, b"", b"", 0xD241),
    "service": messages.pdu(messages.JOB, 1, b"\x2a" + bytes(20)),
    "service with data": messages.pdu(messages.JOB, 1, b"\x2a" + bytes(20), bytes(5)),
    "userdata": messages.userdata(1, 1, 4, 1, b"\x00\x11\x00\x00"),
    "userdata answer": messages.userdata(1, 2, 4, 1, bytes.fromhex("0000000000020010") + bytes(32)),
    "userdata without payload": messages.userdata(1, 2, 4, 1, b"", 0xD402),
    "mode transition": messages.pdu(messages.USERDATA, 0, b"\x01\x00\x10\x10\x00\x00\x00\x00"),
    "other syntax": messages.pdu(messages.JOB, 1, b"\x04\x01\x12\x08\xb0\x01\x00\x02\x00\x03\x00\x04"),
}


@pytest.mark.parametrize("pdu", PDUS.values(), ids=PDUS)
def test_the_fields_stand_for_every_octet_once_and_in_order(pdu: bytes) -> None:
    lines = tree(pdu)
    packet = dt(pdu)
    assert covered(lines) == list(range(len(packet)))
    assert view(lines) == packet
    assert lines[-1] == ""
    assert not [line for line in lines if "MALFORMED" in line]


def test_the_octet_that_makes_an_item_even_is_called_so() -> None:
    lines = tree(messages.read_answer(1, [ODD, WORD], [b"abc", b"\x00\x02"]))
    packet = dt(messages.read_answer(1, [ODD, WORD], [b"abc", b"\x00\x02"]))
    assert covered(lines) == list(range(len(packet)))
    (fill,) = [octets.start for octets, name, _ in rows(lines) if name == "fill"]
    assert packet[fill - 3 : fill] == b"abc"
    assert value_of(lines, "data") == ["61 62 63", "00 02"]


@pytest.mark.parametrize(
    ("pdu", "field", "said"),
    [
        ("setup", "pdu_length", "480"),
        ("write", "data", "00 01"),
        ("write answer", "item 2", "0x0a Object does not exist"),
        ("refusal", "error", "0xd241 Not permitted in current protection level. "),
        ("service", "octets", "00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 … 20 bytes"),
        ("userdata", "subfunction", "0x01 read SZL"),
        ("userdata", "group", "0x04 CPU functions"),
        ("userdata answer", "return_code", "0xff Success"),
        ("userdata without payload", "error_code", "0xd402 Invalid SZL index"),
        ("mode transition", "mode", "0x00 STOP"),
        ("other syntax", "octets", "01 00 02 00 03 00 04"),
    ],
)
def test_what_fields_say(pdu: str, field: str, said: str) -> None:
    assert any(told.startswith(said.strip()) for told in value_of(tree(PDUS[pdu]), field))


def test_data_items_of_a_write_are_named_by_their_address() -> None:
    assert "    data item 2: DB10.DBW4" in tree(PDUS["write"])
    assert "    data item 2" in tree(PDUS["read answer"])


def test_codes_nobody_knows_are_numbers() -> None:
    lines = tree(messages.pdu(messages.JOB, 1, b"\x04\x01\x12\x0a\x10\x77\x00\x01\x00\x00\x99\x00\x00\x00"))
    assert value_of(lines, "transport_size") == ["0x77 (not in the tables)"]
    assert value_of(lines, "area") == ["0x99 (not in the tables)"]


def test_a_pdu_in_several_fragments_counts_from_its_own_first_octet() -> None:
    pdu = messages.read_job(1, [WORD])
    lines = list(tree_lines(parse_pdu(pdu), b""))
    assert lines[0] == "    reassembled from several COTP fragments; offsets count from the start of the S7 PDU"
    assert rows(lines)[0] == (range(1), "protocol_id", "0x32")
    assert covered(lines) == list(range(len(pdu)))
    assert view(lines) == pdu


def test_an_empty_dt_before_the_pdu_changes_no_offset() -> None:
    lines = tree(messages.read_job(1, [WORD]))
    assert rows(lines)[8][:2] == (range(7, 8), "protocol_id")


@pytest.mark.parametrize("kept", [1, 2, 9, 10, 11, 12, 15, 23])
def test_a_cut_pdu_shows_what_is_there(kept: int) -> None:
    pdu = messages.read_job(1, [WORD])[:kept]
    lines = tree(pdu, cut=True)
    assert lines[0] == "    truncated by the capture; offsets count from the start of the S7 PDU"
    assert view(lines) == pdu
    assert set(covered(lines)) <= set(range(kept))


def test_offsets_of_what_is_malformed_are_those_of_the_tree() -> None:
    pdu = bytearray(messages.read_job(1, [WORD]))
    pdu[7] = 99
    lines = tree(bytes(pdu))
    (told,) = [line for line in lines if "MALFORMED" in line]
    octets = next(octets for octets, name, _ in rows(lines) if name == "param_length")
    assert told.endswith(f" (byte {octets.start} here)")
    (told,) = [line for line in list(tree_lines(parse_pdu(bytes(pdu)), b"")) if "MALFORMED" in line]
    assert f"at byte {octets.start - 7} " in told


# ---- TPDUs ----------------------------------------------------------------------------------------------------------


def test_a_connect_request_with_its_parameters() -> None:
    packet = messages.connect(0xE0, called=b"SIMATIC\x1b-ROOT")
    lines = list(tpdu_tree_lines(packet))
    said = {name: (octets, value) for octets, name, value in rows(lines)}
    assert said["type"][1] == "0xe CR"
    assert said["TPDU size"][1] == "0a"
    assert said["calling TSAP"] == (range(14, 18), "01 00")
    assert said["called TSAP"][1].startswith("53 49 4d")
    assert covered(lines) == list(range(len(packet)))
    assert view(lines) == packet
    assert not [line for line in lines if UNSAFE.search(line)]


def test_user_data_of_another_protocol() -> None:
    packet = dt(b"\x72\x01" + bytes(30))
    lines = list(tpdu_tree_lines(packet))
    assert rows(lines)[-1] == (range(7, 39), "user data", "72 01 " + "00 " * 13 + "00 … 32 bytes")
    assert covered(lines) == list(range(len(packet)))


@pytest.mark.parametrize(
    "tpdu", [b"\x01\x80", b"\x06\x80\x00\x01", b"\x02\x70\x00", b"\xff\xe0", b"\x00", b"", b"\x05\x30aaaa"]
)
def test_a_damaged_tpdu_has_a_tree(tpdu: bytes) -> None:
    lines = list(tpdu_tree_lines(messages.tpkt(tpdu)))
    assert [line for line in lines if "MALFORMED" in line]
    assert view(lines) == messages.tpkt(tpdu)


# ---- any octets -----------------------------------------------------------------------------------------------------


@given(st.binary(max_size=60), st.booleans(), st.sampled_from([b"", *PDUS.values()]), st.integers(0, 40))
def test_any_octets_have_a_tree(octets: bytes, cut: bool, begin: bytes, kept: int) -> None:
    pdu = b"\x32" + (begin[1:kept] + octets)
    lines = tree(pdu, cut)
    whole = pdu if cut else dt(pdu)
    hidden = [line for line in lines if re.match(_HEX_ROW, line) and "**" in line[11:59]]
    assert hidden or view(lines) == whole  # what may be a password is not shown
    assert not [line for line in lines if UNSAFE.search(line)]
    assert all(octet < len(dt(pdu)) for octet in covered(lines))


def test_what_is_kept_of_a_tree_is_not_taken_for_another_one() -> None:
    """A PDU that differs in one octet from the one before has the tree that it has alone."""
    pdu = PDUS["read answer"]
    before = tree(pdu)
    for at in range(len(pdu)):
        other = pdu[:at] + bytes((pdu[at] ^ 1,)) + pdu[at + 1 :]
        for cut in (False, True):
            forget()
            alone = tree(other, cut)
            forget()
            assert tree(pdu) == before
            assert tree(other, cut) == alone == tree(other, cut)


@given(st.binary(max_size=60))
def test_any_tpdu_has_a_tree(octets: bytes) -> None:
    lines = list(tpdu_tree_lines(messages.tpkt(octets)))
    assert view(lines) == messages.tpkt(octets)
    assert not [line for line in lines if UNSAFE.search(line)]


def test_every_layout_of_the_tree_has_names_that_fit_their_column() -> None:
    for layout in (layouts.S7ANY_ITEM, layouts.USERDATA_EXTENDED, layouts.SETUP, layouts.MODE_TRANSITION):
        assert max(len(field.name) for field in layout.fields) <= 16
