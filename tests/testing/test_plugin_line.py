"""Fixtures that have to do with sockets, and `s7_capture`."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib

from tests.testing.projects import CLIENT, INSTALLED, PLUGIN, ROOT, Project

pytest_plugins = ["pytester"]


def test_a_capture_is_opened_by_its_name(project: Project) -> None:
    project.test(
        """
import os
import pytest

@pytest.mark.parametrize("name", ["pump", "pump.pcapng", os.path.abspath("tests/captures/pump.pcapng")])
def test_pump(s7_capture, name):
    pump = s7_capture(name)
    assert pump.path.name == "pump.pcapng"
    assert [one.function_name for one in pump.transactions()] == ["Setup communication"] + 4 * ["Read Var"]
    assert pump.analysis().total == 5
    assert len(pump.session().transactions) == 5
    assert {one.slug for one in pump.findings()} >= {"session.unusual_port"}
    assert "Connection" in {type(one).__name__ for one in pump.events()}
    with open(pump, "rb") as file:
        assert file.read(1) == b"\\n"

def test_pomp(s7_capture):
    s7_capture("pomp")
"""
    )
    result = project.run()
    result.assert_outcomes(passed=3, failed=1)
    result.stdout.fnmatch_lines(
        ["*FileNotFoundError: no capture tests/captures/pomp; in tests/captures there is pump.pcapng"]
    )
    project.ini("s7_captures = nowhere")
    result = project.run("-k", "pomp")
    result.stdout.fnmatch_lines(["*no capture nowhere/pomp: there is no folder nowhere (the ini setting s7_captures *"])


def test_a_client_reads_what_was_recorded(project: Project) -> None:
    project.test(
        CLIENT
        + """
def test_pump(s7_server):
    plc = s7_server("pump")
    with connected(plc) as client:
        assert client.db_read(1, 116, 1) == b"t"
    assert [one.function for one in plc.requests] == ["Setup communication", "Read Var"]
    with connected(s7_server("pump", faults=["refuse:2:0x8104"])) as client:
        try:
            client.db_read(1, 116, 1)
        except Exception as refused:
            print(refused)
        else:
            raise AssertionError

def test_no_capture(s7_server):
    s7_server("pump", unmatched="sometimes")
"""
    )
    result = project.run()
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*ValueError: unmatched is 'fail' or 'allow', not 'sometimes'"])


UNMATCHED = """
import pytest

def ask(plc, address=4000):
    with connected(plc) as client, pytest.raises(Exception):
        client.db_read(1, address, 2)

def test_pump(s7_server):
    ask(s7_server("pump"))

def test_allowed(s7_server):
    ask(s7_server("pump", unmatched="allow"))

def test_failing(s7_server):
    ask(s7_server("pump"))
    assert "this" == "that"

@pytest.fixture
def late(s7_server):
    plc = s7_server("pump")
    yield
    ask(plc)

def test_late(late):
    pass

def test_many(s7_server):
    plc = s7_server("pump")
    with connected(plc) as client:
        for address in range(13):
            with pytest.raises(Exception):
                client.db_read(1, 4000 + address, 2)
"""


def test_what_was_not_recorded_fails_the_test(project: Project) -> None:
    module = "tests/test_pump.py"
    project.test(CLIENT + UNMATCHED, module)
    asked = "the fake PLC of tests/captures/pump.pcapng received a request that was not recorded:"
    request = "  request 2 on connection 1, Read Var DB1.DBB4000 x2: not recorded: DB1.DBB4000 x2 (nearest recorded: *)"
    result = project.run(f"{module}::test_pump", f"{module}::test_allowed")
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*_ test_pump _*", asked, request, "Record it as well, or *"], consecutive=True)
    assert "traceback" not in result.stdout.str()
    result = project.run(f"{module}::test_failing")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*assert 'this' == 'that'", "*- Captured s7_server call -*", asked, request])
    result = project.run(f"{module}::test_late")
    result.assert_outcomes(passed=1, errors=1)
    result.stdout.fnmatch_lines(["*ERROR at teardown of test_late*", asked, request])
    result = project.run(f"{module}::test_many")
    result.assert_outcomes(failed=1)
    assert result.stdout.str().count(": not recorded: ") == 10
    result.stdout.fnmatch_lines(["  and 3 more"])


def test_a_recorder_keeps_what_passes(project: Project) -> None:
    project.test(
        CLIENT
        + """
