"""All our captures made anonymous: the same transactions, nothing of what was in them, checksums as right as before."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Final, cast

import pytest

import dissect
from dissect.engine.observer import Observer
from dissect.engine.transactions.side import Side
from dissect.files.anonymize.account import KEEP, MASK, SCRAMBLE, Choices
from dissect.files.anonymize.key import Key
from dissect.files.session import Run
from dissect.packets.source.files import open_capture
from dissect.packets.tcp import ip, link
from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.iso.tables import CC, CR
from dissect.protocols.iso.tsap import Tsap
from dissect.protocols.s7.message import parse_pdu
from tests.build import ACK_DATA, JOB, READ, USERDATA, data_item, dt, payload, pdu, userdata_head
from tests.cases import each
from tests.files.anonymize.support import BLANKED, KEY, anonymized, told
from tests.meaning.report.support import OWN, ROOT, begun, read, saved
from tests.packets.source.craft import drain
from tests.properties.packets import Flow, captured
from tests.tshark import join

#: Octets between IBH-NetLink packets become zeros, which may begin one: a packet behind them is found later than before.
GARBAGE: Final = "netlink-faults"

#: Fields that hold what nobody is to read.
SECRET: Final = frozenset((
    "archive_data", "argument", "author", "bsend_data", "content", "data", "family", "file_data", "file_name", "name",
    "password", "path", "record", "text", "user",
))  # fmt: skip
#: Octets that only long runs of are no chance.
LEAST: Final = 4


class Secrets(Observer):
    """Gathers what stands in the fields above, and TSAPs that are texts."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_tpdus = self.wants_pdus = True
        self.found: set[bytes] = set()

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        tpdu = parse_tpdu(octets[4:])
        for parameter in tpdu.parameters if tpdu.type in {CC, CR} else []:
            if parameter.code in {0xC1, 0xC2} and Tsap(parameter.value).connection_type < 0:
                self._add(parameter.value)

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        for part in parse_pdu(octets).body.parts:
            for value in part.values:
                if value.field.name in SECRET and value.octets is not None:
                    self._add(value.octets)

    def _add(self, octets: bytes) -> None:
        core = octets.strip(b" \0")
        if core.startswith(b"SIMATIC-ROOT-"):
            return  # the TSAP of every device of a kind
        if len(core) >= LEAST and len(set(core)) >= LEAST - 1:
            self.found.add(core)


def secrets_of(path: Path) -> set[bytes]:
    watch = Secrets()
    run = Run([str(path)], watch)
    while run.step():
        pass
    return watch.found


def addresses_of(path: Path) -> set[bytes]:
    """Return the addresses in IP headers, and the stations in Ethernet headers, of which others have to be made."""
    found: set[bytes] = set()
    for frame in drain(open_capture(str(path))).frames:
        at, _ = link.find_ip(frame.octets, 0, len(frame.octets), frame.link_type)
        packet = ip.parse_ip(frame.octets, at, len(frame.octets)) if at >= 0 else ip.IpPacket()
        half = len(packet.addresses) // 2
        found |= {packet.addresses[:half], packet.addresses[half:]}
        if frame.link_type == link.ETHERNET:
            found |= {frame.octets[:6], frame.octets[6:12]}
    return {
        address
        for address in found
        if any(address) and not (len(address) == 6 and address[0] & 1)
        and not (len(address) == 4 and (address[0] in {0, 127} or address[0] >= 224))
        and not (len(address) == 16 and (address[0] == 0xFF or not any(address[:15])))
    }  # fmt: skip


