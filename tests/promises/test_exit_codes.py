"""Promise G18: one case for each exit code that a command says it has."""

from __future__ import annotations

import ast
import re
import shutil
from pathlib import Path
from typing import Final

import pytest

from tests.cli.support import simple
from tests.cli.test_conventions import WRITING, calls
from tests.cli.test_outputs import commands
from tests.meaning.report.schemas import ROOT
from tests.meaning.report.support import begun, read, saved
from tests.promises.nursery import Nursery

#: A call for each code, with files by name: GOOD holds reads, one of them refused; CUT ends within a packet; OTHER says
#: something else; MISSING is none; OUT is to be made.
CASES: Final = """
0 analyze GOOD
1 analyze GOOD --fail-on warning
2 analyze MISSING
3 analyze CUT
0 transactions GOOD
1 transactions GOOD --fail-on transaction.item_error
2 transactions GOOD -T xml
3 transactions CUT
0 values GOOD
1 values GOOD --fail-on transaction.item_error
2 values GOOD Nonsense
3 values CUT
0 operations GOOD
1 operations GOOD --fail-on note
2 operations MISSING
3 operations CUT
0 report GOOD -o OUT
2 report MISSING -o OUT
3 report CUT -o OUT
0 blocks GOOD
1 blocks --diff BLOCKS GOOD
2 blocks MISSING
3 blocks CUT
0 devices GOOD
1 devices GOOD --fail-on note
2 devices MISSING
3 devices CUT
0 show GOOD
1 show GOOD --fail-on note
2 show MISSING
3 show CUT
0 cut GOOD -o OUT
2 cut GOOD -o OUT --connection 77
3 cut CUT -o OUT
2 open MISSING -o OUT
0 extcap --extcap-interfaces
2 extcap
3 extcap --capture --extcap-interface s7dissect-file --file CUT --fifo OUT
0 anonymize GOOD -o OUT
2 anonymize MISSING -o OUT
3 anonymize CUT -o OUT
0 baseline GOOD
1 baseline OTHER --against LEARNED
2 baseline MISSING
3 baseline CUT
0 completion zsh
2 completion sh
2 browser --verify MISSING
0 help live
2 help nonsense
0 export GOOD -o csv:OUT
2 export GOOD -o OUT
3 export CUT -o sqlite:OUT
0 sql periods GOOD
2 sql SELEKT GOOD
3 sql refused CUT
0 golden GOOD
2 golden MISSING
3 golden CUT
0 diff GOOD GOOD
1 diff GOOD OTHER
2 diff GOOD CUT
0 monitor GOOD
1 monitor GOOD --fail-on warning
2 monitor MISSING
3 monitor CUT
0 index FOLDER
2 index MISSING
3 index BROKENFOLDER
0 interfaces
2 interfaces -T xml
2 cluster-check nowhere
0 replay GOOD --dry-run
2 replay GOOD
0 scd compile PLANT -o OUT
2 scd compile GOOD -o OUT
0 scd dump PLANT
2 scd dump GOOD
0 scd check PLANT
1 scd check BROKEN
2 scd check MISSING
0 scd diff PLANT PLANT
1 scd diff PLANT RENAMED
2 scd diff PLANT MISSING
0 scd decode -d PLANT --pdo T2 C1AB24FA
2 scd decode -d PLANT --pdo T2 xyz
3 scd decode -d PLANT --message DC02
0 scd encode -d PLANT --value 0x6001 raw:5
2 scd encode -d PLANT --value 0x6001 x
0 tags check TAGS
1 tags check WRONGTAGS
2 tags check MISSING
0 tags list TAGS
2 tags list WRONGTAGS
0 tags convert TAGS -o OUT
2 tags convert WRONGTAGS -o OUT
0 fields
2 fields nonsense
0 schema
2 schema nothing
"""
#: What takes a peer, tshark, or a signal in the middle of a run, and is tested where that is at hand.
ELSEWHERE: Final = {
    ("browser", "0"): "tests/output/browser/test_parts.py::test_a_page_that_was_mailed_is_recognised",
    ("browser", "1"): "tests/output/browser/test_parts.py::test_a_page_that_was_changed_is_told",
    ("browser", "5"): "tests/output/browser/test_parts.py::test_a_page_for_which_there_is_no_room_is_told",
    ("open", "0"): "tests/cli/test_open.py::test_it_goes_to_the_packet_that_matters_and_leaves_nothing",
    ("open", "3"): "tests/cli/test_open.py::test_a_damaged_capture_is_shown_as_far_as_it_goes",
    ("open", "5"): "tests/cli/test_open.py::test_a_full_disk_is_one_line_and_leaves_nothing",
    ("open", "130"): "tests/cli/test_open.py::test_an_interruption_ends_wireshark_and_leaves_nothing",
    ("index", "130"): "tests/cli/test_index.py::test_interrupted_it_keeps_what_was_read_and_goes_on_there",
    ("cluster-check", "0"): "tests/files/cluster/test_cluster.py::test_a_sound_cluster",
    ("cluster-check", "1"): "tests/files/cluster/test_cluster.py::test_a_worker_of_another_version",
    ("cluster-check", "5"): "tests/files/cluster/test_cluster.py::test_a_full_disk_is_one_line",
    ("export", "5"): "tests/cli/test_export.py::test_a_full_disk_is_one_line_and_leaves_nothing",
    ("verify", "0"): "tests/cli/test_verify.py::test_all_is_explained",
    ("verify", "1"): "tests/cli/test_verify.py::test_what_is_not_explained_is_told",
    ("verify", "2"): "tests/cli/test_verify.py::test_an_unreadable_file",
    ("verify", "3"): "tests/cli/test_verify.py::test_a_file_tshark_gives_up_on",
    ("alerts test", "0"): "tests/online/alerts/test_secrets.py::test_all_is_delivered",
    ("alerts test", "1"): "tests/online/alerts/test_secrets.py::test_every_action_is_tried",
    ("alerts test", "2"): "tests/online/alerts/test_secrets.py::test_rules_that_cannot_be_used",
    ("evidence verify", "0"): "tests/online/live/test_manifest.py::test_evidence_of_a_run_is_verified",
    ("evidence verify", "1"): "tests/online/live/test_manifest.py::test_evidence_of_a_run_is_verified",
    ("evidence verify", "2"): "tests/online/live/test_manifest.py::test_no_manifest_is_wrong_use",
    ("evidence export", "0"): "tests/files/recording/test_incident.py::test_an_incident_is_exported_and_proves_itself",
    ("evidence export", "1"): "tests/files/recording/test_incident.py::test_what_is_not_whole_is_told",
    ("evidence export", "2"): "tests/files/recording/test_incident.py::test_wrong_use_is_refused",
    ("evidence export", "130"): "tests/files/recording/test_incident.py::test_what_is_interrupted_leaves_nothing",
    ("proxy", "0"): "tests/cli/test_proxy.py::test_what_passes_is_told_and_written",
    ("proxy", "1"): "tests/cli/test_proxy.py::test_findings_fail_the_command_when_asked_to",
    ("proxy", "2"): "tests/cli/test_proxy.py::test_wrong_use_is_told",
    ("proxy", "3"): "tests/cli/test_proxy.py::test_a_dissection_that_breaks_off_does_not_stop_the_relay",
    ("proxy", "5"): "tests/cli/test_proxy.py::test_output_that_is_full_does_not_stop_the_relay_either",
    ("serve", "0"): "tests/cli/test_serve.py::test_a_session_as_it_was_recorded",
    ("serve", "1"): "tests/cli/test_serve.py::test_what_was_not_recorded_is_told_and_fails",
    ("serve", "2"): "tests/cli/test_serve.py::test_wrong_use",
    ("replay", "1"): "tests/cli/test_replay.py::test_another_answer_is_exit_code_1_and_told_in_words",
}
#: Said in docs/robustness.md: nothing here makes these happen.
UNTESTED: Final = {("serve", "3"), ("serve", "130"), ("proxy", "130"), ("verify", "5"), ("verify", "130")}
#: Calls that are interrupted when they open FILE.
INTERRUPTED: Final = """
analyze FILE
transactions FILE
values FILE
operations FILE
blocks FILE
devices FILE
show FILE
cut FILE -o OUT
anonymize FILE -o OUT
report FILE -o OUT
report --diff FILE OTHER -o OUT
baseline FILE -o OUT
export FILE -o sqlite:OUT
sql refused FILE
golden FILE -o OUT
diff FILE OTHER
diff OTHER FILE
monitor FILE
replay FILE --dry-run
"""


