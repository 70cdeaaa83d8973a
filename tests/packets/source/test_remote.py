"""Captures of other machines: names, what stands for several, and reading from OpenSSH, nginx and an object store."""

from __future__ import annotations

import os
import shutil
import socket
import ssl
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from dissect.packets.source.files import open_capture
from dissect.packets.source.packet import CaptureError
from dissect.packets.source.remote import RemoteSource, expand, explained, is_remote, open_remote, shown
from tests.cli.support import run
from tests.meaning.report.schemas import ROOT
from tests.packets.source.craft import Recorder, step_to_the_end
from tests.packets.source.servers import LOOPBACK, free_port, object_store, sftp_server, web_server

SZL: Final = ROOT / "captures" / "szl.pcapng"
POLL: Final = ROOT / "captures" / "nodes7-poll-missing.pcapng"
DAYS: Final = ("2026-11-01", "2026-11-03")

Capture = pytest.CaptureFixture[bytes]


def packets(name: str | Path) -> list[object]:
    """Return what a reader delivers of a capture."""
    recorder = Recorder()
    reader = open_capture(name)
    step_to_the_end(reader, recorder)
    reader.close()
    assert not reader.damage
    return list(recorder.frames)


def refused(name: str) -> str:
    with pytest.raises(CaptureError) as caught:
        open_capture(name)
    return str(caught.value)


# ---- names ----------------------------------------------------------------------------------------------------------


def test_a_host_that_is_not_known_is_said_in_words() -> None:
    error = socket.gaierror(socket.EAI_NONAME, "Name or service not known")
    assert explained(error) == "cannot be read: Name or service not known"


def test_what_is_wrong_with_tls_is_said_in_words() -> None:
    """Its errors have numbers of their own, 1 for most, which the system has for "Operation not permitted"."""
    refused = ssl.SSLCertVerificationError(1, "[SSL: CERTIFICATE_VERIFY_FAILED] certificate verify failed")
    refused.verify_message = "self-signed certificate."
    said = (
        "cannot be read: its certificate is not accepted: self-signed certificate; SSL_CERT_FILE names others to trust"
    )
    assert explained(refused) == said
    # As a transport has it: an error of its own that is one of TLS as well, in one of fsspec.
    outer, own = FileNotFoundError("https://h/x"), ClientConnectorError(1, "Cannot connect to host h:443")
    outer.__cause__, own.__cause__ = own, refused
    assert explained(outer) == said


class ClientConnectorError(ssl.SSLError):
    """Stands for those of aiohttp."""


def test_a_server_that_hangs_up_has_not_said_that_there_is_no_file() -> None:
    pytest.importorskip("aiohttp", reason="no aiohttp: pip install 's7dissect[test]'")
    with socket.create_server((LOOPBACK, 0)) as rude:

        def hang_up() -> None:
            try:
                while True:
                    with rude.accept()[0] as asking:
                        asking.recv(4096)  # one that was not read would reset the connection
            except OSError:
                return

        thread = threading.Thread(target=hang_up, daemon=True)
        thread.start()
        address = f"http://{LOOPBACK}:{rude.getsockname()[1]}/x.pcap"
        assert refused(address) == f"{address}: cannot be read: Server disconnected"
        rude.shutdown(socket.SHUT_RDWR)
        thread.join(5)


def test_what_is_a_name_of_another_machine() -> None:
    for name in ("sftp://h/x.pcap", "https://h/x.pcap", "s3://bucket/x", "S3://bucket/x"):
        assert is_remote(name)
    for name in ("x.pcap", "/a/b.pcap", "-", "a:b", "C:\\x.pcap", "://x", "1a://x"):
        assert not is_remote(name)


