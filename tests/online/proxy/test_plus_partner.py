"""S7comm-plus between a client and a server of others, the package s7commplus, through `s7dissect proxy`.

They are looser than a PLC (captures/README.md), so this proves that sessions run through the relay and are understood; what the
format is, public captures say (tests/protocols/s7plus/test_shared_captures.py).
"""

from __future__ import annotations

import contextlib
import json
import ssl
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization

from tests.cli.test_proxy import proxy
from tests.conftest import Command
from tests.online.proxy.support import LOOPBACK, port_of_nobody
from tests.protocols.tls.talks import certificate, rsa_key

client_module = pytest.importorskip("s7commplus.client")
server_module = pytest.importorskip("s7commplus.server")

VARIABLES = {"temperature": ("Real", 0), "pressure": ("Real", 4), "count": ("Int", 8)}


@contextlib.contextmanager
def cpu() -> Iterator[int]:
    """A server with one block; the port it listens at."""
    server = server_module.S7CommPlusServer()
    server.register_db(1, VARIABLES)
    port = port_of_nobody()
    server.start(host=LOOPBACK, port=port)
    try:
        yield port
    finally:
        server.stop()


@contextlib.contextmanager
def cpu_with_tls(folder: Path) -> Iterator[tuple[int, Path]]:
    """A server that goes over to TLS; its port, and the key log that OpenSSL writes on its side.

    The package gives no way to name a key log, so its context is told.
    """
    pem, keys = folder / "pem", folder / "keys"
    private = rsa_key().private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    pem.write_bytes(private + certificate(rsa_key()).public_bytes(serialization.Encoding.PEM))
    server = server_module.S7CommPlusServer()
    server.register_db(1, VARIABLES)
    port = port_of_nobody()
    server.start(host=LOOPBACK, port=port, use_tls=True, tls_cert=str(pem), tls_key=str(pem))
    context = server._ssl_context
    assert isinstance(context, ssl.SSLContext)
    context.keylog_filename = str(keys)
    try:
        yield port, keys
    finally:
        server.stop()


def used(port: int, *, tls: bool = False) -> None:
    """Write, read one and two, read what is not there, look around."""
    client = client_module.S7CommPlusClient()
    client.connect(LOOPBACK, port=port, use_tls=tls)
    assert client.tls_active == tls
    try:
        client.db_write(1, 0, struct.pack(">f", 21.5))
        assert client.db_read(1, 0, 4) == struct.pack(">f", 21.5)
        assert client.db_read_multi([(1, 0, 4), (1, 4, 4)]) == [struct.pack(">f", 21.5), bytes(4)]
        with pytest.raises(Exception, match="error"):
            client.db_read(7, 0, 4)
        assert client.get_cpu_state() == "RUN"
        assert client.explore()
    finally:
        client.disconnect()


def test_a_session_runs_through_the_relay_and_is_understood(tmp_path: Path, s7dissect: Command) -> None:
    path = tmp_path / "out.pcapng"
    with cpu() as port, proxy(port, "-w", path, "-T", "jsonl") as made:
        used(made.port)
        code, lines, _ = made.ended()
    assert code == 0
    told = [json.loads(line) for line in lines]
    found = [one for one in told if one.get("schema") == "s7dissect.transaction/1"]
    functions = [one["function"]["name"] for one in found]
    assert functions[:2] == ["InitSSL", "CreateObject"]
    assert functions[-1] == "DeleteObject"
    assert {"SetMultiVariables", "GetMultiVariables", "Explore"} <= set(functions)
    assert {one["outcome"] for one in found} == {"answered"}
    reads = [one for one in found if one["function"]["name"] == "GetMultiVariables"]
    written = [item for one in found if one["function"]["name"] == "SetMultiVariables" for item in one["items"]]
    assert any(item["data"] is not None and struct.pack(">f", 21.5).hex() in item["data"] for item in written)
    assert any(struct.pack(">f", 21.5).hex() in (item["data"] or "") for one in reads for item in one["items"])
    assert sum(len(one["items"]) == 2 for one in reads) >= 1
    assert sum(bool(one["errors"]) for one in found) == 1  # what is not there
    # The capture tells the same as the relay did, and is whole.
    again = s7dissect("transactions", "-T", "jsonl", path)
    assert again.returncode == 0
    assert [json.loads(line)["function"] for line in again.stdout.splitlines()] == [one["function"] for one in found]


def test_what_the_partner_does_is_no_attack(tmp_path: Path, s7dissect: Command) -> None:
    """Requests count up, and sessions are its own: no finding of replay, of a session of others, of lost notifications."""
    path = tmp_path / "out.pcapng"
    with cpu() as port, proxy(port, "-w", path) as made:
        used(made.port)
        used(made.port)
        made.ended()
    findings = json.loads(s7dissect("analyze", "-T", "json", path).stdout)["findings"]
    assert findings["security.write"] == 2
    unwanted = {"security.replay", "security.session_reused", "s7plus.notifications_lost", "security.unauthenticated"}
    assert not unwanted & set(findings)
    assert not [slug for slug in findings if slug.startswith(("tpkt.", "cotp.", "stream.", "internal."))]


def test_in_tls_the_key_log_opens_every_record_while_it_runs_and_afterwards(tmp_path: Path, s7dissect: Command) -> None:
    path = tmp_path / "out.pcapng"
    with cpu_with_tls(tmp_path) as (port, keys), proxy(port, "-w", path, "-T", "jsonl", "--tls-keys", keys) as made:
        used(made.port, tls=True)
        code, lines, _ = made.ended()
    assert code == 0
    live = [one for one in map(json.loads, lines) if one.get("schema") == "s7dissect.transaction/1"]
    seen = [(one["function"]["name"], [item["data"] for item in one["items"]], len(one["errors"])) for one in live]
    assert [name for name, _, _ in seen][:2] == ["InitSSL", "CreateObject"]
    value = struct.pack(">f", 21.5).hex()
    reads = [data for name, data, _ in seen if name == "GetMultiVariables"]
    assert any(value in (data or "") for data in reads[0])  # what the client read alone
    assert [(data or "")[-8:] for data in reads[1]] == [value, "00000000"]  # and two together
    assert sum(errors for _, _, errors in seen) == 1  # what is not there
    report = json.loads(s7dissect("analyze", "-T", "json", "--tls-keys", keys, path).stdout)
    assert report["tls"]["sessions"] == report["tls"]["decrypted"] == 1
    assert report["tls"]["records_closed"] == 0
    assert report["tls"]["records_opened"] > 20
    assert not {"session.tls_closed", "security.clear_text", "security.unauthenticated"} & set(report["findings"])
    again = s7dissect("transactions", "-T", "jsonl", "--tls-keys", keys, path).stdout.splitlines()
    assert [(one["function"], one["items"]) for one in map(json.loads, again)] == [
        (one["function"], one["items"]) for one in live
    ]
    closed = s7dissect("transactions", "-T", "jsonl", path).stdout.splitlines()
    assert [json.loads(line)["function"]["name"] for line in closed] == ["InitSSL"]
