from __future__ import annotations

from pathlib import Path

import pytest

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.engine.transactions.accounts import KEEP_ALIVE
from dissect.meaning.report import words
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.brief import brief_lines
from dissect.meaning.report.finding_lines import finding_lines
from dissect.meaning.report.styled import Line
from dissect.meaning.report.text import analysis_lines, table
from dissect.meaning.report.words import Places
from dissect.packets.source.packet import SourceFile
from dissect.wire.text import Clock
from tests.cases import each
from tests.meaning.report.support import OWN, ROOT, UNSAFE, WORD, analysed, begun, of_files, read, report, section
from tests.properties import messages
from tests.properties.messages import Item, dt, fragments
from tests.properties.packets import EPOCH_NS, MS, Flow, Packet, Segment, Talk, captured, cut_to


def own(name: str) -> list[str]:
    """Return the report on one of our captures."""
    return report(of_files(ROOT / "captures" / f"{name}.pcapng"))


def headings(lines: list[str]) -> list[str]:
    return [line for line in lines if line and not line.startswith(" ")]


# ---- whole reports on our captures ----------------------------------------------------------------------------------


def test_a_report_from_top_to_bottom() -> None:
    lines = own("item-errors")
    assert lines[0].endswith("item-errors.pcapng: 26 packets, 4.0 kB")
    assert lines[1].startswith("  from 2026-")
    assert lines[1].endswith(" ms")
    assert lines[2] == "  16 S7 PDUs"
    assert headings(lines)[1:] == [
        "Connections",
        "Transactions: 8 answered, 7 with errors",
        "Findings",
        "Failed transactions",
        "Slowest answers",
        "Completeness",
    ]
    connection = section(lines, "Connections")
    assert connection[0].startswith("1  127.0.0.1:")
    assert connection[0].endswith(" → 127.0.0.1:102")
    assert connection[1:] == [
        "TSAP 01.00 (PG) → 01.02 (PG, rack 0 slot 2), TPDU size 1024",
        "PDU length 480, parallel jobs (AmQ): client 1, server 1",
        "16 PDUs, 8 answered, 7 with errors; closed by the client at packet 24",
    ]
    functions = [line.split() for line in section(lines, "Transactions")]
    assert functions[0] == ["function", "count", "errors", "no", "answer", "median", "95", "%", "max"]
    assert [row[:5] for row in functions[1:3]] == [["Read", "Var", "4", "4", "."], ["Write", "Var", "3", "3", "."]]
    findings = section(lines, "Findings")
    assert (
        findings[0]
        == "warning  transaction.item_error (13 times): An item of a read, write or subscription was refused."
    )
    assert findings[1] == "13 refused items on 1 connection, 01:31:05.695 to 01:31:05.703"
    assert findings[2] == "connection 1, packets 10, 11: Read Var DB99.DBB0 x4: 0x0a Object does not exist"
    assert findings[5] == "and 10 more: packets 17, 19, 21, 23"
    assert findings[6].startswith("→ Check the address")
    failed = section(lines, "Failed")
    assert failed[0].split() == ["number", "packets", "answer", "function"]
    assert [row.split()[:2] for row in failed[1:]] == [
        [f"#{number}", f"{2 * number + 6}→{2 * number + 7}"] for number in range(2, 9)
    ]
    refused = "DB99.DBB0 x4: Object does not exist, DB2.DBW99: Invalid address, IB500 x2: Invalid address"
    assert failed[4].endswith(f"Read Var   3 of 7 items refused: {refused}")
    assert section(lines, "Completeness") == ["26 of 26 packets used", "no gaps in the TCP streams"]


@pytest.mark.parametrize(
    ("count", "detailed", "said"),
    [(6, 1, "and 5 more"), (2, 1, "and 1 more"), (9, 5, "and 6 more: packets 4, 5, …")],
)
def test_times_and_what_is_shown_of_a_finding_add_up(count: int, detailed: int, said: str) -> None:
    rule = CATALOGUE["ip.bad_header"]  # counted for each packet, detailed for the first
    found = [Finding(rule, 0, [number], 0, "") for number in range(1, detailed + 1)]
    lines = [line.text for line in finding_lines(rule, count, found, Places([SourceFile("a.pcap", 1)], False))]
    assert f"({count} times)" in lines[0]
    assert [line.strip() for line in lines if "more" in line] == [said]


