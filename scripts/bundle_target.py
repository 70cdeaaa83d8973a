"""The target system of a bundle, and the requirements of the wheels in a folder for that system (scripts/bundle.py)."""

from __future__ import annotations

import platform
import sys
import zipfile
from dataclasses import dataclass
from email.message import Message
from email.parser import Parser
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name, parse_wheel_filename
from packaging.version import Version

#: The properties of a system that markers of requirements check, by the beginning of the tag of its wheels.
SYSTEMS = {
    "win": {"os_name": "nt", "sys_platform": "win32", "platform_system": "Windows"},
    "macosx": {"os_name": "posix", "sys_platform": "darwin", "platform_system": "Darwin"},
    "manylinux": {"os_name": "posix", "sys_platform": "linux", "platform_system": "Linux"},
}
#: The processor name on its system, by the end of the tag.
MACHINES = {"win_amd64": "AMD64", "win_arm64": "ARM64"}
#: The versions of glibc for which wheels for Linux exist: a newer system accepts those of older ones.
GLIBC = range(28, 16, -1)


@dataclass(frozen=True)
class Target:
    """A system and a version of Python. ``tag`` is that of wheels, such as win_amd64; empty for this system."""

    tag: str
    python: str

    @property
    def name(self) -> str:
        """Return the name that folders and files of the bundle have."""
        system = self.tag or f"{sys.platform}_{platform.machine()}"
        return f"{system}-cp{self.python.replace('.', '')}"

    def markers(self) -> dict[str, str]:
        """Return the values of markers of requirements on that system."""
        told = dict(SYSTEMS[self.tag.partition("_")[0]] if self.tag else {})
        if not told:
            told = {"os_name": "posix" if sys.platform != "win32" else "nt", "sys_platform": sys.platform}
            told["platform_system"] = platform.system()
        tail = next((end for end in ("x86_64", "aarch64", "arm64") if self.tag.endswith(end)), platform.machine())
        version = f"{self.python}.0"
        return {
            **told,
            "platform_machine": MACHINES.get(self.tag, tail),
            "platform_python_implementation": "CPython",
            "implementation_name": "cpython",
            "python_version": self.python,
            "python_full_version": version,
            "implementation_version": version,
            "platform_release": "",
            "platform_version": "",
        }

    def tags(self) -> list[str]:
        """Return the tags of wheels that run there, the requested one first."""
        if not self.tag.startswith("manylinux"):
            return [self.tag] if self.tag else []
        machine = self.tag.removeprefix("manylinux_")
        return [f"manylinux_2_{minor}_{machine}" for minor in GLIBC] + [f"manylinux2014_{machine}"]

    def pip(self) -> list[str]:
        """Return the options with which pip chooses wheels for it; none for this Python on this system."""
        if not self.tag and self.python == "{}.{}".format(*sys.version_info):
            return []
        options = [word for tag in self.tags() for word in ("--platform", tag)]
        return [*options, "--python-version", self.python, "--implementation", "cp"]


@dataclass(frozen=True)
class Wheel:
    """A wheel and its metadata."""

    path: Path
    metadata: Message

    @property
    def name(self) -> str:
        """Return the name of its project, in the form of registries."""
        return canonicalize_name(str(self.metadata["Name"]))

    @property
    def version(self) -> Version:
        """Return its version."""
        return parse_wheel_filename(self.path.name)[1]

    def needs(self, markers: dict[str, str], extras: frozenset[str]) -> list[Requirement]:
        """Return its requirements on a system, with these of its extras."""
        said = [Requirement(line) for line in self.metadata.get_all("Requires-Dist") or []]
        return [one for one in said if any(_holds(one, markers, extra) for extra in ("", *sorted(extras)))]


def _holds(requirement: Requirement, markers: dict[str, str], extra: str) -> bool:
    return requirement.marker is None or requirement.marker.evaluate({**markers, "extra": extra})


def read_wheel(path: Path) -> Wheel:
    """Read the metadata of a wheel."""
    with zipfile.ZipFile(path) as archive:
        name = next(
            name for name in archive.namelist() if name.endswith(".dist-info/METADATA") and name.count("/") == 1
        )
        return Wheel(path, Parser().parsestr(archive.read(name).decode()))


def closure(wheels: list[Wheel], root: str, extras: frozenset[str], target: Target) -> dict[str, set[str]]:
    """Return which wheels each wheel needs, from the root on, by name; `LookupError` names missing ones.

    This does not use pip's results: it checks the folder against the metadata of its wheels.
    """
    by_name = {wheel.name: wheel for wheel in wheels}
    markers = target.markers()
    found: dict[str, set[str]] = {}
    asked: set[tuple[str, frozenset[str]]] = set()
    waiting = [(root, extras)]
    while waiting:
        name, wanted = waiting.pop()
        if (name, wanted) in asked:
            continue
        asked.add((name, wanted))
        needed = found.setdefault(name, set())
        for one in by_name[name].needs(markers, wanted):
            other = canonicalize_name(one.name)
            fits = by_name.get(other)
            if fits is None or not one.specifier.contains(fits.version, prereleases=True):
                message = f"{name} needs {one}, and the bundle has {fits.version if fits else 'none'}"
                raise LookupError(message)
            if other != name:
                needed.add(other)
            waiting.append((other, frozenset(one.extras)))
    return found
