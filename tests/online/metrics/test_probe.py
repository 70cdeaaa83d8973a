"""The unit and the container file in docs/probe: well formed, locked down, and the commands in them exist.

systemd's own checks run where systemd is installed. That the command of the unit runs under its filter is in test_sandbox.py.
"""

from __future__ import annotations

import configparser
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Final

import click
import pytest

from dissect.cli.monitor import command as monitor
from dissect.files.recording.ring_buffer import parse_limits
from tests.conftest import ROOT

PROBE: Final = ROOT / "docs" / "probe"
UNIT: Final = PROBE / "s7dissect-probe.service"
CONTAINER: Final = PROBE / "Containerfile"
PAGE: Final = (ROOT / "docs" / "probe.md").read_text(encoding="utf-8")

#: The keys that the unit may use, as systemd.unit(5), systemd.service(5), systemd.exec(5), systemd.kill(5) and
#: systemd.resource-control(5) spell them.
KEYS: Final = {
    "Unit": {"Description", "Documentation", "After", "StartLimitIntervalSec"},
    "Service": {
        *(
            "Type",
            "Environment",
            "EnvironmentFile",
            "ExecStart",
            "ExecReload",
            "Restart",
            "RestartSec",
            "SuccessExitStatus",
        ),
        *(
            "NotifyAccess",
            "WatchdogSec",
            "TimeoutStopSec",
            "OOMPolicy",
            "DynamicUser",
            "AmbientCapabilities",
            "CapabilityBoundingSet",
        ),
        *("NoNewPrivileges", "UMask", "StateDirectory", "StateDirectoryMode", "WorkingDirectory", "ProtectSystem"),
        *("ProtectHome", "PrivateTmp", "PrivateMounts", "PrivateDevices", "RemoveIPC", "ProtectProc", "ProtectClock"),
        *("ProtectControlGroups", "ProtectHostname", "ProtectKernelLogs", "ProtectKernelModules", "LockPersonality"),
        *("ProtectKernelTunables", "RestrictNamespaces", "RestrictRealtime", "RestrictSUIDSGID"),
        *("MemoryDenyWriteExecute", "SystemCallArchitectures", "SystemCallFilter", "SystemCallErrorNumber"),
        *("RestrictAddressFamilies", "IPAddressDeny", "IPAddressAllow", "MemoryMax", "TasksMax", "LimitNOFILE"),
    },
    "Install": {"WantedBy"},
}
#: Without these the unit would not be what its page says.
LOCKED: Final = {
    "DynamicUser": ["yes"],
    "AmbientCapabilities": ["CAP_NET_RAW"],
    "CapabilityBoundingSet": ["CAP_NET_RAW"],
    "NoNewPrivileges": ["yes"],
    "ProtectSystem": ["strict"],
    "ProtectHome": ["yes"],
    "StateDirectory": ["s7dissect"],
    "MemoryMax": ["512M"],
    "Restart": ["always"],
    "Type": ["notify"],
    "WatchdogSec": ["60"],
    "SystemCallFilter": ["@system-service", "~@privileged @resources", "capset"],
    "IPAddressDeny": ["any"],
    "IPAddressAllow": ["localhost"],
}

INSTRUCTIONS: Final = frozenset(
    ("FROM", "RUN", "COPY", "ENV", "VOLUME", "WORKDIR", "USER", "STOPSIGNAL", "ENTRYPOINT", "CMD")
)


class _Repeated(dict[str, str]):
    """A key that stands there again is another line of it."""

    def __setitem__(self, key: str, value: str) -> None:
        if key in self and isinstance(value, list):
            value = [*self[key], *value]
        super().__setitem__(key, value)


def sections(text: str) -> dict[str, dict[str, list[str]]]:
    """Read a unit file: every key with all its values."""
    parser = configparser.RawConfigParser(strict=False, dict_type=_Repeated, delimiters=("=",), comment_prefixes="#")
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(text.replace("\\\n", " "))
    return {name: {key: value.splitlines() for key, value in parser.items(name)} for name in parser.sections()}


def options(arguments: list[str]) -> dict[str, list[str]]:
    """Return the options of a command line of the monitor with their values; a name that does not exist fails."""
    parameters = {name: one for one in monitor.params if isinstance(one, click.Option) for name in one.opts}
    found: dict[str, list[str]] = {}
    rest = list(arguments)
    while rest:
        name = rest.pop(0)
        assert name in parameters, f"s7dissect monitor has no {name}"
        found.setdefault(name, []).extend([] if parameters[name].is_flag else [rest.pop(0)])
    return found


def check_command(arguments: list[str]) -> None:
    found = options(arguments)
    assert {"--plain", "-T", "-i", "--engine", "--metrics", "-w", "-b"} <= found.keys()
    assert (found["-T"], found["--engine"]) == (["jsonl"], ["ring"])
    assert parse_limits([re.sub(r"\$\{\w+\}", "1", word) for word in found["-b"]]).files > 0


