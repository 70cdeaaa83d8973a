"""The same short conversation in every kind of file, files of several sections, and files that are cut off."""

from __future__ import annotations

import gzip
import struct
import zlib
from pathlib import Path

from captures.craft import container
from captures.craft.case import Case, crafts
from captures.craft.container import Pcapng, write_pcap, write_pcapng
from captures.craft.links import V6, bare, cooked
from captures.craft.pdus import READ, WRITE, dt, pattern, read, values, write, written
from captures.craft.talk import CLIENT, SERVER, Talk

COMMENT = "first request of the line: päckets may carry words"
DAY = 86_400


def converse(case: Case) -> None:
    """Handshake, connect, setup, ten reads, two writes, close; answer times from 100 to 1100 microseconds."""
    case.find("security.write")
    talk = Talk(case)
    talk.begin()
    for number in range(1, 11):
        talk.send(CLIENT, dt(read(number, "DB1.DBW0", "MW20")))
        case.pause(-0.5 + number / 10)
        talk.send(SERVER, dt(values(number, pattern(2, number), pattern(2))))
        case.pair(READ)
    for number in (20, 21):
        talk.exchange(WRITE, write(number, pattern(8)), written(number))
    talk.close()


@crafts("The conversation of all plain-* files, as pcap: little-endian, microseconds.")
def plain(case: Case) -> None:
    converse(case)
    case.suffix = "pcap"
    case.write = lambda case: write_pcap(case.packets)


@crafts("The same as pcap in nanoseconds.")
def plain_ns(case: Case) -> None:
    converse(case)
    case.suffix = "pcap"
    case.write = lambda case: write_pcap(case.packets, nanoseconds=True)


@crafts("The same as big-endian pcap.")
def plain_big_endian(case: Case) -> None:
    converse(case)
    case.suffix = "pcap"
    case.write = lambda case: write_pcap(case.packets, big=True)


@crafts("The same as big-endian pcap in nanoseconds.")
def plain_big_endian_ns(case: Case) -> None:
    converse(case)
    case.suffix = "pcap"
    case.write = lambda case: write_pcap(case.packets, big=True, nanoseconds=True)


@crafts("The same as big-endian pcapng.")
def plain_big_endian_ng(case: Case) -> None:
    converse(case)
    case.write = lambda case: write_pcapng(case.packets, big=True)


@crafts("The same pcap under a name that says pcapng: the first octets count, not the name.")
def plain_misnamed(case: Case) -> None:
    converse(case)
    case.write = lambda case: write_pcap(case.packets)


@crafts("The same pcap in gzip.")
def plain_gzip(case: Case) -> None:
    converse(case)
    case.suffix = "pcap.gz"
    case.write = lambda case: gzip.compress(write_pcap(case.packets), mtime=0)


@crafts("The same pcap in zstd.")
def plain_zstd(case: Case) -> None:
    converse(case)
    case.suffix = "pcap.zst"
    case.write = lambda case: in_zstd(write_pcap(case.packets))


def in_zstd(octets: bytes) -> bytes:
    import zstandard

    return zstandard.ZstdCompressor(level=3).compress(octets)


def unpacked(path: Path) -> bytes:
    """The octets of a file, decompressed: how well they are compressed is up to the library of the day."""
    octets = path.read_bytes()
    if path.suffix == ".gz":
        return zlib.decompressobj(wbits=31).decompress(octets)  # a file that is cut gives what is there
    if path.suffix == ".zst":
        import zstandard

        return zstandard.ZstdDecompressor().decompress(octets)
    return octets


