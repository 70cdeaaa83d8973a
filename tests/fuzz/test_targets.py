"""The fuzz targets without a fuzzer: over all seeds of this checkout, damaged ones, and inputs that once failed."""

from __future__ import annotations

import pytest

from dissect.output.baseline.loading import parse_baseline
from dissect.protocols.s7.message import parse_pdu
from dissect.testing.golden.parsing import parse_golden
from dissect.testing.playback.server.recording import recording_of
from dissect.testing.playback.server.session import Action, ClientSession
from tests.fuzz import __main__ as runner
from tests.fuzz import files, frames, inputs, pdus, played, scripts, streams
from tests.fuzz.checks import check_json, check_line
from tests.fuzz.containers import Packets, read
from tests.fuzz.mutations import mutations
from tests.fuzz.played import check_harmless
from tests.fuzz.seeds import own
from tests.fuzz.targets import TARGETS
from tests.meaning.report.support import begun
from tests.meaning.report.support import read as reads
from tests.properties.books import Result, facts
from tests.properties.captures import ROOT, Memory
from tests.properties.messages import JOB, Item, dt, pdu, read_job, setup, userdata, write_job
from tests.properties.packets import Packet

#: How many damaged inputs of each target are tried.
COUNT = 250


@pytest.mark.parametrize("name", TARGETS)
def test_what_always_holds_holds_of_seeds_and_of_damaged_ones(name: str) -> None:
    target, seeds, longest = TARGETS[name]
    begin = [seed for seed in seeds(own()) if len(seed) <= longest]
    assert len(begin) > 50
    for octets in mutations(begin, COUNT, seed=len(name)):
        target(octets)


@pytest.mark.parametrize("name", TARGETS)
def test_short_inputs_hold_too(name: str) -> None:
    target = TARGETS[name][0]
    target(b"")
    for first in range(256):
        target(bytes((first,)))
        target(bytes((first, 0x32, 0x07, first)))


