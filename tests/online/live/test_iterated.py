"""`dissect.live` and Scapy's `sniff` on the loopback interface, as programs use them, while a client asks a PLC."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from scapy.sendrecv import AsyncSniffer
from scapy.utils import wrpcap

import dissect
from dissect.layers import S7Session
from tests.online.live.support import client, plc
from tests.packets.source.live_support import ENGINES, needs_ring

READS = ["Read Var"] * 3


def ask(port: int) -> None:
    """Set up, read three times, and leave."""
    with client(port) as panel:
        for octet in range(3):
            panel.db_read(1, octet, 4)


def beside(port: int, then: Callable[[], None]) -> threading.Thread:
    """Ask beside the test, and do something when that is done."""

    def run() -> None:
        ask(port)
        then()

    thread = threading.Thread(target=run)
    thread.start()
    return thread


def reads(events: list[Any]) -> list[str]:
    return [one.function_name for one in events if isinstance(one, dissect.Transaction) and one.function == 4]


@pytest.fixture
def port() -> Iterator[int]:
    with plc() as server:
        yield server.port


@pytest.mark.parametrize("engine", ENGINES)
def test_loopback_is_iterated(port: int, engine: str) -> None:
    with dissect.live("lo", filter=f"tcp port {port}", engine=engine, pdus=False) as events:
        thread = beside(port, threading.Timer(0.5, events.stop).start)
        found = list(events)
        thread.join()
        assert reads(found) == READS
        assert isinstance(found[-1], dissect.Connection)
        assert (events.drops.kernel, events.drops.interface) == (0, 0)
        assert events.packets > 10


@needs_ring
def test_loopback_is_iterated_beside_other_tasks(port: int) -> None:
    async def follow() -> list[Any]:
        found = []
        async with dissect.live(
            "lo", filter=f"tcp port {port}", engine="ring", where='function == "Read Var"'
        ) as events:
            asking = asyncio.create_task(asyncio.to_thread(ask, port))
            async for event in events:
                found.append(event)
                if len(reads(found)) == len(READS):
                    events.stop()
            await asking
        return found

    assert reads(asyncio.run(asyncio.wait_for(follow(), 60))) == READS


@needs_ring
def test_what_sniff_took_from_loopback_is_a_capture(port: int, tmp_path: Path) -> None:
    ready = threading.Event()
    path = tmp_path / "sniffed.pcap"
    session = S7Session()
    sniffer = AsyncSniffer(iface="lo", filter=f"tcp port {port}", session=session, started_callback=ready.set)
    sniffer.start()
    assert ready.wait(30)
    ask(port)
    threading.Event().wait(0.5)
    packets = sniffer.stop()
    assert packets is not None
    wrpcap(str(path), packets)
    assert reads(list(dissect.open(path, pdus=False))) == READS
