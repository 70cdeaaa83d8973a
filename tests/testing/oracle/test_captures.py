"""The oracle over every capture there is: no difference that the table of known ones does not explain."""

from __future__ import annotations

import re
import subprocess
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Final

import pytest

from dissect.testing.oracle.compare import Comparison, FieldDifference, compare
from dissect.testing.oracle.facts import PDU, TPDU
from dissect.testing.oracle.ours import NO_DISSECTOR
from dissect.testing.oracle.pyshark_reader import read_pyshark
from dissect.testing.oracle.tshark import read_tshark
from dissect.testing.oracle.uncarried import REASONS, as_markdown, without_reason
from tests.cases import each
from tests.tshark import SMALL, read_shared

ROOT: Final = Path(__file__).resolve().parents[3]
#: The public captures, with the S7 PDUs in each by their own count.
PUBLIC: Final = {
    "cotp_unknown_payload_rst.pcapng": 0,
    "mms_header_in_own_segment.pcap": 0,
    "mms_one_sided_read_request.pcap": 0,
    "plc4x_manual_test_tpdu_nr.pcapng": 242,
    "rdp-proprietary-encryption.pcap": 0,
    "s7comm_and_s7commplus_sll.pcap": 34,
    "s7comm_clean.pcap": 5274,
    "s7comm_downloading_block_db1.pcap": 48,
    "s7comm_reading_plc_status.pcap": 144,
    "s7comm_reading_setting_plc_time.pcap": 26,
    "s7comm_varservice_libnodavedemo.pcap": 16,
    "s7commplus_1511_opc_all_types.pcap": 0,
    "s7ident_refused_upload.pcap": 22,
    "scanner_two_connections.pcap": 8,
    "step7_s300_AuthPassword.pcapng": 6,
    "step7_s300_rwVarTab.pcapng": 16,
    "step7_s300_stop.pcapng": 4,
    "tia_s300_goOnline.pcapng": 448,
    "water_pump_hmi.pcapng": 18,
    "wincc_s300_setup-alarm-read-write.pcapng": 164,
}
OWN: Final = sorted(path.name for path in (ROOT / "captures").glob("*.pcapng"))
CRAFTED: Final = sorted(path.name for path in (ROOT / "captures" / "crafted").glob("*.pc*"))
#: Captures cut off in the middle, which tshark gives up on.
CUT_OFF: Final = [name for name in CRAFTED if name.startswith("cut-")]
#: PDUs that Wireshark cannot be asked about, by the reason; none elsewhere.
NOT_COMPARABLE: Final = {"netlink.pcapng": {NO_DISSECTOR: 9}, "netlink-faults.pcapng": {NO_DISSECTOR: 19}}
#: Wireshark numbers custom blocks as if they were packets, so that packet numbers differ from there on.
NUMBERED_OTHERWISE: Final = frozenset(("sections.pcapng",))


@cache
def explained(path: Path, reorder: bool = False) -> Comparison:
    """Compare, and fail on every difference that nothing explains."""
    # Of the repository's captures other tests want to know the same; the largest public ones are read as the product does.
    small = path.is_relative_to(ROOT) or path.stat().st_size < SMALL
    reader = read_shared if small and not reorder else read_tshark
    comparison = compare(str(path), reader, reorder=reorder)
    assert comparison.unexplained == []
    return comparison


@each("name", PUBLIC)
def test_public_capture(corpus: Path, name: str) -> None:
    comparison = explained(corpus / name)
    lost = sum(d.kind == PDU and d.known == "lost-by-tcp" for d in comparison.differences)
    assert comparison.compared[PDU] + lost == PUBLIC[name]
    assert comparison.compared[TPDU] > 0


def test_no_public_capture_is_left_out(corpus: Path) -> None:
    assert {path.name for path in corpus.glob("*.pcap*")} == PUBLIC.keys()


def test_what_tshark_takes_for_retransmissions_it_finds_itself_when_told_to_reorder(corpus: Path) -> None:
    in_order = explained(corpus / "s7comm_clean.pcap", reorder=True)
    assert in_order.compared[PDU] == PUBLIC["s7comm_clean.pcap"]
    assert set(in_order.known) == {"length-in-octets"}, "none is lost by TCP"


@each("name", OWN)
def test_own_capture(name: str) -> None:
    comparison = explained(ROOT / "captures" / name)
    assert comparison.compared[PDU] > 0 or name == "refused-port.pcapng"


@each("name", [name for name in CRAFTED if name not in {*CUT_OFF, *NUMBERED_OTHERWISE}])
def test_crafted_capture(name: str) -> None:
    comparison = explained(ROOT / "captures" / "crafted" / name)
    assert comparison.differences is not None
    assert comparison.not_comparable == NOT_COMPARABLE.get(name, {})


def test_what_wireshark_shows_besides_is_told(corpus: Path) -> None:
    """Every field it shows in a body is compared, or the page has it, with the reason."""
    paths = [corpus / name for name in PUBLIC]
    paths += [ROOT / "captures" / name for name in OWN]
    paths += [ROOT / "captures" / "crafted" / name for name in CRAFTED if name not in {*CUT_OFF, *NUMBERED_OTHERWISE}]
    comparisons = [explained(path) for path in paths]
    other = sum((comparison.other for comparison in comparisons), Counter[str]())
    again = sum((comparison.again for comparison in comparisons), Counter[str]())
    assert without_reason(other, again) == []
    assert as_markdown(other, again) in (ROOT / "docs" / "oracle.md").read_text(encoding="utf-8"), (
        "run `python scripts/oracle_doc.py FOLDER` with the folder of the public captures"
    )
    assert [pattern for pattern, _ in REASONS if not any(re.fullmatch(pattern, name) for name in other)] == []


@pytest.mark.parametrize("name", CUT_OFF)
def test_cut_off_capture(name: str) -> None:
    comparison = compare(str(ROOT / "captures" / "crafted" / name))
    assert "cut off" in comparison.loss or "corrupt" in comparison.loss
    assert sum(comparison.compared.values()) > 0
    assert comparison.unexplained == []


def test_own_captures_through_pyshark(tmp_path: Path) -> None:
    names = ["batched", "item-errors", "blocks", "slivers", "two-clients"]
    same_by_both_ways([ROOT / "captures" / f"{name}.pcapng" for name in names], tmp_path)


def test_public_captures_through_pyshark(corpus: Path, tmp_path: Path) -> None:
    names = ["step7_s300_stop.pcapng", "s7comm_downloading_block_db1.pcap"]
    same_by_both_ways([corpus / name for name in names], tmp_path)


def same_by_both_ways(paths: list[Path], folder: Path) -> None:
    """Compare captures that have no ends in common, joined into one, with what each of them gives alone."""
    joined = str(folder / "joined.pcapng")
    subprocess.run(["mergecap", "-a", "-w", joined, *paths], check=True)
    direct = compare(joined, read_tshark)
    assert direct.unexplained == []
    alone = [explained(path) for path in paths]
    # Packets have other numbers there, and nothing else differs.
    assert [without_frame(one) for one in direct.differences] == [
        without_frame(one) for comparison in alone for one in comparison.differences
    ]
    assert direct.fields == sum(comparison.fields for comparison in alone) > 0
    other = compare(joined, read_pyshark)
    assert other.unexplained == []
    assert other.compared == direct.compared
    assert other.fields == direct.fields
    assert other.known == direct.known


def without_frame(difference: FieldDifference) -> str:
    return re.sub(r"^frame \d+ ", "", str(difference))
