"""Sessions: what OpenSSL says to itself is opened; what is missing, wrong or damaged is counted and explained."""

from __future__ import annotations

import hashlib
import hmac
import ssl
from collections.abc import Iterable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dissect.protocols.tls import session as sessions
from dissect.protocols.tls.direction import MAX_MISSES
from dissect.protocols.tls.handshake import RETRY_RANDOM
from dissect.protocols.tls.key_log import KeyLog, KeyRing
from dissect.protocols.tls.session import TlsSession, Waiting
from tests.protocols.tls import sealing
from tests.protocols.tls.sealing import ALERT, DATA, FINISHED, HANDSHAKE, KEY_UPDATE, Pair, Sealer
from tests.protocols.tls.talks import Key, Wire, ec_key, rsa_key, wire

SAID = [(0, b"one"), (1, b"two" * 9000), (0, b"three"), (1, bytes(5)), (0, b"\x17\x03\x03\x00\x01")]


def ring(text: bytes | None) -> KeyRing:
    if text is None:
        return KeyRing()
    keys = KeyLog()
    keys.add(text)
    return KeyRing(keys)


def told(session: TlsSession, flights: Iterable[tuple[int, bytes]]) -> list[tuple[int, bytes]]:
    """Feed flights; return what came out, contents of a side that follow each other joined."""
    joined: list[tuple[int, bytes]] = []
    for frame, (side, octets) in enumerate(flights, 1):
        for content in session.feed(side, octets, frame, frame):
            if joined and joined[-1][0] == content.index:
                joined[-1] = (content.index, joined[-1][1] + content.octets)
            else:
                joined.append((content.index, content.octets))
    return joined


# ---- what OpenSSL says ----------------------------------------------------------------------------------------------

V2, V3 = ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3
#: Version, cipher in OpenSSL's words, key of the server.
SUITES = [
    (V3, "", rsa_key),
    (V3, "", ec_key),
    (V2, "ECDHE-RSA-AES128-GCM-SHA256", rsa_key),
    (V2, "ECDHE-RSA-AES256-GCM-SHA384", rsa_key),
    (V2, "ECDHE-ECDSA-AES256-GCM-SHA384", ec_key),
    (V2, "AES128-GCM-SHA256", rsa_key),
    (V2, "ECDHE-RSA-CHACHA20-POLY1305", rsa_key),
    (V2, "ECDHE-ECDSA-AES128-CCM", ec_key),
    (V2, "ECDHE-ECDSA-AES256-CCM8", ec_key),
]


def spoken(version: ssl.TLSVersion, cipher: str, key: Key) -> Wire:
    try:
        return wire(SAID, version, cipher, key)
    except ssl.SSLError as error:
        pytest.skip(f"this OpenSSL does not speak {cipher}: {error}")


@pytest.mark.parametrize(("version", "cipher", "key"), SUITES)
def test_what_openssl_says_is_opened(version: ssl.TLSVersion, cipher: str, key: object) -> None:
    assert callable(key)
    found = spoken(version, cipher, key())
    session = TlsSession(ring(found.key_log))
    assert told(session, found.flights) == SAID
    session.close()
    assert (session.shut, session.why_closed, session.malformed, session.is_open) == (0, "", 0, True)
    assert session.version_name == ("TLS 1.3" if version == V3 else "TLS 1.2")
    assert session.suite_name.startswith("TLS_")
    assert session.server_name == "plc.local"
    assert [one.subject for one in session.directions[1].certificates] == ["C=DE,CN=PLC_1/Communication"]
    assert session.held == 0


@pytest.mark.parametrize("version", [V2, V3])
def test_octet_by_octet_and_joined_in_all_ways(version: ssl.TLSVersion) -> None:
    found = wire(SAID, version)
    single = [(side, bytes((octet,))) for side, octets in found.flights for octet in octets]
    assert told(TlsSession(ring(found.key_log)), single) == SAID
    flights = [flight for flight in found.flights if len(flight[1]) < 3000]  # without what takes long to cut
    whole = TlsSession(ring(found.key_log))
    wanted = told(whole, flights)
    for place in range(0, sum(len(octets) for _, octets in flights), 7):
        at, cut = place, []
        for side, octets in flights:
            cut += [(side, octets[:at]), (side, octets[at:])] if 0 <= at < len(octets) else [(side, octets)]
            at -= len(octets)
        session = TlsSession(ring(found.key_log))
        assert told(session, cut) == wanted
        assert session.shut == whole.shut


