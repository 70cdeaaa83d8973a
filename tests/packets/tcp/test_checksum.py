"""Checksums: those that tshark finds wrong are wrong, but where the network card was to make them."""

from __future__ import annotations

import struct
import subprocess
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.packets.source.files import open_capture
from dissect.packets.source.packet import PacketSink
from dissect.packets.tcp.ip import TCP, UDP, FragmentStore
from dissect.packets.tcp.segment import find_segment, is_damaged
from tests.conftest import ROOT

#: Captured where they were sent (loopback), made with right checksums, in fragments, over IPv6, with lies in headers, over UDP.
CAPTURES: Final = {
    "szl": ["card"],
    "crafted/vlan": ["good"],
    "crafted/ip-fragments": ["good"],
    "crafted/ipv6": ["good"],
    "crafted/ip-headers": ["good", "wrong"],
    "scd/plant": ["good"],
}
PUBLIC: Final = (
    "water_pump_hmi.pcapng",
    "s7comm_clean.pcap",
    "cotp_unknown_payload_rst.pcapng",
    "tia_s300_goOnline.pcapng",
)


def words_sum(octets: bytes) -> int:
    """Add up 16-bit words with end-around carry, as RFC 1071 has it."""
    total = 0
    for (word,) in struct.iter_unpack(">H", octets + bytes(len(octets) % 2)):
        total += word
        total = (total & 0xFFFF) + (total >> 16)
    return total


def pseudo(addresses: bytes, protocol: int, size: int) -> bytes:
    if len(addresses) == 8:
        return addresses + struct.pack(">BBH", 0, protocol, size)
    return addresses + struct.pack(">II", size, protocol)


class Verdicts(PacketSink):
    """What becomes of each frame's checksum: ``good``, ``wrong`` or ``card`` (left to it); frames without one are not there."""

    def __init__(self) -> None:
        self.fragments = FragmentStore()
        self.frames = 0
        self.found: dict[int, str] = {}

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        self.frames += 1
        plain = find_segment(buf, start, end, link_type, FragmentStore(), time_ns, True)
        found = find_segment(buf, start, end, link_type, self.fragments, time_ns, True, True)
        if found.problem not in {"", "bad_checksum"} or found.missing:
            return
        verdict = "wrong" if found.problem else "good"
        if verdict == "good" and not plain.problem:
            addresses, rest = found.key[: 8 if len(found.key) in {12, 20} else 32], buf[start:end]
            at = rest.index(found.key[len(addresses) : len(addresses) + 4], 20)
            header = (found.word >> 12) * 4 if found.protocol == TCP else 8
            content = rest[at : at + header + len(found.octets)]
            if words_sum(pseudo(addresses, found.protocol, len(content)) + content) != 0xFFFF:
                verdict = "card"
        self.found[self.frames] = verdict


def of_tshark(path: Path) -> dict[int, str]:
    command = ["tshark", "-r", str(path), "-T", "fields", "-E", "occurrence=l", "-e", "frame.number"]
    command += ["-e", "tcp.checksum.status", "-e", "udp.checksum.status"]
    for protocol in ("tcp", "udp"):
        command += ["-o", f"{protocol}.check_checksum:TRUE"]
    out = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    rows = [line.split("\t") for line in out.splitlines()]
    return {int(number): {"0": "wrong", "1": "good"}.get(tcp or udp, "") for number, tcp, udp in rows if tcp or udp}


def held_to_tshark(path: Path) -> list[str]:
    """Compare, and return our verdicts."""
    ours = Verdicts()
    reader = open_capture(str(path))
    while reader.step(ours):
        pass
    theirs = of_tshark(path)
    found = {frame: theirs[frame] for frame in ours.found if theirs.get(frame)}
    assert found
    assert {frame: ours.found[frame].replace("card", "wrong") for frame in found} == found
    return sorted(set(ours.found.values()))


@pytest.mark.parametrize(("name", "verdicts"), CAPTURES.items())
def test_ours_are_tsharks(name: str, verdicts: list[str]) -> None:
    assert held_to_tshark(ROOT / "captures" / f"{name}.pcapng") == verdicts


@pytest.mark.parametrize("name", PUBLIC)
def test_ours_are_tsharks_in_public_captures(name: str, corpus: Path) -> None:
    held_to_tshark(corpus / name)


def summed(addresses: bytes, protocol: int, octets: bytes) -> bytes:
    """Put the right checksum into a segment or datagram whose checksum is 0."""
    where = 16 if protocol == TCP else 6
    right = 0xFFFF - words_sum(pseudo(addresses, protocol, len(octets)) + octets)
    return octets[:where] + struct.pack(">H", right or (0 if protocol == TCP else 0xFFFF)) + octets[where + 2 :]


ADDRESSES: Final = st.sampled_from((8, 32)).flatmap(lambda size: st.binary(min_size=size, max_size=size))
KINDS: Final = st.sampled_from(((TCP, 20), (UDP, 8)))


@given(ADDRESSES, KINDS, st.binary(max_size=64), st.data())
def test_one_wrong_bit_is_found(addresses: bytes, kind: tuple[int, int], content: bytes, data: st.DataObject) -> None:
    protocol, header = kind
    where = 16 if protocol == TCP else 6
    whole = data.draw(st.binary(min_size=header, max_size=header)) + content
    whole = summed(addresses, protocol, whole[:where] + bytes(2) + whole[where + 2 :])
    assert not is_damaged(addresses, protocol, b"before" + whole + b"behind", 6, 6 + len(whole))
    bit = data.draw(st.integers(0, 8 * len(whole) - 1))
    wrong = bytearray(whole)
    wrong[bit >> 3] ^= 1 << (bit & 7)
    stated = int.from_bytes(wrong[where : where + 2], "big") % 0xFFFF
    card = {words_sum(pseudo(addresses, protocol, size)) % 0xFFFF for size in (0, len(whole))}
    none = protocol == UDP and wrong[where : where + 2] == bytes(2)
    assert is_damaged(addresses, protocol, bytes(wrong), 0, len(wrong)) == (stated not in card and not none)


@given(ADDRESSES, KINDS, st.binary(max_size=64), st.booleans())
def test_what_the_card_is_to_do_is_no_damage(
    addresses: bytes, kind: tuple[int, int], content: bytes, cuts: bool
) -> None:
    protocol, header = kind
    where = 16 if protocol == TCP else 6
    size = 0 if cuts else header + len(content)
    partial = struct.pack(">H", words_sum(pseudo(addresses, protocol, size)))
    whole = bytes(where) + partial + bytes(header - where - 2) + content
    assert not is_damaged(addresses, protocol, whole, 0, len(whole))


def test_a_datagram_without_checksum_is_whole_and_a_segment_is_not() -> None:
    assert not is_damaged(bytes(range(8)), UDP, bytes(8) + b"abc", 0, 11)
    assert is_damaged(bytes(range(8)), TCP, bytes(20) + b"abc", 0, 23)
