"""Logs of Zeek: what ICSNPP writes of the two shared captures that its own tests read, row by row, and how files are framed.

Upstream's expected logs are not here; what these tests hold was compared with them when they were written (revision 858c0b7).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import pytest

from dissect.files.session import Run
from dissect.output.export.forms import ExportRequest
from dissect.output.export.zeek.columns import LOGS, columns_of
from dissect.output.export.zeek.export import json_export, tsv_export
from dissect.output.export.zeek.log import Log
from dissect.output.export.zeek.rows import S7, cotp_row, identification
from tests.build import payload, userdata_head
from tests.cli.support import run
from tests.meaning.report.support import ROOT, WORD, begun, read, saved
from tests.promises import hostile
from tests.properties import messages
from tests.properties.messages import dt

Capture = pytest.CaptureFixture[bytes]
TRANSFER: Final = ROOT / "captures" / "transfer.pcapng"
OK: Final = ("No error", "0x00")
UNSET: Final = ("-", "-")
#: Logs that ICSNPP does not have.
OWN: Final = frozenset(("s7comm_transaction", "s7comm_act", "s7comm_finding_count"))


def logs(path: Path, folder: Path, *, strict: bool = False, as_json: bool = False) -> dict[str, list[dict[str, Any]]]:
    """Return the rows of each log that is written of a capture."""
    folder.mkdir(exist_ok=True)
    make = json_export if as_json else tsv_export
    export = make(ExportRequest(folder, True, [], [str(path)], "0", {"strict": strict}))
    reading = Run([path], export.observer)
    export.begin(reading)
    while reading.step():
        pass
    export.close()
    return {file.stem: rows(file) for file in folder.glob("*.log")}


def rows(file: Path) -> list[dict[str, Any]]:
    lines = file.read_text(encoding="utf-8").split("\n")
    assert lines.pop() == ""
    if not lines[0].startswith("#"):
        return [json.loads(line) for line in lines]
    assert lines[0] == "#separator \\x09"
    assert lines[4] == f"#path\t{file.stem}"
    names = lines[6].split("\t")
    kinds = lines[7].split("\t")
    assert (names[0], kinds[0]) == ("#fields", "#types")
    assert list(zip(names[1:], kinds[1:], strict=True)) == list(columns_of(file.stem))
    assert lines[-1].startswith("#close\t")
    return [dict(zip(names[1:], line.split("\t"), strict=True)) for line in lines[8:-1]]


def picked(rows_: list[dict[str, Any]], *names: str) -> list[tuple[Any, ...]]:
    return [tuple(row[name] for name in names) for row in rows_]


def test_identification_and_refused_uploads(corpus: Path, tmp_path: Path) -> None:
    found = logs(corpus / "s7ident_refused_upload.pcap", tmp_path / "logs", strict=True)
    ours = {name: len(of) for name, of in found.items()}
    assert (ours["cotp"], ours["s7comm"], ours["s7comm_known_devices"]) == (24, 18, 1)
    assert picked(found["cotp"], "is_orig", "pdu_code", "pdu_name") == [
        ("T", "0x0e", "CR Connection Request"),
        ("F", "0x0d", "CC Connection Confirm"),
        *[(side, "0x0f", "DT Data") for _ in range(11) for side in "TF"],
    ]
    wanted: list[tuple[str, ...]] = []
    for side, kind, error in (("T", ("1", "Job-Request"), UNSET), ("F", ("3", "ACK-Data"), OK)):
        wanted.append((side, *kind, "0", "0xf0", "Setup Communication", *UNSET, *error))
    for number in "12345":
        szl = ("0x01", "Read SZL")
        wanted.append(("T", "7", "User-Data", number, "0x44", "Request: CPU Functions", *szl, *UNSET))
        wanted.append(("F", "7", "User-Data", number, "0x84", "Response: CPU Functions", *szl, *OK))
    wanted += [("T", "1", "Job-Request", number, "0x1d", "Start Upload", *UNSET, *UNSET) for number in "6789"]
    wanted.append(("T", "1", "Job-Request", "10", "0x04", "Read Variable", *UNSET, *UNSET))
    wanted.append(("F", "3", "ACK-Data", "10", "0x04", "Read Variable", *UNSET, *OK))
    own = [name for name, _ in LOGS["s7comm"]]
    assert picked(found["s7comm"], "is_orig", *own) == wanted
    for row in found["s7comm"]:
        ends = ("172.17.0.2", "33028"), ("172.17.0.2", "102")
        assert (row["id.orig_h"], row["id.orig_p"], row["id.resp_h"], row["id.resp_p"]) == (*ends[0], *ends[1])
        source, target = ends if row["is_orig"] == "T" else ends[::-1]
        assert (row["source_h"], row["source_p"], row["destination_h"], row["destination_p"]) == (*source, *target)
    (device,) = found["s7comm_known_devices"]
    assert [device[name] for name, _ in LOGS["s7comm_known_devices"]] == [
        "SNAP7-SERVER",
        "CPU 315-2 PN/DP",
        "(empty)",
        "S C-C2UR28922012",
    ]
    assert {device[name] for name in ("is_orig", "source_h", "source_p", "destination_h", "destination_p")} == {"-"}
    assert len({row["uid"] for of in found.values() for row in of if "uid" in row}) == 1


def test_by_default_the_refusals_are_there(corpus: Path, tmp_path: Path) -> None:
    found = logs(corpus / "s7ident_refused_upload.pcap", tmp_path / "logs")
    assert len(found["s7comm"]) == 22
    refusals = [row for row in found["s7comm"] if row["rosctr_code"] == "2"]
    assert [row["pdu_reference"] for row in refusals] == ["6", "7", "8", "9"]
    assert {row["rosctr_name"] for row in refusals} == {"ACK"}
    assert {row["function_code"] for row in refusals} == {"-"}
    assert "-" not in {row["error_code"] for row in refusals}


def test_both_protocols_in_a_cooked_capture(corpus: Path, tmp_path: Path) -> None:
    found = logs(corpus / "s7comm_and_s7commplus_sll.pcap", tmp_path / "logs", strict=True)
    assert {name: len(of) for name, of in found.items() if name not in OWN} == {
        "cotp": 157,
        "s7comm": 34,
        "s7comm_plus": 121,
    }
    words = {"N": ("0x33", "Notification", *UNSET)}
    for letter, code, name in (("S", "0x04f2", "Set Variable"), ("G", "0x054c", "Get Multi Variables")):
        words[letter] = ("0x31", "Request", code, name)
    words["M"] = ("0x31", "Request", "0x0542", "Set Multi Variables")
    words["g"] = ("0x32", "Response", "0x054c", "Get Multi Variables")
    words["m"] = ("0x32", "Response", "0x0542", "Set Multi Variables")
    order = 5 * "NNNSNNNSNNNSNNGgNS" + "NNMmNSNNNSNNNSNNNSNGgNMmNSNNNSN"
    own = [name for name, _ in LOGS["s7comm_plus"]]
    seen = picked(found["s7comm_plus"], *own)
    letters = {word: letter for letter, word in words.items()}
    assert "".join([letters[word[1:]] for word in seen]) == order
    assert {word[0] for word in seen} == {"3"}
    # Notifications and responses come from the PLC, requests from the client, also of a connection seen from its middle.
    for row, letter in zip(found["s7comm_plus"], order, strict=True):
        assert (row["id.orig_h"], row["id.orig_p"], row["id.resp_h"]) == ("192.168.0.3", "49154", "192.168.0.1")
        assert row["is_orig"] == ("F" if letter in "Ngm" else "T")
        assert row["source_h"] == ("192.168.0.1" if letter in "Ngm" else "192.168.0.3")
    jobs: list[tuple[str, ...]] = []
    for number in range(17):
        function = ("0xf0", "Setup Communication") if not number else ("0x04", "Read Variable")
        if number and number % 2 == 0:
            function = ("0x05", "Write Variable")
        jobs.append(("T", "1", "Job-Request", str(number), *function, *UNSET, *UNSET))
        jobs.append(("F", "3", "ACK-Data", str(number), *function, *UNSET, *OK))
    assert picked(found["s7comm"], "is_orig", *[name for name, _ in LOGS["s7comm"]]) == jobs
    codes = picked(found["cotp"], "pdu_code", "pdu_name")
    assert codes.count(("0x0f", "DT Data")) == 155
    at = codes.index(("0x0e", "CR Connection Request"))
    assert codes[at + 1] == ("0x0d", "CC Connection Confirm")
    assert {row["id.orig_p"] for row in found["cotp"][:at]} == {"49154"}
    assert len({row["uid"] for row in found["cotp"]}) == 2


def test_uploads_and_downloads(tmp_path: Path) -> None:
    found = logs(TRANSFER, tmp_path / "logs")["s7comm_upload_download"]
    names = [name for name, _ in LOGS["s7comm_upload_download"] if name != "pdu_reference"]
    assert picked(found, *names)[:4] == [
        ("Job-Request", "Start Upload", "0x00", "0", "-", "_0A00010A", "Data Block", "00010", "Active"),
        ("ACK-Data", "Start Upload", "0x00", "1", "-", *4 * "-"),  # this server says that its length has no digits
        ("Job-Request", "Upload", "0x00", "1", "-", *4 * "-"),
        ("ACK-Data", "Upload", "0x00", "-", "100", *4 * "-"),
    ]
    downloads = {row["filename"] for row in found if row["function_name"] == "Request Download"}
    assert "_0A00010P" in downloads
    assert {row["destination_filesystem"] for row in found} >= {"Active", "Passive"}


def test_errors_services_and_references() -> None:
    job = S7(bytes.fromhex("32 01 0000 0100 0012 0000 28 00000000 0000 fd 0000 09") + b"P_PROGRAM")
    assert job.row() == (1, "Job-Request", 1, "0x28", "PLC Control", "P_PROGRAM", "PLC Start / Stop", None, None)
    refused = S7(bytes.fromhex("32 02 0000 0007 0000 0000 81 04"))
    assert refused.row() == (2, "ACK", 0x700, None, None, None, None, "Application relationship error", "0x04")
    userdata = S7(bytes.fromhex("32 07 0000 0001 000c 0004 000112 08 12 84 01 01 00 00 d209 0a000000"))
    assert userdata.row()[3:] == (
        "0x84",
        "Response: CPU Functions",
        "0x01",
        "Read SZL",
        "Parameter Error",
        "0xd209",
    )
    assert userdata.szl_row() == (256, "Response", None, None, None, "0x0a", "Object does not exist")
    assert not userdata.szl_bounded(True)
    odd = S7(bytes.fromhex("32 09 0000 0001 0001 0000 99"))
    assert odd.row()[:5] == (9, "unknown", 256, "0x99", "unknown")
    assert S7(b"\x32").row()[:3] == (None, "unknown", None)
    assert cotp_row(bytes.fromhex("03000007 02 90 80")) == ("0x09", "Unknown COTP PDU-0x09")
    assert cotp_row(b"\x03\x00\x00\x04") is None
    assert identification(bytes.fromhex("001c 0000 0022 0001 0001") + b"PLC".ljust(32, b"\0")) == {1: "PLC"}
    assert identification(bytes.fromhex("001c 0000 0022 ffff 0001")) == {}


def test_values_as_zeek_writes_them(tmp_path: Path) -> None:
    for as_json in (False, True):
        log = Log(tmp_path, "s7comm_known_devices", as_json)
        head = (1_500_000_000_123_456_789, "C1", "fe80::1", 1024, "fe80::2", 102, True, "fe80::1", 1, "fe80::2", 2)
        log.add((*head, "-", "", "a\tb\\", None))
        log.add((*head, "(empty)", "\udcff\udcfe", "Pumpe ü", "\x1b[31m"))
        log.close()
        assert log.rows == 2
        first, second = rows(tmp_path / "s7comm_known_devices.log")
        keys = [name for name, _ in LOGS["s7comm_known_devices"]]
        if as_json:
            assert [first.get(key) for key in keys] == ["-", "", "a\tb\\", None]
            assert "module_serial" not in first
            assert (first["ts"], first["is_orig"], first["id.orig_p"]) == (1500000000.123456, True, 1024)
            assert [second[key] for key in keys] == ["(empty)", "\\xff\\xfe", "Pumpe ü", "\x1b[31m"]
        else:
            assert [first[key] for key in keys] == ["\\x2d", "(empty)", "a\\x09b\\\\", "-"]
            assert (first["ts"], first["is_orig"]) == ("1500000000.123456", "T")
            assert [second[key] for key in keys] == ["\\x28empty)", "\\xff\\xfe", "Pumpe ü", "\\x1b[31m"]


def test_transactions_have_a_log_of_their_own(tmp_path: Path) -> None:
    found = logs(TRANSFER, tmp_path / "tsv")
    again = logs(TRANSFER, tmp_path / "json", as_json=True)
    assert {name: len(of) for name, of in found.items()} == {name: len(of) for name, of in again.items()}
    first = again["s7comm_transaction"][0]
    assert (first["function_code"], first["function_name"], first["outcome"]) == (
        "0xf0",
        "Setup communication",
        "answered",
    )
    assert first["community_id"].startswith("1:")
    assert 0 < first["latency"] < 1
    assert "reason" not in first
    refused = [row for row in again["s7comm_transaction"] if row["failed"]]
    assert refused
    assert all(row["errors"] for row in refused)
    assert [row["uid"] for row in found["s7comm"]] == [row["uid"] for row in again["s7comm"]]


def test_an_answer_in_parts_has_one_row_and_its_device(tmp_path: Path) -> None:
    record = bytes.fromhex("0001") + b"PLC_1".ljust(32, b"\0")
    whole = bytes.fromhex("001c 0000 0022 0002") + record + bytes.fromhex("0002") + b"CPU".ljust(32, b"\0")
    talk = begun()
    heads = [
        userdata_head(1, 4, 1),
        userdata_head(2, 4, 1, 7, 7, 1),
        userdata_head(1, 4, 1, 7, 7),
        userdata_head(2, 4, 1, 7, 7),
    ]
    for number, (head, content) in enumerate(
        zip(heads, (b"\x00\x1c\x00\x00", whole[:40], b"", whole[40:]), strict=True)
    ):
        talk.send(number % 2, dt(messages.pdu(messages.USERDATA, 5 + number // 2, head, payload(content))))
    found = logs(saved(tmp_path / "parts.pcapng", talk.packets()), tmp_path / "logs")
    answers = [row for row in found["s7comm_read_szl"] if row["method"] == "Response"]
    assert [row["szl_id"] for row in answers] == ["0x001c"]
    (device,) = found["s7comm_known_devices"]
    assert (device["automation_system_name"], device["module_name"]) == ("PLC_1", "CPU")


def test_naughty_strings_keep_rows_and_columns_apart(tmp_path: Path) -> None:
    path = hostile.write(tmp_path / "hostile.pcapng")
    found = logs(path, tmp_path / "tsv")  # `rows` reads each line by its tabs
    again = logs(path, tmp_path / "json", as_json=True)
    assert {name: len(of) for name, of in found.items()} == {name: len(of) for name, of in again.items()}
    assert len({row["filename"] for row in found["s7comm_upload_download"]}) > 180
    for file in (tmp_path / "tsv").iterdir():
        assert not set(file.read_bytes()) & {*range(9), 11, 12, *range(13, 32), 127}


def test_the_command_writes_logs(capfdbinary: Capture, tmp_path: Path) -> None:
    out = tmp_path / "logs"
    ran = run(capfdbinary, "export", TRANSFER, "-o", f"zeek-json:{out}", "--only", "s7comm", "--only", "cotp")
    assert (ran.code, sorted(path.name for path in out.iterdir())) == (0, ["cotp.log", "s7comm.log", "s7dissect.json"])
    ran = run(capfdbinary, "export", TRANSFER, "-o", f"zeek:{tmp_path / 'x'}", "--only", "s7com")
    assert (ran.code, "Did you mean s7comm" in ran.err) == (2, True)
    ran = run(capfdbinary, "export", TRANSFER, "-o", tmp_path / "x.csv", "--zeek-compat", "strict")
    assert (ran.code, "--zeek-compat needs" in ran.err) == (2, True)


def test_acts_and_the_facts_of_findings(tmp_path: Path) -> None:
    for as_json in (False, True):
        found = logs(ROOT / "captures/crafted/plus-plant.pcapng", tmp_path / str(as_json), as_json=as_json)
        acts = found["s7comm_act"]
        assert picked(acts, "kind", "outcome", "slug", "source_h") == [
            ("stop", "accepted", "security.plc_stop", "192.0.2.10"),
            ("start", "accepted", "security.plc_start", "192.0.2.10"),
            ("download", "accepted", "security.program_change", "192.0.2.10"),
        ]
        assert [str(row["transactions"]) for row in acts] == (
            ["[17]", "[20]", "[19]"] if as_json else ["17", "20", "19"]
        )
        counts = {row["slug"]: row for row in found["s7comm_finding_count"] if row["scope"] == "pair"}
        stop = counts["security.plc_stop"]
        assert (stop["client_h"], stop["server_h"], str(stop["events"]), str(stop["first_frame"])) == (
            ("192.0.2.10", "192.0.2.20", "1", "37")
        )
        assert "uid" not in stop


def test_refusals_are_counted_beyond_those_in_detail(tmp_path: Path) -> None:
    talk = begun()
    for number in range(1300):
        read(talk, number + 1, WORD, 0x0A)
    found = logs(saved(tmp_path / "a.pcapng", talk.packets()), tmp_path / "logs")
    rule = next(row for row in found["s7comm_finding_count"] if row["slug"] == "transaction.item_error")
    assert (rule["scope"], rule["events"], rule["client_h"]) == ("rule", "1300", "-")
