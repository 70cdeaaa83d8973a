"""Real traffic, through both engines: on loopback, and over a pair of interfaces in a network of our own."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from dissect.packets.source.live.dumpcap import DumpcapReader
from dissect.packets.source.live.opening import open_live
from dissect.packets.source.live.reader import Drops, LiveError, LiveReader, UnavailableError
from dissect.packets.source.live.ring import BLOCK_SIZE, RingReader
from tests.packets.source.live_support import (
    ENGINES,
    Got,
    Sink,
    drained,
    in_namespace,
    needs_dumpcap,
    needs_ring,
    sender,
    udp,
    until,
)


def converse(listener: socket.socket, octets: bytes = b"a request") -> None:
    """Have a short TCP connection on loopback; its packets have all passed when this returns."""
    with socket.create_connection(listener.getsockname()) as client:
        server, _ = listener.accept()
        with server:
            client.sendall(octets)
            seen = 0
            while seen < len(octets):
                seen += len(server.recv(1 << 20))
            server.sendall(b"an answer")
            assert client.recv(100) == b"an answer"


@needs_ring
@needs_dumpcap
def test_both_engines_see_the_same_on_loopback() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        expression = f"tcp port {listener.getsockname()[1]}"
        readers = [open_live("lo", expression, engine) for engine in ("ring", "dumpcap")]
        assert [reader.engine for reader in readers] == ["ring", "dumpcap"]
        begun = time.time_ns()
        converse(listener)
        ended = time.time_ns()
    seen = []
    for reader in readers:
        sink = Sink()
        until(reader, sink, 8)
        reader.stop()
        assert drained(reader, sink)
        octets = [got.octets for got in sink.got]
        assert [b"a request" in frame for frame in octets].count(True) == 1  # what is sent is not seen a second time
        assert all(begun <= got.time_ns <= ended + 10_000_000_000 for got in sink.got)
        assert all(got.wire_length == len(got.octets) and got.link_type == 1 for got in sink.got)
        assert reader.packets == len(octets)
        assert reader.interface == "lo"
        assert reader.damage == ""
        assert reader.drops == (0, 0)
        seen.append(octets[:8])
    assert seen[0] == seen[1]


@pytest.mark.parametrize("engine", ENGINES)
def test_large_packets_are_whole(engine: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        reader = open_live("lo", f"tcp port {listener.getsockname()[1]}", engine)
        converse(listener, b"\xa5" * 200_000)
    sink = Sink()
    end = time.monotonic() + 60
    while sum(got.octets.count(b"\xa5") for got in sink.got) < 200_000 and time.monotonic() < end:
        reader.step(sink)
    reader.close()
    assert sum(got.octets.count(b"\xa5") for got in sink.got) >= 200_000
    assert all(len(got.octets) == got.wire_length for got in sink.got)


@pytest.mark.parametrize("engine", ENGINES)
def test_nothing_gets_in_before_the_filter(engine: str) -> None:
    def task() -> None:
        out = sender("va")
        ended = threading.Event()
        noise = threading.Thread(target=lambda: [out.send(udp(b"noise", 9)) for _ in iter(ended.is_set, True)])
        noise.start()
        try:
            for _ in range(5):
                reader = open_live("vb", "udp port 4711", engine)
                out.send(udp(b"wanted"))
                sink = Sink()
                until(reader, sink, 1)
                reader.close()
                assert [got.octets for got in sink.got] == [udp(b"wanted")]
        finally:
            ended.set()
            noise.join()
            out.close()

    in_namespace(task)


TAGS = ("", "8100 0005", "88a8 e064", "88a8 0064 8100 0005", "8100 0000", "8100 0001 8100 0002 8100 0003")


@pytest.mark.parametrize("engine", ENGINES)
def test_vlan_tags_are_where_they_were(engine: str) -> None:
    def task() -> None:
        frames = [udp(b"to the PLC", tags=bytes.fromhex(tags)) for tags in TAGS]
        with sender("va") as out:
            reader = open_live("vb", "", engine)
            sink = Sink()
            got: list[Got] = []
            end = time.monotonic() + 60
            while len(got) < len(frames) and time.monotonic() < end:
                if not got:  # a link that comes up late loses what was sent
                    for frame in frames:
                        out.send(frame)
                reader.step(sink)
                got = [packet for packet in sink.got if b"to the PLC" in packet.octets]
            reader.close()
        got = got[: len(frames)]
        assert [packet.octets for packet in got] == frames
        assert [packet.wire_length for packet in got] == [len(frame) for frame in frames]

    in_namespace(task)


@pytest.mark.parametrize(
    ("expression", "wanted"),
    [
        ("udp port 4711", TAGS),
        ("vlan", TAGS[1:]),
        ("vlan 5", TAGS[1:2]),
        ("vlan 100 and udp", TAGS[2:4]),
        ("not vlan and udp", TAGS[:1]),
        ("udp[8:4] = 0x746f2074 and udp", TAGS[:3] + TAGS[4:5]),  # libpcap's work: it looks behind no second tag
        ("vlan 100 and udp[8:4] = 0x746f2074", TAGS[2:3]),
    ],
)
@needs_ring
def test_filters_of_the_ring_in_the_kernel(expression: str, wanted: tuple[str, ...]) -> None:
    def task() -> None:
        try:
            reader = open_live("vb", expression, "ring")
        except LiveError as error:
            if "more than the ring understands" not in str(error):
                raise
            pytest.skip("no libpcap")
        with sender("va") as out:
            for tags in TAGS:
                out.send(udp(b"to the PLC", tags=bytes.fromhex(tags)))
        sink = Sink()
        until(reader, sink, len(wanted))
        reader.stop()
        assert drained(reader, sink)
        assert [got.octets for got in sink.got] == [udp(b"to the PLC", tags=bytes.fromhex(tags)) for tags in wanted]

    in_namespace(task)


FLOOD = 6000


def flood() -> None:
    with sender("va") as out:
        for number in range(FLOOD):
            out.send(udp(number.to_bytes(4, "big") + bytes(900)))


@needs_ring
def test_the_ring_counts_what_it_lost() -> None:
    def task() -> None:
        reader = open_live("vb", "udp port 4711", "ring", buffer_mib=1)
        assert isinstance(reader, RingReader)
        flood()  # more than the ring holds, and nobody reads
        first = reader.drops.kernel
        assert first is not None
        assert first > 0
        sink = Sink()
        reader.stop()
        assert drained(reader, sink)
        assert len(sink.got) > 100
        assert len(sink.got) + first == FLOOD
        assert reader.drops == Drops(first, 0)  # counted once, and known after the end
        assert reader.freezes > 0
        assert reader.octets < 5 * BLOCK_SIZE

    in_namespace(task)


@needs_dumpcap
def test_dumpcap_tells_what_it_lost_at_its_end() -> None:
    def task() -> None:
        reader = open_live("vb", "udp port 4711", "dumpcap", buffer_mib=1)
        assert isinstance(reader, DumpcapReader)
        os.kill(reader.pid, signal.SIGSTOP)
        flood()
        assert reader.drops == Drops(None, 0)
        os.kill(reader.pid, signal.SIGCONT)
        sink = Sink()
        seen = -1
        while seen < len(sink.got) or not seen:  # until dumpcap has given all it holds: what comes is never 1 s late
            seen = len(sink.got)
            until(reader, sink, seen + 1, 1)
        reader.stop()
        assert drained(reader, sink)
        assert reader.damage == ""
        kernel = reader.drops.kernel
        assert kernel is not None
        assert kernel > 0
        assert len(sink.got) + kernel == FLOOD

    in_namespace(task)


@needs_ring
@pytest.mark.parametrize(("promiscuous", "count"), [(True, "promiscuity 1"), (False, "promiscuity 0")])
def test_promiscuous_while_it_is_open(promiscuous: bool, count: str) -> None:
    def shown() -> str:
        return subprocess.run(["ip", "-d", "link", "show", "vb"], capture_output=True, text=True, check=True).stdout

    def task() -> None:
        reader = open_live("vb", "", "ring", promiscuous=promiscuous)
        assert count in shown()
        reader.close()
        assert "promiscuity 0" in shown()

    in_namespace(task)


# ---- ends -----------------------------------------------------------------------------------------------------------


def is_running(pid: int) -> bool:
    """Tell whether a process runs; one that waits to be collected by its parent does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def ends(pid: int) -> bool:
    end = time.monotonic() + 60
    while is_running(pid) and time.monotonic() < end:
        time.sleep(0.01)
    return not is_running(pid)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_silent_line_gives_nothing_and_goes_on(engine: str) -> None:
    reader = open_live("lo", "udp src port 1 and udp dst port 1", engine, wait_ms=5)
    sink = Sink()
    assert all(reader.step(sink) for _ in range(20))
    assert sink.got == []
    reader.close()
    reader.close()
    assert not reader.step(sink)
    assert reader.drops.interface == 0
    assert reader.damage == ""


