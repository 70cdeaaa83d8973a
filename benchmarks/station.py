"""One client and its PLC: their messages over one connection after another."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from benchmarks.connection import CLIENT, MS, PLC, US, Connection
from benchmarks.jobs import Job, clock_job, read_job, service_job, szl_jobs, upload_jobs, write_job
from benchmarks.pdus import (
    EMPTY_DT,
    JOB,
    USERDATA,
    answer,
    connect_tpdu,
    diagnostic_push,
    disconnect_tpdu,
    request,
    setup_param,
    tpkt,
)
from benchmarks.truth import Deal, Truth, Unit

if TYPE_CHECKING:
    from random import Random

    from benchmarks.frames import Host
    from benchmarks.pdus import Variables
    from benchmarks.plant import Manner, Plant

_LATENCIES_NS: Final = (80 * US, 400 * US, 1500 * US, 4 * MS, 9 * MS, 18 * MS)
_CYCLES_NS: Final = (20 * MS, 50 * MS, 100 * MS, 200 * MS, 500 * MS)
_HEADER_ERRORS: Final = (0x8104, 0x8500, 0xD241)
_CALLED: Final = b"\x01\x02"


class Station:
    """A client stack with its behaviour, polling one PLC, one connection at a time."""

    def __init__(
        self, rng: Random, plant: Plant, truth: Truth, manner: Manner, client: Host, plc: Host, *, midstream: bool
    ) -> None:
        self._rng = rng
        self._plant = plant
        self._truth = truth
        self._manner = manner
        self._client = client
        self._plc = plc
        self._midstream = midstream
        self._port = rng.randrange(1025, 60000)
        self._fixed_port = rng.random() < 0.1
        self._stamps = rng.random() < 0.2
        self._pad = rng.random() < 0.5
        self._short = rng.random() < 0.15
        # The PLC's address decides, so that it has the same speed and size for each of its clients.
        self._latency_ns = _LATENCIES_NS[plc.address * 7 % len(_LATENCIES_NS)]
        self._length = min((240, 480, 960)[plc.address % 3], manner.pdu_length)
        self._cycle_ns = rng.choice(_CYCLES_NS)
        self._polls: list[Variables] = plant.polls(rng, self._length)
        self._connection: Connection | None = None
        self._left = 0
        self._poll = 0
        self._number = 0
        self._sequence = 0
        self._owes_empty = False
        #: Exchanges since the capture last missed a segment of this connection.
        self.since_loss = 100

    def act(self, now: int) -> tuple[Connection, int, bool]:
        """Perform the next action at time ``now``.

        Returns the connection with its new drafts, the time of the next action, and whether this was an ordinary exchange, the
        only place for mishaps.
        """
        rng = self._rng
        if self._connection is None:
            self._connection = connection = self._new_connection()
            end = self._start(now, connection)
            return connection, end + rng.randrange(1 * MS, 30 * MS), False
        connection = self._connection
        connection.drafts = []
        if self._left <= 0:
            return connection, self._stop(now, connection) + rng.randrange(300 * MS, 2000 * MS), False
        self._left -= 1
        self.since_loss += 1
        if rng.random() < 0.00008:
            return connection, self._never_answered(now, connection) + rng.randrange(300 * MS, 2000 * MS), False
        end = self._exchange(now, connection)
        return connection, max(now + self._cycle_ns, end) + rng.randrange(MS, 3 * MS), True

    def _new_connection(self) -> Connection:
        rng = self._rng
        if not self._fixed_port:
            self._port = self._port + 1 if self._port < 65000 else 1025
        self._truth.connections += 1
        self._owes_empty = False
        self._left = rng.randrange(3, 60) if self._short else rng.randrange(20_000, 90_000)
        self.since_loss = 100
        return Connection(rng, self._client, self._port, self._plc, stamps=self._stamps, pad=self._pad)

    # -- the connection ------------------------------------------------------------------------------------------------

    def _start(self, now: int, connection: Connection) -> int:
        """Open TCP, COTP and S7; a station may have begun before the capture, or be refused."""
        rng = self._rng
        manner = self._manner
        if self._midstream:
            self._midstream = False
            self._number = rng.getrandbits(16)
            return now
        now = connection.open(now, self._trip())
        reference = rng.randrange(1, 0x10000)
        now += rng.randrange(100, 900) * US
        asked = connect_tpdu(0xE0, 0, reference, manner.tpdu_size, manner.calling, _CALLED)
        connection.send(now, CLIENT, [(asked, Unit("CR"))])
        now += self._trip()
        if rng.random() < 0.01:
            connection.send(now, PLC, [(disconnect_tpdu(reference, 2), Unit("DR"))])
            self._connection = None
            return connection.finish(now + 200 * US, PLC)
        chosen = connect_tpdu(0xD0, reference, rng.randrange(1, 0x10000), manner.tpdu_size, manner.calling, _CALLED)
        connection.send(now, PLC, [(chosen, Unit("CC"))])
        now += rng.randrange(200, 2000) * US
        jobs = manner.open_jobs
        setup = Job(JOB, setup_param(8, 8, manner.pdu_length), b"", setup_param(jobs, jobs, self._length), b"")
        self._number = manner.first
        return self._round(now, connection, [setup])

    def _stop(self, now: int, connection: Connection) -> int:
        self._connection = None
        chance = self._rng.random()
        if chance < 0.2:
            return connection.reset(now, CLIENT)
        return connection.finish(now, PLC if chance < 0.3 else CLIENT)

    def _never_answered(self, now: int, connection: Connection) -> int:
        """A request is acknowledged but not answered; the client waits, then breaks off."""
        self._truth.happened("never_answered")
        job = read_job(self._rng, self._polls[0])
        connection.send(now, CLIENT, self._asking(job, self._references(1)[0], Deal()))
        connection.ack(now + self._trip(), PLC)
        self._connection = None
        return connection.reset(now + self._rng.randrange(2000 * MS, 5000 * MS), CLIENT)

    # -- exchanges -----------------------------------------------------------------------------------------------------

    def _exchange(self, now: int, connection: Connection) -> int:
        """Send the due requests: mostly the next polls, now and then something else, which may take several rounds."""
        rng = self._rng
        chance = rng.random()
        if chance < 0.92:
            return self._round(now, connection, self._due(rng.randint(1, self._manner.open_jobs)))
        if chance < 0.97:
            return self._round(now, connection, [write_job(rng, rng.choice(self._plant.writes))])
        if chance < 0.99:
            self._sequence = self._sequence % 255 + 1
            jobs = szl_jobs(rng, self._length - 26, self._sequence)
        elif chance < 0.995:
            self._sequence = self._sequence % 255 + 1
            jobs = [clock_job(self._sequence)]
        elif chance < 0.9955:
            jobs = upload_jobs(rng, self._length - 18)
        elif chance < 0.997:
            jobs = [service_job()]
        else:
            return self._push(now, connection)
        for job in jobs:
            now = self._round(now, connection, [job]) + rng.randrange(100, 3000) * US
        return now

    def _due(self, count: int) -> list[Job]:
        jobs: list[Job] = []
        for _ in range(count):
            self._poll = (self._poll + 1) % len(self._polls)
            job = read_job(self._rng, self._polls[self._poll])
            if self._rng.random() < 0.0005:
                job.refuse(self._rng.choice(_HEADER_ERRORS))
            jobs.append(job)
        return jobs

    def _push(self, now: int, connection: Connection) -> int:
        unit = Unit("DT", USERDATA, 0)
        connection.send(now, PLC, [(tpkt(diagnostic_push(self._rng)), unit)])
        return connection.ack(now + 150 * US, CLIENT)

    def _trip(self) -> int:
        """Return the time to an answer: log-normal around the PLC's own pace, one in 2000 ten times as long."""
        rng = self._rng
        pace = self._latency_ns * (10 if rng.random() < 0.0005 else 1)
        return max(20 * US, int(pace * rng.lognormvariate(0.0, 0.3)))

    def _references(self, count: int) -> list[int]:
        """Return the PDU references of the next ``count`` requests, as numbers in network order."""
        manner = self._manner
        if manner.numbers == "smallest":
            return list(range(1, count + 1))
        numbers = [(self._number + step) & 0xFFFF for step in range(count)]
        self._number = (self._number + count) & 0xFFFF
        if manner.numbers == "little":
            return [(number & 0xFF) << 8 | number >> 8 for number in numbers]
        return numbers

    def _asking(self, job: Job, reference: int, deal: Deal) -> list[tuple[bytes, Unit]]:
        """Return the TPKTs of a request; an empty DT that is still due goes before it."""
        unit = Unit("DT", job.rosctr, job.function, deal)
        unit.items = job.items
        deal.failed = job.failed
        number = 0x80 | (reference & 0x7F if self._manner.tpdu_numbers else 0)
        asked = (tpkt(request(job.rosctr, reference, job.param, job.data), number), unit)
        if self._owes_empty:
            self._owes_empty = False
            return [(EMPTY_DT, Unit("DT")), asked]
        return [asked]

    def _answering(self, job: Job, reference: int, deal: Deal) -> tuple[bytes, Unit]:
        unit = Unit("DT", job.answer_rosctr, job.answer_function, deal)
        unit.answers = True
        unit.refusals = job.refusals
        if job.answer_rosctr == USERDATA:
            pdu = request(USERDATA, reference, job.answer_param, job.answer_data)
        else:
            pdu = answer(job.answer_rosctr, reference, job.answer_param, job.answer_data, job.error)
        return tpkt(pdu), unit

    def _round(self, now: int, connection: Connection, jobs: list[Job]) -> int:
        """Send all ``jobs``, let all be answered, acknowledge; return the time of the last segment."""
        rng = self._rng
        deals = [Deal() for _ in jobs]
        references = self._references(len(jobs))
        asked = [self._asking(*row) for row in zip(jobs, references, deals, strict=True)]
        if self._manner.together:
            now = connection.send(now, CLIENT, [piece for pieces in asked for piece in pieces])
        else:
            for pieces in asked:
                now = connection.send(now, CLIENT, pieces, self._cuts(pieces, 0.004)) + rng.randrange(10, 60) * US
        trip = self._trip()
        if rng.random() < 0.32:
            connection.ack(now + min(150 * US, trip // 2), PLC)
        now += trip
        answers = [self._answering(*row) for row in zip(jobs, references, deals, strict=True)]
        if self._manner.together and len(jobs) > 1 and rng.random() < 0.3:
            return self._answered(connection.send(now, PLC, answers, self._cuts(answers, 0.1)), connection)
        for number, piece in enumerate(answers):
            now = self._answered(connection.send(now, PLC, [piece], self._cuts([piece], 0.02)), connection)
            if number + 1 < len(answers):
                now += self._trip() // 4
        return now

    def _answered(self, now: int, connection: Connection) -> int:
        """The client gets an answer: it sends an empty DT, an acknowledgement, or nothing until its next request."""
        chance = self._rng.random()
        now += self._rng.randrange(40, 200) * US
        if self._manner.empties:
            if chance < 0.3:
                self._owes_empty = True
                return now
            now = connection.send(now, CLIENT, [(EMPTY_DT, Unit("DT"))])
            return connection.ack(now + 150 * US, PLC) if chance < 0.8 else now
        return connection.ack(now, CLIENT) if chance < 0.76 else now

    def _cuts(self, pieces: list[tuple[bytes, Unit]], share: float) -> tuple[int, ...]:
        """Return where to cut the data into segments: no cut except for a ``share``; a third of these in the header."""
        rng = self._rng
        if rng.random() >= share:
            return ()
        size = sum([len(octets) for octets, _ in pieces])
        self._truth.happened("split")
        if rng.random() < 0.33:
            return (rng.randint(1, 6),)
        return tuple(sorted(rng.sample(range(4, size), rng.randint(1, 2))))
