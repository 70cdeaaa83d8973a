"""How users name findings: by severity (that or worse), by slug, or by a prefix of slugs."""

from __future__ import annotations

from typing import Final

from dissect.engine.findings.catalogue import CATALOGUE, SEVERITIES

#: Ends a prefix: ``session.*`` means every slug that begins with ``session.``.
_ANY: Final = "*"


def slugs_of(text: str) -> frozenset[str]:
    """Return the slugs that ``text`` names: a severity (that or worse), a slug, or a prefix with ``*``.

    Raises ValueError, with suggestions, when it is none of these.
    """
    if text in SEVERITIES:
        worse = SEVERITIES[: SEVERITIES.index(text) + 1]
        return frozenset([slug for slug, rule in CATALOGUE.items() if rule.severity in worse])
    if text.endswith(_ANY):
        found = frozenset([slug for slug in CATALOGUE if slug.startswith(text[:-1])])
    else:
        found = frozenset([text]) & frozenset(CATALOGUE)
    if not found:
        raise ValueError(f"{text!r} is neither a severity nor a finding{_near(text)}")
    return found


def _near(text: str) -> str:
    rooms = sorted({slug.partition(".")[0] + ".*" for slug in CATALOGUE})
    import difflib  # imported late: a run without this mistake does not need it

    near = difflib.get_close_matches(text, [*SEVERITIES, *rooms, *CATALOGUE], n=3)
    begun = [slug for slug in CATALOGUE if text and (slug.startswith(text) or slug.endswith("." + text))]
    named = list(dict.fromkeys([*begun[:3], *near]))
    return f"; did you mean {', '.join(named)}?" if named else "; s7dissect help findings lists them."
