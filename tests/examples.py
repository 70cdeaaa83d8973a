"""The 90 worked messages of the protocol reference (section 8), which Wireshark 4.0.17 decodes as stated there.

Each is the octets from its TPKT header. The blanks between the octets are the reference's: there every group has its own line
and meaning. No two messages have the same title.
"""

from __future__ import annotations

from typing import Final


class Example:
    """A worked message: its section in the reference, its sender, its meaning, its octets as grouped in the reference."""

    def __init__(self, section: str, from_client: bool, title: str, text: str) -> None:
        self.section = section
        self.from_client = from_client
        self.title = title
        self.groups: list[bytes] = [bytes.fromhex(group) for group in text.split()]

    def __repr__(self) -> str:
        return f"{self.section} {self.title}"

    @property
    def octets(self) -> bytes:
        """The message from its TPKT header."""
        return b"".join(self.groups)

    @property
    def cuts(self) -> list[int]:
        """Where the groups begin, from the TPKT header."""
        return [sum(map(len, self.groups[:count])) for count in range(len(self.groups))]


CLIENT: Final = True
PLC: Final = False


#: A session of every S7 function, from its CR to a DC.
S7: Final = (
    Example(
        "8.1", CLIENT, "CR, class 0, two-octet TSAPs (PG -> rack 0 slot 3)",
        "0300 0016 11 e0 0000 004b 00 c0010a c1020100 c2020103",
    ),
    Example(
        "8.1", PLC, "CC answering it (references crossed over, TSAPs repeated unswapped)",
        "0300 0016 11 d0 004b 0006 00 c0010a c1020100 c2020103",
    ),
    Example(
        "8.2", CLIENT, "Job ask for 480-octet PDUs, one job each way",
        "0300 0019 02 f0 80 32 01 0000 0100 0008 0000 f0 00 0001 0001 01e0",
    ),
    Example(
        "8.2", PLC, "Ack_Data the PLC lowers the PDU length to 240",
        "0300001b02f080 320300000100000800000000 f0 00 0001 0001 00f0",
    ),
    Example(
        "8.3", CLIENT, "Job one item, DB10.DBW4 x 3 words",
        "0300 001f 02 f0 80 32 01 0000 0200 000e 0000 04 01 12 0a 10 04 0003 000a 84 000020",
    ),
    Example(
        "8.3", PLC, "Ack_Data six octets (length counted in bits)",
        "0300001f02f080 3203000002000002000a0000 04 01 ff 04 0030 001102200333",
    ),
    Example(
        "8.3", CLIENT, "Job three items - bit, three octets, REAL",
        "0300003702f080 32010000030000260000 04 03 12 0a 10 01 0001 0000 83 000053 12 0a 10 02 0003 0007 84 000000 "
        "12 0a 10 08 0001 0007 84 000040",
    ),
    Example(
        "8.3", PLC, "Ack_Data fill octets after odd-length items that are not the last",
        "0300002b02f080 320300000300000200160000 04 03 ff 03 0001 01 00 ff 04 0018 a1b2c3 00 ff 07 0004 42f6e979",
    ),
    Example(
        "8.3", CLIENT, "Job three items - a data block, a missing data block, timers",
        "0300003702f080 32010000040000260000 04 03 12 0a 10 02 0002 0007 84 000000 12 0a 10 02 0001 03e7 84 000000 "
        "12 0a 10 1d 0002 0000 1d 000005",
    ),
    Example(
        "8.3", PLC, "Ack_Data an item in error is four octets with no data",
        "0300002702f080 320300000400000200120000 04 03 ff040010 1234 0a 00 0000 ff 09 0004 10051006",
    ),
    Example(
        "8.3", CLIENT, "Job DINT, three CHAR, one counter",
        "0300003702f080 32010000048000260000 04 03 120a10 07 0001 0001 84 000000 120a10 03 0003 0001 84 000050 "
        "120a10 1c 0001 0000 1c 000005",
    ),
    Example(
        "8.3", PLC, "Ack_Data DINT comes as data size 0x05 in bits, CHAR and counter as octet strings 0x09",
        "0300002b02f080 320300000480000200160000 04 03 ff 05 0020 fffffffe ff 09 0003 616263 00 ff 09 0002 0123",
    ),
    Example(
        "8.3", CLIENT, "Job DBREAD item (syntax 0xB0), two areas",
        "0300002102f080 32010000050000100000 04 01 12 0c b0 02 02 0044 0160 01 0048 0030",
    ),
    Example(
        "8.3", PLC, "Ack_Data to DBREAD: a return code before each area",
        "0300001e02f080 320300000500000200090000 04 01 ff 09 0005 ff 0001 ff 7a",
    ),
    Example(
        "8.3", CLIENT, "Job Sinumerik NCK item (syntax 0x82)",
        "0300001d02f080 320100000600000c0000 04 01 12 08 82 41 0001 0001 7f 01",
    ),
    Example(
        "8.3", CLIENT, "Job S7-1200 symbolic item (syntax 0xB2)",
        "0300002302f080 32010000070000120000 04 01 12 0e b2 ff 8a0e 0001 11223344 40000009",
    ),
    Example(
        "8.4", CLIENT, "Job set one bit M2.0",
        "0300 0024 02 f0 80 32 01 0000 0800 000e 0005 05 01 12 0a 10 01 0001 0000 83 000010 00 03 0001 01",
    ),
    Example(
        "8.4", PLC, "Ack_Data one return code octet per item",
        "0300001602f080 320300000800000200010000 05 01 ff",
    ),
    Example(
        "8.4", CLIENT, "Job two items, odd first item so a fill octet",
        "0300003902f080 320100000900001a000e 05 02 12 0a 10 02 0001 0003 84 000028 12 0a 10 04 0002 0003 84 000050 "
        "00 04 0008 5a 00 00 04 0020 00640065",
    ),
    Example(
        "8.4", PLC, "Ack_Data second item refused",
        "0300001702f080 320300000900000200020000 05 02 ff 05",
    ),
    Example(
        "8.4", PLC, "Ack whole job refused, error 0x8104 and no parameters",
        "0300001302f080 320200000901000000008104",
    ),
    Example(
        "8.5", CLIENT, "Job Start upload of DB 1 from the active file system",
        "0300 0023 02 f0 80 32 01 0000 0a00 0012 0000 1d 00 0000 00000000 095f3041303030303141",
    ),
    Example(
        "8.5", PLC, "Ack_Data upload id and total length",
        "0300002302f080 320300000a00001000000000 1d 00 0100 00000007 07 30303030323136",
    ),
    Example(
        "8.5", CLIENT, "Job Upload",
        "0300001902f080 320100000b0000080000 1e 00 0000 00000007",
    ),
    Example(
        "8.5", PLC, "Ack_Data last piece",
        "0300002102f080 320300000b000002000c0000 1e 00 0008 00fb 7070010105080001",
    ),
    Example(
        "8.5", CLIENT, "Job End upload",
        "0300001902f080 320100000c0000080000 1f 00 0000 00000007",
    ),
    Example(
        "8.5", PLC, "Ack_Data function code only to end upload",
        "0300001402f080 320300000c00000100000000 1f",
    ),
    Example(
        "8.5", PLC, "Ack (ROSCTR 2) refusing a start upload",
        "0300001302f080 320200000c0100000000d209",
    ),
    Example(
        "8.6", CLIENT, "Job Request download of DB 1 to the passive file system",
        "0300 0031 02 f0 80 32 01 0000 0d00 0020 0000 1a 00 0100 00000000 095f3041303030303150 0d 31 303030323136 "
        "303030303838",
    ),
    Example(
        "8.6", PLC, "Ack_Data to request download",
        "0300001402f080 320300000d00000100000000 1a",
    ),
    Example(
        "8.6", PLC, "Job Download block, sent BY THE PLC",
        "0300002302f080 32010000016500120000 1b 00 0000 00000000 095f3041303030303150",
    ),
    Example(
        "8.6", CLIENT, "Ack_Data with the block data, sent by the client, more to come",
        "0300001f02f080 3203000001650002000a0000 1b 01 0006 00fb 7070010105aa",
    ),
    Example(
        "8.6", PLC, "Job Download ended, sent by the PLC",
        "0300002302f080 32010000016700120000 1c 00 0000 00000000 095f3041303030303150",
    ),
    Example(
        "8.6", CLIENT, "Ack_Data from the client",
        "0300001402f080 320300000167000100000000 1c",
    ),
    Example(
        "8.7", CLIENT, "Job _INSE: activate the block just loaded",
        "0300 002b 02 f0 80 32 01 0000 0e00 001a 0000 28 000000000000fd 000a 01003041303030303150 05 5f494e5345",
    ),
    Example(
        "8.7", PLC, "Ack_Data success is the function code alone",
        "0300001402f080 320300000e00000100000000 28",
    ),
    Example(
        "8.7", PLC, "Ack_Data failure, error in header and status bit 0x02",
        "0300001502f080 320300000e0100020000d2a9 28 02",
    ),
    Example(
        "8.7", CLIENT, "Job _DELE: delete DB 1 from the active file system",
        "0300002b02f080 320100000f00001a0000 28 000000000000fd 000a 01003041303030303141 05 5f44454c45",
    ),
    Example(
        "8.7", CLIENT, "Job P_PROGRAM: warm restart (empty parameter block)",
        "0300002502f080 32010000100000140000 28 000000000000fd 0000 09 505f50524f4752414d",
    ),
    Example(
        "8.7", CLIENT, "Job P_PROGRAM with 'C ': cold restart",
        "0300002702f080 32010000110000160000 28 000000000000fd 0002 4320 09 505f50524f4752414d",
    ),
    Example(
        "8.7", CLIENT, "Job _MODU 'EP': copy RAM to ROM",
        "0300002302f080 32010000120000120000 28 000000000000fd 0002 4550 05 5f4d4f4455",
    ),
    Example(
        "8.7", CLIENT, "Job _GARB: compress memory",
        "0300002102f080 32010000130000100000 28 000000000000fd 0000 05 5f47415242",
    ),
    Example(
        "8.7", CLIENT, "Job PLC stop (function 0x29)",
        "0300002102f080 32010000140000100000 29 0000000000 09 505f50524f4752414d",
    ),
    Example(
        "8.7", PLC, "Ack_Data function code alone",
        "0300001402f080 320300001400000100000000 29",
    ),
    Example(
        "8.8", CLIENT, "Request SZL-ID 0x0424 index 0",
        "0300 0021 02 f0 80 32 07 0000 1500 0008 0008 00 01 12 04 11 44 01 00 ff 09 0004 0424 0000",
    ),
    Example(
        "8.8", PLC, "Response one record of 20 octets, CPU in RUN",
        "0300003d02f080 320700001500000c0020 00 01 12 08 12 84 01 02 00 00 0000 ff 09 001c 0424 0000 0014 0001 "
        "5144 ff 08 00000000 00 00 00 00 2311142215306213",
    ),
    Example(
        "8.8", PLC, "Response, first part (last data unit = no)",
        "0300002f02f080 320700001600000c0012 00 01 12 08 12 84 01 03 d5 01 0000 ff 09 000e 0000 0000 0002 0006 "
        "00000f00 0011",
    ),
    Example(
        "8.8", CLIENT, "Follow-up request: extended form, same sequence number, NEW PDU reference",
        "0300002102f080 320700001700000c0004 00 01 12 08 12 44 01 03 00 00 0000 0a 00 0000",
    ),
    Example(
        "8.8", PLC, "Response, second and last part: continuation without the SZL header",
        "0300002702f080 320700001700000c000a 00 01 12 08 12 84 01 03 d5 00 0000 ff 09 0006 0f11 001c 0131",
    ),
    Example(
        "8.8", PLC, "Response error (bad index), return code 0x0a and no data",
        "0300002102f080 320700001800000c0004 00 01 12 08 12 84 01 00 00 00 d402 0a 00 0000",
    ),
    Example(
        "8.9", CLIENT, "Request list blocks (no data to send: 0a 00 0000)",
        "0300 001d 02 f0 80 32 07 0000 1900 0008 0004 00 01 12 04 11 43 01 00 0a 00 0000",
    ),
    Example(
        "8.9", PLC, "Response four octets per type",
        "0300002902f080 320700001900000c000c 00 01 12 08 12 83 01 00 00 00 0000 ff 09 0008 30380002 30410011",
    ),
    Example(
        "8.9", CLIENT, "Request list blocks of type DB",
        "0300001f02f080 320700001a0000080006 00 01 12 04 11 43 02 00 ff 09 0002 3041",
    ),
    Example(
        "8.9", PLC, "Response number, flags, language",
        "0300002902f080 320700001a00000c000c 00 01 12 08 12 83 02 01 00 00 0000 ff 09 0008 00012205 00072205",
    ),
    Example(
        "8.9", CLIENT, "Request get block info of DB 1, active file system",
        "0300002502f080 320700001b000008000c 00 01 12 04 11 43 03 00 ff 09 0008 3041 3030303031 41",
    ),
    Example(
        "8.9", PLC, "Response get block info, 78 octets",
        "0300006f02f080 320700001b00000c0052 00 01 12 08 12 83 03 00 00 00 0000 ff 09 004e 0100 004a 2200 7070 01 "
        "01 05 0a 0001 000000d8 00000000 02395d992d70 03a1638321a7 0038 0000 0000 0058 415554484f522020 "
        "46414d494c592020 4845414445522020 01 00 63cc 00000000 00000000",
    ),
    Example(
        "8.10", CLIENT, "Request read clock",
        "0300 001d 02 f0 80 32 07 0000 1c00 0008 0004 00 01 12 04 11 47 01 00 0a 00 0000",
    ),
    Example(
        "8.10", PLC, "Response with the clock",
        "0300002b02f080 320700001c00000c000e 00 01 12 08 12 87 01 02 00 00 0000 ff 09 000a 00 19 1602081451379162",
    ),
    Example(
        "8.10", CLIENT, "Request set clock",
        "0300002702f080 320700001d000008000e 00 01 12 04 11 47 02 00 ff 09 000a 00 20 2402291200000005",
    ),
    Example(
        "8.10", PLC, "Response success is error code 0 with return code 0x0a and length 0",
        "0300002102f080 320700001d00000c0004 00 01 12 08 12 87 02 00 00 00 0000 0a 00 0000",
    ),
    Example(
        "8.11", CLIENT, "Request PLC password (8 octets, reversible encoding)",
        "0300 0025 02 f0 80 32 07 0000 1e00 0008 000c 00 01 12 04 11 45 01 00 ff 09 0008 1110090a6d6d0b0c",
    ),
    Example(
        "8.11", PLC, "Response accepted",
        "0300002102f080 320700001e00000c0004 00 01 12 08 12 85 01 01 00 00 0000 0a 00 0000",
    ),
    Example(
        "8.11", PLC, "Response wrong password",
        "0300002102f080 320700001e01000c0004 00 01 12 08 12 85 01 01 00 00 d602 0a 00 0000",
    ),
    Example(
        "8.12", CLIENT, "Request message service: subscribe mode transitions",
        "0300 0027 02 f0 80 32 07 0000 1f00 0008 000e 00 01 12 04 11 44 02 00 ff 09 000a 01 00 5553455231000000",
    ),
    Example(
        "8.12", PLC, "Response to the subscription",
        "0300002302f080 320700001f00000c0006 00 01 12 08 12 84 02 01 00 00 0000 ff 09 0002 02 00",
    ),
    Example(
        "8.12", PLC, "Push mode transition to STOP (different parameter layout, no data)",
        "0300001902f080 32070000000000080000 01 00 10100000 00 00",
    ),
    Example(
        "8.12", PLC, "Push diagnostic message, 20 octets",
        "0300003102f080 32070000000000080018 00 01 12 04 11 04 03 00 ff 09 0014 4304 ff 84 0000 0000 00000000 "
        "2311142215306213",
    ),
    Example(
        "8.12", PLC, "Push ALARM_8 indication",
        "0300003902f080 32070000000000080020 00 01 12 04 11 04 05 00 ff 09 001c 2311142215306213 40 01 12 0a 16 01 "
        "000000c2 01 00 00 00 ff040010 002a",
    ),
    Example(
        "8.12", CLIENT, "Request cyclic transfer, 1 s, one item",
        "0300002d02f080 32070000200000080014 00 01 12 04 11 42 01 00 ff 09 0010 00 01 01 01 12 0a 10 02 0002 0007 "
        "84 000000",
    ),
    Example(
        "8.12", PLC, "Response the sequence number is the job id of the subscription",
        "0300002902f080 320700002000000c000c 00 01 12 08 12 82 01 04 00 00 0000 ff 09 0008 00 01 ff040010 00aa",
    ),
    Example(
        "8.12", PLC, "Push cyclic data for job 4, PDU reference 0",
        "0300002902f080 320700000000000c000c 00 01 12 08 12 02 01 04 00 00 0000 ff 09 0008 00 01 ff040010 00ab",
    ),
    Example(
        "8.12", CLIENT, "Request unsubscribe job 4",
        "0300001f02f080 32070000210000080006 00 01 12 04 11 42 04 00 ff 09 0002 05 04",
    ),
    Example(
        "8.12", CLIENT, "Request variable status (programmer commands use the EXTENDED form even in requests)",
        "0300004102f080 320700002200000c0024 00 01 12 08 12 41 02 00 00 00 0000 ff 09 0020 0014 0008 0000 0000 "
        "0001 0012 0001 0001 0001 0001 0001 0000 0001 02 01 0000 0006",
    ),
    Example(
        "8.12", CLIENT, "BSEND request (group 6), single fragment, R_ID 1",
        "0300002f02f080 320700002300000c0012 00 01 12 08 12 46 01 00 00 00 0000 ff 09 000e 12 06 13 00 00000001 "
        "0004 cafe0001",
    ),
    Example(
        "8.12", PLC, "BSEND response from the partner",
        "0300002102f080 320700002300000c0004 00 01 12 08 12 86 01 00 00 00 0000 0a 00 0000",
    ),
    Example(
        "8.13", CLIENT, "DT fragment 1 of 2 (EOT clear)",
        "0300 0013 02 f0 00 320100002400000e00000401",
    ),
    Example(
        "8.13", CLIENT, "DT fragment 2 of 2 (EOT set): tshark decodes the S7 PDU here",
        "0300001302f080 120a10020010000184000000",
    ),
    Example(
        "8.13", CLIENT, "Empty DT without EOT, sent by STEP 7 / TIA / HMI stacks after each PDU",
        "0300 0007 02 f0 00",
    ),
    Example(
        "8.13", CLIENT, "The next DT with EOT then completes a TSDU of 0 + n octets",
        "0300001f02f080 320100002500000e0000 04 01 12 0a 10 02 0001 0001 84 000000",
    ),
    Example(
        "8.1", PLC, "ER, invalid parameter code, carrying the rejected header",
        "0300 000d 08 70 004b 01 c10211e0",
    ),
    Example(
        "8.1", CLIENT, "DC (not used in class 0, shown for completeness)",
        "0300 000a 05 c0 0006 004b",
    ),
)  # fmt: skip

