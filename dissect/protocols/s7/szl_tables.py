"""System status lists (SZL): ids, partial lists, and the meaning of their indexes (reference section 4.5).

The ids are from the table of the reference, which names Wireshark as their source. The codes in records are from the Siemens
manual of system and standard functions, chapter "System status lists".
"""

from __future__ import annotations

from typing import Final

from dissect.wire.codes import Code, CodeTable

#: The extract (bits 11-8 of an id) that is answered with the head only.
HEAD_ONLY: Final = 0xF

#: The kind of module that the list describes (bits 15-12 of an id).
MODULE_CLASSES: Final = CodeTable(
    "SZL module class",
    1,
    [
        (0x0, "CPU", ""),
        (0x4, "IM", "Interface module."),
        (0x8, "FM", "Function module."),
        (0xC, "CP", "Communication processor."),
    ],
)

#: Partial lists (bits 7-0 of an id).
PARTIAL_LISTS: Final = CodeTable(
    "SZL partial list",
    2,
    [
        (0x00, "list of available SZL ids", ""),
        (0x11, "module identification", ""),
        (0x12, "CPU characteristics", ""),
        (0x13, "user memory areas", ""),
        (0x14, "system areas", ""),
        (0x15, "block types", ""),
        (0x16, "priority classes", ""),
        (0x17, "permitted SDBs below 1000", ""),
        (0x18, "maximum S7-300 I/O configuration", ""),
        (0x19, "status of module LEDs", ""),
        (0x1C, "component identification", ""),
        (0x21, "interrupt and error assignment", ""),
        (0x22, "interrupt status", ""),
        (0x23, "priority class status", ""),
        (0x24, "operating modes", ""),
        (0x25, "process image partitions and their OBs", ""),
        (0x31, "communication capability", ""),
        (0x32, "communication status", ""),
        (0x33, "stations logged on for diagnostics", ""),
        (0x37, "Ethernet interface details", ""),
        (0x71, "H CPU group information", ""),
        (0x74, "status of module LEDs", ""),
        (0x75, "switched DP slaves of an H system", ""),
        (0x81, "start information list", ""),
        (0x82, "start event list", ""),
        (0x90, "DP master system information", ""),
        (0x91, "module status", ""),
        (0x92, "rack and station status", ""),
        (0x94, "rack and station status (PROFIBUS DP and PROFINET)", ""),
        (0x95, "extended DP master and PROFINET IO system information", ""),
        (0x96, "module status, PROFINET IO and PROFIBUS DP", ""),
        (0xA0, "diagnostic buffer of the CPU", ""),
        (0xB1, "module diagnostics, data record 0", ""),
        (0xB2, "module diagnostics, data record 1, by rack and slot", ""),
        (0xB3, "module diagnostics, data record 1, by logical address", ""),
        (0xB4, "diagnostics of a DP slave", ""),
    ],
)


class SzlIds(CodeTable):
    """Ids of lists. An id without its own row still gets the name of its partial list."""

    __slots__ = ()

    def get(self, number: int) -> Code | None:
        """Return the row of ``number``, or one made from its partial list; None if that is unknown, too."""
        row = super().get(number)
        if row is not None:
            return row
        partial = PARTIAL_LISTS.get(number & 0xFF)
        if partial is None:
            return None
        text = _HEAD_ONLY if (number >> 8) & 0xF == HEAD_ONLY else ""
        return Code(number, partial.name, text)

    def name(self, number: int) -> str:
        """Return the name of ``number``; the number itself if it is unknown."""
        row = self.get(number)
        return row.name if row is not None else self.hex(number)

    def text(self, number: int) -> str:
        """Return the sentence of ``number``; empty if there is none."""
        row = self.get(number)
        return row.text if row is not None else ""


_HEAD_ONLY: Final = "List header only (record length and count, no records)."

