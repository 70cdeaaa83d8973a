"""``--metrics``: told before anything is captured, there while the monitor runs, gone after it."""

from __future__ import annotations

import http.client
import re
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dissect.online.live.session import Session
from dissect.online.net.addresses import Address
from dissect.packets.source.files import open_capture
from tests.cli.support import run
from tests.conftest import ROOT

CAPTURE = ROOT / "captures" / "item-errors.pcapng"


def fetch(port: int) -> str:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    try:
        connection.request("GET", "/metrics")
        return connection.getresponse().read().decode()
    finally:
        connection.close()


def test_metrics_while_a_capture_comes_on_standard_input() -> None:
    octets = CAPTURE.read_bytes()
    with subprocess.Popen(
        [sys.executable, "-m", "dissect", "monitor", "--plain", "--metrics", "127.0.0.1:0", "-"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        told = re.fullmatch(rb"s7dissect: metrics at http://127\.0\.0\.1:(\d+)/metrics\n", process.stderr.readline())
        assert told is not None
        process.stdin.write(octets)
        process.stdin.flush()
        while b"Write Var" not in process.stdout.readline():
            pass
        text = fetch(int(told[1]))
        process.stdin.close()
        process.stdout.read()
        assert process.wait(timeout=60) == 0
    assert 's7dissect_transactions_total{function="Read Var",outcome="answered",protocol="s7comm"} 4.0\n' in text
    assert "s7dissect_queue_events " in text
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", int(told[1])), timeout=10)


@pytest.mark.parametrize("address", ["9102", ":9102", "127.0.0.1:99999"])
def test_an_address_that_is_none(capfdbinary: pytest.CaptureFixture[bytes], address: str) -> None:
    ran = run(capfdbinary, "monitor", "--plain", "--metrics", address, CAPTURE)
    assert (ran.code, ran.out) == (2, "")
    assert "Invalid value for '--metrics'" in ran.err


def test_an_address_that_others_reach(capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    ran = run(capfdbinary, "monitor", "--plain", "--metrics", "0.0.0.0:0", CAPTURE)
    assert (ran.code, ran.out) == (2, "")
    assert "add --allow-remote if that is intended" in ran.err
    ran = run(capfdbinary, "monitor", "--plain", "--metrics", "0.0.0.0:0", "--allow-remote", CAPTURE)
    assert ran.code == 0


def test_a_port_that_is_taken_ends_it_before_anything_is_read(
    capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with socket.create_server(("127.0.0.1", 0)) as other:
        address = f"127.0.0.1:{other.getsockname()[1]}"
        ran = run(capfdbinary, "monitor", "--plain", "--metrics", address, tmp_path / "nothing.pcapng")
    assert (ran.code, ran.out) == (2, "")
    assert "in use: choose a different port or address with --metrics" in ran.err
    assert "nothing.pcapng" not in ran.err


def test_a_port_that_is_taken_does_not_end_a_probe_without_a_terminal(
    capfdbinary: pytest.CaptureFixture[bytes],
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        address = f"127.0.0.1:{other.getsockname()[1]}"
        ran = run(capfdbinary, "monitor", "--plain", "--metrics", address, CAPTURE)
    assert ran.code == 0
    assert ran.out
    assert "choose a different port or address with --metrics; it will be tried again" in ran.err


def test_nothing_is_loaded_without_it() -> None:
    code = (
        "import sys\nfrom dissect.cli.main import main\n"
        f"try: main(['monitor', '--plain', {str(CAPTURE)!r}])\n"
        "except SystemExit: pass\nprint([n for n in sys.modules if 'metrics' in n or 'prometheus' in n or n == 'http.server'])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines()[-1] == "[]"


def test_a_scrape_knows_the_queue_of_its_session() -> None:
    from dissect.cli.scrape import Scrape
    from dissect.online.metrics.counters import Metrics

    with Scrape(Address("127.0.0.1", 0), False) as scrape:
        metrics, keeper = scrape.companions
        assert keeper.name == "the metrics server"
        assert isinstance(metrics, Metrics)
        session = Session(lambda: open_capture(str(CAPTURE)), companions=scrape.companions, max_events=1)
        scrape.watch(session)
        session.start()
        end = time.monotonic() + 30
        while not session.waiting and time.monotonic() < end:
            session.poll(0.05, 0)
        session.close()  # a file waits for its reader until it is told to stop; then the rest has no place
        assert metrics.queue == (session.waiting, sum(session.lost.values()))
        assert metrics.queue[1] > 0


def test_without_an_address_there_is_nothing() -> None:
    from dissect.cli.scrape import Scrape

    with Scrape(None, False) as scrape:
        assert scrape.companions == []
