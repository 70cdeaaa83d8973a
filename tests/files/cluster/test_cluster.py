"""--cluster and cluster-check with a real scheduler, real workers, and captures on real servers; all of it on loopback."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Final, NamedTuple

import pytest
from jsonschema import Draft202012Validator

from dissect.cli.examples import EXAMPLES
from dissect.files.cluster import executor
from dissect.packets.source.files import open_capture
from tests.cli.support import Ran, run
from tests.files.cluster.support import PATIENCE_S, Cluster, Pipes, cluster
from tests.meaning.report.schemas import ROOT, load, strict
from tests.packets.source.craft import Pcap, Recorder, step_to_the_end
from tests.packets.source.servers import LOOPBACK, free_port, object_store, sftp_server, web_server

pytest.importorskip("distributed", reason="no distributed: pip install 's7dissect[test]'")

Capture = pytest.CaptureFixture[bytes]

CAPTURES: Final = ROOT / "captures"
SZL: Final = CAPTURES / "szl.pcapng"
READ: Final = CAPTURES / "read-areas.pcapng"
POLL: Final = CAPTURES / "nodes7-poll-missing.pcapng"
CLOCK: Final = CAPTURES / "clock.pcapng"
SMALL: Final = CAPTURES / "refused-port.pcapng"
CUT: Final = CAPTURES / "crafted" / "cut-pcapng.pcapng"
DIED: Final = "the process that read it ended: it was killed, or there was no memory left"


class Site(NamedTuple):
    """A cluster of two workers, a and b, and captures on three servers; only b, in ``home``, has a key of the SSH server.

    Both have the key of a user of the object store who may use the bucket ``ring``, and no other; ``keys`` are its variables.
    """

    cluster: Cluster
    sftp: str
    http: str
    store: str
    home: Path
    keys: dict[str, str]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    s3fs = pytest.importorskip("s3fs", reason="no s3fs: pip install 's7dissect[test]'")
    folder = tmp_path_factory.mktemp("site")
    day = folder / "day"
    day.mkdir()
    for path in (SZL, POLL, CLOCK):
        shutil.copy(path, day)
    for name in ("keys", "a", "b"):
        (folder / name).mkdir()
    with (
        sftp_server(folder / "keys") as ssh,
        web_server(folder, day) as web,
        object_store(folder, INITIAL_NO_AUTH_ACTION_COUNT="3") as store,
        cluster(folder) as made,
    ):
        url = f"http://{LOOPBACK}:{store}"
        environment = {"AWS_ENDPOINT_URL": url, "AWS_DEFAULT_REGION": "us-east-1", **user_of(url), "SSH_AUTH_SOCK": ""}
        (folder / "a" / ".ssh").mkdir()
        shutil.copy(folder / "keys" / "home" / ".ssh" / "known_hosts", folder / "a" / ".ssh")
        made.begin("a", HOME=os.fspath(folder / "a"), **environment)
        made.begin("b", HOME=os.fspath(folder / "keys" / "home"), **environment)
        keys = {"key": environment["AWS_ACCESS_KEY_ID"], "secret": environment["AWS_SECRET_ACCESS_KEY"]}
        objects = s3fs.S3FileSystem(endpoint_url=url, **keys)
        objects.mkdir("ring")
        objects.put(os.fspath(SZL), "ring/szl.pcapng")
        objects.clear_instance_cache()
        made.wait("a", "b")
        sftp = f"sftp://{LOOPBACK}:{ssh}{day}"
        yield Site(made, sftp, f"http://{LOOPBACK}:{web}", "s3://ring", folder / "keys" / "home", environment)


def user_of(url: str) -> dict[str, str]:
    """Make a user of an object store; return the variables by which tools know its key. It takes three requests."""
    users = pytest.importorskip("boto3").client(
        "iam", endpoint_url=url, region_name="us-east-1", aws_access_key_id="first", aws_secret_access_key="any"
    )
    users.create_user(UserName="made")
    key = users.create_access_key(UserName="made")["AccessKey"]
    rights = {"Effect": "Allow", "Action": "s3:*", "Resource": ["arn:aws:s3:::ring", "arn:aws:s3:::ring/*"]}
    policy = json.dumps({"Version": "2012-10-17", "Statement": [rights]})
    users.put_user_policy(UserName="made", PolicyName="ring", PolicyDocument=policy)
    return {"AWS_ACCESS_KEY_ID": key["AccessKeyId"], "AWS_SECRET_ACCESS_KEY": key["SecretAccessKey"]}


def lines_without_place(told: str) -> list[str]:
    """Return the lines of stderr, without the workers that are named in them."""
    return [re.sub(r" \(worker \w+ on \S+\)$", "", line) for line in told.splitlines()]


def both(capfdbinary: Capture, site: Site, *arguments: str | Path) -> Ran:
    """Run a command here and on the cluster, compare, and return what the cluster did."""
    here = run(capfdbinary, *arguments)
    there = run(capfdbinary, *arguments, "--cluster", site.cluster.address)
    assert there.out == here.out
    assert (there.code, sorted(lines_without_place(there.err))) == (here.code, sorted(here.err.splitlines()))
    return there


# ---- who is there ---------------------------------------------------------------------------------------------------


def test_a_sound_cluster(capfdbinary: Capture, site: Site) -> None:
    """As in the examples of the help, and as JSON."""
    for line in EXAMPLES["cluster-check"]:
        words = line.replace("tcp://scheduler:8786", site.cluster.address).split()
        ran = run(capfdbinary, *words[1:])
        assert (ran.code, ran.err) == (0, "")
        if "json" not in words:
            assert ran.out.splitlines()[-1] == "2 of 2 workers can be used, 2 files at the same time"
            assert re.search(r"^worker a on \S+, tcp://127\.0\.0\.1:\d+$", ran.out, re.MULTILINE)
            continue
        told = json.loads(ran.out)
        Draft202012Validator(strict(load("cluster-check"))).validate(told)
        assert [(worker["name"], worker["usable"], worker["lacks"]) for worker in told["workers"]] == [
            ("a", True, []),
            ("b", True, []),
        ]
        assert told["workers"][0]["machine"] == told["here"]
        assert {worker["dask"] for worker in told["workers"]} == {version("distributed")}


def test_a_worker_of_another_version(capfdbinary: Capture, site: Site, tmp_path: Path) -> None:
    """It gets no file, it is named, and the others do all there is to do."""
    older = tmp_path / "dissect"
    older.mkdir()
    (older / "__init__.py").write_text('__version__ = "0.0.7"\n', encoding="ascii")
    site.cluster.begin("old", PYTHONPATH=os.fspath(tmp_path))
    site.cluster.wait("old")
    try:
        checked = run(capfdbinary, "cluster-check", site.cluster.address)
        ran = run(capfdbinary, "analyze", "--separate", "--brief", SZL, "--cluster", site.cluster.address)
    finally:
        site.cluster.end("old")
    assert checked.code == 1
    assert "  cannot be used: has s7dissect 0.0.7, here is " in checked.out
    assert checked.out.splitlines()[-1] == "2 of 3 workers can be used, 2 files at the same time"
    assert ran.code == 3
    assert re.fullmatch(r"s7dissect: worker old on \S+: has s7dissect 0\.0\.7, here is \S+; pip install \S+\n", ran.err)
    assert ran.out.startswith(f"{SZL}: 42 packets")


def test_nobody_can_be_used(capfdbinary: Capture, site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    from dissect.files.cluster import workers

    monkeypatch.setattr(
        "dissect.files.cluster.workers.here", lambda: workers.Machine("h", 1, "3.11", "9.9", True, "", [])
    )
    monkeypatch.setattr("dissect.cli.cluster.here", lambda: workers.Machine("h", 1, "3.11", "9.9", True, "", []))
    ran = run(capfdbinary, "analyze", "--separate", SZL, "--cluster", site.cluster.address)
    assert (ran.code, ran.out) == (2, "")
    said = ran.err.splitlines()
    assert [line.partition(" on ")[0] for line in said[:2]] == ["s7dissect: worker a", "s7dissect: worker b"]
    assert said[-1] == f"Error: {site.cluster.address}: no worker of the cluster can be used"
    assert run(capfdbinary, "cluster-check", site.cluster.address).code == 1


def test_no_scheduler(capfdbinary: Capture, site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody listens, no such name, an open port that is a web server, and a cluster that wants no certificates."""
    closed = f"tcp://{LOOPBACK}:{free_port()}"
    for address, why in (
        (closed, "no scheduler can be reached there: Connection refused"),
        ("tcp://no.such.host.invalid:8786", "no scheduler can be reached there: "),
        (site.http.replace("http", "tcp"), "it does not answer as a Dask scheduler"),
        (site.cluster.address.replace("tcp", "tls"), "certificates are those of Dask's own settings"),
    ):
        begun = time.monotonic()
        for arguments in (("cluster-check", address), ("analyze", "--separate", str(SZL), "--cluster", address)):
            ran = run(capfdbinary, *arguments)
            assert (ran.code, ran.out) == (2, "")
            assert ran.err.startswith(f"Error: {address}: ")
            assert why in ran.err
            assert ran.err.count("\n") == 1
            if address != closed:
                break
        assert time.monotonic() - begun < PATIENCE_S
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    ran = run(capfdbinary, "cluster-check", closed)
    assert (ran.code, ran.err) == (2, "Error: a cluster needs Dask: pip install 's7dissect[cluster]'\n")


