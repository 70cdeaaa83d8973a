"""Rows: what they say of their variable and client, what was refused, and what is kept within bounds."""

from __future__ import annotations

import copy
import pickle
from datetime import timedelta
from pathlib import Path

import pytest

import dissect
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.transactions.results import GAPS, UNCHANGED
from dissect.meaning.tags.loading import load_tags
from dissect.output.variables import collector as collecting
from dissect.output.variables import tracker
from dissect.output.variables.choosing import Known, choose
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.model import RefusedRow, ValueRow
from dissect.output.variables.summary import Summary
from dissect.wire.build import COMPILED
from tests import build
from tests.engine.transactions import talk as line
from tests.engine.transactions.test_results import (
    ON_CHANGE,
    RESPONSE,
    VARIABLES,
    asked_by_test,
    pushed_by_test,
    sent,
    subscribe,
)
from tests.engine.transactions.test_results import PUSH as PUSHED
from tests.meaning.report.support import Kept, begun, observed, saved
from tests.output.variables.support import BIT, BYTE, INT, REAL, WORD, collected, db, reads, real, rows_of, writes


def test_a_row_says_what_its_variable_is(tmp_path: Path) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text("address,type,name,unit,scale,comment\nDB1.DBW0,INT,Temp,°C,0.1,of the oil\n", encoding="utf-8")
    talk = begun()
    reads(talk, 1, (db(INT, 0), b"\0\xd7"), (db(WORD, 6), b"\0\1"))
    reads(talk, 2, (db(INT, 0), b"\0\xd8"), (db(WORD, 6), b"\0\1"))
    first, word, second, again = rows_of(talk, naming=load_tags([tags]).naming())
    assert (first.address, first.tag, first.name, first.type, first.unit) == ("DB1.DBW0", "Temp", "Temp", "INT", "°C")
    assert (word.address, word.tag, word.name, word.type, word.unit) == ("DB1.DBW6", "", "DB1.DBW6", "WORD", "")
    assert first.variable.comment == "of the oil"
    assert (first.previous, first.before, first.previous_text) == (None, None, "")
    assert (second.previous, second.before) == (21.5, b"\0\xd7")
    assert (again.previous, again.before, again.changed) == (1, b"\0\1", False)
    assert (first.variable.value, first.variable.data, first.variable.text) == (21.6, b"\0\xd8", "")
    assert {row.certainty for row in (first, word, second, again)} == {"sure"}
    assert {row.refused for row in (first, word, second, again)} == {""}
    assert (str(first.client).partition(":")[0], first.host) == ("10.0.0.1", "10.0.0.1")
    assert str(first.plc) == "10.0.0.2:102"
    assert (repr(second), repr(first.variable)) == ("ValueRow(read 'Temp' = 21.6)", "Variable('Temp', 'INT')")


def test_a_row_that_was_copied_says_the_same() -> None:
    talk = begun()
    reads(talk, 1, (db(REAL, 0), real(1.5)))
    reads(talk, 2, (db(REAL, 0), real(2.5)))
    row = rows_of(talk)[1]
    for made in (copy.deepcopy(row), pickle.loads(pickle.dumps(row))):
        assert (made.address, made.type, made.value, made.previous, made.frame) == ("DB1.DBD0", "REAL", 2.5, 1.5, 11)
        assert (made.host, str(made.plc), made.connection) == (row.host, str(row.plc), row.connection)


# ---- what the PLC refused -------------------------------------------------------------------------------------------


def beginning(collector: ValueCollector, jobs: int = 1) -> tuple[line.Talk, ValueCollector]:
    """A talk that is begun, in a pipeline of its own with a collector."""
    talk = line.Talk()
    talk.pipeline = Pipeline(collector, Options(strict=True))
    talk.open(jobs, jobs)
    return talk, collector


def refusals() -> list[ValueRow]:
    made = begun()
    reads(made, 1, (db(REAL, 0), real(1.5)), (db(BIT, 8), 0x0A))
    writes(made, 2, (db(REAL, 0), real(9.0), 0x05), (db(BIT, 8), b"\1", 0xFF))
    return collected(ValueCollector(refusals=True), made.packets()).take()