#: A CR with a string TSAP, refused.
NAMED_TSAP: Final = (
    Example(
        "8.1", CLIENT, "CR with a string TSAP (S7-1200/1500 HMI access)",
        "0300 0024 1f e0 0000 0112 00 c1020600 c21053494d415449432d524f4f542d484d49 c0010a",
    ),
    Example(
        "8.1", PLC, "DR refusing a connection, reason 0x82",
        "0300 000b 06 80 0112 0000 82",
    ),
)  # fmt: skip

#: The other refusal of the same CR, with a reason.
UNKNOWN_ADDRESS: Final = (
    Example(
        "8.1", PLC, "DR refusing, with additional information",
        "0300 000f 0a 80 0112 0000 03 e0020102",
    ),
)  # fmt: skip

#: TPDUs that only classes above 0 send.
CLASS_2: Final = (
    Example(
        "8.1", CLIENT, "Class 2 CR with alternative class 0 (ITOT style)",
        "0300 001c 17 e0 0000 0021 21 c0010b c1020100 c2020102 c60101 c70100",
    ),
    Example(
        "8.1", CLIENT, "DT in class 2 normal format (5-octet header)",
        "0300 0011 04 f0 0021 83 0102030405060708",
    ),
    Example(
        "8.1", PLC, "AK, normal format (class 2)",
        "0300 0009 04 62 0021 04",
    ),
    Example(
        "8.1", PLC, "RJ, normal format (class 1/3)",
        "0300 0009 04 51 0021 02",
    ),
    Example(
        "8.1", CLIENT, "ED, X.224 normal format (class 2)",
        "0300 000b 04 10 0021 80 0102",
    ),
    Example(
        "8.1", PLC, "EA acknowledging it",
        "0300 0009 04 20 0021 00",
    ),
)  # fmt: skip

#: All of them, in the order of the reference.
EXAMPLES: Final = tuple(
    sorted((*S7, *NAMED_TSAP, *UNKNOWN_ADDRESS, *CLASS_2), key=lambda one: tuple(map(int, one.section.split("."))))
)
