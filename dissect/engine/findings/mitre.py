"""The only table of the MITRE ATT&CK for ICS techniques that findings refer to, with their ids in releases v18 and v19.

Release 19 (April 2026) brought sub-techniques to the ICS matrix. It revoked nine techniques and reissued them as sub-techniques
with new ids; all others kept their ids. Rules refer to techniques by key, so a renumbering changes only this table.
"""

from __future__ import annotations

from typing import Final

#: The source of the nine new ids.
_CROSSWALK: Final = "ics-sub-techniques-crosswalk.json of attack.mitre.org, 2026-04-28: became "
#: The source of the other ids.
_KEPT: Final = "MITRE ATT&CK for ICS v18; no renumbering in v19 is known"


class Technique:
    """A technique: the ``key`` that rules use, its v18 ``name``, its ids in both releases, and the source of the v19 id."""

    __slots__ = ("key", "name", "source", "v18", "v19")

    def __init__(self, key: str, name: str, v18: str, v19: str, source: str) -> None:
        self.key = key
        self.name = name
        self.v18 = v18
        self.v19 = v19
        self.source = source

    def __repr__(self) -> str:
        return f"Technique({self})"

    @property
    def ids(self) -> str:
        """The v18 id, and the v19 id where it differs: ``T0855 (v19: T1692.001)``."""
        return self.v18 if self.v18 == self.v19 else f"{self.v18} (v19: {self.v19})"

    def __str__(self) -> str:
        return f"{self.name} {self.ids}"

    def as_dict(self) -> dict[str, object]:
        """Return name and ids, JSON-ready."""
        return {"name": self.name, "v18": self.v18, "v19": self.v19}


_ROWS: Final = (
    # Renumbered in v19.
    ("block_command", "Block Command Message", "T0803", "T1691.001",
     _CROSSWALK + "Block Operational Technology Message: Command Message"),
    ("block_reporting", "Block Reporting Message", "T0804", "T1691.002",
     _CROSSWALK + "Block Operational Technology Message: Reporting Message"),
    ("block_serial", "Block Serial COM", "T0805", "T1695.001", _CROSSWALK + "Block Communications: Serial COM"),
    ("default_credentials", "Default Credentials", "T0812", "T1694.001",
     _CROSSWALK + "Insecure Credentials: Default Credentials"),
    ("module_firmware", "Module Firmware", "T0839", "T1693.002", _CROSSWALK + "Modify Firmware: Module Firmware"),
    ("command_message", "Unauthorized Command Message", "T0855", "T1692.001",
     _CROSSWALK + "Unauthorized Message: Command Message"),
    ("spoof_reporting", "Spoof Reporting Message", "T0856", "T1692.002",
     _CROSSWALK + "Unauthorized Message: Reporting Message"),
    ("system_firmware", "System Firmware", "T0857", "T1693.001", _CROSSWALK + "Modify Firmware: System Firmware"),
    ("hardcoded_credentials", "Hardcoded Credentials", "T0891", "T1694.002",
     _CROSSWALK + "Insecure Credentials: Hardcoded Credentials"),
    # The same id in both.
    ("monitor_process", "Monitor Process State", "T0801", "T0801", _KEPT),
    ("brute_force_io", "Brute Force I/O", "T0806", "T0806", _KEPT),
    ("data_destruction", "Data Destruction", "T0809", "T0809", _KEPT),
    ("denial_of_service", "Denial of Service", "T0814", "T0814", _KEPT),
    ("restart_shutdown", "Device Restart/Shutdown", "T0816", "T0816", _KEPT),
    ("modify_tasking", "Modify Controller Tasking", "T0821", "T0821", _KEPT),
    ("adversary_in_the_middle", "Adversary-in-the-Middle", "T0830", "T0830", _KEPT),
    ("manipulate_control", "Manipulation of Control", "T0831", "T0831", _KEPT),
    ("manipulate_io_image", "Manipulate I/O Image", "T0835", "T0835", _KEPT),
    ("modify_parameter", "Modify Parameter", "T0836", "T0836", _KEPT),
    ("modify_alarm_settings", "Modify Alarm Settings", "T0838", "T0838", _KEPT),
    ("connection_enumeration", "Network Connection Enumeration", "T0840", "T0840", _KEPT),
    ("network_sniffing", "Network Sniffing", "T0842", "T0842", _KEPT),
    ("program_download", "Program Download", "T0843", "T0843", _KEPT + "; v19 adds sub-techniques below it"),
    ("program_upload", "Program Upload", "T0845", "T0845", _KEPT),
    ("system_discovery", "Remote System Discovery", "T0846", "T0846", _KEPT + "; v19 adds sub-techniques below it"),
    ("rogue_master", "Rogue Master", "T0848", "T0848", _KEPT),
    ("operating_mode", "Change Operating Mode", "T0858", "T0858", _KEPT),
    ("valid_accounts", "Valid Accounts", "T0859", "T0859", _KEPT),
    ("tag_identification", "Point & Tag Identification", "T0861", "T0861", _KEPT),
    ("detect_mode", "Detect Operating Mode", "T0868", "T0868", _KEPT),
    ("io_image", "I/O Image", "T0877", "T0877", _KEPT),
    ("alarm_suppression", "Alarm Suppression", "T0878", "T0878", _KEPT),
    ("system_information", "Remote System Information Discovery", "T0888", "T0888", _KEPT),
    ("modify_program", "Modify Program", "T0889", "T0889", _KEPT),
    ("change_credential", "Change Credential", "T0892", "T0892", _KEPT),
)  # fmt: skip

#: The techniques by key, the renumbered ones first.
TECHNIQUES: Final[dict[str, Technique]] = {
    key: Technique(key, name, v18, v19, source) for key, name, v18, v19, source in _ROWS
}