import pytest

@pytest.mark.parametrize("form", ["server", "port", "tuple", "text"])
def test_pump(s7_server, s7_record, form):
    plc = s7_server("pump")
    forms = {"server": plc, "port": plc.port, "tuple": (plc.host, plc.port), "text": f"{plc.host}:{plc.port}"}
    line = s7_record(to=forms[form])
    assert line.port != plc.port
    with connected(line) as client:
        client.db_read(1, 116, 1)
    path = line.capture()
    assert path == line.capture() == line.path
    link, = line.session().links
    assert link.begun and link.ended == "disconnect" and link.ended_by == "client"
    assert [str(one.exchange.function_name) for one in link.transactions] == ["Setup communication", "Read Var"]
    with connected(s7_server(line)) as client:  # and what was recorded can be served
        assert client.db_read(1, 116, 1) == b"t"

def test_two(s7_server, s7_record):
    plc = s7_server("pump")
    one, other = s7_record(to=plc), s7_record(to=plc)
    for line in one, other:
        with connected(line) as client:
            client.db_read(1, 116, 1)
    assert one.capture() != other.capture()
    assert len(one.session().transactions) == len(other.session().transactions) == 2

def test_chain(s7_server, s7_record, s7_golden):
    near = s7_record(to=s7_record(to=s7_server("pump")))
    with connected(near) as client:
        client.db_read(1, 116, 1)
    assert len(near.session().transactions) == 2

def test_nowhere(s7_record):
    with pytest.raises(TypeError, match="give the address of the PLC"):
        s7_record(to=None)

def test_unused(s7_record, s7_server):
    line = s7_record(to=s7_server("pump"))
    assert line.capture().stat().st_size > 0
    assert line.session().links == []
"""
    )
    project.run().assert_outcomes(passed=8)


def test_who_does_not_disconnect_is_told(project: Project) -> None:
    project.test(
        CLIENT
        + """
import pytest

def test_open(s7_server, s7_record):
    plc = s7_server("pump")
    line, other = s7_record(to=plc), s7_record(to=plc)
    with connected(line) as client, connected(other) as second:
        client.db_read(1, 116, 1)
        second.db_read(1, 116, 1)
        with pytest.raises(Exception, match="^1 client did not disconnect within 0.05 s, "):
            line.capture(wait_s=0.05)
        other.close()
        assert [one.outcome for one in other.session().transactions] == ["answered", "answered"]

def test_left_open(s7_server, s7_record):
    line = s7_record(to=s7_server("pump"))
    client = snap7.client.Client()
    client.connect(line.host, 0, 1, line.port)
    test_left_open.client = client  # nobody closes it before the fixtures end
"""
    )
    project.run("-W", "ignore").assert_outcomes(passed=2)


def test_a_plc_that_is_not_there_is_told(project: Project) -> None:
    project.test(
        CLIENT
        + """
import pytest
import socket

def test_nobody(s7_record, s7_golden):
    with socket.create_server(("127.0.0.1", 0)) as nobody:
        port = nobody.getsockname()[1]
    line = s7_record(to=port)
    with pytest.raises(Exception):
        with connected(line):
            pass
    line.capture()
    assert "cannot be reached: Connection refused" in line.problems[0]
    s7_golden.check(line)
"""
    )
    result = project.run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        ["*recorded-1.pcapng has no connections, *", "the recorder: 127.0.0.1:* cannot be reached: *"],
        consecutive=True,
    )


def test_why_a_client_was_cut_off_is_printed_with_a_test_that_fails(project: Project) -> None:
    project.test(
        CLIENT
        + """
import socket