@needs_dumpcap
def test_closing_leaves_no_process() -> None:
    reader = open_live("lo", "", "dumpcap")
    assert isinstance(reader, DumpcapReader)
    assert is_running(reader.pid)
    reader.close()
    assert not Path(f"/proc/{reader.pid}").exists()  # nor one to be collected


@needs_dumpcap
def test_a_dumpcap_that_does_not_listen_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dissect.packets.source.live.dumpcap._END_S", 0.05)
    reader = open_live("lo", "", "dumpcap")
    assert isinstance(reader, DumpcapReader)
    os.kill(reader.pid, signal.SIGSTOP)
    reader.close()
    assert not Path(f"/proc/{reader.pid}").exists()


@needs_dumpcap
def test_a_dumpcap_that_does_not_end_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dissect.packets.source.live.dumpcap._END_S", 0.05)
    reader = open_live("lo", "", "dumpcap")
    assert isinstance(reader, DumpcapReader)
    os.kill(reader.pid, signal.SIGSTOP)
    reader.stop()
    assert drained(reader, Sink())
    assert not Path(f"/proc/{reader.pid}").exists()
    assert reader.drops.kernel is None


@needs_dumpcap
def test_a_killed_dumpcap_is_told() -> None:
    reader = open_live("lo", "udp port 1", "dumpcap")
    assert isinstance(reader, DumpcapReader)
    os.kill(reader.pid, signal.SIGKILL)
    assert drained(reader, Sink())
    assert reader.damage == "dumpcap ended: exit code -9"
    assert not Path(f"/proc/{reader.pid}").exists()
    assert reader.drops.kernel is None


