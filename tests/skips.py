"""Which tests CI may skip: those that this build or the rights of the machine rule out, never one whose tool is missing there.

What tests need is installed before they run (`make test-environment`). So in CI a skip for any other reason than these is a
failure: a tool that is gone would take its tests along, and nobody would see it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Generator
from typing import Any, Final

import pytest

#: Reasons that may hold in CI, by their beginning. The build has one of two forms; rights and kernels differ.
REASONS: Final = (
    # the build under test
    "compiled functions cannot be traced",
    "lines of compiled code cannot be counted",
    "compiled constants cannot be changed",
    "instructions are counted of the compiled build",
    "no instructions are recorded for",
    "memory is promised for the compiled build",
    # what takes too long for every change
    "a size for a release",
    # the rights of the user, and what the kernel gives
    "only root ",
    "root may (read|write) anywhere",
    "no device nodes in this folder",
    "no packet socket here",
    "dumpcap cannot capture here",
    "(ring|dumpcap) cannot capture here",
    "no network namespace",
    "no file capabilities here",
    "ip (link|addr)",
    "there can be no line here",
    "no IPv6 ",
    # what lies beside the repository, and is not part of it
    "no shared captures",
    "no protocol reference",
    "no capture of WinCC there",
    # the versions that the distribution has
    r"what differs was counted with tshark 4\.0",
    "this systemd-analyze cannot judge",
)


def refused(reason: str, environment: dict[str, str] | os._Environ[str] = os.environ) -> str:
    """Return why a test must not be skipped for ``reason``, empty when it may be."""
    reason = reason.removeprefix("Skipped: ")
    if not environment.get("CI") or any(re.match(known, reason) for known in REASONS):
        return ""
    return f"skipped in CI, where what tests need is installed (tests/skips.py): {reason}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[Any]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Let a test fail that is skipped for a reason that cannot hold."""
    report = yield
    if report.skipped and not hasattr(report, "wasxfail") and isinstance(report.longrepr, tuple):
        complaint = refused(report.longrepr[2])
        if complaint:
            report.outcome = "failed"
            report.longrepr = complaint
    return report
