"""Code tables of TLS: records, handshakes, alerts, versions (RFC 5246, RFC 8446) and cipher suites (the registry of IANA)."""

from __future__ import annotations

from typing import Final

from dissect.wire.codes import CodeTable

CHANGE_CIPHER_SPEC: Final = 0x14
ALERT: Final = 0x15
HANDSHAKE: Final = 0x16
APPLICATION_DATA: Final = 0x17
HEARTBEAT: Final = 0x18

CONTENT_TYPES: Final = CodeTable("TLS content type", 2, [
    (CHANGE_CIPHER_SPEC, "change cipher spec", "What follows in this direction is encrypted; in TLS 1.3 without meaning."),
    (ALERT, "alert", "An error, or the end of the session."),
    (HANDSHAKE, "handshake", "Messages that agree on version, cipher suite and keys."),
    (APPLICATION_DATA, "application data", "What the session is for; in TLS 1.3 everything encrypted says it is this."),
    (HEARTBEAT, "heartbeat", "Asks whether the peer is alive (RFC 6520)."),
])  # fmt: skip

SSL_3_0: Final = 0x0300
TLS_1_0: Final = 0x0301
TLS_1_1: Final = 0x0302
TLS_1_2: Final = 0x0303
TLS_1_3: Final = 0x0304

TLS_VERSIONS: Final = CodeTable("TLS version", 4, [
    (SSL_3_0, "SSL 3.0", "Broken; prohibited by RFC 7568."),
    (TLS_1_0, "TLS 1.0", "Out of use since RFC 8996."),
    (TLS_1_1, "TLS 1.1", "Out of use since RFC 8996."),
    (TLS_1_2, "TLS 1.2", "RFC 5246."),
    (TLS_1_3, "TLS 1.3", "RFC 8446."),
])  # fmt: skip

CLIENT_HELLO: Final = 1
SERVER_HELLO: Final = 2
NEW_SESSION_TICKET: Final = 4
END_OF_EARLY_DATA: Final = 5
ENCRYPTED_EXTENSIONS: Final = 8
CERTIFICATE: Final = 11
FINISHED: Final = 20
KEY_UPDATE: Final = 24

HANDSHAKE_TYPES: Final = CodeTable("TLS handshake type", 2, [
    (0, "HelloRequest", "The server asks for a new handshake (TLS 1.2)."),
    (CLIENT_HELLO, "ClientHello", "What the client offers."),
    (SERVER_HELLO, "ServerHello", "What the server chooses."),
    (NEW_SESSION_TICKET, "NewSessionTicket", "Lets a later session begin faster."),
    (END_OF_EARLY_DATA, "EndOfEarlyData", "The client's early data ends."),
    (ENCRYPTED_EXTENSIONS, "EncryptedExtensions", "What the server chooses beside the keys."),
    (CERTIFICATE, "Certificate", "The chain of certificates of its sender."),
    (12, "ServerKeyExchange", "The server's half of the key exchange (TLS 1.2)."),
    (13, "CertificateRequest", "The server asks the client for a certificate."),
    (14, "ServerHelloDone", "The server's first messages end (TLS 1.2)."),
    (15, "CertificateVerify", "Proves that its sender owns the certificate."),
    (16, "ClientKeyExchange", "The client's half of the key exchange (TLS 1.2)."),
    (FINISHED, "Finished", "The handshake of its sender is over."),
    (22, "CertificateStatus", "The state of the server's certificate (TLS 1.2)."),
    (KEY_UPDATE, "KeyUpdate", "Its sender goes on with a new key (TLS 1.3)."),
])  # fmt: skip

ALERT_LEVELS: Final = CodeTable("TLS alert level", 2, [
    (1, "warning", "The session may go on."),
    (2, "fatal", "The session is over."),
])  # fmt: skip

