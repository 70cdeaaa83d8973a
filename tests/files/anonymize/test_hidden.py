"""Places where a capture tells of a plant beside S7: blocks and options of the file, other protocols, quoted packets."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from dissect.files.anonymize.account import Choices
from dissect.packets.source.files import open_capture
from tests.files.anonymize.support import anonymized, told
from tests.meaning.report.support import begun, read
from tests.packets.source.craft import Pcapng, drain
from tests.properties.packets import EPOCH_NS, Flow, Packet

FLOW = Flow("192.168.77.13", "192.168.77.94")
MAC = bytes.fromhex("001b1ba7c5d3")
ETHERNET = bytes.fromhex("01005e0000fb") + MAC
#: What no octet of the written file may tell.
SECRETS = (
    b"Pumpwerk-Nord", b"MILLER-PC", b"Windows 10", b"eth-plant", b"the uplink", b"CLIENT_RANDOM 00aa", b"plc17", b"remark",
    b"Xeon", b"cpu-315-halle3", b"SCADA-SERVER", b"halle3", bytes((192, 168, 77, 13)), bytes((192, 168, 77, 94)), MAC,
    b"dumpcap of Mr Miller", b"port 102 and host",
)  # fmt: skip


def others() -> list[bytes]:
    """Return packets of other protocols that name stations."""
    dns = bytes.fromhex("123401000001000000000000") + b"\x05plc17\x06halle3\x03lan\0\0\1\0\1"
    quoted = FLOW.wrap(0, 17, struct.pack(">HHHH", 40000, 102, 8, 0))[14:]
    icmp = b"\x03\x03\0\0\0\0\0\0" + quoted
    dcp = bytes.fromhex("feff 0500 00000001 0000 0010 0202 000e") + b"cpu-315-halle3"
    lldp = b"\x02\x07\x04" + MAC + b"\x0a\x0dPumpwerk-Nord\0\0"
    arp = bytes.fromhex("0001080006040001") + MAC + bytes((192, 168, 77, 13)) + bytes(6) + bytes((192, 168, 77, 94))
    nbns = b"\0\0\1\x10\0\1" + bytes(6) + b"SCADA-SERVER\0"
    return [
        FLOW.wrap(0, 17, struct.pack(">HHHH", 40000, 53, 8 + len(dns), 0) + dns),
        FLOW.wrap(0, 17, struct.pack(">HHHH", 137, 137, 8 + len(nbns), 0) + nbns),
        FLOW.wrap(1, 1, icmp),
        FLOW.wrap(0, 6, b"\0\1"),
        FLOW.wrap(0, 99, b"Pumpwerk-Nord, halle3"),
        ETHERNET + b"\x08\x06" + arp,
        ETHERNET + b"\x88\x92" + dcp,
        ETHERNET + b"\x88\xcc" + lldp,
        ETHERNET + b"\x00\x0dPumpwerk-Nord",
        ETHERNET + b"\x08\x00",
        MAC,
    ]


def capture(path: Path) -> tuple[Path, int]:
    """Write a pcapng file that tells all it can; return it and how many packets it has."""
    file = Pcapng()
    file.octets = b""
    about = [(1, b"Pumpwerk-Nord"), (2, b"Xeon"), (3, b"Windows 10"), (4, b"dumpcap of Mr Miller")]
    file.section(options=b"".join([file.option(code, text) for code, text in about]))
    interface = [(2, b"eth-plant"), (3, b"the uplink"), (11, b"\0port 102 and host 192.168.77.13"), (12, b"Windows 10")]
    interface += [(4, bytes((192, 168, 77, 13, 255, 255, 255, 0))), (6, MAC), (15, b"Xeon")]
    options = b"".join([file.option(code, text) for code, text in interface])
    file.interface(1, options=options + file.resolution(9))
    record = bytes((192, 168, 77, 13)) + b"MILLER-PC\0"
    file.block(4, struct.pack("<HH", 1, len(record)) + record + bytes(-len(record) % 4) + bytes(4))
    keys = b"CLIENT_RANDOM 00aa 00bb\n"
    file.block(10, struct.pack("<II", 0x544C534B, len(keys)) + keys)
    file.block(0xBAD, struct.pack("<I", 32473) + b"plc17 custom")
    packets = read(begun(FLOW), 1).packets()
    packets += [Packet(EPOCH_NS + 10**9 + at, octets, len(octets)) for at, octets in enumerate(others())]
    for packet in packets:
        remark = file.option(1, b"a remark") + file.option(0, b"")
        file.packet(packet.time_ns, packet.time_ns, packet.octets, 0, packet.wire_length, remark)
    file.block(5, struct.pack("<III", 0, 0, 0) + file.option(1, b"a remark on statistics") + file.option(0, b""))
    path.write_bytes(file.octets)
    return path, len(packets)


@pytest.mark.parametrize("keep_others", [False, True])
def test_nothing_is_told_from_any_place(tmp_path: Path, keep_others: bool) -> None:
    source, packets = capture(tmp_path / "in.pcapng")
    octets = source.read_bytes()
    assert [secret for secret in SECRETS if secret not in octets] == []
    account = anonymized(source, tmp_path / "out.pcapng", Choices(keep_others=keep_others))
    written = (tmp_path / "out.pcapng").read_bytes()
    assert [secret for secret in SECRETS if secret in written] == []
    assert told(tmp_path / "out.pcapng") == told(source) != []
    assert account.comments == packets
    assert account.written + sum(account.dropped.values()) == account.packets == packets
    assert account.written == (packets if keep_others else packets - len(others()))
    assert bool(account.dropped) is not keep_others
    frames = drain(open_capture(str(tmp_path / "out.pcapng"))).frames
    if keep_others:
        before = drain(open_capture(str(source))).frames
        assert [(frame.time_ns, len(frame.octets)) for frame in frames] == [
            (frame.time_ns, len(frame.octets)) for frame in before
        ]
        assert {"other_contents", "blank_packets"} <= account.masked.keys()