def test_nobody(s7_record):
    with socket.create_server(("127.0.0.1", 0)) as nobody:
        port = nobody.getsockname()[1]
    with connected(s7_record(to=port)):
        pass
"""
    )
    result = project.run()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        ["*- Captured s7_record call -*", "127.0.0.1:* cannot be reached: Connection refused; *"]
    )
    assert result.stdout.str().count("cannot be reached") == 1


def test_a_plc_of_a_whole_module_is_a_fixture_as_the_documentation_has_it(project: Project) -> None:
    text = (ROOT / "docs" / "pytest.md").read_text(encoding="utf-8")
    (fixture,) = re.findall(r"```python\n(import pytest.*?)```", text, re.DOTALL)
    project.test(
        f"{fixture}\n{CLIENT}\n"
        """
@pytest.mark.parametrize("number", range(2))
def test_pump(plc, s7_record, s7_golden, number):
    line = s7_record(to=plc)
    with connected(line) as client:
        client.db_read(1, 116, 1)
    s7_golden.check(line)

class TestLast:
    def test_of_all(self, plc):
        assert plc.connections == 2
        with connected(plc) as client, pytest.raises(Exception):
            client.db_read(1, 4000, 2)
"""
    )
    result = project.run("--s7-update", "new")
    result.assert_outcomes(passed=3, errors=1)
    result.stdout.fnmatch_lines(["*ERROR at teardown of TestLast.test_of_all*", "*assert not *DB1.DBB4000*"])


def test_an_asynchronous_client_that_is_waited_for_is_recorded_whole(project: Project) -> None:
    project.test(
        """
import asyncio

async def talk(to):
    reader, writer = await asyncio.open_connection(to.host, to.port)
    writer.write(bytes.fromhex("0300001611e00000000100c0010ac1020100c2020102"))
    confirm = await reader.readexactly(22)
    writer.close()
    await writer.wait_closed()
    return confirm

def test_pump(s7_server, s7_record, s7_golden):
    async def both():
        line = s7_record(to=s7_server("pump"))
        confirm = await talk(line)
        s7_golden.check(line)
        return confirm
    assert asyncio.run(both())[5] == 0xD0
"""
    )
    project.run("--s7-update", "new").assert_outcomes(passed=1)
    assert "ends fin by client" in project.golden().read_text()


def test_the_plugin_is_an_entry_point() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert settings["project"]["entry-points"]["pytest11"] == {"s7dissect": "dissect.testing.plugin"}
    assert (PLUGIN == ["-p", "s7dissect"]) == INSTALLED


def loaded(statement: str) -> set[str]:
    """Return what of us and of heavy packages is loaded by a statement, in a process of its own."""
    code = f"import pytest, sys\n{statement}\nprint(*sys.modules)"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    heavy = {"scapy", "msgspec", "rich", "asyncio", "snap7", "pyshark"}
    names = set(ran.stdout.splitlines()[-1].split())
    return {name for name in names if name.split(".")[0] == "dissect" or name in heavy}


def run_loads(*arguments: str) -> set[str]:
    """Return the same of a run of pytest."""
    options = ["-q", *PLUGIN, *arguments]
    return loaded(f"assert pytest.main({options!r}) == 0")


IDLE = {"dissect", "dissect.testing", "dissect.testing.golden_files", "dissect.testing.plugin"}


def test_the_plugin_loads_nothing_of_the_engine() -> None:
    assert loaded("import dissect.testing.plugin") == IDLE


def test_a_run_that_uses_nothing_of_it_loads_nothing(project: Project) -> None:
    project.goldens.mkdir()  # so that it watches
    project.test("def test_nothing():\n    pass\n")
    assert run_loads() == IDLE


def test_a_golden_needs_neither_scapy_nor_the_network(project: Project) -> None:
    project.test("def test_pump(s7_golden):\n    s7_golden.check('pump')\n")
    used = run_loads("--s7-update", "new")
    assert "dissect.testing.golden.comparison" in used
    assert not {
        name
        for name in used
        if name.startswith(("scapy", "dissect.layers", "dissect.testing.playback.server", "dissect.online.proxy"))
    }
