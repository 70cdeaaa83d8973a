"""Capture filters for the ring: compiles the common part of libpcap's language (pcap-filter(7)) without libpcap.

    ip ip6 arp tcp udp sctp icmp icmp6 vlan vlan N
    [tcp|udp|sctp] [src|dst] port N, portrange A-B      [src|dst] host ADDRESS, net ADDRESS/BITS
    and or not ( ), and `port 102 or 1099` for `port 102 or port 1099`

As in libpcap, ``and`` and ``or`` have the same precedence and are read from left to right. Other expressions are left to
libpcap, if it is installed. Two things differ from libpcap: up to three VLAN tags inside a frame are stepped over (the kernel
keeps the outermost tag outside of the frame), and ``vlan`` does not change the meaning of what follows. As in libpcap, a
fragment other than the first has no port, and the header after an IPv6 header must be the transport's.
"""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from typing import Final

from dissect.packets.source.live import program as bpf
from dissect.packets.source.live.interfaces import RAW_IP
from dissect.packets.source.live.program import Assembler, Instruction, TooLongError
from dissect.packets.source.live.reader import LiveError

_ETHERTYPES: Final = {"ip": 0x0800, "ip6": 0x86DD, "arp": 0x0806}
_PROTOCOLS: Final = {"tcp": 6, "udp": 17, "sctp": 132, "icmp": 1, "icmp6": 58}
#: Protocols that belong to one version of IP, with its EtherType.
_FAMILIES: Final = {"icmp": 0x0800, "icmp6": 0x86DD}
_WITH_PORTS: Final = ("tcp", "udp", "sctp")
_TAGS: Final = (0x8100, 0x88A8, 0x9100)
_MAX_INNER_TAGS: Final = 3
_MAX_WORDS: Final = 4096
_NO_PROTOCOL: Final = 0x100

# Memory cells of the program: where IP begins, the EtherType, the protocol above IP, where its ports are (0: no ports).
_NETWORK, _ETHERTYPE, _PROTOCOL, _PORTS = 0, 1, 2, 3
#: Ancillary data of the kernel: the VLAN tag that it took out of the frame, and whether it took one.
_VLAN_TAG: Final = 0xFFFFF000 + 44
_VLAN_PRESENT: Final = 0xFFFFF000 + 48


class NotBuiltInError(Exception):
    """The expression is not in the part of the language that is compiled here."""


@dataclass(frozen=True, slots=True)
class Primitive:
    """One test. ``kind`` is ethertype, protocol, vlan, port or address; ports are ``number`` to ``last``."""

    kind: str
    number: int = 0
    side: str = ""
    protocol: str = ""
    last: int = 0
    network: ipaddress.IPv4Network | ipaddress.IPv6Network | None = None


@dataclass(frozen=True, slots=True)
class Not:
    """The negation of an expression."""

    of: Node


@dataclass(frozen=True, slots=True)
class Both:
    """Two expressions; ``word`` is ``and`` or ``or``."""

    word: str
    left: Node
    right: Node


Node = Primitive | Not | Both


# ---- the language ---------------------------------------------------------------------------------------------------


