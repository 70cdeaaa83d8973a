"""An alert as a line and as JSON: nothing from the wire steers a terminal."""

from __future__ import annotations

import json

import pytest

from tests.meaning.report.support import UNSAFE
from tests.online.alerts.rules_of import alert

ODD = "TSAP \x1b[2J\u202egnp\nnext \x7f \udcff é"


def test_a_line_is_one_line() -> None:
    one = alert(ODD)
    one.repeated = 1
    assert one.line() == (
        "2024-03-04 05:06:08.500000 UTC  ALERT warning  rule: TSAP \\x1b[2J\\u202egnp\\x0anext \\x7f \\xff é, 1 more"
    )
    assert UNSAFE.search(one.line()) is None


@pytest.mark.parametrize("severity", ["error", "warning", "note"])
def test_what_a_webhook_and_a_program_get_names_the_severity_twice(severity: str) -> None:
    """Beside the key there is the whole alert in one text, for receivers that show one and no more."""
    told = json.loads(alert(severity=severity).as_json())
    assert told["severity"] == severity
    assert told["line"] == alert(severity=severity).line()
    assert f" UTC  ALERT {severity}  " in told["line"]
    assert told["text"] in told["line"]


def test_long_texts_are_cut() -> None:
    assert len(alert("x" * 100_000).line()) < 1200


def test_json_escapes_itself() -> None:
    text = alert(ODD).as_json()
    assert text.isascii()
    assert UNSAFE.search(text) is None
    values = json.loads(text)
    assert values["text"] == "TSAP \x1b[2J\u202egnp\nnext \x7f \\xff é"
    assert list(values) == [
        "schema", "rule", "when", "severity", "time", "client", "server", "connection", "text", "line", "repeated", "since",
        "new",
    ]  # fmt: skip
    assert values["schema"] == "s7dissect.alert/1"
    assert values["since"] is None
