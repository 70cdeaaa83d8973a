"""The key for all replacements: with the same key, equal originals get equal replacements in every file."""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
from pathlib import Path
from typing import Final

#: Minimum size of a key file, and the most that is read of it.
MIN_KEY: Final = 16
MAX_KEY: Final = 65_536
_SIZE: Final = 32

_DAY_NS: Final = 86_400_000_000_000
#: The range of days from which `Key.shift_ns` chooses.
_SHIFT_DAYS: Final = 3650


class Key:
    """Generates pseudorandom octets for a purpose and some input; without the key they look random."""

    def __init__(self, secret: bytes) -> None:
        self._key = hashlib.sha256(secret).digest()

    def stream(self, purpose: str, octets: bytes, size: int) -> bytes:
        """Return ``size`` octets (HMAC-SHA-256 in counter mode) for ``octets``, different for each ``purpose``."""
        head = purpose.encode() + b"\0" + len(octets).to_bytes(4, "big") + octets
        blocks = range((size + _SIZE - 1) // _SIZE)
        whole = b"".join([hmac.digest(self._key, number.to_bytes(4, "big") + head, "sha256") for number in blocks])
        return whole[:size]

    @property
    def shift_ns(self) -> int:
        """Nanoseconds by which this key shifts times into the future: days, hours and fractions, at least one day."""
        drawn = int.from_bytes(self.stream("time", b"", 16), "big")
        return _DAY_NS + drawn % (_SHIFT_DAYS * _DAY_NS)


def random_key() -> Key:
    """Return a random key, which is not stored."""
    return Key(secrets.token_bytes(_SIZE))


def read_key(path: str | os.PathLike[str]) -> Key:
    """Return the key in a file: all of its octets count. Raises ValueError (for people) if there are too few or too many."""
    with Path(path).open("rb") as file:
        octets = file.read(MAX_KEY + 1)
    if len(octets) > MAX_KEY:
        raise ValueError(f"more than {MAX_KEY} bytes; a key is a small file")
    if len(octets) < MIN_KEY:
        raise ValueError(f"{len(octets)} bytes, a key needs {MIN_KEY} or more: head -c 32 /dev/urandom > {path}")
    return Key(octets)
