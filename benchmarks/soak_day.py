"""A day of a busy line in minutes, through the live path and without a network card; prints one JSON object.

Run as a child by `benchmarks.soak` and by its test: whichever package ``dissect`` is found first is measured. The packets have
the times of a whole day and the run's clock follows them, so that everything that waits, is overdue, expires or is renewed by
time does so as often as in a day. All events are written as JSON lines to nowhere; alerts and metrics are active as well.

On the line: sixteen connections that poll once a second; eight whose requests are never answered; and connections that are
opened, used for one request and closed, 10,000 in a busy minute (of four ends one is a reset, one never comes).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from typing import TYPE_CHECKING, Final

from benchmarks.feed import peak_kb, resident_kb
from benchmarks.frames import ACK, FIN, PSH, RST, SYN, Host, Sender
from benchmarks.pdus import ACK_DATA, JOB, READ, answer, connect_tpdu, request, setup_param, tpkt
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options
from dissect.online.alerts.dispatcher import Dispatcher
from dissect.online.alerts.engine import AlertEngine
from dissect.online.alerts.loading import parse_rules
from dissect.online.live.alerting import AlertCompanion
from dissect.online.live.events import CLOSED, FINDING, OPENED, TRANSACTION, Event
from dissect.online.live.json_lines import JsonLines
from dissect.online.live.run import Companion, LiveRun
from dissect.online.metrics.counters import Metrics
from dissect.packets.source.live.reader import Drops, LiveReader
from dissect.wire.build import COMPILED

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from dissect.engine.findings.reporter import Finding
    from dissect.engine.transactions.connection import Connection
    from dissect.engine.transactions.transaction import Transaction
    from dissect.online.alerts.alert import Alert
    from dissect.packets.source.packet import PacketSink

NS: Final = 1_000_000_000
MINUTE_S: Final = 60
_BEGIN_NS: Final = 1_709_510_400_000_000_000  # 2024-03-04 00:00 UTC
_QUARTERS: Final = 4
_POLLING: Final = 16
_UNANSWERED: Final = 8
#: Connections of a busy minute, and which minutes are busy by default: two an hour.
CHURN: Final = 10_000
BUSY_EVERY: Final = 30
#: Connections in any other minute.
_CALM: Final = 100
_PORTS: Final = 50_000
_ETHERNET: Final = 1

_READ: Final = bytes((READ, 1)) + b"\x12\x0a\x10\x02\x00\x04\x00\x01\x84\x00\x00\x00"
_VALUE: Final = b"\xff\x04\x00\x20\x11\x22\x33\x44"

_RULES: Final = """
[defaults]
cooldown = "5min"
actions = []
[[rule]]
name = "any finding"
when = "finding"
finding = "note"
[[rule]]
name = "requests stay unanswered"
when = "outcome"
of = "unanswered"
above = 10
[[rule]]
name = "silence"
when = "silence"
longer = "30s"
[[rule]]
name = "rate"
when = "rate"
of = "transactions"
above = 500
[[rule]]
name = "slow"
when = "latency"
of = "median"
above = "1s"
"""


class _Talk:
    """A connection between a client and the PLC, frame by frame."""

    def __init__(self, number: int, plc: Host, base: int) -> None:
        client = Host(base + number // _PORTS % 0x10000)
        port = 1025 + number % _PORTS
        self.client = Sender(client, port, plc, 102, number * 2654435761 & 0xFFFFFFFF)
        self.plc = Sender(plc, 102, client, port, 7 * number & 0xFFFFFFFF)

    def flags(self, sender: Sender, flags: int) -> bytes:
        """Return a segment of flags alone."""
        other = self.plc if sender is self.client else self.client
        frame = sender.segment(flags, sender.seq, other.seq if flags & ACK else 0, b"")
        if flags & (SYN | FIN):
            sender.seq = sender.seq + 1 & 0xFFFFFFFF
        return frame

    def say(self, sender: Sender, payload: bytes) -> bytes:
        """Return a segment with a payload."""
        other = self.plc if sender is self.client else self.client
        frame = sender.segment(ACK | PSH, sender.seq, other.seq, payload)
        sender.seq = sender.seq + len(payload) & 0xFFFFFFFF
        return frame

    def hello(self) -> list[bytes]:
        """Return the handshakes of TCP, COTP and S7."""
        client, plc = self.client, self.plc
        return [
            self.flags(client, SYN),
            self.flags(plc, SYN | ACK),
            self.say(client, connect_tpdu(0xE0, 0, 1, 0x0A, b"\x01\x00", b"\x01\x02")),
            self.say(plc, connect_tpdu(0xD0, 1, 2, 0x0A, b"\x01\x00", b"\x01\x02")),
            self.say(client, tpkt(request(JOB, 0, setup_param(8, 8, 480)))),
            self.say(plc, tpkt(answer(ACK_DATA, 0, setup_param(8, 8, 480)))),
        ]

    def ask(self, number: int) -> bytes:
        """Return a read."""
        return self.say(self.client, tpkt(request(JOB, number & 0xFFFF, _READ)))

    def tell(self, number: int) -> bytes:
        """Return its answer."""
        return self.say(self.plc, tpkt(answer(ACK_DATA, number & 0xFFFF, bytes((READ, 1)), _VALUE)))


class Day:
    """The traffic on the line, second by second. ``opened`` counts the connections."""

    def __init__(self, churn: int, busy_every: int) -> None:
        self._churn = churn
        self._busy_every = busy_every
        self._plc = Host(0x0A0A0102, b"\x00\x1b\x1b")
        self._polling = [_Talk(number, self._plc, 0x0A0B0000) for number in range(_POLLING)]
        self._unanswered = [_Talk(number, self._plc, 0x0A0C0000) for number in range(_UNANSWERED)]
        self.opened = 0

    def second(self, number: int) -> Iterator[bytes]:
        """Yield the frames of the second ``number`` of the day."""
        if number == 0:
            for talk in self._polling + self._unanswered:
                yield from talk.hello()
        for talk in self._polling:
            yield talk.ask(number)
            yield talk.tell(number)
        for talk in self._unanswered:
            yield talk.ask(number)
        minute, within = divmod(number, MINUTE_S)
        total = self._churn if minute % self._busy_every == 0 else min(_CALM, self._churn)
        for _ in range(total * (within + 1) // MINUTE_S - total * within // MINUTE_S):
            yield from self._short()

    def _short(self) -> Iterator[bytes]:
        """Yield a whole connection."""
        talk = _Talk(self.opened, self._plc, 0x0A800000)
        self.opened += 1
        yield from talk.hello()
        yield talk.ask(1)
        yield talk.tell(1)
        if self.opened % 4 == 1:
            yield talk.flags(talk.client, RST | ACK)
        elif self.opened % 4:
            yield talk.flags(talk.client, FIN | ACK)
            yield talk.flags(talk.plc, FIN | ACK)


class DayReader(LiveReader):
    """A live source that gives a second of the day at each step, and whose clock is that of the capture."""

    def __init__(self, day: Day, seconds: int) -> None:
        super().__init__("day", "made", 0)
        self._day = day
        self._seconds = seconds
        self.second = 0

    @property
    def drops(self) -> Drops:
        return Drops(0, 0)

    def clock(self) -> int:
        """Return the monotonic clock of the run."""
        return self.second * NS

    def step(self, sink: PacketSink) -> bool:
        """Give the next second; False after the last."""
        if self.second == self._seconds:
            return False
        time_ns = _BEGIN_NS + self.second * NS
        for frame in self._day.second(self.second):
            time_ns += 20_000
            sink.frame(time_ns, frame, 0, len(frame), len(frame), _ETHERNET)
            self.packets += 1
            self.octets += len(frame)
        self.second += 1
        return True


class _Told(Observer):
    """Makes a line of every event, as `s7dissect monitor -T jsonl` does, and counts octets and lines."""

    def __init__(self) -> None:
        super().__init__()
        self._lines = JsonLines(frozenset())
        self.lines = 0
        self.octets = 0
        self.findings = 0

    def _tell(self, kind: str, time_ns: int, what: Connection | Transaction | Finding) -> None:
        self.lines += 1
        self.octets += len(self._lines.line(Event(kind, time_ns, what)))

    def connection_opened(self, connection: Connection) -> None:
        self._tell(OPENED, int(connection.tcp.last_ns), connection)

    def connection_closed(self, connection: Connection) -> None:
        self._tell(CLOSED, int(connection.tcp.last_ns), connection)

    def transaction(self, transaction: Transaction) -> None:
        self._tell(TRANSACTION, int(transaction.request_ns), transaction)

    def finding(self, finding: Finding) -> None:
        self.findings += 1
        self._tell(FINDING, int(finding.time_ns), finding)


def spend(hours: float, churn: int, busy_every: int) -> dict[str, object]:
    """Let the hours pass; return the counts, and ``resident_kb`` after each quarter.

    Memory is measured after a calm minute, so the figure shows only what a busy minute leaves behind; its peak is in
    ``peak_kb``.
    """
    quarter = max(int(hours * 3600) // _QUARTERS // (MINUTE_S * busy_every), 1) * MINUTE_S * busy_every
    day = Day(churn, busy_every)
    reader = DayReader(day, quarter * _QUARTERS)
    told = _Told()
    alerts: list[int] = [0]

    def alert(_: Alert) -> None:
        alerts[0] += 1

    rules = parse_rules(_RULES)
    engine = AlertEngine(rules, None, alert)
    companions: list[Companion] = [Metrics(), AlertCompanion(engine, Dispatcher(rules.actions))]
    run = LiveRun(reader, told, Options(overdue_ns=2 * NS), companions=companions, clock=reader.clock)
    resident: list[int] = []
    begun = time.process_time()
    while run.step():
        if reader.second % quarter == 0 and len(resident) < reader.second // quarter:
            resident.append(resident_kb())
            print(
                f"{reader.second // 3600} h: {resident[-1]} KiB, {reader.packets} packets", file=sys.stderr, flush=True
            )
    return {
        "build": "compiled" if COMPILED else "interpreted",
        "hours": reader.second / 3600,
        "packets": reader.packets,
        "connections": day.opened + _POLLING + _UNANSWERED,
        "transactions": run.pipeline.exchange.dialogue.count,
        "findings": told.findings,
        "alerts": alerts[0],
        "lines": told.lines,
        "line_octets": told.octets,
        "failures": run.failures,
        "resident_kb": resident,
        "peak_kb": peak_kb(),
        "cpu_s": time.process_time() - begun,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak_day", description=__doc__)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--churn", type=int, default=CHURN, help="connections in a busy minute")
    parser.add_argument("--busy-every", type=int, default=BUSY_EVERY, help="every which minute is busy (1: all)")
    options = parser.parse_args(arguments)
    json.dump(spend(options.hours, options.churn, options.busy_every), sys.stdout)
    sys.stdout.write("\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