# ---- systemd ----------------------------------------------------------------------------------------------------------


def test_the_unit_uses_keys_that_exist() -> None:
    unit = sections(UNIT.read_text(encoding="utf-8"))
    assert {name: set(keys) for name, keys in unit.items()} == KEYS


def test_the_unit_is_locked_down() -> None:
    service = sections(UNIT.read_text(encoding="utf-8"))["Service"]
    assert {key: service.get(key) for key in LOCKED} == LOCKED


def test_the_command_of_the_unit_exists() -> None:
    service = sections(UNIT.read_text(encoding="utf-8"))["Service"]
    (line,) = service["ExecStart"]
    program, command, *arguments = shlex.split(line)
    assert (program, command) == ("/opt/s7dissect/bin/s7dissect", "monitor")
    check_command(arguments)
    settings = {word.partition("=")[0] for line in service["Environment"] for word in shlex.split(line)}
    assert set(re.findall(r"\$\{(\w+)\}", line)) == settings | {"STATE_DIRECTORY"}
    assert all(f"`{name}`" in PAGE for name in settings)


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze here")
def test_systemd_accepts_the_unit(tmp_path: Path) -> None:
    text = UNIT.read_text(encoding="utf-8")
    installed = tmp_path / UNIT.name
    installed.write_text(text.replace("/opt/s7dissect/bin/s7dissect", "/bin/true"), encoding="utf-8")
    assert verify(installed) == ""
    installed.write_text(text.replace("Restart=always", "Restart=sometimes"), encoding="utf-8")
    assert "sometimes" in verify(installed)


def verify(unit: Path) -> str:
    """Return what systemd says against a unit."""
    ran = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(unit)], capture_output=True, text=True, check=False, timeout=60
    )
    return "\n".join([line for line in ran.stderr.splitlines() if unit.name in line or str(unit) in line])


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze here")
def test_systemd_finds_little_that_is_exposed() -> None:
    ran = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--no-pager", "--threshold=20", str(UNIT)],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    if "unrecognized option" in ran.stderr:
        pytest.skip("this systemd-analyze cannot judge a unit that is not installed")
    assert ran.returncode == 0, ran.stdout + ran.stderr  # at most 2.0 of 10


# ---- container --------------------------------------------------------------------------------------------------------


def instructions(text: str) -> list[tuple[str, str]]:
    """Read a container file: every instruction with what follows it."""
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    joined = re.sub(r"\\\n\s*", " ", "\n".join(lines))
    return [(word, rest.strip()) for word, _, rest in (line.partition(" ") for line in joined.splitlines())]


def test_the_container_file_is_well_formed() -> None:
    found = instructions(CONTAINER.read_text(encoding="utf-8"))
    assert {word for word, _ in found} == INSTRUCTIONS
    assert found[0][0] == "FROM"
    for word, rest in found:
        assert rest, word
        if word in {"ENTRYPOINT", "CMD", "VOLUME"}:
            assert all(isinstance(one, str) for one in json.loads(rest))
        if word == "RUN":
            shlex.split(rest)


def test_images_are_named_plainly_and_not_by_the_day() -> None:
    images = [
        rest.partition(" ")[0] for word, rest in instructions(CONTAINER.read_text(encoding="utf-8")) if word == "FROM"
    ]
    assert images == ["python:3.12", "python:3.12-slim"]


def test_the_container_is_nobody_special() -> None:
    found = instructions(CONTAINER.read_text(encoding="utf-8"))
    words = [word for word, _ in found]
    assert [rest for word, rest in found if word == "USER"] == ["10001:10001"]
    assert words.index("USER") > max(index for index, word in enumerate(words) if word == "RUN")
    assert [
        rest for word, rest in found if word == "RUN" and "setcap" in rest and "setcap cap_net_raw=ep " not in rest
    ] == []


def test_the_command_of_the_container_exists() -> None:
    found = dict(instructions(CONTAINER.read_text(encoding="utf-8")))
    program, command, *arguments = json.loads(found["ENTRYPOINT"])
    assert (program, command) == ("/opt/s7dissect/bin/s7dissect", "monitor")
    check_command([*arguments, *json.loads(found["CMD"])])


@pytest.mark.parametrize("runner", ["docker", "podman"])
def test_the_run_lines_on_the_page_are_locked_down(runner: str) -> None:
    line = re.search(rf"^    ({runner} run (?:.*\\\n)*.*)$", PAGE, re.MULTILINE)
    assert line is not None
    words = shlex.split(line[1].replace("\\\n", " "))
    needed = {
        "--read-only",
        "--cap-drop=ALL",
        "--cap-add=NET_RAW",
        "--network=host",
        "--memory=512m",
        "--pids-limit=64",
    }
    assert needed <= set(words)
    assert not {"--privileged", "--user=root"} & set(words)
    image = max(index for index, word in enumerate(words) if word == "s7dissect-probe")
    options(words[image + 1 :])
