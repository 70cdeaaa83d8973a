"""Keys out of secrets, held against RFC 8448 section 3 and against `cryptography`."""

from __future__ import annotations

import pytest
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.kdf.hkdf import HKDFExpand

from dissect.protocols.tls.key_schedule import expand_label, key_block, next_secret, prf, traffic_keys
from dissect.protocols.tls.tables import CIPHER_SUITES, suite_of

CLIENT_SECRET = bytes.fromhex("9e40646ce79a7f9dc05af8889bce6552875afa0b06df0087f792ebb7c17504a5")
SERVER_SECRET = bytes.fromhex("a11af9f05531f856ad47116b45a950328204b4f44bfb6b3a4b4f1f3fcb631643")


@pytest.mark.parametrize(
    ("secret", "key", "iv"),
    [
        (CLIENT_SECRET, "17422dda596ed5d9acd890e3c63f5051", "5b78923dee08579033e523d9"),
        (SERVER_SECRET, "9f02283b6c9c07efc26bb9f2ac92e356", "cf782b88dd83549aadf1e984"),
    ],
)
def test_the_keys_of_rfc_8448(secret: bytes, key: str, iv: str) -> None:
    suite = suite_of(0x1301)
    assert suite is not None
    keys = traffic_keys(suite, secret)
    assert (keys.key.hex(), keys.iv.hex()) == (key, iv)


@pytest.mark.parametrize(
    ("name", "algorithm", "size"), [("sha256", hashes.SHA256(), 32), ("sha384", hashes.SHA384(), 48)]
)
@pytest.mark.parametrize("length", [1, 12, 16, 32, 48, 255])
def test_expand_label_is_that_of_cryptography(
    name: str, algorithm: hashes.HashAlgorithm, size: int, length: int
) -> None:
    secret = bytes(range(size))
    info = length.to_bytes(2, "big") + b"\x11tls13 traffic upd\x00"
    assert expand_label(name, secret, b"traffic upd", length) == HKDFExpand(algorithm, length, info).derive(secret)


def test_the_next_secret_has_the_size_of_the_hash() -> None:
    for code, size in ((0x1301, 32), (0x1302, 48)):
        suite = suite_of(code)
        assert suite is not None
        assert len(next_secret(suite, bytes(size))) == size


def test_the_prf_of_tls_1_2() -> None:
    """The vector for SHA-256 that was published on the TLS mailing list when RFC 5246 was new."""
    secret = bytes.fromhex("9bbe436ba940f017b17652849a71db35")
    seed = bytes.fromhex("a0ba9f936cda311827a6f796ffd5198c")
    wanted = (
        "e3f229ba727be17b8d122620557cd453c2aab21d07c3d495329b52d4e61edb5a6b301791e90d35c9c9a46b4e14baf9af"
        "0fa022f7077def17abfd3797c0564bab4fbc91666e9def9b97fce34f796789baa48082d122ee42c5a72e5a5110fff701"
        "87347b66"
    )
    assert prf("sha256", secret, b"test label", seed, 100).hex() == wanted


@pytest.mark.parametrize(("code", "key", "salt"), [(0xC02F, 16, 4), (0xC030, 32, 4), (0xCCA8, 32, 12), (0xC0AC, 16, 4)])
def test_the_key_block_is_cut_as_the_suite_says(code: int, key: int, salt: int) -> None:
    suite = suite_of(code)
    assert suite is not None
    client, server = key_block(suite, bytes(48), b"c" * 32, b"s" * 32)
    block = prf(suite.hash, bytes(48), b"key expansion", b"s" * 32 + b"c" * 32, 2 * (key + salt))
    assert client.key + server.key + client.iv + server.iv == block
    assert (len(client.key), len(server.iv)) == (key, salt)


@pytest.mark.parametrize(
    ("code", "made"),
    [
        (0x1301, ("GCM", 16, "sha256", 16)),
        (0x1302, ("GCM", 32, "sha384", 16)),
        (0x1303, ("ChaCha20-Poly1305", 32, "sha256", 16)),
        (0x1304, ("CCM", 16, "sha256", 16)),
        (0x1305, ("CCM", 16, "sha256", 8)),
        (0x009D, ("GCM", 32, "sha384", 16)),
        (0xC0A1, ("CCM", 32, "sha256", 8)),
        (0xC0AB, ("CCM", 32, "sha256", 8)),
        (0xCCA9, ("ChaCha20-Poly1305", 32, "sha256", 16)),
    ],
)
def test_what_a_suite_is_made_of(code: int, made: tuple[str, int, str, int]) -> None:
    suite = suite_of(code)
    assert suite is not None
    assert (suite.kind, suite.key, suite.hash, suite.tag) == made


def test_what_is_no_aead_has_no_suite() -> None:
    for code in CIPHER_SUITES.names():
        name = CIPHER_SUITES.name(code)
        aead = any(word in name.split("_") for word in ("GCM", "CCM", "CHACHA20"))
        assert (suite_of(code) is not None) == aead, name
    assert suite_of(0xFAFA) is None
