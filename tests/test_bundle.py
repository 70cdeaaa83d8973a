"""The bundle for machines without a network: what is in it is what is needed there, and nothing of it is fetched here.

What stands for the registry is a folder of small wheels. That the real one can be installed is tried by `make bundle`.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
import zipfile
from pathlib import Path
from typing import Any, Final

import pytest

from scripts import bundle, try_bundle
from scripts.bundle_readme import readme
from scripts.bundle_target import Target, closure, read_wheel

WINDOWS: Final = Target("win_amd64", "3.12")
#: Name, version and tags of a wheel, and what it needs.
MADE: Final[dict[str, list[str]]] = {
    "s7dissect-1.2-py3-none-any": [
        "Plain>=2",
        "quick; extra == 'fast'",
        "coloured; sys_platform == 'win32'",
        "forked; sys_platform != 'win32'",
        "s7dissect[fast,odd]; extra == 'all'",
        "odd; extra == 'odd'",
        "s7dissect[all,docs]; extra == 'test'",
    ],
    "plain-2.1-py3-none-any": ["old; python_version < '3.12'"],
    "plain-1.9-py3-none-any": [],
    "quick-1-cp312-cp312-win_amd64": ["quick_core[more]"],
    "quick-1-cp312-cp312-manylinux_2_17_aarch64": ["quick_core[more]"],
    "quick_core-1-cp312-cp312-win_amd64": ["further; extra == 'more'"],
    "quick_core-1-cp312-cp312-manylinux_2_17_aarch64": ["further; extra == 'more'"],
    "further-1-py3-none-any": [],
    "coloured-1-py3-none-any": [],
    "forked-1-py3-none-any": [],
    "old-1-py3-none-any": [],
    "odd-1-cp312-cp312-manylinux_2_17_aarch64": [],
}


def wheel(folder: Path, stem: str, needs: list[str]) -> Path:
    """Write a wheel that pip accepts: its metadata, and one module."""
    name, version, *tags = stem.split("-")
    info = f"{name}-{version}.dist-info"
    extras = sorted(set(re.findall(r"extra == '(\w+)'", "".join(needs))))
    files = {
        f"{name}.py": "",
        f"{info}/METADATA": "\n".join(
            [
                f"Metadata-Version: 2.4\nName: {name}\nVersion: {version}\nLicense-Expression: MIT",
                *[f"Provides-Extra: {extra}" for extra in extras],
                *[f"Requires-Dist: {need}" for need in needs],
                "",
            ]
        ),
        f"{info}/WHEEL": f"Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: {'-'.join(tags)}\n",
    }
    path = folder / f"{stem}.whl"
    with zipfile.ZipFile(path, "w") as archive:
        for file, text in files.items():
            archive.writestr(file, text)
        archive.writestr(f"{info}/RECORD", "".join(f"{file},,\n" for file in files))
    return path


@pytest.fixture
def registry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of wheels, in which pip looks and nowhere else; our own is built by copying it from there."""
    folder = tmp_path / "registry"
    folder.mkdir()
    for stem, needs in MADE.items():
        wheel(folder, stem, needs)
    for name in [name for name in os.environ if name.startswith("PIP_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))

    def build_own(into: Path) -> Path:
        return wheel(into, "s7dissect-1.2-py3-none-any", MADE["s7dissect-1.2-py3-none-any"])

    monkeypatch.setattr(bundle, "build_own", build_own)
    return folder


def names(folder: Path) -> list[str]:
    return [path.stem for path in sorted((folder / "wheels").iterdir())]


def test_what_that_system_needs_and_has_is_in_it(
    registry: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here the markers of Linux would hold: pip has to be told of Windows, or `coloured` is missing there."""
    folder = bundle.make(WINDOWS, tmp_path / "made", None)
    assert names(folder) == [
        "coloured-1-py3-none-any",
        "further-1-py3-none-any",
        "plain-2.1-py3-none-any",
        "quick-1-cp312-cp312-win_amd64",
        "quick_core-1-cp312-cp312-win_amd64",
        "s7dissect-1.2-py3-none-any",
    ]
    text = (folder / "README.txt").read_bytes()
    assert b"\r\n" in text
    assert b"\n" not in text.replace(b"\r\n", b"")
    assert b"* Left out is the extra 'odd': odd has no wheel there.\r\n" in text
    asked = (folder / "requirements.txt").read_text("ascii")
    digest = hashlib.sha256((folder / "wheels" / "s7dissect-1.2-py3-none-any.whl").read_bytes()).hexdigest()
    assert f"s7dissect[fast]==1.2 --hash=sha256:{digest}\n" in asked
    assert asked.count("--hash=sha256:") == 6
    bill(folder)
    # The command of its README.txt, as far as this system can: nothing else is there to install from.
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path))
    (tmp_path / "work").mkdir()
    try_bundle.try_there(folder, tmp_path / "work", WINDOWS)
    assert capsys.readouterr().out.endswith(
        "ok      all 6 wheels install by the rules of win_amd64-cp312; nothing was run there\n"
    )
    packed = bundle.archive(folder).read_bytes()
    (folder / "README.txt").touch()
    assert bundle.archive(folder).read_bytes() == packed


def bill(folder: Path) -> None:
    """Hold the bill of materials to the wheels of a bundle."""
    told: dict[str, Any] = json.loads((folder / "sbom.cdx.json").read_text("utf-8"))
    assert (told["bomFormat"], told["specVersion"]) == ("CycloneDX", "1.6")
    own = told["metadata"]["component"]
    assert (own["name"], own["version"], own["type"]) == ("s7dissect", "1.2", "application")
    hashes = {entry["name"]: entry["hashes"] for entry in [own, *told["components"]]}
    assert hashes == {
        read_wheel(path).name: [{"alg": "SHA-256", "content": hashlib.sha256(path.read_bytes()).hexdigest()}]
        for path in (folder / "wheels").iterdir()
    }
    assert {entry["licenses"][0]["license"]["id"] for entry in told["components"]} == {"MIT"}
    needs = {entry["ref"].partition("?")[0]: entry.get("dependsOn", []) for entry in told["dependencies"]}
    assert [one.partition("@")[0] for one in needs["pkg:pypi/s7dissect@1.2"]] == [
        "pkg:pypi/coloured",
        "pkg:pypi/plain",
        "pkg:pypi/quick",
    ]
    assert [one.partition("@")[0] for one in needs["pkg:pypi/quick-core@1"]] == ["pkg:pypi/further"]


def test_without_what_it_needs_itself_there_is_no_bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> str:
        return "No matching distribution found for plain>=2"

    monkeypatch.setattr(bundle, "pip", refused)
    own = wheel(tmp_path, "s7dissect-1.2-py3-none-any", MADE["s7dissect-1.2-py3-none-any"])
    with pytest.raises(SystemExit, match=r"s7dissect itself cannot be installed on win_amd64-cp312: .*plain>=2"):
        bundle.fetch(own, ["fast"], WINDOWS, tmp_path / "wheels")


def test_what_wheels_say_is_held_against_the_folder(tmp_path: Path) -> None:
    """Whatever pip found: one that is missing, or of a version that does not do, is seen."""
    made = {stem: read_wheel(wheel(tmp_path, stem, needs)) for stem, needs in MADE.items()}
    here = Target("manylinux_aarch64", "3.12")
    chosen = [made[stem] for stem in made if not stem.endswith("win_amd64") and not stem.startswith("plain-1")]
    assert closure(chosen, "s7dissect", frozenset(("fast", "odd")), here) == {
        "s7dissect": {"plain", "quick", "forked", "odd"},
        "plain": set(),
        "quick": {"quick-core"},
        "quick-core": {"further"},
        "further": set(),
        "forked": set(),
        "odd": set(),
    }
    assert "old" in closure(chosen, "s7dissect", frozenset(), Target("manylinux_aarch64", "3.11"))
    fewer = [one for one in chosen if one.name != "further"]
    with pytest.raises(LookupError, match=r"quick-core needs further; extra .*, and the bundle has none"):
        closure(fewer, "s7dissect", frozenset(("fast",)), here)
    older = [made["plain-1.9-py3-none-any"], *[one for one in chosen if one.name != "plain"]]
    with pytest.raises(LookupError, match=r"s7dissect needs Plain>=2, and the bundle has 1\.9"):
        closure(older, "s7dissect", frozenset(), here)


def test_a_wheel_of_a_checkout_is_compressed_and_taken_where_it_fits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    python = "{}.{}".format(*sys.version_info)
    tag = f"cp{python.replace('.', '')}"
    stem = f"s7dissect-1.2-{tag}-{tag}-linux_x86_64"
    told = wheel(tmp_path, stem, ["x" * 5000])
    into = tmp_path / "into"
    into.mkdir()
    monkeypatch.setattr(bundle, "build_own", lambda folder: folder / "built.whl")
    taken = bundle.own_wheel(told, Target("", python), into)
    assert taken.name == told.name
    assert taken.stat().st_size < told.stat().st_size - 4000
    assert read_wheel(taken).metadata.items() == read_wheel(told).metadata.items()
    assert bundle.own_wheel(told, WINDOWS, into) == into / "built.whl"
    assert bundle.own_wheel(told, Target("", "3.99"), into) == into / "built.whl"


@pytest.mark.parametrize("target", [Target("", "3.11"), WINDOWS, Target("macosx_11_0_arm64", "3.13")])
def test_the_command_that_is_told_is_the_one_that_is_tried(tmp_path: Path, target: Target) -> None:
    own = read_wheel(wheel(tmp_path, "s7dissect-1.2-py3-none-any", []))
    text = readme(target, own, 7, {})
    assert text.isascii()
    assert "the interpreted build" in text
    assert "Left out" not in text
    command = re.search(r"python(?:\")? (-m pip install .*)", text)
    assert command is not None
    assert command[1].split() == (
        ["-m", "pip", "install", "--no-index", "--find-links", "wheels", "--require-hashes", "-r", "requirements.txt"]
    )
    assert ("%USERPROFILE%" in text) == target.tag.startswith("win")
    assert f"{target.python}" in text