def test_what_follows_a_finding_continues_under_its_first_word() -> None:
    """Details, advice and techniques are indented by six; on a narrow screen they go on two further in."""
    rule = CATALOGUE["security.program_change"]
    found = [Finding(rule, 1, [number], 0, "word " * 12) for number in range(1, 30)]
    lines = list(finding_lines(rule, len(found), found, Places([SourceFile("a.pcap", 1)], False)))
    assert len(lines) == 3 + 4
    assert lines[0].hang == 6
    assert [line.hang for line in lines[1:]] == [8] * 6
    for line in lines[1:]:
        first, *rest = line.wrapped(40)
        assert first[:6].strip() == ""
        assert first[6] != " "
        assert all([one.startswith(" " * 8) and one[8] != " " for one in rest])


@pytest.mark.parametrize(("count", "told"), [(1, 1), (2, 1), (14, 1), (14, 2), (3, 3), (14, 3), (14, 14)])
def test_what_is_told_and_what_is_counted_add_up(count: int, told: int) -> None:
    """Of some rules only the first time is told."""
    rule = CATALOGUE["ip.bad_header"]
    found = [Finding(rule, 0, [number], 0, "seen") for number in range(1, told + 1)]
    lines = [line.text for line in finding_lines(rule, count, found, Places([SourceFile("a.pcap", 1)], False))]
    shown = [line for line in lines if line.startswith("      packet ")]
    more = [int(line.split()[1]) for line in lines if line.startswith("      and ")]
    assert len(shown) == min(told, 3)
    assert len(shown) + sum(more) == count


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("cut-with-reset", "7 PDUs, 3 answered, 1 unanswered; reset by the server at packet 15 with 1 request pending"),
        ("cut-with-fin", "1 unanswered; closed by the server at packet"),
        ("client-killed", "1 unanswered; closed by the client at packet"),
        ("connect-close", "; closed by the client (COTP disconnect request, reason not specified)"),
        ("mid-stream", "1 answer without request; already open at the start, closed by the client at packet 11"),
        ("refused-full", "no S7 PDU; reset by the server at packet 15"),
        ("setup-pdu-sizes", "PDU length 960, parallel jobs (AmQ): client 1, server 1"),
        ("slivers", "12 PDUs, 6 answered, 1 with errors; closed by the client at packet 79"),
    ],
)
def test_how_connections_went(name: str, said: str) -> None:
    assert [line for line in section(own(name), "Connections") if said in line]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "cut-with-reset",
            "connection 1, packet 14: Read Var DB1.DBB8 x4: the server reset the connection 100 µs later",
        ),
        ("answer-slow", "the limit is 1.00 s"),
        ("many-open", "connection 1, packet 13: more requests pending than the 1 granted (AmQ)"),
        ("transfer-refused", "0xd241 Not permitted in current protection level"),
    ],
)
def test_what_was_found(name: str, said: str) -> None:
    assert [line for line in section(own(name), "Findings") if said in line]


def test_a_capture_without_fault_says_so() -> None:
    lines = own("read-areas")
    assert "Findings: none" in lines
    assert "Failed transactions" not in headings(lines)


def test_a_capture_without_iso_on_tcp_says_so() -> None:
    lines = own("refused-port")
    assert "No ISO-on-TCP connection in this capture." in lines
    assert not [line for line in headings(lines) if line.startswith(("Transactions", "Failed", "Slowest"))]
    assert [line for line in section(lines, "Findings") if line.startswith("packet 2: 127.0.0.1:102 refuses ")]


@each("path", OWN)
def test_no_line_is_unsafe_or_ragged(path: Path) -> None:
    for line in report(of_files(path)):
        assert not UNSAFE.search(line)
        assert line == line.rstrip()


def test_shared_captures_have_reports(corpus: Path) -> None:
    for path in sorted(corpus.glob("*.pcap*")):
        lines = report(of_files(path))
        assert not [line for line in lines if UNSAFE.search(line)]
        assert section(lines, "Completeness")