#: Ids of lists: the name is that of the partial list, the sentence describes the extract.
SZL_IDS: Final = SzlIds(
    "SZL id",
    4,
    [
        (0x0000, "list of available SZL ids", "All SZL ids of the module."),
        (0x0011, "module identification", "All identification records."),
        (0x0012, "CPU characteristics", "All characteristics."),
        (0x0013, "user memory areas", "All memory areas."),
        (0x0014, "system areas", "All system areas."),
        (0x0015, "block types", "All block types."),
        (0x0016, "priority classes", "All priority classes."),
        (0x0017, "permitted SDBs below 1000", "All SDBs."),
        (0x0018, "maximum S7-300 I/O configuration", "All I/O configuration records."),
        (0x0019, "status of module LEDs", "All LEDs."),
        (0x001C, "component identification", "All components."),
        (0x0021, "interrupt and error assignment", "All possible interrupts."),
        (0x0022, "interrupt status", "All possible interrupts."),
        (0x0023, "priority class status", "All priority classes."),
        (0x0024, "operating modes", "All possible modes."),
        (0x0031, "communication capability", "Not defined."),
        (0x0033, "stations logged on for diagnostics", "All logged-on stations."),
        (0x0037, "Ethernet interface details", "All Ethernet interfaces."),
        (0x0071, "H CPU group information", "Current status of the H system."),
        (0x0074, "status of module LEDs", "All LEDs."),
        (0x0081, "start information list", "Start information of all OBs."),
        (0x0082, "start event list", "All start events."),
        (0x0090, "DP master system information", "All DP master systems known."),
        (0x0091, "module status", "All plugged modules and submodules."),
        (
            0x0092,
            "rack and station status",
            "Expected status, central racks and stations of an integrated DP interface.",
        ),
        (
            0x0094,
            "rack and station status (PROFIBUS DP and PROFINET)",
            "Expected status, central rack and stations of an integrated DP/PN interface.",
        ),
        (
            0x0095,
            "extended DP master and PROFINET IO system information",
            "Extended information on one DP or PROFINET IO system.",
        ),
        (0x00A0, "diagnostic buffer of the CPU", "All entries possible in the current mode."),
        (0x00B1, "module diagnostics, data record 0", "First four diagnostic bytes of a module."),
        (
            0x00B2,
            "module diagnostics, data record 1, by rack and slot",
            "Data record 1 of a central module, by rack and slot.",
        ),
        (
            0x00B3,
            "module diagnostics, data record 1, by logical address",
            "Diagnostics of a module, by logical base address.",
        ),
        (0x00B4, "diagnostics of a DP slave", "Diagnostics of a DP slave, by diagnostic address."),
        (0x0100, "list of available SZL ids", "One partial list with all extracts."),
        (0x0111, "module identification", "One identification record."),
        (0x0112, "CPU characteristics", "One group of characteristics, by index."),
        (0x0113, "user memory areas", "One memory area, by index."),
        (0x0114, "system areas", "One system area, by index."),
        (0x0115, "block types", "One block type, by index."),
        (0x0116, "priority classes", "One priority class, by index."),
        (0x0117, "permitted SDBs below 1000", "One SDB, by index."),
        (0x0118, "maximum S7-300 I/O configuration", "One record, by index."),
        (0x0119, "status of module LEDs", "One LED, by index."),
        (0x011C, "component identification", "One component."),
        (0x0121, "interrupt and error assignment", "Interrupts of one class, by index."),
        (0x0122, "interrupt status", "Interrupts of one class, by index."),
        (0x0123, "priority class status", "One priority class, by index."),
        (0x0124, "operating modes", "Last mode transition."),
        (0x0131, "communication capability", "One communication unit, by index."),
        (0x0132, "communication status", "Status of one communication section, by index."),
        (0x0137, "Ethernet interface details", "One Ethernet interface."),
        (0x0174, "status of module LEDs", "One LED, by index."),
        (0x0181, "start information list", "Start information of all synchronous error OBs."),
        (0x0182, "start event list", "Start events of all synchronous error OBs."),
        (0x0190, "DP master system information", "One DP master system."),
        (0x0191, "module status", "Modules and racks with a wrong type identifier."),
        (0x01A0, "diagnostic buffer of the CPU", "The most recent n entries, n in the index."),
        (0x0200, "list of available SZL ids", "One extract of a partial list."),
        (0x021C, "component identification", "All components of one CPU in an H system."),
        (0x0221, "interrupt and error assignment", "One interrupt, OB number in the index."),
        (0x0222, "interrupt status", "One interrupt, OB number in the index."),
        (0x0223, "priority class status", "Priority classes being processed."),
        (0x0224, "operating modes", "Mode transition that was processed."),
        (0x0232, "communication status", "Protection level and version ids, as 0x0132 with index 4."),
        (0x0281, "start information list", "Start information, synchronous error OBs of one priority class."),
        (0x0282, "start event list", "Start events, synchronous error OBs of one priority class."),
        (0x0291, "module status", "All faulty modules."),
        (0x0292, "rack and station status", "Actual status, central racks and stations of an integrated DP interface."),
        (
            0x0294,
            "rack and station status (PROFIBUS DP and PROFINET)",
            "Actual status, central rack and stations of an integrated DP/PN interface.",
        ),
        (0x0300, "list of available SZL ids", "Possible indexes of one extract."),
        (0x031C, "component identification", "One component of all redundant CPUs."),
        (0x0381, "start information list", "Start information, all OBs of one priority class."),
        (0x0382, "start event list", "Start events, all OBs of one priority class."),
        (0x0391, "module status", "Modules not available."),
        (0x0392, "rack and station status", "Battery state of the central racks."),
        (0x0424, "operating modes", "Current mode transition (RUN or STOP)."),
        (0x0492, "rack and station status", "Total backup state of the central racks."),
        (0x04A0, "diagnostic buffer of the CPU", "Start information of all standard OBs."),
        (0x0524, "operating modes", "One mode transition, by index."),
        (0x0581, "start information list", "Start information, synchronous error OBs before processing."),
        (0x0582, "start event list", "Start events, synchronous error OBs before processing."),
        (0x0591, "module status", "All submodules of the host module."),
        (0x0592, "rack and station status", "24 V supply state of the modules in the central racks."),
        (0x05A0, "diagnostic buffer of the CPU", "Entries from communication units."),
        (0x0681, "start information list", "As 0x0581 for one priority class."),
        (0x0682, "start event list", "As 0x0582 for one priority class."),
        (0x0692, "rack and station status", "OK state of expansion racks and stations."),
        (
            0x0694,
            "rack and station status (PROFIBUS DP and PROFINET)",
            "Status of expansion racks and stations of a DP/PN interface.",
        ),
        (0x0696, "module status, PROFINET IO and PROFIBUS DP", "Status of all interface modules of a module."),
        (0x06A0, "diagnostic buffer of the CPU", "Entries of the object management system."),
        (0x0781, "start information list", "Start information, OBs of one priority class before processing."),
        (0x0782, "start event list", "Start events, OBs of one priority class before processing."),
        (0x07A0, "diagnostic buffer of the CPU", "Entries of the test and installation functions."),
        (0x0822, "interrupt status", "Interrupts of one class whose OB is loaded."),
        (0x0881, "start information list", "Start information of all OBs before processing."),
        (0x0882, "start event list", "Start events of all OBs before processing."),
        (0x08A0, "diagnostic buffer of the CPU", "Entries caused by operating states."),
        (0x0921, "interrupt and error assignment", "Interrupts of one class whose OB is loaded."),
        (0x0922, "interrupt status", "Interrupts whose OB is loaded."),
        (0x0981, "start information list", "Start information, synchronous error OBs being processed."),
        (0x0982, "start event list", "Start events, synchronous error OBs being processed."),
        (0x0991, "module status", "Modules of one DP master system."),
        (0x09A0, "diagnostic buffer of the CPU", "Entries caused by asynchronous errors."),
        (0x0A21, "interrupt and error assignment", "Interrupts whose OB is loaded."),
        (0x0A81, "start information list", "As 0x0981 for one priority class."),
        (0x0A82, "start event list", "As 0x0982 for one priority class."),
        (0x0A91, "module status", "Modules of all DP master systems."),
        (0x0AA0, "diagnostic buffer of the CPU", "Entries caused by synchronous errors."),
        (0x0B81, "start information list", "Start information, OBs of one priority class being processed."),
        (0x0B82, "start event list", "Start events, OBs of one priority class being processed."),
        (0x0BA0, "diagnostic buffer of the CPU", "Entries caused by STOP, abort or mode transition."),
        (0x0C75, "switched DP slaves of an H system", "Communication status of one switched DP slave."),
        (0x0C81, "start information list", "Start information of all OBs being processed."),
        (0x0C82, "start event list", "Start events of all OBs being processed."),
        (0x0C91, "module status", "One module, by logical base address."),
        (0x0C96, "module status, PROFINET IO and PROFIBUS DP", "One module or interface module, by start address."),
        (0x0CA0, "diagnostic buffer of the CPU", "Entries of fault-tolerant and fail-safe events."),
        (0x0D91, "module status", "All modules of one rack or station."),
        (0x0DA0, "diagnostic buffer of the CPU", "All diagnostic entries."),
        (0x0E91, "module status", "All configured modules."),
        (0x0EA0, "diagnostic buffer of the CPU", "All user entries."),
        (0x0F00, "list of available SZL ids", _HEAD_ONLY),
        (0x0F11, "module identification", _HEAD_ONLY),
        (0x0F12, "CPU characteristics", _HEAD_ONLY),
        (0x0F13, "user memory areas", _HEAD_ONLY),
        (0x0F14, "system areas", _HEAD_ONLY),
        (0x0F15, "block types", _HEAD_ONLY),
        (0x0F16, "priority classes", _HEAD_ONLY),
        (0x0F17, "permitted SDBs below 1000", _HEAD_ONLY),
        (0x0F18, "maximum S7-300 I/O configuration", _HEAD_ONLY),
        (0x0F19, "status of module LEDs", _HEAD_ONLY),
        (0x0F1C, "component identification", _HEAD_ONLY),
        (0x0F21, "interrupt and error assignment", _HEAD_ONLY),
        (0x0F22, "interrupt status", _HEAD_ONLY),
        (0x0F23, "priority class status", _HEAD_ONLY),
        (0x0F24, "operating modes", _HEAD_ONLY),
        (0x0F31, "communication capability", _HEAD_ONLY),
        (0x0F32, "communication status", _HEAD_ONLY),
        (0x0F33, "stations logged on for diagnostics", _HEAD_ONLY),
        (0x0F37, "Ethernet interface details", _HEAD_ONLY),
        (0x0F71, "H CPU group information", _HEAD_ONLY),
        (0x0F81, "start information list", _HEAD_ONLY),
        (0x0F82, "start event list", _HEAD_ONLY),
        (0x0F90, "DP master system information", _HEAD_ONLY),
        (0x0F91, "module status", _HEAD_ONLY),
        (0x0F92, "rack and station status", _HEAD_ONLY),
        (0x0F94, "rack and station status (PROFIBUS DP and PROFINET)", _HEAD_ONLY),
        (0x0F95, "extended DP master and PROFINET IO system information", _HEAD_ONLY),
        (0x0FA0, "diagnostic buffer of the CPU", _HEAD_ONLY),
        (0x4092, "rack and station status", "Expected status, stations of an external DP interface."),
        (0x4292, "rack and station status", "Actual status, stations of an external DP interface."),
        (0x4692, "rack and station status", "OK state, stations of an external DP interface."),
        (0x4C91, "module status", "One module at an external DP processor."),
        (0x4F92, "rack and station status", "List header of 0x4x92 only."),
    ],
)

