"""What to do where capturing is not allowed: it depends on who asks, and on how dumpcap was installed."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from dissect.packets.source.live import advice


@pytest.fixture
def somebody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(advice, "_user", lambda: "ada")


def debian(monkeypatch: pytest.MonkeyPatch, there: bool) -> None:
    monkeypatch.setattr(Path, "exists", lambda _: there)


@pytest.mark.usefixtures("somebody")
def test_a_group_that_may_is_joined(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(advice, "_gate_group", lambda _: "wireshark")
    monkeypatch.setattr(advice, "_is_member", lambda _: False)
    lines = advice.dumpcap_permission("/usr/bin/dumpcap")
    assert lines[0].startswith("sudo usermod -aG wireshark ada ")
    assert not any("setcap" in line for line in lines)


@pytest.mark.usefixtures("somebody")
def test_debian_has_a_set_up_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(advice, "_gate_group", lambda _: "")
    debian(monkeypatch, True)
    lines = advice.dumpcap_permission("/usr/bin/dumpcap")
    assert lines[0].startswith("sudo dpkg-reconfigure wireshark-common")
    assert lines[1].startswith("sudo usermod -aG wireshark ada ")


@pytest.mark.usefixtures("somebody")
@pytest.mark.parametrize(("group", "there"), [("", False), ("wireshark", True)])
def test_elsewhere_capabilities_are_set(monkeypatch: pytest.MonkeyPatch, group: str, there: bool) -> None:
    monkeypatch.setattr(advice, "_gate_group", lambda _: group)
    monkeypatch.setattr(advice, "_is_member", lambda _: True)
    debian(monkeypatch, there)
    assert advice.dumpcap_permission("/opt/dumpcap")[0] == "sudo setcap cap_net_raw,cap_net_admin=eip /opt/dumpcap"


@pytest.mark.usefixtures("somebody")
def test_the_ring_takes_one_right_and_no_other() -> None:
    lines = advice.ring_permission()
    assert "becomes ada again" in lines[0]
    assert "--reuid ada" in lines[2]
    assert "--ambient-caps +net_raw" in lines[2]


def test_root_without_rights_is_in_a_container(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    assert "--cap-add=NET_RAW" in advice.ring_permission()[0]
    assert "--cap-add=NET_RAW" in advice.dumpcap_permission("/usr/bin/dumpcap")[0]


@pytest.mark.parametrize(
    ("mode", "group", "wanted"), [(0o750, 4, True), (0o755, 4, False), (0o750, 0, False), (0o700, 4, False)]
)
def test_the_group_that_alone_may_run_it(monkeypatch: pytest.MonkeyPatch, mode: int, group: int, wanted: bool) -> None:
    import grp

    monkeypatch.setattr(Path, "stat", lambda _: SimpleNamespace(st_mode=0o100000 | mode, st_gid=group))
    expected = grp.getgrgid(group).gr_name if wanted else ""
    assert advice._gate_group("/usr/bin/dumpcap") == expected


def test_no_such_program_has_no_group() -> None:
    assert advice._gate_group("/nowhere/dumpcap") == ""
    assert not advice._is_member("no such group")


def test_a_filter_in_a_message_is_short_and_prints() -> None:
    assert advice.shown("port 1\n" * 400).startswith("'port 1\\x0aport 1")
    assert len(advice.shown("x" * 4000)) < 120
