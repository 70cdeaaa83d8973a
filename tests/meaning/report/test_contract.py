from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.transactions.accounts import CATEGORIES, FIRST_IGNORED
from dissect.engine.transactions.transaction import OUTCOMES, REASON_TEXTS
from dissect.files.session import Run
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.contract import analysis_as_dict
from dissect.meaning.report.text import analysis_lines
from dissect.protocols.ibh.tables import IBH_NETLINK, KINDS
from dissect.protocols.iso.upper import UPPER_NAMES
from dissect.wire.malformed import LIMITS, REASONS
from tests.cases import each
from tests.meaning.report.schemas import NAMES, ROOT, complaints, load, parts, quick_validator, strict, table, validator
from tests.meaning.report.support import OWN, WORD, Kept, analysed, begun, observed, of_files, read
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import Flow, captured, cut_to

Told = dict[str, Any]


def told_of(analysis: Analysis) -> Told:
    """Return an analysis the way a program reads it, held to the schema and to itself."""
    told: Told = json.loads(json.dumps(analysis_as_dict(analysis)))
    assert complaints("analysis", told, exact=True) == []
    consistent(told)
    return told


def consistent(told: Told) -> None:
    """Hold an analysis to the sums that docs/json.md promises."""
    packets, octets, counts = told["packets"], told["loss"]["octets"], told["transactions"]
    assert packets["read"] == sum(packets["used"].values()) + sum(packets["ignored"].values())
    assert packets["read"] == sum(file["packets"] for file in told["files"])
    assert octets["delivered"] == octets["framed"] + octets["skipped"] + octets["buffered"]
    assert octets["failed"] == 0
    assert octets["skipped"] == told["loss"]["octets_skipped"]
    assert octets["missing"] == told["loss"]["octets_missing"]
    assert octets["holes"] == told["loss"]["gaps"]
    assert told["s7"]["pdus"] == sum(told["s7"]["rosctr"].values()) == told["tsdus"]["s7comm"]
    assert sum(told["s7"]["functions"].values()) <= told["s7"]["pdus"]
    outcomes = ("answered", "unanswered", "orphan_answers", "unsolicited")
    assert counts["total"] == sum(counts[key] for key in outcomes)
    assert counts["unanswered"] == sum(counts["unanswered_reasons"].values())
    pdus = told["s7"]["pdus"] + told["s7plus"]["pdus"]
    unpaired = told["s7"]["unpaired"] + told["s7plus"]["unpaired"]
    assert pdus == 2 * counts["answered"] + sum(counts[key] for key in outcomes[1:]) + unpaired
    assert told["s7plus"]["pdus"] == sum(told["s7plus"]["versions"].values())
    for key in ("total", "answered", "unanswered", "still_open", "with_errors"):
        assert counts[key] == sum(function[key] for function in told["functions"])
    if not told["connections_not_listed"]:
        for key in (*outcomes, "with_errors"):
            assert counts[key] == sum(connection[key] for connection in told["connections"])
        assert pdus == sum(connection["pdus"] for connection in told["connections"])
    numbers = [connection["number"] for connection in told["connections"]]
    assert numbers == sorted(numbers)
    times = told["latency_ns"]
    if counts["answered"]:
        assert times["min"] <= times["median"] <= times["p95"] <= times["p99"] <= times["max"]
        assert told["slowest"][0]["latency_ns"] == times["max"]
    else:
        assert {times[key] for key in ("min", "median", "p95", "p99", "max")} == {None}
    missed = counts["unanswered"] - counts["still_open"] - counts.get("answers_not_captured", 0)
    assert len(told["failed"]) == min(100, counts["with_errors"] + missed)
    assert counts.get("answers_not_captured", 0) == sum(
        [counts["unanswered_reasons"].get(reason, 0) for reason in ("hole", "one_sided")]
    )
    assert counts.get("likely", 0) == sum(counts.get("likely_doubts", {}).values())
    assert counts.get("likely", 0) == sum(function.get("likely", 0) for function in told["functions"])
    found = told["finding_details"]
    details = [finding["slug"] for finding in found if finding["because_of"] is None]
    assert set(details) <= set(told["findings"]) <= set(CATALOGUE)
    assert all(details.count(slug) <= told["findings"][slug] for slug in details)
    explained = [(finding["because_of"], finding["slug"]) for finding in found if finding["because_of"] is not None]
    assert all(explained.count(pair) <= told["findings_explained"][pair[0]][pair[1]] for pair in explained)
    causes = {finding["number"]: finding["slug"] for finding in found}
    assert len(causes) == len(found)
    for finding in found:
        if finding["explained_by"] is not None:
            assert finding["explained_by"] < finding["number"]
            assert causes.get(finding["explained_by"], finding["because_of"]) == finding["because_of"]


