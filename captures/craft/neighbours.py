"""What is not S7comm on port 102, and what is not TPKT and looks like it."""

from __future__ import annotations

from captures.craft.case import Case, crafts
from captures.craft.pdus import dt
from captures.craft.talk import CLIENT, SERVER, Talk
from dissect.layers import COTP_CC, COTP_CR

TLS_HELLO = bytes.fromhex("16 03 01 00 2f 01 00 00 2b 03 03") + bytes(41)
TLS_DATA = bytes.fromhex("17 03 03 00 10") + bytes(16)
SESSION = bytes.fromhex("10 05 06 13 01 00 16 01 02 14 02 00 02 c1 02 31 80")
"""ISO session CONNECT and ACCEPT, behind their first octet."""
MMS_READ = bytes.fromhex("01 00 01 00 61 0c 30 0a 02 01 03 a0 05 a0 03 02 01 01")


@crafts(
    "Others on port 102, one connection each, none of it S7comm: S7comm-plus of three versions (with an opcode "
    "0x32 inside), TLS inside COTP, MMS, RDP by cookie and by negotiation, TLS and HTTP without TPKT, and a "
    "protocol nobody knows inside COTP."
)
def look_alikes(case: Case) -> None:
    port = 49152

    def talk_of(*messages: bytes, transport: bool = True, foreign: bool = True) -> None:
        """A connection whose two ends send these in turn; if it is ``foreign``, it is reported once."""
        nonlocal port
        port += 1
        talk = Talk(case, client_port=port)
        talk.open()
        if transport:
            talk.connect()
        if messages[0][0] != 3:
            # No ISO-on-TCP; on its port a TPKT might still have come, so that every octet was looked at.
            case.count(connections=-1)
            case.skip(sum(len(message) for message in messages))
        if not transport:
            case.table("ignored", other_protocol=len(messages))
        for number, message in enumerate(messages):
            talk.send((CLIENT, SERVER)[number % 2], message)
        talk.close()
        if foreign:
            case.find("session.foreign_on_102")

    for version in (1, 2, 3):
        talk_of(*[plus(version, opcode, number) for number in (1, 2) for opcode in (0x31, 0x32)], foreign=False)
        case.count(answered=2)
    case.table("tsdus", s7comm_plus=12)
    talk_of(dt(TLS_HELLO), dt(TLS_HELLO), dt(TLS_DATA), dt(TLS_DATA))
    case.table("tsdus", tls=4)
    talk_of(dt(b"\x0d" + SESSION), dt(b"\x0e" + SESSION), dt(MMS_READ), dt(MMS_READ))
    case.table("tsdus", mms=4)
    talk_of(*[dt(b"\x55\xaa" + bytes(20))] * 2)
    case.table("tsdus", unknown=2)
    # RDP, which writes what it likes where a CR has its parameters.
    cookie = b"Cookie: mstshash=operator\r\n" + bytes.fromhex("0100080003000000")
    chosen = bytes.fromhex("0200080001000000")
    talk_of(rdp(COTP_CR(src_ref=1), cookie), rdp(COTP_CC(dst_ref=1, src_ref=2), chosen), TLS_HELLO, transport=False)
    talk_of(rdp(COTP_CR(src_ref=1), chosen.replace(b"\x02", b"\x01")), rdp(COTP_CC(dst_ref=1), chosen), transport=False)
    # No TPKT at all.
    talk_of(TLS_HELLO, TLS_HELLO, TLS_DATA, TLS_DATA, transport=False)
    talk_of(b"GET / HTTP/1.1\r\nHost: plc\r\n\r\n", b"HTTP/1.1 404 Not Found\r\n\r\n", transport=False)


def plus(version: int, opcode: int, number: int) -> bytes:
    """A TPKT with S7comm-plus, the end of a sequence; from version 3 on its content is protected, and has an integrity id."""
    head = bytes([opcode]) + bytes.fromhex("00 00 05 60 00 00") + number.to_bytes(2, "big")
    content = head + (bytes.fromhex("00 00 01 20 34 00 00") if opcode == 0x31 else bytes.fromhex("34 00"))
    integrity_id = 6 + number if opcode == 0x31 else 6 + 2 * number
    content += bytes([integrity_id]) * (version == 3) + bytes(4)
    if version == 3:
        content = b"\x20" + b"\x5a" * 32 + content
    return dt(bytes([0x72, version]) + len(content).to_bytes(2, "big") + content + bytes([0x72, version, 0, 0]))


def rdp(tpdu: COTP_CR | COTP_CC, variable: bytes) -> bytes:
    """A CR or CC as RDP sends it: text or a negotiation structure instead of parameters."""
    octets = bytes(tpdu)
    octets = bytes([len(octets) - 1 + len(variable)]) + octets[1:] + variable
    return b"\x03\x00" + (4 + len(octets)).to_bytes(2, "big") + octets


@crafts(
    "Other ports whose traffic begins like a TPKT: Modbus with transaction number 0x0300, H.323, and a length "
    "that no TPDU fits. None of it is taken for ISO-on-TCP."
)
def false_starts(case: Case) -> None:
    case.ports = []
    modbus = bytes.fromhex("03 00 00 00 00 06 01 03 00 6b 00 03")
    answer = bytes.fromhex("03 00 00 00 00 09 01 03 06 02 2b 00 00 00 64")
    setup = bytes.fromhex("03 00 00 1c 08 02 00 01 05 04 03 88 93 a5 28 0a") + bytes(12)
    odd = bytes.fromhex("03 00 00 08 ff f0 80 00")
    for port, messages in ((502, (modbus, answer)), (1720, (setup, setup)), (4000, (odd, odd))):
        talk = Talk(case, port=port)
        talk.open()
        case.counts["connections"] -= 1
        for number in range(10):
            talk.send(number % 2, messages[number % 2])
        talk.close()
    case.table("ignored", other_protocol=30)