def test_a_refusal_has_a_row_where_it_is_asked_for() -> None:
    value, missing, refused, written = refusals()
    assert isinstance(missing, RefusedRow)
    assert isinstance(refused, RefusedRow)
    assert (missing.how, missing.address, missing.writes, missing.return_code) == ("read", "DB1.DBX8.0", False, 0x0A)
    assert (refused.how, refused.address, refused.writes, refused.return_code) == ("write", "DB1.DBD0", True, 0x05)
    assert (missing.refused, refused.refused) == ("Object does not exist", "Invalid address")
    assert (missing.value, missing.data, missing.changed, missing.first) == (None, None, False, False)
    # It stands where its answer is, a value that is written where its request is.
    assert [int(row.frame) for row in (value, missing, refused, written)] == [9, 9, 11, 10]
    assert refused.time_ns == written.time_ns + 1_000_000
    assert (refused.host, str(refused.plc)) == ("10.0.0.1", "10.0.0.2:102")
    assert repr(refused) == "RefusedRow(write 'DB1.DBD0': Invalid address)"
    assert [row.refused for row in (value, written)] == ["", ""]
    assert (written.first, written.previous) == (True, None)


def test_refusals_are_rows_of_values_only_where_they_are_asked_for(tmp_path: Path) -> None:
    talk = begun()
    reads(talk, 1, (db(WORD, 0), 0x0A), (db(WORD, 2), b"\0\1"))
    path = saved(tmp_path / "refused.pcapng", talk.packets())
    assert [row.refused for row in dissect.values(path)] == [""]
    assert [row.refused for row in dissect.values(path, refusals=True)] == ["Object does not exist", ""]
    assert [row.refused for row in dissect.values(path, of="DB1.DBW0", refusals=True)] == ["Object does not exist"]


def test_a_request_that_is_refused_as_a_whole_says_so_for_each_item() -> None:
    """The reason is that of the answer, because the items have none."""
    talk, collector = beginning(ValueCollector(refusals=True))
    talk.ask(line.read(1, line.dbw(10, 4), line.dbw(10, 8)))
    talk.tell(line.ack_data(1, b"\x04\x00", code=0x8500))
    talk.ask(line.write(2, [line.dbw(10, 4)], line.written(4, b"\0\1")))
    talk.tell(line.ack_data(2, b"\x05\x00", code=0x8104))
    rows = collector.take()
    assert [(row.how, row.address, row.writes, row.refused) for row in rows] == [
        ("read", "DB10.DBW4", False, "Wrong PDU size or frame"), ("read", "DB10.DBW8", False, "Wrong PDU size or frame"),
        ("write", "DB10.DBW4", True, "Service not implemented or frame error"),
    ]  # fmt: skip
    assert [row.return_code for row in rows if isinstance(row, RefusedRow)] == [0x8500, 0x8500, 0x8104]
    assert [(one.refused_reads, one.refused_writes) for one in collector.variables] == [(1, 1), (1, 0)]
    assert (collector.refused, collector.unconfirmed) == (3, 0)


def test_items_that_the_answer_lacks_are_not_refused() -> None:
    """A value that was read is not there; whether a value was written is not known. A code of 0 is one of the item."""
    talk, collector = beginning(ValueCollector(refusals=True))
    both = [line.dbw(10, 4), line.dbw(10, 8)]
    values = line.written(4, b"\0\1") + line.written(4, b"\0\2")
    talk.ask(line.read(1, *both))
    talk.tell(line.ack_data(1, b"\x04\x01", line.good(4, b"\0\7")))
    talk.ask(line.write(2, both, values))
    talk.tell(line.ack_data(2, b"\x05\x01", b"\xff"))
    assert [(row.how, row.address, row.value) for row in collector.take()] == [
        ("read", "DB10.DBW4", 7), ("write", "DB10.DBW4", 1),
    ]  # fmt: skip
    assert (collector.refused, collector.unconfirmed) == (0, 1)
    assert [(one.address, one.refused_reads, one.unconfirmed) for one in collector.variables] == [
        ("DB10.DBW4", 0, 0), ("DB10.DBW8", 0, 1),
    ]  # fmt: skip
    talk.ask(line.write(3, both, values))
    talk.tell(line.ack_data(3, b"\x05\x02", b"\x00\xff"))
    assert [(row.address, row.refused) for row in collector.take()] == [("DB10.DBW4", "Reserved"), ("DB10.DBW8", "")]


