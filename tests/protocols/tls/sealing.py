"""TLS 1.3 built by hand, for cases that Python's `ssl` cannot produce: any suite, key updates, early data, damage.

The keys are derived with `cryptography`, independently of the product.
"""

from __future__ import annotations

from typing import Final

from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.ciphers.aead import AESCCM, AESGCM, ChaCha20Poly1305
from cryptography.hazmat.primitives.kdf.hkdf import HKDFExpand

RANDOM: Final = bytes(range(32))
FINISHED: Final = b"\x14\x00\x00\x20" + bytes(32)
KEY_UPDATE: Final = b"\x18\x00\x00\x01\x00"
END_OF_EARLY_DATA: Final = b"\x05\x00\x00\x00"

HANDSHAKE, ALERT, DATA = 22, 21, 23

LABELS: Final = {
    (0, 0): "CLIENT_EARLY_TRAFFIC_SECRET",
    (0, 1): "CLIENT_HANDSHAKE_TRAFFIC_SECRET",
    (1, 1): "SERVER_HANDSHAKE_TRAFFIC_SECRET",
    (0, 2): "CLIENT_TRAFFIC_SECRET_0",
    (1, 2): "SERVER_TRAFFIC_SECRET_0",
}


def message(type_: int, body: bytes) -> bytes:
    return bytes((type_,)) + len(body).to_bytes(3, "big") + body


def record(kind: int, body: bytes) -> bytes:
    return bytes((kind, 3, 3)) + len(body).to_bytes(2, "big") + body


def extension(kind: int, body: bytes) -> bytes:
    return kind.to_bytes(2, "big") + len(body).to_bytes(2, "big") + body


def client_hello(suite: int = 0x1301, name: bytes = b"plc", early: bool = False, random: bytes = RANDOM) -> bytes:
    listed = b"\x00" + len(name).to_bytes(2, "big") + name
    extensions = extension(0, len(listed).to_bytes(2, "big") + listed) + extension(43, b"\x02\x03\x04")
    if early:
        extensions += extension(42, b"")
    body = b"\x03\x03" + random + b"\x00" + b"\x00\x02" + suite.to_bytes(2, "big") + b"\x01\x00"
    return record(HANDSHAKE, message(1, body + len(extensions).to_bytes(2, "big") + extensions))


def server_hello(suite: int = 0x1301, random: bytes = bytes(32)) -> bytes:
    extensions = extension(43, b"\x03\x04")
    body = b"\x03\x03" + random + b"\x00" + suite.to_bytes(2, "big") + b"\x00"
    return record(HANDSHAKE, message(2, body + len(extensions).to_bytes(2, "big") + extensions))


class Sealer:
    """Encrypts the data of one side, stage after stage: 0 early data, 1 handshake, 2 traffic."""

    def __init__(self, side: int, suite: int = 0x1301, stage: int = 1) -> None:
        self.side = side
        self.suite = suite
        self._hash: hashes.HashAlgorithm = hashes.SHA384() if suite == 0x1302 else hashes.SHA256()
        self.stage = stage
        self._secret = b""
        self.number = 0
        self.enter(stage)

    def secret(self, stage: int) -> bytes:
        return bytes((self.side * 16 + stage,)) * self._hash.digest_size

    def enter(self, stage: int) -> None:
        self.stage = stage
        self._secret = self.secret(stage)
        self.number = 0

    def update(self) -> None:
        self._secret = self._derive(b"traffic upd", self._hash.digest_size)
        self.number = 0

    def _derive(self, label: bytes, size: int) -> bytes:
        name = b"tls13 " + label
        info = size.to_bytes(2, "big") + bytes((len(name),)) + name + b"\x00"
        return HKDFExpand(self._hash, size, info).derive(self._secret)

    def seal(self, content: bytes, kind: int = DATA, padding: int = 0) -> bytes:
        size = 16 if self.suite in {0x1301, 0x1304, 0x1305} else 32
        key, iv = self._derive(b"key", size), self._derive(b"iv", 12)
        nonce = (int.from_bytes(iv, "big") ^ self.number).to_bytes(12, "big")
        self.number += 1
        cipher: AESGCM | AESCCM | ChaCha20Poly1305
        tag = 8 if self.suite == 0x1305 else 16
        if self.suite in {0x1304, 0x1305}:
            cipher = AESCCM(key, tag_length=tag)
        else:
            cipher = ChaCha20Poly1305(key) if self.suite == 0x1303 else AESGCM(key)
        plain = content + bytes((kind,)) + bytes(padding)
        head = b"\x17\x03\x03" + (len(plain) + tag).to_bytes(2, "big")
        return head + cipher.encrypt(nonce, plain, head)


def key_log(*sealers: Sealer, without: tuple[str, ...] = ()) -> bytes:
    lines = [
        f"{LABELS[sealer.side, stage]} {RANDOM.hex()} {sealer.secret(stage).hex()}"
        for sealer in sealers
        for stage in (0, 1, 2)
        if (sealer.side, stage) in LABELS and LABELS[sealer.side, stage] not in without
    ]
    return "\n".join([*lines, ""]).encode()


class Pair:
    """Both sides after their handshake; ``begun`` is the handshake data, pairs of side and octets."""

    def __init__(self, suite: int = 0x1301) -> None:
        self.ends = (Sealer(0, suite), Sealer(1, suite))
        client, server = self.ends
        self.begun = [
            (0, client_hello(suite)),
            (1, server_hello(suite) + record(20, b"\x01")),
            (1, server.seal(FINISHED, HANDSHAKE)),
            (0, record(20, b"\x01") + client.seal(FINISHED, HANDSHAKE)),
        ]
        client.enter(2)
        server.enter(2)

    def keys(self, *without: str) -> bytes:
        return key_log(*self.ends, without=without)
