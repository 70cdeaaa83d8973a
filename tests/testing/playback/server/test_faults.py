"""Faults: how they are said, and what a client sees of each."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.protocols.s7.message import parse_pdu
from dissect.testing.playback.server import Fault, Server, parse_fault
from dissect.testing.playback.server.session import SPLIT_SIZE
from dissect.testing.talk import read, szl, write
from tests.online.proxy.support import tshark
from tests.testing.playback.server.support import Plain, small


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("drop:3", Fault("drop", 3)),
        ("delay:1:250", Fault("delay", 1, "", 250)),
        ("delay:DB10.*:0.5", Fault("delay", 0, "DB10.*", 0.5)),
        ("refuse:2", Fault("refuse", 2, "", 0x8104)),
        ("refuse:Read Var:0xD241", Fault("refuse", 0, "Read Var", 0xD241)),
        ("cut:*", Fault("cut", 0, "*")),
        ("wrong-ref:C200:5", Fault("wrong-ref", 0, "C200:5")),
        ("split:CPU functions: read SZL", Fault("split", 0, "CPU functions: read SZL")),
    ],
)
def test_a_fault_is_read(text: str, fault: Fault) -> None:
    assert parse_fault(text) == fault


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "is not a fault"),
        ("drop", "is not a fault"),
        ("drop:", "is not a fault"),
        ("lose:3", "one of drop, delay, refuse, cut, wrong-ref, split"),
        ("drop:0", "counted from 1"),
        ("delay:3", "for example delay:3:250"),
        ("delay:3:-1", "for example delay:3:250"),
        ("delay:3:nan", "for example delay:3:250"),
        ("delay::5", "for example delay:3:250"),
        ("refuse:1:0x0", "and CODE is not 0"),
        ("refuse:0x1", "a refusal is"),
        ("refuse:3:8104", "expected refuse:WHERE or refuse:WHERE:0xCODE, WHERE a number or a pattern"),
        ("drop:3:250", "expected drop:WHERE, WHERE a number or a pattern"),
    ],
)
def test_what_is_no_fault_is_told(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        parse_fault(text)


@pytest.mark.parametrize(
    ("pattern", "hits"),
    [
        ("read var", True),
        ("Write*", False),
        ("DB10.DBW4", True),
        ("db10.*", True),
        ("MW?", True),
        ("M*1", False),
        ("*", True),
    ],
)
def test_a_pattern_is_for_functions_and_addresses(pattern: str, hits: bool) -> None:
    asked = parse_pdu(read("DB10.DBW4", "MW2").octets)
    assert Fault("drop", 0, pattern).hits(7, asked) is hits
    assert Fault("drop", 7).hits(7, asked)
    assert not Fault("drop", 6).hits(7, asked)


def test_dropped_and_then_as_if_nothing_had_been() -> None:
    with Server(small(), faults=["drop:2"]) as server, Plain(server) as client:
        client.set_up()
        client.send(read("DB10.DBW4"))
        assert client.silent()
        assert client.words("DB10.DBW4") == [2]
        assert [request.faults for request in server.requests] == [(), ("drop",), ()]


def test_a_delayed_answer_comes_when_others_have_come() -> None:
    with Server(small(), faults=["delay:2:400"]) as server, Plain(server) as client:
        client.set_up()
        began = time.monotonic()
        late, soon = client.send_together(read("DB10.DBW4"), szl(0x11))
        assert [client.pdu().pdu_ref, client.pdu().pdu_ref] == [soon, late]
        assert time.monotonic() - began >= 0.4


def test_refused() -> None:
    with Server(small(), faults=["refuse:DB10.DBW4:0x8702", "refuse:CPU*"]) as server, Plain(server) as client:
        told = client.ask(read("DB10.DBW4"))
        assert (told.rosctr, told.error_class, told.error_code, told.malformed) == (2, 0x87, 0x02, [])
        told = client.ask(szl(0x11))
        assert told.parameters.userdata is not None
        assert told.parameters.userdata.error_code == 0x8104
        assert client.ask(write("DB10.DBW8 = 5")).return_codes() == [0xFF]
        assert server.unmatched == []


def test_cut() -> None:
    with Server(small(), faults=["cut:2"]) as server:
        with Plain(server) as client:
            client.set_up()
            client.send(read("DB10.DBW4"))
            assert client.ended() == "reset"
        with Plain(server) as client:
            assert client.words("DB10.DBW4") == [1]


def test_the_reference_of_another() -> None:
    with Server(small(), faults=["wrong-ref:1"]) as server, Plain(server) as client:
        reference = client.send(read("DB10.DBW4"), 0xFFFF)
        assert client.pdu().pdu_ref == 0 != reference
        assert client.words("DB10.DBW4") == [2]


def test_split_into_segments(tmp_path: Path) -> None:
    path = tmp_path / "split.pcapng"
    with Server(small(), faults=["split:2"], writer=PcapngWriter(str(path))) as server, Plain(server) as client:
        client.set_up()
        client.send(read("DB10.DBW4"))
        client.send(read("DB10.DBW4"))
        assert [client.pdu().data.hex(), client.pdu().data.hex()] == ["ff0400100001", "ff0400100002"]
        port = server.port
    size = 7 + 12 + 2 + 6
    sizes = [int(row[1]) for row in tshark(path, f"tcp.srcport=={port} && tcp.len>0", "tcp.len", port=port)]
    assert sizes[2:] == [SPLIT_SIZE] * 3 + [size - 3 * SPLIT_SIZE, size]