def test_passwords_and_signatures_are_not_shown() -> None:
    assert shown("sftp://ann:secret@h:22/day/x.pcap") == "sftp://ann@h:22/day/x.pcap"
    assert shown("sftp://ann@h/x.pcap") == "sftp://ann@h/x.pcap"
    assert shown("https://h/x.pcap?X-Amz-Signature=abc&b=1") == "https://h/x.pcap?…"
    assert shown("what?.pcap") == "what?.pcap"
    assert shown("sftp://ann:secret@h/what?.pcap") == "sftp://ann@h/what?.pcap"  # no query: a part of the name
    assert "secret" not in refused(f"sftp://ann:secret@{LOOPBACK}:{free_port()}/x.pcap")


def test_days_and_patterns_stand_for_the_files_there(tmp_path: Path) -> None:
    for name in ("a-20261030.pcap", "a-20261031.pcap", "a-20261102.pcap", "b[1].pcap", "b1.pcap"):
        (tmp_path / name).write_bytes(b"")
    under = os.fspath(tmp_path) + os.sep
    assert expand([under + "a-{20261031..20261105}.pcap"]) == [under + "a-20261031.pcap", under + "a-20261102.pcap"]
    assert expand([under + "*-{20261030..20261031}.*"]) == [under + "a-20261030.pcap", under + "a-20261031.pcap"]
    assert expand([under + "b[1].pcap", "-", "gone.pcap"]) == [under + "b[1].pcap", "-", "gone.pcap"]
    assert expand([under + "b?.pcap"]) == [under + "b1.pcap"]
    # A file that has the range in its name is that file.
    named = tmp_path / "a-{20261030..20261031}.pcap"
    named.write_bytes(b"")
    assert expand([os.fspath(named)]) == [os.fspath(named)]