#: The subject of an identification record (list 0x11).
IDENTIFICATIONS: Final = CodeTable(
    "identification",
    4,
    [
        (0x0001, "module", "Identification of the module."),
        (0x0006, "basic hardware", "Identification of the basic hardware."),
        (0x0007, "basic firmware", "Identification of the basic firmware."),
        (0x0081, "firmware extension", "Identification of the firmware extension; the boot loader on some CPUs."),
    ],
)

#: Characteristics of a CPU (list 0x12); the index selects a group of them.
CHARACTERISTICS: Final = CodeTable(
    "CPU characteristic",
    4,
    [
        (0x0000, "MC7 processing", "Group."),
        (0x0001, "MC7 code is generated", ""),
        (0x0002, "MC7 code is interpreted", ""),
        (0x0100, "time system", "Group."),
        (0x0101, "resolution 1 ms", ""),
        (0x0102, "resolution 10 ms", ""),
        (0x0103, "no real-time clock", ""),
        (0x0104, "time of day in BCD", ""),
        (0x0105, "all time-of-day functions", "Set, read and synchronise as master and as slave."),
        (0x0106, "SFC 78 OB_RT", ""),
        (0x0200, "system behaviour", "Group."),
        (0x0201, "multiprocessor mode", ""),
        (0x0202, "cold, warm and hot restart", ""),
        (0x0203, "cold and hot restart", ""),
        (0x0204, "warm and hot restart", ""),
        (0x0205, "warm restart only", ""),
        (0x0206, "distributed I/O can be added in RUN", "Within resources reserved before."),
        (0x0207, "distributed I/O can be added in RUN, H CPU alone", "Within resources reserved before."),
        (0x0208, "motion control", ""),
        (0x0300, "instruction set", "Group."),
        (0x0302, "32-bit fixed-point instructions", ""),
        (0x0303, "floating-point instructions", ""),
        (0x0304, "transcendental functions", "Trigonometry, square root, logarithm, exponential."),
        (0x0305, "accumulators 3 and 4", "With ENT, PUSH, POP and LEAVE."),
        (0x0306, "master control relay", ""),
        (0x0307, "address register 1", ""),
        (0x0308, "address register 2", ""),
        (0x0309, "area-crossing addressing", ""),
        (0x030A, "area-internal addressing", ""),
        (0x030B, "memory-indirect addressing of bit memory", ""),
        (0x030C, "memory-indirect addressing of DB", ""),
        (0x030D, "memory-indirect addressing of DI", ""),
        (0x030E, "memory-indirect addressing of local data", ""),
        (0x030F, "parameter transfer in FCs", ""),
        (0x0310, "edge instructions on inputs", ""),
        (0x0311, "edge instructions on outputs", ""),
        (0x0312, "edge instructions on bit memory", ""),
        (0x0313, "edge instructions on DB", ""),
        (0x0314, "edge instructions on DI", ""),
        (0x0315, "edge instructions on local data", ""),
        (0x0316, "FC bit evaluated dynamically", ""),
        (0x0317, "dynamic local data area", ""),
        (0x0401, "SFC 87 C_DIAG", ""),
        (0x0402, "SFC 88 C_CNTRL", ""),
    ],
)

