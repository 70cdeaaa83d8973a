"""Blocks put together from their transfers: pieces, interleaved transfers, either asker, what is missing, hostile octets."""

from __future__ import annotations

from itertools import zip_longest
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dissect
from captures.craft.mc7 import DB2, FC3, OB1, OB1_CHANGED
from dissect.engine.program.carved import CarvedBlock, block_of, carve, plus_block
from dissect.engine.program.classic import read_classic
from dissect.engine.transactions import operation
from dissect.protocols.s7plus.objects import Attribute, PlusObject, build_object
from dissect.protocols.s7plus.value_tables import BOOL, STRUCT, WORD, WSTRING
from dissect.protocols.s7plus.values import Struct, Value
from tests.engine.program.transfers import Said, activate, carry, download, upload
from tests.engine.transactions.talk import CLIENT, FIN, SERVER, Talk, dt

PLUS = Path(__file__).parents[3] / "captures" / "crafted" / "plus-plant.pcapng"


def carved(*said: list[Said], cuts: tuple[int, ...] = (), close: bool = True) -> list[CarvedBlock]:
    """Return the blocks of PDUs sent one after the other."""
    talk = Talk()
    talk.open()
    for each in said:
        carry(talk, each, *cuts)
    if close:
        talk.packet(CLIENT, flags=FIN)
    talk.finish()
    return [block for one in talk.operations for block in carve(one)]


def mixed(*transfers: list[Said]) -> list[Said]:
    """Interleave transfers, exchange by exchange."""
    pairs = [list(zip(one[::2], one[1::2], strict=True)) for one in transfers]
    return [said for row in zip_longest(*pairs) for pair in row if pair is not None for said in pair]


def test_an_upload_is_the_block() -> None:
    (block,) = carved(upload(OB1, "_0800001A", 7, 33))
    assert (block.label, block.direction, block.octets, block.complete) == ("OB1", "upload", OB1, True)
    assert (block.author, block.family, block.version, block.language) == ("meier", "plant", "1.2", "AWL/STL")
    assert (block.code_time, block.activated) == ("2023-09-13 08:30:00.000", None)
    assert block.parts()["code"] == OB1[36:66]
    assert sum([len(part) for part in block.parts().values()]) == len(OB1)


@pytest.mark.parametrize("asks", [SERVER, CLIENT])
def test_a_download_whoever_asks_for_the_pieces(asks: int) -> None:
    loaded = download(FC3, "_0C00003P", 17, asks=asks)
    (block,) = carved(loaded, activate("0C00003P", 50))
    assert (block.label, block.direction, block.octets, block.activated) == ("FC3", "download", FC3, True)
    (block,) = carved(loaded)
    assert (block.complete, block.activated) == (True, False)


def test_transfers_at_once_on_one_connection() -> None:
    said = mixed(
        upload(OB1, "_0800001A", 7, 20, ref=1000), upload(DB2, "_0A00002A", 8, 31, ref=2000),
        download(FC3, "_0C00003P", 9, ref=3000), download(OB1_CHANGED, "_0800001P", 50, ref=4000),
    )  # fmt: skip
    found = {(block.label, block.direction): block.octets for block in carved(said)}
    assert found == {
        ("OB1", "upload"): OB1,
        ("DB2", "upload"): DB2,
        ("FC3", "download"): FC3,
        ("OB1", "download"): OB1_CHANGED,
    }


def test_what_was_cut_off_is_there_and_said() -> None:
    whole = upload(OB1, "_0800001A", 7, 40)
    (block,) = carved(whole[:6])
    assert (block.octets, block.missing) == (OB1[:80], "80 of 140 bytes")
    assert block.classic is not None
    assert block.classic.missing == 60
    (block,) = carved(download(OB1, "_0800001P", 40)[:8])
    assert (block.octets, block.complete, block.activated) == (OB1[:120], False, None)


def holed(said: list[Said], *lost: int) -> CarvedBlock:
    """Return the block of a transfer of which the capture lacks these PDUs."""
    talk = Talk()
    talk.open()
    for number, (side, pdu) in enumerate(said):
        if number in lost:
            talk.lose(side, pdu)
        else:
            talk.packet(side, dt(pdu))
    talk.close()
    (block,) = [block for one in talk.operations for block in carve(one)]
    return block


@pytest.mark.parametrize("lost", [(5,), (4, 5)])
def test_a_block_ends_at_the_gap_of_its_upload(lost: tuple[int, ...]) -> None:
    block = holed(upload(OB1, "_0800001A", 7, 40), *lost)
    assert (block.octets, block.behind_gap) == (OB1[:40], OB1[80:])
    assert block.missing == "40 of 140 bytes, then a gap; 60 bytes behind it left out, as their place is unknown"
    assert block.parts()["code"] == OB1[36:40]


