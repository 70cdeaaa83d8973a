"""Finds the programs of Wireshark: dumpcap, tshark, Wireshark itself."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Final

#: Folders that the installers for macOS and Windows use, and do not add to the path.
_USUAL: Final = ("/Applications/Wireshark.app/Contents/MacOS", r"C:\Program Files\Wireshark")


def find_program(name: str) -> str:
    """Return the path of ``name`` (in lower case), on the path or where installers put it; empty when it is not there."""
    found = shutil.which(name)
    if found:
        return found
    capital = name.capitalize()  # Wireshark.exe, and Wireshark on a Mac; the others are in lower case
    places = [Path(folder) / file for folder in _USUAL for file in (name, f"{name}.exe", capital, f"{capital}.exe")]
    return next((str(place) for place in places if place.is_file()), "")
