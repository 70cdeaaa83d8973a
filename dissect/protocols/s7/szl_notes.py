"""Notes about system status lists and their records, as text (reference section 4.5).

The meaning of an index, and of the bits of racks and stations, comes from the Siemens manual of system and standard functions.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.diagnostics import DIAGNOSTIC_EVENT, event_name, event_note
from dissect.protocols.s7.szl_communication import CAPABILITY_RECORDS, PROTECTION, STATUS_RECORDS
from dissect.protocols.s7.szl_modules import (
    DP_MASTER,
    DP_MASTER_EXTENDED,
    MANY_STATIONS,
    MODULE_DIAGNOSTICS,
    MODULE_STATUS,
    STATIONS,
    SUBMODULE_STATUS,
)
from dissect.protocols.s7.szl_records import (
    BLOCK_TYPE,
    CHARACTERISTIC,
    ETHERNET,
    IDENTIFICATION,
    LED,
    MEMORY_AREA,
    OPERATING_MODE,
    RECORD,
    SYSTEM_AREA,
    SZL_ID,
    version_text,
)
from dissect.protocols.s7.szl_tables import HEAD_ONLY, INDEXES, MODULE_CLASSES, STATION_STATES, SZL_IDS
from dissect.wire.part import Part
from dissect.wire.text import hex_number

#: Lists of small records that only have a meaning together; these records get no note.
_PLAIN: Final = (SZL_ID, CHARACTERISTIC, RECORD)

_GENERAL_CAPABILITY: Final = CAPABILITY_RECORDS[0x01]
_GENERAL_STATUS: Final = STATUS_RECORDS[0x01]
_TIME_STATUS: Final = STATUS_RECORDS[0x08]

_BY_ADDRESS: Final = 0xC
_OF_PLACE: Final = 0xD
#: PROFINET IO systems are numbered from here on; the place of a module only has the number minus this.
_IO_SYSTEMS: Final = 100
_IO_SYSTEM: Final = 0x8000
_OUTPUT: Final = 0x8000
#: Versions of modules are small; larger values, such as blanks and other fill values of some servers, are not versions.
_LAST_VERSION: Final = 0xFF
#: The logical address of a module that has none.
_NO_ADDRESS: Final = 0x7FFF

#: Conditions of a module that its note mentions, in this order (lists 0x91 and 0x96).
_FAULTS: Final = (
    ("error", "faulty"),
    ("disrupted", "faulty"),
    ("not_available", "not available"),
    ("disabled", "disabled"),
    ("station_error", "station faulty"),
    ("station_problem", "station faulty"),
    ("cir_busy", "being changed in RUN"),
    ("cir_active", "being changed in RUN"),
    ("maintenance_demanded", "maintenance demanded"),
    ("maintenance_required", "maintenance required"),
)
#: Fields of diagnostic data that are not faults, or that the note handles in another way.
_NO_FAULTS: Final = frozenset(
    ("module_class", "module_fault", "channel_information", "user_information", "maintenance", "maintenance_too")
)


def module_class(szl_id: int) -> int:
    """Return the kind of module that a list is about (`MODULE_CLASSES`)."""
    return szl_id >> 12


def extract(szl_id: int) -> int:
    """Return the extract that an id requests, 0xF for the head only."""
    return (szl_id >> 8) & 0xF


def list_note(szl_id: int, index: int) -> str:
    """Return the text for a list, for example ``SZL 0x0131 communication capability, general``."""
    told = f"SZL {hex_number(szl_id, 4)}"
    row = SZL_IDS.get(szl_id)
    if row is not None:
        told += f" {row.name}"
    if module_class(szl_id):
        told += f" ({MODULE_CLASSES.name(module_class(szl_id))})"
    part = extract(szl_id)
    if part == HEAD_ONLY:
        told += ", head only"
    else:
        picked = _picked(szl_id & 0xFF, part, index) if index or not module_class(szl_id) else ""
        if picked:
            return f"{told}, {picked}"
    return f"{told}, index {hex_number(index, 4)}" if index else told


def _picked(partial: int, part: int, index: int) -> str:
    """Return what an index selects from a list; empty if it selects nothing or the meaning is unknown."""
    if partial in {0x92, 0x94}:
        return system_text(index)
    if partial == 0x91 and part == _OF_PLACE:
        return _station(index)
    if index == 0:
        return ""
    table = INDEXES.get(partial)
    if table is not None:
        return table.name(index) if part != 0 and index in table else ""
    if partial == 0x22 and part == 0x2:
        return f"OB {index}"
    if partial == 0x91 and part == 0x9:
        return system_text(index >> 8)
    if partial in {0x90, 0x95} and part == 0x1:
        return system_text(index)
    if partial == 0xA0 and part == 0x1:
        return f"newest {index}"
    if partial == 0xB2:
        return f"rack {index >> 8} slot {index & 0xFF}"
    if partial in {0xB1, 0xB3} or (partial == 0x91 and part == _BY_ADDRESS) or partial == 0x96:
        return f"{'output' if index & _OUTPUT else 'input'} address {index & ~_OUTPUT}"
    return ""


def system_text(number: int) -> str:
    """Return the text for the number of a system: the racks of the CPU, a DP master system, or a PROFINET IO system."""
    if number == 0:
        return "central racks"
    return f"{'PROFINET IO' if number >= _IO_SYSTEMS else 'DP master'} system {number}"


def _station(place: int) -> str:
    """Return the text for a rack or station number of the lists of modules."""
    if place & _IO_SYSTEM:
        return f"{system_text(_IO_SYSTEMS + (place >> 11 & 0xF))} station {place & 0x7FF}"
    return f"{system_text(place >> 8)} station {place & 0xFF}" if place >> 8 else f"rack {place}"


def record_note(part: Part, szl_id: int, index: int) -> str:
    """Return a note for a record of a list; empty if no note would be shorter than the record."""
    layout = part.layout
    if layout in _PLAIN:
        return ""
    if layout is DIAGNOSTIC_EVENT:
        return event_note(part)
    if layout is IDENTIFICATION:
        return _identification(part)
    if layout is LED:
        return _led(part)
    if layout is OPERATING_MODE:
        return _operating_mode(part)
    if layout is PROTECTION:
        level = part.text("level") or str(part.number("level"))
        return f"protection {part.number('level')} ({level}), switch {part.text('switch')}"
    if layout is ETHERNET:
        return f"{part.text('ip_address')}, {part.text('mac_address')}"
    if layout is STATIONS:
        return _stations(part, szl_id, index, False)
    if layout is MANY_STATIONS:
        return _stations(part, szl_id, max(0, part.number("index")), True)
    if layout is MODULE_STATUS:
        return _module(part)
    if layout is SUBMODULE_STATUS:
        return _submodule(part)
    if layout is MODULE_DIAGNOSTICS:
        return _diagnostics(part)
    return _communication(part) or _counted(part)


def _communication(part: Part) -> str:
    """Return the note of a communication list's record: numbers of connections, and the time of day."""
    layout = part.layout
    if layout is _GENERAL_CAPABILITY and part.number("connections") >= 0:
        return f"PDU length {part.number('pdu_length')}, at most {part.number('connections')} connections"
    if layout is _GENERAL_STATUS and part.number("free_used") >= 0:
        used = ", ".join(
            [
                f"{part.number(field)} {said}"
                for field, said in (
                    ("pg_used", "of programming devices"),
                    ("os_used", "of operator stations"),
                    ("configured_open", "configured"),
                    ("free_used", "others"),
                )
            ]
        )
        return f"open connections: {used}"
    if layout is _TIME_STATUS and part.text("time"):
        return f"time of day {part.text('time')}"
    return ""


