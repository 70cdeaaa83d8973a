"""nodes7 at the fake PLC, by the very script that the recordings were made with (scripts/install-nodes7.sh)."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

import pytest
from snap7.type import SrvArea

import dissect
from captures.record.memory import memory_of
from captures.record.nodes7 import SCRIPT, node_of, variables_of
from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.testing.playback.server import Server

ROOT: Final = Path(__file__).resolve().parent.parent.parent.parent.parent
ENVIRONMENT: Final = Path(sys.prefix)
PATIENCE_S: Final = 120.0
#: How long nodes7 waits for an answer where one is to be missed, and how often it asks at most.
PATIENT: Final = ("1000", "60")


@pytest.fixture(scope="module", autouse=True)
def nodes7() -> None:
    if not node_of(ENVIRONMENT).is_file():
        text = f"nodes7 is not installed: VENV={ENVIRONMENT} scripts/install-nodes7.sh does it"
        if os.environ.get("CI"):
            pytest.fail(text)
        pytest.skip(text)


def recording(name: str) -> Path:
    return ROOT / "captures" / f"{name}.pcapng"


def start(server: Server, conversation: str, *arguments: str) -> subprocess.Popen[str]:
    command = [str(node_of(ENVIRONMENT)), str(SCRIPT), conversation, str(server.port), *arguments]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=variables_of(ENVIRONMENT))


def heard(client: subprocess.Popen[str]) -> list[dict[str, Any]]:
    """Wait for the client's end, which is to be a good one; return what its reads gave."""
    try:
        out, err = client.communicate(timeout=PATIENCE_S)
    finally:
        client.kill()
    assert (client.returncode, err) == (0, "")
    return [json.loads(line) for line in out.splitlines()]


def talk(server: Server, conversation: str, *arguments: str) -> list[dict[str, Any]]:
    return heard(start(server, conversation, *arguments))


# ---- what the recorded PLC held -------------------------------------------------------------------------------------

ONE, TWO = memory_of(SrvArea.DB, 1), memory_of(SrvArea.DB, 2)
FLAGS, INPUTS, OUTPUTS = [memory_of(area, 0) for area in (SrvArea.MK, SrvArea.PE, SrvArea.PA)]


def value(form: str, octets: bytes, offset: int) -> Any:
    return struct.unpack_from(f">{form}", octets, offset)[0]


POLLED: Final = {
    "real": value("f", TWO, 16),
    "int": value("h", TWO, 4),
    "word": value("H", TWO, 6),
    "dint": value("i", TWO, 8),
    "bit": bool(TWO[0] & 1),
    "far": ONE[500],
    "bytes": list(ONE[10:30]),
    "text": TWO[22 : 22 + TWO[21]].decode(),
    "flag": value("H", FLAGS, 20),
    "flagBit": bool(FLAGS[10] & 8),
    "input": INPUTS[4],
    "output": value("H", OUTPUTS, 6),
    "timer": value("H", memory_of(SrvArea.TM, 0), 4 * 5),  # where the recorded server, Snap7, has T5
    "counter": value("H", memory_of(SrvArea.CT, 0), 4 * 3),
}
PARALLEL: Final = {
    **{f"DB1,BYTE{start}.190": list(ONE[start : start + 190]) for start in (0, 200, 400)},
    "DB10,BYTE0.64": list(memory_of(SrvArea.DB, 10)),
    **{f"{letter}B0.128": list(octets) for letter, octets in (("M", FLAGS), ("I", INPUTS), ("Q", OUTPUTS))},
}
MISSING: Final = {
    "int": POLLED["int"],
    "flag": POLLED["flag"],
    "DB99,INT0": "BAD 255",
    "DB2,REAL400": "BAD 255",
}


@pytest.mark.parametrize(
    ("conversation", "requests", "expected"),
    [
        ("poll", 6, [{"bad": False, "values": POLLED}] * 5),
        ("poll-unmerged", 3, [{"bad": False, "values": POLLED}] * 2),
        ("poll-parallel", 7, [{"bad": False, "values": PARALLEL}] * 3),
        ("poll-missing", 3, [{"bad": True, "values": MISSING}] * 2),
        ("write", 7, []),
    ],
)
def test_the_client_goes_through_its_session(
    conversation: str, requests: int, expected: list[dict[str, object]]
) -> None:
    with Server(recording(f"nodes7-{conversation}")) as server:
        assert talk(server, conversation) == expected
        assert [str(request) for request in server.unmatched] == []
        assert [request.how for request in server.requests] == ["same"] * requests
        assert list(server.problems) == []
        assert server.connections == 1