#: User memory areas (list 0x13).
MEMORY_AREAS: Final = CodeTable(
    "memory area",
    4,
    [
        (1, "work memory", ""),
        (2, "load memory, integrated", ""),
        (3, "load memory, plugged in", ""),
        (4, "largest load memory that can be plugged in", ""),
        (5, "backup memory", ""),
        (6, "memory reserved for communication blocks", ""),
    ],
)

#: Kinds of memory (lists 0x13 and 0x14).
MEMORY_KINDS: Final = CodeTable(
    "memory kind",
    4,
    [
        (1, "RAM", "Volatile memory."),
        (2, "FEPROM", "Non-volatile memory."),
        (3, "RAM and FEPROM", "Mixed memory."),
    ],
)

#: System areas (list 0x14).
SYSTEM_AREAS: Final = CodeTable(
    "system area",
    4,
    [
        (1, "process image of inputs", "In bytes."),
        (2, "process image of outputs", "In bytes."),
        (3, "bit memory", "In bits."),
        (4, "timers", ""),
        (5, "counters", ""),
        (6, "logical address area", "In bytes."),
        (7, "local data", "Of the whole CPU, in bytes."),
        (8, "bit memory bytes", "In bytes."),
        (9, "local data, large", "Of the whole CPU, in KiB."),
    ],
)

