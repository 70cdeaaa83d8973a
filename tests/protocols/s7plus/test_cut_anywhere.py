"""However PDUs are cut into frames, TSDUs and segments, the same is told of them (robustness promise G14)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import pytest

from dissect.meaning.report.tree import plus_tree_lines
from dissect.protocols.s7plus.assembly import MAX_FRAMES
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.event import STOP
from dissect.protocols.s7plus.events import take
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.session import Identity, PlusSession
from dissect.protocols.s7plus.tables import SET_VARIABLE
from dissect.protocols.s7plus.value_tables import DINT
from dissect.protocols.s7plus.values import Value
from dissect.testing.golden.masking import mask_plus
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.cutting import (
    Cutter,
    Sent,
    frames_of,
    in_frames,
    in_segments,
    in_small_frames,
    in_tpdus,
    may_be_cut,
    sent_in,
    told_of,
    uncut,
)
from tests.protocols.s7plus.pdus import asked, framed

CAPTURES: Final = Path(__file__).parents[3] / "captures"
OWN: Final = (
    "crafted/plus-plant.pcapng",
    "crafted/plus-answers.pcapng",
    "crafted/look-alikes.pcapng",
    "s7plus/s7commplus.pcapng",
)
#: Of the shared captures, by the bytes of their longest PDU: how many places are tried.
SHARED: Final = (
    ("s7comm_and_s7commplus_sll.pcap", 12),
    ("s7commplus_1511_opc_all_types.pcap", 60),
    ("s7plus/S7-1511_db2_var1_HMI.pcap", 60),
    ("s7plus/S7-1511_db3_var1_HMI.pcap", 60),
    ("s7plus/online_stop_yeni_yeni.pcapng", 15),
    ("s7plus/S7-1200-Uploading-OB1-TIAV12.pcap", 12),
    ("s7plus/plc.pcap", 6),
    ("s7plus/s71200_GoOfline_HWCompileDownload.pcapng", 3),
    ("s7plus/yeni_onlineyapilmis_upload.pcapng", 2),
)


#: Up to here all cuts are made behind every byte: so far the heads of TSDUs and PDUs reach, and the bodies of most.
_CLOSELY: Final = 72


def same(told: list[str]) -> list[str]:
    """Places of faults within a PDU count the headers of frames."""
    return [re.sub(r"at byte \d+", "at", line) for line in told]


def check(messages: list[Sent], places: list[int]) -> None:
    """Cut everything behind each of these numbers of bytes; a PDU that is shorter at another place."""
    longest = max(len(one.octets) for one in messages)
    one_packet = longest < 15_000
    whole = {packets: same(told_of(messages, uncut, packets)) for packets in (True, False)}
    cutters: list[tuple[Cutter, bool]] = []
    for place in places:
        cutters.append((in_frames(place), one_packet))
        if place < _CLOSELY or place % 5 == 0:
            cutters += [(in_frames(place, True), one_packet), (in_segments(place), False)]
            cutters += [(in_tpdus(place, empty), one_packet) for empty in (False, True)]
    cutters += [(in_small_frames(size), False) for size in (1, 2, 3, 7) if longest < MAX_FRAMES * size]
    for cut, packets in cutters:
        assert same(told_of(messages, cut, packets)) == whole[packets]


@pytest.mark.parametrize("name", OWN)
def test_own_captures_cut_anywhere_tell_the_same(name: str) -> None:
    messages = sent_in(CAPTURES / name)
    check(messages, list(range(max(len(one.octets) for one in messages) + 40)))


@pytest.mark.parametrize(("name", "places"), SHARED)
def test_shared_captures_cut_anywhere_tell_the_same(corpus: Path, name: str, places: int) -> None:
    messages = sent_in(corpus / name)
    most = min(max(len(one.octets) for one in messages), 4096)
    check(messages, sorted({16, 40, *[number * most // places for number in range(places)]}))


@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_stop_is_one_wherever_its_frames_are_cut(version: int) -> None:
    octets = framed(asked(1, SET_VARIABLE, body=bodies.set_variable(52, [2167], Value(0, DINT, 1))), version)
    for place in range(len(parse_plus(octets).data) + 1):
        for empty in (False, True):
            cut = b"".join(frames_of(octets, place, empty=empty and version == 3))
            facts = take(PlusSession(Program(), Identity()), SET_VARIABLE, cut, b"")
            assert facts is not None
            assert [event.kind for event in facts.events] == [STOP]


def fields(octets: bytes) -> list[str]:
    """The fields that `show -V` shows of a message, without their places and without frames."""
    pdu = parse_plus(octets)
    lines = list(plus_tree_lines(pdu, b""))
    found = []
    for line in lines[: lines.index("")]:
        left, *said = re.split(r"(?<=\S)  +", line.strip(), maxsplit=1)
        name = re.sub(r"^\d+(-\d+)? +", "", line.strip())
        if not re.match(r"(data|frame \d+) ", name) and left:
            found.append(re.sub(r"byte \d+", "byte", " ".join([name, *said])))
    begin = next(number for number, line in enumerate(found) if re.match(r"S7comm-plus (req|res|not|sys)", line))
    return found[begin:]


@pytest.mark.parametrize("name", OWN)
def test_show_has_the_same_fields_of_a_message_and_the_frames_it_came_in(name: str) -> None:
    for octets in {one.octets for one in sent_in(CAPTURES / name)}:
        if not may_be_cut(octets):
            continue
        pdu = parse_plus(octets)
        whole = fields(octets)
        parts = [(part.layout.name, part.offset, part.note) for part in parse_contents(pdu).parts]
        for place in range(len(pdu.data)):
            cut = b"".join(frames_of(octets, place))
            again = parse_plus(cut)
            assert fields(cut) == whole
            assert [(part.layout.name, part.offset, part.note) for part in parse_contents(again).parts] == parts
            assert again.frame_places[1][2] == len(cut) - 4
            carried = [line.split()[-2:] for line in plus_tree_lines(again, b"") if re.search(r" frame \d ", line)]
            assert carried == [_count(place), _count(len(pdu.data) - place)]


def _count(size: int) -> list[str]:
    return [str(size), "byte" if size == 1 else "bytes"]


def test_the_mask_of_a_golden_covers_numbers_in_any_frame() -> None:
    messages = sent_in(CAPTURES / OWN[0])
    for octets in [one.octets for one in messages if may_be_cut(one.octets)]:
        whole = parse_plus(mask_plus(octets)).data
        for place in range(len(parse_plus(octets).data)):
            assert parse_plus(mask_plus(b"".join(frames_of(octets, place)))).data == whole