@crafts(
    "pcapng of three sections. Little-endian, two interfaces of other link types and clocks (Ethernet in "
    "microseconds, Linux cooked in nanoseconds) that see one connection each; big-endian, raw IP with a clock of "
    "2**-20 s and one that starts a day late; little-endian, packets without time and in the obsolete block. "
    "Comments, blocks nobody knows and blocks nobody needs between."
)
def sections(case: Case) -> None:
    file = Pcapng()
    file.section(comment="crafted")
    file.interface(container.ETHERNET, "line 1")
    file.interface(container.SLL, "any", container.NS)
    file.block(0x0BAD, b"a block of a kind that nobody has defined")
    file.block(4, struct.pack("<HH4s10s", 1, 14, b"\xc0\x00\x02\x14", b"plc.plant\0") + bytes(6))  # name resolution
    first, second = Talk(case), Talk(case, client_port=49153, link=cooked, interface=1)
    first.begin()
    second.begin()
    for number in range(1, 6):
        case.put(first.make(CLIENT, dt(read(number, "DB1.DBW0"))), comment=COMMENT if number == 1 else "")
        second.send(CLIENT, dt(read(number, "DB2.DBW0")))
        first.send(SERVER, dt(values(number, b"\x00\x01")))
        second.send(SERVER, dt(values(number, b"\x00\x02")))
        case.pair(READ, READ)
    first.close()
    second.close()
    for packet in case.packets:
        file.packet(packet)
    file.block(5, struct.pack("<III", 0, 0, 0))  # interface statistics
    done = len(case.packets)
    file.section(big=True)
    file.interface(container.RAW, "tun0", 1 << 20)
    file.interface(container.IPV6, "tun1", container.NS, offset=DAY)
    file.block(0x40000BAD, b"a block of a kind kept for private use")
    talks = (
        Talk(case, client_port=49154, link=bare),
        Talk(case, *V6, client_port=49155, link=bare, interface=1),
    )
    for talk in talks:
        talk.begin()
        talk.poll(3)
        talk.close()
    for packet in case.packets[done:]:
        file.packet(packet)
    done = len(case.packets)
    file.section()
    file.interface(container.ETHERNET, "line 1", container.NS)
    talk = Talk(case, client_port=49156)
    talk.begin()
    talk.poll(3)
    talk.close()
    for place, packet in enumerate(case.packets[done:]):
        if place % 3 == 1:
            file.simple(packet)
        else:
            file.packet(packet, old=place % 3 == 2)
    case.write = lambda _: file.octets


def cut_off(case: Case, octets: bytes, missing: int) -> bytes:
    """A file without its last octets, which belong to the last packet."""
    case.counts["packets"] -= 1
    return octets[:-missing]


@crafts("A pcap file that ends in the middle of its last packet, as one that is copied while it is being written.")
def cut_pcap(case: Case) -> None:
    unfinished(case)
    octets = cut_off(case, write_pcap(case.packets), 20)
    case.suffix = "pcap"
    case.write = lambda _: octets


@crafts("A pcapng file that ends in the middle of its last packet.")
def cut_pcapng(case: Case) -> None:
    unfinished(case)
    octets = cut_off(case, write_pcapng(case.packets), 21)
    case.write = lambda _: octets


@crafts("A gzip file whose end is missing: some packets, and the check sum.")
def cut_gzip(case: Case) -> None:
    unfinished(case)
    # Stored, not compressed, so that it can be said what is missing.
    whole = gzip.compress(write_pcap(case.packets), compresslevel=0, mtime=0)
    octets = cut_off(case, whole, 8 + 20)
    case.suffix = "pcap.gz"
    case.write = lambda _: octets


def unfinished(case: Case) -> None:
    """Three good reads and a fourth request; its answer is what the cut takes."""
    talk = Talk(case)
    talk.begin()
    talk.poll(3)
    number = talk.next_ref()
    talk.send(CLIENT, dt(read(number, "DB1.DBW0")))
    case.unanswered(READ, "capture_ended")
    talk.send(SERVER, dt(values(number, b"\x00\x01")))
    case.find("capture.damaged")
    case.exit_code = 3


PLAIN = ("plain", "plain-ns", "plain-big-endian", "plain-big-endian-ns", "plain-big-endian-ng", "plain-misnamed",
         "plain-gzip", "plain-zstd")  # fmt: skip
"""The files that differ in nothing but the container."""
