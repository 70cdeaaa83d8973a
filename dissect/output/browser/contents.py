"""The contents of the browser edition: Python for browsers, packages that it needs, and the useful parts of this package.

The same input gives the same bytes: files are in the order of their names, and nothing has a time.
"""

from __future__ import annotations

import fnmatch
import gzip
import io
import lzma
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from dissect.meaning.facts.vendors import listed
from dissect.output.browser.parts import Part, Parts, engine, wheels

_PACKAGE: Final = Path(__file__).resolve().parent.parent.parent
#: Files of the package, and rooms that are useless in a browser: it has no network, no Wireshark, no Scapy, no processes.
_KINDS: Final = frozenset((".py", ".json", ".css", ".js", ".j2", ".md"))
_ROOMS_LEFT_OUT: Final = frozenset(
    (
        "files/cluster",
        "layers",
        "online/metrics",
        "online/monitor",
        "online/proxy",
        "testing/oracle",
        "testing/playback",
    )
)
#: From the room `browser` only the parts that run inside the page.
_INSIDE: Final = frozenset(("__init__.py", "bridge.py"))
#: The plugin for pytest, beside the rooms of its wing.
_PLUGIN: Final = Path("testing")
#: Modules of the standard library that nothing here imports: tools for developers, servers, protocols of mail and news.
_UNUSED: Final = """
    _pyio.py _pyrepl/* asyncio/__main__.py asyncio/tools.py bdb.py cProfile.py compileall.py concurrent/interpreters/*
    doctest.py encodings/mac_*.py ensurepip/* ftplib.py http/server.py idlelib/* imaplib.py mailbox.py modulefinder.py
    multiprocessing/* optparse.py pdb.py pickletools.py plistlib.py poplib.py profile.py profiling/* pstats.py
    py_compile.py pyclbr.py pydoc.py pydoc_data/* smtplib.py socketserver.py statistics.py symtable.py
    sysconfig/__main__.py tabnanny.py trace.py turtle.py unittest/* venv/* wsgiref/* xml/sax/* xmlrpc/* zipapp.py
"""
#: Parts of wheels that are left out: files that only a build or a type checker reads, and code for another machine.
_UNREAD: Final = "*.pyi *.c *.h */py.typed *linux-gnu.so *.dist-info/RECORD *.dist-info/WHEEL"


class Contents:
    """The four things that a page needs to start, compressed, and the licences of what is inside."""

    def __init__(self, parts: Parts) -> None:
        with tarfile.open(fileobj=io.BytesIO(parts.read(engine()))) as package:
            self._engine = {member.name: _octets(package, member) for member in package if member.isfile()}
        self._wheels = [(part, _unpacked(parts.read(part))) for part in wheels()]

    def pieces(self) -> dict[str, bytes]:
        """Return each thing by the name that the page has for it."""
        return {
            "loader": _packed(self._engine["package/pyodide.mjs"]),
            "glue": _packed(self._engine["package/pyodide.asm.mjs"]),
            "wasm": _packed(self._engine["package/pyodide.asm.wasm"]),
            "stdlib": _packed(_standard_library(self._engine["package/python_stdlib.zip"])),
            "packages": _archive(self._packages()),
        }

    def licences(self) -> list[tuple[Part, str]]:
        """Return each package and the text of its licence, empty where the package has none."""
        told = [(engine(), "")]
        for part, held in self._wheels:
            texts = [held[name].decode("utf-8", "replace") for name in sorted(held) if _is_licence(name)]
            told.append((part, "\n".join(texts)))
        return told

    def _packages(self) -> dict[str, bytes]:
        held = dict(_own())
        for _, wheel in self._wheels:
            held.update({name: octets for name, octets in wheel.items() if not _is_any(name, _UNREAD)})
        # Instead of Scapy, only its copy of one of Wireshark's lists.
        held["scapy/__init__.py"] = held["scapy/libs/__init__.py"] = b""
        held["scapy/libs/manuf.py"] = f"DATA = {listed()!r}\n".encode()
        return held


def _octets(package: tarfile.TarFile, member: tarfile.TarInfo) -> bytes:
    file = package.extractfile(member)
    return b"" if file is None else file.read()


def _unpacked(octets: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(octets)) as wheel:
        return {name: wheel.read(name) for name in wheel.namelist() if not name.endswith("/")}


def _own() -> Iterator[tuple[str, bytes]]:
    """Yield the files of this package, installed or in its source tree."""
    for path in sorted(_PACKAGE.rglob("*")):
        inside = path.relative_to(_PACKAGE)
        rooms = {folder.as_posix() for folder in inside.parents}
        if inside.parent == _PLUGIN and path.name != "__init__.py":
            continue
        if (
            path.suffix not in _KINDS
            or rooms & _ROOMS_LEFT_OUT
            or ("output/browser" in rooms and path.name not in _INSIDE)
        ):
            continue
        yield f"dissect/{inside.as_posix()}", path.read_bytes()
    if not (_PACKAGE / "help").is_dir():
        for page in sorted((_PACKAGE.parent / "docs").glob("*.md")):
            yield f"dissect/help/{page.name}", page.read_bytes()


def _standard_library(octets: bytes) -> bytes:
    """Return the zip of Python's library without modules that are never imported; not compressed, because the page is."""
    held = {name: data for name, data in _unpacked(octets).items() if not _is_any(name, _UNUSED)}
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_STORED) as library:
        for name in sorted(held):
            library.writestr(zipfile.ZipInfo(name), held[name])
    return made.getvalue()


def _archive(held: dict[str, bytes]) -> bytes:
    """Return files as a tar in xz, a quarter smaller than in gzip; Python in the page unpacks it itself."""
    made = io.BytesIO()
    with tarfile.open(fileobj=made, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for name in sorted(held, key=lambda name: (name.rpartition(".")[2], name)):  # similar files together
            about = tarfile.TarInfo(name)
            about.size = len(held[name])
            archive.addfile(about, io.BytesIO(held[name]))
    return lzma.compress(made.getvalue(), check=lzma.CHECK_CRC32, preset=6)  # higher ones take longer and save 0.3 %


def _packed(octets: bytes) -> bytes:
    """Return bytes in gzip, which browsers unpack by themselves."""
    return gzip.compress(octets, 9, mtime=0)


def _is_any(name: str, patterns: str) -> bool:
    return any([fnmatch.fnmatchcase(name, pattern) for pattern in patterns.split()])


def _is_licence(name: str) -> bool:
    return ".dist-info/" in name and Path(name).name.upper().startswith(("LICENSE", "COPYING"))
