"""Operations on one line."""

from __future__ import annotations

import json

from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.results import GAPS, HEADER, TransactionError
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.operations import operation_json, operation_line
from dissect.meaning.report.text import results_of
from dissect.meaning.report.words import Places
from dissect.meaning.report.writers.text import transaction_line
from dissect.packets.source.packet import SourceFile
from dissect.wire.text import Clock
from tests.engine.findings import events
from tests.engine.transactions.talk import Talk
from tests.meaning.report.schemas import complaints

PLACES = Places([SourceFile("a.pcap", 1)], False)


def only(talk: Talk) -> Operation:
    (operation,) = talk.operations
    return operation


def begun() -> Talk:
    talk = Talk()
    talk.open()
    talk.operations.clear()
    return talk


def line(operation: Operation) -> str:
    return operation_line(operation, Clock(), PLACES)


def long_answer(group: int, subfunction: int, question: bytes, content: bytes) -> Operation:
    """Return the operation of an answer in two parts."""
    talk = begun()
    talk.ask(events.asks(1, group, subfunction, question))
    talk.tell(events.tells(1, group, subfunction, content[:12], sequence=3, part=9))
    talk.ask(events.asks(2, group, subfunction, sequence=3))
    talk.tell(events.tells(2, group, subfunction, content[12:], sequence=3, part=-9))
    return only(talk)


def test_a_long_answer_names_what_it_lists_and_how_many_more() -> None:
    blocks = b"".join([bytes((0, number, 0x22, 1)) for number in range(1, 7)])
    assert line(long_answer(3, 2, b"0A", blocks)) == (
        "2020-09-13 12:26:40.008000 UTC  #2     8→11         10.0.0.1:50000 → 10.0.0.2:102   3.00 ms  long answer"
        "  DB → 1 (AWL/STL), 2 (AWL/STL), 3 (AWL/STL) and 3 more  2 transactions, 24 bytes  done"
    )


def test_the_columns_of_an_operation_are_those_of_a_transaction() -> None:
    """Both stand below each other in what is watched live."""
    talk = begun()
    talk.ask(events.start_upload(1))
    talk.tell(events.upload_started(1, 7, 300))
    talk.close()
    of_transaction = transaction_line(talk.transactions[-1], Clock(), PLACES)
    of_operation = line(only(talk))
    assert of_operation.index("10.0.0.1:50000") == of_transaction.index("10.0.0.1:50000")
    assert of_operation.index("  upload") == of_transaction.index("  Start upload")


def test_a_long_subject_ends_in_dots() -> None:
    """At most 120 characters, so that the result behind it stays in sight."""
    talk = begun()
    talk.ask(events.start_upload(1))
    talk.tell(events.upload_started(1, 7, 300))
    talk.close()
    operation = only(talk)
    operation.subject = "x" * 120
    assert f"  upload  {'x' * 120}  " in line(operation)
    operation.subject += "y"
    assert f"  upload  {'x' * 120}… (121 characters)  " in line(operation)


def test_the_head_of_a_list_is_not_named_again() -> None:
    content = bytes.fromhex("00a0000000140001 4302ff0000000000000000009401010000000002")
    assert "  SZL 0x00a0 diagnostic buffer of the CPU → 0x4302 STARTUP to RUN, DT#1994-01-01-00:00:00.000  2 trans" in (
        line(long_answer(4, 1, b"\0\xa0\0\0", content))
    )


def test_a_subscription_that_ran_to_the_end_of_its_connection_ended_with_it() -> None:
    """One that ran to the end of the capture goes on."""
    said = []
    for close in (True, False):
        talk = Talk()
        talk.open()
        talk.ask(events.asks(1, 2, 1, events.CYCLIC))
        talk.tell(events.tells(1, 2, 1, events.CYCLIC_VALUES, sequence=5))
        if close:
            talk.close()
        talk.finish()
        said.append(line(talk.operations[-1]).rpartition("  ")[2])
    assert said == ["ended with the connection", "running (capture ends)"]


def test_what_a_clock_that_ran_backwards_cannot_tell_is_left_out() -> None:
    talk = begun()
    talk.ask(events.asks(1, 2, 1, events.CYCLIC))
    talk.tell(events.tells(1, 2, 1, events.CYCLIC_VALUES, sequence=5))
    for number in range(3):
        talk.tell(events.pushes(2, 1, events.CYCLIC_VALUES, sequence=5), after_ns=-(10**9) if number else 10**6)
    talk.finish()
    operation = only(talk)
    assert (operation.pushes, operation.push_interval_ns) == (3, -(10**9))
    said = line(operation)
    assert "3 pushes of them, " in said
    assert "on average" not in said
    operation.end_ns = operation.begin_ns - 1
    assert line(operation).partition(":102")[2].startswith("         ?  cyclic reading")


def test_an_operation_says_how_many_of_its_pairs_are_only_likely() -> None:
    talk = begun()
    talk.ask(events.start_upload(1))
    talk.tell(events.upload_started(1, 7, 300))
    step = talk.transactions[-1]
    talk.close()
    operation = only(talk)
    assert "likely" not in line(operation)
    assert "likely" not in json.loads(operation_json(operation, Clock(), PLACES))
    step._flags |= GAPS
    operation._add(step)
    assert (operation.likely, operation.parts) == (1, 2)
    assert line(operation).endswith("UNFINISHED (connection closed, 1 pair only likely)")
    told = json.loads(operation_json(operation, Clock(), PLACES))
    assert told["likely"] == 1
    assert complaints("operation", told, exact=True) == []
    operation.error = TransactionError(HEADER, 0xD401, "no such block", "The block does not exist.")
    assert line(operation).endswith("(1 pair only likely)")


def test_analyze_and_operations_say_the_same_of_a_subscription() -> None:
    """Two that ended with their connections, and one that runs on."""
    first = Talk()
    for number in range(3):
        talk = first if not number else Talk(50000 + number, beside=first)
        talk.open()
        talk.ask(events.asks(1, 2, 1, events.CYCLIC))
        talk.tell(events.tells(1, 2, 1, events.CYCLIC_VALUES, sequence=5))
        if number:
            talk.close()
    first.finish()
    whole, *parts = Analysis(), Analysis(), Analysis()
    for number, operation in enumerate(first.operations):
        whole.operation(operation)
        parts[number % 2].operation(operation)
    parts[0].merge(parts[1])
    for analysis in (whole, parts[0]):
        assert [*results_of(analysis.operations["cyclic"], analysis.ended_operations["cyclic"])] == [
            ("running", 1),
            ("ended with the connection", 2),
        ]