def listed(text: str) -> list[list[str]]:
    return [line.split() for line in text.strip().split("\n")]


def name_of(call: list[str]) -> str:
    return " ".join(call[:2]) if call[0] in {"scd", "tags", "alerts", "evidence"} else call[0]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory, nursery: Nursery) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("files")
    good = simple(folder / "good.pcapng")
    cut = folder / "cut.pcapng"
    cut.write_bytes(good.read_bytes()[:-5])
    other = saved(folder / "other.pcapng", read(begun(amq=3), 1).send(0, b"\x03\x00\x00\x04").packets())
    plant = ROOT / "captures" / "scd" / "plant.toml"
    text = plant.read_text(encoding="utf-8")
    learned, broken, renamed = folder / "learned.toml", folder / "broken.toml", folder / "renamed.toml"
    assert nursery.wait(nursery.start("baseline", ROOT / "captures" / "szl.pcapng", "-o", learned)) == 0
    first = re.search(r'^name = "(.*)"$', text, re.MULTILINE)
    assert first is not None
    renamed.write_text(text.replace(first[0], 'name = "another"', 1), encoding="utf-8")
    number = re.search(r"^index = 0x6001$", text, re.MULTILINE)
    broken.write_text(text.replace("0x6001", "0x0001") if number is None else text.replace(number[0], "index = 1"))
    for name in (good, cut):
        (folder / name.stem).mkdir()
        shutil.copy(name, folder / name.stem)
    wrong_tags = folder / "wrong.csv"
    wrong_tags.write_text("address,type,name\nDB1.DBW0,REAL,Tank.Level\n", encoding="utf-8")
    return {
        "FOLDER": folder / "good", "BROKENFOLDER": folder / "cut",
        "TAGS": ROOT / "captures" / "tags" / "valve.csv", "WRONGTAGS": wrong_tags,
        "GOOD": good, "CUT": cut, "OTHER": other, "MISSING": folder / "missing.pcapng", "LEARNED": learned,
        "PLANT": plant, "BLOCKS": ROOT / "captures" / "crafted" / "program.pcapng", "BROKEN": broken, "RENAMED": renamed,
    }  # fmt: skip