def _counted(part: Part) -> str:
    """Return the note of a record with a number of something or a text."""
    layout = part.layout
    if layout is MEMORY_AREA:
        return f"{_name(part, 'index')} {part.number('memory_size')} bytes"
    if layout is SYSTEM_AREA:
        return f"{_name(part, 'index')} {part.number('quantity')}"
    if layout is BLOCK_TYPE:
        return f"{_name(part, 'index')}: at most {part.number('blocks')}"
    if layout is DP_MASTER or layout is DP_MASTER_EXTENDED:
        return system_text(max(0, part.number("system_id")))
    text = part.text("text")
    if text:
        return f"{_name(part, 'index')} {text}"
    return _name(part, "index") if part.find("index") is not None else ""


def _name(part: Part, field: str) -> str:
    """Return the meaning of a field, or its number."""
    return part.text(field) or hex_number(max(0, part.number(field)), 4)


def _identification(part: Part) -> str:
    """Return the order number and the version, for example ``6ES7 315-2EH14-0AB0, basic firmware V3.2.6``.

    If the version is not a letter with a number, the octets after it are not part of the module's version: they are reserved,
    or the release of a file of the programming device.
    """
    number = part.text("order_number")
    version = part.number("version")
    release = part.number("release")
    told = _name(part, "index")
    major = version_text(version) if version > 0 else ""
    if major and release >= 0:
        told += f" {major}.{release >> 8}.{release & 0xFF}"
    elif 0 < version <= _LAST_VERSION:
        told += f" version {version}"
    return f"{number}, {told}" if number else told