class _Parser:
    """A recursive descent parser. A bare number or address takes the qualifiers of the primitive before it."""

    def __init__(self, expression: str) -> None:
        self._words: list[str] = re.findall(r"[()!]|&&|\|\||[^\s()!&|]+|\S", expression)[::-1]
        self._last: tuple[str, str, str] | None = None
        if len(self._words) > _MAX_WORDS:
            raise NotBuiltInError

    def parse(self) -> Node:
        node = self._expression(0)
        if self._words:
            raise NotBuiltInError
        return node

    def _expression(self, depth: int) -> Node:
        node = self._unary(depth)
        while self._peek() in {"and", "or", "&&", "||"}:
            word = self._take()
            word = {"&&": "and", "||": "or"}.get(word, word)
            node = Both(word, node, self._unary(depth))
        return node

    def _unary(self, depth: int) -> Node:
        if depth > 50:
            raise NotBuiltInError
        word = self._take()
        if word in {"not", "!"}:
            return Not(self._unary(depth + 1))
        if word == "(":
            node = self._expression(depth + 1)
            if self._take() != ")":
                raise NotBuiltInError
            return node
        return self._primitive(word)

    def _primitive(self, word: str) -> Node:
        if word == "vlan":
            self._last = None
            number = int(self._take()) if _is_port(self._peek()) else -1
            if number > 4095:
                raise NotBuiltInError
            return Primitive("vlan", number)
        protocol = word if word in _WITH_PORTS and self._peek() in {"src", "dst", "port", "portrange"} else ""
        if word in _ETHERTYPES | _PROTOCOLS and not protocol:
            self._last = None
            if word in _ETHERTYPES:
                return Primitive("ethertype", _ETHERTYPES[word])
            protocol_only = Primitive("protocol", _PROTOCOLS[word])
            family = _FAMILIES.get(word)
            return Both("and", Primitive("ethertype", family), protocol_only) if family else protocol_only
        if protocol:
            word = self._take()
        side = word if word in {"src", "dst"} else ""
        if side:
            word = self._take()
        if word in {"port", "portrange", "host", "net"}:
            self._last = (word, side, protocol)
            return self._id(self._take())
        if side or protocol:
            raise NotBuiltInError
        if self._last is None:
            self._last = ("host", "", "")
        return self._id(word)

    def _id(self, word: str) -> Node:
        assert self._last is not None
        what, side, protocol = self._last
        if what in {"port", "portrange"}:
            low, dash, high = word.partition("-")
            if (
                bool(dash) != (what == "portrange")
                or bool(dash) != bool(high)
                or not _is_port(low)
                or not _is_port(high or low)
            ):
                raise NotBuiltInError
            first, last = sorted((int(low), int(high or low)))
            return Primitive("port", first, side, protocol, last)
        if protocol or (what == "host" and "/" in word) or (what == "net" and "/" not in word):
            raise NotBuiltInError
        try:
            return Primitive("address", 0, side, network=ipaddress.ip_network(word))
        except ValueError:
            raise NotBuiltInError from None

    def _peek(self) -> str:
        return self._words[-1] if self._words else ""

    def _take(self) -> str:
        if not self._words:
            raise NotBuiltInError
        return self._words.pop()


def _is_port(text: str) -> bool:
    return text.isascii() and text.isdecimal() and len(text) <= 5 and int(text) <= 65535


# ---- the program ----------------------------------------------------------------------------------------------------


def compile_filter(expression: str, link_type: int = 1) -> list[Instruction]:
    """Return the program for ``expression`` on Ethernet (1) or raw IP (101).

    `NotBuiltInError` for an expression that is not compiled here, `LiveError` for a program too long for the kernel.
    """
    node = _Parser(expression).parse()
    code = Assembler()
    yes, no = code.label(), code.label()
    _prepare(code, link_type)
    _generate(code, node, yes, no)
    code.place(yes)
    code.do(bpf.RETURN, bpf.WHOLE)
    code.place(no)
    code.do(bpf.RETURN, 0)
    try:
        return code.assemble()
    except TooLongError:
        raise LiveError(f"the capture filter is too long: more than {bpf.MAX_INSTRUCTIONS} instructions") from None


def complaint_about(expression: str) -> str:
    """Return what is wrong with a capture filter; empty when it is valid, or cannot be checked without libpcap."""
    try:
        compile_filter(expression)
    except LiveError as error:
        return str(error)
    except NotBuiltInError:
        try:
            return bpf.complaint_of_libpcap(expression)
        except LookupError:
            return ""
    return ""


