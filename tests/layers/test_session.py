from __future__ import annotations

import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from scapy.layers.inet import IP, TCP, UDP
from scapy.layers.inet6 import IPv6
from scapy.layers.l2 import Dot1Q, Ether
from scapy.packet import NoPayload, Packet, Raw
from scapy.sendrecv import sniff
from scapy.utils import EDecimal, wrpcap

import dissect
from dissect.layers import COTP_CR, COTP_DT, S7, TPKT, S7_ReadVarAnswer, S7_ReadVarRequest, S7Plus, S7Session, at
from dissect.layers.s7 import function_of
from tests.cases import each
from tests.layers.examples import BY_NUMBER

CLIENT, PLC = ("02:00:00:00:00:01", "10.0.0.1", 4000), ("02:00:00:00:00:02", "10.0.0.2", 102)
CONNECT, CONFIRM, READ, ANSWER = (BY_NUMBER[number].octets for number in (13, 14, 28, 29))
EMPTY_DT = BY_NUMBER[101].octets
CAPTURES = Path(__file__).resolve().parent.parent.parent / "captures"
START = 1_600_000_000


class Talk:
    """A TCP conversation being written down as packets a millisecond apart."""

    def __init__(self, client: tuple[str, str, int] = CLIENT, plc: tuple[str, str, int] = PLC) -> None:
        self.ends = {"c": client, "p": plc}
        self.seq = {"c": 1000, "p": 5000}
        self.packets: list[Packet] = []

    def send(self, who: str, payload: bytes = b"", flags: str = "A") -> Packet:
        """Append one packet that ``who`` ("c" or "p") sends; it can still be changed."""
        other = "p" if who == "c" else "c"
        (mac, address, port), (to_mac, to_address, to_port) = self.ends[who], self.ends[other]
        network = IPv6 if ":" in address else IP
        tcp = TCP(sport=port, dport=to_port, seq=self.seq[who], ack=self.seq[other] if "A" in flags else 0, flags=flags)
        packet: Packet = Ether(src=mac, dst=to_mac) / network(src=address, dst=to_address) / tcp
        if payload:
            packet /= Raw(payload)
        packet.time = EDecimal(START) + EDecimal(len(self.packets)) / 1000
        self.packets.append(packet)
        self.seq[who] += len(payload) + (1 if set("SF") & set(flags) else 0)
        return packet

    def open(self) -> Talk:
        """The three packets that open a TCP connection."""
        self.send("c", flags="S")
        self.send("p", flags="SA")
        self.send("c")
        return self


def seen(tmp_path: Path, packets: list[Packet], session: Any = S7Session) -> list[Packet]:
    """Return what sniff delivers of a capture of these packets."""
    path = tmp_path / "talk.pcap"
    wrpcap(str(path), packets)
    return list(sniff(offline=str(path), session=session))


def test_one_packet_for_each_tpkt(tmp_path: Path) -> None:
    talk = Talk().open()
    talk.send("c", CONNECT)
    talk.send("p", CONFIRM)
    talk.send("c", READ + READ)
    talk.send("p", ANSWER + EMPTY_DT)
    delivered = seen(tmp_path, talk.packets)
    assert [bytes(packet[TPKT]) for packet in delivered] == [CONNECT, CONFIRM, READ, READ, ANSWER, EMPTY_DT]
    assert isinstance(delivered[0][TPKT].payload, COTP_CR)


def test_addresses_ports_and_times_are_those_of_the_direction(tmp_path: Path) -> None:
    talk = Talk().open()
    talk.send("c", READ)
    talk.send("p", ANSWER)
    asked, answered = seen(tmp_path, talk.packets)
    assert (asked[Ether].src, asked[IP].src, asked[TCP].sport) == CLIENT
    assert (asked[Ether].dst, asked[IP].dst, asked[TCP].dport) == PLC
    assert (answered[Ether].src, answered[IP].src, answered[TCP].sport) == PLC
    assert (answered[Ether].dst, answered[IP].dst, answered[TCP].dport) == CLIENT
    assert asked.time == EDecimal(START) + EDecimal("0.003")
    assert answered.time == EDecimal(START) + EDecimal("0.004")
    assert answered[TPKT].answers(asked[TPKT])


