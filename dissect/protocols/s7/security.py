"""Security (userdata group 5, reference section 4.11): the password of a session.

The encoding does not protect it: anyone who has the octets can decode the password. So nothing in this module decodes it,
except `password_text` for callers that need it.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.parameters import REQUEST, UserdataHead
from dissect.wire.layout import HOLDS_SECRET, REST, Field, Layout
from dissect.wire.part import Cursor

PASSWORD_SIZE: Final = 8
_KEY: Final = 0x55

_FIELD_TEXT: Final = "Password, encoded; not shown as text."
ENCODED_PASSWORD: Final = Layout(
    "password",
    "reference section 4.11",
    [Field("password", REST, _FIELD_TEXT, "s7comm.data.userdata", holds=HOLDS_SECRET)],
)


def decode_password(encoded: bytes) -> bytes:
    """Return the octets of a password (each is encoded by XOR with 0x55 and with the encoded octet two before it)."""
    return bytes(
        octet ^ _KEY ^ (encoded[at - 2] if at >= 2 else 0)  # the first two octets have none two places before them
        for at, octet in enumerate(encoded)
    )


def encode_password(password: bytes) -> bytes:
    """Return the encoded form of a password of up to eight octets, which is padded with blanks.

    Raises ValueError if the password is longer.
    """
    if len(password) > PASSWORD_SIZE:
        message = f"a password has up to {PASSWORD_SIZE} bytes, this one has {len(password)}: give a shorter one"
        raise ValueError(message)
    encoded = bytearray()
    for at, octet in enumerate(password.ljust(PASSWORD_SIZE)):
        encoded.append(octet ^ _KEY ^ (encoded[at - 2] if at >= 2 else 0))
    return bytes(encoded)


def password_text(encoded: bytes) -> str:
    """Return the password of a request, without the padding. Only for callers whose user asked for the password."""
    return decode_password(encoded).decode("latin-1").rstrip(" ")


def parse_password(cursor: Cursor, head: UserdataHead) -> None:
    """Parse the password of a request; answers have no data."""
    if head.type == REQUEST:
        size = cursor.left
        cursor.take(ENCODED_PASSWORD, PASSWORD_SIZE, f"password ({min(size, PASSWORD_SIZE)} bytes, not shown)")
