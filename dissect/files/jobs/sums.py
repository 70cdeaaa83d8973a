"""Results of a run over one file, on their way to be added up, and the sum of the counters of all pipelines.

A part is made of an observer that `dissect.files.jobs.sending` can send, after the run that filled it (`part_of`). A `Sum`
takes the parts in the order of the files.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from dissect.engine.observer import Observer
from dissect.engine.options import Options
from dissect.engine.pipeline import Pipeline
from dissect.engine.sums import Counted, add_counted, counted_by
from dissect.files.jobs.numbers import Offsets
from dissect.files.jobs.sending import Sent, receive, send
from dissect.files.jobs.tasks import About
from dissect.packets.source.packet import SourceFile


class FilePart(NamedTuple):
    """The results of the file ``name``; ``loss`` describes damage, ``first_ns`` is 0 if the file has no packets."""

    name: str
    loss: str
    octets: int
    first_ns: int
    last_ns: int
    sent: Sent

    @property
    def about(self) -> About:
        """The file, for recipients of all kinds of results."""
        return About(*self[:5])


def part_of(observer: Observer, pipeline: Pipeline, files: list[SourceFile]) -> FilePart:
    """Return the results of a finished run over one file."""
    counted = counted_by(pipeline)
    file = files[0]
    return FilePart(
        file.name, file.loss, int(file.octets), pipeline.first_ns, pipeline.now_ns, send((observer, counted, files))
    )


def unread(name: str, why: str, observer: Observer) -> FilePart:
    """Return the part for an unreadable file; ``observer`` is an empty one of its kind."""
    file = SourceFile(name, 1)
    file.damage = why
    pipeline = Pipeline(observer)
    pipeline.note_damage(f"{name}: {why}")
    pipeline.finish()
    return part_of(observer, pipeline, [file])


class Sum:
    """The counters of all pipelines so far, as one ``pipeline``, and the ``files`` they read.

    ``options`` are those of the whole run.
    """

    def __init__(self, options: Options) -> None:
        self.pipeline = Pipeline(Observer(), options)
        self.files: list[SourceFile] = []
        self._given_keys = len(self.pipeline.tls.keys)

    def take(self, part: FilePart) -> Any:
        """Add the part of the next file; return its observer, with the numbers of the whole run."""
        pipeline = self.pipeline
        packets, connections = pipeline.frames, int(pipeline.connections.count)
        received: tuple[Any, Counted, list[SourceFile]] = receive(
            part.sent, Offsets(packets, connections, int(pipeline.exchange.dialogue.count))
        )
        result, counted, files = received
        add_counted(pipeline, counted, packets, self._given_keys)
        self.files += files
        return result
