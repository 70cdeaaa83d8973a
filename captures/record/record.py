"""Record the sessions again: ``python3 captures/record/record.py [NAME ...]``, as root, over loopback only.

Makes the peers' environments on first use: two virtual environments in ``captures/record/.env``, and nodes7 with its node where
the tests have them (scripts/install-nodes7.sh; ``.venv``, or what VENV names). Then, for each session, it captures with
dumpcap, lets the peers talk, counts what tshark sees, compares this with the expected results of the conversation's script, and
writes ``captures/NAME.pcapng`` and ``captures/NAME.toml``. Needs Python 3.11, dumpcap, tshark, ``make test-environment`` (or a
node with npm), and the ports 102, 1102, 2102 and those 10000 above them free. Nothing outside the standard library.
"""

from __future__ import annotations

import datetime as dt
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from contextlib import ExitStack
from pathlib import Path

from dumpcap import Dumpcap
from expect import Expected, count_expected, read_packets, write_table
from nodes7 import modules_of, node_of, variables_of
from relay import Relay
from sessions import SESSIONS, Session

HERE = Path(__file__).resolve().parent
CAPTURES = HERE.parent
ROOT = CAPTURES.parent
TESTED = ROOT / os.environ.get("VENV", ".venv")
"""The environment that the tests run in; nodes7 and its node are the same here and there."""
ENVIRONMENTS = HERE / ".env"
REJECTED = ENVIRONMENTS / "rejected"
"""Where the recordings go that are not what was promised, to be looked at."""
PATIENCE = 60.0
"""Seconds a client may take."""
BEHIND = 10000
"""The real server's port above the relay's."""
SHOWN = "captures/record"
SCRIPTS = {
    "native": "talk_native.py",
    "python": "talk_python.py",
    "nodes7": "talk_nodes7.js",
    "partner": "talk_partner.py",
}


def make_environments() -> None:
    """Two generations of python-snap7 side by side, and nodes7."""
    for name in ("native", "python"):
        home = ENVIRONMENTS / name
        if not (home / "bin" / "python").exists():
            venv.create(home, with_pip=True)
            pip = [str(home / "bin" / "python"), "-m", "pip", "install", "--quiet"]
            subprocess.run([*pip, "-r", str(HERE / f"requirements-{name}.txt")], check=True)
    subprocess.run([str(ROOT / "scripts" / "install-nodes7.sh")], check=True)


def interpreter(peer: str) -> str:
    """The program that runs a peer's script."""
    if peer == "nodes7":
        return str(node_of(TESTED))
    return str(ENVIRONMENTS / ("python" if peer == "python" else "native") / "bin" / "python")


def version_of(peer: str) -> str:
    """Name and version of a peer's software, as installed."""
    if peer == "nodes7":
        package = json.loads((modules_of(TESTED) / "nodes7" / "package.json").read_text())
        ask_node = [interpreter(peer), "--version"]
        node = subprocess.run(ask_node, capture_output=True, text=True, check=True).stdout.strip()
        return f"nodes7 {package['version']} on node {node}"
    ask = "import importlib.metadata as m; print(m.version('python-snap7'))"
    version = subprocess.run([interpreter(peer), "-c", ask], capture_output=True, text=True, check=True).stdout.strip()
    return f"python-snap7 {version} ({'pure Python' if peer == 'python' else 'the Snap7 library, C++'})"


def start_server(stack: ExitStack, session: Session, port: int) -> None:
    """Start the server and wait until it listens; it ends with ``stack``."""
    limit = [str(session.max_clients)] if session.max_clients else []
    command = [interpreter(session.server), str(HERE / "serve.py"), str(port), *limit]
    server = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    stack.callback(server.wait, 20)
    assert server.stdin is not None
    assert server.stdout is not None
    stack.callback(server.stdin.close)
    if server.stdout.readline().strip() != "ready":
        raise RuntimeError(f"{session.name}: the server did not start")


def client_command(client: str, port: int) -> list[str]:
    """The command line of ``PEER CONVERSATION``."""
    peer, *conversation = client.split()
    return [interpreter(peer), str(HERE / SCRIPTS[peer]), *conversation, str(port)]


def talk(session: Session, port: int) -> list[subprocess.Popen[str]]:
    """Start every client of a session."""
    variables = variables_of(TESTED)
    return [
        subprocess.Popen(client_command(one, port), stdout=subprocess.PIPE, text=True, env=variables)
        for one in session.clients
    ]


def wait_asking(client: subprocess.Popen[str]) -> None:
    """Wait until the client has a request open that is not answered soon."""
    assert client.stdout is not None
    if client.stdout.readline().strip() != "asking":
        raise RuntimeError("the client never asked")
    time.sleep(0.2)


