from __future__ import annotations

import math
import struct
from collections.abc import Iterable

import pytest
from mypy_extensions import i64

from dissect.engine.observer import Observer
from dissect.engine.transactions.results import went_wrong
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.meaning.report.words import Places, carried
from dissect.meaning.report.writers.text import TextWriter, comment_line, pdu_line, tpdu_line, transaction_line
from dissect.packets.source.packet import SourceFile
from dissect.protocols.iso.cotp import parse_tpdu
from dissect.protocols.s7.message import parse_pdu
from dissect.wire.text import Clock
from tests.meaning.report.support import (
    OWN,
    UNSAFE,
    WORD,
    Kept,
    analysed,
    begun,
    observed,
    read,
    report,
    section,
    transactions,
)
from tests.properties import messages
from tests.properties.messages import Item, dt
from tests.properties.packets import EPOCH_NS, Flow, Talk, cut_to

ONE = Places([SourceFile("one.pcap", 1)], False)
SEVERAL = Places([SourceFile("one.pcap", 1), SourceFile("two.pcap", 9)], True)


class Lines(Kept):
    """The lines of every PDU and of every TPDU."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_pdus = True
        self.wants_tpdus = True
        self.pdus: list[str] = []
        self.tpdus: list[str] = []
        self.places = ONE

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Keep the line of a TPDU."""
        tpdu = parse_tpdu(octets[4:])
        line = tpdu_line(tpdu, frame, time_ns, side.connection, side.index, Clock(), self.places)
        self.tpdus.append(line.partition("102  ")[2] or line.partition("49152  ")[2])

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Keep the line of a PDU."""
        pdu = parse_pdu(octets, frame, time_ns, side.connection.number, side.index, cut)
        self.pdus.append(pdu_line(pdu, side.connection, Clock(), self.places))


def pdu_lines(talk: Talk) -> list[str]:
    """Return what the lines of the PDUs behind the setup say, without packet, time and addresses."""
    lines = Lines()
    observed(lines, talk.packets())
    return [line.partition("102  ")[2] or line.partition("49152  ")[2] for line in lines.pdus[2:]]


# ---- transactions ---------------------------------------------------------------------------------------------------


def test_a_transaction_on_one_line() -> None:
    told = transactions(read(begun(), 1).packets())
    assert transaction_line(told[1], Clock(), ONE) == (
        "2024-03-04 05:06:07.007000 UTC  #2     8→9          10.0.0.1:49152 → 10.0.0.2:102   1.00 ms  Read Var"
        "  DB10.DBW4 = 1234"
    )


def plain_lines(transactions: Iterable[Transaction], places: Places = ONE) -> list[str]:
    """Return the lines that a writer of plain lines makes, all with what it keeps from those before."""
    writer = TextWriter()
    writer.plain = True
    writer.begin(places)
    for transaction in transactions:
        writer.transaction(transaction)
    lines = [line for line in writer.take() if isinstance(line, bytes)]
    return [line.decode() for line in lines]


class BothWays(Observer):
    """Holds the plain line of each transaction to the other."""

    def __init__(self) -> None:
        super().__init__()
        self.writer = TextWriter()
        self.writer.plain = True
        self.writer.begin(ONE)
        self.count = 0

    def transaction(self, transaction: Transaction) -> None:
        self.writer.transaction(transaction)
        line = transaction_line(transaction, Clock(), ONE)
        assert self.writer.take() == [line.encode("utf-8", "backslashreplace")]
        self.count += 1


def test_plain_lines_say_the_same() -> None:
    count = 0
    for path in OWN:
        both = BothWays()
        run = Run([path], both)
        while run.step():
            pass
        count += both.count
    assert count > 500


SINGLES = struct.pack(">9f", 0.0, -0.0, 1.0, 123.456, 1e20, 1.5e-5, math.inf, -math.inf, math.nan)


@pytest.mark.parametrize(
    ("item", "octets", "text"),
    [
        (Item(0x01, 1, 1, 0x84, 3), b"\x01", "DB1.DBX0.3 = true"),
        (Item(0x02, 1, 1, 0x84, 0), b"\xff", "DB1.DBB0 = 255"),
        (Item(0x02, 3, 1, 0x84, 0), b"\x00\x7f\xff", "DB1.DBB0 x3 = 00 7f ff"),
        (Item(0x02, 16, 1, 0x84, 0), bytes(16), f"DB1.DBB0 x16 = {bytes(16).hex(' ')}"),
        (Item(0x02, 17, 1, 0x84, 0), bytes(17), f"DB1.DBB0 x17 = {bytes(16).hex(' ')} … 17 bytes"),
        (
            Item(0x02, 20, 1, 0x84, 0),
            b"Pump".ljust(20, b"\0"),
            "DB1.DBB0 x20 = 50 75 6d 70 00 00 00 00 00 00 00 00 00 00 00 00 … 20 bytes 'Pump'",
        ),
        (Item(0x02, 4, 1, 0x84, 0), b"Pump", "DB1.DBB0 x4 = 50 75 6d 70 'Pump'"),
        (Item(0x05, 1, 1, 0x84, 0), b"\x80\x00", "DB1.DBW0 = -32768"),
        (Item(0x04, 8, 1, 0x84, 0), b"\x00\x01" * 8, "DB1.DBW0 x8 = [1, 1, 1, 1, 1, 1, 1, 1]"),
        (Item(0x04, 9, 1, 0x84, 0), b"\x00\x01" * 9, "DB1.DBW0 x9 = [1, 1, 1, 1, 1, 1, 1, 1, … 9 in all]"),
        (Item(0x08, 7, 1, 0x84, 0), SINGLES[:28], "DB1.DBD0 x7 = [0.0, -0.0, 1.0, 123.456, 1e+20, 1.5e-05, inf]"),
        (Item(0x03, 5, 1, 0x84, 0), b"Pump1", "DB1.DBB0 x5 = 'Pump1'"),
        (Item(0x03, 5, 1, 0x84, 0), b"-P'=@", "DB1.DBB0 x5 = '-P'=@'"),
        (Item(0x03, 5, 1, 0x84, 0), b"P'-=\\", "DB1.DBB0 x5 = 'P'-=\\'"),
        (Item(0x03, 5, 1, 0x84, 0), b"P\x1b\xe4'\\", "DB1.DBB0 x5 = 'P\\x1bä'\\'"),
        (Item(0x03, 32, 1, 0x84, 0), b"p" * 32, f"DB1.DBB0 x32 = '{'p' * 32}'"),
        (Item(0x03, 37, 1, 0x84, 0), b"p" * 37, f"DB1.DBB0 x37 = '{'p' * 36}'… (37 characters)"),
        (Item(0x0C, 1, 1, 0x84, 0), b"\x21\x23", "DB1.DBW0 = 'S5T#2m3s'"),
        (Item(0x0C, 1, 1, 0x84, 0), b"\x2f\xff", "DB1.DBW0 = 2f ff"),
        (Item(0x0C, 2, 1, 0x84, 0), b"\x21\x23\x2f\xff", "DB1.DBW0 x2 = ['S5T#2m3s', 2f ff]"),
        (Item(0x0B, 1, 1, 0x84, 0), b"\xff\xff\xff\xff", "DB1.DBD0 = 'T#-1ms'"),
        (Item(0x08, 3, 1, 0x84, 0), SINGLES[24:], "DB1.DBD0 x3 = [inf, -inf, nan]"),
    ],
)
@pytest.mark.parametrize("latency_us", [1, 10, 999, 1000, 12_345, 99_994, 99_995, 123_456, 61_000_000])
def test_plain_lines_of_all_values(item: Item, octets: bytes, text: str, latency_us: int) -> None:
    talk = begun().send(0, dt(messages.read_job(1, [item])))
    answered = item if item.size == 0x01 else Item(0x02, len(octets))  # whose item tells the count of bits or of octets
    talk.send(1, dt(messages.read_answer(1, [answered], [octets])))
    told = transactions(talk.packets(step_ns=latency_us * 1000))
    lines = [transaction_line(each, Clock(), ONE) for each in told]
    assert plain_lines(told) == lines
    assert lines[1].endswith(f"  Read Var  {text}")


def both_ways(told: list[Transaction]) -> list[str]:
    """Return what is said of each transaction, by either way of writing a line."""
    lines = [transaction_line(each, Clock(), ONE) for each in told]
    assert plain_lines(told) == lines
    return [line.partition(" ms  ")[2] for line in lines]


def test_an_answer_that_does_not_fit_its_request_is_marked() -> None:
    """With as many octets as came, none of which is taken for a value."""
    four, two, nothing = (Item(0x02, length, 1, 0x84, 0) for length in (4, 2, 0))
    talk = begun()
    for ref, asked in enumerate(([four], [two, two], [two], [two], [nothing]), 1):
        talk.send(0, dt(messages.read_job(ref, asked)))
        answer = messages.write_answer(ref, [0xFF]) if ref == 3 else messages.read_answer(ref, [two], [b"\0\1"])
        talk.send(1, dt(answer))
    told = transactions(talk.packets())
    assert both_ways(told)[1:] == [
        "Read Var  MISMATCH (item size)  DB1.DBB0 x4 = 00 01 (2 bytes instead of 4)",
        "Read Var  MISMATCH (requested 2 items, got 1)  DB1.DBB0 x2 = 00 01, DB1.DBB0 x2",
        "Read Var  MISMATCH (the answer names Write Var)  DB1.DBB0 x2",
        "Read Var  DB1.DBB0 x2 = 00 01",
        "Read Var  MISMATCH (item size)  DB1.DBB0 x0 = 00 01 (2 bytes instead of 0)",
    ]
    assert [went_wrong(one) for one in told] == [False, True, True, True, False, True]


def test_a_value_that_the_capture_cut_is_marked() -> None:
    long = Item(0x02, 100, 1, 0x84, 0)
    talk = begun().send(0, dt(messages.read_job(1, [long]))).send(1, dt(messages.read_answer(1, [long], [bytes(100)])))
    (*others, last) = talk.packets()
    told = transactions([*others, cut_to(last, len(last.octets) - 83)])
    assert both_ways(told)[1] == f"Read Var  DB1.DBB0 x100 = {bytes(16).hex(' ')} … 17 bytes (17 of 100 bytes captured)"


def test_an_answer_before_its_request_has_no_answer_time() -> None:
    (*others, request, answer) = (
        begun()
        .send(0, dt(messages.read_job(1, [WORD])))
        .send(1, dt(messages.read_answer(1, [WORD], [b"\0\1"])))
        .packets()
    )
    swapped = [*others, answer._replace(time_ns=request.time_ns), request._replace(time_ns=request.time_ns + 10_000)]
    told = transactions(swapped)
    (line,) = plain_lines(told[1:])
    assert line == transaction_line(told[1], Clock(), ONE)
    assert line.endswith(" → 10.0.0.2:102         ?  Read Var  DB10.DBW4 = 1")
    functions = [line.split() for line in section(report(analysed(swapped)), "Transactions")]
    assert ["Read", "Var", "1", ".", ".", "?", "?", "?"] in functions


def test_plain_lines_name_files_and_hosts() -> None:
    told = transactions(read(begun(), 1).packets())
    assert plain_lines(told, SEVERAL) == [transaction_line(each, Clock(), SEVERAL) for each in told]
    named = Places([SourceFile("one.pcap", 1)], False, {"10.0.0.2": "Küche"})
    assert plain_lines(told, named) == [transaction_line(each, Clock(), named) for each in told]
    assert " → Küche:102 " in plain_lines(told, named)[1]


def test_an_unanswered_request_says_so_and_why() -> None:
    told = transactions(begun().send(0, dt(messages.read_job(1, [WORD]))).reset(1).packets())
    assert transaction_line(told[1], Clock(), ONE) == (
        "2024-03-04 05:06:07.007000 UTC  #2     8→?          10.0.0.1:49152 → 10.0.0.2:102         -  Read Var"
        "  NO ANSWER (connection closed)  DB10.DBW4"
    )


def test_a_push_has_the_time_of_its_packet() -> None:
    told = transactions(begun().send(1, dt(messages.userdata(0, 0, 4, 3, b"12345678"))).packets())
    assert transaction_line(told[1], Clock(), ONE) == (
        "2024-03-04 05:06:07.007000 UTC  #2     ?→8          10.0.0.2:102 → 10.0.0.1:49152         -"
        "  CPU functions: diagnostic message  push"
    )


def test_several_files_are_named() -> None:
    told = transactions(read(begun(), 1).packets())
    assert " one.pcap:8→two.pcap:1 " in transaction_line(told[1], Clock(), SEVERAL)


def test_no_item_is_left_out() -> None:
    items = [Item(0x02, 1, 1, 0x84, 8 * number) for number in range(20)]
    talk = begun().send(0, dt(messages.read_job(1, items)))
    told = transactions(talk.send(1, dt(messages.read_answer(1, items, [b"\x07"] * 20))).packets())
    line = transaction_line(told[1], Clock(), ONE)
    assert all(f"DB1.DBB{number} = 7" in line for number in range(20))


# ---- PDUs -----------------------------------------------------------------------------------------------------------


def test_a_pdu_on_one_line() -> None:
    lines = Lines()
    observed(lines, read(begun(), 1).packets())
    assert lines.pdus[0] == (
        "     6  2024-03-04 05:06:07.005000 UTC  10.0.0.1:49152 → 10.0.0.2:102"
        "  Job       ref 0x0000  Setup communication  PDU 480, AmQ 1/1"
    )
    lines = Lines()
    lines.places = SEVERAL
    observed(lines, read(begun(), 1).packets())
    assert lines.pdus[-1].startswith("two.pcap:1  ")


def test_what_a_pdu_carries() -> None:
    talk = begun()
    items = [WORD, Item(0x01, 1, 0, 0x83, 81)]
    talk.send(0, dt(messages.read_job(1, items))).send(1, dt(messages.read_answer(1, items, [b"\x04\xd2", 0x0A])))
    talk.send(0, dt(messages.write_job(2, items, [b"\x00\x07", b"\x01"]))).send(
        1, dt(messages.write_answer(2, [255, 255]))
    )
    talk.send(0, dt(messages.write_job(3, items[:1], [b"\x00\x07"]))).send(1, dt(messages.write_answer(3, [255])))
    talk.send(0, dt(messages.pdu(messages.JOB, 4, b"\x1d"))).send(
        1, dt(messages.pdu(messages.ACK, 4, b"", b"", 0xD241))
    )
    assert pdu_lines(talk) == [
        "Job       ref 0x0001  Read Var  DB10.DBW4, M10.1",
        "Ack_Data  ref 0x0001  Read Var  1 of 2 items refused: item 2: Object does not exist",
        "Job       ref 0x0002  Write Var  DB10.DBW4 = 7, M10.1 = true",
        "Ack_Data  ref 0x0002  Write Var  2 items, all good",
        "Job       ref 0x0003  Write Var  DB10.DBW4 = 7",
        "Ack_Data  ref 0x0003  Write Var  1 item, good",
        "Job       ref 0x0004  Start upload  MALFORMED s7: upload at byte 10 needs 8 bytes, the parameter part has 1",
        "Ack       ref 0x0004  error 0xd241 Not permitted in current protection level",
    ]


def test_userdata_on_a_line() -> None:
    talk = begun().send(0, dt(messages.userdata(1, 1, 4, 1, b"\x00\x11\x00\x00")))
    talk.send(1, dt(messages.userdata(1, 2, 4, 1, b"", 0xD402)))
    more = bytearray(messages.userdata(2, 2, 4, 1, b"12345678"))
    more[19] = 1  # last data unit: no
    talk.send(0, dt(messages.userdata(2, 1, 4, 1, b"\x00\x12\x00\x00"))).send(1, dt(bytes(more)))
    transition = messages.pdu(messages.USERDATA, 0, b"\x01\x00\x10\x10\x00\x00\x00\x00")
    talk.send(1, dt(transition))
    assert pdu_lines(talk) == [
        "Userdata  ref 0x0001  CPU functions: read SZL  request, sequence 0  SZL 0x0011 module identification",
        "Userdata  ref 0x0001  CPU functions: read SZL  response, sequence 0, error 0xd402 Invalid SZL index",
        "Userdata  ref 0x0002  CPU functions: read SZL  request, sequence 0  SZL 0x0012 CPU characteristics",
        "Userdata  ref 0x0002  CPU functions: read SZL  response, sequence 0, more to come  continuation",
        "Userdata  ref 0x0000  mode transition: STOP  push, sequence 0",
    ]


def test_a_damaged_pdu_says_what_is_wrong() -> None:
    lying = bytearray(messages.read_job(1, [WORD]))
    lying[7] = 99  # parameter length
    (line,) = pdu_lines(begun().send(0, dt(bytes(lying))))
    assert "MALFORMED s7: param_length at byte 6 claims 109 bytes, the TSDU has 24" in line


def test_a_payload_that_is_damaged_says_what_is_wrong() -> None:
    """In the line as in the tree."""
    (line,) = pdu_lines(begun().send(0, dt(messages.userdata(1, 1, 7, 2, b"\0\x20\x24"))))
    said = "Userdata  ref 0x0001  time functions: set clock  request, sequence 0"
    assert line == f"{said}  MALFORMED s7: clock at byte 22 needs 10 bytes, the item has 3"


@pytest.mark.parametrize("octets", ["00202413280755066125", "00000000000000000000"])
def test_a_clock_that_is_no_time(octets: str) -> None:
    (line,) = pdu_lines(begun().send(0, dt(messages.userdata(1, 1, 7, 2, bytes.fromhex(octets)))))
    assert line.endswith("request, sequence 0  invalid time" if int(octets) else "request, sequence 0  no time")


@pytest.mark.parametrize(
    ("kept", "said"),
    [
        (23, "Job       ref 0x0001  Read Var  TRUNCATED by the capture"),
        (12, "Job       ref 0x0001  Read Var  TRUNCATED by the capture"),
        (10, "Job       ref 0x0001  TRUNCATED by the capture"),
    ],
)
def test_a_cut_pdu_says_so(kept: int, said: str) -> None:
    packets = begun().send(0, dt(messages.read_job(1, [WORD]))).packets()
    packets[-1] = cut_to(packets[-1], 54 + 7 + kept)
    lines = Lines()
    observed(lines, packets)
    assert lines.pdus[-1].partition("102  ")[2] == said  # which is no fault of the PDU: nothing is malformed


def test_a_write_that_was_cut_says_how_much_was_captured() -> None:
    packets = begun().send(0, dt(messages.write_job(1, [Item(0x02, 10, 1, 0x84, 0)], [bytes(10)]))).packets()
    packets[-1] = cut_to(packets[-1], len(packets[-1].octets) - 6)
    lines = Lines()
    observed(lines, packets)
    said = "Write Var  DB1.DBB0 x10 = 00 00 00 00 (4 of 10 bytes captured)  TRUNCATED by the capture"
    assert lines.pdus[-1].partition("102  ")[2] == f"Job       ref 0x0001  {said}"


def test_a_header_that_is_not_all_there_has_no_invented_fields() -> None:
    lines = Lines()
    observed(lines, begun().send(0, dt(b"\x32\x01\x00\x00\x00\x07")).packets())
    said = lines.pdus[-1].partition("102  ")[2]
    assert said == "Job       ref ?  MALFORMED s7: header at byte 0 needs 10 bytes, the TSDU has 6"


# ---- TPDUs and comments ---------------------------------------------------------------------------------------------


def test_tpdus_on_a_line() -> None:
    talk = begun().send(1, messages.EMPTY_DT).send(1, dt(b"\x17\x03\x03" + bytes(19)))
    talk.send(0, messages.disconnect(1)).send(1, messages.tpkt(b"\x04\x70\x00\x01\x02"))
    lines = Lines()
    observed(lines, talk.packets())
    assert lines.tpdus[0] == "COTP CR  TSAP 01.00 (PG) → 01.02 (PG, rack 0 slot 2), TPDU size 1024"
    assert lines.tpdus[1] == "COTP CC  TSAP 01.00 (PG) → 01.02 (PG, rack 0 slot 2), TPDU size 1024"
    assert lines.tpdus[5] == "COTP DT  TLS, 22 bytes: TLS 1.2 or 1.3 application data"
    assert lines.tpdus[6].startswith("COTP DR  ")
    assert lines.tpdus[6] != "COTP DR  "
    assert lines.tpdus[7].startswith("COTP ER  ")


@pytest.mark.parametrize(
    ("data", "protocol"),
    [
        (b"", ""),
        (messages.read_job(1, [WORD]), ""),
        (b"\x72\x01" + bytes(20), ""),
        (b"\x17\x03\x03\x00\x02ab", "TLS"),
        (b"hello", "unknown protocol"),
    ],
)
def test_what_a_dt_carries(data: bytes, protocol: str) -> None:
    assert carried(parse_tpdu(dt(data)[4:])) == protocol


@pytest.mark.parametrize(
    "tpdu", [b"\x01\x80", b"\x06\x80\x00\x01", b"\x02\x70\x00", b"\xff\xe0", b"\x00", b"", b"\x05\x30aaaa"]
)
def test_a_damaged_tpdu_has_a_line(tpdu: bytes) -> None:
    connection = transactions(begun().packets())[0].connection
    line = tpdu_line(parse_tpdu(tpdu), 8, EPOCH_NS, connection, 0, Clock(), ONE)
    assert "COTP" in line
    assert not UNSAFE.search(line)


@pytest.mark.parametrize(("variable", "said"), [(b"\r\n", "RDP"), (b"Cookie: x=1\r\n", "RDP, ")])
def test_a_connect_request_of_remote_desktop(variable: bytes, said: str) -> None:
    """A bare end of a line says nothing more."""
    connection = transactions(begun().packets())[0].connection
    request = bytes((6 + len(variable), 0xE0)) + bytes(5) + variable
    line = tpdu_line(parse_tpdu(request), 8, EPOCH_NS, connection, 0, Clock(), ONE)
    _, found, rest = line.partition(f"  COTP CR  {said}")
    assert (bool(found), bool(rest)) == (True, said != "RDP")


def test_a_comment_is_safe_and_bounded() -> None:
    assert comment_line(7, "look\x1b[31m here\u202e", ONE) == "     7  comment: look\\x1b[31m here\\u202e"
    assert comment_line(7, "x" * 5000, ONE) == f"     7  comment: {'x' * 1000}… (5000 characters)"
    assert comment_line(9, "here", SEVERAL) == "two.pcap:1  comment: here"


def test_ipv6_and_vlan_do_not_disturb_a_line() -> None:
    lines = Lines()
    observed(lines, read(begun(Flow("fe80::1", "fe80::2", vlans=(7,))), 1).packets())
    assert "  [fe80::1]:49152 → [fe80::2]:102  Job " in lines.pdus[0]