#: Block types in the form used by the list of block types (0x15).
SZL_BLOCK_TYPES: Final = CodeTable(
    "block type in SZL 0x15",
    4,
    [
        (0x0800, "OB", "Organization block."),
        (0x0A00, "DB", "Data block."),
        (0x0B00, "SDB", "System data block."),
        (0x0C00, "FC", "Function."),
        (0x0E00, "FB", "Function block."),
    ],
)

#: Light-emitting diodes of a module (lists 0x19 and 0x74).
LEDS: Final = CodeTable(
    "LED",
    2,
    [
        (0x01, "SF", "Group error."),
        (0x02, "INTF", "Internal error."),
        (0x03, "EXTF", "External error."),
        (0x04, "RUN", ""),
        (0x05, "STOP", ""),
        (0x06, "FRCE", "Force."),
        (0x07, "CRST", "Cold restart."),
        (0x08, "BAF", "Battery fault, or the backup voltage on the bus is overloaded."),
        (0x09, "USR", "User-defined."),
        (0x0A, "USR1", "User-defined."),
        (0x0B, "BUS1F", "Bus error at interface 1."),
        (0x0C, "BUS2F", "Bus error at interface 2."),
        (0x0D, "REDF", "Redundancy error."),
        (0x0E, "MSTR", "Master."),
        (0x0F, "RACK0", "Rack number 0."),
        (0x10, "RACK1", "Rack number 1."),
        (0x11, "RACK2", "Rack number 2."),
        (0x12, "IFM1F", "Error at interface module 1."),
        (0x13, "IFM2F", "Error at interface module 2."),
        (0x14, "BUS3F", "Bus error at interface 3."),
        (0x15, "MAINT", "Maintenance wanted."),
        (0x16, "DC24V", "24 V supply."),
        (0x80, "IF", "Initialisation failure."),
        (0x81, "UF", "User failure."),
        (0x82, "MF", "Monitoring failure."),
        (0x83, "CF", "Communication failure."),
        (0x84, "TF", "Task failure."),
        (0xEC, "APPL_STATE_RED", ""),
        (0xED, "APPL_STATE_GREEN", ""),
    ],
)