def small(told: Told) -> Told:
    """Return the parts of an analysis that a test of counts compares."""
    return {key: told[key] for key in ("packets", "tsdus", "s7", "transactions", "findings")}


# ---- the schemas and the documentation ------------------------------------------------------------------------------


@each("name", NAMES)
def test_the_schemas_are_schemas(name: str) -> None:
    Draft202012Validator.check_schema(load(name))
    Draft202012Validator.check_schema(strict(load(name)))


@each(("before", "behind", "lines"), list(parts()))
def test_every_key_is_documented(before: str, behind: str, lines: list[str]) -> None:
    text = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
    assert text.split(before, 1)[1].split(f"\n{behind}", 1)[0].split("\n") == lines


@each("name", NAMES)
def test_every_key_has_a_sentence(name: str) -> None:
    assert [row for row in table(name) if row.endswith("|  |")] == []


def test_an_unknown_key_is_welcome_but_noticed() -> None:
    told = told_of(analysed(begun().packets()))
    for part in (told, told["packets"], told["connections"][0], told["latency_ns"], told["functions"][0]["latency_ns"]):
        part["surprise"] = 1
        assert complaints("analysis", told, exact=False) == []
        assert len(complaints("analysis", told, exact=True)) >= 1
        del part["surprise"]
    assert complaints("analysis", told, exact=True) == []


def test_what_looks_fast_and_what_explains_agree() -> None:
    """`complaints` asks the second library only about what the first objects to."""
    told = told_of(analysed(begun().packets()))
    wrong: list[Told] = [{key: value for key, value in told.items() if key != left} for left in told]
    wrong += [{**told, key: value} for key in list(told)[::4] for value in (None, "x", {"x": 1})]
    first = told["connections"][0]
    wrong += [{**told, "connections": [{**first, key: {}}]} for key in list(first)[::4]]
    seen = set()
    for one in wrong:
        for exact in (False, True):
            sound = quick_validator("analysis", exact=exact).is_valid(one)
            assert sound == validator("analysis", exact=exact).is_valid(one), one
            assert bool(complaints("analysis", one, exact=exact)) is not sound
            seen.add(sound)
    assert seen == {True, False}


@pytest.mark.parametrize("key", ["schema", "packets", "connections", "loss"])
def test_a_missing_key_is_noticed(key: str) -> None:
    told = told_of(analysed(begun().packets()))
    del told[key]
    assert complaints("analysis", told, exact=False)


def enumeration(name: str, *path: str) -> set[str | None]:
    part: Any = load(name)
    for step in path:
        part = part[step]
    return set(part)


def test_enumerations_are_those_of_the_engine() -> None:
    packets = ("properties", "packets", "properties")
    assert enumeration("analysis", *packets, "used", "propertyNames", "enum") == set(CATEGORIES[:FIRST_IGNORED])
    assert enumeration("analysis", *packets, "ignored", "propertyNames", "enum") == set(CATEGORIES[FIRST_IGNORED:])
    assert enumeration("analysis", "properties", "tsdus", "propertyNames", "enum") == set(UPPER_NAMES)
    protocols = enumeration("analysis", "properties", "connections", "items", "properties", "protocol", "enum")
    assert protocols == {None, IBH_NETLINK, *UPPER_NAMES} - {"empty"}
    assert enumeration("analysis", "properties", "ibh", "propertyNames", "enum") == set(KINDS)
    assert enumeration("transaction", "properties", "outcome", "enum") == set(OUTCOMES) - {"open"}
    assert enumeration("transaction", "properties", "reason", "enum") == {None, *REASON_TEXTS}
    malformed = ("$defs", "malformed", "items", "properties")
    assert enumeration("pdu", *malformed, "reason", "enum") == set(REASONS)
    assert enumeration("pdu", *malformed, "limit", "enum") == set(LIMITS)


