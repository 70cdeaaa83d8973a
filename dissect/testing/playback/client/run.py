"""A whole replay: plays all connections, then compares the result with the recording."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Final

from dissect.meaning.report import words
from dissect.online.net.addresses import Address, Place
from dissect.testing.golden.comparison import differences
from dissect.testing.golden.difference import Difference, DiffOptions
from dissect.testing.golden.model import Link, Session
from dissect.testing.playback.client.expected import expected_session
from dissect.testing.playback.client.permissions import Permissions
from dissect.testing.playback.client.plan import Part, Withheld, playable, withheld
from dissect.testing.playback.client.player import INTERRUPTED, PartPlayer
from dissect.testing.playback.client.record import Record
from dissect.testing.playback.client.schedule import expect_few, perform
from dissect.testing.playback.client.settings import Settings, Shared
from dissect.testing.playback.client.watch import Watch

if TYPE_CHECKING:
    from dissect.engine.exchange import PayloadDecoder
    from dissect.packets.source.pcapng_writer import PcapngWriter

#: Maximum number of transaction numbers in a line of the summary.
_NAMED: Final = 10


class ReplayOutcome:
    """The result of a replay. ``expected`` and ``came`` are the expected and the actual session; `differences` compares them.

    ``withheld`` was left out on purpose; ``not_sent`` could no longer be sent; ``problems`` say why. ``unreachable`` counts
    connections that could not be made. ``interrupted``: the replay was halted before its end. ``file_trouble`` is why the
    capture file is incomplete, otherwise empty.
    """

    def __init__(self, name: str, came: Session, links: Mapping[int, Link], players: Sequence[PartPlayer]) -> None:
        self.came = came
        self.expected, self._pairs = expected_session(name, players, came, links)
        self.withheld: list[Withheld] = []
        self.not_sent: list[Withheld] = []
        self.problems: list[str] = []
        self.file_trouble = ""
        self.interrupted = False
        self.connections = sum([player.first_frame > 0 for player in players])
        self.unreachable = sum([player.unreachable for player in players])
        self.requests = sum([player.requests for player in players])
        self.answered = sum([player.answered for player in players])
        self.served = sum([player.served for player in players])
        self.server_jobs = sum([player.server_jobs for player in players])
        for player in players:
            number = player.part.link.number
            self.withheld += player.withheld
            self.not_sent += [withheld(transaction, player.problem) for transaction in player.not_sent]
            if player.problem not in {"", INTERRUPTED}:
                self.problems.append(f"connection {number}: {player.problem}")

    def differences(self, options: DiffOptions | None = None) -> Iterator[Difference]:
        """Yield the differences between the recording and the replay. The pairs of connections are known."""
        for one, other in self._pairs:
            yield from differences(one, other, options)

    def summary(self) -> list[str]:
        """Describe what was done and what was left out, in lines safe to show except for texts of the operating system."""
        answers = words.count(self.answered, "answer")
        lines = [
            f"{words.count(self.requests, 'request')} sent on {words.count(self.connections, 'connection')}, {answers}"
        ]
        if self.served:
            lines[0] += f", {words.count(self.served, 'job')} of the server answered"
        lines += self.problems
        lines += _grouped("withheld", self.withheld)
        lines += _grouped("not sent", self.not_sent)
        if self.server_jobs:
            more = "more " if self.served else ""
            lines.append(f"the server sent {words.count(self.server_jobs, more + 'time')}; it was not answered")
        return lines

    def as_dict(self) -> dict[str, object]:
        """Return it as JSON-ready values, without the sessions."""
        return {
            "connections": self.connections,
            "unreachable": self.unreachable,
            "requests": self.requests,
            "answered": self.answered,
            "jobs_answered": self.served,
            "server_jobs": self.server_jobs,
            "withheld": [one.as_dict() for one in self.withheld],
            "not_sent": [one.as_dict() for one in self.not_sent],
            "problems": list(self.problems),
        }


def _grouped(what: str, left: Sequence[Withheld]) -> list[str]:
    lines = []
    for reason, count in Counter([one.reason for one in left]).items():
        numbers = [str(one.transaction) for one in left if one.reason == reason][:_NAMED]
        more = f" and {count - _NAMED} more" if count > _NAMED else ""
        which = f"transaction{'s' if count > 1 else ''} {', '.join(numbers)}{more}"
        lines.append(f"{what}: {words.count(count, 'transaction')}, {reason} ({which})")
    return lines


def replay(
    recorded: Session,
    plan: Sequence[Part],
    places: Sequence[Place],
    target: Address,
    permissions: Permissions | None = None,
    settings: Settings | None = None,
    writer: PcapngWriter | None = None,
    decoder: PayloadDecoder | None = None,
    watch: Watch | None = None,
) -> ReplayOutcome:
    """Play the connections of ``plan`` (`make_plan`) to ``places`` (`places_of`); connections overlap as in the recording.

    Raises `ReplayError` if too many are open at once, before anything is sent.

    Only reads are sent unless ``permissions`` allow more. ``writer`` stores the exchange, ``decoder`` decodes SCD in it. A
    ``watch`` that is halted (`Watch.halt`) ends the replay early: nothing more is sent, connections are closed, and the outcome
    covers what was sent.
    """
    settings = settings or Settings()
    if not settings.one_by_one:
        expect_few(plan)
    record = Record(str(target), writer, decoder)
    shared = Shared(permissions or Permissions(), settings, record, watch)
    players = [PartPlayer(part, shared) for part in playable(plan)]
    try:
        perform(players, places, shared)
    finally:
        came = record.finish()
    outcome = ReplayOutcome(recorded.name, came, record.links, players)
    played = {id(player.part) for player in players}
    for part in plan:
        if id(part) not in played:
            outcome.withheld += part.withheld
    outcome.interrupted = shared.watch.halted
    outcome.file_trouble = record.trouble
    return outcome
