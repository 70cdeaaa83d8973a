"""`s7dissect cut`: which packets it writes, with what comments, what analysis and Wireshark say of it, what it refuses."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

import dissect
from dissect.engine.transactions.transaction import Transaction
from dissect.packets.source.files import open_capture
from dissect.wire.build import COMPILED
from tests.cli.support import Ran, run, simple
from tests.meaning.report.support import WORD, begun, read, saved
from tests.packets.source.craft import Frame, Pcapng, drain
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import EPOCH_NS, MS, Flow, Packet, Talk, captured

ROOT = Path(__file__).resolve().parents[2]
Capfd = pytest.CaptureFixture[bytes]

#: Our own captures that a cut is compared on: segments, losses, disorder, several connections, other links, IBH-NetLink.
COMPARED = (
    "batched",
    "blocks",
    "many-open",
    "slivers",
    "two-clients",
    "crafted/cotp-fragments",
    "crafted/endings",
    "crafted/holes",
    "crafted/ip-fragments",
    "crafted/ipv6",
    "crafted/link-types",
    "crafted/netlink",
    "crafted/retransmissions",
    "crafted/sequence-wrap",
    "crafted/vlan",
)


def frames(path: Path) -> list[Frame]:
    reader = open_capture(str(path))
    got = drain(reader)
    assert (reader.damage, reader.rejected, reader.notes) == ("", 0, [])
    return got.frames


def numbers(path: Path, source: Sequence[Packet]) -> list[int]:
    """Return which packets of ``source`` are in a file, by their number from 1."""
    times = [packet.time_ns for packet in source]
    return [times.index(frame.time_ns) + 1 for frame in frames(path)]


def cut(capfdbinary: Capfd, *arguments: str | Path) -> Ran:
    ran = run(capfdbinary, "cut", *arguments)
    assert ran.out == ""
    return ran


@pytest.fixture
def mixed() -> list[Packet]:
    """Two connections by turns: packets 1, 3, 5, … are of the first, with the second read refused."""
    talks = [begun(Flow(ports=(port, 102))) for port in (49152, 49153)]
    for talk in talks:
        read(read(read(talk, 1), 2, WORD, 0x0A), 3).close()
    packets: list[Packet] = []
    for index, pair in enumerate(zip(*(talk.packets() for talk in talks), strict=True)):
        packets += [packet._replace(time_ns=EPOCH_NS + (2 * index + turn) * MS) for turn, packet in enumerate(pair)]
    return packets


def test_a_connection_is_whole(tmp_path: Path, capfdbinary: Capfd, mixed: list[Packet]) -> None:
    path, out = saved(tmp_path / "in.pcapng", mixed), tmp_path / "out.pcapng"
    ran = cut(capfdbinary, path, "-o", out, "--connection", "2")
    assert ran.code == 0
    assert ran.err == f"s7dissect: 16 of 32 packets written to {out}, 2 with findings as comments\n"
    assert numbers(out, mixed) == list(range(2, 33, 2))
    assert frames(out) == frames(path)[1::2]
    assert [one.name for one in tmp_path.iterdir() if one not in (path, out)] == []


def told(path: Path) -> dict[int, list[tuple[object, ...]]]:
    """Return the transactions of each connection, without numbers of packets."""
    found: dict[int, list[tuple[object, ...]]] = {}
    for event in dissect.open(str(path), pdus=False):
        if isinstance(event, Transaction):
            found.setdefault(int(event.connection.number), []).append(
                (
                    event.function_name,
                    event.outcome,
                    event.reason,
                    event.request_octets,
                    event.response_octets,
                    event.request_ns,
                    event.response_ns,
                    str(event.connection.client),
                )
            )
    return found


@pytest.mark.parametrize("name", COMPARED)
def test_a_connection_alone_has_the_same_transactions(tmp_path: Path, capfdbinary: Capfd, name: str) -> None:
    path = ROOT / "captures" / f"{name}.pcapng"
    whole = told(path)
    assert whole
    for number in sorted(whole)[:5]:
        out = tmp_path / f"{number}.pcapng"
        assert cut(capfdbinary, path, "-o", out, "--connection", str(number)).code == 0
        alone = told(out)
        assert whole[number] in alone.values()


def test_a_transaction_is_all_its_packets(tmp_path: Path, capfdbinary: Capfd) -> None:
    talk = begun()
    job, answer = (
        dt(messages.read_job(1, [WORD] * 3)),
        messages.fragments(messages.read_answer(1, [WORD] * 3, [b"ab"] * 3), [9, 20]),
    )
    talk.send(0, job[:5]).ack(1).send(0, job[5:20], job[20:])  # packets 8, 10, 11
    talk.segments.append(talk.segments[-2])  # 12: sent again
    talk.send(1, answer[:8], answer[8:30], answer[30:])  # 13 to 15
    packets = read(talk, 2).packets()
    path, out = saved(tmp_path / "in.pcapng", packets), tmp_path / "out.pcapng"
    assert cut(capfdbinary, path, "-o", out, "--transaction", "2").code == 0
    assert numbers(out, packets) == [8, 10, 11, 12, 13, 14, 15]
    assert cut(capfdbinary, path, "-o", out, "--transaction", "3", "--transaction", "1", "--force").code == 0
    assert numbers(out, packets) == [6, 7, 16, 17]


def test_context_of_a_transaction(tmp_path: Path, capfdbinary: Capfd) -> None:
    packets = read(read(begun(), 1), 2).close().packets()
    path, out = saved(tmp_path / "in.pcapng", packets), tmp_path / "out.pcapng"
    ran = cut(capfdbinary, path, "-o", out, "--transaction", "3", "--context")
    assert ran.code == 0
    assert "of them open or close connections" in ran.err
    kept = numbers(out, packets)
    assert kept[:8] == [1, 2, 4, 5, 6, 7, 10, 11]
    assert kept[-1] > 11
    ran = cut(capfdbinary, path, "-o", out, "--transaction", "3", "--force")
    assert numbers(out, packets) == [10, 11]
    assert "open or close" not in ran.err
    ran = cut(capfdbinary, path, "-o", out, "--connection", "1", "--context", "--force")
    assert ran.code == 2
    assert "--context needs --transaction" in ran.err


def test_fragments_of_a_transaction_go_along(tmp_path: Path, capfdbinary: Capfd) -> None:
    flow = Flow()
    talk = begun(flow)
    job = talk.put(0, 0x18, dt(messages.read_job(1, [WORD] * 9)))
    talk.send(1, dt(messages.read_answer(1, [WORD] * 9, [b"ab"] * 9)))
    octets = [packet.octets for packet in talk.packets()]
    octets[7:8] = reversed(flow.fragments(job, 48, 7))
    packets = [Packet(EPOCH_NS + number * MS, one, len(one)) for number, one in enumerate(octets)]
    path, out = saved(tmp_path / "in.pcapng", packets), tmp_path / "out.pcapng"
    assert cut(capfdbinary, path, "-o", out, "--transaction", "2").code == 0
    assert numbers(out, packets) == list(range(8, len(packets) + 1))
    assert len(packets) > 10


def test_findings_by_slug_severity_and_number(tmp_path: Path, capfdbinary: Capfd, mixed: list[Packet]) -> None:
    path, out = saved(tmp_path / "in.pcapng", mixed), tmp_path / "out.pcapng"
    details = json.loads(run(capfdbinary, "analyze", "-T", "json", path).out)["finding_details"]
    assert {one["slug"] for one in details} == {"transaction.item_error"}
    shown = [one["frames"] for one in details]
    everything = sorted({frame for one in shown for frame in one})
    for what in ("transaction.item_error", "transaction.*", "warning", "note"):
        assert cut(capfdbinary, path, "-o", out, "--finding", what, "--force").code == 0
        assert numbers(out, mixed) == everything
    assert cut(capfdbinary, path, "-o", out, "--finding", "2", "--force").code == 0
    assert numbers(out, mixed) == sorted(shown[1])


def test_comments_are_shown_by_wireshark(tmp_path: Path, capfdbinary: Capfd, mixed: list[Packet]) -> None:
    path = saved(tmp_path / "in.pcapng", mixed, {1: "from before", 21: "and this"})
    out = tmp_path / "out.pcapng"
    assert cut(capfdbinary, path, "-o", out).code == 0
    shown = subprocess.run(
        ["tshark", "-r", str(out), "-T", "fields", "-E", "aggregator=|", "-e", "frame.number", "-e", "frame.comment"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert [line for line in shown.stderr.splitlines() if not line.startswith("Running as user")] == []
    comments = [line.partition("\t")[2] for line in shown.stdout.splitlines()]
    assert len(comments) == len(mixed)
    assert comments[0] == "from before"
    commented = {number: text for number, text in enumerate(comments, 1) if text}
    assert {number for number, text in commented.items() if "s7dissect: warning transaction.item_error" in text} >= {
        21,
        22,
    }
    assert commented[21].startswith("and this|s7dissect: warning transaction.item_error: An item of a read, write or ")
    assert cut(capfdbinary, path, "-o", out, "--no-comments", "--force").code == 0
    assert drain(open_capture(str(out))).comments == [(1, "from before"), (21, "and this")]


def test_a_comment_of_the_capture_is_made_safe(tmp_path: Path, capfdbinary: Capfd) -> None:
    path = saved(tmp_path / "in.pcapng", begun().packets(), {1: "red \x1b[31m\r\nline"})
    out = tmp_path / "out.pcapng"
    cut(capfdbinary, path, "-o", out)
    assert drain(open_capture(str(out))).comments == [(1, "red \\x1b[31m\nline")]


@pytest.mark.parametrize(
    ("window", "kept"),
    [
        ("0..0.003", [1, 2, 3, 4]),
        ("0.0295..", [31, 32]),
        ("..05:06:07.001", [1, 2]),
        ("05:06:07.030..05:06:08", [31, 32]),
        ("2024-03-04T05:06:07.031..", [32]),
    ],
)
def test_a_window_of_time(
    tmp_path: Path, capfdbinary: Capfd, mixed: list[Packet], window: str, kept: list[int]
) -> None:
    path, out = saved(tmp_path / "in.pcapng", mixed), tmp_path / "out.pcapng"
    assert cut(capfdbinary, path, "-o", out, "--time", window).code == 0
    assert numbers(out, mixed) == kept


def test_time_narrows_what_is_asked_for(tmp_path: Path, capfdbinary: Capfd, mixed: list[Packet]) -> None:
    path, out = saved(tmp_path / "in.pcapng", mixed), tmp_path / "out.pcapng"
    assert cut(capfdbinary, path, "-o", out, "--connection", "1", "--time", "0..0.005").code == 0
    assert numbers(out, mixed) == [1, 3, 5]


@pytest.mark.parametrize(
    ("around", "kept"),
    [
        ("0", [12, 14]),
        ("1", [11, 12, 13, 14, 15]),
        ("3", [*range(9, 18)]),
        ("99", [*range(1, 33)]),
        ("2ms", [*range(10, 17)]),
        ("0ms", [12, 14]),
        ("1s", [*range(1, 33)]),
    ],
)
def test_what_is_around_goes_along(
    tmp_path: Path, capfdbinary: Capfd, mixed: list[Packet], around: str, kept: list[int]
) -> None:
    path, out = saved(tmp_path / "in.pcapng", mixed), tmp_path / "out.pcapng"
    ran = cut(capfdbinary, path, "-o", out, "--transaction", "2", "--around", around)
    assert numbers(out, mixed) == kept
    assert (f"{len(kept) - 2} of them for being near" in ran.err) == (len(kept) > 2)


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_memory_for_what_is_around_is_bounded_and_told(
    tmp_path: Path, capfdbinary: Capfd, mixed: list[Packet], monkeypatch: pytest.MonkeyPatch
) -> None:
    from dissect.files.recording import cutter

    monkeypatch.setattr(cutter, "MAX_HELD", 1400)
    path, out = saved(tmp_path / "in.pcapng", mixed), tmp_path / "out.pcapng"
    ran = cut(capfdbinary, path, "-o", out, "--transaction", "2", "--around", "8")
    assert re.search(r"[1-9]\d* packets left memory before .* some may be missing", ran.err)
    assert 12 in numbers(out, mixed)
    assert 4 not in numbers(out, mixed)


def test_links_interfaces_times_and_cut_packets_stay(tmp_path: Path, capfdbinary: Capfd) -> None:
    file = Pcapng()
    file.interface(1, options=file.option(2, b"eth0") + file.resolution(9))
    file.interface(1, options=file.option(2, b"eth\x1b1") + file.resolution(6))
    file.interface(101)
    file.packet(EPOCH_NS + 7, EPOCH_NS + 7, bytes(60), 0)
    file.packet(EPOCH_NS // 1000, EPOCH_NS, bytes(60), 1, wire=1500)
    file.packet(EPOCH_NS // 1000, EPOCH_NS, bytes(20), 2)
    file.section(big=True)
    file.interface(113, options=file.option(2, b"eth0") + file.resolution(9))
    file.packet(5, 5, bytes(33), 0)
    path, out = tmp_path / "in.pcapng", tmp_path / "out.pcapng"
    path.write_bytes(file.octets)
    cut(capfdbinary, path, "-o", out)
    assert frames(out) == file.frames
    about = subprocess.run(["capinfos", str(out)], capture_output=True, text=True, check=True).stdout
    assert re.findall(r"Name = (.*)", about) == ["eth0", "eth\\x1b1", "eth0"]
    assert re.findall(r"Encapsulation = ([^(]*) \(", about) == [
        "Ethernet",
        "Ethernet",
        "Raw IP",
        "Linux cooked-mode capture v1",
    ]


def test_several_files_go_to_one(tmp_path: Path, capfdbinary: Capfd, mixed: list[Packet]) -> None:
    first, second = saved(tmp_path / "1.pcapng", mixed[:13]), saved(tmp_path / "2.pcapng", mixed[13:])
    out = tmp_path / "out.pcapng"
    assert cut(capfdbinary, first, second, "-o", out, "--connection", "2").code == 0
    assert numbers(out, mixed) == list(range(2, 33, 2))


@pytest.mark.parametrize(
    "name", ["crafted/plain-zstd.pcap.zst", "crafted/plain-gzip.pcap.gz", "crafted/plain-big-endian.pcap"]
)
def test_every_format_is_cut(tmp_path: Path, capfdbinary: Capfd, name: str) -> None:
    out = tmp_path / "out.pcapng"
    assert cut(capfdbinary, ROOT / "captures" / name, "-o", out).code == 0
    assert frames(out) == frames(ROOT / "captures" / name)


def test_a_damaged_capture_is_cut_as_far_as_it_goes(tmp_path: Path, capfdbinary: Capfd) -> None:
    out = tmp_path / "out.pcapng"
    ran = cut(capfdbinary, ROOT / "captures" / "crafted" / "cut-pcapng.pcapng", "-o", out)
    assert ran.code == 3
    assert "cut off at byte" in ran.err
    assert len(frames(out)) == 14


def test_standard_output(tmp_path: Path, mixed: list[Packet]) -> None:
    path = saved(tmp_path / "in.pcapng", mixed)
    arguments = [sys.executable, "-m", "dissect", "cut", str(path), "-o", "-", "--connection", "1"]
    done = subprocess.run(arguments, capture_output=True, check=True)
    assert b"16 of 32 packets written to standard output" in done.stderr
    (tmp_path / "out.pcapng").write_bytes(done.stdout)
    assert numbers(tmp_path / "out.pcapng", mixed) == list(range(1, 32, 2))


def test_the_same_capture_gives_the_same_octets(tmp_path: Path, capfdbinary: Capfd, mixed: list[Packet]) -> None:
    path = saved(tmp_path / "in.pcapng", mixed)
    outs = [tmp_path / name for name in ("a.pcapng", "b.pcapng")]
    for out in outs:
        cut(capfdbinary, path, "-o", out, "--finding", "note", "--around", "2")
    assert outs[0].read_bytes() == outs[1].read_bytes()


# ---- what is refused ------------------------------------------------------------------------------------------------


def test_nothing_is_overwritten_unasked(tmp_path: Path, capfdbinary: Capfd, mixed: list[Packet]) -> None:
    path, out = saved(tmp_path / "in.pcapng", mixed), tmp_path / "out.pcapng"
    out.write_bytes(b"precious")
    ran = cut(capfdbinary, path, "-o", out)
    assert ran.code == 2
    assert "--force overwrites it" in ran.err
    assert out.read_bytes() == b"precious"
    assert cut(capfdbinary, path, "-o", out, "--force").code == 0
    assert len(frames(out)) == 32


def test_the_capture_itself_is_never_overwritten(tmp_path: Path, capfdbinary: Capfd, mixed: list[Packet]) -> None:
    path = saved(tmp_path / "in.pcapng", mixed)
    before = path.read_bytes()
    (tmp_path / "link").symlink_to(path)
    os.link(path, tmp_path / "other name")
    for name in ("in.pcapng", "link", "other name", "../" + tmp_path.name + "/in.pcapng"):
        ran = cut(capfdbinary, path, "-o", tmp_path / name, "--force")
        assert ran.code == 2
        assert "is both input and output; choose another OUT" in ran.err
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--connection", "3"], "no connection 3 in the capture; nothing was written"),
        (
            ["--connection", "1", "--connection", "7", "--transaction", "99"],
            "no connection 7; no transaction 99 in the",
        ),
        (["--finding", "900"], "no finding 900 in the capture"),
        (["--finding", "security.plc_stop"], "no packet matches; nothing was written"),
        (["--time", "100.."], "no packet matches"),
        (["--time", "noon..dawn"], "'noon' is not a time: expected"),
        (["--around", "-1"], "expected a number of packets or a time such as 500ms or 2s, got '-1'"),
        (["--around", "5min"], "expected a number of packets or a time such as 500ms or 2s, got '5min'"),
        (["--around", "1"], "--around needs -Y, --connection, --transaction, --finding or --time"),
        (["--finding", "transaction.slo"], "did you mean transaction.slow"),
        (["--finding", "0"], "'0' is neither a severity nor a finding"),
        (["--connection", "0"], "x>=1"),
    ],
)
def test_what_is_not_there_is_told_and_nothing_written(
    tmp_path: Path, capfdbinary: Capfd, mixed: list[Packet], arguments: list[str], said: str
) -> None:
    path, out = saved(tmp_path / "in.pcapng", mixed), tmp_path / "out.pcapng"
    ran = cut(capfdbinary, path, "-o", out, *arguments)
    assert ran.code == 2
    assert said in ran.err
    assert list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_read_twice_or_written(tmp_path: Path, capfdbinary: Capfd, mixed: list[Packet]) -> None:
    path = saved(tmp_path / "in.pcapng", mixed)
    ran = cut(capfdbinary, "-", "-o", tmp_path / "out.pcapng")
    assert ran.code == 2
    assert "read twice" in ran.err
    ran = cut(capfdbinary, path, "-o", tmp_path / "none" / "out.pcapng")
    assert ran.code == 2
    assert "No such file or directory" in ran.err
    assert "none/out.pcapng" in ran.err
    ran = cut(capfdbinary, tmp_path / "none.pcapng", "-o", tmp_path / "out.pcapng")
    assert ran.code == 2
    assert "no such file" in ran.err
    assert run(capfdbinary, "cut", path, "-o", tmp_path).code == 2
    assert run(capfdbinary, "cut", path, "-o", "/dev/full").code == 5
    assert list(tmp_path.iterdir()) == [path]


def test_a_handshake_alone_is_no_connection(tmp_path: Path, capfdbinary: Capfd) -> None:
    talk = Talk(Flow())
    packets = talk.handshake().packets()
    ran = cut(capfdbinary, saved(tmp_path / "in.pcapng", packets), "-o", tmp_path / "out.pcapng", "--connection", "1")
    assert ran.code == 2
    assert "no connection 1" in ran.err


def test_an_output_that_cannot_be_made_is_called_by_its_name(
    capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path
) -> None:
    for command in ("cut", "anonymize"):
        out = tmp_path / "none" / "x.pcapng"
        ran = run(capfdbinary, command, simple(tmp_path / "a.pcapng"), "-o", out)
        assert (ran.code, ran.out, ran.err) == (2, "", f"s7dissect: {out}: No such file or directory\n")


@pytest.mark.parametrize("vlans", [((10,), (20,)), ((), (10,)), ((20,), ())])
def test_a_connection_in_two_vlans(
    tmp_path: Path, capfdbinary: Capfd, vlans: tuple[tuple[int, ...], tuple[int, ...]]
) -> None:
    """Each direction has a tag of its own: what is chosen by connection, transaction or expression has both."""
    sent = read(read(begun(), 1), 2).close().segments
    tagged = [segment._replace(flow=Flow(vlans=vlans[segment.side])) for segment in sent]
    path, out = saved(tmp_path / "in.pcapng", captured(tagged)), tmp_path / "out.pcapng"
    cut(capfdbinary, path, "-o", out, "--connection", "1")
    assert len(frames(out)) == len(sent)
    cut(capfdbinary, path, "-o", out, "--transaction", "3", "--force")
    assert len(frames(out)) == 2
    cut(capfdbinary, path, "-o", out, "-Y", "connection == 1", "--force")
    assert len(frames(out)) == len(sent)