ALERTS: Final = CodeTable("TLS alert", 2, [
    (0, "close_notify", "Its sender sends no more."),
    (10, "unexpected_message", ""),
    (20, "bad_record_mac", "A record could not be decrypted."),
    (22, "record_overflow", ""),
    (40, "handshake_failure", "Nothing that both sides accept was found."),
    (42, "bad_certificate", "A certificate is damaged or its signature is wrong."),
    (43, "unsupported_certificate", ""),
    (44, "certificate_revoked", ""),
    (45, "certificate_expired", "A certificate is outside its period of validity."),
    (46, "certificate_unknown", "A certificate was refused for another reason."),
    (47, "illegal_parameter", ""),
    (48, "unknown_ca", "Nobody whom its sender trusts signed the certificate."),
    (49, "access_denied", ""),
    (50, "decode_error", ""),
    (51, "decrypt_error", "A signature or a Finished could not be verified."),
    (70, "protocol_version", "The version is not supported."),
    (71, "insufficient_security", ""),
    (80, "internal_error", ""),
    (86, "inappropriate_fallback", ""),
    (90, "user_canceled", ""),
    (100, "no_renegotiation", ""),
    (109, "missing_extension", ""),
    (110, "unsupported_extension", ""),
    (112, "unrecognized_name", "The server does not know the name that was asked for."),
    (113, "bad_certificate_status_response", ""),
    (115, "unknown_psk_identity", ""),
    (116, "certificate_required", "The client showed no certificate."),
    (120, "no_application_protocol", ""),
])  # fmt: skip

# The ways in which a suite protects records.
GCM: Final = "GCM"
CCM: Final = "CCM"
CHACHA20: Final = "ChaCha20-Poly1305"


class Suite:
    """The parameters of an AEAD cipher suite.

    ``hash`` is a name that `hashlib` knows; ``key`` and ``tag`` are sizes in octets; ``kind`` is `GCM`, `CCM` or `CHACHA20`.
    """

    __slots__ = ("code", "hash", "key", "kind", "name", "tag")

    def __init__(self, code: int, name: str, kind: str, key: int, hash_: str, tag: int) -> None:
        self.code = code
        self.name = name
        self.kind = kind
        self.key = key
        self.hash = hash_
        self.tag = tag

    @property
    def explicit(self) -> int:
        """Octets of the nonce that are sent with each TLS 1.2 record (RFC 5288, 6655, 7905)."""
        return 0 if self.kind == CHACHA20 else 8

    @property
    def salt(self) -> int:
        """Octets of the nonce that come from the TLS 1.2 key block."""
        return 12 - self.explicit


_TLS_1_3: Final = [
    (0x1301, "TLS_AES_128_GCM_SHA256"),
    (0x1302, "TLS_AES_256_GCM_SHA384"),
    (0x1303, "TLS_CHACHA20_POLY1305_SHA256"),
    (0x1304, "TLS_AES_128_CCM_SHA256"),
    (0x1305, "TLS_AES_128_CCM_8_SHA256"),
]

