"""Clients of other makes at the fake PLC: each call of each that a recording can answer.

python-snap7 3 and nodes7 have tests of their own for whole sessions (test_real_client.py, test_nodes7.py).
"""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NoReturn

import pytest
from snap7.type import SrvArea

from captures.record.memory import memory_of
from dissect.testing.golden import read_session
from dissect.testing.playback.server import Server

ROOT: Final = Path(__file__).resolve().parent.parent.parent.parent.parent
CAPTURES: Final = ROOT / "captures"
NATIVE: Final = Path(sys.prefix) / "snap7-native"
PATIENCE_S: Final = 60.0

# ---- python-snap7 2, the library in C++ -----------------------------------------------------------------------------

#: Its sessions by the recordings of them: what each calls stands in captures/record/talk_native.py.
SESSIONS: Final = {
    "read-areas": "read-areas",
    "write-areas": "write-areas",
    "item-errors": "item-errors",
    "multi-items": "multi-items",
    "szl": "szl",
    "blocks": "blocks",
    "clock": "clock",
    "transfer-refused": "transfer-refused",
    "plc-control": "plc-control",
    "password": "password",
    "setup-pdu-sizes": "setup-pdu-sizes",
}


def missing(text: str) -> NoReturn:
    """Skip a test whose peer is not there; in CI it is a failure."""
    if os.environ.get("CI"):
        pytest.fail(text)
    pytest.skip(text)


@pytest.mark.parametrize(("conversation", "name"), SESSIONS.items())
def test_snap7_goes_through_its_session(conversation: str, name: str) -> None:
    folder = Path(os.environ.get("S7DISSECT_SNAP7") or NATIVE)
    if not folder.is_dir():
        missing(f"Snap7 is not installed: VENV={sys.prefix} scripts/install-native.sh does it")
    script = CAPTURES / "record" / "talk_native.py"
    with Server(CAPTURES / f"{name}.pcapng") as server:
        command = [sys.executable, str(script), conversation, str(server.port)]
        variables = {**os.environ, "PYTHONPATH": str(folder)}
        done = subprocess.run(command, env=variables, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert (done.returncode, done.stderr) == (0, "")
        assert [str(request) for request in server.unmatched] == []
        recorded = read_session(CAPTURES / f"{name}.pcapng").transactions
        assert len(server.requests) == sum([bool(one.request) for one in recorded])


# ---- calls, one by one ----------------------------------------------------------------------------------------------

ONE, TWO = memory_of(SrvArea.DB, 1), memory_of(SrvArea.DB, 2)
FLAGS: Final = memory_of(SrvArea.MK, 0)
BYTES: Final = [(1, 0, 4), (1, 4, 4)]
TEMPERATURE: Final = bytes.fromhex("41ac0000")
#: The recording that answers a call, the call, what comes of it.
Row = tuple[str, Callable[[Any], object], object]


def pys7() -> Any:
    try:
        return importlib.import_module("pyS7").S7Client
    except ImportError:
        missing("pyS7 is not installed: make test-environment does it")


def successes(results: Any) -> list[bool]:
    return [bool(result.success) for result in results]


def batch(client: Any) -> list[object]:
    with client.batch_write() as transaction:
        transaction.add("DB2,I4", -7)
    return list(client.read(["DB2,I4"]))


PYS7: Final[dict[str, Row]] = {
    "read": ("read-areas", lambda client: client.read(["DB1,B5", "MB20"]), [ONE[5], FLAGS[20]]),
    "read of one": ("read-areas", lambda client: client.read(["DB1,B5"]), [ONE[5]]),
    "read_detailed": (
        "read-areas",
        lambda client: [(one.success, one.value) for one in client.read_detailed(["DB1,B5", "DB77,I0"])],
        [(True, ONE[5]), (False, None)],
    ),
    "write": ("read-areas", lambda client: client.write(["MB20"], [9]) or client.read(["MB20"]), [9]),
    "write_detailed": (
        "read-areas",
        lambda client: successes(client.write_detailed(["MB20", "DB77,B0"], [9, 9])),
        [True, False],
    ),
    "batch_write": ("nodes7-poll", batch, [-7]),
}


@pytest.mark.parametrize("call", PYS7)
def test_pys7(call: str) -> None:
    made = pys7()
    name, does, expected = PYS7[call]
    with Server(CAPTURES / f"{name}.pcapng", memory=True) as server:
        with made("127.0.0.1", 0, 1, port=server.port, timeout=PATIENCE_S) as client:
            assert does(client) == expected
        strange = [request for request in server.unmatched if "DB77" not in str(request)]
        assert [str(request) for request in strange] == []


def test_lists_that_pys7_requests_are_refused_and_told() -> None:
    """pyS7 3.1 has the type of a push in its requests for lists, which no recorded client had."""
    with Server(CAPTURES / "szl.pcapng") as server:
        with pys7()("127.0.0.1", 0, 1, port=server.port, timeout=PATIENCE_S) as client:
            for call in (client.get_cpu_status, client.get_cpu_info):
                with pytest.raises(ValueError, match="return code: 0xa"):
                    call()
        told = [str(request).partition("nearest recorded: ")[2] for request in server.unmatched]
    assert [text.partition(";")[0] for text in told] == [
        "CPU functions: read SZL 0x0424 operating modes",
        "CPU functions: read SZL 0x0011 module identification",
    ]


#: Of the package s7commplus; `captures/s7plus/s7commplus.pcapng` holds what it calls.
PLUS: Final[dict[str, Row]] = {
    "db_read": ("", lambda client: client.db_read(1, 0, 4), TEMPERATURE),
    "db_read of another": ("", lambda client: client.db_read(1, 4, 4), bytes(4)),
    "db_read_multi": ("", lambda client: client.db_read_multi(BYTES), [TEMPERATURE, bytes(4)]),
    "db_read_multi, turned": ("", lambda client: client.db_read_multi(BYTES[::-1]), [bytes(4), TEMPERATURE]),
    "db_write": ("", lambda client: client.db_write(1, 0, bytes(4)), None),
    "get_cpu_state": ("", lambda client: client.get_cpu_state(), "RUN"),
    "explore": ("", lambda client: bool(client.explore(3)), True),
    "session_id": ("", lambda client: client.session_id, 1),
}


@pytest.mark.parametrize("call", PLUS)
def test_s7commplus(call: str) -> None:
    try:
        made = importlib.import_module("s7commplus.client").S7CommPlusClient
    except ImportError:
        missing("s7commplus is not installed: make test-environment does it")
    _, does, expected = PLUS[call]
    with Server(CAPTURES / "s7plus" / "s7commplus.pcapng") as server:
        client = made()
        client.connect("127.0.0.1", port=server.port, use_tls=False)
        assert does(client) == expected
        client.disconnect()
        assert [str(request) for request in server.unmatched] == []