def test_without_keys_what_the_handshake_says() -> None:
    for version, name in ((V2, "TLS 1.2"), (V3, "TLS 1.3")):
        found = wire(SAID, version)
        session = TlsSession(KeyRing())
        assert told(session, found.flights) == []
        session.close()
        assert (session.version_name, session.server_name, session.why_closed) == (name, "plc.local", "")
        assert session.shut > 4
        assert session.directions[1].octets > 27000
        certificates = session.directions[1].certificates
        assert bool(certificates) == (version == V2)  # in TLS 1.3 they are encrypted


def test_a_cbc_suite_is_named_and_stays_closed() -> None:
    found = spoken(V2, "ECDHE-RSA-AES128-SHA:@SECLEVEL=0", rsa_key())
    session = TlsSession(ring(found.key_log))
    assert told(session, found.flights) == []
    session.close()
    assert session.why_closed == (
        "TLS 1.2 with TLS_ECDHE_RSA_WITH_AES_128_CBC_SHA is not decrypted, only the AEAD suites of TLS 1.2 and 1.3"
    )


# ---- keys that do not fit -------------------------------------------------------------------------------------------


def test_keys_of_another_session() -> None:
    found, other = wire(SAID), wire(SAID)
    session = TlsSession(ring(other.key_log))
    assert told(session, found.flights) == []
    session.close()
    assert session.why_closed == "the key log holds only keys of 1 other session"
    empty = TlsSession(ring(b""))
    told(empty, found.flights)
    empty.close()
    assert empty.why_closed == "the key log is empty"


def test_a_key_log_that_was_cut_off_is_not_called_empty() -> None:
    """Half a key log: of the only line, or of the last one, the end is missing."""
    found, other = wire(SAID), wire(SAID)
    first = other.key_log.splitlines()[1] + b"\n"
    cut = found.key_log.splitlines()[1][:-1]
    exporter = b"EXPORTER_SECRET " + cut.split(b" ")[1] + b" " + bytes(32).hex().encode()
    for text, why in (
        (cut, "the key log holds only the beginning of a line that is cut off"),
        (b"CLIE", "the key log holds only the beginning of a line that is cut off"),
        (first + cut, "the key log holds only keys of 1 other session and the beginning of a line that is cut off"),
        (cut + b"\n", "no line of the key log has the form LABEL CLIENT_RANDOM SECRET"),
        (exporter + b"\n", "the key log holds nothing that opens records"),
        (b"# begun\n", "the key log is empty"),
    ):
        pieces = iter((text,))
        keys = KeyLog([lambda pieces=pieces: next(pieces, b"")])  # type: ignore[misc]
        session = TlsSession(KeyRing(keys))
        assert told(session, found.flights) == []
        session.close()
        assert session.why_closed == why, text