_TLS_1_2: Final = [
    (0x009C, "TLS_RSA_WITH_AES_128_GCM_SHA256"),
    (0x009D, "TLS_RSA_WITH_AES_256_GCM_SHA384"),
    (0x009E, "TLS_DHE_RSA_WITH_AES_128_GCM_SHA256"),
    (0x009F, "TLS_DHE_RSA_WITH_AES_256_GCM_SHA384"),
    (0x00A0, "TLS_DH_RSA_WITH_AES_128_GCM_SHA256"),
    (0x00A1, "TLS_DH_RSA_WITH_AES_256_GCM_SHA384"),
    (0x00A2, "TLS_DHE_DSS_WITH_AES_128_GCM_SHA256"),
    (0x00A3, "TLS_DHE_DSS_WITH_AES_256_GCM_SHA384"),
    (0x00A6, "TLS_DH_anon_WITH_AES_128_GCM_SHA256"),
    (0x00A7, "TLS_DH_anon_WITH_AES_256_GCM_SHA384"),
    (0x00A8, "TLS_PSK_WITH_AES_128_GCM_SHA256"),
    (0x00A9, "TLS_PSK_WITH_AES_256_GCM_SHA384"),
    (0x00AA, "TLS_DHE_PSK_WITH_AES_128_GCM_SHA256"),
    (0x00AB, "TLS_DHE_PSK_WITH_AES_256_GCM_SHA384"),
    (0x00AC, "TLS_RSA_PSK_WITH_AES_128_GCM_SHA256"),
    (0x00AD, "TLS_RSA_PSK_WITH_AES_256_GCM_SHA384"),
    (0xC02B, "TLS_ECDHE_ECDSA_WITH_AES_128_GCM_SHA256"),
    (0xC02C, "TLS_ECDHE_ECDSA_WITH_AES_256_GCM_SHA384"),
    (0xC02D, "TLS_ECDH_ECDSA_WITH_AES_128_GCM_SHA256"),
    (0xC02E, "TLS_ECDH_ECDSA_WITH_AES_256_GCM_SHA384"),
    (0xC02F, "TLS_ECDHE_RSA_WITH_AES_128_GCM_SHA256"),
    (0xC030, "TLS_ECDHE_RSA_WITH_AES_256_GCM_SHA384"),
    (0xC031, "TLS_ECDH_RSA_WITH_AES_128_GCM_SHA256"),
    (0xC032, "TLS_ECDH_RSA_WITH_AES_256_GCM_SHA384"),
    (0xC09C, "TLS_RSA_WITH_AES_128_CCM"),
    (0xC09D, "TLS_RSA_WITH_AES_256_CCM"),
    (0xC09E, "TLS_DHE_RSA_WITH_AES_128_CCM"),
    (0xC09F, "TLS_DHE_RSA_WITH_AES_256_CCM"),
    (0xC0A0, "TLS_RSA_WITH_AES_128_CCM_8"),
    (0xC0A1, "TLS_RSA_WITH_AES_256_CCM_8"),
    (0xC0A2, "TLS_DHE_RSA_WITH_AES_128_CCM_8"),
    (0xC0A3, "TLS_DHE_RSA_WITH_AES_256_CCM_8"),
    (0xC0A4, "TLS_PSK_WITH_AES_128_CCM"),
    (0xC0A5, "TLS_PSK_WITH_AES_256_CCM"),
    (0xC0A6, "TLS_DHE_PSK_WITH_AES_128_CCM"),
    (0xC0A7, "TLS_DHE_PSK_WITH_AES_256_CCM"),
    (0xC0A8, "TLS_PSK_WITH_AES_128_CCM_8"),
    (0xC0A9, "TLS_PSK_WITH_AES_256_CCM_8"),
    (0xC0AA, "TLS_PSK_DHE_WITH_AES_128_CCM_8"),
    (0xC0AB, "TLS_PSK_DHE_WITH_AES_256_CCM_8"),
    (0xC0AC, "TLS_ECDHE_ECDSA_WITH_AES_128_CCM"),
    (0xC0AD, "TLS_ECDHE_ECDSA_WITH_AES_256_CCM"),
    (0xC0AE, "TLS_ECDHE_ECDSA_WITH_AES_128_CCM_8"),
    (0xC0AF, "TLS_ECDHE_ECDSA_WITH_AES_256_CCM_8"),
    (0xCCA8, "TLS_ECDHE_RSA_WITH_CHACHA20_POLY1305_SHA256"),
    (0xCCA9, "TLS_ECDHE_ECDSA_WITH_CHACHA20_POLY1305_SHA256"),
    (0xCCAA, "TLS_DHE_RSA_WITH_CHACHA20_POLY1305_SHA256"),
    (0xCCAB, "TLS_PSK_WITH_CHACHA20_POLY1305_SHA256"),
    (0xCCAC, "TLS_ECDHE_PSK_WITH_CHACHA20_POLY1305_SHA256"),
    (0xCCAD, "TLS_DHE_PSK_WITH_CHACHA20_POLY1305_SHA256"),
    (0xCCAE, "TLS_RSA_PSK_WITH_CHACHA20_POLY1305_SHA256"),
    (0xD001, "TLS_ECDHE_PSK_WITH_AES_128_GCM_SHA256"),
    (0xD002, "TLS_ECDHE_PSK_WITH_AES_256_GCM_SHA384"),
    (0xD003, "TLS_ECDHE_PSK_WITH_AES_128_CCM_8_SHA256"),
    (0xD005, "TLS_ECDHE_PSK_WITH_AES_128_CCM_SHA256"),
]