def test_every_word_of_an_enumeration_is_explained() -> None:
    text = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
    words: Iterable[str] = (*CATEGORIES, *OUTCOMES[1:], *REASON_TEXTS, *REASONS, *LIMITS)
    assert [word for word in words if f"`{word}`" not in text] == []


# ---- on captures ----------------------------------------------------------------------------------------------------


def count_transactions(path: Path) -> int:
    """Return how many transactions are told of a capture."""
    kept = Kept()
    run = Run([str(path)], kept)
    while run.step():
        pass
    return len(kept.transactions)


@each("path", OWN)
def test_the_contract_holds_on_our_captures(path: Path) -> None:
    assert told_of(of_files(path))["transactions"]["total"] == count_transactions(path)


def test_the_contract_holds_on_shared_captures(corpus: Path) -> None:
    paths = sorted(corpus.glob("*.pcap*"))
    assert len(paths) >= 20
    for path in paths:
        assert told_of(of_files(path))["transactions"]["total"] == count_transactions(path), path.name


# ---- what the keys say ----------------------------------------------------------------------------------------------


def test_the_other_vlans_of_a_connection() -> None:
    flows = Flow(vlans=(10,)), Flow(vlans=(5, 20))
    sent = [segment._replace(flow=flows[segment.side]) for segment in read(begun(), 1).segments]
    (connection,) = told_of(analysed(captured(sent)))["connections"]
    assert (connection["vlan"], connection["also_vlans"]) == ([10], [[5, 20]])


def test_a_connection_from_beginning_to_end() -> None:
    talk = read(begun(Flow(vlans=(100, 7)), amq=3, length=240), 1)
    talk.send(0, dt(messages.read_job(2, [WORD]))).reset(1)
    told = told_of(analysed(talk.packets()))
    (connection,) = told["connections"]
    setup = {"max_amq_calling": 3, "max_amq_called": 3, "pdu_length": 240}
    assert connection == {
        "number": 1,
        "client": "10.0.0.1:49152",
        "server": "10.0.0.2:102",
        "client_known": True,
        "transport": "tcp",
        "vlan": [100, 7],
        "protocol": "s7comm",
        "identified_by": None,
        "tls": None,
        "start": "syn",
        "first_frame": 1,
        "first_time": "2024-03-04T05:06:07.000000000Z",
        "last_frame": 11,
        "last_time": "2024-03-04T05:06:07.010000000Z",
        "calling_tsap": {"octets": "0100", "text": "01.00", "connection_type": 1, "rack": 0, "slot": 0},
        "called_tsap": {"octets": "0102", "text": "01.02", "connection_type": 1, "rack": 0, "slot": 2},
        "tpdu_size": 1024,
        "setup_asked": setup,
        "setup_granted": setup,
        "pdus": 5,
        "answered": 2,
        "unanswered": 1,
        "still_open": 0,
        "orphan_answers": 0,
        "unsolicited": 0,
        "one_way": 0,
        "with_errors": 0,
        "refused": None,
        "disconnected": None,
        "ended": "reset",
        "ended_by": "10.0.0.2:102",
        "ended_frame": 11,
        "open_at_end": 1,
        "ending": {
            "how": "reset",
            "by": "10.0.0.2:102",
            "role": "server",
            "frame": 11,
            "time": "2024-03-04T05:06:07.010000000Z",
            "reset": None,
            "silence_ns": 1_000_000,
            "connecting": False,
            "open_requests": 1,
            "oldest_request": {"what": "Read Var DB10.DBW4", "before_ns": 1_000_000},
            "last_request": {"what": "Read Var DB10.DBW4", "before_ns": 1_000_000},
            "last_answer": {"what": "Read Var DB10.DBW4", "before_ns": 2_000_000},
            "last_error": None,
        },
    }
    assert told["transactions"]["unanswered_reasons"] == {"connection_closed": 1}
    assert told["failed"][0]["request_frame"] == 10


def test_functions_tell_userdata_apart() -> None:
    talk = read(begun(), 1).send(0, dt(messages.userdata(2, 1, 4, 1, b"\x00\x11\x00\x00")))
    talk.send(1, dt(messages.userdata(2, 2, 4, 1, b"", 0xD402)))
    talk.send(1, dt(messages.pdu(messages.USERDATA, 0, b"\x01\x00\x10\x10\x00\x00\x00\x00")))
    functions = told_of(analysed(talk.packets()))["functions"]
    keys = ("code", "group", "subfunction", "name", "total", "with_errors")
    assert [[function.get(key) for key in keys] for function in functions] == [
        ["0x04", None, None, "Read Var", 1, 0],
        ["0xf0", None, None, "Setup communication", 1, 0],
        ["0x01", 0, 0, "mode transition: STOP", 1, 0],
        ["0x00", 4, 1, "CPU functions: read SZL", 1, 1],
    ]


