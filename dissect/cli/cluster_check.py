"""`s7dissect cluster-check`: whether the workers of a Dask cluster can do what `--cluster` would give them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.formats import format_option, write_outcome
from dissect.cli.main import EXIT_GATE, EXIT_OK
from dissect.cli.options.jobs import cluster_address
from dissect.meaning.report import words
from dissect.meaning.report.formats import OUTCOME, Format
from dissect.meaning.report.outcome import Outcome
from dissect.meaning.report.styled import FAILED, HEADING, PLAIN, Line
from dissect.wire.text import encodable, printable

if TYPE_CHECKING:
    from dissect.files.cluster.workers import Machine, Worker

CLUSTER_SCHEMA: Final = "s7dissect.cluster-check/1"


@click.command(
    "cluster-check",
    epilog="Exit code: 0 every worker can be used, 1 one of them cannot or there is none, 2 wrong use or no scheduler, "
    "5 the output could not be written.",
)
@click.argument("address", metavar="ADDRESS", callback=cluster_address)
@format_option(OUTCOME)
def command(address: str, format_: Format) -> int:
    """Ask every worker of a Dask cluster whether it can read captures as this machine does.

    ADDRESS is that of the scheduler, tcp://HOST:8786, or tls://HOST:8786 with the certificates of Dask's own settings. A worker
    needs the same version of s7dissect, and the extras that the captures take; compiled or interpreted gives the same results.
    """
    from dissect.files.cluster.connect import ClusterError, connected
    from dissect.files.cluster.workers import here, obstacle, workers_of

    ours = here()
    try:
        with connected(address) as (client, patience):
            workers = workers_of(client, patience)
    except ClusterError as error:
        raise click.ClickException(printable(str(error))) from None
    checked = [(worker, obstacle(worker, ours)) for worker in workers]
    write_outcome(format_, OUTCOME, _Check(address, ours, checked))
    return EXIT_OK if checked and not any([why for _, why in checked]) else EXIT_GATE


class _Check(Outcome):
    """Workers, and the problem of each, "" for none; ``ours`` is this machine."""

    def __init__(self, address: str, ours: Machine, checked: Sequence[tuple[Worker, str]]) -> None:
        self._address = address
        self._ours = ours
        self._checked = checked

    def text(self) -> Iterator[Line]:
        """Return the versions here, and two or three lines for each worker."""
        from dissect.files.cluster.workers import lacks

        yield Line(f"this machine: {_about(self._ours)}", PLAIN, 2)
        for worker, why in self._checked:
            address = "" if worker.name in {"", worker.address} else f", {worker.address}"
            yield Line(printable(f"{worker.label}{address}"), HEADING, 4)
            memory = f", {words.size(worker.memory)} of memory" if worker.memory else ""
            yield Line(
                f"  {words.count(worker.threads, 'thread')}{memory}, Dask {printable(worker.dask) or '?'}", PLAIN, 4
            )
            if worker.machine is not None:
                yield Line(f"  {_about(worker.machine)}", PLAIN, 4)
            if why:
                yield Line(f"  cannot be used: {printable(why)}", FAILED, 4)
            elif missing := lacks(worker, self._ours):
                yield Line(f"  not there, but here: {', '.join(missing)}; files that need one fail there", FAILED, 4)
        usable = [worker for worker, why in self._checked if not why]
        threads = words.count(sum([worker.threads for worker in usable]), "file")
        text = f"{len(usable)} of {words.count(len(self._checked), 'worker')} can be used, {threads} at the same time"
        yield Line(text if self._checked else "the cluster has no workers", PLAIN if usable else FAILED, 2)

    def as_dict(self) -> Mapping[str, object]:
        """Return the object of the JSON contract."""
        from dissect.files.cluster.workers import lacks

        return {
            "schema": CLUSTER_SCHEMA,
            "scheduler": encodable(self._address),
            "here": _as_dict(self._ours),
            "workers": [
                {
                    "address": encodable(worker.address),
                    "name": encodable(worker.name),
                    "threads": worker.threads,
                    "memory": worker.memory or None,
                    "dask": encodable(worker.dask) or None,
                    "machine": _as_dict(worker.machine) if worker.machine is not None else None,
                    "usable": not why,
                    "reason": encodable(why) or None,
                    "lacks": lacks(worker, self._ours),
                }
                for worker, why in self._checked
            ],
        }


def _about(machine: Machine) -> str:
    build = "compiled" if machine.compiled else "interpreted"
    version = f"s7dissect {printable(machine.version)} ({build})" if machine.version else "no s7dissect"
    extras = ", ".join([printable(name) for name in machine.extras]) or "none"
    return f"{version}, Python {printable(machine.python)}; extras: {extras}"


def _as_dict(machine: Machine) -> dict[str, object]:
    return {
        "host": encodable(machine.host),
        "python": encodable(machine.python),
        "version": encodable(machine.version) or None,
        "compiled": machine.compiled if machine.version else None,
        "extras": [encodable(name) for name in machine.extras],
    }
