"""TLS made by OpenSSL in memory: both ends of Python's `ssl`, the exchanged data, and their key log."""

from __future__ import annotations

import datetime
import functools
import ipaddress
import ssl
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.x509.oid import NameOID

from tests.engine.transactions.talk import Talk, dt

CLIENT: Final = 0
SERVER: Final = 1

#: When the packets of a `tests.engine.transactions.talk.Talk` are captured (2020-09-13), when certificates are valid.
THEN: Final = datetime.datetime(2020, 9, 13, tzinfo=datetime.UTC)
YEAR: Final = datetime.timedelta(days=365)

Key = rsa.RSAPrivateKey | ec.EllipticCurvePrivateKey


@functools.cache
def rsa_key(bits: int = 2048) -> rsa.RSAPrivateKey:
    return rsa.generate_private_key(65537, bits)


@functools.cache
def ec_key() -> ec.EllipticCurvePrivateKey:
    return ec.generate_private_key(ec.SECP256R1())


def named(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name), x509.NameAttribute(NameOID.COUNTRY_NAME, "DE")])


def certificate(
    key: Key,
    subject: str = "PLC_1/Communication",
    issuer: str = "",
    signer: Key | None = None,
    begins: datetime.datetime = THEN - YEAR,
    ends: datetime.datetime = THEN + 30 * YEAR,
) -> x509.Certificate:
    """A certificate; without ``signer`` it is self-signed."""
    builder = x509.CertificateBuilder(
        issuer_name=named(issuer or subject),
        subject_name=named(subject),
        public_key=key.public_key(),
        serial_number=4711,
        not_valid_before=begins,
        not_valid_after=ends,
    ).add_extension(x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("10.0.0.2"))]), False)
    return builder.sign(signer or key, hashes.SHA256())


def der(made: x509.Certificate) -> bytes:
    return made.public_bytes(serialization.Encoding.DER)


@dataclass
class Wire:
    """The exchanged data: (side, octets) in order; ``key_log`` is what the client wrote."""

    flights: list[tuple[int, bytes]] = field(default_factory=list)
    key_log: bytes = b""
    suite: str = ""


def wire(
    said: list[tuple[int, bytes]],
    version: ssl.TLSVersion = ssl.TLSVersion.TLSv1_3,
    ciphers: str = "",
    key: Key | None = None,
    made: x509.Certificate | None = None,
    name: str | None = "plc.local",
) -> Wire:
    """Perform a handshake, then send ``said``, pairs of side and octets, each in its own record."""
    key = key or rsa_key()
    found = Wire()
    with tempfile.TemporaryDirectory() as folder:
        server_context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        path = Path(folder, "pem")
        private = key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
        path.write_bytes(private + (made or certificate(key)).public_bytes(serialization.Encoding.PEM))
        client_context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        client_context.check_hostname = False
        client_context.verify_mode = ssl.CERT_NONE
        client_context.keylog_filename = str(Path(folder, "keys"))
        for context in (server_context, client_context):
            context.minimum_version = context.maximum_version = version
            if ciphers:
                context.set_ciphers(ciphers)
        server_context.load_cert_chain(path)
        into = (ssl.MemoryBIO(), ssl.MemoryBIO())
        out = (ssl.MemoryBIO(), ssl.MemoryBIO())
        client = client_context.wrap_bio(into[0], out[0], server_hostname=name)
        server = server_context.wrap_bio(into[1], out[1], server_side=True)
        _run(_Tap(found, into, out), (client, server), said)
        found.key_log = Path(folder, "keys").read_bytes()
        cipher = client.cipher()
        assert cipher is not None
        found.suite = cipher[0]
    return found


def in_tls(talk: Talk, found: Wire) -> None:
    """A connection that carries TLS from its first message on."""
    talk.hello()
    talk.connect()
    for side, octets in found.flights:
        talk.packet(side, dt(octets))
    talk.close()


class _Tap:
    """Connects two ends: takes what one wrote, and gives it to the other."""

    def __init__(
        self, found: Wire, into: tuple[ssl.MemoryBIO, ssl.MemoryBIO], out: tuple[ssl.MemoryBIO, ssl.MemoryBIO]
    ) -> None:
        self._found = found
        self._into = into
        self._out = out

    def take(self, side: int) -> None:
        octets = self._out[side].read()
        if octets:
            self._found.flights.append((side, octets))
            self._into[1 - side].write(octets)


def _run(tap: _Tap, ends: tuple[ssl.SSLObject, ssl.SSLObject], said: list[tuple[int, bytes]]) -> None:
    done = [False, False]
    while not all(done):
        for side in (CLIENT, SERVER):
            if not done[side]:
                try:
                    ends[side].do_handshake()
                    done[side] = True
                except ssl.SSLWantReadError:
                    pass
                tap.take(side)
    for side, octets in said:
        ends[side].write(octets)
        tap.take(side)
        got = b""
        while len(got) < len(octets):
            got += ends[1 - side].read(len(octets) - len(got))
        assert got == octets
