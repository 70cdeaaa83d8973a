"""The text of README.txt in a bundle, for the person who installs from it (scripts/bundle.py)."""

from __future__ import annotations

from scripts.bundle_target import Target, Wheel

#: The same on all systems: the digests of requirements.txt are checked, and no other wheels are accepted.
INSTALL = "-m pip install --no-index --find-links wheels --require-hashes -r requirements.txt"

WINDOWS = r"""
1. Python {python}, 64 bit, must be installed. "py -{python} --version" in a command prompt shows it.
   An installation for the current user is enough, without the rights of an administrator.
2. Unpack the zip, open a command prompt (cmd) in the unpacked folder, and type

     py -{python} -m venv "%USERPROFILE%\s7dissect"
     "%USERPROFILE%\s7dissect\Scripts\python" {install}

3. Try it:

     "%USERPROFILE%\s7dissect\Scripts\s7dissect" --version
     "%USERPROFILE%\s7dissect\Scripts\s7dissect" analyze C:\path\to\trace.pcapng

To remove it, delete the folder %USERPROFILE%\s7dissect. Nothing else was changed.

* Results are UTF-8. The console shows them as they are. Where another program reads them (a pipe,
  "more", PowerShell), type "chcp 65001" first; in PowerShell
  "[Console]::OutputEncoding = [Text.Encoding]::UTF8".
* Live capture needs dumpcap of Wireshark with Npcap. Reading captures needs neither.
* Nobody has run this bundle on Windows yet. On another system, pip installed it by its rules for
  Windows: every wheel is there and fits. Please report what fails.
"""

UNIX = """
1. Python {python} with its venv module must be installed.
2. Unpack the zip, and in the unpacked folder type

     python{python} -m venv ~/s7dissect
     ~/s7dissect/bin/python {install}

3. Try it:

     ~/s7dissect/bin/s7dissect --version
     ~/s7dissect/bin/s7dissect analyze /path/to/trace.pcapng

To remove it, delete the folder ~/s7dissect. Nothing else was changed.
"""


def readme(target: Target, own: Wheel, count: int, missing: dict[str, str]) -> str:
    """Return the text, in ASCII."""
    windows = target.tag.startswith("win")
    steps = (WINDOWS if windows else UNIX).format(python=target.python, install=INSTALL)
    compiled = "py3-none-any" not in own.path.name
    build = "compiled for this system" if compiled else "the interpreted build, which runs everywhere and is slower"
    notes = [f"* s7dissect is {build}."]
    notes += [f"* Left out is the extra {extra!r}: {why}." for extra, why in sorted(missing.items())]
    return f"""s7dissect {own.version} for {target.name}
{"=" * len(f"s7dissect {own.version} for {target.name}")}

Installs s7dissect and all that it uses from this folder: {count} wheels. No network is needed or asked.
{steps}
{chr(10).join(notes)}
* sbom.cdx.json lists what is in it (CycloneDX 1.6), with the SHA-256 of each wheel.
  requirements.txt holds the same digests, and pip refuses a wheel that differs.
"""