# ---- connections ----------------------------------------------------------------------------------------------------


def connection_of(*packets: list[Packet]) -> list[str]:
    return section(report(analysed(*packets)), "Connections")


def test_a_refused_connection() -> None:
    talk = Talk().handshake().send(0, messages.connect(0xE0)).send(1, messages.disconnect(3)).close(1)
    lines = report(analysed(talk.packets()))
    told = section(lines, "Connections")
    assert told[0].endswith("10.0.0.2:102, no data")
    assert told[1] == "TSAP 01.00 (PG) → 01.02 (PG, rack 0 slot 2)"
    assert told[2].startswith("REFUSED: ")
    assert told[3] == "no S7 PDU; closed by the server at packet 6"
    assert [line for line in section(lines, "Findings") if line.startswith("warning  cotp.refused")]


def test_vlan_and_ipv6() -> None:
    told = connection_of(read(begun(Flow("fe80::1", "fe80::2", vlans=(100, 7))), 1).packets())
    assert told[0] == "1  [fe80::1]:49152 → [fe80::2]:102, VLAN 100.7"


def test_a_connection_in_several_vlans() -> None:
    sent = read(begun(), 1).segments
    for vlans, said in (((20,), "VLAN 10, also in VLAN 20"), ((), "VLAN 10, also without a VLAN")):
        flows = Flow(vlans=(10,)), Flow(vlans=vlans)
        told = connection_of(captured([segment._replace(flow=flows[segment.side]) for segment in sent]))
        assert told[0] == f"1  10.0.0.1:49152 → 10.0.0.2:102, {said}"


def test_less_than_asked_is_granted() -> None:
    talk = begun()
    talk.segments = talk.segments[:5]
    talk.next = [talk.segments[-1].ack, talk.segments[-1].seq + len(talk.segments[-1].payload)]
    talk.send(0, dt(messages.setup(messages.JOB, 1, 8, 960))).send(1, dt(messages.setup(messages.ACK_DATA, 1, 3, 240)))
    told = connection_of(talk.packets())
    assert told[2] == "PDU length 240 (requested 960), parallel jobs (AmQ): client 3, server 3"
    # A second setup that is refused changes nothing of it.
    refused = messages.pdu(messages.ACK_DATA, 2, b"", b"", 0x8104)
    talk.send(0, dt(messages.setup(messages.JOB, 2, 8, 480))).send(1, dt(refused))
    assert connection_of(talk.packets())[2] == told[2]


def test_an_unknown_client_is_no_arrow() -> None:
    talk = Talk().send(1, dt(messages.userdata(0, 0, 4, 3, b"12345678")))
    assert connection_of(talk.packets())[0] == "1  10.0.0.1:49152 ↔ 10.0.0.2:102"


@pytest.mark.parametrize(
    ("octets", "said"),
    [
        (b"\x17\x03\x03\x00\x02ab", "10.0.0.2:102, TLS (TLS 1.2 or 1.3 application data)"),
        (b"hello", "10.0.0.2:102, unknown protocol (begins with 68 65 6c 6c 6f)"),
    ],
)
def test_other_protocols_are_named(octets: bytes, said: str) -> None:
    talk = Talk().handshake().send(0, messages.connect(0xE0)).send(1, messages.connect(0xD0)).send(0, dt(octets))
    lines = report(analysed(talk.packets()))
    told = section(lines, "Connections")
    assert told[0].endswith(said)
    assert f"; other messages: 1 {said.partition(', ')[2].partition(' (')[0]}" in lines[2]
    assert "(PG, rack 0 slot 2)" not in told[1]


def test_addresses_used_again() -> None:
    first = begun().send(0, dt(messages.read_job(1, [WORD])))
    again = Talk(isns=(90_000, 7_000_000)).handshake()
    packets = first.packets() + [packet._replace(time_ns=packet.time_ns + 60 * MS) for packet in again.packets()]
    told = connection_of(packets)
    assert told[3].startswith(
        "3 PDUs, 1 answered, 1 unanswered; replaced by a new connection on the same addresses with 1 request pending: Read Var "
    )