def test_a_variable_without_value_or_refusal_is_not_in_a_summary() -> None:
    talk, collector = beginning(ValueCollector(sums=True))
    talk.ask(line.read(1, line.dbw(10, 4), line.dbw(10, 8)))
    talk.tell(line.ack_data(1, b"\x04\x01", line.good(4, b"\0\7")))
    assert [one.address for one in collector.variables] == ["DB10.DBW4", "DB10.DBW8"]
    assert [one.address for one in Summary(collector).variables] == ["DB10.DBW4"]


def test_one_that_was_not_answered_is_not_likely_refused() -> None:
    """A doubt is about a pair: a write that has no answer is unconfirmed, also where its answer may be in a gap."""
    kept = Kept()
    talk = begun()
    talk.send(0, line.dt(line.write(1, [line.dbw(1, 0)], line.written(4, b"\0\1"))))
    observed(kept, talk.packets())
    (write,) = [one for one in kept.transactions if one.function == 5]
    write._flags |= GAPS
    collector = ValueCollector()
    collector.transaction(write)
    assert (collector.unconfirmed, collector.doubts, [one.likely for one in collector.variables]) == (1, {}, [0])


def test_a_write_without_an_answer_is_no_refusal() -> None:
    talk = begun()
    talk.send(0, line.dt(line.write(1, [line.dbw(1, 0)], line.written(4, b"\0\1"))))
    found = collected(ValueCollector(refusals=True), talk.packets())
    assert found.take() == []
    assert (found.refused, found.unconfirmed) == (0, 1)


def test_a_refusal_that_is_only_likely_is_left_out_or_marked() -> None:
    talk = begun()
    reads(talk, 1, (db(WORD, 0), 0x0A))
    kept = Kept()
    observed(kept, talk.packets())
    (read,) = [one for one in kept.transactions if one.function == 4]
    read._flags |= GAPS
    for likely, count in ((False, 0), (True, 1)):
        found = ValueCollector(likely=likely, refusals=True)
        found.transaction(read)
        rows = found.take()
        assert [(row.doubt, row.certainty) for row in rows] == [("gaps", "likely")] * count
        assert (found.refused, [one.likely for one in found.variables]) == (0, [1])


def test_a_tag_that_is_refused_is_counted_by_its_name(tmp_path: Path) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text("address,type,name\nDB1.DBW0,INT,Temp\nDB1.DBW4,INT,Flow\n", encoding="utf-8")
    talk = begun()
    reads(talk, 1, (db(INT, 0), 0x0A), (db(INT, 4), b"\0\1"))
    writes(talk, 2, (db(INT, 0), b"\0\2", 0x05))
    options = Options(strict=True, naming=load_tags([tags]).naming())
    found = collected(ValueCollector(refusals=True), talk.packets(), options)
    assert [(row.name, row.how, row.refused) for row in found.take()] == [
        ("Temp", "read", "Object does not exist"), ("Flow", "read", ""), ("Temp", "write", "Invalid address"),
    ]  # fmt: skip
    assert [(one.name, one.refused_reads, one.refused_writes) for one in found.variables] == [
        ("Temp", 1, 1), ("Flow", 0, 0),
    ]  # fmt: skip


def test_a_wanted_place_that_is_refused_or_too_short(tmp_path: Path) -> None:
    """The refusal counts for the place; an item of the wrong length stands for itself."""
    talk = begun()
    reads(talk, 1, (db(WORD, 0), 0x0A))
    reads(talk, 2, (db(WORD, 0, 2), b"\1\2\3"))
    reads(talk, 3, (db(WORD, 0, 2), b"\1\2\3\4"))
    wanted = choose(["DB1.DBW0", "DB1.DBW2", "DB1.DBW4"], Known(None))
    found = collected(ValueCollector(wanted, refusals=True), talk.packets())
    assert [(row.address, row.type, row.data, row.refused) for row in found.take()] == [
        ("DB1.DBW0", "WORD", None, "Object does not exist"), ("DB1.DBW0", "2 x WORD", b"\1\2\3", ""),
        ("DB1.DBW0", "WORD", b"\1\2", ""), ("DB1.DBW2", "WORD", b"\3\4", ""),
    ]  # fmt: skip
    assert found.found == {"DB1.DBW0", "DB1.DBW2"}


