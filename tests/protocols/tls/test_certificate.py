"""Certificates: what they say, judged at a given time, and those that are damaged."""

from __future__ import annotations

import builtins
import warnings
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec, ed25519
from hypothesis import given, settings
from hypothesis import strategies as st

from dissect.protocols.tls.certificate import MAX_CERTIFICATE, read_certificate
from tests.protocols.tls.talks import THEN, YEAR, certificate, der, ec_key, named, rsa_key

THEN_NS = int(THEN.timestamp()) * 1_000_000_000
YEAR_NS = 365 * 86400 * 1_000_000_000
PLC = der(certificate(ec_key()))


def test_a_self_signed_certificate() -> None:
    found = read_certificate(PLC)
    assert (found.subject, found.issuer) == ("C=DE,CN=PLC_1/Communication", "C=DE,CN=PLC_1/Communication")
    assert (found.key, found.signature, found.self_signed) == ("EC secp256r1", "sha256", True)
    assert (found.weak, found.unread) == ([], "")
    assert (found.not_before_ns, found.not_after_ns) == (THEN_NS - YEAR_NS, THEN_NS + 30 * YEAR_NS)
    assert len(found.sha256) == 64


def test_its_validity_at_a_time() -> None:
    found = read_certificate(PLC)
    assert found.validity_fault(THEN_NS) == ""
    assert found.validity_fault(THEN_NS - 2 * YEAR_NS) == "not valid before 2019-09-14 00:00 UTC"
    assert found.validity_fault(THEN_NS + 31 * YEAR_NS) == "expired 2050-09-06 00:00 UTC"
    assert read_certificate(b"").validity_fault(THEN_NS) == ""


def test_one_that_another_signed() -> None:
    found = read_certificate(der(certificate(rsa_key(), issuer="Plant CA", signer=ec_key())))
    assert (found.issuer, found.self_signed, found.key) == ("C=DE,CN=Plant CA", False, "RSA 2048 bits")


def test_one_that_only_claims_to_have_signed_itself() -> None:
    found = read_certificate(der(certificate(rsa_key(), signer=rsa_key(1024))))
    assert found.subject == found.issuer
    assert found.self_signed is False
    assert read_certificate(der(certificate(rsa_key(), signer=ec_key()))).self_signed is None


def test_weak_keys() -> None:
    assert read_certificate(der(certificate(rsa_key(1024)))).weak == ["a key of 1024 bits (RSA)"]
    small = ec.generate_private_key(ec.SECP192R1())
    assert read_certificate(der(certificate(small))).weak == ["a key of 192 bits (EC secp192r1)"]


def test_a_weak_signature() -> None:
    """SHA-256 with RSA (…01 01 0b) said to be SHA-1 with RSA (…01 01 05) at both places."""
    octets = der(certificate(rsa_key()))
    sha256, sha1 = bytes.fromhex("2a864886f70d01010b"), bytes.fromhex("2a864886f70d010105")
    assert octets.count(sha256) == 2
    found = read_certificate(octets.replace(sha256, sha1))
    assert (found.weak, found.signature) == (["signed with sha1"], "sha1")


def test_an_algorithm_without_a_hash() -> None:
    key = ed25519.Ed25519PrivateKey.generate()
    builder = x509.CertificateBuilder(named("x"), named("x"), key.public_key(), 1, THEN, THEN + YEAR)
    found = read_certificate(builder.sign(key, None).public_bytes(serialization.Encoding.DER))
    assert (found.key, found.signature, found.self_signed) == ("Ed25519", "1.3.101.112", True)


def test_names_are_safe_to_show() -> None:
    found = read_certificate(der(certificate(ec_key(), "PLC\x1b[31m\u202e")))
    assert found.subject == "C=DE,CN=PLC\\x1b[31m\\u202e"


def test_without_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("cryptography"):
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    found = read_certificate(PLC)
    assert found.unread == "reading certificates needs the package cryptography: pip install 's7dissect[tls]'"
    assert len(found.sha256) == 64


def test_one_that_is_too_long() -> None:
    assert read_certificate(bytes(MAX_CERTIFICATE + 1)).unread == "65537 bytes, more than are read of one"


@settings(max_examples=300)
@given(st.data())
def test_damaged_ones_never_raise(data: st.DataObject) -> None:
    octets = bytearray(PLC)
    for _ in range(data.draw(st.integers(1, 4))):
        octets[data.draw(st.integers(0, len(octets) - 1))] = data.draw(st.integers(0, 255))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = read_certificate(bytes(octets[: data.draw(st.integers(0, len(octets)))]))
    assert found.unread or found.subject or found.issuer or found.not_after_ns is not None


@given(st.binary(max_size=200))
def test_anything_may_be_sent_for_one(octets: bytes) -> None:
    assert read_certificate(octets).unread.startswith("damaged: ")