def test_any_segmentation_gives_the_same(tmp_path: Path) -> None:
    talk = Talk().open()
    for octet in READ + READ:
        talk.send("c", bytes((octet,)))
    delivered = seen(tmp_path, talk.packets)
    assert [bytes(packet[TPKT]) for packet in delivered] == [READ, READ]
    assert delivered[0].time == EDecimal(START) + EDecimal(2 + len(READ)) / 1000


def test_segments_out_of_order_duplicates_and_trailers(tmp_path: Path) -> None:
    talk = Talk().open()
    for part in (READ[:10], READ[10:20], READ[20:]):
        talk.send("c", part)
    talk.packets[3], talk.packets[4] = talk.packets[4], talk.packets[3]
    talk.packets.insert(5, talk.packets[4])
    trailed = Ether(bytes(talk.packets[-1]) + b"\x00\x11\x22\x33")
    trailed.time = talk.packets[-1].time
    talk.packets[-1] = trailed
    (only,) = seen(tmp_path, talk.packets)
    assert bytes(only[TPKT]) == READ


def test_an_s7_pdu_over_several_dts_hangs_whole_on_the_last(tmp_path: Path) -> None:
    pdu = READ[7:]
    parts = [bytes(TPKT() / COTP_DT(eot=eot) / Raw(part)) for eot, part in ((0, pdu[:5]), (0, pdu[5:9]), (1, pdu[9:]))]
    talk = Talk().open()
    for part in parts:
        talk.send("c", part)
    first, second, last = seen(tmp_path, talk.packets)
    assert (first[Raw].load, second[Raw].load) == (pdu[:5], pdu[5:9])
    assert S7 not in first
    assert bytes(last[S7]) == pdu
    assert isinstance(last[S7].payload, S7_ReadVarRequest)
    assert last[TPKT].length == len(parts[2])


def test_the_empty_dt_before_a_pdu_changes_nothing(tmp_path: Path) -> None:
    talk = Talk().open()
    talk.send("c", EMPTY_DT + READ)
    empty, read = seen(tmp_path, talk.packets)
    assert isinstance(empty.lastlayer(), COTP_DT)
    assert bytes(read[TPKT]) == READ


def test_a_pdu_of_no_known_rosctr_is_no_s7plus(tmp_path: Path) -> None:
    pdu = bytes((0x32, 4)) + READ[9:]
    talk = Talk().open()
    talk.send("c", READ)
    talk.send("c", bytes(TPKT() / COTP_DT() / Raw(pdu)))
    talk.send("c", bytes(TPKT() / COTP_DT(eot=0) / Raw(pdu[:9])))
    talk.send("c", bytes(TPKT() / COTP_DT() / Raw(pdu[9:])))
    _, whole, _, joined = seen(tmp_path, talk.packets)
    assert [type(packet[COTP_DT].payload) for packet in (whole, joined)] == [Raw, Raw]
    assert (whole[Raw].load, joined[Raw].load) == (pdu, pdu)


def test_a_fragment_that_looks_like_s7_is_none(tmp_path: Path) -> None:
    """The end of an S7comm-plus TSDU that happens to begin with 0x32 0x01."""
    talk = Talk().open()
    head = b"\x72\x01" + (len(READ) - 7).to_bytes(2, "big")
    talk.send("c", bytes(TPKT() / COTP_DT(eot=0) / Raw(head)))
    rest = READ[7:] + b"\x72\x01\x00\x00"
    end = TPKT() / COTP_DT() / Raw(rest)
    assert S7 in TPKT(bytes(end))
    talk.send("c", bytes(end))
    _, last = seen(tmp_path, talk.packets)
    assert S7 not in last
    assert bytes(last[S7Plus]) == head + rest


def test_a_pdu_that_the_capture_cut_comes_without_tpkt(tmp_path: Path) -> None:
    talk = Talk().open()
    whole = talk.send("p", ANSWER)
    size = len(whole)
    cut = Ether(bytes(whole)[:-3])
    cut.time, cut.wirelen = whole.time, size
    talk.packets[-1] = cut
    (packet,) = seen(tmp_path, talk.packets)
    assert TPKT not in packet
    assert bytes(packet[S7]) == ANSWER[7:-3]
    assert packet[S7_ReadVarAnswer].data[0].length == 48


def test_what_waits_behind_a_hole_is_delivered_at_the_end(tmp_path: Path) -> None:
    talk = Talk().open()
    talk.send("c", READ)
    talk.seq["c"] += 500
    talk.send("c", READ)
    session = S7Session()
    delivered = seen(tmp_path, talk.packets, session)
    assert [bytes(packet[TPKT]) for packet in delivered] == [READ, READ]
    (pipeline,) = session.pipelines.values()
    assert pipeline.counters.octets.missing == 500
    assert sum(pipeline.counters.packet_counts().values()) == len(talk.packets)