#: Whether an LED is lit.
LED_STATES: Final = CodeTable("LED state", 2, [(0, "off", ""), (1, "on", "")])

#: Whether an LED flashes.
LED_FLASHING: Final = CodeTable(
    "LED flashing", 2, [(0, "steady", ""), (1, "flashing at 2 Hz", ""), (2, "flashing at 0.5 Hz", "")]
)

#: Component of list 0x1c.
COMPONENTS: Final = CodeTable(
    "component",
    4,
    [
        (0x0001, "name of the station", ""),
        (0x0002, "name of the module", ""),
        (0x0003, "plant designation", ""),
        (0x0004, "copyright", ""),
        (0x0005, "serial number", ""),
        (0x0007, "module type", ""),
        (0x0008, "serial number of the memory card", ""),
        (0x0009, "manufacturer and profile", ""),
        (0x000A, "OEM copyright and id", ""),
        (0x000B, "location designation", ""),
    ],
)

#: Units of the communication capability (list 0x31).
CAPABILITIES: Final = CodeTable(
    "communication unit",
    4,
    [
        (0x0001, "general", ""),
        (0x0002, "test and installation", ""),
        (0x0003, "operator functions", ""),
        (0x0004, "object management", ""),
        (0x0005, "diagnostics", ""),
        (0x0006, "communication function blocks", ""),
        (0x0007, "global data", ""),
        (0x0008, "times of test and installation", ""),
        (0x0009, "clock", ""),
        (0x0010, "messages", ""),
        (0x0011, "SCAN", ""),
    ],
)