def test_another_connect_request_on_the_same_connection() -> None:
    talk = begun().send(0, messages.connect(0xE0)).send(1, messages.connect(0xD0))
    told = connection_of(talk.packets())
    assert [line for line in told if "replaced by a new connection on the same addresses" in line]


def test_many_connections_are_a_choice_of_the_interesting_ones() -> None:
    packets = [packet for number in range(24) for packet in begun(Flow(ports=(20000 + number, 102))).packets()]
    packets += read(begun(Flow(ports=(30000, 102))), 1, WORD, 0x0A).packets()
    lines = report(analysed(packets))
    assert "Connections (20 of 25: those with most errors, then the busiest, by number)" in lines
    told = section(lines, "Connections")
    assert told[-1] == "and 5 more; -T json lists up to 1000"
    shown = [int(line.split()[0]) for line in told if "→" in line and not line.startswith("TSAP")]
    assert len(shown) == 20
    assert shown == sorted(shown)
    assert shown[-1] == 25  # the one with an error


# ---- loss -----------------------------------------------------------------------------------------------------------


def test_holes_are_told() -> None:
    talk = begun().send(0, dt(messages.read_job(1, [WORD]))).skip(1, 29).send(0, dt(messages.read_job(2, [WORD])))
    talk.send(1, dt(messages.read_answer(2, [WORD], [b"\x00\x01"]))).ack(0)
    lines = report(analysed(talk.packets()))
    assert "1 gap in the TCP streams, 29 bytes missing from the capture" in section(lines, "Completeness")
    assert [line for line in section(lines, "Findings") if line.startswith("warning  stream.hole")]
    assert "Transactions: 2 answered, 1 answer not captured" in lines
    assert not [line for line in lines if "unanswered" in line or line.startswith("Failed")]


def test_one_direction_only() -> None:
    talk = begun()
    for ref in range(1, 6):
        read(talk, ref)
    packets = captured([segment for segment in talk.segments if segment.side == 0])
    findings = section(report(analysed(packets)), "Findings")
    assert [line for line in findings if line.startswith("warning  capture.one_sided")]
    assert [line for line in findings if "only packets from 10.0.0.1:49152 were captured" in line]


def test_cut_packets_are_told() -> None:
    packets = begun().send(0, dt(messages.read_job(1, [WORD]))).packets()
    packets[-1] = cut_to(packets[-1], 54 + 7 + 12)
    lines = report(analysed(packets))
    assert "1 packet truncated by the capture (snaplen)" in section(lines, "Completeness")


def test_garbage_and_unfinished_messages_are_told() -> None:
    talk = begun().send(0, b"GET / HTTP/1.1\r\n\r\n" + dt(messages.read_job(1, [WORD])))
    talk.send(1, dt(messages.read_answer(1, [WORD], [b"\x00\x01"]))[:20])
    told = section(report(analysed(talk.packets())), "Completeness")
    assert "18 bytes skipped that belong to no message" in told
    assert "20 bytes of unfinished messages at the end" in told


def test_repetitions_are_told() -> None:
    talk = read(begun(), 1)
    packets = talk.packets()
    packets.insert(9, packets[8])
    told = section(report(analysed(packets)), "Completeness")
    assert told[0] == "10 of 10 packets used, 1 of them repeated: sent again or captured twice"


def test_keep_alives_are_among_what_was_repeated() -> None:
    analysis = analysed(read(begun(), 1).packets())
    assert analysis.pipeline is not None
    analysis.pipeline.counters.packets.add(KEEP_ALIVE)
    told = section(report(analysis), "Completeness")
    assert told[0].endswith(
        " packets used, 1 of them repeated: sent again, captured twice, or a keep-alive with a byte"
    )


def test_packets_that_were_not_used_are_told_by_reason() -> None:
    packets = read(begun(), 1).packets()
    packets.append(Packet(packets[-1].time_ns, bytes(12) + b"\x08\x06" + bytes(30), 44))  # ARP
    packets.append(Packet(packets[-1].time_ns, Flow().wrap(0, 17, bytes(20)), 54))  # UDP
    packets.append(Packet(packets[-1].time_ns, b"\x00" * 20, 20, 9999))
    told = section(report(analysed(packets)), "Completeness")
    assert told[:4] == [
        "9 of 12 packets used",
        "1 ignored: not IP",
        "1 ignored: IP but not TCP",
        "1 ignored: unsupported link type",
    ]