def _prepare(code: Assembler, link_type: int) -> None:
    """Generate code that finds IP, the protocol above it and its ports, once for all tests."""
    v4, v6, done = code.label(), code.label(), code.label()
    for cell, number in ((_PROTOCOL, _NO_PROTOCOL), (_PORTS, 0)):
        code.do(bpf.LOAD_NUMBER, number)
        code.do(bpf.STORE, cell)
    _find_network(code, link_type)
    code.do(bpf.LOAD_X_MEMORY, _NETWORK)
    code.do(bpf.LOAD_MEMORY, _ETHERTYPE)
    code.test(bpf.EQUAL, 0x0800, v4, -1)
    code.test(bpf.EQUAL, 0x86DD, v6, done)
    code.place(v4)
    code.do(bpf.LOAD_OCTET_X, 9)
    code.do(bpf.STORE, _PROTOCOL)
    code.do(bpf.LOAD_HALF_X, 6)
    code.test(bpf.ANY_BIT, 0x1FFF, done, -1)
    code.do(bpf.LOAD_OCTET_X, 0)
    code.do(bpf.AND, 0x0F)
    code.do(bpf.SHIFT_LEFT, 2)
    code.do(bpf.ADD_X)
    code.do(bpf.STORE, _PORTS)
    code.jump(done)
    code.place(v6)
    code.do(bpf.LOAD_OCTET_X, 6)
    code.do(bpf.STORE, _PROTOCOL)
    code.do(bpf.X_TO_A)
    code.do(bpf.ADD, 40)
    code.do(bpf.STORE, _PORTS)
    code.place(done)


def _find_network(code: Assembler, link_type: int) -> None:
    """Generate code that stores where the network layer begins, and its EtherType."""
    typed = code.label()
    if link_type == RAW_IP:
        v6 = code.label()
        code.do(bpf.LOAD_NUMBER, 0)
        code.do(bpf.STORE, _NETWORK)
        code.do(bpf.LOAD_OCTET, 0)
        code.do(bpf.AND, 0xF0)
        code.test(bpf.EQUAL, 0x60, v6, -1)
        code.do(bpf.LOAD_NUMBER, 0x0800)
        code.do(bpf.STORE, _ETHERTYPE)
        code.jump(typed)
        code.place(v6)
        code.do(bpf.LOAD_NUMBER, 0x86DD)
        code.do(bpf.STORE, _ETHERTYPE)
    else:
        for tags in range(_MAX_INNER_TAGS + 1):
            tagged = code.label()
            code.do(bpf.LOAD_NUMBER, 14 + 4 * tags)
            code.do(bpf.STORE, _NETWORK)
            code.do(bpf.LOAD_HALF, 12 + 4 * tags)
            code.do(bpf.STORE, _ETHERTYPE)
            if tags < _MAX_INNER_TAGS:
                for tag in _TAGS[:-1]:
                    code.test(bpf.EQUAL, tag, tagged, -1)
                code.test(bpf.EQUAL, _TAGS[-1], tagged, typed)
            code.place(tagged)
    code.place(typed)


def _generate(code: Assembler, node: Node, yes: int, no: int) -> None:
    if isinstance(node, Not):
        _generate(code, node.of, no, yes)
    elif isinstance(node, Both):
        # Chains of `and` and `or` nest to the left and may be long, so this is a loop and not a recursion.
        chain: list[tuple[Both, int, int]] = []
        left: Node = node
        while isinstance(left, Both):
            middle = code.label()
            chain.append((left, yes, no))
            yes, no = (middle, no) if left.word == "and" else (yes, middle)
            left = left.left
        _generate(code, left, yes, no)
        for both, if_yes, if_no in reversed(chain):
            code.place(yes if both.word == "and" else no)
            _generate(code, both.right, if_yes, if_no)
            yes, no = if_yes, if_no
    elif node.kind == "port":
        _port(code, node, yes, no)
    elif node.kind == "address":
        _address(code, node, yes, no)
    elif node.kind == "vlan":
        _vlan(code, node.number, yes, no)
    else:
        code.do(bpf.LOAD_MEMORY, _ETHERTYPE if node.kind == "ethertype" else _PROTOCOL)
        code.test(bpf.EQUAL, node.number, yes, no)


