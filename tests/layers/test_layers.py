from __future__ import annotations

import doctest
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from scapy.packet import Packet, fuzz, ls

import dissect
import dissect.layers
from dissect.layers import COTP, S7, TPKT, S7_Any, S7_ReadVarRequest
from tests.cases import each

DOCUMENT = Path(__file__).resolve().parent.parent.parent / "docs" / "layers.md"


def test_the_tutorial_is_true(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = "\n".join(
        re.findall(r"^```python\n(.*?)^```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    )
    examples = doctest.DocTestParser().get_doctest(text, {}, "layers.md", str(DOCUMENT), 0)
    assert len(examples.examples) > 30
    told: list[str] = []
    assert doctest.DocTestRunner(verbose=False).run(examples, out=told.append).failed == 0, "".join(told)


def test_the_documents_name_every_layer() -> None:
    pages = [DOCUMENT, DOCUMENT.with_name("layers-parts.md")]
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    bases = {"S7_Body", "S7_Item", "S7_Userdata"}
    for name in set(dissect.layers.__all__) - bases:
        assert name in text or (name.endswith("_Extended") and name.removesuffix("_Extended") in text), name


def test_the_page_of_structures_is_the_classes() -> None:
    root = DOCUMENT.parent.parent
    environment = {**os.environ, "PYTHONPATH": str(Path(dissect.__file__).parent.parent)}
    done = subprocess.run(
        [sys.executable, root / "scripts" / "layers_doc.py"],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
    )
    assert done.stdout == (root / "docs" / "layers-parts.md").read_text(encoding="utf-8")


def test_the_docstring_is_true() -> None:
    text = dissect.layers.__doc__
    assert text is not None
    lines = [line[4:] for line in text.splitlines() if line.startswith("    ")]
    code = "\n".join(lines[: next(number for number, line in enumerate(lines) if "packet.getlayer" in line)])
    names: dict[str, object] = {}
    exec(code, names)
    read = names["read"]
    assert isinstance(read, Packet)
    assert f"bytes(read).hex()  # {bytes(read).hex()}" in code
    assert f".summary()  # {TPKT(bytes(read)).summary()}" in code


def test_all_that_is_public_is_there() -> None:
    assert set(dissect.layers.__all__) <= set(dir(dissect.layers))


def test_importing_says_nothing() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", "import dissect.layers"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_the_rest_of_the_package_does_without_scapy() -> None:
    code = "import sys, dissect.engine.pipeline, dissect.protocols.s7.message; print('scapy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "False\n"


@each("name", dissect.layers.__all__)
def test_every_layer_can_be_listed(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    layer = getattr(dissect.layers, name)
    if not (isinstance(layer, type) and issubclass(layer, Packet)):
        return
    assert layer.__doc__
    ls(layer)
    listed = capsys.readouterr().out
    for field in layer.fields_desc:
        assert field.name in listed
    if layer is not COTP and layer.fields_desc:
        bytes(layer())


@each("name", dissect.layers.__all__)
def test_every_layer_can_be_fuzzed(name: str) -> None:
    layer = getattr(dissect.layers, name)
    if isinstance(layer, type) and issubclass(layer, Packet) and layer.fields_desc:
        for _ in range(10):
            packet = fuzz(layer())
            packet.summary()
            octets = bytes(packet)
            assert not octets or bytes(layer(octets)) == octets


def test_items_can_be_fuzzed() -> None:
    packet = TPKT() / S7(pdu_ref=1) / S7_ReadVarRequest(items=[fuzz(S7_Any())])
    assert packet.summary() == "TPKT"
    assert len(bytes(packet)) == 4 + 10 + 2 + 12


def test_octets_may_be_a_bytearray() -> None:
    packet = TPKT(bytearray(b"\x03\x00\x00\x07\x02\xf0\x80"))
    assert packet.summary() == "TPKT / COTP DT EOT empty"
