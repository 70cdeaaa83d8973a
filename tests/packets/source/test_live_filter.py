"""The ring's own capture filters: held against libpcap's programs, and against what they say."""

from __future__ import annotations

import struct

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dissect.packets.source.live.filter import NotBuiltInError, compile_filter
from dissect.packets.source.live.program import (
    EQUAL,
    LOAD_NUMBER,
    MAX_INSTRUCTIONS,
    RETURN,
    Assembler,
    Instruction,
    compile_with_libpcap,
)
from dissect.packets.source.live.reader import LiveError
from tests.cases import each
from tests.packets.source.live_support import ethernet, ip_packet, needs_ring, run_filter, udp

ADDRESSES = ("10.0.0.1", "10.0.0.2", "10.1.2.3", "192.168.7.9")
ADDRESSES_6 = ("fe80::1", "fe80::2", "2001:db8::7")
PORTS = (0, 102, 1099, 4711, 65535)


def tcp(source: int, target: int) -> bytes:
    return struct.pack(">HHIIHHHH", source, target, 1, 1, 0x5010, 512, 0, 0)


@st.composite
def frames(draw: st.DrawFn) -> bytes:
    """Frames without tags: IPv4 (also fragments and options), IPv6, ARP, RARP, and what is none of them."""
    what = draw(st.sampled_from(["ip", "ip", "ip6", "arp", "other"]))
    payload = tcp(draw(st.sampled_from(PORTS)), draw(st.sampled_from(PORTS)))
    protocol = draw(st.sampled_from([6, 6, 17, 132, 1, 58, 47]))
    if what == "ip":
        fragment = draw(st.sampled_from([0, 0, 0x4000, 0x2000, 0x00B9]))
        packet = ip_packet(
            draw(st.sampled_from(ADDRESSES)), draw(st.sampled_from(ADDRESSES)), protocol, payload, fragment
        )
        if draw(st.booleans()):
            packet = b"\x47" + packet[1:20] + bytes(8) + packet[20:]
        return ethernet(packet, 0x0800)
    if what == "ip6":
        return ethernet(
            ip_packet(draw(st.sampled_from(ADDRESSES_6)), draw(st.sampled_from(ADDRESSES_6)), protocol, payload), 0x86DD
        )
    if what == "arp":
        ends = [bytes(int(part) for part in draw(st.sampled_from(ADDRESSES)).split(".")) for _ in "12"]
        head = struct.pack(">HHBBH", 1, 0x0800, 6, 4, 1)
        return ethernet(head + bytes(6) + ends[0] + bytes(6) + ends[1], draw(st.sampled_from([0x0806, 0x8035])))
    return ethernet(draw(st.binary(max_size=60)), draw(st.sampled_from([0x88CC, 0x8892, 0x0026])))


@st.composite
def questions(draw: st.DrawFn) -> str:
    side = draw(st.sampled_from(["", "src ", "dst "]))
    kind = draw(st.sampled_from(["word", "port", "ports", "range", "host", "host6", "hosts", "net"]))
    transport = draw(st.sampled_from(["", "tcp ", "udp ", "sctp "]))
    port = draw(st.sampled_from(PORTS))
    if kind == "port":
        return f"{transport}{side}port {port}"
    if kind == "ports":
        return f"({transport}{side}port {port} or {draw(st.sampled_from(PORTS))})"
    if kind == "range":
        return f"{transport}{side}portrange {port}-{draw(st.sampled_from(PORTS))}"
    if kind == "host":
        return f"{side}host {draw(st.sampled_from(ADDRESSES))}"
    if kind == "host6":
        return f"{side}host {draw(st.sampled_from(ADDRESSES_6))}"
    if kind == "hosts":
        return f"({side}host {draw(st.sampled_from(ADDRESSES))} or {draw(st.sampled_from(ADDRESSES))})"
    if kind == "net":
        return f"{side}net {draw(st.sampled_from(['10.0.0.0/8', '10.0.0.0/30', '192.168.7.8/29', 'fe80::/64']))}"
    return draw(st.sampled_from(["ip", "ip6", "arp", "tcp", "udp", "sctp", "icmp", "icmp6"]))