@pytest.mark.parametrize(("code", "call"), [(int(words[0]), words[1:]) for words in listed(CASES)], ids=str)
def test_each_code(nursery: Nursery, files: dict[str, Path], tmp_path: Path, code: int, call: list[str]) -> None:
    told = tmp_path / "stderr"
    words = [files.get(word) or word.replace("OUT", str(tmp_path / "out")) for word in call]
    assert nursery.wait(nursery.start(*words, stderr=told)) == code, told.read_text()
    assert "Traceback" not in told.read_text()


@pytest.mark.parametrize("call", listed(INTERRUPTED), ids=" ".join)
def test_130_when_interrupted(nursery: Nursery, files: dict[str, Path], tmp_path: Path, call: list[str]) -> None:
    """By a signal that comes when FILE is opened for the first, the second … time: nothing is written then."""
    told, out = tmp_path / "stderr", tmp_path / "out"
    words = [{**files, "FILE": files["GOOD"]}.get(word) or word.replace("OUT", str(out)) for word in call]
    code = 0
    for times in range(1, 20):
        out.unlink(missing_ok=True)
        code = nursery.wait(nursery.start(*words, stderr=told, trip=(files["GOOD"], times)))
        assert "Traceback" not in told.read_text()
        if code != 130:
            break  # it is opened less often than that
        assert list(tmp_path.glob("*out*")) == []
    assert times > 1, told.read_text()
    assert code in {0, 1}
    assert out.exists() == ("OUT" in " ".join(call))


def test_every_code_that_a_command_names_is_tested() -> None:
    tested = {(name_of(words[1:]), words[0]) for words in listed(CASES)}
    tested |= {(name_of(words), "130") for words in listed(INTERRUPTED)}
    tested |= {(name_of(words), "5") for words in calls(WRITING)}  # tests/cli/test_conventions.py: the disk is full
    assert tested.isdisjoint(UNTESTED | ELSEWHERE.keys())
    said = set()
    for name, command in commands().items():
        (told,) = [part for part in (command.epilog or "").split("\n\n") if part.startswith("Exit code:")]
        codes = re.findall(r"(?:^|[,;:] )(?:and )?(\d+) (?=[a-z-])", told)
        said |= {(name, code) for code in codes}
    assert said == tested | ELSEWHERE.keys() | UNTESTED
    for place in ELSEWHERE.values():
        path, _, name = place.partition("::")
        tree = ast.parse((ROOT / path).read_bytes())
        assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, place
