"""Blocks as files: a folder with a file for each block, texts of S7comm-plus blocks in further files, and a manifest.

A file is named by its number in the list, type, number and direction, never by text from a device; its octets are those that
were captured. The manifest is the JSON of `s7dissect blocks`, with the names of the files.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from dissect.engine.program.carved import S7COMM_PLUS, CarvedBlock, block_of, plus_block
from dissect.engine.program.plus import TEXTS
from dissect.output.carve.records import BLOCKS_SCHEMA
from dissect.protocols.s7plus.blobs import open_blob
from dissect.wire.config.hostile import ContentError, read_json
from dissect.wire.config.saving import save
from dissect.wire.errors import Error
from dissect.wire.text import printable

MANIFEST: Final = "manifest.json"
#: Suffixes of block files: S7-300/400, S7comm-plus, and contents without a header.
CLASSIC: Final = ".mc7"
PLUS: Final = ".s7p"
RAW: Final = ".bin"
#: Suffixes of the names of files: a block that is not complete, and the octets that were captured after its gap.
INCOMPLETE: Final = "-incomplete"
BEHIND_GAP: Final = ".behind-gap"
_SUFFIXES: Final = (CLASSIC, PLUS, RAW)
#: Size of the largest file that is read as a block or a manifest.
_LARGEST: Final = 64 * 1024 * 1024
#: Total size of all texts that are inflated, because a small blob may become large.
MAX_TEXTS: Final = 128 * 1024 * 1024
_UNSAFE: Final = re.compile(r"[^A-Za-z0-9]+")
_MAX_WORD: Final = 24


class FolderError(Error, ValueError):
    """A file or folder without blocks; the message is one line for a person."""


def file_name(number: int, block: CarvedBlock) -> str:
    """Return the unique file name, of safe characters only, for the block with this ``number`` in its list."""
    kind = _UNSAFE.sub("", block.kind)[:_MAX_WORD] or "block"
    suffix = PLUS if block.plus is not None else CLASSIC if block.classic is not None else RAW
    label = f"{kind}{block.number}" if block.number >= 0 else kind
    direction = f"-{block.direction}" if block.direction else ""
    state = "" if block.complete else INCOMPLETE
    return f"{number:04d}-{label}{direction}{state}{suffix}"


def texts(block: CarvedBlock, dictionaries: Mapping[int, bytes]) -> dict[str, bytes]:
    """Return the inflated texts of a block by kind (``body-1``), without those that cannot be opened."""
    found: dict[str, bytes] = {}
    counts: dict[int, int] = {}
    for id_, octets in block.plus.blobs() if block.plus is not None else ():
        counts[id_] = counts.get(id_, 0) + 1
        opened = open_blob(octets, dictionaries)
        if opened.octets and not opened.fault:
            found[f"{TEXTS[id_]}-{counts[id_]}"] = opened.octets
    return found


class Plan:
    """The files of blocks, planned before any is written: ``files`` has index of the block and octets, by name.

    ``left_out`` counts, by index, the texts beyond `MAX_TEXTS`. The manifest is not among the files.
    """

    def __init__(self, blocks: Sequence[CarvedBlock], dictionaries: Mapping[int, bytes], most: int = MAX_TEXTS) -> None:
        self.files: dict[str, tuple[int, bytes]] = {}
        self.left_out: dict[int, int] = {}
        for index, block in enumerate(blocks):
            name = file_name(index + 1, block)
            self.files[name] = index, block.octets
            if block.behind_gap:
                self.files[name + BEHIND_GAP] = index, block.behind_gap
            for text, octets in texts(block, dictionaries).items():
                if len(octets) > most:
                    self.left_out[index] = self.left_out.get(index, 0) + 1
                    continue
                most -= len(octets)
                self.files[f"{name.removesuffix(PLUS)}.{text}.xml"] = index, octets


def write_folder(folder: str | Path, plan: Plan, manifest: dict[str, Any]) -> None:
    """Write the files of a plan; then the manifest, with the names of the files of each block. Raises `OSError`.

    ``manifest`` has the records of the blocks in ``blocks``.
    """
    home = Path(folder)
    home.mkdir(parents=True, exist_ok=True)
    for index, count in plan.left_out.items():
        manifest["blocks"][index]["texts_left_out"] = count
    for name, (index, octets) in plan.files.items():
        record = manifest["blocks"][index]
        if name.endswith(_SUFFIXES):
            record["file"] = name
        elif name.endswith(BEHIND_GAP):
            record["behind_gap"] = name
        else:
            record.setdefault("texts", []).append(name)
        save(home / name, octets)
    save(home / MANIFEST, (json.dumps(manifest, indent=1) + "\n").encode("ascii"))


def occupied(folder: str | Path, names: Sequence[str]) -> list[str]:
    """Return those of ``names``, and the manifest, that exist in a folder already."""
    home = Path(folder)
    return [name for name in (MANIFEST, *names) if (home / name).exists() or (home / name).is_symlink()]


# ---- reading --------------------------------------------------------------------------------------------------------


def read_folder(folder: str | Path) -> list[CarvedBlock]:
    """Return the blocks of a folder: those in its manifest; without a manifest all files that are blocks, sorted by name.

    Raises `FolderError` if there are none, or the manifest is wrong; OSError if a file cannot be read.
    """
    home = Path(folder)
    manifest = home / MANIFEST
    if manifest.is_file():
        return _read_manifest(home, manifest)
    paths = sorted([path for path in home.iterdir() if path.is_file() and path.suffix not in {".xml", BEHIND_GAP}])
    found = [block for path in paths if (block := read_block(path)) is not None]
    if not found:
        raise FolderError(
            f"{printable(str(folder))}: no block in this folder: no manifest.json, and no file that is one"
        )
    return found


def _read_manifest(home: Path, path: Path) -> list[CarvedBlock]:
    try:
        told = read_json(_octets(path))
        records = told["blocks"]
        if told["schema"] != BLOCKS_SCHEMA or not isinstance(records, list):
            raise FolderError(f"{printable(str(path))}: expected schema {BLOCKS_SCHEMA}")
        return [_of_record(home, record) for record in records if record.get("file")]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, FolderError):
            raise
        if isinstance(error, ContentError):
            raise FolderError(f"{printable(str(path))}: not a manifest of blocks: {error}") from None
        raise FolderError(f"{printable(str(path))}: not a manifest of blocks: {printable(repr(error))}") from None


def _of_record(home: Path, record: dict[str, Any]) -> CarvedBlock:
    octets = _octets(_path(home, str(record["file"])))
    block = plus_block(octets) if record.get("protocol") == S7COMM_PLUS else None
    if block is None:
        block = block_of(octets, _named(record))
    block.missing = str(record.get("missing") or "")
    if record.get("behind_gap"):
        block.behind_gap = _octets(_path(home, str(record["behind_gap"])))
    return block


def _path(home: Path, name: str) -> Path:
    """Return the path of a file that the manifest names. Raises `FolderError` if it is outside of the folder."""
    if name != Path(name).name or name in {"", ".", ".."}:
        raise FolderError(f"{printable(str(home / MANIFEST))}: {printable(name)} is not a file of this folder")
    return home / name


def _named(record: dict[str, Any]) -> str:
    """Return the name of a block in its request, in the form that `block_of` needs."""
    number = record.get("number")
    return f"{record.get('type')} {number}, passive" if isinstance(number, int) else str(record.get("title") or "")


def read_block(path: str | Path) -> CarvedBlock | None:
    """Return the block in a file; None if it is not a block. Raises OSError."""
    octets = _octets(Path(path))
    block = block_of(octets)
    if block.classic is not None:
        lost = block.classic.missing
        block.missing = f"{len(octets)} of {block.classic.size} bytes" if lost else ""
        return block
    return plus_block(octets)


def _octets(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_LARGEST)
