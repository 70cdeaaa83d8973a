"""Every capture there is, made anonymous: each packet in its place, the same analysis, and no text or address of the plant.

What must not be there is gathered by tshark and from the octets of the files themselves, not by what anonymizes.
"""

from __future__ import annotations

import re
import subprocess
import zlib
from collections import Counter
from collections.abc import Iterator
from ipaddress import ip_address
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

import pytest

import dissect
from dissect.engine.transactions.transaction import Transaction
from dissect.files.anonymize.account import KEEP, MASK, Choices
from dissect.files.anonymize.key import Key
from dissect.packets.source.files import open_capture
from dissect.packets.source.pcapng_writer import PcapngWriter
from tests.files.anonymize.support import BLANKED, KEY, anonymized, told
from tests.meaning.report.support import OWN, ROOT
from tests.packets.source.craft import Frame, drain

#: What analyses differ in, by capture: findings that lean on octets which nobody knows the meaning of, and which are zeros now.
DIFFER: Final = {
    "conflicts.pcapng": {"stream.conflict"},  # two copies differ in a value, which is zero in both
    "ip-fragments.pcapng": {"ip.fragment_conflict"},  # so do two fragments
    "cut-gzip.pcap.gz": {"capture.damaged"},  # what is written is whole
    "cut-pcap.pcap": {"capture.damaged"},
    "cut-pcapng.pcapng": {"capture.damaged"},
    "look-alikes.pcapng": {"tpkt.garbage", "cotp.malformed", "session.foreign_on_102"},  # what they look like is gone
    "rdp-proprietary-encryption.pcap": {"tpkt.garbage", "cotp.malformed", "cotp.bad_start"},
    "program.pcapng": {"block.inconsistent", "block.system_call"},  # the code of blocks is zeros, which is no code
    "program-python.pcapng": {"block.inconsistent"},
    "netlink-faults.pcapng": {"ibh.malformed", "transaction.unanswered"},  # see `GARBAGE`
    "s7-lengths.pcapng": {"transaction.size_mismatch"},
    "s7commplus-tls.pcapng": {
        "security.write",
        "transaction.item_error",
        "s7plus.malformed",
        "session.encrypted",
    },  # keys are dropped
    "s7commplus.pcapng": {"security.write", "transaction.item_error", "s7plus.malformed"},
    "tpkt-faults.pcapng": {"tpkt.garbage", "tpkt.unfinished"},  # of a header that is not whole nothing stays
}
#: Octets between IBH-NetLink packets become zeros, which may begin one: a packet behind them is found later than before.
GARBAGE: Final = "netlink-faults.pcapng"
#: Texts of the protocol and the products, by which nobody knows a plant.
ALLOWED: Final = re.compile(
    rb"_?0[0-9A-F]{6}[0-9A-F]?[ABP]|1?[0-9]{7,12}|6ES7 [0-9A-Z -]+|[0-9]{1,2}-[0-9][A-Z]{2}[0-9] ?|Boot Loader *|P_PROGRAM"
    rb"|SIMATIC-ROOT-HMI|_N_[A-Z_]{6}|6ES7 3"
)
TEXT: Final = re.compile(rb"[A-Za-z0-9 ._/#:@-]{6,}")
#: A run of octets like a text happens by chance in times and checksums that go up; a text has letters beside each other.
WORD: Final = re.compile(rb"[A-Za-z]{4}|[0-9]{4}")

ADDRESSES: Final = (
    "eth.src", "eth.dst", "sll.src.eth", "ip.src", "ip.dst", "ipv6.src", "ipv6.dst", "arp.src.hw_mac", "arp.src.proto_ipv4",
    "arp.dst.proto_ipv4",
)  # fmt: skip
TEXTS: Final = (
    "cotp.src-tsap", "cotp.dst-tsap", "s7comm.blockinfo.author", "s7comm.blockinfo.family", "s7comm.blockinfo.headername",
    "s7comm.cpu.msg.username", "s7comm.data.ncprg.filepath", "s7comm.szl.001c.0001.name", "s7comm.szl.001c.0002.name",
    "s7comm.szl.001c.0003.tag", "s7comm.szl.001c.0004.copyright", "s7comm.szl.001c.0005.serialn",
    "s7comm.szl.001c.0008.snmcmmc", "s7comm.szl.001c.000b.loc_id", "dns.qry.name", "frame.interface_description",
)  # fmt: skip
#: Heads of blocks and of SCD messages, of which the numbers stay.
KNOWN: Final = (b"pp", b"\xdc")
OCTETS: Final = ("s7comm.resp.data", "udp.payload")
CHECKSUMS: Final = ("ip.checksum.status", "tcp.checksum.status", "udp.checksum.status", "tcp.len", "frame.len")

