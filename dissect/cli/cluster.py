"""Tasks of ``--separate`` on a Dask cluster (option --cluster): the workers that take part, and their data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import click

from dissect.cli.configuration import settings_now
from dissect.cli.main import ARGUMENTS
from dissect.cli.separate import Readers, say
from dissect.files.cluster.connect import ClusterError, connected
from dissect.files.cluster.executor import Cluster
from dissect.files.cluster.reader import digest
from dissect.files.cluster.workers import here, obstacle, workers_of
from dissect.wire.text import printable

_CONFIG: Final = "--config"


@contextmanager
def readers_of(address: str, files: Sequence[str], folder: str) -> Iterator[Readers]:
    """Provide the workers of a cluster that can read ``files``, and write to ``folder`` unless that is "".

    Raises ClickException when there are none.
    """
    if "-" in files:
        raise click.UsageError("--cluster: standard input is on this machine only.")
    settings = settings_now()
    besides = _besides(files, settings)
    try:
        with connected(address) as (client, patience):
            workers = workers_of(client, patience)
            ours = here()
            usable = []
            for worker in workers:
                why = obstacle(worker, ours)
                if why:
                    _say_of_workers(None, f"{worker.label}: {why}")
                else:
                    usable.append(worker)
            if not usable:
                problem = "the cluster has no workers" if not workers else "no worker of the cluster can be used"
                raise click.ClickException(f"{printable(address)}: {problem}")
            with Cluster(client, usable, ours, besides, _say_of_workers) as cluster:
                fewer = len(usable) < len(workers)
                yield Readers(
                    cluster, lambda: cluster.slots, folder, settings, cluster.look, lambda: fewer or cluster.troubled
                )
    except ClusterError as error:
        raise click.ClickException(printable(str(error))) from None


def _say_of_workers(file: str | None, text: str) -> None:
    if file is not None:
        say(file, text)
    else:
        click.echo(f"s7dissect: {printable(text)}", err=True)


def _besides(files: Sequence[str], settings: Mapping[str, object]) -> Mapping[str, str]:
    """Return the other files that the command reads, with digests: those that options and settings name."""
    words: list[str] = []
    before = ""
    for word in click.get_current_context().meta[ARGUMENTS]:
        if before != _CONFIG and not word.startswith(f"{_CONFIG}="):  # the settings themselves are sent
            words += [word, word.partition("=")[2]]
        before = word
    for value in settings.values():
        words += [str(each) for each in (value if isinstance(value, list) else [value])]
    return {word: digest(word) for word in dict.fromkeys(words) if word and word not in files and _is_file(word)}


def _is_file(word: str) -> bool:
    try:
        return Path(word).is_file()
    except (OSError, ValueError):  # longer than a name may be, or with a NUL
        return False
