"""Which findings of a rule are shown one by one: from as many pairs of hosts as possible, then the earliest.

A thousand findings between two hosts must not hide the one between two others.
"""

from __future__ import annotations

from collections.abc import Iterable

from dissect.engine.findings.reporter import Finding


class Examples:
    """Takes the findings of a rule in order, and chooses up to ``most`` of them."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._taken = 0
        self._early: list[tuple[int, Finding]] = []  # with their places in the order
        self._first: list[tuple[int, Finding]] = []  # the first of each pair of hosts
        self._hosts: set[tuple[str, str]] = set()

    def take(self, finding: Finding) -> None:
        """Take the next finding."""
        place = self._taken
        self._taken += 1
        if place < self._most:
            self._early.append((place, finding))
        if len(self._first) < self._most:
            hosts = (finding.client, finding.server)
            if hosts not in self._hosts:
                self._hosts.add(hosts)
                self._first.append((place, finding))

    def chosen(self) -> list[Finding]:
        """Return the chosen findings in order."""
        found = dict(self._first)
        for place, finding in self._early:
            if len(found) == self._most:
                break
            found[place] = finding
        return [found[place] for place in sorted(found)]


def examples_of(findings: Iterable[Finding], most: int) -> list[Finding]:
    """Return up to ``most`` findings of a rule, in order."""
    taken = Examples(most)
    for finding in findings:
        taken.take(finding)
    return taken.chosen()