def end_clients(session: Session, clients: list[subprocess.Popen[str]]) -> None:
    """Wait for each process; kill the one that must be killed. Raises RuntimeError if a conversation did not go as expected."""
    if session.moment == "kill":
        wait_asking(clients[0])
        clients[0].kill()
    for client in clients:
        code = client.wait(PATIENCE)
        if code and session.moment != "kill":
            raise RuntimeError(f"{session.name}: {client.args!r} ended with {code}")


def record(session: Session, path: Path) -> int:
    """Run one session into ``path``; return the number of packets according to dumpcap."""
    capture_filter = f"tcp port {session.port}"
    with ExitStack() as stack:
        server_port = session.port + BEHIND if session.fault else session.port
        if session.server:
            start_server(stack, session, server_port)
        if session.fault:
            relay = Relay(session.port, server_port, session.fault)
            stack.callback(relay.close)
        if session.moment == "late":
            clients = talk(session, session.port)
            wait_asking(clients[0])
            capture = Dumpcap(path, capture_filter, session.purpose)
        else:
            capture = Dumpcap(path, capture_filter, session.purpose)
            clients = talk(session, session.port)
        try:
            end_clients(session, clients)
            if session.fault == "slow":
                time.sleep(2)  # an answer may still be held back
        finally:
            packets = capture.stop()
    return packets


def check(session: Session, counted: Expected, packets: int) -> None:
    """Raises RuntimeError if tshark's counts are not the expected results of the script."""
    told = dict(session.promise._asdict(), packets=packets, unsolicited=0)
    seen = dict(counted, asked=counted["answered"] + counted["unanswered"])
    wrong = [
        f"{name}: tshark counts {seen[name]}, the script {told[name]}" for name in told if seen[name] != told[name]
    ]
    if wrong:
        raise RuntimeError(f"{session.name}: " + "; ".join(wrong))


def tell_how(session: Session) -> list[str]:
    """The commands, in order."""
    server_port = session.port + BEHIND if session.fault else session.port
    steps = []
    if session.server:
        limit = f" {session.max_clients}" if session.max_clients else ""
        steps.append(f"python {SHOWN}/serve.py {server_port}{limit}  # {version_of(session.server)}")
    if session.fault:
        steps.append(f"relay {session.port} -> {server_port}: {session.fault}  # {SHOWN}/relay.py")
    capture = f'dumpcap -i lo -f "tcp port {session.port}" -w {session.name}.pcapng'
    talks = []
    for client in session.clients:
        peer, *conversation = client.split()
        runner = "node" if peer == "nodes7" else "python"
        said = " ".join([runner, f"{SHOWN}/{SCRIPTS[peer]}", *conversation, str(session.port)])
        talks.append(f"{said}  # {version_of(peer)}")
    steps += [*talks, capture] if session.moment == "late" else [capture, *talks]
    if session.moment == "kill":
        steps.append("kill -KILL the client while its third poll is open")
    return steps


def write_toml(session: Session, counted: Expected) -> str:
    """The text of ``NAME.toml``."""
    tools = subprocess.run(["dumpcap", "--version"], capture_output=True, text=True, check=True).stdout
    dumpcap = tools.splitlines()[0].split(" (Git")[0].rstrip(".")
    how = [json.dumps(step, ensure_ascii=False) for step in tell_how(session)]
    lines = [
        f"purpose = {json.dumps(session.purpose, ensure_ascii=False)}",
        "how = [",
        *(f"    {step}," for step in how),
        "]",
        f"recorded = {dt.datetime.now(tz=dt.UTC).date().isoformat()}  # {dumpcap}",
        f"port = {session.port}",
        "",
        write_table(counted),
    ]
    return "\n".join(lines)


def main(names: list[str]) -> int:
    """Record the named sessions, or all; return the exit code."""
    if os.geteuid() != 0:
        print("record.py captures on lo and listens on port 102: run it as root", file=sys.stderr)
        return 2
    known = {session.name: session for session in SESSIONS}
    unknown = [name for name in names if name not in known]
    if unknown:
        print(f"no session {', '.join(unknown)}; there are: {', '.join(known)}", file=sys.stderr)
        return 2
    make_environments()
    failed = 0
    with tempfile.TemporaryDirectory() as scratch:
        for session in [known[name] for name in names] or SESSIONS:
            path = Path(scratch) / f"{session.name}.pcapng"
            try:
                packets = record(session, path)
                counted = count_expected(read_packets(path, session.port))
                check(session, counted, packets)
            except (RuntimeError, subprocess.TimeoutExpired) as problem:
                failed += 1
                REJECTED.mkdir(exist_ok=True)
                shutil.copy(path, REJECTED)
                print(f"NOT KEPT {problem}", file=sys.stderr)
                continue
            shutil.copy(path, CAPTURES)
            (CAPTURES / f"{session.name}.toml").write_text(write_toml(session, counted))
            size = path.stat().st_size
            print(f"{session.name}: {counted['packets']} packets, {counted['s7_pdus']} PDUs, {size} octets")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
