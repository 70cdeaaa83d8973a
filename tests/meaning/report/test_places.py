from __future__ import annotations

import pytest

from dissect.meaning.report.words import Places
from dissect.packets.source.packet import SourceFile


def places(several: bool = True) -> Places:
    """Three files: packets 1-10 of the run, none, and 11-."""
    return Places([SourceFile("a.pcap", 1), SourceFile("empty.pcap", 11), SourceFile("b\x1b.pcap", 11)], several)


@pytest.mark.parametrize(
    ("frame", "place"),
    [(1, ("a.pcap", 1)), (10, ("a.pcap", 10)), (11, ("b\x1b.pcap", 1)), (999, ("b\x1b.pcap", 989))],
)
def test_a_packet_of_the_run_is_found_in_its_file(frame: int, place: tuple[str, int]) -> None:
    assert places().locate(frame) == place
    assert places().number(frame) == place[1]
    assert places(several=False).number(frame) == frame


def test_files_may_come_while_the_run_goes_on() -> None:
    files = [SourceFile("a.pcap", 1)]
    growing = Places(files, True)
    assert growing.locate(5) == ("a.pcap", 5)
    files.append(SourceFile("b.pcap", 4))
    assert growing.locate(5) == ("b.pcap", 2)


def test_a_file_name_that_is_no_utf8_can_be_written() -> None:
    assert Places([SourceFile("caf\udce9", 1)], True).locate(1) == ("caf\\xe9", 1)


@pytest.mark.parametrize(
    ("frames", "alone", "among_others"),
    [
        ((3, 4), "3→4", "a.pcap:3→4"),
        ((3, 0), "3→?", "a.pcap:3→?"),
        ((0, 4), "?→4", "a.pcap:?→4"),
        ((9, 12), "9→12", "a.pcap:9→b\\x1b.pcap:2"),
        ((0, 12), "?→12", "b\\x1b.pcap:?→2"),
    ],
)
def test_the_packets_of_a_request_and_its_answer(frames: tuple[int, int], alone: str, among_others: str) -> None:
    assert places(several=False).pair(*frames) == alone
    assert places().pair(*frames) == among_others


@pytest.mark.parametrize(
    ("frames", "alone", "among_others"),
    [
        ([], "the capture", "the capture"),
        ([3], "packet 3", "packet 3 of a.pcap"),
        ([3, 4], "packets 3, 4", "packets 3, 4 of a.pcap"),
        ([9, 12], "packets 9, 12", "packet 9 of a.pcap, packet 2 of b\\x1b.pcap"),
    ],
)
def test_packets_in_words(frames: list[int], alone: str, among_others: str) -> None:
    assert places(several=False).phrase(frames) == alone
    assert places().phrase(frames) == among_others


def test_the_mark_of_a_line() -> None:
    assert places(several=False).mark(12) == "12"
    assert places().mark(12) == "b\\x1b.pcap:2"


def test_a_text_has_the_names_of_hosts_for_whole_addresses_only() -> None:
    named = Places([], False, {"10.0.0.1": "Press", "fe80::1": "Panel", "2001:db8::": "Net"}).named
    assert named("10.0.0.1:102 to 10.0.0.10:102, 110.0.0.1, 10.0.0.1.2 and 10.0.0.1.") == (
        "Press:102 to 10.0.0.10:102, 110.0.0.1, 10.0.0.1.2 and Press."
    )
    assert named("[fe80::1]:102 (fe80::1), fe80::11, fe80::1:2, ::ffff:10.0.0.1, 2001:db8::1, [2001:db8::1]:5") == (
        "Panel:102 (Panel), fe80::11, fe80::1:2, ::ffff:10.0.0.1, 2001:db8::1, [2001:db8::1]:5"
    )
    assert Places([], False).named("10.0.0.1:102") == "10.0.0.1:102"
