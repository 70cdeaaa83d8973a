"""Records of the communication lists as Scapy packets (`dissect.s7.szl_communication`)."""

from __future__ import annotations

from dissect.layers.fields import header_fields
from dissect.layers.parts import S7_Part
from dissect.s7 import szl_communication

__all__ = [
    "S7_SZLCapabilityBlocks",
    "S7_SZLCapabilityClock",
    "S7_SZLCapabilityDiagnostics",
    "S7_SZLCapabilityGeneral",
    "S7_SZLCapabilityGlobalData",
    "S7_SZLCapabilityMessages",
    "S7_SZLCapabilityObjects",
    "S7_SZLCapabilityOperator",
    "S7_SZLCapabilityTest",
    "S7_SZLCapabilityTestTimes",
    "S7_SZLProtection",
    "S7_SZLStatusBlocks",
    "S7_SZLStatusDiagnostics",
    "S7_SZLStatusGeneral",
    "S7_SZLStatusMeters",
    "S7_SZLStatusMeters2",
    "S7_SZLStatusTest",
    "S7_SZLStatusTime",
]


class S7_SZLCapabilityGeneral(S7_Part):
    """Communication unit: general."""

    name = "S7 communication unit: general"
    layout = szl_communication.CAPABILITY_RECORDS[1]
    fields_desc = header_fields(szl_communication.CAPABILITY_RECORDS[1], {"index": 1})


class S7_SZLCapabilityTest(S7_Part):
    """Communication unit: test and installation."""

    name = "S7 communication unit: test and installation"
    layout = szl_communication.CAPABILITY_RECORDS[2]
    fields_desc = header_fields(szl_communication.CAPABILITY_RECORDS[2], {"index": 2})


class S7_SZLCapabilityOperator(S7_Part):
    """Communication unit: operator functions."""

    name = "S7 communication unit: operator functions"
    layout = szl_communication.CAPABILITY_RECORDS[3]
    fields_desc = header_fields(szl_communication.CAPABILITY_RECORDS[3], {"index": 3})


class S7_SZLCapabilityObjects(S7_Part):
    """Communication unit: object management."""

    name = "S7 communication unit: object management"
    layout = szl_communication.CAPABILITY_RECORDS[4]
    fields_desc = header_fields(szl_communication.CAPABILITY_RECORDS[4], {"index": 4})


class S7_SZLCapabilityDiagnostics(S7_Part):
    """Communication unit: diagnostics."""

    name = "S7 communication unit: diagnostics"
    layout = szl_communication.CAPABILITY_RECORDS[5]
    fields_desc = header_fields(szl_communication.CAPABILITY_RECORDS[5], {"index": 5})


class S7_SZLCapabilityBlocks(S7_Part):
    """Communication unit: communication function blocks."""

    name = "S7 communication unit: communication function blocks"
    layout = szl_communication.CAPABILITY_RECORDS[6]
    fields_desc = header_fields(szl_communication.CAPABILITY_RECORDS[6], {"index": 6})


class S7_SZLCapabilityGlobalData(S7_Part):
    """Communication unit: global data."""

    name = "S7 communication unit: global data"
    layout = szl_communication.CAPABILITY_RECORDS[7]
    fields_desc = header_fields(szl_communication.CAPABILITY_RECORDS[7], {"index": 7})


class S7_SZLCapabilityTestTimes(S7_Part):
    """Communication unit: times of test and installation."""

    name = "S7 communication unit: times of test and installation"
    layout = szl_communication.CAPABILITY_RECORDS[8]
    fields_desc = header_fields(szl_communication.CAPABILITY_RECORDS[8], {"index": 8})


class S7_SZLCapabilityClock(S7_Part):
    """Communication unit: clock."""

    name = "S7 communication unit: clock"
    layout = szl_communication.CAPABILITY_RECORDS[9]
    fields_desc = header_fields(szl_communication.CAPABILITY_RECORDS[9], {"index": 9})


class S7_SZLCapabilityMessages(S7_Part):
    """Communication unit: messages."""

    name = "S7 communication unit: messages"
    layout = szl_communication.CAPABILITY_RECORDS[16]
    fields_desc = header_fields(szl_communication.CAPABILITY_RECORDS[16], {"index": 16})


class S7_SZLProtection(S7_Part):
    """Protection of the CPU: the levels, the switch, what tells versions apart."""

    name = "S7 communication section: protection"
    layout = szl_communication.PROTECTION
    fields_desc = header_fields(szl_communication.PROTECTION, {"index": 4})


class S7_SZLStatusGeneral(S7_Part):
    """Communication section: general."""

    name = "S7 communication section: general"
    layout = szl_communication.STATUS_RECORDS[1]
    fields_desc = header_fields(szl_communication.STATUS_RECORDS[1], {"index": 1})


class S7_SZLStatusTest(S7_Part):
    """Communication section: test and installation."""

    name = "S7 communication section: test and installation"
    layout = szl_communication.STATUS_RECORDS[2]
    fields_desc = header_fields(szl_communication.STATUS_RECORDS[2], {"index": 2})


class S7_SZLStatusDiagnostics(S7_Part):
    """Communication section: diagnostics."""

    name = "S7 communication section: diagnostics"
    layout = szl_communication.STATUS_RECORDS[5]
    fields_desc = header_fields(szl_communication.STATUS_RECORDS[5], {"index": 5})


class S7_SZLStatusBlocks(S7_Part):
    """Communication section: data exchange."""

    name = "S7 communication section: data exchange"
    layout = szl_communication.STATUS_RECORDS[6]
    fields_desc = header_fields(szl_communication.STATUS_RECORDS[6], {"index": 6})


class S7_SZLStatusTime(S7_Part):
    """Communication section: time system."""

    name = "S7 communication section: time system"
    layout = szl_communication.STATUS_RECORDS[8]
    fields_desc = header_fields(szl_communication.STATUS_RECORDS[8], {"index": 8})


class S7_SZLStatusMeters(S7_Part):
    """Communication section: run-time meters 0 to 7."""

    name = "S7 communication section: run-time meters 0 to 7"
    layout = szl_communication.STATUS_RECORDS[11]
    fields_desc = header_fields(szl_communication.STATUS_RECORDS[11], {"index": 11})


class S7_SZLStatusMeters2(S7_Part):
    """Communication section: run-time meters 8 to 15."""

    name = "S7 communication section: run-time meters 8 to 15"
    layout = szl_communication.STATUS_RECORDS[12]
    fields_desc = header_fields(szl_communication.STATUS_RECORDS[12], {"index": 12})
