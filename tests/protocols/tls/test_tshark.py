"""The same key log given to tshark: it opens the same records. It knows no TLS inside COTP, so that this is about bare TCP."""

from __future__ import annotations

import shutil
import ssl
import subprocess
from pathlib import Path
from typing import Any

import pytest

from dissect.protocols.tls.session import TlsSession
from tests.engine.transactions.talk import Talk
from tests.protocols.tls.files import Film
from tests.protocols.tls.sealing import HANDSHAKE, KEY_UPDATE, Pair
from tests.protocols.tls.talks import Wire, ec_key, rsa_key, wire
from tests.protocols.tls.test_session import ring

SAID = [(0, b"one"), (1, b"two" * 6000), (0, b"three"), (1, bytes(range(200)))]
V2, V3 = ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3


def tshark_opens(folder: Path, found: Wire) -> list[bytes]:
    """Return the decrypted application data of each record, as tshark has it."""
    tshark = shutil.which("tshark")
    if tshark is None:
        pytest.skip("no tshark")
    path, keys = folder / "plain.pcapng", folder / "keys.log"
    keys.write_bytes(found.key_log)
    talk = Talk(50000, 443)
    film: Any = Film(path)
    talk.pipeline = film
    talk.hello()
    for side, octets in found.flights:
        for at in range(0, len(octets), 1400):
            talk.packet(side, octets[at : at + 1400])
    talk.close()
    ran = subprocess.run(
        [tshark, "-r", path, "-o", f"tls.keylog_file:{keys}", "-q", "-z", "follow,tls,raw,0"],
        capture_output=True, text=True, check=True, timeout=120,
    )  # fmt: skip
    lines = ran.stdout.split("Node 1: ", 1)[1].splitlines()[1:]
    return [bytes.fromhex(line) for line in lines if not line.startswith("=")]


def we_open(found: Wire) -> list[bytes]:
    session = TlsSession(ring(found.key_log))
    contents = [one for side, octets in found.flights for one in session.feed(side, octets, 1, 1)]
    assert session.shut == 0
    return [one.octets for one in contents]


def by_hand() -> Wire:
    """TLS 1.3 with key updates and padding."""
    pair = Pair(0x1303)
    client, server = pair.ends
    flights = [*pair.begun, (0, client.seal(b"one", padding=9)), (0, client.seal(KEY_UPDATE, HANDSHAKE))]
    client.update()
    flights += [(0, client.seal(b"two")), (1, server.seal(b"answer"))]
    return Wire(flights, pair.keys())


@pytest.mark.parametrize(
    "found",
    [
        lambda: wire(SAID, V3),
        lambda: wire(SAID, V2, "ECDHE-RSA-AES128-GCM-SHA256"),
        lambda: wire(SAID, V2, "ECDHE-RSA-AES256-GCM-SHA384", rsa_key()),
        lambda: wire(SAID, V2, "ECDHE-RSA-CHACHA20-POLY1305"),
        lambda: wire(SAID, V2, "ECDHE-ECDSA-AES128-CCM", ec_key()),
        by_hand,
    ],
    ids=["1.3", "gcm 128", "gcm 256", "chacha20", "ccm", "key updates"],
)
def test_tshark_opens_the_same(tmp_path: Path, found: Any) -> None:
    spoken = found()
    assert tshark_opens(tmp_path, spoken) == we_open(spoken) != []
