"""The tests that CI may skip: only those that this build or the rights of the machine rule out.

Tools for tests are installed before they run (`make test-environment`). So in CI a skip for any other reason, such as a
missing tool, is a failure: otherwise the tests of that tool would silently disappear.

Elsewhere a test that starts a program of others which is not installed is skipped, with the program as the reason.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Generator
from typing import Any, Final

import pytest

#: Reasons that are possible in CI, by their beginning. The build has one of two forms; rights and kernels differ.
REASONS: Final = (
    # the build under test
    "compiled functions cannot be traced",
    "lines of compiled code cannot be counted",
    "compiled constants cannot be changed",
    "instructions are counted of the compiled build",
    "no instructions are recorded for",
    "memory is promised for the compiled build",
    # tests that take too long for every change
    "a size for a release",
    # the rights of the user, and the kernel
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
    # files beside the repository that are not part of it
    "no shared captures",
    "no protocol reference",
    "no capture of WinCC there",
    # the versions in the distribution
    r"what differs was counted with tshark 4\.0",
    "this systemd-analyze cannot judge",
)


#: Programs of others that tests start, and that may be missing where a person runs the tests.
PROGRAMS: Final = frozenset(("tshark", "capinfos", "dumpcap", "editcap", "mergecap"))


def missing_program(error: BaseException | None) -> str:
    """Return which of `PROGRAMS` is not installed, if that is why a test failed, in each of its cases; empty otherwise."""
    if isinstance(error, BaseExceptionGroup):
        names = [missing_program(one) for one in error.exceptions]
        return names[0] if all(names) else ""
    while error is not None:
        name = str(getattr(error, "filename", ""))
        if type(error).__name__ == "TSharkNotFoundException":  # pyshark's
            name = "tshark"
        if name in PROGRAMS and shutil.which(name) is None:
            return name
        error = error.__cause__
    return ""


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
    """Let a test fail if it is skipped for an impossible reason."""
    report = yield
    if report.failed and call.excinfo is not None and (name := missing_program(call.excinfo.value)):
        report.outcome = "skipped"
        report.longrepr = (str(item.path), item.location[1] or 0, f"Skipped: {name} is not installed")
    if report.skipped and not hasattr(report, "wasxfail") and isinstance(report.longrepr, tuple):
        complaint = refused(report.longrepr[2])
        if complaint:
            report.outcome = "failed"
            report.longrepr = complaint
    return report
