"""The engine and the Scapy layers read every shared capture alike: every field of every TPDU, header, item and data item."""

from __future__ import annotations

from pathlib import Path

import pytest
from scapy.packet import NoPayload, Packet, Raw

from dissect.layers import (
    COTP,
    COTP_DT,
    S7,
    S7_USEND,
    TPKT,
    S7_Any,
    S7_Function,
    S7_ReadVarRequest,
    S7_Setup,
    S7_Userdata,
    S7_UserdataExtended,
    S7_WriteVarAnswer,
    S7_WriteVarRequest,
)
from dissect.layers.fields import scapy_name
from dissect.layers.parts import CLASSES, JOINED
from dissect.layers.s7 import function_of
from dissect.protocols.iso.cotp import Tpdu, parse_tpdu
from dissect.protocols.iso.upper import is_rdp_connect
from dissect.protocols.s7.bodies import parse_body
from dissect.protocols.s7.layouts import USERDATA_EXTENDED, USERDATA_SHORT
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7.parameters import header_size
from dissect.protocols.s7.tables import ROSCTR
from dissect.wire.part import SURPLUS, Part
from tests.cases import each
from tests.layers.examples import EXAMPLES, Example
from tests.layers.support import tpkts_of

CAPTURES = Path(__file__).resolve().parent.parent.parent / "captures"


def assert_read_alike(octets: bytes) -> None:
    """Compare the two readings of one TPKT, and build it again from the layers."""
    packet = TPKT(octets)
    assert bytes(packet) == octets
    content = octets[4:]
    if len(content) >= 2 and 2 <= content[0] + 1 <= len(content):
        assert_same_tpdu(packet.payload, parse_tpdu(content))
    if S7 in packet:
        assert_same_pdu(packet[S7], parse_pdu(bytes(packet[S7])))
    packet.clear_cache()
    assert bytes(packet) == octets


def assert_same_tpdu(layer: Packet, tpdu: Tpdu) -> None:
    assert isinstance(layer, COTP)
    if tpdu.malformed:
        return
    for value in tpdu.fields:
        assert layer.getfieldval(value.field.name) == value.value, value.field.name
    if is_rdp_connect(tpdu.variable):
        assert [bytes(one) for one in layer.parameters] == [tpdu.variable]
    else:
        assert [(one.code, one.value) for one in layer.parameters] == [(one.code, one.value) for one in tpdu.parameters]
    assert bytes(layer.payload) == tpdu.data
    is_s7 = is_whole_header(tpdu.data)
    assert isinstance(layer.payload, S7) == (isinstance(layer, COTP_DT) and tpdu.field("eot") == 1 and is_s7)


def is_whole_header(octets: bytes) -> bool:
    return octets[:1] == b"\x32" and len(octets) >= 10 and octets[1] in ROSCTR and len(octets) >= header_size(octets[1])


def assert_same_pdu(layer: S7, pdu: Pdu) -> None:
    for name in ("rosctr", "redundancy_id", "pdu_ref", "param_length", "data_length"):
        assert layer.getfieldval(name) == getattr(pdu, name), name
    if pdu.error_class >= 0:
        assert (layer.error_class, layer.error_code) == (pdu.error_class, pdu.error_code)
    body = layer.payload
    if isinstance(body, NoPayload):
        assert pdu.function == -1
        assert not pdu.data
        return
    function = function_of(body)
    assert pdu.function == (-1 if function is None else function)
    assert_same_parts(body, pdu)
    if isinstance(body, S7_Setup):
        setup = pdu.parameters.setup
        assert setup is not None
        assert setup.as_dict() == {name: body.getfieldval(name) for name in setup.as_dict()}
    if isinstance(body, S7_Userdata):
        assert_same_userdata(body, pdu)
    assert_same_items(body, pdu)
    if isinstance(body, S7_WriteVarAnswer):
        assert body.return_codes == pdu.return_codes()


def assert_same_userdata(body: S7_Userdata, pdu: Pdu) -> None:
    head = pdu.parameters.userdata
    assert head is not None
    assert head.extended == isinstance(body, S7_UserdataExtended)
    names = ["type", "group", "subfunction", "sequence"]
    names += ["data_unit_ref", "last_data_unit", "error_code"] if head.extended else []
    for name in names:
        assert body.getfieldval(name) == getattr(head, name), name


def assert_same_parts(body: Packet, pdu: Pdu) -> None:
    """The lists of a body are the engine's parts, field by field; what no list holds is left over."""
    told = parse_body(pdu)
    if isinstance(body, S7_Function):
        assert_list(body.parameters, told.parameters, pdu.octets)
        assert_list(body.data, told.data, pdu.octets)
    elif isinstance(body, S7_Userdata):
        size = (USERDATA_EXTENDED if isinstance(body, S7_UserdataExtended) else USERDATA_SHORT).size
        behind = [part for part in told.parameters if part.offset >= pdu.header_size + size]
        assert b"".join(pdu.octets[part.offset : part.end] for part in behind) == body.parameter_rest
        assert_list(body.data, told.data, pdu.octets)
    elif isinstance(body, S7_USEND):
        assert_list(body.data, told.data, pdu.octets)
    elif isinstance(body, S7_ReadVarRequest | S7_WriteVarRequest):
        assert_list(body.items, [part for part in told.parameters[1:] if part.layout is not SURPLUS], pdu.octets)


