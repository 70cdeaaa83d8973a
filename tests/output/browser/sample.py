"""Compare the page with the command line on a folder of captures: ``python -m tests.output.browser.sample FOLDER``."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Final

from tests.output.browser.support import NOWHERE, Opened, make_page
from tests.output.browser.test_page import here
from tests.output.page.browser import start_chromium

#: The outputs that are compared for each capture, and the number of captures in the page at a time.
FORMS: Final = (
    ["analyze", "-T", "json"],
    ["transactions", "-T", "jsonl"],
    ["devices", "-T", "json"],
    ["values", "-T", "csv"],
)
AT_ONCE: Final = 20
#: Larger ones would take minutes each.
LARGEST: Final = 20_000_000


def main(folder: Path) -> int:
    """Print the differences; return the number of command lines with differences."""
    sys.modules["cryptography"] = None  # type: ignore[assignment]  # the page has none
    found = {
        path.name: path for path in sorted(folder.rglob("*")) if path.suffix in {".pcap", ".pcapng", ".cap", ".gz"}
    }
    files = [path for path in found.values() if 0 < path.stat().st_size <= LARGEST]
    different = 0
    driver = start_chromium(NOWHERE)
    try:
        with tempfile.TemporaryDirectory() as made:
            opened = Opened(driver, make_page(Path(made)))
            opened.open()
            for begin in range(0, len(files), AT_ONCE):
                part = files[begin : begin + AT_ONCE]
                opened.choose(*part)
                lines = [(path, [*form, path.name]) for path in part for form in FORMS]
                told = opened.run([line for _, line in lines])
                for (path, line), one in zip(lines, told, strict=True):
                    if one != here(path.parent, line):
                        different += 1
                        print("different:", path, " ".join(line))
    finally:
        driver.quit()
    print(f"{len(files)} captures, {len(files) * len(FORMS)} command lines, {different} different")
    return different


if __name__ == "__main__":
    sys.exit(bool(main(Path(sys.argv[1]))))