def test_cut_packets_and_other_protocols_are_counted() -> None:
    talk = begun().send(1, dt(b"\x72\xff\x01\x00"))
    packets = talk.send(0, dt(messages.read_job(1, [WORD]))).packets()
    packets[-1] = cut_to(packets[-1], 54 + 7 + 12)
    told = told_of(analysed(packets))
    assert told["packets"]["truncated"] == 1
    assert told["s7"]["cut"] == 1
    assert told["tsdus"]["s7comm_plus"] == told["s7plus"]["pdus"] == told["s7plus"]["unpaired"] == 1


def test_an_analysis_that_was_never_filled_says_what_to_do() -> None:
    with pytest.raises(ValueError, match=r"dissect\.analyze"):
        analysis_as_dict(Analysis())
    assert list(analysis_lines(Analysis()))  # the report of nothing is short, but one


def test_an_empty_capture() -> None:
    told = told_of(analysed([]))
    assert (told["first_time"], told["last_time"], told["packets"]["read"]) == (None, None, 0)


def test_interruption_is_told() -> None:
    analysis = analysed(begun().packets())
    assert analysis_as_dict(analysis)["interrupted"] is False
    assert analysis_as_dict(analysis, interrupted=True)["interrupted"] is True


# ---- several files --------------------------------------------------------------------------------------------------


def test_packets_are_numbered_within_their_file() -> None:
    packets = read(read(begun(), 1), 2, WORD, 0x0A).send(0, dt(messages.read_job(3, [WORD]))).reset(1).packets()
    whole = told_of(analysed(packets))
    split = told_of(analysed(packets[:10], packets[10:]))
    assert small(split) == small(whole)
    (connection,) = split["connections"]
    assert (connection["first_frame"], connection["first_file"]) == (1, "1.pcap")
    assert (connection["last_frame"], connection["last_file"]) == (3, "2.pcap")
    assert (connection["ended_frame"], connection["ended_file"]) == (3, "2.pcap")
    refused = next(finding for finding in split["finding_details"] if finding["slug"] == "transaction.item_error")
    assert (refused["frames"], refused["files"]) == ([10, 1], ["1.pcap", "2.pcap"])
    failed = split["failed"][0]
    assert (failed["request_frame"], failed["request_file"]) == (10, "1.pcap")
    assert (failed["response_frame"], failed["response_file"]) == (1, "2.pcap")


def test_one_file_has_no_key_that_names_it() -> None:
    told = json.dumps(told_of(analysed(read(begun(), 1, WORD, 0x0A).packets())))
    assert not [key for key in ('_file":', '"files": ["') if key in told]


def test_a_connection_that_is_open_has_no_end() -> None:
    told = told_of(analysed(begun().packets(), read(begun(Flow(ports=(49153, 102))), 1).packets()))
    assert [
        (connection["ended"], connection["ended_frame"], connection["ended_file"]) for connection in told["connections"]
    ] == [("open", None, None)] * 2


def test_connections_are_in_order_of_their_numbers() -> None:
    first, second = begun(), begun(Flow(ports=(49153, 102)))
    packets = first.packets()[:7]
    packets += [
        packet._replace(time_ns=packets[-1].time_ns + packet.time_ns % 10**9) for packet in second.close().packets()
    ]
    told = told_of(analysed(packets))
    assert [connection["client"] for connection in told["connections"]] == ["10.0.0.1:49152", "10.0.0.1:49153"]


def test_many_connections_are_counted() -> None:
    analysis = Analysis()
    packets = [
        packet for number in range(1002) for packet in begun(Flow(ports=(20000 + number, 102))).packets(step_ns=0)
    ]
    pipeline = observed(analysis, packets)
    analysis.take(pipeline, [])
    told = json.loads(json.dumps(analysis_as_dict(analysis)))
    assert complaints("analysis", told, exact=True) == []
    assert (len(told["connections"]), told["connections_not_listed"]) == (1000, 2)
