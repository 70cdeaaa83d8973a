"""`--tls-keys` on the commands, and captures that hold their keys: what opens, what is refused, and that no key gets out."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest

import dissect
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import KeyLogError, Run
from dissect.packets.source.files import open_capture
from dissect.packets.source.packet import PacketSink
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.value_tables import INT
from dissect.protocols.s7plus.values import Value
from dissect.protocols.tls import aead
from tests.cli.support import run
from tests.cli.test_outputs import commands
from tests.engine.transactions.talk import dbw, read
from tests.files.anonymize.support import anonymized
from tests.meaning.report.schemas import complaints
from tests.protocols.s7plus.bodies import get_multi, multi_got
from tests.protocols.s7plus.pdus import asked, framed, told
from tests.protocols.tls.files import filmed
from tests.protocols.tls.talks import Wire, wire

Capture = pytest.CaptureFixture[bytes]
QUESTION, ANSWER = framed(asked(5, body=b"what")), framed(told(5))
READERS = (
    "analyze",
    "transactions",
    "values",
    "operations",
    "blocks",
    "devices",
    "report",
    "export",
    "sql",
    "show",
    "cut",
    "open",
    "extcap",
    "golden",
    "diff",
    "baseline",
    "verify",
    "monitor",
    "proxy",
)


class Secrets(PacketSink):
    """Keeps what Decryption Secrets Blocks hold."""

    def __init__(self) -> None:
        self.texts: list[tuple[int, bytes]] = []
        self.packets = 0

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        self.packets += 1

    def secrets(self, text: bytes) -> None:
        self.texts.append((self.packets, text))


def secrets_in(path: Path) -> list[tuple[int, bytes]]:
    """Return (packets before it, text) of each block."""
    found = Secrets()
    reader = open_capture(str(path))
    while reader.step(found):
        pass
    assert (reader.damage, reader.rejected) == ("", 0)
    return found.texts


@pytest.fixture(scope="module")
def spoken() -> Wire:
    return wire([(0, QUESTION), (1, ANSWER)])


@pytest.fixture
def trace(tmp_path: Path, spoken: Wire) -> Path:
    (tmp_path / "keys.log").write_bytes(spoken.key_log)
    return filmed(tmp_path / "trace.pcapng", spoken)


@pytest.fixture
def keys(trace: Path) -> Path:
    return trace.with_name("keys.log")


def hexes(found: Wire) -> list[str]:
    return [line.split()[2].decode() for line in found.key_log.splitlines() if not line.startswith(b"#")]


def test_every_command_that_reads_captures_has_the_option() -> None:
    having = {name for name, one in commands().items() if any(param.name == "tls_keys" for param in one.params)}
    assert having == set(READERS)


def test_what_opens_on_each_command(capfdbinary: Capture, trace: Path, keys: Path, tmp_path: Path) -> None:
    ran = run(capfdbinary, "transactions", "--tls-keys", keys, trace)
    assert "S7comm-plus GetMultiVariables" in ran.out
    assert "GetMultiVariables" not in run(capfdbinary, "transactions", trace).out
    assert run(capfdbinary, "show", "--tls-keys", keys, trace).out.count("GetMultiVariables") == 2
    tree = run(capfdbinary, "show", "-V", "--tls-keys", keys, trace).out
    assert tree.count("decrypted; offsets count from the start of the S7comm-plus PDU") == 2
    assert "GetMultiVariables" in run(capfdbinary, "golden", "--tls-keys", keys, trace).out
    assert run(capfdbinary, "diff", "--tls-keys", keys, trace, trace).code == 0
    assert "GetMultiVariables" in run(capfdbinary, "monitor", "--plain", "--tls-keys", keys, trace).out
    assert "GetMultiVariables" in run(capfdbinary, "baseline", "--tls-keys", keys, trace).out
    assert run(capfdbinary, "operations", "--tls-keys", keys, trace).code == 0
    part = tmp_path / "part.pcapng"
    assert run(capfdbinary, "cut", "--tls-keys", keys, trace, "-o", part, "--transaction", "2").code == 0
    assert secrets_in(part) == []  # keys that were given are not written


def test_verify_looks_into_tls(capfdbinary: Capture, tmp_path: Path) -> None:
    """S7comm-plus proves itself there, too; Wireshark is not asked about what it cannot see."""
    word = VariableAddress(0, 82, 3736, [3, 100, 2])
    request = framed(asked(7, body=get_multi(word, integrity_id=1)), 3)
    response = framed(told(7, body=multi_got([(1, Value(0, INT, 5))], [], 8)), 3)
    spoken = wire([(0, request), (1, response), (0, read(1, dbw(1, 0)))])
    trace = filmed(tmp_path / "trace.pcapng", spoken)
    (tmp_path / "keys.log").write_bytes(spoken.key_log)
    closed = run(capfdbinary, "verify", trace)
    assert (closed.code, "0 of 0 whole PDUs read to their last byte, 2 of functions" in closed.out) == (0, True)
    opened = run(capfdbinary, "verify", "--tls-keys", tmp_path / "keys.log", trace)
    assert opened.code == 0
    assert (
        "S7comm-plus: 2 of 2 whole PDUs read to their last byte, 2 of functions whose body is not known;" in opened.out
    )
    assert "; 1 of 1 response ids = request id + sequence number" in opened.out
    assert "  1 PDU not compared: Wireshark is not asked to decrypt TLS" in opened.out


def test_the_report(capfdbinary: Capture, trace: Path, keys: Path) -> None:
    told = run(capfdbinary, "analyze", "--tls-keys", keys, trace).out
    assert "TLS 1.3, TLS_AES_256_GCM_SHA384, server name plc.local, " in told
    assert "certificate of the server: C=DE,CN=PLC_1/Communication, self-signed, valid 2019-09-14 to 2050-09-06" in told
    values = json.loads(run(capfdbinary, "analyze", "-T", "json", "--tls-keys", keys, trace).out)
    assert complaints("analysis", values, exact=True) == []
    (connection,) = values["connections"]
    session = connection["tls"]
    assert (session["version"], session["cipher_suite"]) == ("TLS 1.3", "TLS_AES_256_GCM_SHA384")
    assert (session["records_closed"], session["closed_because"]) == (0, None)
    assert session["server"]["certificates"][0]["self_signed"] is True
    assert session["client"]["octets_per_second"] > 0
    assert values["tls"]["decrypted"] == 1
    without = json.loads(run(capfdbinary, "analyze", "-T", "json", trace).out)
    assert complaints("analysis", without, exact=True) == []
    assert without["connections"][0]["tls"]["server"]["certificates"] == []
    assert "session.tls_closed" not in without["findings"]


def test_decrypted_bytes_that_are_no_s7_are_counted_and_named(capfdbinary: Capture, tmp_path: Path) -> None:
    spoken = wire([(0, QUESTION), (1, b"\x00\x1b[2J" * 9), (1, ANSWER), (0, b"GET / HTTP/1.1")])
    trace = filmed(tmp_path / "trace.pcapng", spoken)
    (tmp_path / "keys.log").write_bytes(spoken.key_log)
    said = run(capfdbinary, "analyze", "--tls-keys", tmp_path / "keys.log", trace).out
    assert " TLS, 2 decrypted\n" in said
    assert "unknown in TLS: begins with 00 1b 5b 32 4a 00 1b 5b\n" in said
    assert said.count("unknown in TLS") == 1
    assert "decrypted\n" not in run(capfdbinary, "analyze", trace).out.partition("Connections")[0]


def test_several_key_logs_and_lines_of_another_form(
    capfdbinary: Capture, trace: Path, keys: Path, tmp_path: Path
) -> None:
    lines = keys.read_bytes().splitlines(keepends=True)
    one, two = tmp_path / "one", tmp_path / "two"
    one.write_bytes(b"".join(lines[:3]))
    two.write_bytes(b"a line of something else\n" + b"".join(lines[3:]))
    ran = run(capfdbinary, "transactions", "--tls-keys", one, "--tls-keys", two, trace)
    assert "GetMultiVariables" in ran.out
    assert ran.err == "s7dissect: --tls-keys: 1 line has another form and no key\n"


def test_keys_of_another_session_are_said_to_be(capfdbinary: Capture, trace: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.write_bytes(wire([]).key_log)
    told = run(capfdbinary, "analyze", "--tls-keys", other, trace).out
    assert "session.tls_closed" in told
    assert "not decrypted: the key log holds only keys of 1 other session" in told


def test_a_key_log_whose_end_is_missing_is_said_to_be_cut_off(capfdbinary: Capture, trace: Path, keys: Path) -> None:
    keys.write_bytes(next(line for line in keys.read_bytes().splitlines() if line.startswith(b"CLIENT_"))[:-7])
    ran = run(capfdbinary, "analyze", "--tls-keys", keys, trace)
    assert "not decrypted: the key log holds only the beginning of a line that is cut off" in ran.out
    assert ran.err == "s7dissect: --tls-keys: the last line is cut off and gives no key unless the rest is added\n"


@pytest.mark.parametrize("content", [b"hello\nworld\n", b"hello", bytes(range(256)) * 20])
def test_a_file_of_another_form(capfdbinary: Capture, trace: Path, tmp_path: Path, content: bytes) -> None:
    wrong = tmp_path / "wrong"
    wrong.write_bytes(content)
    ran = run(capfdbinary, "analyze", "--tls-keys", wrong, trace)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.endswith("not a TLS key log: no line has the form LABEL CLIENT_RANDOM SECRET (SSLKEYLOGFILE)\n")
    with pytest.raises(KeyLogError, match="not a TLS key log"):
        dissect.analyze(trace, tls_keys=wrong)


def test_a_file_that_is_missing(capfdbinary: Capture, trace: Path) -> None:
    ran = run(capfdbinary, "analyze", "--tls-keys", "nowhere", trace)
    assert ran.code == 2
    assert "nowhere: No such file or directory" in ran.err
    with pytest.raises(FileNotFoundError):
        dissect.analyze(trace, tls_keys="nowhere")


def test_without_the_package(capfdbinary: Capture, trace: Path, keys: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(aead, "is_installed", lambda: False)
    ran = run(capfdbinary, "analyze", "--tls-keys", keys, trace)
    assert (ran.code, ran.out) == (2, "")
    assert "--tls-keys needs the package cryptography: pip install 's7dissect[tls]'" in ran.err
    with pytest.raises(ImportError, match=r"pip install 's7dissect\[tls\]'"):
        dissect.analyze(trace, tls_keys=keys)


def test_in_python(trace: Path, keys: Path) -> None:
    names = [one.function_name for one in dissect.open(trace, tls_keys=keys) if isinstance(one, Transaction)]
    assert names == ["S7comm-plus InitSSL", "S7comm-plus GetMultiVariables"]
    assert dissect.analyze(trace, tls_keys=[keys]).total == 2
    assert dissect.analyze(trace).total == 1


# ---- Decryption Secrets Blocks --------------------------------------------------------------------------------------


def test_a_capture_that_holds_its_keys(capfdbinary: Capture, tmp_path: Path, spoken: Wire) -> None:
    source = filmed(tmp_path / "dsb.pcapng", spoken, spoken.key_log)
    assert "GetMultiVariables" in run(capfdbinary, "transactions", source).out
    out = tmp_path / "cut.pcapng"
    ran = run(capfdbinary, "cut", source, "-o", out)
    assert "keeps 1 block of TLS session keys: it can be decrypted without other keys\n" in ran.err
    assert secrets_in(out) == [(0, spoken.key_log)]
    assert "GetMultiVariables" in run(capfdbinary, "transactions", out).out


def test_no_key_gets_out(capfdbinary: Capture, tmp_path: Path, spoken: Wire, keys: Path, trace: Path) -> None:
    source = filmed(tmp_path / "dsb.pcapng", spoken, spoken.key_log)
    for arguments in (
        ("analyze", source), ("analyze", "-T", "json", source), ("transactions", "-T", "jsonl", source),
        ("show", "-V", source), ("show", "-T", "jsonl", source), ("golden", source), ("baseline", source),
        ("monitor", "--plain", source), ("monitor", "-T", "jsonl", source), ("operations", "-T", "jsonl", source),
        ("analyze", "--tls-keys", keys, trace), ("show", "-V", "--tls-keys", keys, trace),
    ):  # fmt: skip
        ran = run(capfdbinary, *arguments)
        text = (ran.out + ran.err).lower().replace(" ", "")
        for secret in hexes(spoken):
            assert secret not in text, arguments


def test_anonymize_drops_keys_and_certificates(tmp_path: Path) -> None:
    import ssl

    found = wire([(0, QUESTION), (1, ANSWER)], ssl.TLSVersion.TLSv1_2)  # its certificate is there in clear
    source = filmed(tmp_path / "dsb.pcapng", found, found.key_log)
    assert b"PLC_1/Communication" in source.read_bytes()
    out = tmp_path / "shared.pcapng"
    account = anonymized(source, out)
    assert account.secrets == 1
    assert account.masked["tls"][0] > 2
    assert "       1  blocks of TLS session keys" in account.lines()
    octets = out.read_bytes()
    assert secrets_in(out) == []
    for secret in (b"PLC_1/Communication", b"plc.local", *[bytes.fromhex(text) for text in hexes(found)]):
        assert secret not in octets
    assert dissect.analyze(out).total == 1  # the answer to InitSSL


def test_blocks_of_editcap(tmp_path: Path, trace: Path, keys: Path) -> None:
    """It puts them before the first interface; ours stand behind it, where tshark can write them again."""
    editcap = shutil.which("editcap")
    if editcap is None:
        pytest.skip("no editcap")
    injected = tmp_path / "injected.pcapng"
    subprocess.run([editcap, "--inject-secrets", f"tls,{keys}", trace, injected], check=True)
    assert secrets_in(injected) == [(0, keys.read_bytes())]
    assert dissect.analyze(injected).total == 2
    ours = filmed(tmp_path / "ours.pcapng", wire([]), keys.read_bytes())
    again = tmp_path / "again.pcapng"
    subprocess.run([editcap, ours, again], check=True)
    assert secrets_in(again) == [(0, keys.read_bytes())]


def test_a_key_log_that_grows_while_it_is_read(trace: Path, keys: Path, spoken: Wire) -> None:
    """What a program writes into the file once the line is watched is taken when it is needed."""
    from dissect.engine.pipeline import Options
    from dissect.files.session import read_tls_keys
    from dissect.meaning.report.analysis import Analysis

    keys.write_bytes(b"# nothing yet\n")
    growing = read_tls_keys([keys])
    keys.write_bytes(b"# nothing yet\n" + spoken.key_log)
    analysis = Analysis()
    reading = Run([trace], analysis, Options(tls_keys=growing))
    while reading.step():
        pass
    assert analysis.total == 2