#: Suites that have names here, but are not decrypted, because they are not AEAD.
_OTHERS: Final = [
    (0x0000, "TLS_NULL_WITH_NULL_NULL"),
    (0x0001, "TLS_RSA_WITH_NULL_MD5"),
    (0x0002, "TLS_RSA_WITH_NULL_SHA"),
    (0x0004, "TLS_RSA_WITH_RC4_128_MD5"),
    (0x0005, "TLS_RSA_WITH_RC4_128_SHA"),
    (0x000A, "TLS_RSA_WITH_3DES_EDE_CBC_SHA"),
    (0x0016, "TLS_DHE_RSA_WITH_3DES_EDE_CBC_SHA"),
    (0x0018, "TLS_DH_anon_WITH_RC4_128_MD5"),
    (0x002F, "TLS_RSA_WITH_AES_128_CBC_SHA"),
    (0x0033, "TLS_DHE_RSA_WITH_AES_128_CBC_SHA"),
    (0x0034, "TLS_DH_anon_WITH_AES_128_CBC_SHA"),
    (0x0035, "TLS_RSA_WITH_AES_256_CBC_SHA"),
    (0x0039, "TLS_DHE_RSA_WITH_AES_256_CBC_SHA"),
    (0x003A, "TLS_DH_anon_WITH_AES_256_CBC_SHA"),
    (0x003B, "TLS_RSA_WITH_NULL_SHA256"),
    (0x003C, "TLS_RSA_WITH_AES_128_CBC_SHA256"),
    (0x003D, "TLS_RSA_WITH_AES_256_CBC_SHA256"),
    (0x0067, "TLS_DHE_RSA_WITH_AES_128_CBC_SHA256"),
    (0x006B, "TLS_DHE_RSA_WITH_AES_256_CBC_SHA256"),
    (0xC006, "TLS_ECDHE_ECDSA_WITH_NULL_SHA"),
    (0xC007, "TLS_ECDHE_ECDSA_WITH_RC4_128_SHA"),
    (0xC008, "TLS_ECDHE_ECDSA_WITH_3DES_EDE_CBC_SHA"),
    (0xC009, "TLS_ECDHE_ECDSA_WITH_AES_128_CBC_SHA"),
    (0xC00A, "TLS_ECDHE_ECDSA_WITH_AES_256_CBC_SHA"),
    (0xC010, "TLS_ECDHE_RSA_WITH_NULL_SHA"),
    (0xC011, "TLS_ECDHE_RSA_WITH_RC4_128_SHA"),
    (0xC012, "TLS_ECDHE_RSA_WITH_3DES_EDE_CBC_SHA"),
    (0xC013, "TLS_ECDHE_RSA_WITH_AES_128_CBC_SHA"),
    (0xC014, "TLS_ECDHE_RSA_WITH_AES_256_CBC_SHA"),
    (0xC023, "TLS_ECDHE_ECDSA_WITH_AES_128_CBC_SHA256"),
    (0xC024, "TLS_ECDHE_ECDSA_WITH_AES_256_CBC_SHA384"),
    (0xC027, "TLS_ECDHE_RSA_WITH_AES_128_CBC_SHA256"),
    (0xC028, "TLS_ECDHE_RSA_WITH_AES_256_CBC_SHA384"),
]

CIPHER_SUITES: Final = CodeTable(
    "TLS cipher suite", 4, [(code, name, "") for code, name in (*_TLS_1_3, *_TLS_1_2, *_OTHERS)]
)

#: Words in the name of a suite with insufficient protection: no encryption, broken ciphers, no authentication.
WEAK_WORDS: Final = frozenset(("NULL", "RC4", "3DES", "DES40", "EXPORT", "anon", "MD5"))


def suite_of(code: int) -> Suite | None:
    """Return the parameters of the suite ``code``, which are all in its name; None if it is not AEAD or unknown."""
    name = CIPHER_SUITES.name(code)
    words = name.split("_")
    hash_ = "sha384" if words[-1] == "SHA384" else "sha256"
    tag = 8 if "8" in words else 16
    if "GCM" in words or "CCM" in words:
        key = 32 if "256" in words else 16
        return Suite(code, name, GCM if "GCM" in words else CCM, key, hash_, tag)
    if "CHACHA20" in words:
        return Suite(code, name, CHACHA20, 32, hash_, tag)
    return None