expressions = st.recursive(
    questions(),
    lambda inner: st.one_of(
        inner.map("not {}".format),
        inner.map("({})".format),
        st.tuples(inner, st.sampled_from([" and ", " or ", " && ", "||"]), inner).map("".join),
    ),
    max_leaves=6,
)


def libpcap(expression: str) -> list[Instruction]:
    try:
        return compile_with_libpcap(expression, "lo")
    except LookupError:
        pytest.skip("no libpcap")
    except LiveError as error:
        if "rejects all packets" not in str(error):
            raise
    return [Instruction(RETURN, 0, 0, 0)]


@needs_ring
@settings(max_examples=60)
@given(expressions, st.lists(frames(), min_size=1, max_size=20))
def test_agrees_with_libpcap(expression: str, packets: list[bytes]) -> None:
    ours = compile_filter(expression)
    theirs = libpcap(expression)
    assert [run_filter(ours, packet) for packet in packets] == [run_filter(theirs, packet) for packet in packets]


@each("tags", ["", "8100 0005", "88a8 0064 8100 0005", "9100 0001 8100 0002 8100 0003"])
@each(
    ("expression", "wanted"),
    [
        ("udp port 4711", True),
        ("port 102 or 1099 or 4711", True),
        ("tcp port 4711", False),
        ("src host 10.0.0.1 and dst host 10.0.0.2", True),
        ("host 10.0.0.9", False),
        ("ip and not tcp", True),
        ("arp", False),
    ],
)
def test_sees_through_tags_in_the_frame(tags: str, expression: str, wanted: bool) -> None:
    assert run_filter(compile_filter(expression), udp(b"x", tags=bytes.fromhex(tags))) == wanted


def test_a_fourth_tag_is_not_stepped_over() -> None:
    assert not run_filter(compile_filter("udp"), udp(b"x", tags=bytes.fromhex("8100 0001") * 4))


@pytest.mark.parametrize(
    ("expression", "beside", "inside", "wanted"),
    [
        ("vlan", None, "", False),
        ("vlan", 5, "", True),
        ("vlan", 0, "", True),
        ("vlan", None, "8100 0005", True),
        ("vlan 5", 0x2005, "", True),
        ("vlan 5", None, "8100 2005", True),
        ("vlan 5", 6, "", False),
        ("vlan 5", None, "88a8 0006", False),
        ("vlan 5 and udp port 4711", 5, "", True),
        ("vlan 0", 5, "", False),
        ("not vlan", 5, "", False),
        ("not vlan", None, "", True),
    ],
)
def test_vlan_beside_and_inside(expression: str, beside: int | None, inside: str, wanted: bool) -> None:
    assert run_filter(compile_filter(expression), udp(b"x", tags=bytes.fromhex(inside)), beside) == wanted


@pytest.mark.parametrize(
    ("expression", "packet", "wanted"),
    [
        ("tcp port 102", ip_packet("10.0.0.1", "10.0.0.2", 6, tcp(5000, 102)), True),
        ("tcp port 102", ip_packet("fe80::1", "fe80::2", 6, tcp(102, 5000)), True),
        ("udp", ip_packet("10.0.0.1", "10.0.0.2", 6, tcp(1, 2)), False),
        ("ip6", ip_packet("fe80::1", "fe80::2", 6, tcp(1, 2)), True),
        ("ip", ip_packet("fe80::1", "fe80::2", 6, tcp(1, 2)), False),
    ],
)
def test_raw_ip_has_no_ethernet_header(expression: str, packet: bytes, wanted: bool) -> None:
    assert run_filter(compile_filter(expression, 101), packet) == wanted


def test_and_and_or_bind_alike() -> None:
    # (udp or ip6) and arp, so nothing; with the manners of C it would be udp or (ip6 and arp).
    assert not run_filter(compile_filter("udp or ip6 and arp"), udp(b"x"))
    assert run_filter(compile_filter("udp or (ip6 and arp)"), udp(b"x"))


