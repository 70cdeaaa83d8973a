"""Values as short texts for a person, and as JSON-ready data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from librt.strings import BytesWriter, write_f32_be

from dissect.protocols.s7.singles import real_repr, real_text
from dissect.protocols.s7plus.id_tables import IDS
from dissect.protocols.s7plus.identification import RECORDS, is_record, record_text
from dissect.protocols.s7plus.ids import HIDDEN, id_name, member_name
from dissect.protocols.s7plus.program_tables import MEANINGS
from dissect.protocols.s7plus.value_tables import (
    AID,
    BIT_TYPES,
    FIXED_SIZES,
    NULL,
    REAL,
    RID,
    TIMESPAN,
    TIMESTAMP,
    WSTRING,
)
from dissect.protocols.s7plus.values import Blob, Member, Packed, Rows, Struct, Value
from dissect.wire.text import Clock, hexadecimal, json_text

#: Maximum number of elements of an array, characters and octets that are shown.
_SHOWN: Final = 8
_SHOWN_TEXT: Final = 80
_SHOWN_OCTETS: Final = 16
#: Members of a structure that a line names.
_SHOWN_MEMBERS: Final = 8
_BYTE: Final = "0x%02x"
#: Numbers with another form.
_OTHER: Final = "?"
#: By type: the format of a number, empty for a decimal number.
_FORMS: Final[list[str]] = [
    f"0x%0{2 * FIXED_SIZES[type_]}x" if type_ in BIT_TYPES
    else _OTHER if type_ in (RID, AID, TIMESTAMP, TIMESPAN)
    else ""
    for type_ in range(256)
]  # fmt: skip
_BYTES: Final[list[str]] = [_BYTE % number for number in range(256)]


def value_with_type(value: Value) -> str:
    """Return a value as a short text after its type: ``Int 5``, ``WString 'pump'``, ``USInt[256] 254, 5, 104 …``.

    Text from the wire is not escaped.
    """
    content = value.content
    if value.end == 0 and content == HIDDEN:
        return HIDDEN  # nothing of the secret is shown; its type was another one
    name = value.type_name
    if value.sparse and isinstance(content, list):
        return f"{name}, sparse, {len(content)} elements"
    if isinstance(content, list):
        some = ", ".join([_content_text(value.type, element) for element in content[:_SHOWN]])
        return f"{name}[{len(content)}] {some}{' …' if len(content) > _SHOWN else ''}".rstrip()
    if value.type == NULL:
        return name
    return f"{name} {_content_text(value.type, content)}"


def value_said(value: Value, id_: int) -> str:
    """Return a value as a short text, with the meaning of its number if ``id_``, its attribute or member, has meanings."""
    meaning = meant(value.content, id_)
    if meaning and id_ in RECORDS:
        return f"I&M0 {meaning}"
    return f"{value_with_type(value)} {meaning}" if meaning else value_with_type(value)


def in_line(value: Value, id_: int) -> str:
    """Return `value_said` for lines that show no members: a structure without a name is shown with its first members."""
    content = value.content
    if isinstance(content, Struct) and content.id not in IDS:
        return f"{value.type_name} {_members_text(content)}"
    return value_said(value, id_)


def _members_text(struct: Struct) -> str:
    said = [f"{member_name(id_)}: {_member_text(value, id_)}" for id_, value in struct.members[:_SHOWN_MEMBERS]]
    more = ", …" if len(struct.members) > _SHOWN_MEMBERS else ""
    return f"{{{', '.join(said)}{more}}}"


def _member_text(value: Value, id_: int) -> str:
    """Return the value of a member without its type, and the meaning of its number."""
    content = value.content
    if isinstance(content, Struct | list) or value.type == NULL or (value.end == 0 and content == HIDDEN):
        return value_with_type(value)
    meaning = meant(content, id_)
    return f"{_content_text(value.type, content)} {meaning}".rstrip()


def members_said(members: Mapping[str, object]) -> str:
    """Return the members of a structure, as JSON has them, by name: ``{OwnState: 0, OperatingState: 8 RUN}``. Not escaped."""
    return f"{{{', '.join([_member_said(name, value) for name, value in members.items()])}}}"


def _member_said(name: str, value: object) -> str:
    id_ = int(name) if name.isascii() and name.isdecimal() else -1
    meaning = meant(value, id_)
    return f"{member_name(id_) if id_ >= 0 else name}: {_json_said(value)}{f' {meaning}' if meaning else ''}"


def _json_said(value: object) -> str:
    """Return data in the form of JSON, but with members without quotes and text not escaped."""
    if isinstance(value, dict):
        inner = value.get("members")
        return members_said(inner if isinstance(inner, dict) else value)
    if isinstance(value, list):
        return f"[{', '.join([_json_said(one) for one in value])}]"
    if isinstance(value, str):
        return f'"{value}"'
    if value is None:
        return "null"
    return str(value).lower() if isinstance(value, bool) else str(value)


def meant(content: object, id_: int) -> str:
    """Return the meaning of a number or a record if ``id_``, its attribute or member, has one; else empty."""
    if id_ in RECORDS:
        return record_text(content.octets) if isinstance(content, Blob) and is_record(content.octets) else ""
    codes = MEANINGS.get(id_)
    row = codes.get(content) if codes is not None and isinstance(content, int) else None
    return row.name if row is not None else ""


def _content_text(type_: int, content: object) -> str:
    if content is True:
        return "true"
    if content is False:
        return "false"
    if isinstance(content, int):
        return _number_text(type_, content)
    if isinstance(content, bytes) and type_ == WSTRING:
        content = content.decode("utf-8", "replace")
    if isinstance(content, str):
        more = "…" if len(content) > _SHOWN_TEXT else ""
        return f"'{content[:_SHOWN_TEXT]}'{more}"
    if isinstance(content, bytes):
        return octets_text(content)
    if isinstance(content, float):
        return real_text(_single(content)) if type_ == REAL else repr(content)
    if isinstance(content, Blob):
        return octets_text(content.octets)
    if isinstance(content, Value):
        return value_with_type(content)
    if isinstance(content, Struct | Packed | Rows):
        return id_name(content.id)
    return "-"


def _single(number: float) -> bytes:
    """Return the octets of a number that was sent as a single."""
    out = BytesWriter()
    write_f32_be(out, number)
    return out.getvalue()


def _number_text(type_: int, number: int) -> str:
    form = _FORMS[type_] if 0 <= type_ < len(_FORMS) else ""
    if not form:
        return str(number)
    if form == _BYTE and 0 <= number < len(_BYTES):
        return _BYTES[number]
    if form != _OTHER:
        return form % number
    if type_ == RID or type_ == AID:
        return id_name(number)
    if type_ == TIMESTAMP:
        return iso_time(number)
    return f"{number} ns"


def iso_time(time_ns: int) -> str:
    """Return a time in nanoseconds since 1970 as ISO 8601; return a number if no clock could show it."""
    return Clock().iso(time_ns) if 0 <= time_ns < 1 << 63 else str(time_ns)


def octets_text(octets: bytes) -> str:
    """Return the first octets in hexadecimal, and the count if there are more."""
    if len(octets) <= _SHOWN_OCTETS:
        return octets.hex(" ") or "(empty)"
    return f"{octets[:_SHOWN_OCTETS].hex(' ')} … {len(octets)} bytes"


def as_json(value: Value) -> object:
    """Return the content of a value as JSON-ready data: numbers, texts, lists; octets in hexadecimal.

    A structure is an object with its ``id`` and its ``members`` by number. A number that JSON cannot represent (NaN, infinity)
    becomes a text.
    """
    content = value.content
    if value.sparse and isinstance(content, list):
        return {str(key): _json_one(value.type, element) for key, element in content}
    if isinstance(content, list):
        return [_json_one(value.type, element) for element in content]
    return _json_one(value.type, content)


def _json_one(type_: int, content: object) -> object:
    if isinstance(content, bytes) and type_ == WSTRING:
        return content.decode("utf-8", "replace")
    if isinstance(content, bytes):
        return content.hex()
    if isinstance(content, float):
        number = float(real_text(_single(content))) if type_ == REAL else content
        return number if math.isfinite(number) else repr(number)
    if isinstance(content, Blob):
        if content.root > 1 and content.kind == 0:
            return {"root": content.root, "members": _json_members(content.members)}
        return content.octets.hex()
    if isinstance(content, Value):
        return as_json(content)
    if isinstance(content, Struct):
        return {"id": content.id, "members": _json_members(content.members)}
    if isinstance(content, Rows):
        return {"id": content.id, "rows": [_json_members(row) for row in content.rows]}
    if isinstance(content, Packed):
        return {"id": content.id, "time": content.time, "octets": content.octets.hex()}
    return content


def _json_members(members: list[Member]) -> dict[str, object]:
    return {str(id_): as_json(value) for id_, value in members}


def value_json(value: Value) -> str:
    """Return `as_json` as JSON text, without intermediate objects, because lines of transactions have a value for each item."""
    content = value.content
    if not isinstance(content, list):
        return _one_as_text(value.type, content)
    if value.sparse:
        return _by_number({key: _one_as_text(value.type, element) for key, element in content})
    return f"[{','.join([_one_as_text(value.type, element) for element in content])}]"


def _one_as_text(type_: int, content: object) -> str:
    if content is None:
        return "null"
    if content is True:
        return "true"
    if content is False:
        return "false"
    if isinstance(content, int):
        return str(content)
    if isinstance(content, float):
        text = real_repr(_single(content)) if type_ == REAL else repr(content)
        return f'"{text}"' if "n" in text else text  # NaN and the infinities
    if isinstance(content, str):
        return json_text(content)
    if isinstance(content, bytes):
        return json_text(content.decode("utf-8", "replace")) if type_ == WSTRING else f'"{hexadecimal(content)}"'
    if isinstance(content, Blob):
        if content.root > 1 and content.kind == 0:
            return f'{{"root":{content.root},"members":{_members_as_text(content.members)}}}'
        return f'"{content.octets.hex()}"'
    if isinstance(content, Value):
        return value_json(content)
    if isinstance(content, Struct):
        return f'{{"id":{content.id},"members":{_members_as_text(content.members)}}}'
    if isinstance(content, Rows):
        return f'{{"id":{content.id},"rows":[{",".join([_members_as_text(row) for row in content.rows])}]}}'
    if isinstance(content, Packed):
        return f'{{"id":{content.id},"time":{content.time},"octets":"{content.octets.hex()}"}}'
    raise TypeError(f"no value holds {type(content).__name__}")


def _members_as_text(members: list[Member]) -> str:
    return _by_number({id_: value_json(value) for id_, value in members})


def _by_number(texts: dict[int, str]) -> str:
    """Return a JSON object; if a number occurs twice, the last value is used in the place of the first."""
    members = ",".join([f'"{number}":{text}' for number, text in texts.items()])
    return f"{{{members}}}"
