"""Cyclic services as Scapy packets (`dissect.s7.cyclic`)."""

from __future__ import annotations

from typing import ClassVar

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.s7 import cyclic

__all__ = [
    "S7_CyclicRequest",
    "S7_CyclicUnsubscribe",
    "S7_CyclicValues",
    "S7_Record",
    "S7_RecordHead",
    "S7_RecordLength",
    "S7_RecordNoStatus",
    "S7_RecordStatus",
    "S7_RecordTransport",
]


class S7_CyclicRequest(S7_Part):
    """Head of a request for cyclic or change driven transfer. ``item_count`` is filled in when left out."""

    name = "S7 cyclic request"
    layout = cyclic.CYCLIC_REQUEST
    counted: ClassVar[dict[str, tuple[str, ...]]] = {"item_count": ("S7_Item",)}
    fields_desc = header_fields(cyclic.CYCLIC_REQUEST, {"item_count": None, "time_base": 1, "factor": 1})


class S7_CyclicValues(S7_Part):
    """Head of the values in an answer or a push. ``item_count`` is filled in when left out."""

    name = "S7 cyclic values"
    layout = cyclic.CYCLIC_VALUES
    fields_desc = header_fields(cyclic.CYCLIC_VALUES)


class S7_CyclicUnsubscribe(S7_Part):
    """Ends a cyclic job."""

    name = "S7 unsubscribe"
    layout = cyclic.CYCLIC_UNSUBSCRIBE
    fields_desc = header_fields(cyclic.CYCLIC_UNSUBSCRIBE, {"function": 5})


class S7_RecordHead(S7_Part):
    """Head of a record request and of its answer; it has no interval."""

    name = "S7 data record"
    layout = cyclic.RECORD_HEAD
    fields_desc = header_fields(cyclic.RECORD_HEAD, {"item_count": 1})


class S7_RecordTransport(S7_Part):
    """What stands between the return code and the status of a record that was read."""

    name = "S7 data record transport size"
    layout = cyclic.RECORD_TRANSPORT
    fields_desc = header_fields(cyclic.RECORD_TRANSPORT, {"transport_size": 9})


class S7_RecordStatus(S7_Part):
    """Status of a data record that was read. ``status_length`` is filled in when left out."""

    name = "S7 data record status"
    layout = cyclic.RECORD_STATUS
    fields_desc = header_fields(cyclic.RECORD_STATUS)


class S7_RecordNoStatus(S7_Part):
    """Data record status."""

    name = "S7 data record status"
    layout = cyclic.RECORD_NO_STATUS
    fields_desc = header_fields(cyclic.RECORD_NO_STATUS)


class S7_RecordLength(S7_Part):
    """Octets of the data record that follows. ``record_length`` is filled in when left out."""

    name = "S7 data record length"
    layout = cyclic.RECORD_LENGTH
    fields_desc = header_fields(cyclic.RECORD_LENGTH)


class S7_Record(S7_Part):
    """The content of a data record."""

    name = "S7 record"
    layout = cyclic.RECORD
    fields_desc = header_fields(cyclic.RECORD)
