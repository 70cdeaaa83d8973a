"""Checks that several tests of the Scapy layers share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from hypothesis import strategies as st
from scapy.packet import NoPayload, Packet
from scapy.utils import RawPcapReader

from dissect.layers import S7_Part
from tests.layers.examples import EXAMPLES

#: Fields that building fills in if they are missing; for parts these are all fields without a default.
FILLED: Final = frozenset(("li", "length", "param_length", "data_length", "item_count", "fill"))


def survives(dissect: Callable[[bytes], Packet], octets: bytes) -> Packet:
    """Dissect, show, copy and build again: with Scapy's cache of the original octets, and from the fields alone.

    Empty octets cannot be dissected: Scapy then makes a packet of the defaults, as if the class was called without arguments.
    """
    packet = dissect(octets)
    if not octets:
        return packet
    assert bytes(packet) == octets
    shown(packet)
    packet.summary()
    repr(packet)
    again = packet.copy()
    again.clear_cache()
    assert bytes(again) == octets
    return packet


def shown(packet: Packet) -> str:
    """Return what ``show()`` prints."""
    text: str | None = packet.show(dump=True)
    assert text is not None
    return text


def forget(packet: Packet) -> Packet:
    """Return a copy without the fields that building fills in."""
    blank = packet.copy()
    layer: Packet = blank
    while not isinstance(layer, NoPayload):
        _forget(layer)
        layer = layer.payload
    return blank


def _forget(layer: Packet) -> None:
    for name, value in list(layer.fields.items()):
        counts = type(layer)().default_fields[name] is None if isinstance(layer, S7_Part) else name in FILLED
        if counts:
            layer.delfieldval(name)
        elif isinstance(value, list):
            for element in value:
                if isinstance(element, Packet):
                    _forget(element)


def mutated() -> st.SearchStrategy[bytes]:
    """Octets of the examples with some changed, cut off, or followed by another example."""
    octets = st.sampled_from([example.octets for example in EXAMPLES])
    changes = st.lists(st.tuples(st.integers(0, 120), st.integers(0, 255)), max_size=4)
    return st.builds(_mutate, octets, changes, st.integers(0, 130), st.one_of(st.just(b""), octets))


def _mutate(octets: bytes, changes: list[tuple[int, int]], cut: int, behind: bytes) -> bytes:
    changed = bytearray(octets)
    for at, value in changes:
        changed[at % len(changed)] = value
    return (bytes(changed) + behind)[: max(cut, 1)]


def tpkts_of(path: Path) -> list[bytes]:
    """Return the distinct TPKTs of a capture, taken apart without this package: Ethernet or Linux cooked, IPv4, TCP in order.

    A segment that is not the next one of its direction, or does not begin with a TPKT, starts anew.
    """
    found: dict[bytes, None] = {}
    pending: dict[bytes, tuple[int, bytes]] = {}
    with RawPcapReader(str(path)) as reader:
        for frame, meta in reader:
            link = getattr(meta, "linktype", None) or getattr(reader, "linktype", 1)
            cut = _segment(frame, 16 if link == 113 else 14)
            if cut is None:
                continue
            flow, seq, payload = cut
            expected, held = pending.get(flow, (seq, b""))
            octets = (held if expected == seq else b"") + payload
            if octets[:1] != b"\x03":
                octets = b""
            while len(octets) >= 4 and octets[0] == 3 and 4 <= int.from_bytes(octets[2:4], "big") <= len(octets):
                size = int.from_bytes(octets[2:4], "big")
                found[octets[:size]] = None
                octets = octets[size:]
            pending[flow] = ((seq + len(payload)) & 0xFFFFFFFF, octets)
    return list(found)


def _segment(frame: bytes, at: int) -> tuple[bytes, int, bytes] | None:
    """Return (flow, sequence number, payload) of a frame with TCP payload."""
    if frame[at - 2 : at] != b"\x08\x00" or frame[at + 9] != 6:
        return None
    ip = frame[at : at + int.from_bytes(frame[at + 2 : at + 4], "big")]
    tcp = ip[(ip[0] & 15) * 4 :]
    payload = tcp[(tcp[12] >> 4) * 4 :]
    if not payload:
        return None
    return ip[12:20] + tcp[:4], int.from_bytes(tcp[4:8], "big"), payload
