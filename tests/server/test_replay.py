"""Each capture is served, and its client played against it: to the octet what the recorded server said."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.server import Server
from tests.server.support import Tpkts, play

FOLDER = Path(__file__).resolve().parent.parent.parent / "captures"
#: Nobody listened there, so that there is nothing to serve.
NOTHING = {"refused-port"}
NAMES = sorted(path.stem for path in FOLDER.glob("*.pcapng") if path.stem not in NOTHING)


@pytest.mark.parametrize("name", NAMES)
def test_the_fake_plc_says_what_the_recorded_one_said(name: str) -> None:
    path = FOLDER / f"{name}.pcapng"
    connections = Tpkts(path).connections
    assert connections
    with Server(path) as server:
        for number, packets in enumerate(connections, 1):
            if (
                name == "two-clients" and number == 2
            ):  # the confirmation of its end has a broken variable part (captures/README.md)
                packets = packets[:-1]
            wanted, got = play(server, packets)
            assert got.hex(" ") == wanted.hex(" ")
            assert wanted or name == "refused-full"
        assert server.unmatched == []
        assert not [text for text in server.problems if "broken" in text]


@pytest.mark.parametrize("name", ["two-clients", "setup-pdu-sizes"])
def test_connections_at_once_do_not_mix(name: str) -> None:
    connections = Tpkts(FOLDER / f"{name}.pcapng").connections
    with Server(FOLDER / f"{name}.pcapng") as server:
        for packets in reversed(connections):
            if name == "two-clients":  # their TSAPs tell them apart
                wanted, got = play(server, packets[:-1])
                assert got == wanted
        assert server.unmatched == []


def test_public_captures_play_as_well(corpus: Path) -> None:
    for name in ("s7comm_downloading_block_db1.pcap", "s7comm_varservice_libnodavedemo.pcap", "step7_s300_stop.pcapng"):
        with Server(corpus / name) as server:
            for packets in Tpkts(corpus / name).connections:
                wanted, got = play(server, packets)
                assert got == wanted
            assert server.unmatched == []
