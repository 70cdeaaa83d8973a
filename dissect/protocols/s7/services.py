"""PI services by name: their effect and their arguments (reference section 3.10 and its table)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.tables import CONTROL, DESTRUCTIVE, LOGIN, MEMORY, PROGRAM_CHANGE, READ, START, WRITE

LINK_IN: Final = "_INSE"
LINK_IN_SECOND: Final = "_INS2"
DELETE: Final = "_DELE"
PROGRAM: Final = "P_PROGRAM"
COPY_TO_ROM: Final = "_MODU"
COMPRESS: Final = "_GARB"

#: Services whose parameter block lists blocks.
BLOCK_SERVICES: Final = frozenset((LINK_IN, LINK_IN_SECOND, DELETE))
#: The beginning of the names of all Sinumerik services.
NC_PREFIX: Final = "_N_"
#: The name of an argument that must not be shown.
SECRET: Final = "password"  # noqa: S105 - the name of an argument, no secret


class Service:
    """A PI service. ``arguments`` describes its parameter block; ``effect`` is the effect of a call on the device."""

    __slots__ = ("arguments", "effect", "meaning", "name")

    def __init__(self, name: str, arguments: str, meaning: str, effect: str) -> None:
        self.name = name
        self.arguments = arguments
        self.meaning = meaning
        self.effect = effect

    @property
    def count(self) -> int:
        """The number of arguments, if all of them have names."""
        return len(self.arguments.split(", "))

    def argument(self, number: int) -> str:
        """Return the name of the argument ``number``, counted from 0; empty if it has none."""
        names = self.arguments.split(", ")
        return names[number] if number < len(names) and not names[number][0].isdigit() else ""


_ROWS: Final = (
    Service("_INSE", "block list", "link in (activate) blocks loaded to the passive file system", PROGRAM_CHANGE),
    Service("_INS2", "block list", "second form of _INSE", PROGRAM_CHANGE),
    Service("_DELE", "block list", "delete blocks", PROGRAM_CHANGE),
    Service(
        "P_PROGRAM",
        'empty, or text such as "C "',
        'start the CPU: empty = warm restart, "C " = cold restart; with function 0x29 stop',
        START,
    ),
    Service("_MODU", '"EP"', "copy RAM to ROM", MEMORY),
    Service("_GARB", "empty", "compress memory", MEMORY),
    Service("_N_LOGIN_", "address, password", "log in (NC)", LOGIN),
    Service("_N_LOGOUT", "address", "log out (NC)", LOGIN),
    Service("_N_NEWPWD", "address, password, level", "set a password (NC)", LOGIN),
    Service("_N_CANCEL", "address", "cancel an NC alarm", CONTROL),
    Service("_N_DASAVE", "address", "save SRAM to flash", CONTROL),
    Service("_N_DIGIOF", "address", "digitising off", CONTROL),
    Service("_N_DIGION", "address", "digitising on", CONTROL),
    Service("_N_DZERO_", "address", "set all D numbers invalid", WRITE),
    Service("_N_ENDEXT", "address", "end external mode", CONTROL),
    Service("_N_F_OPER", "address, file, window", "open a file read-only", READ),
    Service("_N_F_OPEN", "address, file, window", "open a file", READ),
    Service("_N_F_CLOS", "address, window", "close a file", READ),
    Service("_N_F_SEEK", "address, window, pointer, size, text, count", "move the search pointer", READ),
    Service("_N_F_COPY", "address, direction, source, destination", "copy a file", WRITE),
    Service("_N_F_RENA", "address, old, new", "rename a file", WRITE),
    Service("_N_F_DELE", "address, file", "delete a file", DESTRUCTIVE),
    Service("_N_F_DELR", "address, file", "delete a file even without rights", DESTRUCTIVE),
    Service("_N_F_DMDA", "address, channel", "delete MDA memory", DESTRUCTIVE),
    Service("_N_F_PROT", "address, file, level", "set the protection of a file", WRITE),
    Service("_N_F_PROR", "address, file, level", "set the protection of a file, second form", WRITE),
    Service("_N_F_XFER", "address, file", "select a file for upload", READ),
    Service("_N_EXTERN", "address, file", "select an external program", CONTROL),
    Service("_N_EXTMOD", "address, file", "select an external program", CONTROL),
    Service("_N_LOCKE_", "address, file", "lock the active file for editing", CONTROL),
    Service("_N_SELECT", "address, file", "select a program for execution", CONTROL),
    Service("_N_SRTEXT", "address, file", "mark a file", WRITE),
    Service("_N_SEL_BL", "address, line", "select a block", CONTROL),
    Service("_N_FINDBL", "address, mode", "start a block search", CONTROL),
    Service("_N_ASUP__", "address, interrupt number, priority, lift fast, sync, file", "assign an interrupt", WRITE),
    Service("_N_CONFIG", "address, class", "reconfigure machine data", WRITE),
    Service("_N_IBN_SS", "address, switch", "set the start-up switch", CONTROL),
    Service("_N_MMCSEM", "address, function, value", "MMC semaphore", CONTROL),
    Service("_N_NCKMOD", "address, on/off, mode, factor", "set the NCK mode", CONTROL),
    Service("_N_OST_OF", "address", "overstore off", CONTROL),
    Service("_N_OST_ON", "address", "overstore on", CONTROL),
    Service("_N_SCALE_", "address", "metric or inch", WRITE),
    Service("_N_SETUFR", "address", "activate the user frame", WRITE),
    Service("_N_STRTLK", "address", "set the global start lock", CONTROL),
    Service("_N_STRTUL", "address", "reset the global start lock", CONTROL),
    Service("_N_TMRASS", "address", "reset the active status", CONTROL),
    Service("_N_CHEKDM", "address, magazine, D number, spindle", "start a uniqueness check of D numbers", READ),
    Service("_N_CHKDNO", "address, tool numbers, D number", "check D numbers", READ),
    Service("_N_CRCEDN", "address, T, D", "create a cutting edge", WRITE),
    Service("_N_CREACE", "address, tool", "create a cutting edge", WRITE),
    Service("_N_CREATO", "address, tool", "create a tool", WRITE),
    Service("_N_CRTOCE", "address, tool, edge", "create a tool with an edge", WRITE),
    Service("_N_DELECE", "address, T, D", "delete a cutting edge", DESTRUCTIVE),
    Service("_N_DELETO", "address, tool", "delete a tool", DESTRUCTIVE),
    Service("_N_DELVAR", "address, block, columns, rows", "delete a data block", DESTRUCTIVE),
    Service("_N_SETTST", "address, magazine, group, state", "activate replacement tools", WRITE),
    Service("_N_TMAWCO", "address, magazine, group, strategy", "set the active wear group", WRITE),
    Service("_N_TMCRTC", "address, tool id, number, duplo, edge", "create a tool with an edge", WRITE),
    Service("_N_TMCRTO", "address, tool id, number, duplo", "create a tool", WRITE),
    Service("_N_TMFDPL", "address, tool, places", "search an empty place for loading", READ),
    Service("_N_TMFPBP", "address, 12 place fields", "search an empty place", READ),
    Service("_N_TMGETT", "address, name, duplo", "find the T number of a tool", READ),
    Service("_N_TMMVTL", "address, tool, places", "load or unload a tool", CONTROL),
    Service("_N_TMPCIT", "address, spindle, increment", "set the piece counter increment", WRITE),
    Service("_N_TMPOSM", "address, tool, places", "position a magazine or tool", CONTROL),
    Service("_N_TRESMO", "address, tool, D, mode", "reset monitoring values", WRITE),
    Service("_N_TSEARC", "address, 8 search fields", "complex tool search", READ),
)  # fmt: skip

#: All services by name.
PI_SERVICES: Final[dict[str, Service]] = {service.name: service for service in _ROWS}
