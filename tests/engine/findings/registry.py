"""The register of scenarios: the conversations that trigger a rule, and those that do not."""

from __future__ import annotations

from collections.abc import Callable

from tests.engine.transactions.talk import Talk

Scenario = Callable[[Talk], None]

SPEAKS: dict[str, Scenario] = {}
SILENT: dict[str, Scenario] = {}


def speaks(slug: str) -> Callable[[Scenario], Scenario]:
    def keep(scenario: Scenario) -> Scenario:
        assert slug not in SPEAKS
        SPEAKS[slug] = scenario
        return scenario

    return keep


def silent(*slugs: str) -> Callable[[Scenario], Scenario]:
    def keep(scenario: Scenario) -> Scenario:
        for slug in slugs:
            assert slug not in SILENT
            SILENT[slug] = scenario
        return scenario

    return keep