Rows = list[list[str]]


class Made(NamedTuple):
    source: Path
    masked: Path
    kept: Path


def make(directory: Path, sources: list[Path]) -> list[Made]:
    made = []
    for source in sources:
        one = Made(source, directory / f"{source.name}.mask.pcapng", directory / f"{source.name}.keep.pcapng")
        for path, values in ((one.masked, MASK), (one.kept, KEEP)):
            account = anonymized(source, path, Choices(values, keep_code=values == KEEP, keep_others=True))
            assert account.dropped == {}
        made.append(one)
    return made


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> list[Made]:
    return make(tmp_path_factory.mktemp("own"), OWN)


@pytest.fixture(scope="module")
def public(tmp_path_factory: pytest.TempPathFactory, corpus: Path) -> list[Made]:
    return make(tmp_path_factory.mktemp("public"), sorted(path for path in corpus.iterdir() if "pcap" in path.suffix))


def test_our_captures(own: list[Made]) -> None:
    for one in own:
        judge(one)


def test_public_captures(public: list[Made]) -> None:
    assert len(public) > 10
    for one in public:
        judge(one)


def judge(one: Made) -> None:
    name = one.source.name
    before = frames(one.source)
    for out in (one.masked, one.kept):
        assert [shape(frame) for frame in frames(out)] == [shape(frame) for frame in before], name
        if name != GARBAGE and name not in BLANKED:
            assert told(out) == told(one.source), name
        slugs, others = findings(one.source), findings(out)
        differ = {slug for slug in slugs.keys() | others.keys() if slugs[slug] != others[slug]}
        assert differ <= DIFFER.get(name, set()), name
    assert surviving_texts(one.source, one.masked) == [], name
    if name not in {
        GARBAGE,
        "s7-lengths.pcapng",
        *BLANKED,
    }:  # of PDUs whose lengths contradict each other nothing is known
        assert values(one.kept) == values(one.source), name


def frames(path: Path) -> list[Frame]:
    return drain(open_capture(str(path))).frames


def shape(frame: Frame) -> tuple[int, int, int, int]:
    return frame.time_ns, len(frame.octets), frame.wire_length, frame.link_type


def findings(path: Path) -> Counter[str]:
    return Counter(finding.slug for finding in dissect.analyze(str(path)).findings)


def values(path: Path) -> list[bytes | None]:
    return [
        result.data
        for event in dissect.open(str(path), pdus=False)
        if isinstance(event, Transaction)
        for result in event.s7_results
    ]


def surviving_texts(source: Path, out: Path) -> list[bytes]:
    """Return texts anywhere in the file ``source``, its comments and options included, that stand in ``out``."""
    written = out.read_bytes()
    return [
        text
        for text in set(TEXT.findall(unpacked(source)))
        if WORD.search(text) and text in written and not ALLOWED.fullmatch(text)
    ]


def unpacked(path: Path) -> bytes:
    octets = path.read_bytes()
    if path.suffix == ".gz":
        return zlib.decompressobj(31).decompress(octets)
    if path.suffix == ".zst":
        zstandard = pytest.importorskip("zstandard")
        return bytes(zstandard.ZstdDecompressor().decompress(octets, max_output_size=1 << 24))
    return octets


# ---- what tshark knows ----------------------------------------------------------------------------------------------


def test_tshark_finds_the_same_checksums_and_nothing_of_ours_in_what_was_written(
    own: list[Made], tmp_path: Path
) -> None:
    inspect(own, *both(own, tmp_path))


@pytest.fixture(scope="module")
def seen(public: list[Made], tmp_path_factory: pytest.TempPathFactory) -> tuple[Rows, Rows]:
    return both(public, tmp_path_factory.mktemp("seen"))


def test_tshark_finds_the_same_checksums_and_nothing_of_public_captures(
    public: list[Made], seen: tuple[Rows, Rows]
) -> None:
    inspect(public, *seen)


def both(captures: list[Made], directory: Path) -> tuple[Rows, Rows]:
    """Return what tshark says of captures before and after."""
    before = tshark([one.source for one in captures], directory / "before.pcapng")
    return before, tshark([one.masked for one in captures], directory / "after.pcapng")


