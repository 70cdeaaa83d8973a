"""Counting: the same numbers as the analysis has, and never more series than there are names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from dissect import scd
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.payloads import ScdMessage, ScdParameters
from dissect.engine.transactions.transaction import ANSWERED, ORPHAN, PUSH, UNANSWERED, Transaction
from dissect.files.session import Run
from dissect.meaning.report.analysis import Analysis
from dissect.online.live.run import Fanout, LiveRun
from dissect.online.metrics.counters import SEPARATOR, Metrics
from dissect.online.metrics.functions import BOUNDS_NS, MAX_SCD, OTHER, FunctionCounts, Functions
from dissect.packets.source.files import open_capture
from dissect.packets.source.live.reader import Drops
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.s7.errors import ERROR_CODES
from dissect.protocols.s7.parameters import Parameters, parse_parameters
from dissect.protocols.s7.tables import FUNCTIONS, JOB, USERDATA, USERDATA_SUBFUNCTIONS
from dissect.protocols.s7plus.parameters import PlusParameters
from dissect.protocols.s7plus.tables import FUNCTIONS as PLUS_FUNCTIONS
from tests.cases import each
from tests.conftest import ROOT
from tests.meaning.bindings import plant

CAPTURES: Final = sorted((ROOT / "captures").glob("*.pcapng"))


def counted(path: Path) -> tuple[Metrics, Analysis]:
    """Read a capture once and tell both."""
    metrics, analysis = Metrics(), Analysis()

    def fail(_observer: object, error: Exception) -> None:
        raise error

    run = Run([str(path)], Fanout([metrics, analysis], fail))
    metrics.begin(run.pipeline)
    while run.step():
        pass
    analysis.take(run.pipeline, run.files)
    return metrics, analysis


def rows(metrics: Metrics) -> Iterator[FunctionCounts]:
    return iter(metrics.functions.rows.values())


def test_there_are_captures() -> None:
    assert len(CAPTURES) > 20


@each("path", CAPTURES)
def test_the_numbers_are_those_of_the_analysis(path: Path) -> None:
    metrics, analysis = counted(path)
    totals: Counter[int] = Counter()
    for row in rows(metrics):
        totals.update(dict(enumerate(row.outcomes)))
        assert sum(row.buckets) == row.outcomes[ANSWERED]
    assert totals.total() == analysis.total
    assert totals[ANSWERED] == analysis.answered == analysis.latencies.count
    assert totals[UNANSWERED] == analysis.unanswered
    assert (totals[ORPHAN], totals[PUSH]) == (analysis.orphans, analysis.unsolicited)
    assert sum(row.errors for row in rows(metrics)) == analysis.with_errors
    assert metrics.unanswered == analysis.unanswered_reasons
    operations = {
        f"{kind}{SEPARATOR}{result}": count
        for kind, results in analysis.operations.items()
        for result, count in results.items()
    }
    assert metrics.operations == operations
    assert metrics.opened == sum(metrics.ended.values()) == len(analysis.connections)
    endings = [connection.ending.how for connection in analysis.connections if connection.ending is not None]
    assert metrics.ended == Counter(endings)


@each("path", CAPTURES)
def test_functions_are_those_of_the_analysis(path: Path) -> None:
    metrics, analysis = counted(path)
    theirs: Counter[str] = Counter()
    for statistics in analysis.functions.values():
        theirs[statistics.name] += int(statistics.total)
    ours = {
        f"S7comm-plus {row.name}" if row.protocol == "s7comm_plus" else row.name: sum(row.outcomes)
        for row in rows(metrics)
    }
    assert ours == theirs


def test_a_live_run_tells_its_companion() -> None:
    path = ROOT / "captures" / "answer-lost.pcapng"
    metrics, analysis = Metrics(clock=lambda: 5), Analysis()
    run = LiveRun(open_capture(str(path)), analysis, companions=[metrics])
    while run.step():
        pass
    assert metrics.pipeline is run.pipeline
    assert sum(sum(row.outcomes) for row in rows(metrics)) == analysis.total > 0
    metrics.tick(2, Drops(7, None))
    assert (metrics.lag_ns, metrics.drops, metrics.queue) == (3, Drops(7, None), None)
    metrics.watch_queue(lambda: (4, 1))
    assert metrics.queue == (4, 1)


# ---- answer times -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("latency_ns", "bucket"),
    [(-5, 0), (0, 0), (1_000_000, 0), (1_000_001, 1), (10_000_000_000, 12), (10_000_000_001, 13), (1 << 62, 13)],
)
def test_an_answer_time_is_in_the_bucket_that_ends_at_or_after_it(latency_ns: int, bucket: int) -> None:
    row = FunctionCounts("s7comm", "Read Var")
    row.add_latency(latency_ns)
    assert row.buckets == [int(index == bucket) for index in range(len(BOUNDS_NS) + 1)]
    assert row.sum_ns == max(latency_ns, 0)


# ---- functions --------------------------------------------------------------------------------------------------------


def userdata(group: int, subfunction: int, type_: int = 1) -> Parameters:
    """Return the parameter block of a userdata PDU."""
    return parse_parameters(bytes((0, 1, 0x12, 4, 0x11, type_ << 6 | group, subfunction, 0)), USERDATA)


def test_a_job_without_a_name_is_other() -> None:
    functions = Functions()
    for code in range(256):
        functions.of(parse_parameters(bytes((code, 0)), JOB))
    assert {row.name for row in functions.rows.values()} == {code.name for code in FUNCTIONS} | {OTHER}
    assert functions.of(parse_parameters(b"", JOB)).name == "no function"


def test_userdata_without_a_name_is_other_in_its_group() -> None:
    functions = Functions()
    for group in range(64):
        for subfunction in range(256):
            functions.of(userdata(group, subfunction))
    names = {row.name for row in functions.rows.values()}
    assert {"CPU functions: read SZL", "CPU functions: other", "userdata: other"} <= names
    assert len(names) <= sum(len(table) + 1 for table in USERDATA_SUBFUNCTIONS.values()) + 1
    assert len(functions._by_key) < len(names)


def test_plus_functions_without_a_name_are_other() -> None:
    functions = Functions()
    for code in range(-1, 4096):
        functions.of(PlusParameters(code))
    names = {row.name for row in functions.rows.values()}
    assert names == {code.name for code in PLUS_FUNCTIONS} | {OTHER, "notification"}
    assert {row.protocol for row in functions.rows.values()} == {"s7comm_plus"}


def test_a_function_of_each_protocol_has_a_row_of_its_own() -> None:
    functions = Functions()
    one, two = functions.of(parse_parameters(b"\x99", JOB)), functions.of(PlusParameters(0x99))
    assert (one.name, two.name) == (OTHER, OTHER)
    assert one is not two


def test_functions_of_a_dictionary_are_bounded(scd_message: ScdMessage) -> None:
    functions = Functions()
    for number in range(2 * MAX_SCD):
        functions.of(ScdParameters(number, f"PDO {number}", scd_message))
        functions.of(ScdParameters(number, f"PDO {number}", scd_message))
    names = [row.name for row in functions.rows.values()]
    assert names == [*(f"PDO {number}" for number in range(MAX_SCD)), OTHER]


@pytest.fixture
def scd_message() -> ScdMessage:
    """Something of SCD; only its place in a parameter block counts here."""
    return ScdMessage(scd.Message(), plant.dictionary(), "binding", b"")


# ---- errors -----------------------------------------------------------------------------------------------------------


def refused(code: int) -> Transaction:
    """Return a read whose answer says no as a whole."""
    ends = (Endpoint(b"\x0a\0\0\1", 1025), Endpoint(b"\x0a\0\0\2", 102))
    connection = Connection(1, TcpConnection(*ends, 0, 1, 0))
    transaction = Transaction(1, connection, 0, JOB, 1, parse_parameters(b"\x04\x00", JOB))
    transaction._outcome = ANSWERED
    transaction.has_errors = True
    transaction.error_code = code
    return transaction


@pytest.mark.parametrize(
    ("code", "class_"), [(0x8104, "application relationship"), (0x8701, "access"), (0xD241, "0xd2"), (0x7777, OTHER)]
)
def test_the_class_of_an_error(code: int, class_: str) -> None:
    metrics = Metrics()
    metrics.transaction(refused(code))
    assert metrics.errors == {f"header{SEPARATOR}{class_}": 1}


def test_classes_of_errors_are_bounded() -> None:
    metrics = Metrics()
    for code in range(1, 0x10000, 7):
        metrics.transaction(refused(code))
    classes = {key.partition(SEPARATOR)[2] for key in metrics.errors}
    assert len(classes) <= len({code.number >> 8 for code in ERROR_CODES}) + 8


def test_a_no_without_a_code_is_counted_too() -> None:
    metrics = Metrics()
    metrics.transaction(refused(0))
    assert metrics.errors == {f"{OTHER}{SEPARATOR}{OTHER}": 1}


def test_items_are_counted_each() -> None:
    metrics, _ = counted(ROOT / "captures" / "item-errors.pcapng")
    assert metrics.errors == {
        f"item{SEPARATOR}Object does not exist": 4,
        f"item{SEPARATOR}Invalid address": 7,
        f"item{SEPARATOR}Data type inconsistent": 2,
    }