def test_what_was_not_recorded_is_refused_and_told(tmp_path: Path) -> None:
    path = tmp_path / "refused.pcapng"
    with Server(recording("read-areas"), writer=PcapngWriter(str(path))) as server:
        # One that another client read as well, and one that nobody did.
        told = talk(server, "until", "20000", "1", "DB1,BYTE5", "DB77,INT0")
        assert [str(request) for request in server.unmatched] == [
            (
                "request 2 on connection 1, Read Var DB1.DBB5, DB77.DBB0 x2: not recorded: DB77.DBB0 x2 "
                "(nearest recorded: DB1.DBB5; DB1.DBB4 x7; DB1.DBX10.3)"
            )
        ]
        assert server.problems.pop().startswith("unmatched: request 2 on connection 1, ")
    assert told == [{"bad": True, "values": {"DB1,BYTE5": ONE[5], "DB77,INT0": "BAD 255"}}]
    (read,) = [
        one
        for one in dissect.open(str(path), pdus=False)
        if isinstance(one, dissect.Transaction) and one.function_name == "Read Var"
    ]
    assert [error.code for error in read.errors] == [0x0A]  # object does not exist


def test_with_memory_the_client_reads_what_it_wrote() -> None:
    with Server(recording("nodes7-poll"), memory=True) as server:
        for tag, before, after in (
            ("DB2,INT4", POLLED["int"], -7),
            ("DB2,REAL16", POLLED["real"], 12.5),
            ("DB2,X0.0", True, False),
            ("DB2,S20.6", "Pump", "Valve"),
        ):
            told = talk(server, "back", tag, json.dumps(after))
            assert told == [{"bad": False, "values": {tag: one}} for one in (before, after)]
        changed = {"int": -7, "real": 12.5, "bit": False, "text": "Valve"}
        assert talk(server, "poll") == [{"bad": False, "values": POLLED | changed}] * 5
        assert server.unmatched == []


def test_two_clients_at_once_hear_the_same() -> None:
    with Server(recording("nodes7-poll")) as server:
        clients = [start(server, "poll") for _ in range(2)]
        assert [heard(client) for client in clients] == [[{"bad": False, "values": POLLED}] * 5] * 2
        assert [request.how for request in server.requests] == ["same"] * 12
        assert {request.connection for request in server.requests} == {1, 2}


def test_what_goes_wrong_is_an_error_of_the_client_and_then_it_recovers() -> None:
    """nodes7 reconnects after each of these, as it does with a PLC.

    A TPKT in pieces is an error to it, too, if it sees the pieces: a busy machine hands it several of them as one.
    """
    tags = ("DB2,INT4", "MW20")
    good = {"bad": False, "values": {"DB2,INT4": POLLED["int"], "MW20": POLLED["flag"]}}
    none = {"bad": True, "values": dict.fromkeys(tags, "BAD 255")}
    faults = ("drop:2", "delay:2:3000", "cut:2", "refuse:2:0x8500", "wrong-ref:2", "split:2")
    servers = [Server(recording("nodes7-poll"), memory=True, faults=[fault]) for fault in faults]
    for server in servers:
        server.start()
    try:
        clients = [start(server, "until", *PATIENT, *tags) for server in servers]
        for fault, server, told in zip(faults, servers, [heard(client) for client in clients], strict=True):
            whole = fault.startswith("split") and told == [good]
            assert (fault, told[0], told[-1]) == (fault, good if whole else none, good)
            assert [good] == [one for one in told if one != none]
            assert (fault, server.connections >= (1 if whole else 2), server.unmatched) == (fault, True, [])
            assert [request.faults for request in server.requests if request.faults] == [(fault.split(":")[0],)]
    finally:
        for server in servers:
            server.close()


def test_an_answer_that_is_late_but_not_too_late_is_no_error() -> None:
    with Server(recording("nodes7-poll"), memory=True, faults=["delay:2:300"]) as server:
        told = talk(server, "until", "20000", "1", "DB2,INT4")
        assert told == [{"bad": False, "values": {"DB2,INT4": POLLED["int"]}}]
        assert server.connections == 1
