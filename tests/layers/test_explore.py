from __future__ import annotations

import builtins
import os
import subprocess
import sys
from typing import Final

import pytest
from scapy.config import conf
from scapy.packet import explore, ls

import dissect.layers
from dissect.layers import S7_CyclicRequest


def test_explore_lists_every_layer_with_its_name(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in dissect.layers.__all__:  # asked by the short name, Scapy loads the layers for the prompt
        monkeypatch.setattr(builtins, name, None, raising=False)
    explore("s7dissect")
    by_name = capsys.readouterr().out
    explore("scapy.layers.s7dissect")
    assert capsys.readouterr().out == by_name
    cells = [[cell.strip() for cell in line.split("|")] for line in by_name.splitlines()]
    rows = {row[0]: row[1] for row in cells if len(row) == 2 and row[0]}
    layers = {name for name in dissect.layers.__all__ if isinstance(getattr(dissect.layers, name), type)}
    assert layers - {"S7Session"} <= set(rows)
    assert rows["S7_CyclicRequest"] == "S7 cyclic request"
    assert not [name for name, shown in rows.items() if not shown]


def test_the_window_of_explore_knows_the_package() -> None:
    described = dict(conf.layers.layers())
    assert described["scapy.layers.s7dissect"].startswith("Scapy layers for TPKT, COTP and S7comm")
    assert not [name for name in described if name.startswith("dissect")]


def test_ls_tells_the_fields_and_what_a_new_packet_has(capsys: pytest.CaptureFixture[str]) -> None:
    ls(S7_CyclicRequest)
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()][-2:]
    assert lines == [
        "time_base : XByteEnumField = ('1')",
        "factor : ByteField = ('1')",
    ]


#: What a process of its own does, and what it prints: nothing that another test did can help it.
FRESH: Final = """
import contextlib, io, sys
import dissect.layers
from scapy.config import conf
from scapy.main import load_contrib, load_layer
from scapy.packet import explore
for load in (load_layer, load_contrib):
    for name in ("s7", "s7dissect", "dissect.layers"):
        names = {}
        load(name, globals_dict=names)
        assert names["S7_Clock"] is dissect.layers.S7_Clock and set(names) == set(dissect.layers.__all__), (load, name)
listed = set()
for name in ("s7", "s7dissect", "dissect.layers", dissect.layers, "scapy.layers.s7"):
    told = io.StringIO()
    with contextlib.redirect_stdout(told):
        explore(name)
    listed.add(told.getvalue().partition(chr(10))[2].count(chr(10)))
    assert "S7_CyclicRequest" in told.getvalue(), name
assert len(listed) == 1, listed
print([(extension.name, sorted(extension.specs)) for extension in conf.exts.exts])
"""


def test_a_fresh_process_loads_and_lists_the_layers_by_each_of_their_names() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", FRESH], capture_output=True, text=True, check=False, env=dict(os.environ)
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    names = ["scapy.layers.dissect.layers", "scapy.layers.s7", "scapy.layers.s7dissect"]
    assert done.stdout.strip() == str([("s7dissect", names)])