@needs_dumpcap
def test_dumpcap_does_not_outlive_us() -> None:
    code = (
        "import os; from dissect.packets.source.live.opening import open_live\n"
        "reader = open_live('lo', '', 'dumpcap'); print(reader.pid, flush=True); os.kill(os.getpid(), 9)"
    )
    with socket.create_server(("127.0.0.1", 0)) as listener:
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert done.returncode == -9, done.stderr
        converse(listener)  # it notices with the next packet at the latest
        assert ends(int(done.stdout))


@pytest.mark.parametrize("engine", ENGINES)
def test_an_interface_that_goes_away(engine: str) -> None:
    def task() -> None:
        reader = open_live("vb", "udp port 4711", engine)
        with sender("va") as out:
            out.send(udp(b"the last"))
        sink = Sink()
        until(reader, sink, 1)
        subprocess.run(["ip", "link", "del", "va"], check=True)
        assert drained(reader, sink)
        assert [got.octets for got in sink.got] == [udp(b"the last")]
        assert reader.damage != ""

    in_namespace(task)


@pytest.mark.parametrize("engine", ENGINES)
def test_an_interface_that_was_down_is_waited_for(engine: str) -> None:
    def task() -> None:
        reader = open_live("vb", "udp port 4711", engine)
        sink = Sink()
        told: list[tuple[str, bool]] = []
        for state in ("down", "up"):
            subprocess.run(["ip", "link", "set", "vb", state], check=True)
            assert all(reader.step(sink) for _ in range(3))
            assert reader.drops is not None
            told += reader.take_outages()
        with sender("va") as out:
            out.send(udp(b"again"))
        assert until(reader, sink, 1) == [udp(b"again")]
        told += reader.take_outages()
        assert [over for _, over in told] == [False, True]
        assert told[0][0] == "the interface vb went down; nothing is captured until it is up"
        assert re.fullmatch(r"the interface vb is up again; nothing was captured for 0\.[0-9] s", told[1][0])
        assert 0 < reader.down_seconds < 1
        reader.close()

    in_namespace(task)


