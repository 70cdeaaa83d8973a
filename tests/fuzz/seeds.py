"""The seeds of a fuzzer: our own captures, and the shared ones if they exist, in the form of each target."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Final

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.side import Side
from dissect.packets.source.files import find_reader
from dissect.scd.dump import dump_json
from tests.fuzz import files, frames, inputs, pdus, scripts, streams
from tests.fuzz.blocks import block_seeds
from tests.fuzz.containers import Packets
from tests.fuzz.plus_seeds import plus_seeds
from tests.fuzz.tls import tls_seeds
from tests.properties.captures import ROOT, SHARED, Memory
from tests.properties.packets import Packet
from tests.testing.golden.support import WRITTEN

#: Longer captures make a fuzzer slow and show it nothing more.
LARGEST: Final = 12 * 1024
#: Number of packets of a capture that a seed uses.
MOST_PACKETS: Final = 50

EDS: Final = """[FileInfo]
FileName=pump.eds
[DeviceInfo]
ProductName=Pump
[DeviceComissioning]
NodeID=5
[MandatoryObjects]
SupportedObjects=1
1=0x1000
[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=0x191
[OptionalObjects]
SupportedObjects=1
1=0x1018
[1018]
ParameterName=Identity
ObjectType=0x9
SubNumber=2
[1018sub0]
ParameterName=Highest
DataType=0x0005
AccessType=ro
DefaultValue=1
[1018sub1]
ParameterName=Vendor
DataType=0x0007
AccessType=ro
DefaultValue=$NODEID+0x20
"""
XDD: Final = """<?xml version="1.0" encoding="UTF-8"?>
<ISO15745ProfileContainer><ISO15745Profile><ProfileBody><ApplicationLayers><ObjectList>
<Object index="1000" name="Device type" objectType="7" dataType="0007" accessType="ro" defaultValue="0x191"/>
<Object index="1018" name="Identity" objectType="9" subNumber="2">
<SubObject subIndex="00" name="Highest" objectType="7" dataType="0005" accessType="ro" defaultValue="1"/>
<SubObject subIndex="01" name="Vendor" objectType="7" dataType="0007" accessType="ro" defaultValue="5"/>
</Object></ObjectList></ApplicationLayers></ProfileBody></ISO15745Profile></ISO15745ProfileContainer>
"""
FILTERS: Final = ("tcp port 102", "(tcp or udp) and host 10.0.0.1", "net 10.0.0.0/8 and not vlan 5", "ip6 or port 1099")
WORDS: Final = (
    "error", "session.*", "s7.malformed", "10:00:00..10:00:01.5", "2024-03-04T05:06:07..", "..12.25", "files:3,filesize:100",
    "duration:0.5,files:2",
)  # fmt: skip


class _Parts(Observer):
    """Collects the TPKTs, by direction, and the PDUs of a capture."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_tpdus = self.wants_pdus = True
        self.streams: dict[tuple[int, int], list[bytes]] = {}
        self.pdus: list[bytes] = []

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        self.streams.setdefault((int(side.connection.number), int(side.index)), []).append(octets)

    def ibh_packet(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        self.tpdu(frame, time_ns, side, octets)
        self.pdus.append(octets)

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        self.pdus.append(octets)

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        self.pdus.append(octets)


class Seeds:
    """The seeds of every target, made of captures."""

    def __init__(self, paths: Iterable[Path]) -> None:
        self.captures = [path.read_bytes() for path in paths if path.stat().st_size <= LARGEST]
        self._packets = [_packets(octets) for octets in self.captures]
        self._parts = [_parts(packets) for packets in self._packets]

    def container(self) -> list[bytes]:
        return self.captures

    def frames(self) -> list[bytes]:
        return [frames.written(packets[:MOST_PACKETS]) for packets in self._packets]

    def segments(self) -> list[bytes]:
        return [scripts.written(packets[:MOST_PACKETS]) for packets in self._packets]

    def streams(self) -> list[bytes]:
        return [
            streams.written(pieces[:MOST_PACKETS], number % 2 == 0)
            for parts in self._parts
            for number, pieces in enumerate(parts.streams.values())
        ]

    def pdus(self) -> list[bytes]:
        """One PDU of each kind: by its first octets and its size, which largely determine its type."""
        kinds = {
            (pdu[:2], pdu[10:13], pdu[17:24] if pdu[1:2] == b"\x07" else pdu[17:19], len(pdu) // 64): pdu
            for parts in self._parts
            for pdu in parts.pdus
        }
        return [bytes((pdus.CUT if number % 9 == 0 else 0,)) + pdu for number, pdu in enumerate(kinds.values())]

    def blocks(self) -> list[bytes]:
        return block_seeds()

    def plus(self) -> list[bytes]:
        return plus_seeds([octets for parts in self._parts for octets in parts.pdus])

    def tls(self) -> list[bytes]:
        return tls_seeds()

    def files(self) -> list[bytes]:
        made = []
        for number, octets in enumerate(self.captures):
            other = 0 if number % 3 else files.OTHER
            made.append(octets + bytes((number % len(files.FACES) | other,)))
            script = scripts.written(self._packets[number][:MOST_PACKETS])
            made.append(script + bytes((files.SCRIPT | (number + 3) % len(files.FACES) | other,)))
        plant = _packets(inputs.PLANT.with_name("plant.pcapng").read_bytes())
        for face in range(len(files.FACES)):
            octets = scripts.written(plant[face * 10 : face * 10 + MOST_PACKETS])
            made.append(octets + bytes((files.SCRIPT | files.SCD | face,)))
        return made

    def inputs(self) -> list[bytes]:
        plant = inputs.plant()
        texts = [path.read_bytes() for path in sorted((ROOT / "captures" / "golden").rglob("*.s7.txt"))]
        made = [inputs.written("golden", text) for text in (WRITTEN.encode(), *texts) if len(text) <= LARGEST]
        made += [inputs.written("compiled", plant.octets[64:]), inputs.written("raw", plant.octets)]
        made.append(inputs.written("toml", inputs.PLANT.read_bytes()))
        made.append(inputs.written("json", dump_json(plant).encode()))
        made += [inputs.written("eds", EDS.encode()), inputs.written("xdd", XDD.encode())]
        made.append(inputs.written("bindings", inputs.BINDINGS.read_bytes()))
        for text in re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "alerts.md").read_text("utf-8"), re.DOTALL):
            made.append(inputs.written("baseline" if "[[pair]]" in text else "rules", text.encode()))
        made += [inputs.written("filter", text.encode()) for text in FILTERS]
        made += [inputs.written("words", text.encode()) for text in WORDS]
        for pdo in (*plant.tpdo.values(), *plant.rpdo.values()):
            made.append(inputs.written("decoded", bytes((pdo.number % 8,)) + bytes(pdo.size)))
        made += [inputs.written("received", octets) for octets in _payloads(ROOT / "captures" / "scd" / "plant.pcapng")]
        return made


def _packets(octets: bytes) -> list[Packet]:
    packets = Packets()
    reader = find_reader(Memory(octets), "seed")
    while reader.step(packets):
        pass
    return [Packet(time_ns, content, wire, link) for time_ns, content, wire, link in packets.told]


def _parts(packets: Iterable[Packet]) -> _Parts:
    parts = _Parts()
    pipeline = Pipeline(parts, Options())
    for packet in packets:
        pipeline.frame(packet.time_ns, packet.octets, 0, len(packet.octets), packet.wire_length, packet.link_type)
    pipeline.finish()
    return parts


def _payloads(path: Path) -> list[bytes]:
    """Return the payloads of UDP datagrams of a capture, one of each size."""
    sizes = {len(packet.octets): packet.octets[42:] for packet in _packets(path.read_bytes())
             if packet.octets[23:24] == b"\x11"}  # fmt: skip
    return list(sizes.values())


@cache
def own() -> Seeds:
    """Return the seeds that every checkout has."""
    return Seeds(sorted(path for path in (ROOT / "captures").rglob("*.pcap*") if path.is_file()))


def every() -> Seeds:
    """Return the seeds, including those of the shared captures if they exist."""
    shared: Sequence[Path] = sorted(SHARED.glob("*.pcap*"))
    return Seeds([*sorted(path for path in (ROOT / "captures").rglob("*.pcap*") if path.is_file()), *shared])
