"""Derives keys from secrets: HKDF-Expand-Label of TLS 1.3 (RFC 8446 section 7), PRF of TLS 1.2 (RFC 5246 section 5)."""

from __future__ import annotations

import hashlib
import hmac

from dissect.protocols.tls.tables import Suite


class Keys:
    """The key of the records of one direction, with the ``iv`` (TLS 1.3) or salt (1.2) for their nonces."""

    __slots__ = ("iv", "key")

    def __init__(self, key: bytes, iv: bytes) -> None:
        self.key = key
        self.iv = iv


def expand_label(hash_: str, secret: bytes, label: bytes, size: int) -> bytes:
    """Return HKDF-Expand-Label(secret, label, "", size), with a hash that `hashlib` knows."""
    name = b"tls13 " + label
    info = size.to_bytes(2, "big") + bytes((len(name),)) + name + b"\0"
    made = b""
    block = b""
    while len(made) < size:
        block = hmac.digest(secret, block + info + bytes((len(made) // hashlib.new(hash_).digest_size + 1,)), hash_)
        made += block
    return made[:size]


def traffic_keys(suite: Suite, secret: bytes) -> Keys:
    """Return the keys for a traffic secret of TLS 1.3."""
    key = expand_label(suite.hash, secret, b"key", suite.key)
    return Keys(key, expand_label(suite.hash, secret, b"iv", 12))


def next_secret(suite: Suite, secret: bytes) -> bytes:
    """Return the traffic secret after ``secret`` and a KeyUpdate."""
    return expand_label(suite.hash, secret, b"traffic upd", hashlib.new(suite.hash).digest_size)


class TrafficSecrets:
    """The traffic secrets of one direction; each KeyUpdate derives the next one.

    The latest one and the previous one are kept, because `Direction` tries whether a KeyUpdate was missed.
    """

    __slots__ = ("_before", "_first", "_latest", "_steps", "_suite")

    def __init__(self) -> None:
        self._suite: Suite | None = None
        self._first = b""
        self._before = b""
        self._latest = b""
        self._steps = 0  # from the first to the latest

    def after(self, suite: Suite, first: bytes, updates: int) -> bytes:
        """Return the secret after ``first`` and ``updates`` KeyUpdates."""
        if first != self._first or suite is not self._suite or updates < self._steps - 1:
            self._suite = suite
            self._first = first
            self._before = first
            self._latest = first
            self._steps = 0
        while self._steps < updates:
            self._before = self._latest
            self._latest = next_secret(suite, self._latest)
            self._steps += 1
        return self._latest if updates == self._steps else self._before

    def forget(self) -> None:
        """Drop all secrets."""
        self._first = b""
        self._before = b""
        self._latest = b""
        self._steps = 0
        self._suite = None


def prf(hash_: str, secret: bytes, label: bytes, seed: bytes, size: int) -> bytes:
    """Return ``size`` octets of the TLS 1.2 PRF."""
    seed = label + seed
    made = b""
    chained = seed
    while len(made) < size:
        chained = hmac.digest(secret, chained, hash_)
        made += hmac.digest(secret, chained + seed, hash_)
    return made[:size]


def key_block(suite: Suite, master: bytes, client_random: bytes, server_random: bytes) -> tuple[Keys, Keys]:
    """Return the keys of client and server for an AEAD suite and a master secret of TLS 1.2."""
    key, salt = suite.key, suite.salt
    block = prf(suite.hash, master, b"key expansion", server_random + client_random, 2 * (key + salt))
    client = Keys(block[:key], block[2 * key : 2 * key + salt])
    return client, Keys(block[key : 2 * key], block[2 * key + salt :])