def test_a_damaged_file_and_notes() -> None:
    analysis = analysed(begun().packets())
    analysis.files[0].damage = "cut off at byte 12\x1b[2J"
    analysis.files[0].octets = 0
    assert report(analysis)[1] == "  NOT READ: cut off at byte 12\\x1b[2J"
    analysis.files[0].octets = 12
    analysis.files[0].notes = [f"oddity {number}" for number in range(12)]
    lines = report(analysis)
    assert lines[1] == "  DAMAGED: cut off at byte 12\\x1b[2J"
    assert lines[2:12] == [f"  oddity {number}" for number in range(10)]
    assert lines[12] == "  and 2 more notes; -T json lists them"


def test_an_interruption_is_told() -> None:
    analysis = analysed(begun().packets())
    assert not [line for line in report(analysis) if "INTERRUPTED" in line]
    assert [line for line in analysis_lines(analysis, interrupted=True) if "INTERRUPTED" in line.text]


# ---- several files --------------------------------------------------------------------------------------------------


def test_packets_of_several_files_are_named_by_file() -> None:
    packets = read(read(begun(), 1), 2, WORD, 0x0A).send(0, dt(messages.read_job(3, [WORD]))).reset(1).packets()
    lines = report(analysed(packets[:10], packets[10:]))
    assert [line.partition(":")[0] for line in lines[:2]] == ["1.pcap", "2.pcap"]
    assert lines[2] == ("  from 2024-03-04 05:06:07.000000 UTC to 2024-03-04 05:06:07.012000 UTC, first to last packet")
    assert [line for line in section(lines, "Connections") if "reset by the server at packet 3 of 2.pcap" in line]
    assert [
        line
        for line in section(lines, "Findings")
        if line.startswith("connection 1, packet 10 of 1.pcap, packet 1 of 2.pcap: ")
    ]
    assert [line for line in section(lines, "Failed") if line.startswith("#3  1.pcap:10→2.pcap:1")]


def test_files_out_of_order_give_no_negative_duration() -> None:
    late = [packet._replace(time_ns=packet.time_ns + 10**12) for packet in begun().packets()]
    lines = report(analysed(late, begun(Flow(ports=(5, 102))).packets()))
    assert (
        " UTC back to 2024-03-04 05:06:07.006000 UTC (packets are not in order of time), first to last packet"
        in lines[2]
    )


def test_files_of_which_one_is_older_than_the_first_span_them_all() -> None:
    packets = [begun(Flow(ports=(port, 102))).packets() for port in (4, 5, 6)]
    files = [
        [packet._replace(time_ns=packet.time_ns + late * 10**12) for packet in some]
        for some, late in zip(packets, (1, 0, 2), strict=True)
    ]
    found = analysed(*files)
    pipeline = found.pipeline
    assert pipeline is not None
    said = f"from {words.span(Clock(), packets[0][0].time_ns, files[2][-1].time_ns)}"
    assert report(found)[3] == f"  {said}, earliest to latest packet (packets are not in order of time)"
    brief = [line.text for line in brief_lines(found)]
    assert [line for line in brief if line.startswith(f"  {said} (packets are not in order of time); ")]
    assert (pipeline.first_ns, pipeline.now_ns) == (files[0][0].time_ns, files[2][-1].time_ns)


# ---- form -----------------------------------------------------------------------------------------------------------


def test_slowest_answers_come_slowest_first() -> None:
    talk = begun()
    for ref in range(1, 10):
        read(talk, ref)
    packets = talk.packets()
    moved = []
    for number, packet in enumerate(packets, 1):
        late = 700 * MS if number >= 13 else 30 * MS if number >= 11 else 0
        moved.append(packet._replace(time_ns=packet.time_ns + late))
    rows = section(report(analysed(moved)), "Slowest")
    assert [row.split()[0] for row in rows] == ["number", "#4", "#3", "#1", "#2", "#5"]
    assert rows[1].split()[1:4] == ["12→13", "671", "ms"]