# ---- what cannot be opened ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ["auto", "ring", "dumpcap"])
@pytest.mark.parametrize("name", ["nosuch0", "1", "", "rpcap://x/y", "TCP@x:1", "/dev/null", "-D"])
def test_no_such_interface(name: str, engine: str) -> None:
    with pytest.raises(LiveError, match="there is no interface") as told:
        open_live(name, "", engine)
    assert "lo" in told.value.advice[0]


@pytest.mark.parametrize("engine", ENGINES)
def test_a_bad_filter_is_told(engine: str) -> None:
    with pytest.raises(LiveError, match=r"'tcp && && port' is not valid: .*syntax error"):
        open_live("lo", "tcp && && port", engine)


@pytest.mark.parametrize("engine", ENGINES)
def test_an_interface_that_is_down(engine: str) -> None:
    def task() -> None:
        subprocess.run(["ip", "link", "set", "vb", "down"], check=True)
        with pytest.raises(LiveError, match="vb: it is down") as told:
            open_live("vb", "", engine)
        assert told.value.advice == ("sudo ip link set vb up",)

    in_namespace(task)


def test_wrong_arguments() -> None:
    for arguments in ({"engine": "x"}, {"snaplen": -1}, {"buffer_mib": 0}, {"expression": "a\0b"}):
        with pytest.raises(LiveError):
            open_live("lo", **arguments)


@needs_ring
def test_without_dumpcap_the_ring_captures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    reader: LiveReader = open_live("lo")
    assert reader.engine == "ring"
    reader.close()
    with pytest.raises(UnavailableError, match="not installed") as told:
        open_live("lo", engine="dumpcap")
    assert "apt install wireshark-common" in told.value.advice[0]


@needs_ring
def test_a_dumpcap_that_may_not_be_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "dumpcap").write_bytes(b"")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UnavailableError, match="no permission to run it") as told:
        open_live("lo", engine="dumpcap")
    assert told.value.advice


@needs_ring
def test_a_dumpcap_that_says_nothing_useful(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / "dumpcap"
    program.write_text(
        "#!/bin/sh\nexec 1>&-\nsleep 0.05\necho 'dumpcap: something \033[31mnew' >&2\nexit 1\n", encoding="utf-8"
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    with pytest.raises(LiveError, match=r"lo: dumpcap: something \\x1b\[31mnew"):
        open_live("lo", engine="dumpcap")


@needs_ring
def test_a_dumpcap_that_closes_its_output_and_stays(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / "dumpcap"
    program.write_text("#!/bin/sh\nexec 1>&-\nexec sleep 60\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    monkeypatch.setattr("dissect.packets.source.live.dumpcap._END_S", 0.05)
    with pytest.raises(LiveError, match="lo: dumpcap: ended without a message"):
        open_live("lo", engine="dumpcap")


@needs_ring
def test_a_dumpcap_that_never_begins(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    program = tmp_path / "dumpcap"
    program.write_text("#!/bin/sh\necho 'dumpcap: busy' >&2\nexec sleep 60\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
    monkeypatch.setattr("dissect.packets.source.live.dumpcap._START_S", 0.2)
    with pytest.raises(LiveError, match="lo: dumpcap did not start within 0 s: busy"):
        open_live("lo", engine="dumpcap")


@needs_ring
def test_packets_that_the_ring_holds_when_it_is_closed_are_counted_as_lost() -> None:
    def task() -> None:
        reader = open_live("vb", "udp", "ring")
        sink = Sink()
        with sender("va") as out:
            for number in range(10):
                out.send(udp(bytes([number])))
            assert len(until(reader, sink, 10)) == 10
            for number in range(500):
                out.send(udp(number.to_bytes(2, "big") * 100))
        reader.stop()
        time.sleep(0.3)  # the kernel gives the last block back
        assert reader.drops.kernel == 0
        reader.close()
        assert reader.drops.kernel == 500
        reader.close()
        assert reader.drops.kernel == 500

    in_namespace(task)
