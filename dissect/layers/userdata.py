"""Userdata (ROSCTR 7) as Scapy layers: the parameter head in its forms, the payload as parts (reference section 4)."""

from __future__ import annotations

from typing import Any, Final

from scapy.packet import Packet, Raw, bind_top_down

from dissect.layers.fields import header_fields
from dissect.layers.parts import PartsField, S7_Part
from dissect.layers.s7 import (
    S7,
    USERDATA_BODIES,
    S7_Body,
    body_fields,
    carve_data,
    error_text,
    notes_of,
    pdu_of,
    userdata_body,
)
from dissect.protocols.s7 import layouts, pbc, security, tables
from dissect.protocols.s7.items import SPECIFICATION
from dissect.protocols.s7.message import NOT_REFUSED
from dissect.protocols.s7.parameters import REQUEST, RESPONSE
from dissect.protocols.s7.tables import PARAMETER_EXTENDED, PARAMETER_SHORT, PBC_R_ID


class S7_Userdata(S7_Body):
    """Userdata: `S7_UserdataShort` or `S7_UserdataExtended`. ``data`` is an `S7_DataHead` and the parts of the payload.

    ``S7_Userdata(octets)`` chooses by the parameter head; ``S7_Userdata()`` is an `S7_UserdataShort`.
    """

    name = "S7 userdata"
    match_subclass = True
    rosctr_alone = tables.USERDATA
    data_fields = ("data", "data_rest")

    @classmethod
    def dispatch_hook(cls, _pkt: bytes | None = None, *_args: Any, **_kwargs: Any) -> type[Packet]:
        """Choose the class that the octets call for (Scapy's interface)."""
        if not _pkt:
            return S7_UserdataShort
        known = userdata_body(bytes(_pkt))
        return known if known is not None and issubclass(known, S7_Userdata) and len(_pkt) >= known.least else Raw

    def responds_to(self, other: Packet) -> bool:
        """Return whether this is a response and ``other`` a request of the same group and subfunction."""
        return (
            isinstance(other, S7_Userdata)
            and self.type == RESPONSE
            and other.type == REQUEST
            and (self.group, self.subfunction) == (other.group, other.subfunction)
        )

    def detail(self) -> str:
        """Return the reason of a refusal, if any, and the description of the parts."""
        code = self.error_code if "error_code" in self.default_fields else 0
        pdu = pdu_of(self)
        refusing = pdu.refusing_code if pdu is not None else NOT_REFUSED
        error = f"error {error_text(code, tables.CPU_SERVICES)}" if code else ""
        refused = f"refused {tables.RETURN_CODES.coded(refusing)}" if refusing != NOT_REFUSED else ""
        return " ".join([text for text in (error, refused, notes_of(self)) if text])

    def describe(self) -> str:
        """Return type, group and subfunction by name."""
        names = tables.USERDATA_SUBFUNCTIONS.get(self.group)
        subfunction = names.name(self.subfunction) if names is not None else f"0x{self.subfunction:02x}"
        return f"{tables.USERDATA_TYPES.name(self.type)} {tables.USERDATA_GROUPS.name(self.group)}: {subfunction}"


_USERDATA_DEFAULTS: Final = {"item_count": 1, "specification": SPECIFICATION, "group": 4, "subfunction": 1}


class S7_UserdataShort(S7_Userdata):
    """Userdata with the short parameter head: most requests, and the pushes of group 4."""

    name = "S7 userdata (short)"
    least = layouts.USERDATA_SHORT.size
    fields_desc = body_fields(
        *header_fields(
            layouts.USERDATA_SHORT, {**_USERDATA_DEFAULTS, "length": 4, "syntax_id": PARAMETER_SHORT, "type": REQUEST}
        ),
        data=[PartsField("data", carve_data)],
    )


class S7_UserdataExtended(S7_Userdata):
    """Userdata with the extended parameter head: answers, follow-up requests, most pushes."""

    name = "S7 userdata (extended)"
    least = layouts.USERDATA_EXTENDED.size
    fields_desc = body_fields(
        *header_fields(
            layouts.USERDATA_EXTENDED,
            {**_USERDATA_DEFAULTS, "length": 8, "syntax_id": PARAMETER_EXTENDED, "type": RESPONSE},
        ),
        data=[PartsField("data", carve_data)],
    )


class S7_ModeTransition(S7_Body):
    """The push for a change of the operating mode: userdata with a special parameter block."""

    name = "S7 mode transition"
    least = layouts.MODE_TRANSITION.size
    fields_desc = body_fields(
        *header_fields(layouts.MODE_TRANSITION, {"function": tables.MODE_TRANSITION, "unknown": 0x10100000})
    )

    def detail(self) -> str:
        """Return the new mode."""
        return str(tables.USERDATA_SUBFUNCTIONS[0].name(self.mode))


class S7_USEND(S7_Body):
    """Data that a program sends unsolicited: userdata with a special parameter block, ``data`` without data head."""

    name = "S7 USEND"
    least = pbc.USEND_HEAD.size
    rosctr_alone = tables.USERDATA
    data_fields = ("data", "data_rest")
    fields_desc = body_fields(
        *header_fields(
            pbc.USEND_HEAD,
            {"item_count": 1, "specification": SPECIFICATION, "length": pbc.USEND_HEAD.size - 4, "syntax_id": PBC_R_ID},
        ),
        data=[PartsField("data", carve_data)],
    )

    def detail(self) -> str:
        """Return the R_ID."""
        return notes_of(self)


USERDATA_BODIES.update(
    {
        layouts.USERDATA_SHORT: S7_UserdataShort,
        layouts.USERDATA_EXTENDED: S7_UserdataExtended,
        layouts.MODE_TRANSITION: S7_ModeTransition,
        pbc.USEND_HEAD: S7_USEND,
    }
)
for _body in USERDATA_BODIES.values():
    bind_top_down(S7, _body, rosctr=tables.USERDATA)


class S7_Password(S7_Part):
    """The password of a session, encoded; `of` encodes a text."""

    name = "S7 password"
    layout = security.ENCODED_PASSWORD
    fields_desc = header_fields(security.ENCODED_PASSWORD)

    @classmethod
    def of(cls, text: str) -> S7_Password:
        """Return the password ``text``, up to eight characters, encoded. Raises ValueError for a longer one."""
        return cls(password=security.encode_password(text.encode("latin-1")))
