"""The answers of `s7dissect extcap` to Wireshark: the sentences of the extcap protocol (wireshark's doc/README.extcap)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

from dissect.packets.source.pcap import LINKTYPE_ETHERNET
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.packets.source.live.interfaces import NetworkInterface

#: The two interfaces that Wireshark lists, and their names.
LIVE: Final = "s7dissect"
FILE: Final = "s7dissect-file"
INTERFACES: Final = {
    LIVE: "S7 with findings (live)",
    FILE: "S7 with findings (from a file)",
}


def sentence(word: str, *values: tuple[str, object]) -> str:
    """Return a sentence: a word and values in braces; a brace in a value, which would end it, becomes a parenthesis."""
    marks = str.maketrans({"\\": "\\\\", "{": "(", "}": ")"})
    parts = [f"{{{name}={printable(str(value)).translate(marks)}}}" for name, value in values]
    return f"{word} {''.join(parts)}"


def interface_sentences(version: str) -> Iterator[str]:
    """Return the interfaces for capturing."""
    yield sentence("extcap", ("version", version), ("display", "s7dissect: S7 traffic with findings"))
    for name, display in INTERFACES.items():
        yield sentence("interface", ("value", name), ("display", display))


def link_sentences() -> Iterator[str]:
    """Return the probable link type; each interface in the output has its own."""
    yield sentence("dlt", ("number", LINKTYPE_ETHERNET), ("name", "EN10MB"), ("display", "Ethernet"))


def option_sentences(name: str, interfaces: Sequence[NetworkInterface]) -> Iterator[str]:
    """Return the options of one of our interfaces; the names of calls are those of `s7dissect extcap`."""
    if name == LIVE:
        yield _argument(0, "--interface", "Network interface", "selector", "Where to capture", ("required", "true"))
        yield from _choices(interfaces)
    else:
        yield _argument(
            0, "--file", "Capture file", "fileselect", "pcap or pcapng, plain or compressed",
            ("required", "true"), ("mustexist", "true"),
        )  # fmt: skip
        yield _argument(
            1, "--where", "Only", "string", "An expression such as: host == 192.168.0.1 and latency > 20ms",
            ("placeholder", "everything"),
        )  # fmt: skip
    yield _argument(
        2, "--slow", "Slow answers (ms)", "double", "Report answers that take longer", ("default", "1000"),
        ("range", "0,1000000000"),
    )  # fmt: skip
    yield _argument(3, "--tags", "Tag table", "fileselect", "Names for addresses", ("mustexist", "true"))


def _argument(number: int, call: str, display: str, kind: str, tooltip: str, *more: tuple[str, str]) -> str:
    return sentence(
        "arg", ("number", number), ("call", call), ("display", display), ("tooltip", tooltip), ("type", kind), *more
    )


def _choices(interfaces: Sequence[NetworkInterface]) -> Iterator[str]:
    """Return the network interfaces; the first one that is up and is not the loopback is preselected."""
    usable = [one for one in interfaces if printable(one.name) == one.name and not set(one.name) & set("{}\\")]
    default = next((one for one in usable if one.state == "up" and not one.loopback), None)
    for one in usable:
        display = " ".join([one.name, *one.addresses]) if one.state != "down" else f"{one.name} (down)"
        chosen = [("default", "true")] if one is default else []
        yield sentence("value", ("arg", 0), ("value", one.name), ("display", display), *chosen)