def test_wanted_places_beyond_the_bound_are_items_of_their_own() -> None:
    talk = begun()
    for ref in (1, 2):
        reads(talk, ref, (db(BYTE, 0, 4), bytes((ref, 2, 3, 4))))
    wanted = choose(["DB1.DBB0", "DB1.DBB1", "DB1.DBB2"], Known(None))
    found = collected(ValueCollector(wanted, most=2), talk.packets())
    assert [(row.address, row.type, row.value, row.previous) for row in found.take()] == [
        ("DB1.DBB0", "BYTE", 1, None), ("DB1.DBB1", "BYTE", 2, None), ("DB1.DBB0", "4 x BYTE", [1, 2, 3, 4], None),
        ("DB1.DBB0", "BYTE", 2, 1), ("DB1.DBB1", "BYTE", 2, 2), ("DB1.DBB0", "4 x BYTE", [2, 2, 3, 4], None),
    ]  # fmt: skip
    assert (found.known, found.untracked) == (2, 2)


def test_an_item_without_a_place_is_found_by_its_address_alone() -> None:
    """One of a length of 0 touches no place, wherever it stands; its own address names it."""
    talk = begun()
    reads(talk, 1, *[(db(BYTE, octet, 0), b"") for octet in (4, 5, 6)], (db(WORD, 4), b"\0\1"))
    for name, expected in (
        ("DB1.DBW4", [("DB1.DBW4", b"\0\1")]),
        ("DB1.DBB5", [("DB1.DBB5", b""), ("DB1.DBB5", b"\1")]),
        ("DB1.DBB6", [("DB1.DBB6", b"")]),
    ):
        assert [(row.address, row.data) for row in rows_of(talk, name)] == expected, name


def test_bits_in_the_middle_of_items_of_bits_and_of_octets() -> None:
    talk = begun()
    reads(talk, 1, (db(BIT, 4, bit=3), b"\1"))
    reads(talk, 2, (db(BYTE, 4), b"\x10"))
    reads(talk, 3, (db(BYTE, 3, 3), b"\xff\x28\xff"))
    assert [(row.address, row.value) for row in rows_of(talk, "DB1.DBX4.3", "DB1.DBX4.4", "DB1.DBX4.5")] == [
        ("DB1.DBX4.3", True),
        ("DB1.DBX4.3", False), ("DB1.DBX4.4", True), ("DB1.DBX4.5", False),
        ("DB1.DBX4.3", True), ("DB1.DBX4.4", False), ("DB1.DBX4.5", True),
    ]  # fmt: skip


@pytest.mark.parametrize(("subfunction", "how"), [(8, "modify"), (9, "force")])
def test_values_of_a_variable_table_count_once_the_plc_reports_them(subfunction: int, how: str) -> None:
    """They are in the request; where the PLC refuses the job they are refused writes, all of them."""
    values = b"\x00\x09\x00\x04\x41\x33\x85\x1f" + b"\x00\x03\x00\x01\x01\x00"
    for code, expected in ((0, []), (0xD401, [("MD0", True, "Invalid SZL id"), ("I8.1", True, "Invalid SZL id")])):
        talk = line.Talk()
        collector = ValueCollector(refusals=True)
        talk.pipeline = Pipeline(collector, Options(strict=True))
        talk.open(8, 8)
        talk.ask(asked_by_test(1, subfunction, VARIABLES[:2], values))
        talk.tell(line.userdata(1, line.head(2, 1, subfunction, 2, code)))
        rows = collector.take()
        assert [(row.how, row.address, row.writes, row.refused) for row in rows] == [(how, *one) for one in expected]
        assert collector.refused == len(expected)
        if code:
            continue
        talk.tell(pushed_by_test(subfunction, 2, b"\x00\x02\xff\x05"))
        good, bad = collector.take()
        assert (good.how, good.address, good.data, good.writes, good.refused) == (
            how,
            "MD0",
            b"\x41\x33\x85\x1f",
            True,
            "",
        )
        assert (bad.how, bad.address, bad.value, bad.writes, bad.refused) == (
            how,
            "I8.1",
            None,
            True,
            "Invalid address",
        )
        assert [(int(row.frame), int(row.time_ns)) for row in (good, bad)] == [(talk.pipeline.frames, talk.now_ns)] * 2
        # An item that the report lacks is neither a value nor refused.
        talk.tell(pushed_by_test(subfunction, 2, b"\x00\x01\xff"))
        assert [row.address for row in collector.take()] == ["MD0"]
        assert (collector.refused, collector.unconfirmed) == (1, 0)
        # Beyond the values of the request, the report of the PLC has none.
        talk.tell(pushed_by_test(subfunction, 2, b"\x00\x03\xff\xff\xff"))
        assert [row.address for row in collector.take()] == ["MD0", "I8.1"]