def test_a_block_ends_at_the_gap_of_its_download() -> None:
    said = download(OB1, "_0800001P", 40)
    assert said[7][0] == CLIENT
    block = holed(said, 7)
    assert (block.label, block.octets, block.behind_gap) == ("OB1", OB1[:80], OB1[120:])
    block = holed(said, 3)
    assert (block.label, block.octets, block.behind_gap) == ("OB1", b"", OB1[40:])
    assert block.missing.startswith("0 of 140 bytes, then a gap; 100 bytes")


def test_of_one_direction_only_the_first_piece_is_sure() -> None:
    talk = Talk()
    for number, (side, pdu) in enumerate(upload(OB1, "_0800001A", 7, 40)):
        if side == SERVER and number != 7:
            talk.packet(side, dt(pdu))
        else:
            talk.lose(side, pdu)
    talk.finish()
    (block,) = [block for one in talk.operations for block in carve(one)]
    assert (block.octets, block.behind_gap) == (OB1[:40], OB1[40:80] + OB1[120:])


def test_a_gap_that_held_no_piece_harms_no_block() -> None:
    said = upload(OB1, "_0800001A", 7, 40)
    other = download(DB2, "_0A00002P", 100, ref=2000)[:2]
    block = holed([*said[:4], *other, *said[4:]], 4, 5)
    assert (block.octets, block.complete, block.behind_gap) == (OB1, True, b"")


def test_contents_without_a_header_are_named_by_the_request() -> None:
    (block,) = carved(download(bytes(60), "_0A00010P"))
    assert (block.label, block.octets, block.classic, block.language) == ("DB10", bytes(60), None, "")
    assert block.parts() == {"values": bytes(60)}


def test_a_file_with_a_path_is_no_block() -> None:
    path = "/_N_MPF_DIR/../../etc/passwd"
    said = upload(b"%_N_X", "_0800001A", 7)
    name = path.encode("ascii")
    said[0] = (
        CLIENT,
        said[0][1][:6] + (9 + len(name)).to_bytes(2, "big") + said[0][1][8:18] + bytes((len(name),)) + name,
    )
    (block,) = carved(said)
    assert (block.kind, block.number, block.label, block.octets) == ("file", -1, path, b"%_N_X")


def test_a_refused_transfer_carries_none() -> None:
    said = download(OB1, "_0800001P")
    assert carved([said[0], (SERVER, said[1][1][:10] + b"\x81\x04" + said[1][1][12:])]) == []


def test_too_much_is_dropped_and_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operation, "MAX_CONTENT", 100)
    if len(carved(upload(OB1, "_0800001A", 7, 40))[0].octets) == len(OB1):
        pytest.skip("compiled constants cannot be changed")
    (block,) = carved(upload(OB1, "_0800001A", 7, 40))
    assert (block.octets, block.missing) == (OB1[:80], "60 bytes were too much to keep")
    monkeypatch.setattr(operation, "MAX_CONTENTS", 100)
    first, second = carved(mixed(upload(OB1, "_0800001A", 7, 40), upload(DB2, "_0A00002A", 8, 40, ref=1000)))
    assert len(first.octets) + len(second.octets) <= 100
    assert not first.complete
    assert not second.complete
    (again,) = carved(upload(OB1[:70], "_0800001A", 7, 40))
    assert len(again.octets) == 70  # what was held is given back


@settings(max_examples=40, deadline=None)
@given(
    octets=st.binary(min_size=1, max_size=300), size=st.integers(1, 120),
    cuts=st.lists(st.integers(1, 200), max_size=6), asks=st.sampled_from((SERVER, CLIENT)),
)  # fmt: skip
def test_any_segmentation_gives_the_same_blocks(octets: bytes, size: int, cuts: list[int], asks: int) -> None:
    said = mixed(upload(octets, "_0800001A", 7, size, ref=1000), download(octets, "_0C00003P", size, 3000, asks))
    plain, cut = carved(said), carved(said, cuts=tuple(cuts))
    assert [block.octets for block in plain] == [octets, octets]
    assert [(block.label, block.direction, block.octets, block.missing) for block in cut] == [
        (block.label, block.direction, block.octets, block.missing) for block in plain
    ]


@settings(max_examples=100, deadline=None)
@given(octets=st.binary(max_size=120), at=st.integers(0, 139), value=st.integers(0, 255))
def test_hostile_octets_never_raise(octets: bytes, at: int, value: int) -> None:
    changed = OB1[:at] + bytes((value,)) + OB1[at + 1 :]
    for block in (
        block_of(octets),
        block_of(b"pp\x01\x01\x01\x08" + octets),
        block_of(changed),
        block_of(changed[:-at]),
    ):
        assert sum([len(part) for part in block.parts().values()]) <= len(block.octets)
        assert isinstance(block.label, str)
    plus_block(octets)
    plus_block(b"\xa1" + octets)