@each(
    "expression",
    [
        *(
            "",
            "port",
            "port x",
            "port 65536",
            "port 1-2",
            "portrange 1",
            "portrange 1-",
            "102",
            "tcp or 102",
            "nonsense",
        ),
        *("host 10.0.0.1/8", "net 10.0.0.1/8", "net 10", "host 300.1.1.1", "host plc.example", "tcp host 10.0.0.1"),
        *(
            "(tcp",
            "tcp)",
            "tcp and",
            "not",
            "and tcp",
            "tcp udp",
            "vlan 4096",
            "ether proto 0x88cc",
            "tcp[13] & 2 != 0",
        ),
        *("src", "src or dst port 1", "(" * 60 + "tcp" + ")" * 60, "port ²", "greater 100", "tcp and and udp"),
    ],
)
def test_everything_else_is_left_to_libpcap(expression: str) -> None:
    with pytest.raises(NotBuiltInError):
        compile_filter(expression)


WORDS = st.sampled_from(
    [
        "tcp",
        "udp",
        "port",
        "102",
        "src",
        "dst",
        "host",
        "10.0.0.1",
        "net",
        "10.0.0.0/8",
        "ip6",
        "and",
        "or",
        "not",
        "(",
        ")",
    ]
)


@given(
    st.text(alphabet="()!&| 0123456789./:-abcdehinoprstuvx\0é", max_size=40) | st.lists(WORDS, max_size=8).map(" ".join)
)
@example("tcp port 102 and not host 10.0.0.1")
def test_any_text_is_compiled_or_refused(expression: str) -> None:
    try:
        program = compile_filter(expression)
    except NotBuiltInError:
        return
    assert program[-1].code == RETURN
    run_filter(program, udp(b"x"))


def test_long_lists_jump_far() -> None:
    program = compile_filter(" or ".join(f"port {port}" for port in range(4500, 4750)))
    assert len(program) > 1000
    assert run_filter(program, udp(b"x", 4500))
    assert run_filter(program, udp(b"x", 4711))
    assert run_filter(program, udp(b"x", 4749))
    assert not run_filter(program, udp(b"x", 4750))
    assert max(max(part.yes, part.no) for part in program) <= 255


@pytest.mark.parametrize("text", ["(", "not ", "((tcp) or ", "tcp or ", "a", "port 9"], ids=str)
def test_a_filter_of_a_mebibyte_is_refused_without_recursion(text: str) -> None:
    with pytest.raises((NotBuiltInError, LiveError)):
        compile_filter(text * (1_048_576 // len(text)), 1)


def test_longer_than_the_kernel_takes_is_told() -> None:
    with pytest.raises(LiveError, match=f"more than {MAX_INSTRUCTIONS} instructions"):
        compile_filter(" or ".join(f"port {port}" for port in range(900)))


@each("distance", range(250, 262))
@each("value", [1, 2])
@each("ways", ["yes", "no", "both"])
def test_comparisons_at_the_edge_of_their_reach(distance: int, value: int, ways: str) -> None:
    code = Assembler()
    yes, no = code.label(), code.label()
    code.do(LOAD_NUMBER, value)
    code.test(EQUAL, 1, yes if ways != "no" else -1, no if ways != "yes" else -1)
    code.do(RETURN, 7)
    for _ in range(distance):
        code.do(LOAD_NUMBER, 0)
    code.place(no)
    code.do(RETURN, 0)
    code.place(yes)
    code.do(RETURN, 1)
    program = code.assemble()
    falls = (ways == "no" and value == 1) or (ways == "yes" and value == 2)
    at = 1
    while program[at].code != RETURN:
        part = program[at]
        met = value == part.k
        at += 1 + (part.k if part.code == 5 else (part.yes if met else part.no) if part.code == EQUAL else 0)
    assert program[at].k == (7 if falls else int(value == 1))