#: Sections of the communication status (list 0x32).
STATUS_SECTIONS: Final = CodeTable(
    "communication section",
    4,
    [
        (0x0001, "general", ""),
        (0x0002, "test and installation", ""),
        (0x0003, "operator functions", ""),
        (0x0004, "protection", ""),
        (0x0005, "diagnostics", ""),
        (0x0006, "data exchange", ""),
        (0x0007, "global data", ""),
        (0x0008, "time system", ""),
        (0x0009, "MPI", ""),
        (0x000A, "communication bus", ""),
        (0x000B, "run-time meters 0 to 7", ""),
        (0x000C, "run-time meters 8 to 15", ""),
        (0x0010, "SCAN, first part", ""),
        (0x0011, "SCAN, second part", ""),
    ],
)

#: Protection levels (list 0x32 index 4).
PROTECTION_LEVELS: Final = CodeTable(
    "protection level",
    4,
    [
        (0, "no password", "The level of the switch holds."),
        (1, "none", "Nothing is protected."),
        (2, "write protection", "Writing needs the password."),
        (3, "read and write protection", "Reading and writing need the password."),
    ],
)

#: Positions of the mode switch (list 0x32 index 4).
SWITCH_POSITIONS: Final = CodeTable(
    "mode switch",
    4,
    [
        (0, "unknown", "Not defined or cannot be found out."),
        (1, "RUN", ""),
        (2, "RUN-P", ""),
        (3, "STOP", ""),
        (4, "MRES", "Memory reset."),
    ],
)

#: Positions of the start-up switch (list 0x32 index 4).
STARTUP_SWITCH: Final = CodeTable(
    "start-up switch",
    4,
    [
        (0, "unknown", "Not there, not defined or cannot be found out."),
        (1, "CRST", "Cold restart."),
        (2, "WRST", "Warm restart."),
    ],
)

#: No or yes, as a word of 16 bits.
NO_YES: Final = CodeTable("yes or no", 4, [(0, "no", ""), (1, "yes", "")])

#: Operating modes in the form used by a mode transition (list 0x24) and the H system (list 0x71).
OPERATING_MODES: Final = CodeTable(
    "operating mode",
    1,
    [
        (0x1, "STOP (update)", ""),
        (0x2, "STOP (memory reset)", ""),
        (0x3, "STOP (self-initialisation)", ""),
        (0x4, "STOP", ""),
        (0x5, "STARTUP", "Complete restart; cold restart in the newer list of the H system."),
        (0x6, "STARTUP (warm restart)", ""),
        (0x7, "STARTUP (hot restart)", ""),
        (0x8, "RUN", ""),
        (0x9, "RUN redundant", ""),
        (0xA, "HOLD", ""),
        (0xB, "LINK-UP", ""),
        (0xC, "UPDATE", ""),
        (0xD, "DEFECT", ""),
        (0xE, "SELFTEST", ""),
        (0xF, "NO POWER", ""),
    ],
)

#: Kinds of start-up (list 0x24: the last one and the permitted one).
STARTUP_KINDS: Final = CodeTable(
    "start-up kind",
    2,
    [
        (0x00, "none", "No kind of start-up."),
        (0x01, "complete restart in multicomputing", ""),
        (0x03, "complete restart by the switch", ""),
        (0x04, "complete restart by command", ""),
        (0x0A, "restart in multicomputing", ""),
        (0x0B, "restart by the switch", ""),
        (0x0C, "restart by command", ""),
        (0x10, "complete restart after buffered power-on", "Of its own accord."),
        (0x13, "complete restart by the switch, power-on was buffered", ""),
        (0x14, "complete restart by command, power-on was buffered", ""),
        (0x20, "complete restart after unbuffered power-on", "Of its own accord, memory reset by the system."),
        (0x23, "complete restart by the switch, power-on was not buffered", ""),
        (0x24, "complete restart by command, power-on was not buffered", ""),
        (0xA0, "restart after buffered power-on", "Of its own accord, as set in the parameters."),
    ],
)

