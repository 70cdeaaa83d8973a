"""Security functions as Scapy packets (`dissect.protocols.s7.security`)."""

from __future__ import annotations

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.protocols.s7 import security


class S7_Password(S7_Part):
    """The password of a session, encoded; `of` encodes a text."""

    name = "S7 password"
    layout = security.ENCODED_PASSWORD
    fields_desc = header_fields(security.ENCODED_PASSWORD)

    @classmethod
    def of(cls, text: str) -> S7_Password:
        """Return the password ``text``, up to eight characters, encoded. Raises ValueError for a longer one."""
        return cls(password=security.encode_password(text.encode("latin-1")))