def _port(code: Assembler, node: Primitive, yes: int, no: int) -> None:
    code.do(bpf.LOAD_MEMORY, _PROTOCOL)
    ports = code.label()
    wanted = [_PROTOCOLS[node.protocol]] if node.protocol else [_PROTOCOLS[name] for name in _WITH_PORTS]
    for protocol in wanted[:-1]:
        code.test(bpf.EQUAL, protocol, ports, -1)
    code.test(bpf.EQUAL, wanted[-1], ports, no)
    code.place(ports)
    code.do(bpf.LOAD_MEMORY, _PORTS)
    code.test(bpf.EQUAL, 0, no, -1)
    code.do(bpf.LOAD_X_MEMORY, _PORTS)
    offsets = {"src": (0,), "dst": (2,)}.get(node.side, (0, 2))
    for offset in offsets:
        miss = no if offset == offsets[-1] else code.label()
        code.do(bpf.LOAD_HALF_X, offset)
        if node.number == node.last:
            code.test(bpf.EQUAL, node.number, yes, miss)
        else:
            code.test(bpf.AT_LEAST, node.number, -1, miss)
            code.test(bpf.GREATER, node.last, miss, yes)
        if miss != no:
            code.place(miss)


def _address(code: Assembler, node: Primitive, yes: int, no: int) -> None:
    """Generate code that tests an address of an IP packet; for IPv4 also of ARP and RARP, as in libpcap."""
    network = node.network
    assert network is not None
    layouts: tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]
    layouts = (((2048,), (12, 16)), ((2054, 32821), (14, 24))) if network.version == 4 else (((34525,), (8, 24)),)
    for types, places in layouts:
        other = no if types == layouts[-1][0] else code.label()
        found = code.label()
        code.do(bpf.LOAD_MEMORY, _ETHERTYPE)
        for ethertype in types[:-1]:
            code.test(bpf.EQUAL, ethertype, found, -1)
        code.test(bpf.EQUAL, types[-1], found, other)
        code.place(found)
        code.do(bpf.LOAD_X_MEMORY, _NETWORK)
        wanted = {"src": places[:1], "dst": places[1:]}.get(node.side, places)
        for place in wanted:
            miss = no if place == wanted[-1] else code.label()
            _compare(code, network, place, yes, miss)
            if miss != no:
                code.place(miss)
        if other != no:
            code.place(other)


def _compare(
    code: Assembler, network: ipaddress.IPv4Network | ipaddress.IPv6Network, place: int, yes: int, no: int
) -> None:
    """Generate code that compares the octets at X plus ``place`` with a network, word by word."""
    wanted, mask = network.network_address.packed, network.netmask.packed
    for at in range(0, len(mask), 4):
        bits = int.from_bytes(mask[at : at + 4], "big")
        if not bits:
            break
        code.do(bpf.LOAD_WORD_X, place + at)
        if bits != 0xFFFFFFFF:
            code.do(bpf.AND, bits)
        code.test(bpf.EQUAL, int.from_bytes(wanted[at : at + 4], "big"), -1, no)
    code.jump(yes)


def _vlan(code: Assembler, number: int, yes: int, no: int) -> None:
    """Generate code that tests the VLAN tag, which the kernel took out or (without offloading) left in; -1 means any VLAN."""
    inside, tagged = code.label(), code.label()
    code.do(bpf.LOAD_WORD, _VLAN_PRESENT)
    code.test(bpf.EQUAL, 0, inside, -1 if number >= 0 else yes)
    if number >= 0:
        code.do(bpf.LOAD_WORD, _VLAN_TAG)
        code.do(bpf.AND, 0x0FFF)
        code.test(bpf.EQUAL, number, yes, no)
    code.place(inside)
    code.do(bpf.LOAD_HALF, 12)
    for tag in _TAGS[:-1]:
        code.test(bpf.EQUAL, tag, tagged, -1)
    code.test(bpf.EQUAL, _TAGS[-1], tagged, no)
    code.place(tagged)
    if number < 0:
        code.jump(yes)
        return
    code.do(bpf.LOAD_HALF, 14)
    code.do(bpf.AND, 0x0FFF)
    code.test(bpf.EQUAL, number, yes, no)