def test_a_header_whose_lengths_lie() -> None:
    octets = OB1[:8] + (0xFFFFFFFF).to_bytes(4, "big") + OB1[12:28] + b"\xff\xff" * 4 + OB1[36:]
    block = read_classic(octets)
    assert block is not None
    assert (block.code, block.interface, block.networks) == (octets[36:], b"", b"")
    assert block.missing == 0xFFFFFFFF - len(octets)


def test_blocks_of_s7comm_plus() -> None:
    found = dissect.blocks(PLUS)
    assert [(one.label, one.name, one.language, one.protocol, one.complete) for one in found] == [
        ("OB1", "Main", "SCL", "s7comm_plus", True)
    ]
    (block,) = found
    again = plus_block(block.octets)
    assert again is not None
    assert again.parts() == block.parts()
    assert (again.label, again.name, again.language) == ("OB1", "Main", "SCL")
    assert [id_ for id_, _ in block.plus.blobs()] == [2533] if block.plus is not None else False


#: Captures of others with transfers: what an independent reading of their payloads gives, by capture.
SHARED = {
    "s7comm_downloading_block_db1.pcap": ("DB1", 500),
    "blocks/tia_s300_downloadOb1.pcapng": ("OB1", 332),
}


@pytest.mark.parametrize("name", SHARED)
def test_the_octets_are_those_of_the_packets(corpus: Path, name: str) -> None:
    """The pieces cut out of the TCP payloads by Scapy and these lines, without anything of the engine."""
    from scapy.layers.inet import TCP
    from scapy.utils import PcapReader

    joined = b""
    with PcapReader(str(corpus / name)) as packets:
        for packet in packets:
            payload = bytes(packet[TCP].payload) if TCP in packet else b""
            pdu = payload[7:]
            if pdu[:2] == b"\x32\x03" and pdu[12:13] == b"\x1b":  # the answer to download block
                size = int.from_bytes(pdu[6:8], "big")
                piece = pdu[12 + size :]
                joined += piece[4 : 4 + int.from_bytes(piece[:2], "big")]
    (block,) = dissect.blocks(corpus / name)
    assert (block.label, len(block.octets), block.complete, block.activated) == (*SHARED[name], True, True)
    assert block.octets == joined


def test_a_program_of_an_s7_1200_is_taken_apart(corpus: Path) -> None:
    found = dissect.blocks(corpus / "s7plus" / "yeni_onlineyapilmis_upload.pcapng")
    assert [block.label for block in found] == [
        "DB1", "DB2", "DB3", "DB4", "DB5", "DB8", "DB15", "DB333", "FB1084", "FB1085",
        *[f"UDT{number}" for number in (620, 621, 622, 623, 624, 625, 626, 627, 628, 633)], "DB334", "OB1",
    ]  # fmt: skip
    assert {(block.direction, block.protocol, block.complete) for block in found} == {("upload", "s7comm_plus", True)}
    assert len([id_ for id_, _ in (found[-1].plus.blobs() if found[-1].plus else ()) if id_ == 2533]) == 15
    # MB_CLIENT and MB_SERVER come with TIA Portal and are protected, as their instances are.
    assert [block.label for block in found if block.protected] == ["DB3", "DB4", "DB5", "FB1084", "FB1085"]


@pytest.mark.parametrize(
    ("value", "protected"),
    [
        (Value(0, STRUCT, Struct(3447, [(3448, Value(0, WORD, 3)), (3449, Value(0, WSTRING, ""))])), True),
        (Value(0, STRUCT, Struct(3447, [(3448, Value(0, WORD, 0))])), False),
        (Value(0, STRUCT, Struct(3447, [])), False),
        (Value(0, BOOL, True), False),
    ],
)
def test_know_how_protection_of_s7comm_plus(value: Value, protected: bool) -> None:
    block = plus_block(build_object(PlusObject(0x8A320001, 2647, 0, 0, 0, [Attribute(2524, value)])))
    assert block is not None
    assert block.protected == protected


@pytest.mark.parametrize("said", [upload(OB1, "_0800001A", 7, 33), download(FC3, "_0C00003P", 17)])
def test_a_block_with_pieces_from_pairs_that_are_only_likely_is_not_complete(said: list[Said]) -> None:
    (sure,) = carved(said)
    assert sure.complete
    one = sure.operation
    assert one is not None
    one.likely = 2
    (block,) = carve(one)
    assert (block.octets, block.complete) == (sure.octets, False)
    assert block.missing == ("2 pairs of request and answer are only likely, so its pieces may not belong together")
