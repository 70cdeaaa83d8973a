"""Owner, validity and weaknesses of a certificate (X.509, RFC 5280), read with `cryptography` (extra ``tls``).

Certificates come from the wire: if one is damaged, `Certificate.unread` is set, and its readable parts are kept.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final, TypeVar

from dissect.protocols.tls.aead import NEEDS
from dissect.wire.text import printable, shortened

if TYPE_CHECKING:
    from cryptography import x509

#: Size of the largest certificate that is read; maximum number of characters of a name that are shown.
MAX_CERTIFICATE: Final = 64 * 1024
MAX_NAME: Final = 200
#: Keys with fewer bits are obsolete (NIST SP 800-131A): of RSA and DSA, and of a curve.
_LEAST_RSA: Final = 2048
_LEAST_CURVE: Final = 224
_WEAK_HASHES: Final = frozenset(("md2", "md4", "md5", "sha1"))
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)

T = TypeVar("T")


class Certificate:
    """A certificate. Texts are printable, empty if they could not be read; then times are None.

    ``not_before_ns`` and ``not_after_ns`` are nanoseconds since 1970. ``weak`` lists its weaknesses. ``sha256`` is its
    fingerprint. ``unread`` says why it could not be read, completely or in part.
    """

    __slots__ = (
        "issuer",
        "key",
        "not_after_ns",
        "not_before_ns",
        "self_signed",
        "sha256",
        "signature",
        "subject",
        "unread",
        "weak",
    )

    def __init__(self) -> None:
        self.subject = ""
        self.issuer = ""
        self.not_before_ns: int | None = None
        self.not_after_ns: int | None = None
        self.self_signed: bool | None = None
        self.key = ""
        self.signature = ""
        self.weak: list[str] = []
        self.sha256 = ""
        self.unread = ""

    def validity_fault(self, time_ns: int) -> str:
        """Return the fault of the period of validity at ``time_ns``; empty if there is none, or it is unknown."""
        if self.not_after_ns is not None and time_ns > self.not_after_ns:
            return f"expired {_day(self.not_after_ns)}"
        if self.not_before_ns is not None and time_ns < self.not_before_ns:
            return f"not valid before {_day(self.not_before_ns)}"
        return ""


def _day(time_ns: int) -> str:
    return (_EPOCH + timedelta(microseconds=time_ns // 1000)).strftime("%Y-%m-%d %H:%M UTC")


def read_certificate(der: bytes) -> Certificate:
    """Read a certificate in DER. Never raises."""
    found = Certificate()
    found.sha256 = hashlib.sha256(der).hexdigest()
    if len(der) > MAX_CERTIFICATE:
        found.unread = f"{len(der)} bytes, more than are read of one"
        return found
    try:
        from cryptography import x509
    except ImportError:
        found.unread = f"reading certificates {NEEDS}"
        return found
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a fault of the certificate must not cause a warning about this program
        try:
            _read(found, x509.load_der_x509_certificate(der))
        except Exception as error:  # noqa: BLE001 - the library raises errors of many kinds about octets of the wire
            found.unread = f"damaged: {shortened(str(error) or type(error).__name__, MAX_NAME)}"
    return found


def _read(found: Certificate, certificate: x509.Certificate) -> None:
    found.subject = _tried(lambda: shortened(certificate.subject.rfc4514_string(), MAX_NAME), "")
    found.issuer = _tried(lambda: shortened(certificate.issuer.rfc4514_string(), MAX_NAME), "")
    found.not_before_ns = _tried(lambda: _nanoseconds(certificate.not_valid_before_utc), None)
    found.not_after_ns = _tried(lambda: _nanoseconds(certificate.not_valid_after_utc), None)
    found.self_signed = _tried(lambda: _is_self_signed(certificate), None)
    found.signature = _tried(lambda: _signature(certificate), "")
    if found.signature in _WEAK_HASHES:
        found.weak.append(f"signed with {found.signature}")
    _tried(lambda: _key(found, certificate), None)
    if not (found.subject or found.issuer or found.not_after_ns is not None):
        found.unread = "damaged: neither its names nor its validity can be read"


def _tried(part: Callable[[], T], otherwise: T) -> T:
    """Return the result of ``part``, or ``otherwise`` if that part of the certificate is damaged."""
    try:
        return part()
    except Exception:  # noqa: BLE001 - as above; the other parts are read nevertheless
        return otherwise


def _nanoseconds(time: datetime) -> int:
    return (time - _EPOCH) // timedelta(microseconds=1) * 1000


def _is_self_signed(certificate: x509.Certificate) -> bool | None:
    """Return whether it is signed with its own key; None if it claims to be, but that cannot be verified."""
    from cryptography.exceptions import InvalidSignature

    if certificate.subject != certificate.issuer:
        return False
    try:
        certificate.verify_directly_issued_by(certificate)
    except InvalidSignature:
        return False
    except (TypeError, ValueError):
        return None
    return True


def _signature(certificate: x509.Certificate) -> str:
    """Return the name of the signature's hash, or the algorithm if that has none (Ed25519)."""
    hash_ = certificate.signature_hash_algorithm
    return printable(hash_.name) if hash_ is not None else certificate.signature_algorithm_oid.dotted_string


def _key(found: Certificate, certificate: x509.Certificate) -> None:
    from cryptography.hazmat.primitives.asymmetric import dsa, ec, rsa

    key = certificate.public_key()
    if isinstance(key, (rsa.RSAPublicKey, dsa.DSAPublicKey)):
        kind = "RSA" if isinstance(key, rsa.RSAPublicKey) else "DSA"
        found.key = f"{kind} {key.key_size} bits"
        if key.key_size < _LEAST_RSA:
            found.weak.append(f"a key of {key.key_size} bits ({kind})")
    elif isinstance(key, ec.EllipticCurvePublicKey):
        found.key = f"EC {printable(key.curve.name)}"
        if key.curve.key_size < _LEAST_CURVE:
            found.weak.append(f"a key of {key.curve.key_size} bits ({found.key})")
    else:
        found.key = type(key).__name__.removesuffix("PublicKey").lstrip("_")
