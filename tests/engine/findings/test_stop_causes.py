"""A STOP that a PLC reports: its cause is told where a diagnostic message just stated it."""

from __future__ import annotations

from pathlib import Path

import pytest

import dissect
from dissect.engine.findings.reporter import Finding
from dissect.protocols.s7.diagnostic_tables import EVENTS
from dissect.protocols.s7.diagnostics import states_stop
from dissect.protocols.s7.tables import DIAGNOSTIC_MESSAGE, GROUP_CPU
from tests.engine.findings import events
from tests.engine.transactions.talk import SECOND, Talk
from tests.protocols.s7.test_diagnostics import STOP

STOPPED = "security.stopped"
SERVER_SAYS = "10.0.0.2:102 reports to 10.0.0.1:50000: mode STOP"
CAUSE = "; its diagnostic message states the cause: "


def pushed(event: int) -> bytes:
    return events.pushes(GROUP_CPU, DIAGNOSTIC_MESSAGE, event.to_bytes(2, "big") + STOP[2:])


def stops(talk: Talk) -> list[Finding]:
    talk.close()
    return [finding for finding in talk.findings if finding.slug == STOPPED]


def test_the_cause_that_was_just_stated() -> None:
    talk = Talk()
    talk.open()
    stated = talk.tell(pushed(0x4562))
    frame = talk.tell(events.mode(0))
    (stop,) = stops(talk)
    assert stop.detail == f"{SERVER_SAYS}{CAUSE}0x4562 STOP: programming error"
    assert stop.frames == [stated, frame]


def test_both_in_one_packet() -> None:
    talk = Talk()
    talk.open()
    frame = talk.tell(pushed(0x4303), events.mode(0))
    (stop,) = stops(talk)
    assert stop.detail == f"{SERVER_SAYS}{CAUSE}0x4303 STOP by the mode switch"
    assert stop.frames == [frame]


def test_what_states_no_stop_is_no_cause() -> None:
    talk = Talk()
    talk.open()
    for event in (0x4301, 0x4302, 0x4318, 0x39C4, 0x530D, 0x49B1):
        talk.tell(pushed(event))
    talk.tell(events.pushes(GROUP_CPU, DIAGNOSTIC_MESSAGE, b"\x43"))
    frame = talk.tell(events.mode(0))
    (stop,) = stops(talk)
    assert (stop.detail, stop.frames) == (SERVER_SAYS, [frame])


def test_a_cause_belongs_to_one_stop() -> None:
    """What was stated long before, or before another change of mode, is not the cause of this one."""
    talk = Talk()
    talk.open()
    talk.tell(pushed(0x4304))
    talk.tell(events.mode(0))
    talk.tell(events.mode(0))
    talk.tell(pushed(0x4304))
    talk.tell(events.mode(2))
    talk.tell(events.mode(0))
    talk.tell(pushed(0x4304))
    talk.tell(events.mode(0), after_ns=6 * SECOND)
    assert [CAUSE in stop.detail for stop in stops(talk)] == [True, False, False, False]


def test_the_events_that_state_a_stop_are_those_whose_names_do() -> None:
    named = {row.number for row in EVENTS if row.number >> 12 == 4 and row.name.startswith(("STOP", "DEFECT"))}
    named.discard(0x4301)  # from STOP to STARTUP
    stating = {row.number for row in EVENTS if states_stop(row.number)}
    assert named <= stating
    assert sorted(row.name for row in EVENTS if row.number in stating - named) == [
        "HOLD left, going to STOP",
        "checksum error",
        "memory reset wanted: interface to the integrated technology changed",
        "module in STOP because a CPU is",
        "modules are not ready",
        "no restart possible, monitoring time is over",
        "standby CPU in STOP",
        "standby CPU in STOP because the master is, during link-up",
    ]


@pytest.mark.parametrize(
    ("name", "frames", "detail"),
    [
        (
            "step7_s300_stop.pcapng",
            [3, 4],
            f"134.249.61.163:102 reports to 134.249.62.199:49161: mode STOP{CAUSE}0x4304 STOP by a PG or by SFB 20",
        ),
        (
            "s7plus/online_stop_yeni_yeni.pcapng",
            [42, 46],
            "192.168.41.10:102 reports to 192.168.55.5:62973: operating state STOP",
        ),
    ],
)
def test_shared_captures(corpus: Path, name: str, frames: list[int], detail: str) -> None:
    found = [finding for finding in dissect.analyze(corpus / name).findings if finding.slug == STOPPED]
    assert [(finding.frames, finding.detail) for finding in found] == [(frames, detail)]
