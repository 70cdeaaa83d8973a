"""Our crafted captures: what we make of each is what the script that wrote it says it wrote."""

from __future__ import annotations

import json
import subprocess
import tomllib
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import dissect
from captures.craft.cases import FOLDER, RECIPES, Case, craft
from captures.craft.files import COMMENT, PLAIN, unpacked
from captures.record.expect import listed
from dissect import Observer, Run, Transaction
from tests.conftest import Command
from tests.tshark import ask, ask_together

NAMES = list(RECIPES)
DAMAGED = [name for name in NAMES if name.startswith("cut-")]
SIDES = ("answered", "unanswered", "orphan_answers", "unsolicited")


@cache
def case_of(name: str) -> Case:
    return craft(name)


@cache
def description(name: str) -> dict[str, Any]:
    return tomllib.loads((FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def capture_of(name: str) -> Path:
    return FOLDER / str(description(name)["file"])


@cache
def analysis(name: str) -> dict[str, Any]:
    return dict(dissect.analyze(str(capture_of(name))).as_dict())


@cache
def transactions_of(name: str) -> list[Transaction]:
    return [event for event in dissect.open(str(capture_of(name)), pdus=False) if isinstance(event, Transaction)]


@pytest.fixture(params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_every_capture_is_there_and_told_of() -> None:
    assert {path.stem for path in FOLDER.glob("*.toml")} == set(NAMES)
    captures = {path.name for path in FOLDER.iterdir() if path.suffix != ".toml"}
    assert captures == {case_of(name).file for name in NAMES}
    readme = (FOLDER.parent / "README.md").read_text(encoding="utf-8")
    assert [name for name in NAMES if f"| `{name}` |" not in readme] == []


def test_script_gives_the_same_octets(name: str, tmp_path: Path) -> None:
    case = case_of(name)
    again = tmp_path / case.file
    again.write_bytes(case.write(case))
    assert unpacked(again) == unpacked(capture_of(name))
    assert case.toml() == (FOLDER / f"{name}.toml").read_text(encoding="utf-8")
    assert 0 < capture_of(name).stat().st_size < 100_000


def test_analysis_gives_the_expected_counts(name: str) -> None:
    expected = description(name)["expected"]
    told = analysis(name)
    counts = {
        "packets": told["packets"]["read"],
        "truncated": told["packets"]["truncated"],
        "connections": len(told["connections"]),
        "s7_pdus": told["s7"]["pdus"],
        **{key: told["transactions"][key] for key in SIDES},
    }
    assert counts == {key: expected[key] for key in counts}
    assert told["transactions"]["total"] == sum(expected[key] for key in SIDES)
    assert told["s7"]["functions"] == expected["functions"]
    assert told["transactions"]["unanswered_reasons"] == expected["unanswered_reasons"]
    assert {key: told["loss"][key] for key in expected["loss"]} == expected["loss"]


def test_analysis_finds_what_is_there_and_nothing_else(name: str) -> None:
    assert analysis(name)["findings"] == description(name)["expected"]["findings"]


def test_kinds_are_counted(name: str) -> None:
    expected, told = description(name)["expected"], analysis(name)
    rosctr = told["s7"]["rosctr"]
    assert sum(rosctr.values()) == expected["s7_pdus"]
    assert rosctr == expected.get("rosctr", rosctr)
    tsdus = {protocol: count for protocol, count in told["tsdus"].items() if count}
    assert tsdus == expected.get("tsdus", tsdus)
    assert told["tpdus"] == expected.get("tpdus", told["tpdus"])
    assert told["ibh"] == expected.get("ibh", told["ibh"])
    assert told["packets"]["ignored"] == expected.get("ignored", told["packets"]["ignored"])


def test_errors_are_told_where_they_are(name: str) -> None:
    expected = description(name)["expected"]
    places = Counter(error.where.split()[0] for transaction in transactions_of(name) for error in transaction.errors)
    assert places["item"] == expected["item_errors"]
    assert places["header"] + places["parameter"] == expected["header_errors"]


def test_every_packet_and_octet_is_accounted_for(name: str) -> None:
    told = analysis(name)
    packets, octets = told["packets"], told["loss"]["octets"]
    assert packets["read"] == sum(packets["used"].values()) + sum(packets["ignored"].values())
    assert octets["delivered"] == octets["framed"] + octets["skipped"] + octets["buffered"]


# ---- tshark ---------------------------------------------------------------------------------------------------------


@cache
def tshark_version() -> str:
    said = subprocess.run(["tshark", "--version"], capture_output=True, text=True, check=True).stdout
    return next(word for word in said.split() if word[0].isdigit())


@cache
def as_decoded() -> dict[str, list[dict[str, Any]]]:
    """The packets of the captures of which tshark shows another number, as a person would ask, by "decode as"."""
    names = [name for name in NAMES if "tshark" in description(name)]
    found: dict[str, list[dict[str, Any]]] = {}
    for ports in sorted({tuple(description(name)["ports"]) for name in names}):
        asked = [part for port in ports for part in ("-d", f"tcp.port=={port},tpkt")]
        alike = {capture_of(name): name for name in names if tuple(description(name)["ports"]) == ports}
        shown = ask_together(list(alike), [*asked, "-T", "json", "-J", "frame tcp s7comm", "--no-duplicate-keys"])
        found |= {alike[path]: packets for path, packets in shown.items()}
    return found


def test_tshark_shows_as_many_pdus_or_it_is_told_why_not(name: str) -> None:
    told = description(name)
    shown = told.get("tshark", {}).get("s7_pdus", told["expected"]["s7_pdus"])
    if "tshark" in told:
        assert shown != told["expected"]["s7_pdus"]
        assert told["tshark"]["why"]
        if not tshark_version().startswith("4.0."):
            pytest.skip(f"what differs was counted with tshark 4.0, this is {tshark_version()}")
        code, packets = 0, as_decoded()[name]
    else:
        packets, code, _ = ask(capture_of(name), told["ports"])
    assert bool(code) == bool(told["exit_code"])
    assert sum(len(listed(layers.get("s7comm"))) for layers in packets) == shown


# ---- what counts do not say -----------------------------------------------------------------------------------------


def test_whole_captures_end_well(s7dissect: Command) -> None:
    whole = [name for name in NAMES if name not in DAMAGED]
    assert {description(name)["exit_code"] for name in whole} == {0}
    ran = s7dissect("analyze", "-T", "json", *map(capture_of, whole))
    assert (ran.returncode, ran.stderr) == (0, b"")
    assert json.loads(ran.stdout)["packets"]["read"] == sum(description(name)["expected"]["packets"] for name in whole)


@pytest.mark.parametrize("name", DAMAGED)
def test_cut_captures_give_their_packets_and_exit_code_3(name: str, s7dissect: Command) -> None:
    ran = s7dissect("analyze", "-T", "json", capture_of(name))
    assert ran.returncode == description(name)["exit_code"] == 3
    assert json.loads(ran.stdout)["packets"]["read"] == description(name)["expected"]["packets"]


@pytest.mark.parametrize("name", PLAIN)
def test_containers_change_nothing_but_the_precision_of_time(name: str) -> None:
    unit = 1 if name in {"plain-ns", "plain-big-endian-ns", "plain-big-endian-ng"} else 1000
    times = [packet.time_ns // unit * unit for packet in case_of(name).packets]
    told = transactions_of(name)
    assert len(told) == 13
    for transaction in told:
        assert transaction.request_ns == times[transaction.request_frame - 1]
        assert transaction.response_ns == times[transaction.response_frame - 1]
    first = transactions_of(PLAIN[0])
    assert [(t.request_octets, t.response_octets) for t in told] == [
        (t.request_octets, t.response_octets) for t in first
    ]


def test_comments_are_told_with_their_packet() -> None:
    class Listener(Observer):
        def __init__(self) -> None:
            super().__init__()
            self.heard: list[tuple[int, str]] = []

        def comment(self, frame: int, text: str) -> None:
            self.heard.append((frame, text))

    listener = Listener()
    run = Run([str(capture_of("sections"))], listener)
    while run.step():
        pass
    commented = [
        (number, packet.comment) for number, packet in enumerate(case_of("sections").packets, 1) if packet.comment
    ]
    assert listener.heard == commented == [(15, COMMENT)]


def test_first_copy_counts() -> None:
    values = [result.value for transaction in transactions_of("conflicts") for result in transaction.s7_results]
    assert values == [[0, number] for number in range(1, 6)]


def test_nothing_is_made_up_for_what_the_capture_cut() -> None:
    cut = [
        t for t in transactions_of("snaplen") if t.connection.number == 1 and t.pdu_ref in (1, 2, 3, 5) and t.s7_results
    ]
    assert [transaction.pdu_ref for transaction in cut][:2] == [1, 2]
    assert [result.value for transaction in cut for result in transaction.s7_results] == [None] * len(cut)


def test_vlans_are_part_of_a_connection() -> None:
    vlans = [connection["vlan"] for connection in analysis("vlan")["connections"]]
    assert sorted(vlans) == [[], [], [10], [10, 20], [20], [20, 10], [30]]
    # Each VLAN reads a size of its own, so a mix-up would show.
    sizes: dict[int, set[int]] = {}
    for transaction in transactions_of("vlan"):
        for result in transaction.s7_results:
            sizes.setdefault(transaction.connection.number, set()).add(len(result.data or b""))
    assert {len(found) for found in sizes.values()} == {1}


def test_refusals_of_connections_say_why() -> None:
    told = [connection["refused"] for connection in analysis("cotp-refused")["connections"]]
    assert [text is not None for text in told] == [True] * 4 + [False]
    details = [finding["detail"] for finding in analysis("cotp-refused")["finding_details"]]
    assert sum("rack 0 slot 31" in detail for detail in details) == 4


def test_protocols_on_port_102_are_named() -> None:
    told = analysis("look-alikes")
    foreign = [finding for finding in told["finding_details"] if finding["slug"] == "session.foreign_on_102"]
    details = [finding["detail"].partition(": ") for finding in foreign]
    assert Counter(name for name, _, _ in details) == {"tls": 2, "mms": 1, "rdp": 2, "unknown": 2}
    assert {identity for name, _, identity in details if name == "rdp"} == {
        "cookie mstshash=operator, asks for TLS or CredSSP",
        "asks for TLS",
    }
    assert [(function["code"], function["answered"]) for function in told["functions"]] == [("0x0560", 6)]


def test_a_second_is_not_slow() -> None:
    latencies = sorted(transaction.latency_ns or 0 for transaction in transactions_of("timing"))
    assert latencies[-2:] == [1_000_000_000, 1_200_000_000]
    assert latencies[0] < 0


def test_who_asked_is_known_for_both_ends() -> None:
    asked = Counter((transaction.asked_by, transaction.function) for transaction in transactions_of("plc-asks"))
    client = next(t.asked_by for t in transactions_of("plc-asks") if t.function == 0xF0)
    assert {function: count for (side, function), count in asked.items() if side != client} == {0x1B: 3, 0x1C: 1, 0: 1}
