"""Old versions, certificates at the time of the capture, keys that do not open: what is said, and when nothing is."""

from __future__ import annotations

import datetime
import ssl

import pytest

from tests.engine.transactions.talk import Talk
from tests.protocols.tls import sealing
from tests.protocols.tls.talks import THEN, Wire, certificate, ec_key, in_tls, rsa_key, wire

DAY = datetime.timedelta(days=1)
TLS_1_2 = ssl.TLSVersion.TLSv1_2


def said(found: Wire, key_log: bytes | None = None) -> list[tuple[str, str]]:
    talk = Talk()
    if key_log is not None:
        talk.unlock(key_log)
    in_tls(talk, found)
    beside = {"session.foreign_on_102", "cotp.size_exceeded"}
    return [(one.slug, one.detail) for one in talk.findings if one.slug not in beside]


def chosen(version: int, suite: int) -> Wire:
    """A server that chooses so."""
    body = version.to_bytes(2, "big") + bytes(32) + b"\x00" + suite.to_bytes(2, "big") + b"\x00"
    return Wire([(1, sealing.record(22, sealing.message(2, body)))])


@pytest.mark.parametrize(
    ("version", "suite", "detail"),
    [
        (0x0300, 0x002F, "SSL 3.0 with TLS_RSA_WITH_AES_128_CBC_SHA"),
        (0x0301, 0xC02F, "TLS 1.0 with TLS_ECDHE_RSA_WITH_AES_128_GCM_SHA256"),
        (0x0302, 0x1234, "TLS 1.1 with 0x1234"),
        (0x0303, 0x0005, "TLS 1.2 with TLS_RSA_WITH_RC4_128_SHA"),
        (0x0303, 0x003B, "TLS 1.2 with TLS_RSA_WITH_NULL_SHA256"),
        (0x0303, 0x00A6, "TLS 1.2 with TLS_DH_anon_WITH_AES_128_GCM_SHA256"),
        (0x0303, 0x000A, "TLS 1.2 with TLS_RSA_WITH_3DES_EDE_CBC_SHA"),
    ],
)
def test_what_protects_no_longer(version: int, suite: int, detail: str) -> None:
    assert said(chosen(version, suite)) == [("security.tls_weak", detail)]


@pytest.mark.parametrize(("version", "suite"), [(0x0303, 0xC02F), (0x0303, 0x002F), (0x0304, 0x1301)])
def test_what_protects(version: int, suite: int) -> None:
    assert said(chosen(version, suite)) == []


@pytest.mark.parametrize(
    ("begins", "ends", "fault"),
    [
        (THEN - 2 * DAY, THEN - DAY, "expired 2020-09-12 00:00 UTC"),
        (THEN + DAY, THEN + 2 * DAY, "not valid before 2020-09-14 00:00 UTC"),
        (THEN - DAY, THEN + DAY, ""),
    ],
)
@pytest.mark.parametrize("version", [TLS_1_2, ssl.TLSVersion.TLSv1_3])
def test_validity_at_the_time_of_the_capture(
    version: ssl.TLSVersion, begins: datetime.datetime, ends: datetime.datetime, fault: str
) -> None:
    """Long past today, all of them: what counts is when it was shown. In TLS 1.3 it is known where the keys are."""
    found = wire([], version, key=ec_key(), made=certificate(ec_key(), begins=begins, ends=ends))
    detail = f"server 10.0.0.2:102, C=DE,CN=PLC_1/Communication: {fault}"
    assert said(found, found.key_log) == ([("security.certificate_expired", detail)] if fault else [])
    assert len(said(found)) == (1 if fault and version == TLS_1_2 else 0)


def test_a_weak_key() -> None:
    found = wire([], TLS_1_2, "ECDHE+AESGCM:@SECLEVEL=0", rsa_key(1024))
    detail = "server 10.0.0.2:102, C=DE,CN=PLC_1/Communication: a key of 1024 bits (RSA)"
    assert said(found) == [("security.certificate_weak", detail)]
    assert said(wire([], TLS_1_2, key=rsa_key(2048))) == []


def test_why_records_stay_closed_is_said_once() -> None:
    found, other = wire([(0, b"x"), (1, b"y")]), wire([])
    (finding,) = said(found, other.key_log)
    assert finding[0] == "session.tls_closed"
    assert finding[1].endswith(" encrypted records stay closed: the key log holds only keys of 1 other session")
    assert said(found) == []
    assert said(found, found.key_log) == []


def test_half_a_key_log_blames_neither_the_capture_nor_the_device() -> None:
    """What the other direction said stays encrypted: the transactions that lack it say so."""
    request = bytes.fromhex("72010012310000058600000007000000003000000000") + bytes.fromhex("72010000")
    answer = bytes.fromhex("7201000f320000058600000007000000000000") + bytes.fromhex("72010000")
    found = wire([(0, request), (1, answer)])
    for closed, slug, detail in (
        (b"CLIENT", "transaction.orphan", "reference 0x0007; the request stays encrypted"),
        (b"SERVER", "transaction.unanswered", "the answer, if there was one, stays encrypted"),
    ):
        half = b"\n".join([line for line in found.key_log.splitlines() if not line.startswith(closed)])
        details = dict(said(found, half))
        assert details[slug].endswith(detail), details
    assert {slug for slug, _ in said(found, found.key_log)}.isdisjoint({"transaction.orphan", "transaction.unanswered"})
