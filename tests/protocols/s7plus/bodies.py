"""Bodies of S7comm-plus functions as tests need them, in the forms that captures show."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.objects import PlusObject, build_object
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, AID, RID, UDINT
from dissect.protocols.s7plus.values import Value, build_members, build_value
from dissect.wire.varint import VLQ, VLQ64, build_varint

QUALIFIER: Final = b"\0\0\x04\xe8" + build_members(
    [(1257, Value(0, RID, 0)), (1258, Value(0, AID, 0)), (1259, Value(0, UDINT, 0))]
)
FILL: Final = bytes(4)


def number(value: int) -> bytes:
    return build_varint(value, VLQ)


def rid(value: int) -> bytes:
    return value.to_bytes(4, "big")


def end(integrity_id: int = -1) -> bytes:
    return (number(integrity_id) if integrity_id >= 0 else b"") + FILL


def addresses(*wanted: VariableAddress) -> bytes:
    found = b"".join(
        [
            number(one.crc) + number(one.area) + number(len(one.lids) + 1) + number(one.sub_area)
            + b"".join([number(lid) for lid in one.lids])
            for one in wanted
        ]
    )  # fmt: skip
    fields = sum([4 + len(one.lids) for one in wanted])
    return rid(0) + number(len(wanted)) + number(fields) + found


def get_multi(*wanted: VariableAddress, integrity_id: int = 9) -> bytes:
    return addresses(*wanted) + QUALIFIER + end(integrity_id)


def multi_got(items: list[tuple[int, Value]], refusals: list[tuple[int, int]], integrity_id: int = 9) -> bytes:
    values = b"".join([number(item) + build_value(value) for item, value in items]) + b"\0"
    refused = b"".join([number(item) + build_varint(code, VLQ64) for item, code in refusals]) + b"\0"
    return b"\0" + values + refused + end(integrity_id)


def set_multi(pairs: list[tuple[VariableAddress, Value]], integrity_id: int = 9) -> bytes:
    values = b"".join([number(index) + build_value(value) for index, (_, value) in enumerate(pairs, 1)])
    return addresses(*[address for address, _ in pairs]) + values + b"\0" + QUALIFIER + end(integrity_id)


def set_variable(object_id: int, ids: list[int], value: Value, integrity_id: int = 9) -> bytes:
    wanted = number(len(ids)) + b"".join([number(id_) for id_ in ids])
    return rid(object_id) + wanted + build_value(value) + QUALIFIER + b"\0" + end(integrity_id)


def get_stream(object_id: int, ids: list[int]) -> bytes:
    return rid(object_id) + build_value(Value(ADDRESS_ARRAY, UDINT, list(ids))) + QUALIFIER + b"\0\1"


def create_object(parent: int, value: Value, *objects: PlusObject, integrity_id: int = -1) -> bytes:
    head = rid(parent) + build_value(value) + bytes(4)
    id_ = number(integrity_id) if integrity_id >= 0 else b""
    return head + id_ + b"".join([build_object(one) for one in objects]) + FILL


def delete_object(object_id: int, integrity_id: int = 9) -> bytes:
    return rid(object_id) + b"\0" + QUALIFIER + end(integrity_id)