def test_one_answer_is_not_ranked() -> None:
    assert not [line for line in report(analysed(begun().packets())) if line.startswith("Slowest")]


def test_failed_transactions_are_bounded_and_counted() -> None:
    talk = begun()
    for ref in range(1, 14):
        read(talk, ref, WORD, 0x0A)
    lines = report(analysed(talk.packets()))
    assert "Failed transactions (first 10 of 13)" in lines
    assert len(section(lines, "Failed")) == 11


def test_findings_come_in_order_of_weight_then_of_number() -> None:
    talk = begun(length=100)
    read(talk, 1, WORD, 0x0A)
    read(talk, 2, WORD, 0x0A)
    talk.send(0, dt(b"\x17\x03\x03" + bytes(20)))
    items = [Item(0x02, 1, 1, 0x84, 8 * number) for number in range(10)]
    talk.send(0, dt(messages.read_job(3, items)))
    found = [line.split()[:2] for line in section(report(analysed(talk.packets())), "Findings")]
    order = [row for row in found if row[0] in {"error", "warning", "note"}]
    assert [severity for severity, _ in order] == sorted(
        (row[0] for row in order), key=["error", "warning", "note"].index
    )
    assert order[0] == ["error", "session.pdu_too_long:"]


def test_fragments_that_never_end() -> None:
    talk = begun().send(0, fragments(messages.read_job(1, [WORD]), [10])[: 7 + 10])
    assert [line for line in section(report(analysed(talk.packets())), "Findings") if "cotp.unfinished_tsdu" in line]


def test_an_empty_capture_has_a_report() -> None:
    analysis = Analysis()
    filled = analysed([])
    assert filled.pipeline is not None
    analysis.take(filled.pipeline, [SourceFile("empty.pcap", 1)])
    lines = report(analysis)
    assert lines[0] == "empty.pcap: 0 packets, 0 B"
    assert section(lines, "Completeness")[0] == "0 of 0 packets used"


def test_styles_mark_what_matters() -> None:
    styles = {
        line.text.strip().split(" ")[0]: line.style
        for line in analysis_lines(of_files(ROOT / "captures" / "item-errors.pcapng"))
    }
    assert (styles["Connections"], styles["warning"], styles["→"]) == ("heading", "warning", "dim")


def test_a_table_is_aligned() -> None:
    rows = [["name", "count"], ["a", "1"], ["long name", "1000"]]
    assert [line.text for line in table(rows, frozenset({1}))] == [
        "  name       count",
        "  a              1",
        "  long name   1000",
    ]
    assert list(table([], frozenset())) == []


@pytest.mark.parametrize("width", [40, 80, 120])
def test_a_narrow_terminal_wraps_between_words(width: int) -> None:
    for line in analysis_lines(of_files(ROOT / "captures" / "item-errors.pcapng")):
        pieces = line.wrapped(width)
        assert "".join(" ".join(pieces).split()) == "".join(line.text.split())
        for piece in pieces:
            assert len(piece) <= width or " " not in piece.strip()
        if len(line.text) <= width:
            assert pieces == [line.text]


def test_lines_in_one_text_are_wrapped_one_by_one() -> None:
    line = Line("  #5  Read Var  one two three\n\n  #6  Read", hang=16)
    assert line.wrapped(24) == ["  #5  Read Var", "      one two three", "", "  #6  Read"]


def test_wrapped_rows_hang_below_their_last_column() -> None:
    line = Line("  #5  Read Var  one two three", hang=16)
    assert line.wrapped(24) == ["  #5  Read Var", "      one two three"]  # too narrow to hang
    assert Line("  #5  Read  one two three", hang=12).wrapped(25) == ["  #5  Read  one two three"]
    assert Line("  #5  Read  one two three four", hang=12).wrapped(25) == [
        "  #5  Read  one two three",
        "            four",
    ]


def test_times_are_those_of_the_capture() -> None:
    segments = [Segment(Flow(), 0, 1, 0, 2)]
    lines = report(analysed(captured(segments, EPOCH_NS)))
    assert lines[1] == "  from 2024-03-04 05:06:07.000000 UTC, 0 µs"
