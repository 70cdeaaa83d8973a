"""General sentences in the catalogue: each stands only where somebody looked for a counter-example and found none."""

from __future__ import annotations

import re
from typing import Final

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.cause_tables import CAUSES
from dissect.engine.findings.known_bugs_tables import KNOWN_BUGS
from tests.cases import each

#: What claims something of all devices, clients or receivers.
GENERAL: Final = re.compile(
    r"\b(?:always|never|incorrectly|[Nn]o (?:S7 |normal )?(?:device|client|PLC)|[Aa]ll (?:devices|clients|PLCs)"
    r"|(?<![Mm]ost )(?:[Rr]eceivers?|devices|PLCs|clients|CPUs) ignore[sd]?|client is faulty|not normal)\b"
)
#: Where such a sentence may stand, and what was looked at.
EXAMINED: Final[dict[str, str]] = {
    "cotp.unfinished_tsdu": "'was never completed' says what happened on this connection",
    "ibh.unfinished": "'was never completed' says what happened on this connection",
    "stream.outside_window": "it names its exception, a large gap of the capture",
    "block.skipped_call": "'always made' is a fact of the code of the previous version",
}


@each("slug", CATALOGUE)
def test_a_general_sentence_was_examined(slug: str) -> None:
    rule = CATALOGUE[slug]
    found = GENERAL.findall(f"{rule.sentence} {rule.advice}")
    assert bool(found) is (slug in EXAMINED), found


def test_causes_and_known_bugs_claim_nothing_of_all() -> None:
    texts = [cause.when for cause in CAUSES]
    for bug in KNOWN_BUGS.values():
        texts += [bug.sign, bug.means, bug.remedy]
    assert [text for text in texts if GENERAL.search(text)] == []