def test_any_port_vlan_and_ipv6(tmp_path: Path) -> None:
    talk = Talk(("02:00:00:00:00:01", "2001:db8::1", 4000), ("02:00:00:00:00:02", "2001:db8::2", 2102)).open()
    talk.send("c", CONNECT)
    talk.send("c", READ)
    tagged: list[Packet] = []
    for packet in talk.packets:
        frame = Ether(src=packet.src, dst=packet.dst) / Dot1Q(vlan=7) / Dot1Q(vlan=9) / packet.payload
        frame.time = packet.time
        tagged.append(frame)
    _, read = seen(tmp_path, tagged)
    assert (read[IPv6].src, read[IPv6].dst) == ("2001:db8::1", "2001:db8::2")
    assert (read[TCP].sport, read[TCP].dport) == (4000, 2102)
    assert [layer.vlan for layer in read.iterpayloads() if isinstance(layer, Dot1Q)] == [7, 9]
    assert (read.src, read.dst) == ("02:00:00:00:00:01", "02:00:00:00:00:02")
    assert read[S7].pdu_ref == 0x0200
    assert Ether(bytes(read))[TCP].payload.load == READ


def test_other_traffic_is_not_delivered(tmp_path: Path) -> None:
    talk = Talk().open()
    talk.send("c", b"GET / HTTP/1.1\r\n\r\n")
    other = Ether(src=CLIENT[0], dst=PLC[0]) / IP(src=CLIENT[1], dst=PLC[1]) / UDP(sport=1, dport=2) / Raw(b"x")
    other.time = START
    assert seen(tmp_path, [*talk.packets, other]) == []


def test_each_capture_has_a_pipeline_of_its_own(tmp_path: Path) -> None:
    paths = []
    for number in range(2):
        talk = Talk().open()
        talk.send("c", READ[: 10 + number])
        talk.send("c", READ[10 + number :])
        paths.append(str(tmp_path / f"{number}.pcap"))
        wrpcap(paths[-1], talk.packets)
    session = S7Session()
    delivered = sniff(offline=paths, session=session)
    assert [bytes(packet[TPKT]) for packet in delivered] == [READ, READ]
    assert len(session.pipelines) == 2


def test_packets_in_memory(tmp_path: Path) -> None:
    talk = Talk().open()
    talk.send("c", READ[:9])
    talk.send("c", READ[9:])
    (only,) = sniff(offline=talk.packets, session=S7Session)
    assert bytes(only[TPKT]) == READ


def test_a_delivered_packet_can_be_written_and_read_again(tmp_path: Path) -> None:
    talk = Talk().open()
    talk.send("c", bytes(TPKT() / COTP_DT() / S7(pdu_ref=3) / S7_ReadVarRequest(items=[at("MB0")])))
    (packet,) = seen(tmp_path, talk.packets)
    again = Ether(bytes(packet))
    assert again.summary() == packet.summary()
    assert isinstance(again.lastlayer().payload, NoPayload)


#: S7 PDUs and TPKTs of each shared capture; the PDUs are those of SOURCES.tsv, no duplicates among them.
SHARED = {
    "cotp_unknown_payload_rst.pcapng": (4, 0),
    "plc4x_manual_test_tpdu_nr.pcapng": (242, 242),
    "s7comm_and_s7commplus_sll.pcap": (157, 34),
    "s7comm_clean.pcap": (5274, 5274),
    "s7comm_downloading_block_db1.pcap": (78, 48),
    "s7comm_reading_plc_status.pcap": (218, 144),
    "s7comm_reading_setting_plc_time.pcap": (41, 26),
    "s7comm_varservice_libnodavedemo.pcap": (18, 16),
    "s7commplus_1511_opc_all_types.pcap": (29, 0),
    "s7ident_refused_upload.pcap": (24, 22),
    "scanner_two_connections.pcap": (12, 8),
    "step7_s300_AuthPassword.pcapng": (6, 6),
    "step7_s300_rwVarTab.pcapng": (24, 16),
    "step7_s300_stop.pcapng": (4, 4),
    "tia_s300_goOnline.pcapng": (448, 448),
    "water_pump_hmi.pcapng": (20, 18),
    "wincc_s300_setup-alarm-read-write.pcapng": (164, 164),
}