@pytest.mark.parametrize("version", [V2, V3])
def test_keys_that_are_wrong(version: ssl.TLSVersion) -> None:
    found = wire(SAID, version)
    lines = [line.split(b" ") for line in found.key_log.splitlines() if not line.startswith(b"#")]
    wrong = b"\n".join([b" ".join([label, random, b"ab" * (len(secret) // 2)]) for label, random, secret in lines])
    session = TlsSession(ring(wrong))
    assert told(session, found.flights) == []
    session.close()
    assert session.why_closed == (
        "the secrets given for it do not open the records: they belong to another session, or the records were changed"
    )


@pytest.mark.parametrize("side", [0, 1])
def test_half_a_key_log_opens_half(side: int) -> None:
    found = wire(SAID)
    label = (b"SERVER", b"CLIENT")[side]
    half = b"\n".join([line for line in found.key_log.splitlines() if not line.startswith(label)])
    session = TlsSession(ring(half))
    assert told(session, found.flights) == _joined([one for one in SAID if one[0] == side])
    session.close()
    missing = f"{label.decode()}_HANDSHAKE_TRAFFIC_SECRET"
    assert session.why_closed == f"the key log lacks {missing} of its session"


def _joined(said: list[tuple[int, bytes]]) -> list[tuple[int, bytes]]:
    return [(said[0][0], b"".join([octets for _, octets in said]))]


def test_traffic_secrets_alone_open_the_content() -> None:
    found = wire(SAID)
    half = b"\n".join([line for line in found.key_log.splitlines() if b"HANDSHAKE" not in line])
    session = TlsSession(ring(half))
    assert told(session, found.flights) == SAID
    session.close()
    assert session.directions[1].certificates == []
    assert session.shut == 5  # EncryptedExtensions, Certificate, CertificateVerify, twice Finished
    assert session.why_closed == (
        "the key log lacks CLIENT_HANDSHAKE_TRAFFIC_SECRET and SERVER_HANDSHAKE_TRAFFIC_SECRET of its session"
    )


def test_without_the_client_hello_or_the_server_hello() -> None:
    found = wire(SAID)
    session = TlsSession(ring(found.key_log))
    assert told(session, found.flights[1:]) == []
    session.close()
    assert session.why_closed == "its ClientHello was not captured, and only that tells which keys are its own"
    session = TlsSession(ring(found.key_log))
    assert told(session, found.flights[:1] + found.flights[2:]) == []
    session.close()
    assert session.why_closed == "its ServerHello was not captured, and only that names the cipher suite"


def test_without_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    found = wire(SAID)

    def missing(*_: object) -> None:
        raise ImportError

    monkeypatch.setattr(sessions, "Opener", missing)
    session = TlsSession(ring(found.key_log))
    assert told(session, found.flights) == []
    session.close()
    assert session.why_closed == "decrypting needs the package cryptography: pip install 's7dissect[tls]'"


# ---- keys that come late --------------------------------------------------------------------------------------------


def test_what_waits_for_its_keys_is_opened_in_order() -> None:
    found = wire(SAID)
    for late in range(len(found.flights)):
        keys = KeyLog()
        session = TlsSession(KeyRing(keys))
        got = told(session, found.flights[:late])
        keys.add(found.key_log)
        got += told(session, found.flights[late:])
        session.close()
        assert got == SAID, late
        assert session.shut == 0


def test_keys_that_come_one_by_one() -> None:
    found = wire(SAID)
    lines = iter([line + b"\n" for line in found.key_log.splitlines()])
    session = TlsSession(KeyRing(KeyLog([lambda: next(lines, b"")])))
    got = told(
        session, [(side, octets[at : at + 400]) for side, octets in found.flights for at in range(0, len(octets), 400)]
    )
    assert b"".join([octets for side, octets in got if side == 1]) == b"two" * 9000 + bytes(5)
    assert b"".join([octets for side, octets in got if side == 0]) == b"onethree\x17\x03\x03\x00\x01"
    session.close()
    assert session.shut == 0


def test_what_waits_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sessions, "MAX_WAITING", 4000)
    found = wire([(0, b"x" * 1000)] * 8)
    keys, waiting = KeyLog(), Waiting()
    session = TlsSession(KeyRing(keys), waiting)
    for side, octets in found.flights:
        session.feed(side, octets, 1, 1)
        assert session.held <= 4000
        assert waiting.octets <= 4000
    assert waiting.octets == 0
    assert session.shut > 0
    keys.add(found.key_log)
    session.close()
    assert session.opened == 0


def test_sessions_share_a_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sessions, "MAX_WAITING_ALL", 3000)
    waiting = Waiting()
    sessions_of = [TlsSession(KeyRing(KeyLog()), waiting) for _ in range(3)]
    for session in sessions_of:
        told(session, wire([(0, b"x" * 500)]).flights)
        assert waiting.octets <= 3000
    assert sessions_of[-1].shut > 0


def test_nothing_waits_where_nobody_has_keys() -> None:
    session = TlsSession(KeyRing())
    told(session, wire(SAID).flights)
    assert session.held == 0


# ---- TLS 1.3 by hand ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suite", [0x1301, 0x1302, 0x1303, 0x1304, 0x1305])
def test_every_suite_of_tls_1_3(suite: int) -> None:
    pair = Pair(suite)
    client, server = pair.ends
    session = TlsSession(ring(pair.keys()))
    assert told(session, [*pair.begun, (0, client.seal(b"ask")), (1, server.seal(b"answer", padding=7))]) == [
        (0, b"ask"),
        (1, b"answer"),
    ]
    assert (session.shut, session.suite_code) == (0, suite)


def test_key_updates_of_either_side() -> None:
    pair = Pair()
    client, server = pair.ends
    flights = list(pair.begun)
    wanted = b""
    for turn in range(5):
        flights += [(0, client.seal(b"%d" % turn)), (0, client.seal(KEY_UPDATE, HANDSHAKE))]
        wanted += b"%d" % turn
        client.update()
    flights += [(0, client.seal(b"last")), (1, server.seal(b"answer"))]
    session = TlsSession(ring(pair.keys()))
    assert told(session, flights) == [(0, wanted + b"last"), (1, b"answer")]
    assert session.shut == 0


def counted_digests(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return a list that grows with every step of a key derivation."""
    made: list[str] = []
    digest = hmac.digest

    def counting(key: bytes, message: bytes, hash_: str) -> bytes:
        made.append(hash_)
        return digest(key, message, hash_)

    monkeypatch.setattr(hmac, "digest", counting)
    return made


def test_each_key_update_is_one_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many came before: to begin anew with the first secret took minutes after some thousands."""
    pair = Pair()
    client = pair.ends[0]
    flights = list(pair.begun)
    for _ in range(200):
        flights.append((0, client.seal(KEY_UPDATE, HANDSHAKE)))
        client.update()
    session = TlsSession(ring(pair.keys()))
    made = counted_digests(monkeypatch)
    assert told(session, [*flights, (0, client.seal(b"last"))]) == [(0, b"last")]
    assert len(made) < 4 * 200
    session.lose(0, 100)
    client.seal(KEY_UPDATE, HANDSHAKE)
    client.update()
    made.clear()
    forged = sealing.record(DATA, bytes(40))
    assert told(session, [*[(0, forged)] * 3, (0, client.seal(b"again"))]) == [(0, b"again")]
    assert len(made) < 4 * 10


def test_the_keys_of_tls_1_2_are_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    found = wire([(0, b"x")] * 50, V2)
    session = TlsSession(ring(found.key_log))
    made = counted_digests(monkeypatch)
    assert told(session, found.flights) == [(0, b"x" * 50)]
    assert len(made) < 40


def test_early_data() -> None:
    client, server = Sealer(0, stage=0), Sealer(1)
    flights = [(0, sealing.client_hello(early=True) + client.seal(b"early"))]
    flights += [(1, sealing.server_hello() + server.seal(FINISHED, HANDSHAKE))]
    end = client.seal(sealing.END_OF_EARLY_DATA, HANDSHAKE)
    client.enter(1)
    finished = client.seal(FINISHED, HANDSHAKE)
    client.enter(2)
    flights += [(0, end + finished), (0, client.seal(b"late"))]
    session = TlsSession(ring(sealing.key_log(client, server)))
    assert told(session, flights) == [(0, b"earlylate")]
    assert session.shut == 0


def test_early_data_that_was_refused() -> None:
    """The server asks for another ClientHello; the client goes on without early data."""
    client, server = Sealer(0, stage=0), Sealer(1)
    flights = [(0, sealing.client_hello(early=True) + client.seal(b"early"))]
    assert hashlib.sha256(b"HelloRetryRequest").digest() == RETRY_RANDOM
    flights += [(1, sealing.server_hello(random=RETRY_RANDOM))]
    flights += [(0, sealing.client_hello()), (1, sealing.server_hello() + server.seal(FINISHED, HANDSHAKE))]
    client.enter(1)
    flights += [(0, client.seal(FINISHED, HANDSHAKE))]
    client.enter(2)
    flights += [(0, client.seal(b"late"))]
    session = TlsSession(ring(sealing.key_log(client, server)))
    assert told(session, flights)[-1] == (0, b"late")


def test_alerts() -> None:
    pair = Pair()
    session = TlsSession(ring(pair.keys()))
    told(session, [*pair.begun, (0, pair.ends[0].seal(b"\x02\x30", ALERT)), (1, b"\x15\x03\x03\x00\x02\x01\x00")])
    assert [one.alert for one in session.directions] == ["fatal unknown_ca", "warning close_notify"]


def test_records_of_nothing_but_padding_and_of_no_content() -> None:
    pair = Pair()
    client = pair.ends[0]
    session = TlsSession(ring(pair.keys()))
    assert told(
        session, [*pair.begun, (0, client.seal(b"", 0, 20)), (0, client.seal(b"")), (0, client.seal(b"x"))]
    ) == [(0, b"x")]
    assert (session.malformed, session.shut) == (1, 0)


@pytest.mark.parametrize("lost", [1, 5, 60])
def test_after_a_gap_the_number_of_the_next_record_is_found(lost: int) -> None:
    pair = Pair()
    client = pair.ends[0]
    session = TlsSession(ring(pair.keys()))
    told(session, pair.begun)
    missing = b"".join([client.seal(b"lost") for _ in range(lost)])
    session.lose(0, len(missing))
    assert told(session, [(0, client.seal(b"found")), (0, client.seal(b"and more"))]) == [(0, b"foundand more")]
    assert session.shut == 0


def test_a_gap_may_hold_the_end_of_the_handshake_and_a_key_update() -> None:
    pair = Pair()
    client = pair.ends[0]
    session = TlsSession(ring(pair.keys()))
    told(session, pair.begun[:3])
    session.lose(0, 200)
    client.seal(b"lost")
    assert told(session, [(0, client.seal(b"found"))]) == [(0, b"found")]
    session.lose(0, 100)
    client.seal(KEY_UPDATE, HANDSHAKE)
    client.update()
    client.seal(b"lost")
    assert told(session, [(0, client.seal(b"again")), (0, client.seal(b"!"))]) == [(0, b"again!")]


def test_a_gap_that_is_too_long_closes_the_direction_and_says_so() -> None:
    pair = Pair()
    client, server = pair.ends
    session = TlsSession(ring(pair.keys()))
    told(session, [*pair.begun, (0, client.seal(b"seen"))])
    client.number += 100_000
    session.lose(0, 500)
    assert told(session, [(0, client.seal(b"x"))] * 3 + [(1, server.seal(b"still read"))]) == [(1, b"still read")]
    session.close()
    assert session.shut == 3
    assert session.why_closed == (
        "records are missing from the capture, and those after them fit no record number that was tried"
    )


def test_a_forged_record_costs_nothing_but_itself() -> None:
    pair = Pair()
    client = pair.ends[0]
    session = TlsSession(ring(pair.keys()))
    forged = sealing.record(DATA, bytes(40))
    flights = [*pair.begun, (0, client.seal(b"a")), *[(0, forged)] * (MAX_MISSES - 1), (0, client.seal(b"b"))]
    assert told(session, flights) == [(0, b"ab")]
    assert session.shut == MAX_MISSES - 1


def test_another_session_on_the_same_connection() -> None:
    first, second = wire([(0, b"first")]), wire([(0, b"second")], V2)
    session = TlsSession(ring(first.key_log + second.key_log))
    assert told(session, first.flights + second.flights) == [(0, b"firstsecond")]
    assert session.version_name == "TLS 1.2"
    assert session.shut == 0


def test_a_handshake_message_over_many_records() -> None:
    hello = sealing.client_hello(name=b"n" * 100)[5:]
    session = TlsSession(KeyRing())
    for octet in hello:
        session.feed(0, sealing.record(HANDSHAKE, bytes((octet,))), 1, 1)
    assert session.server_name == "n" * 100


def test_a_message_that_is_too_long_is_passed_over() -> None:
    session = TlsSession(KeyRing())
    size = 1_000_000
    octets = b"\x0b" + size.to_bytes(3, "big") + bytes(size) + sealing.client_hello()[5:]
    for at in range(0, len(octets), 16000):
        session.feed(0, sealing.record(HANDSHAKE, octets[at : at + 16000]), 1, 1)
        assert session.held < 40_000
    assert session.directions[0].messages.passed == 1
    assert session.server_name == "plc"


def test_no_secret_stays_when_it_is_over() -> None:
    found = wire(SAID)
    session = TlsSession(ring(found.key_log))
    told(session, found.flights)
    session.close()
    assert session._secrets == {}
    assert [one._opener for one in session.directions] == [None, None]


# ---- anything -------------------------------------------------------------------------------------------------------

RECORDED = {version: wire(SAID[:1] + SAID[2:], version) for version in (V2, V3)}


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_damage_never_raises_and_everything_is_counted(data: st.DataObject) -> None:
    found = RECORDED[data.draw(st.sampled_from([V2, V3]))]
    session = TlsSession(ring(found.key_log if data.draw(st.booleans()) else None))
    for side, octets in found.flights:
        changed = bytearray(octets)
        for _ in range(data.draw(st.integers(0, 3))):
            changed[data.draw(st.integers(0, len(changed) - 1))] = data.draw(st.integers(0, 255))
        if data.draw(st.booleans()):
            session.lose(side, data.draw(st.integers(1, 5000)))
        for content in session.feed(side, bytes(changed), 1, 1):
            assert content.octets
    session.close()
    for direction in session.directions:
        assert direction.opened + direction.shut <= direction.records


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 1), st.binary(max_size=80)), max_size=20))
def test_anything_may_come(flights: list[tuple[int, bytes]]) -> None:
    session = TlsSession(ring(b""))
    records = [(side, sealing.record(22, octets)) for side, octets in flights]
    told(session, flights)
    told(session, records)
    session.close()
    assert session.opened == 0
