"""The list of interfaces, from the kernel and from dumpcap."""

from __future__ import annotations

import socket
import struct
import subprocess
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.packets.source.live import interfaces, opening
from dissect.packets.source.live.interfaces import NetworkInterface, find_interface, list_interfaces
from tests.packets.source.live_support import in_namespace

LISTED = (
    "1. en0\t\tWi-Fi\t1\tfe80::1,192.168.1.7\tnetwork\t\n"
    "2. lo0\t\tLoopback\t0\t127.0.0.1,::1\tloopback\t\n"
    "nonsense\n3. short\n4. utun0\t\t\t0\t\tnetwork\t\n"
)


def test_loopback_is_there() -> None:
    lo = find_interface("lo")
    assert lo is not None
    assert lo.loopback
    assert (lo.link_type, lo.link_name, lo.mac) == (1, "Ethernet", "00:00:00:00:00:00")
    assert lo.mtu > 1000
    assert lo.lost == 0
    assert lo.number == socket.if_nametoindex("lo")
    assert [name for _, name in socket.if_nameindex()] == [one.name for one in list_interfaces()]


def test_no_such_interface() -> None:
    assert find_interface("nosuch0") is None


def test_states_and_addresses_of_this_network_namespace() -> None:
    def task() -> None:
        assert [one.name for one in list_interfaces()] == ["lo", "vb", "va"]
        for words in (
            "addr add 192.0.2.1/24 dev va",
            "addr add 2001:db8::1/64 dev va nodad",
            "link set vb down",
            "link set va address 02:00:00:00:00:07 mtu 1400",
        ):
            subprocess.run(["ip", *words.split()], check=True)
        va, vb = find_interface("va"), find_interface("vb")
        assert va is not None
        assert vb is not None
        assert va.state == "no carrier"
        assert vb.state == "down"
        assert va.addresses[0] == "192.0.2.1/24"
        assert "2001:db8::1/64" in va.addresses
        assert (va.mac, va.mtu, va.loopback) == ("02:00:00:00:00:07", 1400, False)
        subprocess.run(["ip", "link", "set", "vb", "up"], check=True)
        end = time.monotonic() + 60  # the kernel tells of a carrier a little later
        while "up" not in {one.state for one in list_interfaces() if one.name == "va"}:
            assert time.monotonic() < end

    in_namespace(task)


def link(kind: int, flags: int, *attributes: tuple[int, bytes]) -> bytes:
    packed = [struct.pack("=HH", 4 + len(value), code) + value + bytes(-len(value) % 4) for code, value in attributes]
    return struct.pack("=BxHiII", 0, kind, 7, flags, 0) + b"".join(packed)


def test_a_link_of_another_kind() -> None:
    counts = struct.pack("=24Q", *range(24))
    made = interfaces._parse_link(link(280, 1, (3, b"can0\0"), (16, b"\6"), (23, counts)), {7: ["10.0.0.1/8"]})
    assert made == NetworkInterface("can0", 7, "up", False, -1, "CAN", "", 0, ("10.0.0.1/8",), 14 + 15)
    assert interfaces._parse_link(link(0xFFFE, 0, (3, b"tun0\0")), {}).link_type == 101
    assert interfaces._parse_link(link(4242, 0, (3, b"x\0")), {}).link_name == "ARPHRD 4242"
    assert interfaces._parse_link(link(1, 0, (23, counts[:80])), {}).lost is None


@given(st.binary(max_size=80))
def test_any_attributes(octets: bytes) -> None:
    interfaces._parse_link(link(1, 1) + octets, {})
    interfaces._parse_address(struct.pack("=BBBBi", 2, 24, 0, 0, 1) + octets)


def stub(directory: Path, text: str) -> str:
    program = directory / "dumpcap"
    program.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
    program.chmod(0o755)
    return str(program)


def test_without_rtnetlink_dumpcap_is_asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delattr(socket, "AF_NETLINK")
    (tmp_path / "listed").write_text(LISTED, encoding="utf-8")
    program = stub(tmp_path, f'[ "$*" = "-D -M" ] && cat {tmp_path}/listed')
    assert list_interfaces(program) == [
        NetworkInterface("en0", 1, "", False, -1, "", "", 0, ("fe80::1", "192.168.1.7"), None),
        NetworkInterface("lo0", 2, "", True, -1, "", "", 0, ("127.0.0.1", "::1"), None),
        NetworkInterface("utun0", 4, "", False, -1, "", "", 0, (), None),
    ]
    assert list_interfaces() == []


def test_windows_names_are_those_that_it_shows(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delattr(socket, "AF_NETLINK")
    device = r"\Device\NPF_{0BADC0DE-0000-4000-8000-000000000001}"
    (tmp_path / "listed").write_text(
        f"1. {device}\tIntel(R) Ethernet\tEthernet 2\t0\t192.168.0.9\tnetwork\n"
        f"2. {device}x\t\t\t0\t\tnetwork\n"
        "3. \\Device\\NPF_Loopback\tAdapter for loopback\tAdapter for loopback\t0\t127.0.0.1\tloopback\n",
        encoding="utf-8",
    )
    program = stub(tmp_path, f'[ "$*" = "-D -M" ] && cat {tmp_path}/listed')
    assert [one.name for one in list_interfaces(program)] == ["Ethernet 2", f"{device}x", "Adapter for loopback"]
    assert {device, "Ethernet 2", f"{device}x", "Adapter for loopback"} <= set(opening._special(program))


def test_a_program_that_cannot_be_started_is_no_answer(tmp_path: Path) -> None:
    answer = interfaces.ask(str(tmp_path / "nothing"), "-D")
    assert answer.returncode == 1
    assert b"No such file" in answer.stderr
