"""Replacements for texts and values: of the same length and character classes, equal for equal originals."""

from __future__ import annotations

from typing import Final

from dissect.files.anonymize.key import Key
from dissect.protocols.iso.tsap import Tsap

_PADDING: Final = b" \0"
_UPPER: Final = b"ABCDEFGHIJKLMNOPQRSTUVWXYZ"
_LOWER: Final = _UPPER.lower()
_DIGITS: Final = b"0123456789"
#: TSAPs that all devices of a kind have, and common beginnings of others.
_WELL_KNOWN_TSAPS: Final = frozenset((b"SIMATIC-ROOT-ES", b"SIMATIC-ROOT-HMI", b"SIMATIC-ROOT-OTHER"))
_ROOT: Final = b"SIMATIC-ROOT-"


def replace_text(key: Key, octets: bytes) -> bytes:
    """Return the replacement for a text: letters for letters, digits for digits; blanks and zeros around it stay.

    Other characters between letters and digits stay, so that a path remains a path; a text without letters and digits gets
    letters.
    """
    start = len(octets) - len(octets.lstrip(_PADDING))
    core = octets.strip(_PADDING)
    if not core:
        return octets
    plain = any(_alphabet(octet) for octet in core)
    new = core
    for attempt in range(256):
        drawn = key.stream(f"text{attempt}", core, len(core))
        new = bytes([_drawn(octet, drawn[at], _alphabet(octet) if plain else _UPPER) for at, octet in enumerate(core)])
        if new != core:  # for a text of one or two characters the original may come up again
            break
    return octets[:start] + new + octets[start + len(core) :]


def replace_path(key: Key, octets: bytes) -> bytes:
    """Return the replacement for a path: each name between slashes is replaced separately."""
    return b"/".join([replace_text(key, name) for name in octets.split(b"/")])


def replace_tsap(key: Key, octets: bytes) -> bytes:
    """Return the replacement for a TSAP; one that consists of connection type, rack and slot stays."""
    tsap = Tsap(octets)
    if tsap.connection_type >= 0 or not octets or octets in _WELL_KNOWN_TSAPS:
        return octets
    if octets.startswith(_ROOT):
        return _ROOT + replace_text(key, octets[len(_ROOT) :])
    if all(octet >= 0x20 or octet == 0 for octet in octets):
        return replace_text(key, octets)
    return replace_octets(key, octets)


def replace_octets(key: Key, octets: bytes) -> bytes:
    """Return pseudorandom replacement octets, equal for equal originals."""
    return key.stream("octets", octets, len(octets))


def replace_bit(key: Key, octets: bytes) -> bytes:
    """Return the replacement for a bit, the lowest bit of the octets."""
    return octets[:-1] + bytes((octets[-1] ^ (key.stream("bit", b"", 1)[0] & 1),)) if octets else octets


def _alphabet(octet: int) -> bytes:
    """Return the characters that may replace one, empty if it stays."""
    if octet in _DIGITS:
        return _DIGITS
    if octet in _LOWER:
        return _LOWER
    return _UPPER if octet in _UPPER or octet >= 0x80 else b""


def _drawn(octet: int, number: int, alphabet: bytes) -> int:
    return alphabet[number % len(alphabet)] if alphabet else octet
