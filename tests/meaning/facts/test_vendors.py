"""Vendors of network cards: what Wireshark's list says."""

from __future__ import annotations

import sys

import pytest

from dissect.meaning.facts import vendors
from dissect.meaning.facts.vendors import LOCALLY_ADMINISTERED, vendor
from tests.meaning.report.schemas import ROOT


@pytest.mark.parametrize(
    ("mac", "name"),
    [
        ("00:1b:1b:01:02:03", "Siemens AG"),
        ("00:0e:8c:01:02:03", "Siemens AG"),
        ("00:0c:29:c1:49:92", "VMware, Inc."),
        ("02:00:00:00:00:02", LOCALLY_ADMINISTERED),
        ("f0:f0:f0:f0:f0:f0", ""),
    ],
)
def test_a_card_has_a_vendor(mac: str, name: str) -> None:
    assert vendor(mac) == name


def test_a_prefix_of_28_or_36_bits_is_the_vendors_own() -> None:
    from scapy.libs.manuf import DATA

    line = next(line for line in DATA.splitlines() if "/36" in line.split("\t")[0])
    prefix, short, long = line.split("\t")
    assert vendor(prefix.partition("/")[0].strip().lower()) == (long.strip(" ,") or short.strip(" ,"))


def test_few_prefixes_are_searched_and_many_looked_up_with_the_same_result() -> None:
    """A capture of a few stations makes no dictionary of the list's 50,000 lines."""
    from scapy.libs.manuf import DATA

    prefixes = [line.split("\t")[0].partition("/")[0].replace(":", "").strip() for line in DATA.splitlines()[::997]]
    macs = [f"{prefix}{'5a' * 6}"[:12].lower() for prefix in [*prefixes, "02aabb", "f0f0f0"]]
    macs = [":".join([mac[at : at + 2] for at in range(0, 12, 2)]) for mac in macs]
    for cached in (vendors._name, vendors._names):
        cached.cache_clear()
    few = []
    for mac in macs:
        vendors._name.cache_clear()
        few.append(vendor(mac))
    assert vendors._names.cache_info().misses == 0
    for number in range(vendors._MANY + 1):
        vendors._name(f"{number:06X}")
    assert [vendor(mac) for mac in macs] == few
    assert vendors._names.cache_info().misses == 1


def test_the_list_is_read_by_no_other_command() -> None:
    import subprocess

    program = (
        "import sys\nfrom dissect.cli.main import main\n"
        f"try:\n    main(['analyze', {str(ROOT / 'captures' / 'szl.pcapng')!r}])\n"
        "except SystemExit:\n    pass\n"
        "print([name for name in sys.modules if name.startswith(('scapy', 'dissect.meaning.inventory'))])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.splitlines()[-1] == "[]"