@pytest.mark.parametrize("name", SHARED)
def test_shared_captures_give_every_pdu_once(corpus: Path, name: str) -> None:
    counted = [0, 0]

    def count(packet: Packet) -> None:
        counted[0] += TPKT in packet
        counted[1] += S7 in packet

    sniff(offline=str(corpus / name), session=S7Session, prn=count, store=False)
    assert tuple(counted) == SHARED[name]


#: Answers that name another group and subfunction than was asked: the engine pairs them, `answers` does not take them.
ANSWERED_ELSEWHERE = {"blocks-python": 1}


@each("path", sorted(CAPTURES.glob("*.toml")))
def test_our_captures_give_what_they_expect(path: Path) -> None:
    expected = tomllib.loads(path.read_text(encoding="utf-8"))["expected"]
    pdus: list[Packet] = [
        packet for packet in sniff(offline=str(path.with_suffix(".pcapng")), session=S7Session) if S7 in packet
    ]
    assert len(pdus) == expected["s7_pdus"]
    told = [function_of(pdu[S7].payload) for pdu in pdus]
    functions = Counter(f"0x{function:02x}" for function in told if function is not None)
    assert functions == Counter(expected["functions"])
    assert answered(pdus) == expected["answered"] - ANSWERED_ELSEWHERE.get(path.stem, 0)


def answered(pdus: list[Packet]) -> int:
    """Count the answers that find their request by `answers` alone, the oldest one of the connection first."""
    found = 0
    waiting: list[Packet] = []
    for pdu in pdus:
        for asked in waiting:
            same = (pdu[TCP].sport, pdu[TCP].dport) == (asked[TCP].dport, asked[TCP].sport)
            if same and pdu[S7].hashret() == asked[S7].hashret() and pdu[S7].answers(asked[S7]):
                found += 1
                waiting.remove(asked)
                break
        else:
            waiting.append(pdu)
    return found


# ---- what is written is a stream again --------------------------------------------------------------------------------


#: Captures of which not everything can be written again, and why.
NOT_STREAMS = {
    "vlan.pcapng": "one stream in several VLANs, which only its SYNs tell apart",
    "snaplen.pcapng": "PDUs that were cut come without TPKT",
    "sections.pcapng": "times that no pcap file can hold",
    "s7commplus-tls.pcapng": "what was decrypted has no place in the stream",
    "link-types.pcapng": "Scapy reads no such link",
    "ip-headers.pcapng": "Scapy raises for a TCP header that is cut, when debugging",
    "ip-fragments.pcapng": "Scapy raises for a fragment, when debugging",
}


def transactions_of(path: Path) -> list[Any]:
    """Return what is said of the transactions of a capture; why one has no answer may be a FIN, which is in no TPKT."""
    found = []
    for event in dissect.open(path, pdus=False):
        if isinstance(event, dissect.Transaction):
            errors = [repr(error) for error in event.errors]
            parts = (
                event.function_name,
                int(event._outcome),
                event.latency_ns,
                event.request_octets,
                event.response_octets,
            )
            found.append((*parts, errors, event.unseen))
    return sorted(found, key=repr)


@pytest.mark.parametrize(
    "path", [path for path in sorted(CAPTURES.rglob("*.pcap*")) if path.suffix in {".pcap", ".pcapng"}], ids=str
)
def test_what_is_written_has_the_same_transactions(path: Path, tmp_path: Path) -> None:
    expected = transactions_of(path)
    if path.name in NOT_STREAMS or not expected:
        return
    delivered = sniff(offline=str(path), session=S7Session)
    again = tmp_path / "again.pcap"
    wrpcap(str(again), delivered, nano=True)
    assert transactions_of(again) == expected


def test_packets_of_ones_own_are_fed(tmp_path: Path) -> None:
    talk = Talk().open()
    talk.send("c", READ[:10])
    talk.send("c", READ[10:])
    talk.send("p", ANSWER)
    session = S7Session()
    fed = [one for packet in talk.packets for one in session.feed(packet)] + list(session.finish())
    assert [bytes(one[TPKT]) for one in fed] == [READ, ANSWER]
    assert [(one[TCP].seq, one[TCP].ack) for one in fed] == [(1001, 5001), (5001, 1001 + len(READ))]
    with pytest.raises(TypeError, match="use feed"):
        S7Session().process(talk.packets[3])
