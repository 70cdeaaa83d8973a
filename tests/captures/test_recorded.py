"""Our own recordings: what we make of each is what tshark, and the script that recorded it, say it holds."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import dissect
from captures.record.expect import count_expected
from captures.record.sessions import SESSIONS
from dissect.engine.transactions.transaction import Transaction
from tests.tshark import ask

ROOT = Path(__file__).resolve().parents[2]
CAPTURES = ROOT / "captures"
NAMES = [session.name for session in SESSIONS]


@cache
def description(name: str) -> dict[str, Any]:
    return tomllib.loads((CAPTURES / f"{name}.toml").read_text(encoding="utf-8"))


def recording(name: str) -> str:
    return str(CAPTURES / f"{name}.pcapng")


@cache
def analysis(name: str) -> dict[str, Any]:
    return dict(dissect.analyze(recording(name)).as_dict())


@cache
def transactions_of(name: str) -> list[Transaction]:
    return [event for event in dissect.open(recording(name), pdus=False) if isinstance(event, Transaction)]


@pytest.fixture(params=NAMES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_every_session_is_recorded_and_described() -> None:
    recorded = {path.stem for path in CAPTURES.glob("*.toml") if "recorded" in description(path.stem)}
    assert recorded == set(NAMES)
    readme = (CAPTURES / "README.md").read_text(encoding="utf-8")
    for session in SESSIONS:
        told = description(session.name)
        assert f"| `{session.name}` |" in readme
        assert told["purpose"] == session.purpose
        assert told["port"] == session.port
        assert 0 < Path(recording(session.name)).stat().st_size < 100_000


def test_expected_is_what_the_script_caused(name: str) -> None:
    promise = next(session.promise for session in SESSIONS if session.name == name)
    expected = description(name)["expected"]
    assert expected["answered"] + expected["unanswered"] == promise.asked
    for key in ("connections", "unanswered", "orphan_answers", "item_errors", "header_errors"):
        assert expected[key] == getattr(promise, key)


def test_expected_is_what_tshark_counts(name: str) -> None:
    told = description(name)
    shown = ask(Path(recording(name)), [told["port"]])
    assert shown.code == 0, shown.complaint
    assert count_expected(shown.packets) == told["expected"]


def test_analysis_gives_the_expected_counts(name: str) -> None:
    expected = description(name)["expected"]
    told = analysis(name)
    transactions = told["transactions"]
    assert told["packets"]["read"] == expected["packets"]
    assert len(told["connections"]) == expected["connections"]
    assert told["s7"]["pdus"] == expected["s7_pdus"]
    assert sum(told["s7"]["rosctr"].values()) == expected["s7_pdus"]
    assert told["s7"]["functions"] == expected["functions"]
    for key in ("answered", "unanswered", "orphan_answers", "unsolicited"):
        assert transactions[key] == expected[key]
    assert transactions["total"] == sum(
        expected[key] for key in ("answered", "unanswered", "orphan_answers", "unsolicited")
    )
    for key in ("gaps", "octets_missing", "octets_skipped"):
        assert told["loss"][key] == 0


def test_errors_are_told_where_they_are(name: str) -> None:
    expected = description(name)["expected"]
    transactions = transactions_of(name)
    places = [error.where for transaction in transactions for error in transaction.errors]
    assert sum(place.startswith("item ") for place in places) == expected["item_errors"]
    assert sum(place in {"header", "parameter"} for place in places) == expected["header_errors"]
    failed = sum(bool(transaction.errors) for transaction in transactions)
    assert analysis(name)["transactions"]["with_errors"] == failed


# Where a peer's own octets are wrong: see captures/README.md.
DEFECTS = {"blocks": "s7.malformed", "szl-python": "s7.malformed", "two-clients": "cotp.malformed"}


def test_only_what_is_wrong_is_called_malformed(name: str) -> None:
    findings = analysis(name)["findings"]
    assert {slug for slug in findings if "malformed" in slug} == ({DEFECTS[name]} if name in DEFECTS else set())
    odd = [slug for slug in findings if slug.startswith(("capture.", "stream.", "tpkt.", "internal."))]
    assert odd == (["stream.refused"] if name == "refused-port" else [])
    assert ("session.unusual_port" in findings) == (description(name)["port"] != 102)


@pytest.mark.parametrize(
    ("name", "slug", "count"),
    [
        ("answer-slow", "transaction.slow", 1),
        ("answer-after-fin", "transaction.slow", 1),
        ("answer-lost", "transaction.unanswered", 1),
        ("answer-twice", "transaction.orphan", 1),
        ("client-killed", "transaction.unanswered", 1),
        ("cut-with-reset", "transaction.unanswered", 1),
        ("cut-with-fin", "transaction.unanswered", 1),
        ("many-open", "session.too_many_jobs", 6),
        ("item-errors", "transaction.item_error", 13),
        ("nodes7-poll-missing", "transaction.item_error", 4),
        ("transfer-refused", "transaction.refused", 3),
        ("blocks-python", "transaction.function_mismatch", 1),
    ],
)
def test_the_fault_a_session_was_made_for_is_found(name: str, slug: str, count: int) -> None:
    assert analysis(name)["findings"][slug] == count


@pytest.mark.parametrize(
    "name",
    ["setup-pdu-sizes", "read-areas", "nodes7-poll", "nodes7-poll-parallel", "bsend"],
)
def test_a_session_without_fault_gives_no_finding(name: str) -> None:
    assert analysis(name)["findings"] == {}


@pytest.mark.parametrize(
    ("name", "events"),
    [
        ("write-areas", {"security.write": 1, "security.write_outputs": 1}),
        ("multi-items", {"security.write": 1, "security.write_outputs": 1}),
        ("clock", {"security.clock_set": 2}),
        ("password", {"security.password": 2}),
        (
            "plc-control",
            {"security.memory": 2, "security.plc_start": 2, "security.plc_stop": 2, "security.program_change": 1},
        ),
    ],
)
def test_a_session_without_fault_tells_only_what_matters_for_security(name: str, events: dict[str, int]) -> None:
    assert analysis(name)["findings"] == events


def test_values_are_those_the_server_held() -> None:
    results = [result for transaction in transactions_of("read-areas")[-8:] for result in transaction.s7_results]
    told = [(result.item.address if result.item else "", result.value) for result in results]
    assert told == [
        ("DB2.DBB1", 0x100 - 5),
        ("DB2.DBB2", "O"),
        ("DB2.DBW4", -1234),
        ("DB2.DBW6", 54321),
        ("DB2.DBD8", -123456789),
        ("DB2.DBD12", 4000000000),
        ("DB2.DBD16", 3.5),
        ("DB2.DBB20", "\x06\x04Pump\x00\x00"),
    ]


def test_the_server_asks_in_a_download() -> None:
    asked = [(t.function, t.connection.number, t.asked_by) for t in transactions_of("transfer")]
    client = next(side for function, _, side in asked if function == 0xF0)
    assert [function for function, _, side in asked if side != client] == [0x1B, 0x1C, 0x1B, 0x1B, 0x1C]


@pytest.mark.parametrize("name", ["answer-slow", "answer-after-fin"])
def test_the_late_answer_is_timed(name: str) -> None:
    latencies = sorted(t.latency_ns or 0 for t in transactions_of(name))
    assert 1_500_000_000 <= latencies[-1] < 1_700_000_000
    assert latencies[-2] < 100_000_000


@pytest.mark.parametrize(
    ("name", "ended", "by_server"),
    [("cut-with-reset", "reset", True), ("cut-with-fin", "fin", True), ("client-killed", "fin", False)],
)
def test_who_ended_the_connection_and_what_was_open_then(name: str, ended: str, by_server: bool) -> None:
    (connection,) = analysis(name)["connections"]
    assert connection["ended"] == ended
    assert connection["ended_by"] == connection["server" if by_server else "client"]
    assert connection["open_at_end"] == 1
    assert [t.reason for t in transactions_of(name) if t.reason] == ["connection_closed"]


def test_negotiated_sizes_are_told() -> None:
    connections = analysis("setup-pdu-sizes")["connections"]
    assert [connection["setup_granted"]["pdu_length"] for connection in connections] == [240, 480, 960]