#: Area of a module (lists 0x91 and 0x96).
MODULE_AREAS: Final = CodeTable(
    "module area",
    1,
    [
        (0, "S7-400", ""),
        (1, "S7-300", ""),
        (2, "ET area", ""),
        (3, "P area", ""),
        (4, "Q area", ""),
        (5, "IM3 area", ""),
        (6, "IM4 area", ""),
    ],
)

#: The meaning of the logical address of a module (list 0x91).
ADDRESS_KINDS: Final = CodeTable(
    "address kind", 2, [(0xB4, "input", ""), (0xB5, "output", ""), (0xFF, "external DP interface", "")]
)

#: Kind of a module that has diagnostic data (lists 0xB1 to 0xB3).
DIAGNOSED_MODULES: Final = CodeTable(
    "kind of module with diagnostics",
    1,
    [
        (0x0, "CPU", ""),
        (0x3, "DP standard slave", ""),
        (0x4, "IM", "Interface module."),
        (0x5, "analog module", ""),
        (0x8, "FM", "Function module."),
        (0xC, "CP", "Communication processor."),
        (0xF, "digital module", ""),
    ],
)

#: Meaning of a bit of a rack or station, by extract of the lists 0x92 and 0x94. No source at hand describes the bits for
#: batteries and for the 24 V supply.
STATION_STATES: Final = CodeTable(
    "state of racks and stations",
    1,
    [
        (0x0, "configured", ""),
        (0x1, "configured and activated", ""),
        (0x2, "available", "Activated and has not failed."),
        (0x6, "faulty or deactivated", "At least one module is not ok, or the station is deactivated."),
    ],
)

#: The origin of an IP address (list 0x37).
ADDRESS_SOURCES: Final = CodeTable(
    "origin of the IP address",
    2,
    [
        (0, "not set", ""),
        (1, "configured", "In the hardware configuration."),
        (2, "set by DCP", ""),
        (3, "from a DHCP server", ""),
    ],
)

#: The kind of H system (list 0x71).
REDUNDANCY: Final = CodeTable("redundancy", 4, [(0x0011, "single H CPU", ""), (0x0012, "one of two", "")])

#: Time bases of the times of test functions (list 0x31 index 8).
TIME_BASES: Final = CodeTable(
    "time base",
    1,
    [
        (0x0, "100 ps", ""),
        (0x1, "1 ns", ""),
        (0x2, "10 ns", ""),
        (0x3, "100 ns", ""),
        (0x4, "1 us", ""),
        (0x5, "10 us", ""),
        (0x6, "100 us", ""),
        (0x7, "1 ms", ""),
        (0x8, "10 ms", ""),
        (0x9, "100 ms", ""),
        (0xA, "1 s", ""),
        (0xB, "10 s", ""),
        (0xC, "100 s", ""),
        (0xD, "1000 s", ""),
        (0xE, "10000 s", ""),
        (0xF, "100000 s", "Wireshark writes 1000000 s, which breaks the series."),
    ],
)

#: What an index selects, by partial list; in all other lists, the index is the number of an object of the device.
INDEXES: Final[dict[int, CodeTable]] = {
    0x11: IDENTIFICATIONS,
    0x12: CHARACTERISTICS,
    0x13: MEMORY_AREAS,
    0x14: SYSTEM_AREAS,
    0x15: SZL_BLOCK_TYPES,
    0x19: LEDS,
    0x1C: COMPONENTS,
    0x31: CAPABILITIES,
    0x32: STATUS_SECTIONS,
    0x74: LEDS,
}
