"""The STIX bundle, read by the library of OASIS."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Any, Final

import pytest
import stix2

from dissect import analyze
from dissect.files.session import Run
from dissect.output.export.forms import ExportRequest
from dissect.output.export.stix import stix_export
from tests.cli.support import run
from tests.meaning.report.support import ROOT
from tests.promises import hostile

TRANSFER: Final = ROOT / "captures" / "transfer.pcapng"


def bundle(path: Path, out: Path) -> Any:
    export = stix_export(ExportRequest(out, False, [], [str(path)], "0"))
    reading = Run([path], export.observer)
    export.begin(reading)
    while reading.step():
        pass
    export.close()
    return stix2.parse(out.read_text(encoding="ascii"))


def test_a_bundle_is_what_the_standard_says(tmp_path: Path) -> None:
    found, analysis = bundle(TRANSFER, tmp_path / "a.stix"), analyze(TRANSFER)
    kinds = Counter(one.type for one in found.objects)
    assert kinds["note"] == kinds["observed-data"] == len(analysis.findings)
    assert kinds["sighting"] == sum(len(finding.rule.techniques) for finding in analysis.findings)
    ids = {one.id for one in found.objects}
    assert len(ids) == len(found.objects)
    for one in found.objects:
        for name in ("sighting_of_ref", "created_by_ref", "src_ref", "dst_ref"):
            assert one.get(name) is None or one[name] in ids
        for name in ("object_refs", "observed_data_refs", "where_sighted_refs"):
            assert set(one.get(name, ())) <= ids
    patterns = [one for one in found.objects if one.type == "attack-pattern"]
    assert {one.external_references[0].external_id for one in patterns} == {
        technique.v18 for finding in analysis.findings for technique in finding.rule.techniques
    }
    download = next(one for one in patterns if one.external_references[0].external_id == "T0843")
    assert download.id == "attack-pattern--be69c571-d746-4b1f-bdd0-c0c9817e9068"  # MITRE's own
    assert [phase.phase_name for phase in download.kill_chain_phases] == ["lateral-movement"]
    note = next(one for one in found.objects if one.type == "note")
    assert "Community ID 1:" in note.content
    assert "transfer.pcapng" in note.content
    assert (tmp_path / "a.stix").read_bytes() == again(TRANSFER, tmp_path / "b.stix")


def again(path: Path, out: Path) -> bytes:
    bundle(path, out)
    return out.read_bytes()


def test_ids_of_observables_are_those_of_the_standard(tmp_path: Path) -> None:
    found = bundle(TRANSFER, tmp_path / "a.stix")
    for one in found.objects:
        if one.type == "ipv4-addr":
            assert one.id == stix2.IPv4Address(value=one.value).id
        if one.type == "network-traffic":
            names = ("start", "src_ref", "dst_ref", "src_port", "dst_port", "protocols")
            assert one.id == stix2.NetworkTraffic(**{name: one[name] for name in names}).id


def test_naughty_strings_and_a_capture_without_findings(
    capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path
) -> None:
    found = bundle(hostile.write(tmp_path / "hostile.pcapng"), tmp_path / "a.stix")
    assert len(found.objects) > 100
    empty = tmp_path / "empty.pcap"
    empty.write_bytes(bytes.fromhex("d4c3b2a1020004000000000000000000ffff000001000000"))
    ran = run(capfdbinary, "export", empty, "-o", tmp_path / "b.stix")
    assert ran.code == 0
    assert json.loads((tmp_path / "b.stix").read_text(encoding="ascii")).keys() == {"type", "id"}  # it needs no objects


def test_the_command(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    out = tmp_path / "findings.stix.json"
    ran = run(capfdbinary, "export", TRANSFER, "-o", out)
    assert (ran.code, f"{len(analyze(TRANSFER).findings)} findings, " in ran.err) == (0, True), ran.err
    assert stix2.parse(out.read_text(encoding="ascii")).type == "bundle"