#: Inputs that failed once, made small: what they showed, the target, its octets.
FOUND = {
    "a connection of an address with itself was never closed": (
        "frames",
        b"\0\0\0\x4f" + bytes(12) + b"\x08\0\x45\0\0\x41\0\0\0\0\0\x06\0\0\x0a\0\0\x01\x0a\0\0\x01\0\x66\0\x66"
        + bytes(8) + b"\x50" + bytes(7) + b"\x03\0\0\x19\x02\xf0\x80\x32\x01" + bytes(8),
    ),
    "TSAPs that no connect request has room for": (
        "inputs",
        inputs.written("golden", (
            f"s7dissect golden 1\n\nconnection 1\n  client TSAP <{'41 ' * 121}>\n  server TSAP <{'42 ' * 121}>\n"
            "  TPDU size 1024, asked 1024\n\n1 client READ\n  no answer: hole\n  M20.1 BIT\n").encode()),
    ),
    "an array of Null, whose elements take no octets, read again from fewer octets": (
        "plus",
        bytes.fromhex("04000000896a0013008900000034019077000801000004e88969001200000000896a001300896b00040000000900000000001300896b00040000000900000000"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", FOUND)
def test_what_once_failed_holds(what: str) -> None:
    name, octets = FOUND[what]
    TARGETS[name][0](octets)


def test_every_target_can_be_named() -> None:
    assert tuple(TARGETS) == runner.NAMES


# ---- seeds reach what they are for ----------------------------------------------------------------------------------


def shown(name: str) -> list[Packet]:
    (path,) = (ROOT / "captures").rglob(name)
    packets, _, _ = read(Memory(path.read_bytes()))
    return [Packet(*told) for told in packets.told]


@pytest.mark.parametrize(
    "name", ["szl.pcapng", "two-clients.pcapng", "netlink.pcapng", "segments.pcapng", "refusals.pcapng"]
)
def test_a_script_says_what_its_capture_says(name: str) -> None:
    packets = shown(name)
    original = Result(packets)
    played = Result(scripts.Script(scripts.written(packets)).packets)
    assert len(original.transactions) > 1
    # Connections get other addresses: what was said on them is compared.
    assert sorted(repr(facts(one)[2:]) for one in played.transactions) == sorted(
        repr(facts(one)[2:]) for one in original.transactions
    )


def test_packets_and_pieces_are_read_as_they_were_written() -> None:
    packets = reads(begun(), 1).packets()
    found, checksums = frames.packets_of(frames.written(packets))
    assert [packet.octets for packet in found] == [packet.octets for packet in packets]
    assert not checksums
    pieces = [dt(setup(JOB, 1)), b"\x03\x00", b""]
    assert streams.pieces_of(streams.written(pieces, True)) == ([(piece, 0, False) for piece in pieces], True)


def test_seeds_hold_every_kind_of_input_and_every_face() -> None:
    assert {seed[0] for seed in own().inputs()} == set(range(len(inputs.KINDS)))
    assert {seed[-1] & files.SCRIPT for seed in own().files()} == {0, files.SCRIPT}
    assert {(seed[-1] & 0x1F) % len(files.FACES) for seed in own().files()} == set(range(len(files.FACES)))
    assert {seed[1] for seed in own().pdus()} >= {0x32, 0x72}
    assert len({seed[1:3] for seed in own().pdus()}) > 5


# ---- a target sees what is wrong ------------------------------------------------------------------------------------


def test_output_that_is_not_safe_or_no_json_is_a_failure() -> None:
    check_line("DB1.DBW2 = 5 → ü")
    for line in ("\x1b[31m", "a\nb", "\u202eabc", "\x85", "\udc80"):
        with pytest.raises((AssertionError, UnicodeEncodeError)):
            check_line(line)
    assert check_json('{"a": [1.5, null]}') == {"a": [1.5, None]}
    for text in ('{"a": NaN}', "[Infinity]", '["\u202e"]', "{", '{"a": 1'):
        with pytest.raises((AssertionError, ValueError)):
            check_json(text)


def test_a_gap_between_parts_is_a_failure() -> None:
    parts = parse_pdu(setup(JOB, 1)).body.parameters
    start, end = parts[0].offset, parts[-1].end
    pdus._check_cover(parts, start, end)
    for wrong in ((start + 1, end), (start, end + 1)):
        with pytest.raises(AssertionError):
            pdus._check_cover(parts, *wrong)


def test_a_reader_that_depends_on_pieces_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    seed = own().captures[0]
    real = read

    def forgetful(source: Memory, steps: int = 24) -> tuple[Packets, list[str], bool]:
        packets, said, ended = real(source, steps)
        if type(source) is not Memory:
            packets.told.pop()
        return packets, said, ended

    monkeypatch.setattr("tests.fuzz.containers.read", forgetful)
    with pytest.raises(AssertionError):
        TARGETS["container"][0](seed)


def test_an_error_that_is_not_documented_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    golden = inputs.written("golden", b"no golden")
    inputs.inputs(golden)

    def wrong(text: str) -> None:
        raise KeyError(text)

    monkeypatch.setattr("tests.fuzz.inputs.parse_golden", wrong)
    with pytest.raises(KeyError):
        inputs.inputs(golden)


def test_a_golden_that_reads_back_as_another_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    script = scripts.written(reads(begun(), 1).packets())
    golden = script + bytes((files.SCRIPT | files.FACES.index(files._golden),))
    files.files(golden)
    real = parse_golden
    monkeypatch.setattr("tests.fuzz.files.parse_golden", lambda text: real(text.replace("1234", "1235")))
    with pytest.raises(AssertionError):
        files.files(golden)


def test_a_request_that_is_no_harmless_one_is_a_failure() -> None:
    item = Item(0x04, 1, 10)
    check_harmless(setup(JOB, 1))
    check_harmless(read_job(1, [item]))
    check_harmless(userdata(1, 1, 4, 1, b"\x00\x11\x00\x00"))
    for octets in (
        write_job(1, [item], [b"\0\0"]),
        pdu(JOB, 1, b"\x29"),
        userdata(1, 2, 4, 1),
        read_job(1, [item]) + b"\0",
    ):
        with pytest.raises(AssertionError):
            check_harmless(octets)


def test_what_a_server_says_that_is_no_tpkt_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    served = played.ServedReader("made")
    files.drive(files.as_pcap(reads(begun(), 1).packets()), served, None)
    recording = recording_of(served.finish())
    played.check_served(recording, [], b"")

    class Mumbling(ClientSession):
        def feed(self, octets: bytes) -> list[Action]:
            return [deed._replace(octets=deed.octets[:-1]) for deed in super().feed(octets)]

    monkeypatch.setattr("tests.fuzz.played.ClientSession", Mumbling)
    with pytest.raises(AssertionError):
        played.check_served(recording, [], b"")


def test_what_is_new_to_what_was_learned_of_the_same_capture_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    script = scripts.written(reads(begun(), 1).packets()) + bytes((files.SCRIPT | files.FACES.index(files._learned),))
    files.files(script)
    real = parse_baseline
    monkeypatch.setattr("tests.fuzz.files.parse_baseline", lambda text: real(text.replace('"DB10"', '"DB11"')))
    with pytest.raises(AssertionError):
        files.files(script)