def test_a_push_without_a_new_value_is_no_row() -> None:
    talk = line.Talk()
    collector = ValueCollector()
    talk.pipeline = Pipeline(collector, Options(strict=True))
    talk.open(8, 8)
    talk.ask(subscribe(1, ON_CHANGE, line.dbw(1, 0), line.dbw(2, 0)))
    talk.tell(sent(RESPONSE, ON_CHANGE, 1, b"\xff\x04\x00\x10\x00\x07", b"\xff\x04\x00\x10\x00\x08", reference=1))
    assert [(row.how, row.value) for row in collector.take()] == [("push", 7), ("push", 8)]
    talk.tell(sent(PUSHED, ON_CHANGE, 1, bytes((UNCHANGED, 0, 0, 0)), b"\xff\x04\x00\x10\x00\x09"))
    assert [(row.address, row.value, row.previous) for row in collector.take()] == [("DB2.DBW0", 9, 8)]


# ---- bounds ---------------------------------------------------------------------------------------------------------


def test_what_is_remembered_is_counted() -> None:
    talk = begun()
    reads(talk, 1, (db(WORD, 0), b"\0\1"), (db(REAL, 4), real(1.0)), (db(BYTE, 9, 3), b"abc"))
    found = collected(ValueCollector(most=7), talk.packets())
    assert (found.known, found.kept, found.most, found.untracked) == (3, 2 + 4 + 3, 7, 0)
    assert found.plcs == ["10.0.0.2:102"]
    reads(talk, 2, (db(WORD, 0), b"\0\2"))  # a new value takes the place of the one before
    found = collected(ValueCollector(), talk.packets())
    assert (found.known, found.kept) == (3, 9)


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_values_are_remembered_within_a_bound_of_their_octets(monkeypatch: pytest.MonkeyPatch) -> None:
    """Variables that are new once that many octets are kept have rows, but no value before."""
    monkeypatch.setattr(tracker, "MAX_KEPT", 6)
    for size, known in ((4, 2), (6, 1)):
        talk = begun()
        for ref, octet in enumerate((0, 10, 20, 0, 10, 20), 1):
            reads(talk, ref, (db(BYTE, octet, size), bytes([ref]) * size))
        found = collected(ValueCollector(), talk.packets())
        rows = found.take()
        assert [row.data for row in rows] == [bytes([ref]) * size for ref in range(1, 7)]
        assert [row.before is not None for row in rows] == [False] * 3 + [at < known for at in range(3)]
        assert (found.known, found.kept, found.untracked) == (known, known * size, 2 * (3 - known))


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_plans_that_are_forgotten_change_no_row(monkeypatch: pytest.MonkeyPatch) -> None:
    talk = begun()
    for ref in range(1, 40):
        reads(talk, ref, *[(db(WORD, 2 * (ref % 3) + at), bytes((0, ref))) for at in range(0, 12, 4)])
    expected = [(row.address, row.value, row.previous) for row in rows_of(talk)]
    for most in (1, 5, 12):
        monkeypatch.setattr(collecting, "MAX_PLANS", most)
        found = collected(ValueCollector(), talk.packets())
        assert [(row.address, row.value, row.previous) for row in found.take()] == expected
        assert sum(len(plc.plans) + sum(map(len, plc.reads.values())) for plc in found._store.plcs.values()) < most + 8


def test_no_more_plcs_than_variables_are_remembered() -> None:
    first = line.Talk()
    collector = ValueCollector(most=2)
    first.pipeline = Pipeline(collector, Options(strict=True))
    for number in range(4):
        talk = first if not number else line.Talk(50000 + number, beside=first)
        talk.hosts = [1, 2 + number]
        talk.open()
        for ref, value in ((1, 5), (2, 6)):
            talk.ask(line.read(ref, line.dbw(1, 0)))
            talk.tell(line.words(ref, value))
    assert len(collector.plcs) == 2
    assert [(str(row.plc), row.value, row.previous) for row in collector.take()] == [
        (f"10.0.0.{host}:102", value, previous)
        for host in range(2, 6)
        for value, previous in ((5, None), (6, 5 if host < 4 else None))
    ]


