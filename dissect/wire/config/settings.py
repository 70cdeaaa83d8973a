"""`s7dissect.toml`: options that a user does not want to type each time (docs/config.md).

All its errors are reported at once, and then none of its settings are used.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from ipaddress import ip_address
from pathlib import Path
from typing import Any, Final, NamedTuple

from dissect.wire.config.hints import close_to
from dissect.wire.config.hostile import ContentError, check_code_page, read_toml
from dissect.wire.config.lines import Lines
from dissect.wire.errors import Error
from dissect.wire.text import printable, shortened

MAX_FILE: Final = 1 << 20
_MAX_DB: Final = 65535
_MAX_MS: Final = 1e9
_COLORS: Final = ("auto", "always", "never")


class ConfigError(Error):
    """Files of settings cannot be used; ``problems`` has a message for each mistake, with file and line."""

    def __init__(self, problems: list[str]) -> None:
        self.problems = problems
        super().__init__("\n".join(problems))


class Settings(NamedTuple):
    """The contents of the files, key by key (`KEYS`), and the files in the order in which they were read."""

    values: Mapping[str, Any]
    files: tuple[Path, ...]


def _text(value: object, _folder: Path) -> str:
    if not isinstance(value, str) or not value.strip():
        raise ValueError("expected a text")
    return value


def _code_page(value: object, folder: Path) -> str:
    name = _text(value, folder)
    check_code_page(name)
    return name


def _file(value: object, folder: Path) -> str:
    return str(folder / _text(value, folder))


def _tag_files(value: object, folder: Path) -> list[str]:
    """Return files of tags; a CPU in front of a file ("10.0.0.5=plc.xlsx") is kept."""
    rows = value if isinstance(value, list) else [value]
    texts = [row for row in rows if isinstance(row, str) and row.strip()]
    if not rows or len(texts) != len(rows):
        raise ValueError('expected a file or a list of files, for example ["plc_tags.xlsx", "tank.awl"]')
    found = []
    for row in texts:
        host, name = split_host(row)
        found.append(f"{host}={folder / name}" if host else str(folder / name))
    return found


def _numbers(value: object, _folder: Path) -> dict[str, int]:
    if not isinstance(value, dict):
        raise ValueError("expected a table of block names and numbers, for example { Tank = 10 }")  # noqa: TRY004 - as above
    for name, number in value.items():
        if not isinstance(number, int) or isinstance(number, bool) or not 0 < number <= _MAX_DB:
            raise ValueError(f"{name!r}: expected the number of a data block from 1 to {_MAX_DB}")
    return dict(value)


def _hosts(value: object, _folder: Path) -> dict[str, str]:
    if not isinstance(value, dict):
        raise ValueError('expected a table of addresses and names, for example { "10.0.0.5" = "press" }')  # noqa: TRY004 - as above
    found = {}
    for address, name in value.items():
        try:
            plain = str(ip_address(address))
        except ValueError:
            raise ValueError(f"{address!r} is not an IP address") from None
        if not isinstance(name, str) or not name.strip():
            raise ValueError(f"{address!r}: expected a name")
        found[plain] = name
    return found


def _milliseconds(value: object, _folder: Path) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value <= _MAX_MS:
        raise ValueError("expected milliseconds from 0 to 1000000000")
    return float(value)


def _switch(value: object, _folder: Path) -> bool:
    if not isinstance(value, bool):
        raise ValueError("expected true or false")  # noqa: TRY004 - as above
    return value


def _color(value: object, _folder: Path) -> str:
    if value not in _COLORS:
        raise ValueError(f"expected one of {', '.join(_COLORS)}")
    return str(value)


def _check_format(name: str, formats: tuple[str, ...]) -> None:
    if name not in formats:
        raise ValueError(f"{name!r} is not one of {', '.join(formats)}{close_to(name, formats)}")


#: Every key: its meaning for docs/config.md, and the function that reads its value (with the folder of the file). Tables are
#: joined.
KEYS: Final[dict[str, tuple[str, Callable[[object, Path], Any]]]] = {
    "tags": ("files of tags, as `--tags`", _tag_files),
    "tags-encoding": ("their code page, as `--tags-encoding`", _code_page),
    "tags-db": ("numbers of data blocks by name, as `--tags-db`", _numbers),
    "scd": ("an SCD dictionary, as `--scd`", _file),
    "bind": ("where SCD is carried, as `--bind`", _file),
    "hosts": ("names of hosts by address, shown in text", _hosts),
    "slow": (
        "milliseconds after which an answer is slow, as `--slow` of `analyze`, `monitor` and `proxy`",
        _milliseconds,
    ),
    "format": ("output format, as `-T`, of the commands that have it", _text),
    "checksums": ("ignore packets with wrong checksums, as `--checksums`", _switch),
    "local-time": ("show and take times in the zone of this machine, as `--local-time`", _switch),
    "color": ("colours, as `--color`", _color),
}


def split_host(text: str) -> tuple[str, str]:
    """Return the address and the file of "ADDRESS=FILE", an empty address where there is none."""
    host, equals, name = text.partition("=")
    if equals:
        try:
            return str(ip_address(host.strip())), name
        except ValueError:
            pass
    return "", text


def load_settings(paths: list[Path], formats: Iterable[str] = ()) -> Settings:
    """Return the settings in files: each key from the first file that has it, tables merged entry by entry.

    ``formats`` are the names that ``format`` may have. Raises `ConfigError` with every mistake of all files, OSError if a file
    cannot be read.
    """
    problems: list[str] = []
    values: dict[str, Any] = {}
    for path in paths:
        for key, value in _read(path, problems, tuple(formats)).items():
            if isinstance(value, dict):
                values[key] = {**value, **values.get(key, {})}
            else:
                values.setdefault(key, value)
    if problems:
        raise ConfigError(problems)
    return Settings(values, tuple(paths))


def _read(path: Path, problems: list[str], formats: tuple[str, ...]) -> dict[str, Any]:
    """Return the keys of one file; mistakes are added to ``problems``."""
    name = printable(os.fspath(path))
    with path.open("rb") as stream:
        octets = stream.read(MAX_FILE + 1)
    if len(octets) > MAX_FILE:
        problems.append(f"{name}: more than {MAX_FILE} bytes: not a file of settings")
        return {}
    try:
        text = octets.decode("utf-8-sig")
        content = read_toml(text)
    except UnicodeDecodeError as error:
        line = octets.count(b"\n", 0, error.start) + 1
        problems.append(f"{name}:{line}: byte 0x{octets[error.start]:02X} is not UTF-8: save the file as UTF-8")
        return {}
    except ContentError as error:
        place = f"{name}:{error.line}" if error.line else name
        problems.append(f"{place}: not valid TOML: {shortened(str(error), 200)}")
        return {}
    lines = Lines(text)
    found: dict[str, Any] = {}
    for key, value in content.items():
        row = KEYS.get(key)
        place = f"{name}:{lines.at(key)}"
        if row is None:
            hint = close_to(key, KEYS) or f"; known keys: {', '.join(KEYS)}"
            problems.append(f"{place}: {shortened(key, 60)}: unknown key{hint}")
            continue
        try:
            found[key] = row[1](value, path.resolve().parent)
            if key == "format":
                _check_format(str(value), formats)
        except ValueError as error:
            problems.append(f"{place}: {key}: {shortened(str(error), 200)}")
    return found
