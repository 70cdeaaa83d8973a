"""The kinds of acts: for each its meaning, its finding, its operation, and the role of the client that it shows.

An act is what a client did, or tried to do, to a device: stop it, load it, force its outputs. Findings of security, operations,
the inventory, the table `acts` of exports and baselines all read this one table.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.engine.transactions import operation as operations

STOP: Final = "stop"
START: Final = "start"
RESTART: Final = "restart"
DOWNLOAD: Final = "download"
UPLOAD: Final = "upload"
DELETE: Final = "delete"
ACTIVATE: Final = "activate"
RESET: Final = "memory_reset"
TO_ROM: Final = "copy_ram_to_rom"
COMPRESS: Final = "compress"
CLOCK: Final = "clock_set"
PASSWORD: Final = "password"  # noqa: S105 - the name of a kind, no secret
PROTECTION: Final = "protection_change"
FORCE: Final = "force"
OUTPUTS: Final = "output_write"
FIRMWARE: Final = "firmware"
TEST: Final = "test"
MONITOR: Final = "monitor"
FLASH: Final = "flash_led"
ALARMS: Final = "alarm_change"
NC: Final = "nc_command"
UNKNOWN: Final = "unknown_command"


class Kind(NamedTuple):
    """A kind of act.

    ``slug`` is the finding that it makes, empty for none; with ``commands`` the finding says whether the device accepted (and
    so carries out) the command. ``operation`` is the kind of operation that a single transaction of this kind makes, empty for
    none. With ``lasts`` it takes several transactions, and ends with its operation. ``deed`` and ``tried`` say what it shows
    about its client; they are empty if clients of all kinds do it.
    """

    name: str
    sentence: str
    slug: str = ""
    commands: bool = True
    operation: str = ""
    lasts: bool = False
    deed: str = ""
    tried: str = ""


_CONTROLS: Final = ("stops, starts or resets the PLC", "tried to stop, start or reset the PLC")
_TESTS: Final = ("runs test functions", "tried to run test functions")
_CONTROL: Final = operations.CONTROL
_MEMORY: Final = "security.memory"
_CHANGE: Final = "security.program_change"

_ROWS: Final = (
    Kind(STOP, "A client stops a PLC.", "security.plc_stop", True, _CONTROL, False, *_CONTROLS),
    Kind(START, "A client starts a PLC; of S7comm a warm restart.", "security.plc_start", True, _CONTROL, False, *_CONTROLS),
    Kind(RESTART, "A client restarts a PLC from its initial values (cold).", "security.plc_start", True, _CONTROL, False,
         *_CONTROLS),
    Kind(DOWNLOAD, "A client loads blocks, a configuration or a file into a device.", _CHANGE, True, operations.DOWNLOAD, True,
         "loads blocks", "tried to load blocks"),
    Kind(UPLOAD, "A client reads blocks or a file out of a device.", "security.program_read", False, operations.UPLOAD, True,
         "reads blocks out", "tried to read blocks out"),
    Kind(DELETE, "A client deletes blocks, or a whole program.", _CHANGE, True, operations.DELETE, False,
         "deletes blocks", "tried to delete blocks"),
    Kind(ACTIVATE, "A client links blocks in that it loaded before.", _CHANGE),
    Kind(RESET, "A client resets the memory of a PLC.", _MEMORY, True, _CONTROL, False, *_CONTROLS),
    Kind(TO_ROM, "A client copies the work memory of a PLC to its load memory.", _MEMORY),
    Kind(COMPRESS, "A client compresses the memory of a PLC.", _MEMORY),
    Kind(CLOCK, "A client sets the clock of a PLC.", "security.clock_set"),
    Kind(PASSWORD, "A client sends a password.", "security.password", True, operations.PASSWORD),
    Kind(PROTECTION, "A client changes passwords, rights or the protection of a device or a file, or gives its rights back.",
         "security.protection"),
    Kind(FORCE, "A client modifies or forces variables by test functions.", "security.force", True, "", False, *_TESTS),
    Kind(OUTPUTS, "A client writes to outputs or peripherals for the first time on a connection.", "security.write_outputs",
         False),
    Kind(FIRMWARE, "A client writes to the firmware of a device.", "security.firmware"),
    Kind(TEST, "A client watches a program as it runs, or halts it: block status, breakpoints, test jobs.", "security.debug",
         False, "", False, *_TESTS),
    Kind(MONITOR, "A client monitors variables by test functions.", "", False, "", False, *_TESTS),
    Kind(FLASH, "A client makes the LEDs of a device flash.", "security.flash_led"),
    Kind(ALARMS, "A client locks, unlocks or acknowledges alarms.", "security.alarm_change"),
    Kind(NC, "A client sends a command to a numerical control.", "security.nc_command"),
    Kind(UNKNOWN, "A client sends a command whose meaning is not known.", "security.unknown_service"),
)  # fmt: skip

#: Every kind of act by its name.
ACTS: Final[dict[str, Kind]] = {kind.name: kind for kind in _ROWS}
#: What acts show about their client, and the text for an act that the device refused, in the order in which a role lists them.
DEEDS: Final[dict[str, str]] = {
    ACTS[name].deed: ACTS[name].tried for name in (DOWNLOAD, UPLOAD, DELETE, TEST, STOP)
}
#: Findings about acts that mention whether the device accepted them.
COMMANDS: Final = frozenset([kind.slug for kind in _ROWS if kind.commands and kind.slug])

# The outcomes of an act.
ACCEPTED: Final = "accepted"
REFUSED: Final = "refused"
IN_PART: Final = "refused_in_part"
FAILED: Final = "failed"
UNFINISHED: Final = "unfinished"
UNANSWERED: Final = "unanswered"
UNCONFIRMED: Final = "unconfirmed"
NOT_CAPTURED: Final = "not_captured"
#: Every outcome with a sentence.
OUTCOMES: Final[dict[str, str]] = {
    ACCEPTED: "The device accepted it.",
    REFUSED: "The device refused it.",
    IN_PART: "The device refused a part of it.",
    FAILED: "It began, and a later step was refused or reported an error.",
    UNFINISHED: "It began, and its end is missing: the connection or the capture ended, or a step was not answered.",
    UNANSWERED: "It was asked for, and not answered.",
    UNCONFIRMED: "The request wanted no answer.",
    NOT_CAPTURED: "The capture lacks the packets that show how it ended.",
}
