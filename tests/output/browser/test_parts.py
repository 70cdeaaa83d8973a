"""What the browser edition is made of: pinned packages, their licences, and a page that is the same each time."""

from __future__ import annotations

import errno
import gzip
import hashlib
import re
import shutil
from pathlib import Path

import click
import pytest

from dissect.cli.main import COMMANDS, group, run
from dissect.output.browser import page as page_module
from dissect.output.browser.bridge import Bridge, refused
from dissect.output.browser.contents import Contents
from dissect.output.browser.page import MAX_OCTETS, TooLargeError, made
from dissect.output.browser.parts import Part, Parts, PartsError, engine, wheels
from tests.cli.support import run as run_command
from tests.meaning.report.schemas import ROOT
from tests.output.browser.support import OWN, PACKAGES


def test_the_page_is_small_and_the_same_each_time(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert 5_000_000 < page.stat().st_size <= MAX_OCTETS == 12_000_000
    # What is compressed is compared, compressed lightly: xz takes most of the time.
    monkeypatch.setattr(
        "dissect.output.browser.contents.lzma.compress", lambda octets, **_: gzip.compress(octets, 1, mtime=0)
    )
    first, second = [Contents(Parts(PACKAGES)).pieces() for _ in range(2)]
    assert first == second


def test_a_page_that_was_mailed_is_recognised(
    page: Path, capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    octets = page.read_bytes()
    monkeypatch.setattr("dissect.output.browser.page.made", lambda *_: octets)
    digest = hashlib.sha256(octets).hexdigest()
    same = run_command(capfdbinary, "browser", "--verify", page, "--packages", PACKAGES)
    assert (same.code, same.out) == (0, f"the same: SHA-256 {digest}\nmade here: {digest}\n")


def test_a_page_that_was_changed_is_told(
    page: Path, tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dissect.output.browser.page.made", lambda *_: page.read_bytes())
    changed = tmp_path / "mailed.html"
    changed.write_bytes(page.read_bytes().replace(b"nothing is sent", b"all is sent", 1))
    told = run_command(capfdbinary, "browser", "--verify", changed, "--packages", PACKAGES)
    assert told.code == 1
    assert told.out.startswith("DIFFERENT: ")
    before = changed.read_bytes()
    kept = run_command(capfdbinary, "browser", "-o", changed, "--packages", PACKAGES)
    assert (kept.code, changed.read_bytes()) == (2, before)
    assert "--force overwrites it" in kept.err
    assert run_command(capfdbinary, "browser", "-o", changed, "--packages", PACKAGES, "--force").code == 0
    assert changed.read_bytes() == page.read_bytes()
    assert "give either" in run_command(capfdbinary, "browser").err
    assert run_command(capfdbinary, "browser", "--verify", tmp_path / "none.html").err.endswith(
        "No such file or directory\n"
    )


def test_a_page_for_which_there_is_no_room_is_told(
    page: Path, tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(output: str, octets: bytes) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", output)

    monkeypatch.setattr("dissect.output.browser.page.made", lambda *_: b"page")
    monkeypatch.setattr("dissect.cli.browser.save", full)
    told = run_command(capfdbinary, "browser", "-o", tmp_path / "page.html", "--packages", PACKAGES)
    assert (told.code, told.out) == (5, "")
    assert "No space left on device" in told.err


def test_a_place_that_cannot_be_written_is_told_before_anything_is_fetched(
    tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Parts, "fetch", lambda _: pytest.fail("it fetches"))
    told = run_command(capfdbinary, "browser", "-o", tmp_path / "none" / "page.html")
    assert (told.code, told.out) == (2, "")
    assert "No such file or directory" in told.err
    (tmp_path / "page.html").write_bytes(b"here")
    told = run_command(capfdbinary, "browser", "-o", tmp_path / "page.html")
    assert (told.code, "--force overwrites it" in told.err) == (2, True)


def test_every_package_is_listed_with_its_licence(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for part in [engine(), *wheels()]:
        assert f"<summary>{part.name} {part.version}: {part.licence}</summary>" in text
    shown = text[text.index("Licences of what is inside") : text.index('id="worker"')]
    assert shown.count("Permission is hereby granted") + shown.count("Redistribution and use") >= 9


def test_a_package_that_is_not_the_pinned_one_is_refused(page: Path, tmp_path: Path) -> None:
    part = wheels()[0]
    octets = (PACKAGES / part.file).read_bytes()
    assert part.is_pinned(octets)
    (tmp_path / part.file).write_bytes(octets[:-1] + bytes((octets[-1] ^ 1,)))
    with pytest.raises(PartsError, match=f"not the pinned {part.name}"):
        Parts(tmp_path).read(part)
    with pytest.raises(PartsError, match="No such file"):
        Parts(tmp_path).read(engine())


def test_what_cannot_be_fetched_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda *_, **__: None)
    with pytest.raises(PartsError, match="comes from npm, which is not installed"):
        Parts(tmp_path).fetch()
    broken = tmp_path / "npm"
    broken.write_text("#!/bin/sh\necho 'npm error code E503' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(shutil, "which", lambda *_, **__: str(broken))
    with pytest.raises(PartsError, match=r"reachable from here\?\): npm error code E503"):
        Parts(tmp_path / "packages").fetch()


def test_a_page_that_became_too_large_is_not_written(monkeypatch: pytest.MonkeyPatch) -> None:
    class Heavy(Contents):
        def __init__(self) -> None:
            pass

        def pieces(self) -> dict[str, bytes]:
            return {"wasm": bytes(1000)}

        def licences(self) -> list[tuple[Part, str]]:
            return [(engine(), "")]

    assert b'id="piece-wasm"' in made(Heavy(), "1")
    monkeypatch.setattr(page_module, "MAX_OCTETS", 1000)
    with pytest.raises(TooLargeError, match="more than 1,000"):
        made(Heavy(), "1")


def test_the_views_know_what_each_command_takes() -> None:
    """The page gives a command the files beside the captures only where it has an option for them."""
    script = (ROOT / "dissect" / "output" / "browser" / "views.js").read_text(encoding="utf-8")
    table = script[script.index("const TAKES") : script.index("const COLUMNS")]
    rows = re.findall(r"^  (\w+): \[(.*)\],$", table, re.MULTILINE)
    assert len(rows) >= 10
    for name, given in rows:
        command = group.get_command(click.Context(group), name)
        assert command is not None
        taken = {option for parameter in command.params for option in parameter.opts}
        assert set(re.findall(r'"([^"]+)"', given)) == {"--tags", "--scd", "--bind", "-Y"} & taken, name


def test_commands_of_the_page_go_on_after_each_other(tmp_path: Path) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    (folder / "one.pcapng").symlink_to(OWN / "item-errors.pcapng")
    bridge = Bridge(run, str(folder))
    pieces: list[bytes] = []

    def take(piece: memoryview) -> None:
        pieces.append(bytes(piece))

    def broken(argv: list[str]) -> int:
        raise ValueError("of\nours")

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        assert bridge.run(["analyze", "one.pcapng"], take) == (0, "")
        assert b"".join(pieces).startswith(b"one.pcapng: 26 packets")
        code, errors = bridge.run(["analyze", "two.pcapng"], take)
        assert (code, errors) == (2, "s7dissect: two.pcapng: no such file\n")
        assert bridge.run(["cut", "one.pcapng", "-o", "part.pcapng"], take)[0] == 0
        assert bridge.written() == ["part.pcapng"]
        assert Bridge(broken, str(folder)).run(["analyze"], take) == (
            70,
            "s7dissect: a fault of this program: ValueError: of\\x0aours\n",
        )


@pytest.mark.parametrize(
    ("line", "needs"),
    [
        ("serve x.pcapng", "serve needs the network"),
        ("verify x.pcapng", "verify needs tshark"),
        ("analyze x.pcapng --tls-keys=keys.txt", "--tls-keys needs the package cryptography"),
        ("export x.pcapng -o rows.parquet", "export to this format needs a compiled package"),
        ("export x.pcapng -o rows.csv", ""),
        ("analyze x.pcapng", ""),
    ],
)
def test_what_a_browser_lacks_is_said(line: str, needs: str) -> None:
    told = refused(line.split())
    assert needs in told
    assert bool(told) == bool(needs)


def test_a_room_that_is_left_out_is_of_a_command_that_is_refused() -> None:
    from dissect.output.browser.contents import _ROOMS_LEFT_OUT

    for name in COMMANDS:
        source = (ROOT / "dissect" / "cli" / f"{name.replace('-', '_')}.py").read_text(encoding="utf-8")
        rooms = set(re.findall(r"^\s*from dissect\.(\w+)[. ]", source, re.MULTILINE)) & _ROOMS_LEFT_OUT
        assert not rooms or refused([name]), (name, rooms)
