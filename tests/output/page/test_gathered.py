"""What a report gathers in one pass: polls, gaps that nothing bridges, values of tags, who talked to whom, and bounds."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.output.page import data as drawing
from dissect.output.page import gathered as room
from dissect.output.page import tag_steps
from dissect.output.page.data import Data
from dissect.output.page.verdict import verdict
from dissect.wire.build import COMPILED
from tests.meaning.report.schemas import ROOT
from tests.meaning.report.support import WORD, begun, read, saved
from tests.output.page.support import gathered_of
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import EPOCH_NS, MS, Flow, Packet, Talk


def polled(values: list[int], ports: int = 40000) -> Talk:
    """Return a connection that reads DB10.DBW4 again and again."""
    talk = begun(Flow(ports=(ports, 102)))
    for ref, value in enumerate(values, 1):
        read(talk, ref, WORD, value.to_bytes(2, "big"))
    return talk


def test_a_poll_has_its_period_and_its_jitter(tmp_path: Path) -> None:
    found = gathered_of([saved(tmp_path / "a.pcapng", polled([1, 1, 2, 3, 3, 3]).packets(step_ns=10 * MS))])
    (poll,) = found.requests.polls()
    assert (poll.count, poll.periods.count, poll.periods.smallest, poll.periods.largest) == (6, 5, 20 * MS, 20 * MS)
    assert (poll.subject, poll.periods.deviation) == ("Read Var DB10.DBW4", 0)
    ((place, variable),) = found.requests.variables().items()
    assert (place[1], variable.read, variable.written, variable.refused) == ("DB10.DBW4", 6, 0, 0)


def test_equal_values_are_one_step_and_writes_have_their_writer(tmp_path: Path) -> None:
    talk = polled([5, 5, 5, 7])
    talk.send(0, dt(messages.write_job(9, [WORD], [b"\x00\x09"]))).send(1, dt(messages.write_answer(9, [0xFF])))
    talk.send(0, dt(messages.write_job(10, [WORD], [b"\x00\x63"]))).send(1, dt(messages.write_answer(10, [0x05])))
    found = gathered_of([saved(tmp_path / "a.pcapng", talk.packets())], ["db10.dbw4", "DB99.DBX0.0"])
    ((key, steps),) = found.tags.found.items()
    assert key[0] == "DB10.DBW4"
    assert [step.first for step in steps.steps] == [5, 7, 9]
    assert [write.value for write in steps.writes] == [9]
    assert found.tags.refused() == ["DB10.DBW4"]
    assert {write.writer for write in steps.writes} == {found.analysis.connections[0].client.host}
    assert found.tags.missing() == ["DB99.DBX0.0"]


def test_many_values_are_gathered_in_bins_and_keep_their_extremes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tag_steps, "_EXACT", 50)
    steps = tag_steps.TagSteps()
    for number in range(5000):
        steps.take(EPOCH_NS + number * 7 * MS, number % 97, None)
    assert len(steps.steps) <= 50
    assert steps.width_ns > 0
    assert (min([step.smallest for step in steps.steps]), max([step.largest for step in steps.steps])) == (0, 96)
    assert sum([step.count for step in steps.steps]) == steps.values == 5000
    assert steps.steps[-1].last == 4999 % 97


def test_nothing_is_bridged_across_a_gap(tmp_path: Path) -> None:
    talk = polled([1, 1, 1])
    talk.skip(1, 400)
    for ref in (20, 21, 22):
        read(talk, ref, WORD, b"\x00\x02")
    path = saved(tmp_path / "a.pcapng", talk.packets(step_ns=10 * MS))
    found = gathered_of([path], ["DB10.DBW4"])
    assert [gap.why for gap in found.gaps] == ["400 bytes are missing"]
    (gap,) = found.gaps
    assert 0 <= gap.end_ns - gap.begin_ns <= 40 * MS
    (steps,) = found.tags.found.values()
    assert [(step.first, step.broken) for step in steps.steps] == [(1, False), (2, True)]
    (poll,) = found.requests.polls()
    assert (poll.count, poll.periods.count) == (6, 4)


@pytest.mark.parametrize("idle_s", [1, 3600])
@pytest.mark.parametrize("answered", [True, False])
def test_the_time_of_a_gap_is_not_the_idle_time_after_it(tmp_path: Path, idle_s: int, answered: bool) -> None:
    """Bytes are missing before a packet that comes at once; the next message comes much later, or only the end."""
    talk = polled([1, 1, 1])
    before = len(talk.packets())
    talk.skip(1, 400)
    talk.send(
        1, dt(messages.read_answer(77, [WORD], [b"\0\1"]))
    )  # nobody asked for it: it is no answer, but shows the gap
    shown = len(talk.packets())
    if answered:
        read(talk, 20, WORD, b"\x00\x02")
    packets = talk.close().packets(step_ns=10 * MS)
    late = [packet._replace(time_ns=packet.time_ns + idle_s * 10**9) for packet in packets[shown:]]
    found = gathered_of([saved(tmp_path / "a.pcapng", [*packets[:shown], *late])], ["DB10.DBW4"])
    (gap,) = found.gaps
    assert packets[before - 2].time_ns <= gap.begin_ns <= packets[before].time_ns
    assert gap.end_ns == packets[shown - 1].time_ns


@pytest.mark.parametrize("idle_s", [0, 3600])
@pytest.mark.parametrize("reset", [True, False])
def test_a_gap_that_only_an_acknowledgement_shows_ends_with_it(tmp_path: Path, idle_s: int, reset: bool) -> None:
    """The answer is missing, the client acknowledged it, and the connection was closed much later."""
    talk = polled([1, 1, 1])
    talk.send(0, dt(messages.read_job(20, [WORD])))
    asked = len(talk.packets())
    talk.skip(1, 400).ack(0)
    packets = (talk.reset(0) if reset else talk.close()).packets(step_ns=10 * MS)
    late = [packet._replace(time_ns=packet.time_ns + idle_s * 10**9) for packet in packets[asked + 1 :]]
    found = gathered_of([saved(tmp_path / "a.pcapng", [*packets[: asked + 1], *late])])
    (gap,) = found.gaps
    assert gap.why == "400 bytes are missing"
    assert packets[0].time_ns < gap.begin_ns <= gap.end_ns == packets[asked].time_ns


def test_files_apart_leave_a_gap_of_all(tmp_path: Path) -> None:
    first = saved(tmp_path / "a.pcapng", polled([1]).packets())
    later = saved(tmp_path / "b.pcapng", polled([2], 40001).packets(start_ns=EPOCH_NS + 3600 * 10**9))
    found = gathered_of([first, later])
    (gap,) = found.between_files()
    assert gap.connection == 0
    assert 3599 < (gap.end_ns - gap.begin_ns) / 1e9 < 3600
    assert gathered_of([first]).between_files() == []


def test_a_gap_between_files_is_seen_past_one_without_s7_and_an_open_request(tmp_path: Path) -> None:
    """Neither is a file whose packets hold no S7 a gap, nor does what is told at the end hide one."""
    hour = 3600 * 10**9
    silent = [
        packet._replace(time_ns=packet.time_ns + hour) for packet in Talk(Flow(ports=(50000, 80))).handshake().packets()
    ]
    asked = polled([1])
    asked.send(0, dt(messages.read_job(99, [WORD])))  # which nobody answers
    paths = [
        saved(tmp_path / "a.pcapng", asked.packets()),
        saved(tmp_path / "b.pcapng", silent),
        saved(tmp_path / "c.pcapng", polled([2], 40001).packets(start_ns=EPOCH_NS + 2 * hour)),
    ]
    for order in (paths, paths[::-1]):
        gaps = gathered_of(order).between_files()
        assert [round((gap.end_ns - gap.begin_ns) / hour, 2) for gap in gaps] == [1, 1]


def test_files_that_continue_each_other_break_no_line(tmp_path: Path) -> None:
    first = saved(tmp_path / "a.pcapng", polled([1]).packets())
    soon = saved(tmp_path / "b.pcapng", polled([2], 40001).packets(start_ns=EPOCH_NS + 10**9))
    late = saved(tmp_path / "c.pcapng", polled([3], 40002).packets(start_ns=EPOCH_NS + 3600 * 10**9))
    found = gathered_of([first, soon, late], ["DB10.DBW4"])
    (steps,) = found.tags.found.values()
    assert [(step.first, step.broken) for step in steps.steps] == [(1, False), (2, False), (3, True)]


def test_medians_are_those_of_the_analysis(tmp_path: Path) -> None:
    """Of an even number of answers the mean of the two in the middle, wherever they lie."""
    talk = polled([])
    for ref, pause in enumerate((1, 200), 1):
        talk.send(0, dt(messages.read_job(ref, [WORD])))
        for _ in range(pause):
            talk.ack(1)
        talk.send(1, dt(messages.read_answer(ref, [WORD], [b"\x00\x01"])))
    found = gathered_of([saved(tmp_path / "a.pcapng", talk.packets())])
    told = {
        spread["function"]: (spread["median"], spread["p95"]) for spread in Data(found, "").as_dict()["spreads"]["rows"]
    }
    counted = {
        one.name: (one.latencies.quantile(0.5), one.latencies.quantile(0.95))
        for one in found.analysis.functions.values()
    }
    assert told == counted
    assert told["Read Var"][0] > 50 * MS


def test_machines_alike_in_vlans_of_their_own_are_told_apart(tmp_path: Path) -> None:
    packets: list[Packet] = []
    for vlans in ((), (10,), (20,)):
        talk = begun(Flow(ports=(50000 + sum(vlans), 102), vlans=vlans))
        for ref in range(1, 6):
            read(talk, ref, WORD, 0x0A if vlans == (20,) else b"\x00\x01")
        packets += talk.packets()
    found = gathered_of([saved(tmp_path / "a.pcapng", sorted(packets))], ["DB10.DBW4"])
    plcs = ["10.0.0.2", "10.0.0.2 in VLAN 10", "10.0.0.2 in VLAN 20"]
    data = Data(found, "").as_dict()
    assert sorted([(pair["server"], pair["errors"]) for pair in data["talks"]["pairs"]]) == list(
        zip(plcs, (0, 0, 5), strict=True)
    )
    assert sorted({row["host"] for row in data["spreads"]["rows"]}) == plcs
    assert sorted({row["host"] for row in data["polls"]["rows"]}) == plcs
    assert sorted({row["host"] for row in data["tags"]["series"]}) == plcs[:2]
    tables = {table["name"]: table["rows"] for table in data["tables"]}
    assert sorted([row["cells"][0] for row in tables["variables"]]) == plcs
    assert "vlan == 20" in tables["variables"][0]["show"]
    assert {row["cells"][3] for row in tables["failed"]} == {"10.0.0.1 → 10.0.0.2 in VLAN 20"}
    assert verdict(found).sentences[2].startswith("It concerns 10.0.0.1 → 10.0.0.2 in VLAN 20")


def test_captures_in_another_order_span_all_their_packets(tmp_path: Path) -> None:
    early = saved(tmp_path / "a.pcapng", polled([1, 2]).packets())
    late = saved(tmp_path / "b.pcapng", polled([3, 4], 40001).packets(start_ns=EPOCH_NS + 10**9))
    later = saved(tmp_path / "c.pcapng", polled([5, 6], 40002).packets(start_ns=EPOCH_NS + 2 * 10**9))
    right = gathered_of([early, late, later])
    for paths in ([later, late, early], [late, early, later], [late, later, early]):
        wrong = gathered_of(paths)
        assert (wrong.start_ns, wrong.end_ns) == (right.start_ns, right.end_ns)
        session = Data(wrong, "").as_dict()
        assert session["span"] > 2
        assert (
            sum([row[1] for row in session["rates"]["bins"] if 0 <= row[0] <= session["span"]]) == wrong.analysis.total
        )


def test_a_clock_that_is_set_back_spans_all_its_packets(tmp_path: Path) -> None:
    packets = polled([1, 2, 3, 4]).packets(step_ns=MS)
    half = len(packets) // 2
    turned = [*packets[:half], *[packet._replace(time_ns=packet.time_ns - 10**9) for packet in packets[half:]]]
    found = gathered_of([saved(tmp_path / "a.pcapng", turned)])
    times = [packet.time_ns for packet in turned]
    assert (found.start_ns, found.end_ns) == (min(times), max(times))
    assert found.analysis.pipeline is not None
    assert (found.analysis.pipeline.first_ns, found.analysis.pipeline.now_ns) == (times[0], times[-1])


def test_who_talks_to_whom_with_the_worst_finding(tmp_path: Path) -> None:
    talk = begun()
    read(talk, 1, WORD, 0x0A)
    found = gathered_of([saved(tmp_path / "a.pcapng", talk.close().packets())])
    ((_, pair),) = found.talks.pairs.items()
    assert (pair.connections, pair.errors, pair.worst) == (1, 1, "warning")
    assert pair.octets > 60
    (variable,) = found.requests.variables().values()
    assert (variable.refused, variable.why) == (1, "Object does not exist")


def test_what_is_refused_of_a_variable_is_what_was_refused(tmp_path: Path) -> None:
    """A request may be refused as a whole; an item without return code may have been written."""
    talk = begun()
    talk.send(0, dt(messages.write_job(1, [WORD], [b"\0\1"]))).send(1, dt(bytes.fromhex("3203000000010000000084 04")))
    found = gathered_of([saved(tmp_path / "whole.pcapng", talk.close().packets())])
    (variable,) = found.requests.variables().values()
    assert (variable.written, variable.refused, variable.why) == (1, 1, "Function cannot be performed")
    talk, other = begun(), messages.Item(0x04, 1, 10, 0x84, 6 * 8)
    read(talk, 1, other, 0x0A)
    talk.send(0, dt(messages.write_job(2, [WORD, other], [b"\0\1"] * 2))).send(1, dt(messages.write_answer(2, [0xFF])))
    found = gathered_of([saved(tmp_path / "short.pcapng", talk.close().packets())])
    told = {address: (one.refused, one.why) for (_, address), one in found.requests.variables().items()}
    assert told == {"DB10.DBW4": (0, ""), "DB10.DBW6": (1, "Object does not exist")}


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_tables_are_bounded_and_count_what_they_leave_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "MAX_SLOWEST", 3)
    monkeypatch.setattr(room, "MAX_FAILED", 2)
    monkeypatch.setattr(room, "MAX_SPREADS", 1)
    talk = begun()
    for ref in range(1, 10):
        read(talk, ref, WORD, 0x0A if ref > 4 else b"\x00\x01")
    found = gathered_of([saved(tmp_path / "a.pcapng", talk.packets())])
    assert (len(found.failed), found.failed.total) == (2, 5)
    assert found.spreads_not_told_apart == 9
    (functions,) = [table for table in Data(found, "").as_dict()["tables"] if table["name"] == "functions"]
    assert (len(functions["rows"]), functions["total"]) == (1, 2)  # Setup communication, and Read Var, nine times
    latencies = [row["cells"][4] for row in found.slowest()]
    assert 3 <= len(latencies) <= 6  # three of all, and of the rest of the time as many
    assert latencies[:3] == sorted(latencies, reverse=True)[:3]


def test_too_many_marks_are_thinned_out_over_all_of_the_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawing, "_MARKS", 8)
    talk = begun()
    for ref in range(1, 40):
        read(talk, ref, WORD, 0x0A)
    data = Data(gathered_of([saved(tmp_path / "a.pcapng", talk.packets())]), "").as_dict()
    times = [mark[0] for mark in data["marks"]["marks"]]
    assert len(times) <= 8 < data["marks"]["total"]
    assert times[-1] > data["span"] * 0.7


def test_modes_and_operations_of_a_plant_are_on_its_lane() -> None:
    found = gathered_of([ROOT / "captures" / "crafted" / "plus-plant.pcapng"])
    assert [(mode.host, mode.text) for mode in found.modes] == [(("192.0.2.20", 0), "STOP"), (("192.0.2.20", 0), "RUN")]
    assert {span.kind for span in found.spans} >= {"control", "download", "session"}
    assert {span.host for span in found.spans} == {("192.0.2.20", 0)}


def test_an_empty_capture_gathers_nothing(tmp_path: Path) -> None:
    empty: list[Packet] = []
    found = gathered_of([saved(tmp_path / "a.pcapng", empty)])
    assert (found.start_ns, found.end_ns, found.rates.rows, found.gaps) == (0, 0, {}, [])