def test_a_pattern_finds_what_it_does_in_a_shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names that begin with a dot, as that of an index does, only where it says so; ** outside a part of its own is *."""
    for name in ("a.pcap", ".index", ".old/b.pcap", "day/c.pcap", "day/.part/d.pcap", "day/.e.pcap"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"")
    monkeypatch.chdir(tmp_path)
    for pattern, found in (
        ("*", ["a.pcap", "day"]), (".*", [".index", ".old"]), ("**/*.pcap", ["a.pcap", "day/c.pcap"]),
        ("**.pcap", ["a.pcap"]), ("*/*", ["day/c.pcap"]), ("day/.*", ["day/.e.pcap", "day/.part"]),
        (".old/*", [".old/b.pcap"]), ("day/../*.pcap", ["day/../a.pcap"]),
    ):  # fmt: skip
        assert expand([pattern]) == [os.fspath(Path(name)) for name in found], pattern


def test_what_finds_nothing_is_said(tmp_path: Path) -> None:
    for name, why in (
        ("*.pcap", "no file has such a name"),
        ("a-{2026-11-01..2026-11-09}.pcap", "no file has such a name"),
        ("a-{2026-11-09..2026-11-01}.pcap", "not a range of days"),
        ("a-{2026-11-01..20261109}.pcap", "not a range of days"),
        ("a-{2000-01-01..2026-11-09}.pcap", "not a range of days"),
        ("a-{2026-02-01..2026-02-30}.pcap", "day is out of range for month"),
    ):
        with pytest.raises(CaptureError, match=why):
            expand([os.fspath(tmp_path / name)])


def test_a_pattern_on_the_command_line(capfdbinary: Capture) -> None:
    told = run(capfdbinary, "analyze", "--brief", os.fspath(SZL.parent / "sz[l].pcapng"))
    assert told.out.splitlines()[0].startswith(f"{SZL}: 42 packets")
    missing = run(capfdbinary, "analyze", os.fspath(SZL.parent / "none-*.pcapng"))
    assert (missing.code, missing.out) == (2, "")
    assert missing.err.endswith("none-*.pcapng: no file has such a name\n")


# ---- transports -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("day")
    shutil.copy(SZL, folder)
    shutil.copy(POLL, folder)
    return folder


@pytest.fixture
def nobody_connected() -> Iterator[None]:
    """Forget connections and their credentials, which fsspec keeps for the process."""
    yield
    sshfs = sys.modules.get("sshfs")
    if sshfs is not None:
        sshfs.SSHFileSystem.clear_instance_cache()


def test_openssh(
    day: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    nobody_connected: None,
    capfdbinary: Capture,
) -> None:
    with sftp_server(tmp_path) as port:
        monkeypatch.setenv("HOME", os.fspath(tmp_path / "home"))
        monkeypatch.delenv("SSH_AUTH_SOCK", raising=False)
        here = f"sftp://{LOOPBACK}:{port}{day}"
        assert packets(f"{here}/szl.pcapng") == packets(SZL)
        assert expand([f"{here}/*.pcapng"]) == [f"{here}/{POLL.name}", f"{here}/{SZL.name}"]
        assert expand([f"{here}/sz?.pcapng"]) == [f"{here}/{SZL.name}"]
        odd = day / "a #1?%20\n.pcapng"  # none of it means anything in the name of a file
        shutil.copy(SZL, odd)
        assert expand([f"{here}/a*"]) == [f"{here}/{odd.name}"]
        assert packets(f"{here}/{odd.name}") == packets(SZL)
        odd.unlink()
        assert refused(f"{here}/none.pcapng") == f"{here}/none.pcapng: no such file"
        assert refused(here) == f"{here}: a directory, not a capture file"
        told = run(capfdbinary, "analyze", "--brief", f"{here}/*.pcapng")
        assert told.code == 0
        assert [line.partition(": ")[0] for line in told.out.splitlines()[:2]] == [
            f"{here}/{POLL.name}",
            f"{here}/{SZL.name}",
        ]
        # A host that is not known, and a key that is not allowed.
        sys.modules["sshfs"].SSHFileSystem.clear_instance_cache()
        known = tmp_path / "home" / ".ssh" / "known_hosts"
        kept = known.read_text()
        known.write_text("")
        assert "the host is not known, or is not the known one" in refused(f"{here}/szl.pcapng")
        known.write_text(kept)
        (tmp_path / "authorized_keys").write_text("")
        assert "access refused" in refused(f"{here}/szl.pcapng")
    assert refused(f"{here}/szl.pcapng") == f"{here}/szl.pcapng: cannot be read: Connection refused"


def test_nginx(day: Path, tmp_path: Path) -> None:
    large = day / "large"
    with large.open("wb") as file:
        file.truncate(256 * 1024 * 1024)  # a hole, which takes no room
    with web_server(tmp_path, day) as port:
        here = f"http://{LOOPBACK}:{port}"
        assert packets(f"{here}/szl.pcapng") == packets(SZL)
        assert packets(f"{here}/plain/szl.pcapng?token=abc") == packets(SZL)  # a server without parts
        assert refused(f"{here}/none.pcapng") == f"{here}/none.pcapng: no such file"
        why = "no such file; a web server lists no folders, so a name there is no pattern"
        assert refused(f"{here}/*.pcapng") == f"{here}/*.pcapng: {why}"
        closed = refused(f"{here}/closed/x.pcapng?token=abc")
        assert closed.startswith(f"{here}/closed/x.pcapng?…: access refused (403")
        assert "abc" not in closed
        secure = f"https://{LOOPBACK}:{port}/szl.pcapng"  # where none is spoken
        assert refused(secure) == f"{secure}: cannot be read: TLS failed: wrong version number"
        source = open_remote(f"{here}/large")
        taken = len(source.read(1000))
        assert taken == 1000
    # The server is gone in the middle: what came counts, and the rest is said to be missing.
    while piece := source.read(1 << 20):
        taken += len(piece)
    assert taken < large.stat().st_size
    assert source.damage.startswith(f"reading failed after byte {taken}: ")
    assert source.read(1) == b""
    source.close()
    source.close()
    assert refused(f"{here}/szl.pcapng") == f"{here}/szl.pcapng: cannot be read: Connection refused"


def test_an_object_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    s3fs = pytest.importorskip("s3fs", reason="no s3fs: pip install 's7dissect[test]'")
    with object_store(tmp_path) as port:
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{LOOPBACK}:{port}")
        monkeypatch.setenv("AWS_ACCESS_KEY_ID", "made")
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "up")
        monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        monkeypatch.setenv("HOME", os.fspath(tmp_path))
        bucket = f"s7dissect-{port}"
        store = s3fs.S3FileSystem()
        store.mkdir(bucket)
        for name in DAYS:
            store.put(os.fspath(SZL), f"{bucket}/{name}/szl.pcapng")
        whole = [f"s3://{bucket}/{name}/szl.pcapng" for name in DAYS]
        assert packets(whole[0]) == packets(SZL)
        assert expand([f"s3://{bucket}/{{2026-11-01..2026-11-05}}/*.pcapng"]) == whole
        assert expand([f"s3://{bucket}/{{2026-11-01..2026-11-05}}/szl.pcapng"]) == whole
        assert refused(f"s3://{bucket}/none.pcapng") == f"s3://{bucket}/none.pcapng: no such file"
        with pytest.raises(CaptureError, match="no file has such a name"):
            expand([f"s3://{bucket}/*.zip"])


# ---- what goes wrong elsewhere --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("address", "why"),
    [
        ("sftp://", "the address names no host"),
        ("http:///x.pcap", "the address names no host"),
        ("http://h:99999/x.pcap", "Port out of range 0-65535"),
        ("sftp://h:0/x.pcap", "Port out of range 1-65535"),
    ],
)
def test_an_address_that_cannot_be(address: str, why: str) -> None:
    assert refused(address) == f"{address}: cannot be read: {why}"


@pytest.mark.parametrize("scheme", ["http", "s3"])
def test_a_machine_that_takes_the_connection_and_says_nothing(scheme: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Transports try again, or ask several things: all that together has a limit."""
    pytest.importorskip("s3fs", reason="no s3fs: pip install 's7dissect[test]'")
    with socket.create_server((LOOPBACK, 0)) as mute:
        port = mute.getsockname()[1]
        for name, value in (
            ("AWS_ENDPOINT_URL", f"http://{LOOPBACK}:{port}"), ("AWS_ACCESS_KEY_ID", "a"), ("AWS_SECRET_ACCESS_KEY", "b")
        ):  # fmt: skip
            monkeypatch.setenv(name, value)
        name = f"{scheme}://{LOOPBACK}:{port}/x.pcap" if scheme == "http" else "s3://silent/x.pcap"
        with pytest.raises(CaptureError) as told:
            open_remote(name, 3)
    assert str(told.value) == f"{name}: cannot be read: no answer in time"


def test_a_scheme_that_nobody_knows() -> None:
    assert "Protocol not known: gopher" in refused("gopher://h/x.pcap")


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name == "fsspec" or name.startswith("fsspec.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "fsspec", None)
    told = refused("sftp://h/x.pcap")
    assert (
        told == "sftp://h/x.pcap: a file of another machine, which needs more packages: pip install 's7dissect[remote]'"
    )


def test_a_connection_that_breaks_damages_the_file() -> None:
    class Stream:
        def __init__(self) -> None:
            self.closed = 0

        def read(self, size: int) -> bytes:
            if size == 1:
                raise ConnectionError("peer\x1b[31m gone, see https://h/x?secret=1")
            return b"abc"

        def close(self) -> None:
            self.closed += 1
            raise OSError("already gone")

    source = RemoteSource(Stream())
    assert source.read(8) == b"abc"
    assert source.read(1) == b""
    assert source.damage == "reading failed after byte 3: peer\\x1b[31m gone, see https://h/x?…"
    source.close()
