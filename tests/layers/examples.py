"""The worked examples of the protocol reference (section 8): octets, sender, and the summary line.

The octets are the reference's, whole TPKTs; tshark 4.0.17 decodes every one of them as in the reference.
"""

# ruff: noqa: E501  # a line that a person must see stands as it is

from __future__ import annotations

from typing import Final


class Example:
    """A message: the number the reference gives it, its octets, whether the client sent it, and its summary."""

    def __init__(self, number: int, from_client: bool, octets: str, summary: str) -> None:
        self.number = number
        self.from_client = from_client
        self.octets = bytes.fromhex(octets)
        self.summary = summary

    def __repr__(self) -> str:
        return f"{self.number} {self.summary}"


EXAMPLES: Final = [
    Example(13, True, "0300001611e00000004b00c0010ac1020100c2020103", "COTP CR 01.00 -> 01.03 rack 0 slot 3"),
    Example(14, False, "0300001611d0004b000600c0010ac1020100c2020103", "COTP CC 01.00 -> 01.03 rack 0 slot 3"),
    Example(
        15,
        True,
        "030000241fe00000011200c1020600c21053494d415449432d524f4f542d484d49c0010a",
        "COTP CR 06.00 -> SIMATIC-ROOT-HMI",
    ),
    Example(
        16, False, "0300000b06800112000082", "COTP DR connection negotiation failed (proposed classes not supported)"
    ),
    Example(17, False, "0300000f0a800112000003e0020102", "COTP DR address unknown"),
    Example(18, True, "0300000a05c00006004b", "COTP DC"),
    Example(19, False, "0300000d0870004b01c10211e0", "COTP ER invalid parameter code"),
    Example(
        20, True, "0300001c17e00000002121c0010bc1020100c2020102c60101c70100", "COTP CR 01.00 -> 01.02 rack 0 slot 2"
    ),
    Example(21, True, "0300001104f00021830102030405060708", "COTP DT EOT / Raw"),
    Example(22, False, "030000090462002104", "COTP AK"),
    Example(23, False, "030000090451002102", "COTP RJ"),
    Example(24, True, "0300000b04100021800102", "COTP ED / Raw"),
    Example(25, False, "030000090420002100", "COTP EA"),
    Example(
        26,
        True,
        "0300001902f08032010000010000080000f0000001000101e0",
        "S7 Job Setup communication ref=0x0100 amq=1/1 pdu=480",
    ),
    Example(
        27,
        False,
        "0300001b02f080320300000100000800000000f0000001000100f0",
        "S7 Ack_Data Setup communication ref=0x0100 amq=1/1 pdu=240",
    ),
    Example(
        28,
        True,
        "0300001f02f080320100000200000e00000401120a10040003000a84000020",
        "S7 Job Read Var ref=0x0200 DB10.DBW4 x3",
    ),
    Example(
        29,
        False,
        "0300001f02f0803203000002000002000a00000401ff040030001102200333",
        "S7 Ack_Data Read Var ref=0x0200 1 ok",
    ),
    Example(
        30,
        True,
        "0300003702f080320100000300002600000403120a10010001000083000053120a10020003000784000000120a10080001000784000040",
        "S7 Job Read Var ref=0x0300 M10.3, DB7.DBB0 x3, DB7.DBD8",
    ),
    Example(
        31,
        False,
        "0300002b02f0803203000003000002001600000403ff0300010100ff040018a1b2c300ff07000442f6e979",
        "S7 Ack_Data Read Var ref=0x0300 3 ok",
    ),
    Example(
        32,
        True,
        "0300003702f080320100000400002600000403120a10020002000784000000120a1002000103e784000000120a101d000200001d000005",
        "S7 Job Read Var ref=0x0400 DB7.DBB0 x2, DB999.DBB0, T5 x2",
    ),
    Example(
        33,
        False,
        "0300002702f0803203000004000002001200000403ff04001012340a000000ff09000410051006",
        "S7 Ack_Data Read Var ref=0x0400 2 ok, Object does not exist",
    ),
    Example(
        34,
        True,
        "0300003702f080320100000480002600000403120a10070001000184000000120a10030003000184000050120a101c000100001c000005",
        "S7 Job Read Var ref=0x0480 DB1.DBD0, DB1.DBB10 x3, C5",
    ),
    Example(
        35,
        False,
        "0300002b02f0803203000004800002001600000403ff050020fffffffeff09000361626300ff0900020123",
        "S7 Ack_Data Read Var ref=0x0480 3 ok",
    ),
    Example(
        36,
        True,
        "0300002102f080320100000500001000000401120cb00202004401600100480030",
        "S7 Job Read Var ref=0x0500 DB68.DBB352 x2+DB72.DBB48",
    ),
    Example(
        37,
        False,
        "0300001e02f0803203000005000002000900000401ff090005ff0001ff7a",
        "S7 Ack_Data Read Var ref=0x0500 1 ok",
    ),
    Example(
        38,
        True,
        "0300001d02f080320100000600000c0000040112088241000100017f01",
        "S7 Job Read Var ref=0x0600 NCK C1 module S column 1 line 1",
    ),
    Example(
        39,
        True,
        "0300002302f080320100000700001200000401120eb2ff8a0e00011122334440000009",
        "S7 Job Read Var ref=0x0700 SYM DB1 LID 9",
    ),
    Example(
        40,
        True,
        "0300002402f080320100000800000e00050501120a100100010000830000100003000101",
        "S7 Job Write Var ref=0x0800 M2.0",
    ),
    Example(41, False, "0300001602f0803203000008000002000100000501ff", "S7 Ack_Data Write Var ref=0x0800 1 ok"),
    Example(
        42,
        True,
        "0300003902f080320100000900001a000e0502120a10020001000384000028120a10040002000384000050000400085a000004002000640065",
        "S7 Job Write Var ref=0x0900 DB3.DBB5, DB3.DBW10 x2",
    ),
    Example(
        43,
        False,
        "0300001702f0803203000009000002000200000502ff05",
        "S7 Ack_Data Write Var ref=0x0900 1 ok, Invalid address",
    ),
    Example(
        44,
        False,
        "0300001302f080320200000901000000008104",
        "S7 Ack ref=0x0901 error 0x8104 Service not implemented or frame error",
    ),
    Example(
        45,
        True,
        "0300002302f080320100000a00001200001d00000000000000095f3041303030303141",
        "S7 Job Start upload ref=0x0a00 DB 1, active",
    ),
    Example(
        46,
        False,
        "0300002302f080320300000a000010000000001d000100000000070730303030323136",
        "S7 Ack_Data Start upload ref=0x0a00 upload 7, 216 bytes",
    ),
    Example(47, True, "0300001902f080320100000b00000800001e00000000000007", "S7 Job Upload ref=0x0b00 upload 7"),
    Example(
        48,
        False,
        "0300002102f080320300000b000002000c00001e00000800fb7070010105080001",
        "S7 Ack_Data Upload ref=0x0b00 8 bytes",
    ),
    Example(49, True, "0300001902f080320100000c00000800001f00000000000007", "S7 Job End upload ref=0x0c00 upload 7"),
    Example(50, False, "0300001402f080320300000c000001000000001f", "S7 Ack_Data End upload ref=0x0c00"),
    Example(51, False, "0300001302f080320200000c0100000000d209", "S7 Ack ref=0x0c01 error 0xd209 Block not found"),
    Example(
        52,
        True,
        "0300003102f080320100000d00002000001a00010000000000095f30413030303031500d31303030323136303030303838",
        "S7 Job Request download ref=0x0d00 DB 1, passive, 216 bytes, 88 of them MC7 code",
    ),
    Example(53, False, "0300001402f080320300000d000001000000001a", "S7 Ack_Data Request download ref=0x0d00"),
    Example(
        54,
        False,
        "0300002302f080320100000165001200001b00000000000000095f3041303030303150",
        "S7 Job Download block ref=0x0165 DB 1, passive",
    ),
    Example(
        55,
        True,
        "0300001f02f0803203000001650002000a00001b01000600fb7070010105aa",
        "S7 Ack_Data Download block ref=0x0165 more to come, 6 bytes",
    ),
    Example(
        56,
        False,
        "0300002302f080320100000167001200001c00000000000000095f3041303030303150",
        "S7 Job Download ended ref=0x0167 DB 1, passive",
    ),
    Example(57, True, "0300001402f0803203000001670001000000001c", "S7 Ack_Data Download ended ref=0x0167"),
    Example(
        58,
        True,
        "0300002b02f080320100000e00001a000028000000000000fd000a01003041303030303150055f494e5345",
        "S7 Job PI service ref=0x0e00 _INSE: link in (activate) blocks loaded to the passive file system, block DB 1, passive",
    ),
    Example(59, False, "0300001402f080320300000e0000010000000028", "S7 Ack_Data PI service ref=0x0e00"),
    Example(
        60,
        False,
        "0300001502f080320300000e0100020000d2a92802",
        "S7 Ack_Data PI service ref=0x0e01 error 0xd2a9 CPU parameters being assigned",
    ),
    Example(
        61,
        True,
        "0300002b02f080320100000f00001a000028000000000000fd000a01003041303030303141055f44454c45",
        "S7 Job PI service ref=0x0f00 _DELE: delete blocks, block DB 1, active",
    ),
    Example(
        62,
        True,
        "0300002502f0803201000010000014000028000000000000fd000009505f50524f4752414d",
        "S7 Job PI service ref=0x1000 P_PROGRAM: start the CPU, warm restart",
    ),
    Example(
        63,
        True,
        "0300002702f0803201000011000016000028000000000000fd0002432009505f50524f4752414d",
        'S7 Job PI service ref=0x1100 P_PROGRAM: start the CPU, "C ", cold restart',
    ),
    Example(
        64,
        True,
        "0300002302f0803201000012000012000028000000000000fd00024550055f4d4f4455",
        'S7 Job PI service ref=0x1200 _MODU: copy RAM to ROM, "EP"',
    ),
    Example(
        65,
        True,
        "0300002102f0803201000013000010000028000000000000fd0000055f47415242",
        "S7 Job PI service ref=0x1300 _GARB: compress memory",
    ),
    Example(
        66,
        True,
        "0300002102f0803201000014000010000029000000000009505f50524f4752414d",
        "S7 Job PLC stop ref=0x1400 P_PROGRAM",
    ),
    Example(67, False, "0300001402f08032030000140000010000000029", "S7 Ack_Data PLC stop ref=0x1400"),
    Example(
        68,
        True,
        "0300002102f080320700001500000800080001120411440100ff09000404240000",
        "S7 Userdata request CPU functions: read SZL ref=0x1500 SZL 0x0424 operating modes",
    ),
    Example(
        69,
        False,
        "0300003d02f080320700001500000c0020000112081284010200000000ff09001c04240000001400015144ff0800000000000000002311142215306213",
        "S7 Userdata response CPU functions: read SZL ref=0x1500 SZL 0x0424 operating modes, RUN, event 0x5144 run-time event",
    ),
    Example(
        70,
        False,
        "0300002f02f080320700001600000c00120001120812840103d5010000ff09000e000000000002000600000f000011",
        "S7 Userdata response CPU functions: read SZL ref=0x1600 SZL 0x0000 list of available SZL ids",
    ),
    Example(
        71,
        True,
        "0300002102f080320700001700000c00040001120812440103000000000a000000",
        "S7 Userdata request CPU functions: read SZL ref=0x1700",
    ),
    Example(
        72,
        False,
        "0300002702f080320700001700000c000a0001120812840103d5000000ff0900060f11001c0131",
        "S7 Userdata response CPU functions: read SZL ref=0x1700 continuation",
    ),
    Example(
        73,
        False,
        "0300002102f080320700001800000c000400011208128401000000d4020a000000",
        "S7 Userdata response CPU functions: read SZL ref=0x1800 error 0xd402 Invalid SZL index",
    ),
    Example(
        74,
        True,
        "0300001d02f0803207000019000008000400011204114301000a000000",
        "S7 Userdata request block functions: list blocks ref=0x1900",
    ),
    Example(
        75,
        False,
        "0300002902f080320700001900000c000c000112081283010000000000ff0900083038000230410011",
        "S7 Userdata response block functions: list blocks ref=0x1900 2 OB, 17 DB",
    ),
    Example(
        76,
        True,
        "0300001f02f080320700001a00000800060001120411430200ff0900023041",
        "S7 Userdata request block functions: list blocks of type ref=0x1a00 DB",
    ),
    Example(
        77,
        False,
        "0300002902f080320700001a00000c000c000112081283020100000000ff0900080001220500072205",
        "S7 Userdata response block functions: list blocks of type ref=0x1a00 1 (DB), 7 (DB)",
    ),
    Example(
        78,
        True,
        "0300002502f080320700001b000008000c0001120411430300ff0900083041303030303141",
        "S7 Userdata request block functions: get block info ref=0x1b00 block DB 1, active",
    ),
    Example(
        79,
        False,
        "0300006f02f080320700001b00000c0052000112081283030000000000ff09004e0100004a220070700101050a0001000000d80000000002395d992d7003a1638321a70038000000000058415554484f52202046414d494c5920204845414445522020010063cc0000000000000000",
        "S7 Userdata response block functions: get block info ref=0x1b00 block DB 1, version 0.1, "
        "changed 2015-11-06 10:21:53.945, 88 bytes MC7, author A… (98 characters)",
    ),
    Example(
        80,
        True,
        "0300001d02f080320700001c000008000400011204114701000a000000",
        "S7 Userdata request time functions: read clock ref=0x1c00",
    ),
    Example(
        81,
        False,
        "0300002b02f080320700001c00000c000e000112081287010200000000ff09000a00191602081451379162",
        "S7 Userdata response time functions: read clock ref=0x1c00 DT#2016-02-08-14:51:37.916",
    ),
    Example(
        82,
        True,
        "0300002702f080320700001d000008000e0001120411470200ff09000a00202402291200000005",
        "S7 Userdata request time functions: set clock ref=0x1d00 DT#2024-02-29-12:00:00.000",
    ),
    Example(
        83,
        False,
        "0300002102f080320700001d00000c00040001120812870200000000000a000000",
        "S7 Userdata response time functions: set clock ref=0x1d00",
    ),
    Example(
        84,
        True,
        "0300002502f080320700001e000008000c0001120411450100ff0900081110090a6d6d0b0c",
        "S7 Userdata request security: PLC password ref=0x1e00 password (8 bytes, not shown)",
    ),
    Example(
        85,
        False,
        "0300002102f080320700001e00000c00040001120812850101000000000a000000",
        "S7 Userdata response security: PLC password ref=0x1e00",
    ),
    Example(
        86,
        False,
        "0300002102f080320700001e01000c000400011208128501010000d6020a000000",
        "S7 Userdata response security: PLC password ref=0x1e01 error 0xd602 Incorrect password",
    ),
    Example(
        87,
        True,
        "0300002702f080320700001f000008000e0001120411440200ff09000a01005553455231000000",
        "S7 Userdata request CPU functions: message service ref=0x1f00 events: mode transitions",
    ),
    Example(
        88,
        False,
        "0300002302f080320700001f00000c0006000112081284020100000000ff0900020200",
        "S7 Userdata response CPU functions: message service ref=0x1f00",
    ),
    Example(
        89,
        False,
        "0300001902f080320700000000000800000100101000000000",
        "S7 Userdata Mode transition indication ref=0x0000 STOP",
    ),
    Example(
        90,
        False,
        "0300003102f080320700000000000800180001120411040300ff0900144304ff8400000000000000002311142215306213",
        "S7 Userdata push CPU functions: diagnostic message ref=0x0000 0x4304 STOP by a PG or by SFB 20, DT#2023-11-14-22:15:30.621",
    ),
    Example(
        91,
        False,
        "0300003902f080320700000000000800200001120411040500ff09001c23111422153062134001120a1601000000c201000000ff040010002a",
        "S7 Userdata push CPU functions: ALARM_8 indication ref=0x0000 DT#2023-11-14-22:15:30.621, event 0x000000c2: signal 1 on, with 00 2a",
    ),
    Example(
        92,
        True,
        "0300002d02f080320700002000000800140001120411420100ff09001000010101120a10020002000784000000",
        "S7 Userdata request cyclic services: cyclic transfer ref=0x2000 every 1 s, DB7.DBB0 x2",
    ),
    Example(
        93,
        False,
        "0300002902f080320700002000000c000c000112081282010400000000ff0900080001ff04001000aa",
        "S7 Userdata response cyclic services: cyclic transfer ref=0x2000 job 4",
    ),
    Example(
        94,
        False,
        "0300002902f080320700000000000c000c000112081202010400000000ff0900080001ff04001000ab",
        "S7 Userdata push cyclic services: cyclic transfer ref=0x0000 job 4",
    ),
    Example(
        95,
        True,
        "0300001f02f080320700002100000800060001120411420400ff0900020504",
        "S7 Userdata request cyclic services: unsubscribe ref=0x2100 job 4",
    ),
    Example(
        96,
        True,
        "0300004102f080320700002200000c0024000112081241020000000000ff0900200014000800000000000100120001000100010001000100000001020100000006",
        "S7 Userdata request programmer commands (test and installation): variable status ref=0x2200 MW6",
    ),
    Example(
        97,
        True,
        "0300002f02f080320700002300000c0012000112081246010000000000ff09000e12061300000000010004cafe0001",
        "S7 Userdata request PBC (programmable block communication): BSEND ref=0x2300 R_ID 0x00000001, 4 bytes",
    ),
    Example(
        98,
        False,
        "0300002102f080320700002300000c00040001120812860100000000000a000000",
        "S7 Userdata response PBC (programmable block communication): BSEND ref=0x2300",
    ),
    Example(99, True, "0300001302f000320100002400000e00000401", "COTP DT / Raw"),
    Example(100, True, "0300001302f080120a10020010000184000000", "COTP DT EOT / Raw"),
    Example(101, True, "0300000702f000", "COTP DT empty"),
    Example(
        102,
        True,
        "0300001f02f080320100002500000e00000401120a10020001000184000000",
        "S7 Job Read Var ref=0x2500 DB1.DBB0",
    ),
]

BY_NUMBER: Final = {example.number: example for example in EXAMPLES}
