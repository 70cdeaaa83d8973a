"""The tutorial of the layers is run: a session with a python-snap7 server on this machine."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

DOCUMENT = Path(__file__).resolve().parent.parent.parent / "docs" / "layers-tutorial.md"


def test_the_session_goes_as_it_stands_there() -> None:
    blocks = re.findall(r"^```python\n(.*?)^```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    examples = doctest.DocTestParser().get_doctest("\n".join(blocks), {}, DOCUMENT.name, str(DOCUMENT), 0)
    assert len(examples.examples) > 40
    told: list[str] = []
    try:
        failed = doctest.DocTestRunner(verbose=False).run(examples, out=told.append, clear_globs=False).failed
    finally:
        for name, close in (("stream", "close"), ("plc", "stop")):  # a session that failed is closed too
            if name in examples.globs:
                getattr(examples.globs[name], close)()
    assert failed == 0, "".join(told)
