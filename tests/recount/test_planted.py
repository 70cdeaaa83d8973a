"""A wrong number that is planted in what an output says is found, for every kind of sentence."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator

from tests.recount.gathering import Recounted
from tests.recount.kinds import KINDS
from tests.recount.recount import Claim, recount

#: So many claims of a kind are tried.
TRIES = 6


def planted(claim: Claim) -> Iterator[str]:
    """Yield wrong numbers, names or times in the place of a right one: another digit, from the first one on."""
    for found in re.finditer(r"\d", claim.said):
        other = str((int(found[0]) + 1) % 10)
        yield f"{claim.said[: found.start()]}{other}{claim.said[found.end() :]}"


def shows(one: Recounted, claim: Claim) -> bool:
    """Return whether a number that is planted at a claim is reported as a difference of that kind."""
    for wrong in planted(claim):
        text = one.outputs[claim.face]
        outputs = {**one.outputs, claim.face: text[: claim.begin] + wrong + text[claim.end :]}
        after = recount(outputs, one.path, {claim.face: KINDS[claim.face]})
        if any([found.kind == claim.kind and not found.right for found in after]):
            return True
    return False


def test_a_wrong_number_of_every_kind_is_found(project: list[Recounted]) -> None:
    places: dict[str, list[tuple[Recounted, Claim]]] = defaultdict(list)
    for one in project:
        for claim in one.claims:
            if len(places[claim.kind]) < TRIES and re.search(r"\d", claim.said):
                places[claim.kind].append((one, claim))
    blind = {kind: [claim.said for one, claim in tried if not shows(one, claim)] for kind, tried in places.items()}
    assert {kind: said for kind, said in blind.items() if said} == {}
    assert len(places) >= 100