def test_one_value_in_each_stretch_of_time(tmp_path: Path) -> None:
    """Stretches begin at whole multiples since 1970; one as short as the clock of the values leaves out nothing."""
    talk = begun()
    for ref in range(1, 9):
        reads(talk, ref, (db(WORD, 0), bytes((0, ref))))
    path = saved(tmp_path / "every.pcapng", talk.packets())
    times = [row.time_ns for row in dissect.values(path)]
    for every in (timedelta(microseconds=1), timedelta(milliseconds=3), timedelta(milliseconds=4), timedelta(hours=1)):
        size = every // timedelta(microseconds=1) * 1000
        expected = [time for at, time in enumerate(times) if not at or time // size != times[at - 1] // size]
        assert [row.time_ns for row in dissect.values(path, every=every)] == expected, every
    for every in (timedelta(0), timedelta(microseconds=-1)):
        with pytest.raises(ValueError, match="every: expected a time above 0"):
            dissect.values(path, every=every)


def test_the_bounds_of_what_is_remembered() -> None:
    """20,000 variables, and 8 MiB of values: as the documentation and the sentence of a summary name them."""
    kept = Kept()
    talk = begun()
    reads(talk, 1, (db(BYTE, 0), b"\1"))
    observed(kept, talk.packets())
    (read,) = [one for one in kept.transactions if one.function == 4]
    (item,) = read.parameters.items
    store = tracker.Tracker(False, 0, False, ValueCollector().most, False, False)
    plc = store.plc(read, 1)
    for number in range(20_001):
        store.named(plc, str(number), "BYTE", "", "")
    assert (int(store.count), len(plc.variables)) == (20_000, 20_000)
    store = tracker.Tracker(False, 0, False, 100, False, False)
    plc = store.plc(read, 1)
    for number in range(9):
        store.item(read, store.named(plc, str(number), "BYTE", "", ""), item, "read", False, bytes(1 << 20))
    assert (int(store.count), int(store.kept), int(store.untracked)) == (8, 8 << 20, 1)
    assert len(store.rows) == 9


def test_a_likely_value_is_there_from_the_next_interval_on() -> None:
    """Before that the interval has its value; a likely one begins none."""
    talk = begun()
    for ref in range(1, 5):
        reads(talk, ref, (db(WORD, 0), bytes((0, ref))))
    kept = Kept()
    observed(kept, talk.packets())
    first, *others = [one for one in kept.transactions if one.function == 4]
    for one in others:
        one._flags |= GAPS
    size = 2_000_000  # of one read to the next
    begin = int(first.response_ns)
    for every_ns, expected in (
        (size, [1, 2, 3, 4]),
        (begin + size, [1, 2, 3, 4]),
        (begin + 2 * size, [1, 3, 4]),
        (begin + 2 * size + 1, [1, 4]),
    ):
        found = ValueCollector(every_ns=every_ns, likely=True)
        for one in kept.transactions:
            found.transaction(one)
        assert [row.value for row in found.take()] == expected, every_ns
        assert found.doubts == ({"gaps": 4 - len(expected)} if len(expected) < 4 else {})


def test_several_bits_are_decoded_where_each_has_a_byte() -> None:
    """Devices pack them in different ways; where they share bytes, their order is not known."""
    for octets, value in ((b"\1\0\1", [True, False, True]), (b"\5", None), (b"\1\0\1\0", None)):
        for sums in (False, True):
            talk, collector = beginning(ValueCollector(sums=sums))
            talk.ask(line.read(1, line.item(0x84, 1, 32, BIT, 3)))
            talk.tell(line.ack_data(1, b"\x04\x01", line.good(9, octets)))
            rows = collector.take()
            (variable,) = collector.variables
            assert (variable.address, variable.type) == ("DB1.DBX4.0", "3 x BOOL")
            if sums:
                assert variable.statistics is not None
                assert variable.statistics.first == (octets if value is None else value)
            else:
                assert [(row.value, row.data) for row in rows] == [(value, octets)]


def test_each_wanted_place_that_an_item_touches_is_looked_at() -> None:
    """Whatever the one before it came to: it is not known as a whole, refused, or beyond the bound."""
    talk = begun()
    reads(talk, 1, (db(WORD, 2), b"\1\2"))  # half of the first place, all of the others
    writes(talk, 2, (db(BYTE, 0, 6), bytes(6), 0x05))
    wanted = choose(["DB1.DBD0", "DB1.DBW2:INT", "DB1.DBB3:SINT"], Known(None))
    found = collected(ValueCollector(wanted, refusals=True), talk.packets())
    assert [(row.address, row.type, row.value, bool(row.refused)) for row in found.take()] == [
        ("DB1.DBW2", "INT", 0x102, False), ("DB1.DBB3", "SINT", 2, False), ("DB1.DBW2", "WORD", 0x102, False),
        ("DB1.DBD0", "DWORD", None, True), ("DB1.DBW2", "INT", None, True), ("DB1.DBB3", "SINT", None, True),
    ]  # fmt: skip
    talk = begun()
    reads(talk, 1, (db(BYTE, 5), b"\7"))
    reads(talk, 2, (db(BYTE, 2, 4), b"\1\2\3\4"))
    wanted = choose(["DB1.DBW2:INT", "DB1.DBB5:SINT"], Known(None))
    found = collected(ValueCollector(wanted, most=1), talk.packets())
    assert [(row.address, row.type, row.value) for row in found.take()] == [
        ("DB1.DBB5", "SINT", 7), ("DB1.DBB5", "SINT", 4), ("DB1.DBB2", "4 x BYTE", [1, 2, 3, 4]),
    ]  # fmt: skip


def test_a_push_without_its_subscription_has_no_items() -> None:
    talk, collector = beginning(ValueCollector(refusals=True), 8)
    talk.tell(sent(PUSHED, ON_CHANGE, 7, b"\xff\x04\x00\x10\x00\x09"))
    talk.tell(pushed_by_test(8, 2, b"\x00\x01\xff"))
    talk.finish()
    assert (collector.take(), collector.variables, collector.plcs[:1]) == ([], [], collector.plcs)


def test_a_value_that_is_pushed_is_at_its_packet() -> None:
    talk, collector = beginning(ValueCollector(refusals=True), 8)
    talk.ask(subscribe(1, ON_CHANGE, line.dbw(1, 0), line.dbw(2, 0)))
    first = talk.tell(sent(RESPONSE, ON_CHANGE, 1, b"\xff\x04\x00\x10\x00\x07", b"\x0a\x00\x00\x00", reference=1))
    second = talk.tell(sent(PUSHED, ON_CHANGE, 1, b"\x05\x00\x00\x00", b"\xff\x04\x00\x10\x00\x09"))
    talk.tell(sent(PUSHED, ON_CHANGE, 1, b"\xff\x04\x00\x10\x00\x08"))  # it lacks the second item
    assert [(row.how, row.address, row.value, row.refused, row.writes, int(row.frame)) for row in collector.take()] == [
        ("push", "DB1.DBW0", 7, "", False, first), ("push", "DB2.DBW0", None, "Object does not exist", False, first),
        ("push", "DB1.DBW0", None, "Invalid address", False, second), ("push", "DB2.DBW0", 9, "", False, second),
        ("push", "DB1.DBW0", 8, "", False, second + 1),
    ]  # fmt: skip
    assert [(one.address, one.refused_reads, one.refused_writes) for one in collector.variables] == [
        ("DB1.DBW0", 1, 0), ("DB2.DBW0", 1, 0),
    ]  # fmt: skip
    assert (collector.refused, collector.unconfirmed) == (2, 0)


def test_pieces_of_a_tag_are_apart_by_their_bytes(tmp_path: Path) -> None:
    """Two that begin alike are no values of one variable, nor of the whole."""
    tags = tmp_path / "tags.csv"
    tags.write_text("address,type,name\nDB1.DBD0,REAL,Level\n", encoding="utf-8")
    talk = begun()
    for ref, octets in enumerate((b"\1\2", b"\1\2\3", b"\1\2\3\4", b"\1\2"), 1):
        reads(talk, ref, (db(BYTE, 0, len(octets)), octets))
    rows = rows_of(talk, naming=load_tags([tags]).naming())
    assert [(row.name, row.remark, row.first) for row in rows] == [
        ("Level", "bytes 0 to 1 of 4", True), ("Level", "bytes 0 to 2 of 4", True), ("Level", "", True),
        ("Level", "bytes 0 to 1 of 4", False),
    ]  # fmt: skip


def test_a_plc_without_variables_is_none_of_those_that_have_some() -> None:
    talk, collector = beginning(ValueCollector(refusals=True))
    talk.ask(line.userdata(1, line.head(1, 4, 1), build.payload(b"\0\x11\0\0")))
    talk.tell(line.userdata(1, line.head(2, 4, 1, 0, 0), build.payload(b"\0\x11\0\0\0\x1c\0\0")))
    assert collector.plcs == []
