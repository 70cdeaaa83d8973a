"""Decrypts records. The ciphers are those of `cryptography` (extra ``tls``), which is imported with the first key."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from dissect.protocols.tls.key_schedule import Keys
from dissect.protocols.tls.tables import CCM, CHACHA20, Suite

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.ciphers.aead import AESCCM, AESGCM, ChaCha20Poly1305

#: What to install if there are keys but no ciphers.
NEEDS: Final = "needs the package cryptography: pip install 's7dissect[tls]'"


def is_installed() -> bool:
    """Return whether the ciphers are installed."""
    try:
        import cryptography.hazmat.primitives.ciphers.aead  # noqa: F401 - only asked for
    except ImportError:
        return False
    return True


class Opener:
    """Decrypts the records of one direction with one key. Raises ImportError if `cryptography` is not installed."""

    __slots__ = ("_cipher", "_invalid", "_iv", "_suite")

    def __init__(self, suite: Suite, keys: Keys) -> None:
        from cryptography.exceptions import InvalidTag

        self._suite = suite
        self._iv = keys.iv
        self._cipher = _cipher(suite, keys.key)
        self._invalid = InvalidTag

    def open_1_3(self, record: bytes, number: int) -> bytes | None:
        """Return content, type and padding of a TLS 1.3 record; None if the key or ``number`` is wrong."""
        return self._open(self._mixed(number), record[5:], record[:5])

    def open_1_2(self, record: bytes, number: int) -> bytes | None:
        """Return the content of a TLS 1.2 record; None if the key or ``number`` is wrong."""
        explicit = self._suite.explicit
        size = len(record) - 5 - explicit - self._suite.tag
        if size < 0:
            return None
        nonce = self._iv + record[5 : 5 + explicit] if explicit else self._mixed(number)
        head = number.to_bytes(8, "big") + record[:3] + size.to_bytes(2, "big")
        return self._open(nonce, record[5 + explicit :], head)

    def _mixed(self, number: int) -> bytes:
        return (int.from_bytes(self._iv, "big") ^ number).to_bytes(12, "big")

    def _open(self, nonce: bytes, sealed: bytes, about: bytes) -> bytes | None:
        if len(sealed) < self._suite.tag:
            return None
        try:
            return self._cipher.decrypt(nonce, sealed, about)
        except self._invalid:
            return None


def _cipher(suite: Suite, key: bytes) -> AESGCM | AESCCM | ChaCha20Poly1305:
    from cryptography.hazmat.primitives.ciphers import aead

    if suite.kind == CHACHA20:
        return aead.ChaCha20Poly1305(key)
    if suite.kind == CCM:
        return aead.AESCCM(key, tag_length=suite.tag)
    return aead.AESGCM(key)