def inspect(captures: list[Made], before: Rows, after: Rows) -> None:
    wrong = [
        (row[:5], other[:5])
        for row, other in zip(before, after, strict=True)
        if row[:5] != other[:5] and (row[0], other[0]) != ("2", "")  # a header that cannot be read is blank
    ]
    assert wrong == []
    rows = iter(before)
    for one in captures:
        secrets: set[bytes] = set()
        for _ in frames(one.source):
            secrets |= set(secrets_of(next(rows)))
        written = one.masked.read_bytes()
        assert [secret for secret in secrets if secret in written and not ALLOWED.fullmatch(secret)] == [], one.source


def tshark(paths: list[Path], joined: Path) -> Rows:
    """Return the fields of all packets of some captures, which are put into one for the purpose."""
    writer = PcapngWriter(str(joined), overwrite=True)
    for path in paths:
        for frame in frames(path):
            writer.packet(frame.time_ns, frame.octets, frame.wire_length, frame.link_type)
    writer.close()
    fields = [word for field in (*CHECKSUMS, *ADDRESSES, *TEXTS, *OCTETS) for word in ("-e", field)]
    checks = [word for kind in ("ip", "tcp", "udp") for word in ("-o", f"{kind}.check_checksum:TRUE")]
    command = ["tshark", "-r", str(joined), *checks, "-T", "fields", "-E", "aggregator=\x1f", *fields]
    ran = subprocess.run(command, capture_output=True, check=True)
    return [line.split("\t") for line in ran.stdout.decode("utf-8", "surrogateescape").split("\n")[:-1]]


def secrets_of(row: list[str]) -> Iterator[bytes]:
    """Give the octets of a packet that are to be gone: addresses that do not stay, texts, long values."""
    cells = iter(row[len(CHECKSUMS) :])
    for _ in ADDRESSES:
        for text in filter(None, next(cells).split("\x1f")):
            if ":" in text and len(text) == 17:
                octets = bytes.fromhex(text.replace(":", ""))
                stays = octets[0] & 1
            else:
                address = ip_address(text)
                octets = address.packed
                stays = address.is_loopback or address.is_multicast or address.is_unspecified or octets[0] in {0, 255}
            if not stays and len(set(octets)) > 3:
                yield octets
    for _ in TEXTS:
        for text in next(cells).split("\x1f"):
            core = text.encode("utf-8", "surrogateescape").strip(b" \0")
            if len(core) >= 4 and not core.startswith(b"0x"):
                yield core
    for _ in OCTETS:
        for text in re.split("[\x1f,]", next(cells)):
            octets = bytes.fromhex(text)
            if len(octets) >= 12 and len(set(octets)) > 6 and not octets.startswith(KNOWN):
                yield octets


# ---- keys -----------------------------------------------------------------------------------------------------------


def test_the_key_alone_decides(own: list[Made], tmp_path: Path) -> None:
    again, other = tmp_path / "again.pcapng", tmp_path / "other.pcapng"
    for one in own[::12]:
        anonymized(one.source, again, Choices(MASK, keep_others=True), KEY)
        anonymized(one.source, other, Choices(MASK, keep_others=True), Key(b"one that is not that"))
        assert again.read_bytes() == one.masked.read_bytes()
        assert [shape(frame) for frame in frames(other)] == [shape(frame) for frame in frames(one.source)]
    named = ROOT / "captures/crafted/ip-headers.pcapng"
    anonymized(named, other, Choices(MASK), Key(b"one that is not that"))
    assert [frame.octets[26:34] for frame in frames(other)[:1]] != [frame.octets[26:34] for frame in frames(named)[:1]]


def test_addresses_share_as_much_of_their_front_as_before(seen: tuple[Rows, Rows]) -> None:
    before, after = seen
    at = len(CHECKSUMS) + ADDRESSES.index("ip.src")
    pairs = {
        (row[at], other[at]) for row, other in zip(before, after, strict=True) if row[at] and "\x1f" not in row[at]
    }
    found = sorted((int(ip_address(one)), int(ip_address(other))) for one, other in pairs)
    assert len(found) > 10
    assert len({one for one, _ in found}) == len({other for _, other in found}) == len(found)
    for (one, new), (other, another) in pairwise(found):
        assert (one ^ other).bit_length() == (new ^ another).bit_length()
