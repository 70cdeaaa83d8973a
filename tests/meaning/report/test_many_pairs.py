"""What happened once between two hosts is not hidden by a thousand times between two others, nor by coming late."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from typing import Final

import pytest

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.engine.transactions.connection import Connection
from dissect.meaning.report.analysis import MAX_CONNECTIONS, Analysis
from dissect.meaning.report.brief import brief_lines
from dissect.meaning.report.examples import examples_of
from dissect.meaning.report.servers import Servers
from dissect.online.monitor.lists import MAX_DETAILS, FindingList
from dissect.output.page.findings import findings_of
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from tests.engine.transactions.talk import ack_data, job
from tests.meaning.report.support import analysed, begun, report, saved, section
from tests.output.page.support import gathered_of, page_of
from tests.properties.messages import dt
from tests.properties.packets import Flow, Packet

STOP: Final = job(9, b"\x29" + bytes(5) + b"\x09P_PROGRAM")
STOPPED: Final = ack_data(9, b"\x29")
SLUG: Final = "security.plc_stop"


def stops(servers: list[str]) -> list[Packet]:
    """PLC stops of these servers, each in a connection of its own."""
    packets: list[Packet] = []
    for number, server in enumerate(servers):
        talk = begun(Flow(server=server, ports=(20_000 + number, 102)))
        talk.send(0, dt(STOP)).send(1, dt(STOPPED))
        now = packets[-1].time_ns + 1000 if packets else 0
        packets += talk.close().packets(start_ns=now, step_ns=1000)
    return packets


def finding(number: int, server: str) -> Finding:
    made = Finding(CATALOGUE[SLUG], number, [number], number, f"to {server}")
    made.client, made.server = "10.0.0.1", server
    return made


@pytest.mark.parametrize(
    ("servers", "most", "chosen"),
    [
        ("aaaa", 3, [0, 1, 2]),
        ("aaaaab", 3, [0, 1, 5]),
        ("abbbbc", 3, [0, 1, 5]),
        ("aaaabcd", 3, [0, 4, 5]),
        ("aabb", 5, [0, 1, 2, 3]),
        ("aaaaaab", 1, [0]),
        ("", 3, []),
    ],
)
def test_which_findings_are_shown(servers: str, most: int, chosen: list[int]) -> None:
    found = [finding(number, server) for number, server in enumerate(servers)]
    assert [one.connection for one in examples_of(iter(found), most)] == chosen


@pytest.mark.parametrize("at", [0, 5, 29])
def test_the_one_stop_of_another_plc_is_shown(at: int) -> None:
    servers = ["10.0.0.2"] * 30
    servers[at] = "10.0.0.3"
    lines = section(report(analysed(stops(servers))), "Findings")
    said = [line for line in lines if line.startswith("connection ")]
    assert len(said) == 3
    assert [" to 10.0.0.3:102: PLC stop" in line for line in said].count(True) == 1
    more = next(line for line in lines if line.startswith("and "))
    shown = {int(number) for line in said for number in re.findall(r"(\d+):", line.partition(": ")[0] + ":")}
    assert more.startswith("and 27 more: packets ")
    assert not shown & {int(number) for number in re.findall(r" (\d+),", more)}


def test_the_page_shows_the_one_stop_of_another_plc(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.pcapng", stops(["10.0.0.2"] * 40 + ["10.0.0.3"]))
    (told,) = findings_of(gathered_of([path]))
    assert [row["connection"] for row in told["rows"]] == [*range(1, 25), 41]
    assert "25 of 41: the first of as many pairs of hosts as possible, then the earliest." in page_of(path)


def test_screens_keep_the_finding_of_the_pair_that_has_few() -> None:
    listed = FindingList()
    for number in range(3 * MAX_DETAILS):
        listed.note(finding(number, "b" if number == 7 else "a"))
    (facts,) = listed.facts({SLUG: 3 * MAX_DETAILS})
    assert len(facts.details) == MAX_DETAILS
    assert [one.connection for one in facts.details][:2] == [7, 2 * MAX_DETAILS + 1]


# ---- connections ----------------------------------------------------------------------------------------------------


def connection(number: int, server: int, errors: int = 0, pdus: int = 1) -> Connection:
    ends = Endpoint(b"\n\0\0\1", 1024), Endpoint(b"\n\0" + server.to_bytes(2, "big"), 102)
    made = Connection(number, TcpConnection(*ends, 0, 1, 1))
    made.errors, made.pdus, made.answered = errors, pdus, pdus
    return made


def brief(analysis: Analysis, title: str) -> list[str]:
    lines = [line.text for line in brief_lines(analysis)]
    begin = next(at for at, line in enumerate(lines) if line.startswith(title))
    return list(itertools.takewhile(lambda line: line.startswith("  "), lines[begin + 1 :]))


def test_plcs_are_counted_from_all_connections() -> None:
    analysis = Analysis()
    for number in range(1, MAX_CONNECTIONS + 101):
        analysis.connection_closed(connection(number, 2))
    analysis.connection_closed(connection(MAX_CONNECTIONS + 101, 3, errors=1, pdus=4))
    rows = [line.split()[:4] for line in brief(analysis, "PLCs")[1:]]
    assert rows == [["10.0.0.3", "1", "4", "4"], ["10.0.0.2", "1100", "1100", "1100"]]


@pytest.mark.parametrize("parts", [1, 2, 7])
def test_the_connections_that_matter_most_are_kept_whenever_they_come(parts: int) -> None:
    most = MAX_CONNECTIONS + 200
    made = [connection(number, 2, errors=number % 7 == 3, pdus=number * 37 % 101) for number in range(1, most + 1)]
    expected = sorted(made, key=lambda one: (-one.errors, -one.pdus, one.number))
    whole = Analysis()
    for part in range(parts):
        one = Analysis()
        for each in made[part * most // parts : (part + 1) * most // parts]:
            one.connection_closed(each)
        whole.merge(one)
    assert len(whole.connections) == MAX_CONNECTIONS
    assert {one.number for one in whole.connections} == {one.number for one in expected[:MAX_CONNECTIONS]}
    assert whole.connections_not_listed == 200
    assert whole.worst_connections(20) == expected[:20]
    assert whole.servers.found["10.0.0.2"].connections == most


def test_servers_have_a_bound_and_silent_ones_push_out_nobody() -> None:
    servers = Servers(3)
    for number in range(20):
        servers.take(connection(number, 100 + number, pdus=0))  # a scan
    for number in range(5):
        servers.take(connection(number, number))
    servers.take(connection(9, 1, pdus=0))
    assert list(servers.found) == ["10.0.0.0", "10.0.0.1", "10.0.0.2"]
    assert (servers.found["10.0.0.1"].connections, servers.further) == (2, 2)
    more = Servers(3)
    more.take(connection(1, 1, errors=2))
    more.take(connection(2, 8))
    more.take(connection(3, 100))
    more.merge(servers)
    assert (more.found["10.0.0.1"].connections, more.found["10.0.0.1"].errors) == (3, 2)
    assert (more.found["10.0.0.100"].connections, more.further) == (2, 4)
