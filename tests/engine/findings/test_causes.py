"""The table of causes: each pair of cause and consequence has a conversation that speaks, and one beside it that does not."""

from __future__ import annotations

from dissect.engine.findings.catalogue import CATALOGUE, SEVERITIES
from dissect.engine.findings.cause_tables import CAUSES, CONNECTION, EXPLAINS, REQUEST, WAITS
from tests.cases import each
from tests.engine.findings.cause_scenarios import EXPLAINED, UNEXPLAINED, Pair
from tests.engine.findings.registry import Scenario
from tests.engine.transactions.talk import Talk

PAIRS: list[Pair] = [(cause.slug, slug) for cause in CAUSES for slug in cause.consequences]
#: What changes a running plant, or tries to.
ACTS = frozenset(
    (
        "security.plc_stop", "security.plc_start", "security.stopped", "security.mode_changed", "security.program_change",
        "security.program_read", "security.memory", "security.force", "security.write", "security.write_outputs",
        "security.new_writer", "security.clock_set", "security.password", "security.password_failed",
        "security.password_guessing", "security.nc_command", "security.unknown_service", "security.alarm_change",
    )
)  # fmt: skip


def played(scenario: Scenario) -> Talk:
    talk = Talk()
    scenario(talk)
    return talk


# ---- the table ------------------------------------------------------------------------------------------------------


def test_the_table_is_sound() -> None:
    slugs = [cause.slug for cause in CAUSES]
    assert len(slugs) == len(set(slugs))
    for cause in CAUSES:
        assert cause.slug in CATALOGUE
        assert cause.scope in {REQUEST, CONNECTION}
        assert cause.when
        assert len(cause.consequences) == len(set(cause.consequences))
        assert EXPLAINS[cause.slug] == set(cause.consequences) <= set(CATALOGUE)


def test_acts_are_never_explained_away() -> None:
    assert set(CATALOGUE) >= ACTS
    assert not ACTS & {slug for _, slug in PAIRS}


@each("pair", PAIRS)
def test_a_cause_is_never_lighter_than_what_it_explains(pair: Pair) -> None:
    """So that a gate for a severity fails as it did before."""
    cause, slug = (SEVERITIES.index(CATALOGUE[one].severity) for one in pair)
    assert cause <= slug


def test_what_waits_is_what_shows_itself_only_later() -> None:
    assert {slug for cause in CAUSES if cause.scope == CONNECTION for slug in cause.consequences} == WAITS


def test_each_pair_has_both_conversations() -> None:
    assert set(PAIRS) == set(EXPLAINED) == set(UNEXPLAINED)


# ---- the pairs ------------------------------------------------------------------------------------------------------


@each("pair", PAIRS)
def test_a_cause_explains(pair: Pair) -> None:
    cause, slug = pair
    talk = played(EXPLAINED[pair])
    reporter = talk.pipeline.exchange.reporter
    assert reporter.explained.get(pair), reporter.explained
    assert slug not in reporter.counts, reporter.counts
    assert reporter.counts[cause]
    by_number = {int(finding.number): finding for finding in talk.findings}
    assert sorted(by_number) == [*range(1, len(talk.findings) + 1)]
    found = [finding for finding in talk.findings if finding.slug == slug]
    assert found
    for finding in found:
        reason = by_number[int(finding.explained_by)]
        assert finding.because == reason.slug == cause
        assert reason.number < finding.number
        assert not reason.because
        said = reason.detail.partition("; seen with")[0]
        assert finding.detail.endswith(f"because of {cause}: {said}")
        assert len(said) <= 200


@each("pair", PAIRS)
def test_what_the_cause_does_not_explain_stands_for_itself(pair: Pair) -> None:
    _, slug = pair
    talk = played(UNEXPLAINED[pair])
    reporter = talk.pipeline.exchange.reporter
    assert reporter.counts.get(slug), (reporter.counts, reporter.explained)
    alone = [finding for finding in talk.findings if finding.slug == slug and not finding.because]
    assert alone
    for finding in alone:
        assert finding.explained_by == 0
        assert "because of" not in finding.detail