@each("source", OWN)
def test_what_happened_stays_and_who_it_was_goes(source: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.pcapng"
    account = anonymized(source, out)
    assert account.written + sum(account.dropped.values()) == account.packets
    if GARBAGE not in source.name and source.name not in BLANKED:
        assert told(out) == told(source)
    octets = b"".join([frame.octets for frame in drain(open_capture(str(out))).frames])
    assert [secret for secret in secrets_of(source) if secret in octets] == []
    addresses = addresses_of(source)
    assert addresses & addresses_of(out) == set()
    assert [address.hex() for address in addresses if address in octets and len(set(address)) > 3] == []


#: Two areas in one item (syntax 0xB0), and what they hold: a return code in front of each, of which the second refuses.
AREAS: Final = bytes.fromhex("12 0c b0 02 02 0044 0160 01 0048 0030")
HELD: Final = bytes.fromhex("ff 1234 0a")


@pytest.mark.parametrize("gap", [0, 7])
@pytest.mark.parametrize("values", [MASK, SCRAMBLE])
def test_return_codes_within_values_stay_whoever_sends_them(values: str, gap: int, tmp_path: Path) -> None:
    """A subscription and what it pushes; a read, behind a gap as well, where the answer is known before its request."""
    talk = begun()
    talk.send(0, dt(pdu(USERDATA, 2, userdata_head(1, 2, 5), payload(b"\x00\x01\x01\x0a" + AREAS))))
    answer = b"\x00\x01" + data_item(0xFF, 9, HELD)
    talk.send(1, dt(pdu(USERDATA, 2, userdata_head(2, 2, 5, 4, 0), payload(answer))))
    pushed = dt(pdu(USERDATA, 0, userdata_head(0, 2, 5, 4, 0), payload(answer)))
    talk.send(1, pushed + pushed).skip(0, gap)
    talk.send(0, dt(pdu(JOB, 3, bytes((READ, 1)) + AREAS)))
    talk.send(1, dt(pdu(ACK_DATA, 3, bytes((READ, 1)), data_item(0xFF, 9, HELD))))
    source, out = saved(tmp_path / "in.pcapng", talk.packets()), tmp_path / "out.pcapng"
    anonymized(source, out, Choices(values))
    assert [code for row in told(source) for _, code in cast("list[tuple[str, int]]", row[7])] == [255, 10] * 4
    assert told(out) == told(source)
    octets = b"".join([frame.octets for frame in drain(open_capture(str(out))).frames])
    assert b"\x12\x34" not in octets


@pytest.mark.parametrize("values", [KEEP, SCRAMBLE])
@pytest.mark.parametrize("name", ["slivers", "multi-items", "crafted/retransmissions", "crafted/segments"])
def test_values_as_chosen(name: str, values: str, tmp_path: Path) -> None:
    source, out = ROOT / f"captures/{name}.pcapng", tmp_path / "out.pcapng"
    anonymized(source, out, Choices(values))
    assert told(out) == told(source)
    before, after = _values(source), _values(out)
    assert len(before) == len(after)
    if values == KEEP:
        assert before == after
    else:
        assert any(one != other for one, other in zip(before, after, strict=True))
        pairs = set(zip(before, after, strict=True))
        bits = {one for one, _ in pairs if len(one) == 1}  # a bit of a longer item is another one than an octet
        assert len({one for one, _ in pairs if one not in bits}) == len([one for one, _ in pairs if one not in bits])


def _values(path: Path) -> list[bytes]:
    return [
        result.data
        for event in dissect.open(str(path))
        if isinstance(event, dissect.Transaction)
        for result in event.s7_results
        if result.data is not None
    ]


def test_the_same_key_gives_the_same_octets_and_another_one_others(tmp_path: Path) -> None:
    source = ROOT / "captures/crafted/plain.pcap"
    files = [tmp_path / f"{number}.pcapng" for number in range(3)]
    for file, key in zip(files, (KEY, KEY, Key(b"another key")), strict=True):
        anonymized(source, file, key=key)
    assert files[0].read_bytes() == files[1].read_bytes() != files[2].read_bytes()


def test_times_move_together(tmp_path: Path) -> None:
    source, out = ROOT / "captures/szl.pcapng", tmp_path / "out.pcapng"
    anonymized(source, out, Choices(shift_time=True))
    moved = {
        after.time_ns - before.time_ns
        for before, after in zip(
            drain(open_capture(str(source))).frames, drain(open_capture(str(out))).frames, strict=True
        )
    }
    assert moved == {KEY.shift_ns}


def test_wireshark_reads_it_as_before(tmp_path: Path) -> None:
    """Captures that have no ends in common, before and after, joined: tshark starts once for all of them."""
    names = ("multi-items", "slivers", "szl", "password", "crafted/vlan", "crafted/ipv6")
    sources = [ROOT / f"captures/{name}.pcapng" for name in names]
    for source in sources:
        anonymized(source, tmp_path / source.name)
    shown = []
    for kind, paths in (("before", sources), ("after", [tmp_path / source.name for source in sources])):
        (tmp_path / kind).mkdir()
        joined, counts = join(paths, tmp_path / kind)
        lines = _wireshark(joined).splitlines()
        assert len(lines) == sum(counts)
        shown.append(lines)
    assert shown[0] == shown[1]
    assert len([line for line in shown[0] if line.split("\t")[4]]) > 100


def _wireshark(path: Path) -> str:
    """Return what tshark says of each packet: its checksums, its S7 PDUs, how it is numbered and cut."""
    fields = (
        "ip.checksum.status",
        "tcp.checksum.status",
        "tcp.seq",
        "tcp.len",
        "s7comm.header.pduref",
        "s7comm.param.func",
    )
    wanted = [word for field in fields for word in ("-e", field)]
    checks = ("-o", "ip.check_checksum:TRUE", "-o", "tcp.check_checksum:TRUE")
    ran = subprocess.run(
        ["tshark", "-r", str(path), *checks, "-T", "fields", *wanted], capture_output=True, text=True, check=True
    )
    return ran.stdout


def test_a_connection_in_two_vlans(tmp_path: Path) -> None:
    flows = Flow(vlans=(10,)), Flow(vlans=(20,))
    sent = [segment._replace(flow=flows[segment.side]) for segment in read(read(begun(), 1), 2).close().segments]
    source, out = saved(tmp_path / "in.pcapng", captured(sent)), tmp_path / "out.pcapng"
    account = anonymized(source, out)
    assert account.written == len(sent)
    assert told(out) == told(source)