def test_a_full_disk_is_one_line(site: Site) -> None:
    with open("/dev/full", "wb") as full:  # noqa: PTH123 - a device
        command = [sys.executable, "-m", "dissect", "cluster-check", site.cluster.address]
        ran = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (5, "s7dissect: cannot write the results: No space left on device\n")


# ---- results --------------------------------------------------------------------------------------------------------


def test_workers_find_what_one_process_finds(
    capfdbinary: Capture, site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a file that is no capture, one that is cut, one that is not there, tags, and settings of this folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s7dissect.toml").write_text("slow = 0\n", encoding="ascii")
    (tmp_path / "text.pcap").write_text("this is no capture, but long enough to be looked at")
    shutil.copy(SZL, "relative.pcapng")
    tls = CAPTURES / "s7plus" / "s7commplus-tls.pcapng"
    files: list[str | Path] = ["relative.pcapng", SZL, tls, POLL, CUT, "text.pcap", "gone.pcap"]
    tags = CAPTURES / "tags" / "valve.csv"
    ran = both(capfdbinary, site, "analyze", "--separate", "-T", "json", "--tags", tags, "-Y", "not tag == x", *files)
    assert ran.code == 3
    assert sum(["gone.pcap: no such file (worker " in line for line in ran.err.splitlines()]) == 1
    assert sum([f"{CUT}: cut off" in line for line in ran.err.splitlines()]) == 1
    devices = both(capfdbinary, site, "devices", "--separate", "-T", "json", "--tags", tags, *files)
    assert (devices.code, len(json.loads(devices.out)["devices"]) > 1) == (3, True)


def test_two_hundred_files(capfdbinary: Capture, site: Site, tmp_path: Path) -> None:
    """One cut, one that cannot be read: both named, the others as they are, each of them read once."""
    for number in range(200):
        (tmp_path / f"{number:03}.pcapng").symlink_to(SMALL)
    for name, content in (("100.pcapng", CUT.read_bytes()), ("150.pcapng", b"no capture, nor anything like it")):
        (tmp_path / name).unlink()
        (tmp_path / name).write_bytes(content)
    arguments = ["analyze", "--separate", "-T", "json", str(tmp_path / "*.pcapng")]
    ran = run(capfdbinary, *arguments, "--cluster", site.cluster.address)
    assert ran.code == 3
    found = json.loads(ran.out)
    names = [file["name"] for file in found["files"]]  # in the order of time, what cannot be read last
    assert sorted(names) == [str(tmp_path / f"{number:03}.pcapng") for number in range(200)]
    assert names[-1].endswith("150.pcapng")
    small, cut = (json.loads(run(capfdbinary, "analyze", "-T", "json", path).out) for path in (SMALL, CUT))
    packets = 198 * small["packets"]["read"] + cut["packets"]["read"]
    assert found["packets"]["read"] == packets > 198
    assert len(found["connections"]) == 198 * len(small["connections"]) + len(cut["connections"])
    said = ran.err.splitlines()
    assert [line.partition(": ")[2].partition(": ")[0][-10:] for line in said[:2]] == ["100.pcapng", "150.pcapng"]


def test_a_ring_of_forty_files(capfdbinary: Capture, site: Site, tmp_path: Path) -> None:
    """Its connections go on from file to file: the run that joins them finds what the whole has, --separate says so."""
    recorder = Recorder()
    reader = open_capture(READ)
    step_to_the_end(reader, recorder)
    reader.close()
    count = -(-len(recorder.frames) // 40)
    names = []
    for number in range(40):
        piece = Pcap(nanoseconds=True)
        for frame in recorder.frames[number * count : (number + 1) * count]:
            piece.packet(frame.time_ns, frame.octets)
        names.append(tmp_path / f"ring-{number:02}.pcap")
        names[-1].write_bytes(piece.octets)
    whole, joined = (json.loads(run(capfdbinary, "analyze", "-T", "json", *files).out) for files in ([READ], names))
    for key in ("transactions", "functions"):
        assert joined[key] == whole[key]
    ends = [
        [(one["client"], one["first_time"], one["last_time"]) for one in made["connections"]]
        for made in (whole, joined)
    ]
    assert ends[0] == ends[1]
    ran = run(capfdbinary, "analyze", "--separate", "-T", "json", *names, "--cluster", site.cluster.address)
    assert re.match(
        r"s7dissect: \d+ files go on where the file before ends; .* Without --separate they are followed\.", ran.err
    )
    found = json.loads(ran.out)
    assert found["packets"]["read"] == whole["packets"]["read"]
    assert len(found["connections"]) > len(whole["connections"])


def test_captures_on_servers(capfdbinary: Capture, site: Site) -> None:
    """Of a web server and an object store."""
    files = [
        f"{site.http}/szl.pcapng",
        f"{site.store}/szl.pcapng",
        f"{site.http}/gone.pcapng",
        f"{site.http}/closed/x.pcapng",
    ]
    ran = run(capfdbinary, "analyze", "--separate", "-T", "json", *files, "--cluster", site.cluster.address)
    assert ran.code == 3
    found = json.loads(ran.out)
    assert [file["packets"] for file in found["files"]] == [42, 42, 0, 0]
    said = ran.err.splitlines()
    assert said[0].startswith(f"s7dissect: {files[2]}: no such file (worker ")
    assert said[1].startswith(f"s7dissect: {files[3]}: access refused (403")
    assert len(said) == 2


def test_credentials_that_are_refused(capfdbinary: Capture, site: Site) -> None:
    """One line for each file, with the machine; no password is shown. The right ones read."""
    asks = site.http.replace("//", "//{}@") + "/asks/szl.pcapng"
    files = [
        "s3://closed/szl.pcapng",
        site.sftp.replace("//", "//nobody-of-ours@") + "/szl.pcapng",
        f"{site.http}/asks/szl.pcapng",
        asks.format("made:dOwN"),
        asks.format("made:up"),
    ]
    ran = run(capfdbinary, "analyze", "--separate", "-T", "json", *files, "--cluster", site.cluster.address)
    assert ran.code == 3
    assert [file["packets"] for file in json.loads(ran.out)["files"]] == [0, 0, 0, 0, 42]
    shown = [*files[:3], files[3].replace(":dOwN", "")]
    said = ran.err.splitlines()
    assert len(said) == len(shown)
    assert re.fullmatch(rf"s7dissect: {shown[0]}: no permission to read it \(worker [ab] on \S+\)", said[0])
    own, address = "those of the transport's own tools", "what the address holds: https://USER:PASSWORD@HOST/…"
    for line, name, whose in zip(said[1:], shown[1:], (own, address, address), strict=True):
        assert line.startswith(f"s7dissect: {name}: access refused (")
        assert re.search(rf"; credentials are {re.escape(whose)} \(worker [ab] on \S+\)$", line)
    assert "dOwN" not in ran.err + ran.out


def test_verify(capfdbinary: Capture, site: Site) -> None:
    """Wireshark is asked on the workers."""
    if shutil.which("tshark") is None:
        pytest.skip("no tshark: scripts/install-tools.sh installs it")
    ran = both(capfdbinary, site, "verify", "--separate", SZL, CLOCK, CUT)
    assert (ran.code, ran.out.count(".pcapng: ")) == (3, 3)


def test_a_worker_that_may_not_read_what_another_may(capfdbinary: Capture, site: Site) -> None:
    """Worker a has no key: it is named with the file, worker b reads it; after three files a is given no more.

    That it cannot read one is known when b has read it: until then a slow machine lets a try another.
    """
    files = [
        f"{site.sftp}/{name}" for name in ("szl.pcapng", "clock.pcapng", "szl.pcapng", "clock.pcapng", "szl.pcapng")
    ]
    ran = run(capfdbinary, "analyze", "--separate", "-T", "json", *files, "--cluster", site.cluster.address)
    assert ran.code == 3
    assert [file["packets"] for file in json.loads(ran.out)["files"]] == [42, 20, 42, 20, 42]
    refused = [line for line in ran.err.splitlines() if "access refused" in line]
    assert refused
    for line in refused:
        assert line.startswith(f"s7dissect: {site.sftp}/")
        assert re.search(r"\w\.pcapng: access refused \(.*\).*; another worker read it \(worker a on \S+\)$", line)
    assert ("worker a on" in ran.err and "gets no more files" in ran.err) == (len(refused) >= 3)


def test_rows_and_tables(capfdbinary: Capture, site: Site, tmp_path: Path) -> None:
    """Rows come back and are written here; Parquet files are written by the workers."""
    files = [SZL, POLL, CUT, CLOCK, tmp_path / "gone.pcap"]
    rows = both(capfdbinary, site, "transactions", "--separate", "-T", "jsonl", *files)
    assert rows.code == 3
    assert (
        sum([line.endswith(")") and "gone.pcap: no such file (worker " in line for line in rows.err.splitlines()]) == 1
    )
    assert both(capfdbinary, site, "values", "--separate", "-T", "csv", POLL, READ).out.count("\n") > 2
    for name in ("tables.csv", "tables.parquet"):
        made = []
        for place, more in (("here", ()), ("there", ("--cluster", site.cluster.address))):
            (tmp_path / place).mkdir(exist_ok=True)
            out = tmp_path / place / name
            ran = run(capfdbinary, "export", "--separate", *files, "-o", out, *more)
            assert ran.code == 3
            made.append({path.relative_to(out): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()})
        assert made[0] == made[1]
        assert len(made[0]) > 3


def test_parquet_on_other_machines(
    capfdbinary: Capture, site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Workers write it there: the files that one process writes there, with the rows that it writes here."""
    fsspec, parquet = pytest.importorskip("fsspec"), pytest.importorskip("pyarrow.parquet")
    for name, value in {**site.keys, "HOME": os.fspath(site.home)}.items():
        monkeypatch.setenv(name, value)
    there = ("--cluster", site.cluster.address)
    fsspec.get_filesystem_class("s3").clear_instance_cache()
    store = fsspec.filesystem("s3")
    files = ("export", "--separate", SZL, CUT, POLL, CLOCK, tmp_path / "gone.pcap", "-o")
    local = tmp_path / "tables.parquet"
    assert run(capfdbinary, *files, local).code == 3

    def made(name: str) -> dict[str, bytes]:
        store.invalidate_cache()
        return {path.partition(f"{name}/")[2]: store.cat(path) for path in store.find(f"ring/{name}")}

    for name, more in (("one.parquet", ()), ("out.parquet", there)):
        ran = run(capfdbinary, *files, f"s3://ring/{name}", *more)
        assert ran.code == 3
        assert ran.err.splitlines()[-1].endswith(f" written to s3://ring/{name}")
    objects = made("out.parquet")
    assert objects == made("one.parquet")
    assert {name.partition("/")[0] for name in objects} == {path.name for path in local.iterdir()}
    for table in ("transactions", "values", "devices"):
        ours = [parquet.ParquetFile(path).read() for path in sorted((local / table).rglob("*.parquet"))]
        theirs = [
            parquet.ParquetFile(io.BytesIO(objects[name])).read()
            for name in sorted(objects)
            if name.startswith(f"{table}/")
        ]
        assert [one.to_pylist() for one in theirs] == [one.to_pylist() for one in ours]
    # What is there is kept, or replaced as a whole; one run writes there as well.
    ran = run(capfdbinary, *files, "s3://ring/out.parquet")
    assert (ran.code, ran.err.splitlines()[-1]) == (2, "Error: s3://ring/out.parquet exists; --force overwrites it.")
    ran = run(capfdbinary, "export", SZL, "--only", "items", "-o", "s3://ring/out.parquet", "--force")
    assert (ran.code, sorted(made("out.parquet"))) == (0, ["items.parquet", "s7dissect.json"])
    assert run(capfdbinary, "export", SZL, "-o", "parquet:s3://ring", "--force").err.splitlines()[-1] == (
        "Error: s3://ring holds files that no export wrote; choose another OUT."
    )
    # Worker a has no key of the SSH server: its files are done by b.
    out = f"{site.sftp}/out.parquet"
    ran = run(capfdbinary, "export", "--separate", SZL, POLL, "-o", out, *there)
    assert ran.code == 3
    assert re.match(rf"s7dissect: \S+: its rows cannot be written to {out}: access refused .* \(worker a on ", ran.err)
    folder = Path(f"/{site.sftp.split('/', 3)[3]}", "out.parquet")
    parts = [path.name for path in sorted((folder / "transactions").rglob("*.parquet"))]
    assert parts == ["part-0001-0001.parquet", "part-0002-0001.parquet"]
    assert not (folder / "s7dissect-unfinished").exists()


def test_what_is_not_written_on_other_machines(
    capfdbinary: Capture, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line each, before anything is read."""
    for name, value in site.keys.items():
        monkeypatch.setenv(name, value)
    pytest.importorskip("s3fs").S3FileSystem.clear_instance_cache()
    for out, why in (
        ("s3://closed/x.parquet", "s7dissect: s3://closed/x.parquet: "),
        (
            f"{site.http}/x.parquet",
            f"Error: {site.http}/x.parquet: captures can be read over HTTP, and nothing written",
        ),
        ("s3://ring/x.sqlite", "Error: s3://ring/x.sqlite: SQLite database is written on this machine"),
        (f"sftp://u:dOwN@{LOOPBACK}:{free_port()}/x.parquet", f"s7dissect: sftp://u@{LOOPBACK}:"),
    ):
        ran = run(capfdbinary, "export", "--separate", "no-such.pcap", "-o", out)
        assert (ran.code, ran.out) == (2, "")
        assert ran.err.splitlines()[-1].startswith(why)
        assert "no-such" not in ran.err
        assert "dOwN" not in ran.err


#: Runs a command whose processes can write no file of more than 4 kB.
LITTLE_ROOM: Final = """
import os, resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
os.execv(sys.argv[1], sys.argv[1:])
"""


def test_a_worker_without_room(capfdbinary: Capture, site: Site, tmp_path: Path) -> None:
    """The file whose rows it cannot write is named with it, and another worker does it; nothing is missing."""
    files = [SZL, CLOCK, READ]
    out = [tmp_path / name / "tables.parquet" for name in ("here", "there")]
    for path in out:
        path.parent.mkdir()
    assert run(capfdbinary, "export", "--separate", *files, "-o", out[0]).code == 0
    site.cluster.begin("little", sys.executable, "-c", LITTLE_ROOM)
    site.cluster.wait("little")
    try:
        ran = run(capfdbinary, "export", "--separate", *files, "-o", out[1], "--cluster", site.cluster.address)
    finally:
        site.cluster.end("little")
    assert ran.code == 3
    said = re.escape(f"s7dissect: {READ}: its rows cannot be written to {out[1]}: File too large")
    assert re.fullmatch(rf"{said}; another worker read it \(worker little on \S+\)", ran.err.splitlines()[0])
    assert ran.err.count("cannot be") == 1
    made = [{path.relative_to(one): path.read_bytes() for path in one.rglob("*.parquet")} for one in out]
    assert made[0] == made[1]


def test_workers_do_not_open_what_the_index_rules_out(capfdbinary: Capture, site: Site, tmp_path: Path) -> None:
    """A capture that nobody could read any more is not missed."""
    for path in (SZL, CLOCK):
        shutil.copy(path, tmp_path)
    run(capfdbinary, "index", tmp_path)
    size, time_ns = (tmp_path / CLOCK.name).stat().st_size, (tmp_path / CLOCK.name).stat().st_mtime_ns
    (tmp_path / CLOCK.name).write_bytes(bytes(size))
    os.utime(tmp_path / CLOCK.name, ns=(time_ns, time_ns))
    files = (tmp_path / SZL.name, tmp_path / CLOCK.name)
    ran = both(capfdbinary, site, "transactions", "--separate", "--indexed", "-Y", "port == 52228", *files)
    assert (ran.code, ran.err.count("not opened")) == (0, 1)
    assert ran.out.count("\n") > 1


def test_a_cluster_takes_captures_of_their_own(capfdbinary: Capture, site: Site) -> None:
    for command in ("analyze", "transactions", "values"):
        ran = run(capfdbinary, command, SZL, "--cluster", site.cluster.address)
        assert (ran.code, ran.out) == (2, "")
        assert "--cluster has each file read by one of its workers, and needs --separate" in ran.err


# ---- who dies -------------------------------------------------------------------------------------------------------


def begun(site: Site, *arguments: str | Path) -> subprocess.Popen[str]:
    """Start a command on the cluster."""
    command = [sys.executable, "-m", "dissect", *map(str, arguments), "--cluster", site.cluster.address]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_a_worker_that_is_killed(capfdbinary: Capture, site: Site, tmp_path: Path) -> None:
    """What it was reading is read once more by another, which is said; the result is that of one process."""
    pipes = Pipes(tmp_path / "x.pcapng", tmp_path / "y.pcapng")
    with begun(site, "analyze", "--separate", "-T", "json", *pipes.paths, CLOCK) as command:
        pipes.await_readers()
        site.cluster.end("a", kill=True)
        lost = pipes.without_reader()
        (other,) = set(pipes.paths) - {lost}
        pipes.feed(other, POLL)
        pipes.feed(lost, SZL)
        out, err = command.communicate()
    site.cluster.begin("a", HOME=os.fspath(site.cluster.folder / "a"))
    said = err.splitlines()
    assert re.fullmatch(rf"s7dissect: {lost}: {DIED}; it is read once more \(worker a on \S+\)", said[0])
    assert len(said) == 2  # the other one: a file goes on where the one before ends
    assert command.returncode == 0
    for path in pipes.paths:
        path.unlink()
    lost.symlink_to(SZL)
    other.symlink_to(POLL)
    assert run(capfdbinary, "analyze", "--separate", "-T", "json", *pipes.paths, CLOCK).out == out
    site.cluster.wait("a")


def test_a_worker_that_joins_later(capfdbinary: Capture, site: Site, tmp_path: Path) -> None:
    """It is given a file while the others are busy."""
    pipes, later = Pipes(tmp_path / "x.pcapng", tmp_path / "y.pcapng"), Pipes(tmp_path / "z.pcapng")
    files = [*pipes.paths, *later.paths]
    with begun(site, "analyze", "--separate", "-T", "json", *files) as command:
        pipes.await_readers()
        site.cluster.begin("late")
        later.await_readers()
        for some in (later, pipes):
            for path in some.paths:
                some.feed(path, CLOCK)
        out, err = command.communicate()
    site.cluster.end("late")
    assert (command.returncode, err) == (0, "")
    for path in files:
        path.unlink()
        path.symlink_to(CLOCK)
    assert run(capfdbinary, "analyze", "--separate", "-T", "json", *files).out == out


def test_a_scheduler_that_falls_silent(
    capfdbinary: Capture, site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It keeps its connections, and does nothing any more."""
    monkeypatch.setattr(executor, "SILENCE_S", 1)
    monkeypatch.setattr(executor, "_ASK_S", 0.1)
    pipes = Pipes(tmp_path / "x.pcapng", tmp_path / "y.pcapng")

    def stop() -> None:
        pipes.await_readers()
        site.cluster.scheduler.send_signal(signal.SIGSTOP)

    stopping = threading.Thread(target=stop)
    stopping.start()
    try:
        files = [CLOCK, *pipes.paths, SZL]
        ran = run(capfdbinary, "analyze", "--separate", "--brief", *files, "--cluster", site.cluster.address)
    finally:
        stopping.join()
        site.cluster.scheduler.send_signal(signal.SIGCONT)
        pipes.close()
    assert ran.code == 3
    silent = f"the scheduler {site.cluster.address} has not answered for 1 seconds"
    assert ran.err.splitlines() == [f"s7dissect: {file}: {silent}" for file in (*pipes.paths, SZL)]
    assert ran.out.startswith(f"{CLOCK}: 20 packets")


def test_a_scheduler_that_is_gone(capfdbinary: Capture, site: Site, tmp_path: Path) -> None:
    """Each file that was not read is named; what was read is in the result. The last test of this cluster."""
    pipes = Pipes(tmp_path / "x.pcapng", tmp_path / "y.pcapng")
    with begun(site, "analyze", "--separate", "--brief", CLOCK, *pipes.paths, SZL) as command:
        pipes.await_readers()
        site.cluster.scheduler.kill()
        out, err = command.communicate()
    pipes.close()
    assert command.returncode == 3
    lost = f"the connection to the scheduler {site.cluster.address} was lost"
    assert err.splitlines() == [f"s7dissect: {file}: {lost}" for file in (*pipes.paths, SZL)]
    assert out.startswith(f"{CLOCK}: 20 packets")