def assert_list(packets: list[Packet], parts: list[Part], octets: bytes) -> None:
    left = list(parts)
    for packet in packets:
        part = left.pop(0)
        own = octets[part.offset : part.end]
        if len(own) < part.layout.size:
            assert type(packet) is Raw
            assert packet.load == own
            continue
        assert type(packet) is CLASSES[part.layout]
        for value in part.values:
            given = packet.getfieldval(scapy_name(value.field.name))
            assert given == (value.value if value.octets is None else value.octets), (
                part.layout.name,
                value.field.name,
            )
        while left and left[0].layout in JOINED.get(part.layout, ()):
            own += octets[left[0].offset : left[0].end]
            left.pop(0)
        assert bytes(packet) == own
    assert not left


def assert_same_items(body: Packet, pdu: Pdu) -> None:
    if isinstance(body, S7_ReadVarRequest | S7_WriteVarRequest):
        for item, parsed in zip(body.items, pdu.parameters.items, strict=True):
            assert item.syntax_id == parsed.syntax_id
            if isinstance(item, S7_Any):
                read = (item.transport_size, item.count, item.db, item.area, item.address)
                assert read == (parsed.transport_size, parsed.count, parsed.db, parsed.area, parsed.start_bit)
                assert item.describe() == parsed.label
            else:
                assert bytes(item).startswith(parsed.octets)
    items = pdu.data_items()
    if items:
        for item, given in zip(body.data, items, strict=True):
            assert (item.return_code, item.transport_size, item.length) == (
                given.return_code,
                given.transport_size,
                given.length,
            )
            assert item.octets == given.data


@each("example", EXAMPLES)
def test_worked_examples(example: Example) -> None:
    assert_read_alike(example.octets)


#: Each shared capture, the distinct TPKTs that can be taken from it without reassembly, and how many of them hold S7.
SHARED = {
    "cotp_unknown_payload_rst.pcapng": (4, 0),
    "mms_header_in_own_segment.pcap": (55, 0),
    "mms_one_sided_read_request.pcap": (5, 0),
    "plc4x_manual_test_tpdu_nr.pcapng": (242, 242),
    "rdp-proprietary-encryption.pcap": (75, 0),
    "s7comm_and_s7commplus_sll.pcap": (157, 34),
    "s7comm_clean.pcap": (5274, 5274),
    "s7comm_downloading_block_db1.pcap": (48, 41),
    "s7comm_reading_plc_status.pcap": (147, 144),
    "s7comm_reading_setting_plc_time.pcap": (29, 26),
    "s7comm_varservice_libnodavedemo.pcap": (18, 16),
    "s7commplus_1511_opc_all_types.pcap": (21, 0),
    "s7ident_refused_upload.pcap": (24, 22),
    "scanner_two_connections.pcap": (10, 6),
    "step7_s300_AuthPassword.pcapng": (6, 6),
    "step7_s300_rwVarTab.pcapng": (16, 15),
    "step7_s300_stop.pcapng": (4, 4),
    "tia_s300_goOnline.pcapng": (448, 448),
    "water_pump_hmi.pcapng": (20, 18),
    "wincc_s300_setup-alarm-read-write.pcapng": (58, 58),
}


def assert_all_read_alike(found: list[bytes]) -> int:
    """Build each TPKT again, read both ways those that differ in more than the PDU reference; return how many hold S7."""
    kinds: dict[bytes, bytes] = {}
    pdus = 0
    for octets in found:
        packet = TPKT(octets)
        assert bytes(packet) == octets
        pdus += S7 in packet
        kinds.setdefault(octets[:11] + octets[13:], octets)
    for octets in kinds.values():
        assert_read_alike(octets)
    return pdus


@pytest.mark.parametrize("name", SHARED)
def test_shared_captures(corpus: Path, name: str) -> None:
    found = tpkts_of(corpus / name)
    assert (len(found), assert_all_read_alike(found)) == SHARED[name]


def test_our_captures() -> None:
    crafted = ("reference-examples", "s7-lengths", "refusals", "plc-asks")
    paths = [*sorted(CAPTURES.glob("*.pcap*")), *(CAPTURES / "crafted" / f"{name}.pcapng" for name in crafted)]
    found = [octets for path in paths for octets in tpkts_of(path)]
    assert len(paths) > 1
    assert assert_all_read_alike(found) > len(paths)