def _led(part: Part) -> str:
    """Return an LED and its state, for example ``RUN on``."""
    flashing = part.number("flashing")
    state = _name(part, "state")
    return f"{_name(part, 'led')} {state}" + (f", {_name(part, 'flashing')}" if flashing > 0 else "")


def _operating_mode(part: Part) -> str:
    """Return the mode and its origin, for example ``RUN, before: STARTUP, event 0x4302 STARTUP to RUN``."""
    event = part.number("event")
    told = part.text("mode") or f"mode {part.number('mode')}"
    if part.number("previous") > 0:
        told += f", before: {_name(part, 'previous')}"
    return f"{told}, event {hex_number(event, 4)} {event_name(event)}" if event > 0 else told


def _stations(part: Part, szl_id: int, system: int, group: bool) -> str:
    """Return which racks or stations have the state that a list describes, for example ``available: stations 1, 3``.

    Bit 0 is the central rack or station 1. With ``group`` information before the bits, these are further on.
    """
    octets = part.octets("stations")
    first = (0 if system == 0 else 1) - (1 if group else 0)
    numbers = [8 * at + bit for at, octet in enumerate(octets) for bit in range(8) if octet >> bit & 1]
    said = [str(first + number) for number in numbers if number or not group]
    kind = "rack" if system == 0 else "station"
    told = f"{kind}{'s' if len(said) > 1 else ''} {', '.join(said)}" if said else "none"
    state = STATION_STATES.get(extract(szl_id))
    return f"{state.name}: {told}" if state is not None else told


def _module(part: Part) -> str:
    """Return place and state of a module, for example ``rack 0 slot 4 (input address 256): ok``."""
    slot = part.number("slot")
    if slot < 0:
        return ""
    place = part.number("place")
    if place & _IO_SYSTEM:
        told = f"{_station(place)} slot {slot}"
    else:
        inner = f" interface module {slot & 0xFF}" if slot & 0xFF else ""
        told = f"{_station(place)} slot {slot >> 8}{inner}"
    address = part.number("address")
    if 0 <= address != _NO_ADDRESS:
        kind = part.text("address_kind")
        told += f" ({kind} address {address})" if kind in {"input", "output"} else f" (address {address})"
    return f"{told}: {_state(part)}" if part.find("exists") is not None else told


def _submodule(part: Part) -> str:
    """Return place and state of a submodule."""
    if part.number("subslot") < 0:
        return ""
    system, station = part.number("system"), part.number("station")
    told = f"{system_text(system)} station {station}" if system else f"rack {station}"
    inner = f" subslot {part.number('subslot')}" if part.number("subslot") else ""
    told += f" slot {part.number('slot')}{inner}"
    return f"{told}: {_state(part)}" if part.find("exists") is not None else told


def _state(part: Part) -> str:
    """Return the state of a module."""
    faults = [said for field, said in _FAULTS if part.number(field) > 0]
    if faults:
        return ", ".join(faults)
    return "ok" if part.number("exists") > 0 else "no module"


def _diagnostics(part: Part) -> str:
    """Return a text for the diagnostic data of a module, for example ``analog module: external fault, fuse blown``."""
    kind = part.text("module_class")
    said = [value.field.name for value in part.values if value.value and value.field.name not in _NO_FAULTS]
    if part.number("maintenance") > 0 or part.number("maintenance_too") > 0:
        said.append("maintenance_required")
    told = ", ".join(said).replace("_", " ") or "no fault"
    return f"{kind}: {told}" if kind else told
