"""The page in Firefox: it opens from the disk and says what the command line says."""

from __future__ import annotations

import json
from pathlib import Path

from tests.output.browser.bidi import Firefox
from tests.output.browser.test_page import PLANT, here

LINES = (["analyze", "-T", "json", PLANT.name], ["transactions", "-T", "jsonl", PLANT.name])


def test_it_opens_and_analyses_a_capture(page: Path, tmp_path: Path) -> None:
    with Firefox(tmp_path / "profile") as firefox:
        firefox.open(page)
        firefox.until("document.documentElement.dataset.ready === 'yes'")
        firefox.script(
            "addEventListener('securitypolicyviolation', (event) => { document.title = event.violatedDirective; }); ''"
        )
        firefox.choose("#choose", [PLANT])
        firefox.until("document.documentElement.dataset.files === '1'")
        for line in LINES:
            run = f"engine.run({json.dumps(line)})"
            told = firefox.script(
                f"{run}.then(async (one) => JSON.stringify([one.code, await one.out.text(), one.errors]))"
            )
            assert json.loads(told) == list(here(PLANT.parent, line))
        firefox.script("select('transactions', '2'); ''")
        firefox.until("document.querySelectorAll('.dump').length === 2")
        firefox.script("select('report'); ''")
        firefox.until("document.querySelector('iframe.report')")
        assert firefox.script("document.title") == "s7dissect"
        assert firefox.script("String(performance.getEntriesByType('resource').length)") == "0"
