"""tshark's view of a capture: connections, and on each the requests with their answers. Nothing here uses the package.

tshark pairs no requests with answers, so this is done here in the simplest way, from its fields: an answer belongs to the
oldest open request of its connection with the same PDU reference from the other side, Job and Userdata separately.
"""

from __future__ import annotations

import tomllib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from tests.testing.golden.tshark_names import (
    ACK_DATA,
    DISCONNECTS,
    FUNCTIONS,
    GROUPS,
    JOB,
    PASSWORD,
    PBC,
    PUSH,
    REJECTIONS,
    REQUEST,
    RESPONSE,
    SECURITY,
    SUBFUNCTIONS,
    USERDATA,
)
from tests.tshark import Tree, ask

_FIN, _SYN, _RESET, _ACKNOWLEDGES = 1, 2, 4, 16
_CR, _CC, _DR, _ER = 0x0E, 0x0D, 0x08, 0x07
_USEND: Final = 0x13


def listed(value: Any) -> list[Any]:
    """Return a value as a list: tshark gives one only if a name occurs more than once."""
    if value is None:
        return []
    return value if isinstance(value, list) else [value]


def raws(tree: Tree, name: str) -> list[tuple[bytes, int]]:
    """Return octets and position of every occurrence of a field."""
    found = tree.get(f"{name}_raw") or []
    each = found if found and isinstance(found[0], list) else [found] if found else []
    # A field of some bits of an octet has an odd number of digits.
    return [(bytes.fromhex(text.zfill(len(text) + len(text) % 2)), at) for text, at, *_ in each]


def number(tree: Tree, name: str, missing: int = 0) -> int:
    """Return a field in either notation; the first one if there are several."""
    found = listed(tree.get(name))
    return int(found[0], 0) if found else missing


def inner(tree: Tree, name: str) -> Tree:
    """Return a subtree, empty when there is none."""
    found = tree.get(name)
    return found if isinstance(found, dict) else {}


class Pdu:
    """An S7 PDU as tshark shows it, without the parts that a golden leaves out (docs/golden.md)."""

    def __init__(self, tree: Tree, octets: bytes, at: int, sender: str) -> None:
        self.sender = sender
        self.header = inner(tree, "s7comm.header")
        self.parameters = inner(tree, "s7comm.param")
        self.data = inner(tree, "s7comm.data")
        self.rosctr = number(self.header, "s7comm.header.rosctr")
        self.reference = number(self.header, "s7comm.header.pduref")
        self.function = number(self.parameters, "s7comm.param.func", -1)
        self.kind = self.group = self.subfunction = -1
        self.usend = False
        if "s7comm.param.userdata.head" in self.parameters:
            self._userdata(self.parameters)
        self._at = at
        self._octets = bytearray(octets)
        self._octets[4:6] = bytes(2)
        self._mask()
        self.octets = bytes(self._octets)
        self.parameter_octets = self._block(tree, "s7comm.param")
        self.data_octets = self._block(tree, "s7comm.data")
        self.error = number(self.header, "s7comm.header.errcls") << 8 | number(self.header, "s7comm.header.errcod")
        for _, place in raws(self.parameters, "s7comm.param.errcod"):
            self.error = number(self.parameters, "s7comm.param.errcod")
            if self.parameter_octets:
                begin = place - raws(tree, "s7comm.param")[0][1]
                self.parameter_octets = self.parameter_octets[:begin] + bytes(2) + self.parameter_octets[begin + 2 :]

    def _userdata(self, head: Tree) -> None:
        # Type and group as two and six bits: docs/oracle.md, userdata-type-of-four-bits.
        octet = number(head, "s7comm.param.userdata.type") << 4 | number(head, "s7comm.param.userdata.funcgroup")
        self.kind, self.group = octet >> 6, octet & 0x3F
        names = ("s7comm.param.userdata.subfunc", "s7comm.param.modetrans.subfunc")
        self.subfunction = next((number(head, name) for name in names if name in head), 0)
        self.function = number(head, "s7comm.param.userdata.head") >> 16
        # docs/oracle.md, usend-as-head: the syntax id is where other userdata state what follows.
        self.usend = number(head, "s7comm.param.userdata.reqres1") == _USEND
        if self.usend:
            self.kind, self.group = PUSH, PBC

    def _block(self, tree: Tree, name: str) -> bytes:
        for octets, place in raws(tree, name):
            begin = place - self._at
            return self.octets[begin : begin + len(octets)]
        return b""

    def _mask(self) -> None:
        """Put zeros at the same places as in a golden, by the positions that tshark gives."""
        head = self.parameters
        if not self.usend and number(head, "s7comm.param.userdata.head") >> 16 == 0:
            goes_on = self.group == PBC and self.kind != RESPONSE and number(head, "s7comm.param.userdata.seq_num")
            self._put(head, "s7comm.param.userdata.seq_num", 1 if goes_on else 0)
            if number(head, "s7comm.param.userdata.dataunitref"):
                self._put(head, "s7comm.param.userdata.dataunitref", 1)
        uploads = (JOB, 0x1E), (JOB, 0x1F), (ACK_DATA, 0x1D)
        if (self.rosctr, self.function) in uploads:
            self._put(head, "s7comm.data.blockcontrol.uploadid", 0)
        if (self.group, self.kind, self.subfunction) == (SECURITY, REQUEST, PASSWORD):
            self._put(self.data, "s7comm.data.userdata", 0)
        self._put(inner(head, "s7comm.param.pistart.parameterblock"), "s7comm.param.pi.n_x.password", 0)
        for item in listed(self.data.get("s7comm.data.item")):
            self._put(item, "s7comm.data.fillbyte", 0)

    def _put(self, tree: Tree, name: str, value: int) -> None:
        for octets, place in raws(tree, name):
            begin = place - self._at
            self._octets[begin : begin + len(octets)] = value.to_bytes(len(octets), "big")

    @property
    def asks(self) -> bool:
        """Return whether it is a request."""
        return self.rosctr == JOB or (self.rosctr == USERDATA and self.kind == REQUEST)

    @property
    def pushes(self) -> bool:
        """Return whether it is unsolicited."""
        return self.rosctr == USERDATA and self.kind == PUSH

    @property
    def name(self) -> str:
        """The function in words."""
        if self.usend:
            return f"{GROUPS[PBC]}: USEND"
        if self.kind >= 0:
            return f"{GROUPS[self.group]}: {SUBFUNCTIONS[self.group][self.subfunction]}"
        return FUNCTIONS[self.function] if self.function >= 0 else "no function"


class Deal:
    """A request and its answer, either of which may be missing. ``asked_by`` is ``client`` or ``server``."""

    def __init__(self, asked: Pdu | None, told: Pdu | None) -> None:
        self.asked = asked
        self.told = told
        self.who = ""
        self.reason = ""

    @property
    def first(self) -> Pdu:
        """The PDU by which it is identified."""
        pdu = self.asked or self.told
        assert pdu is not None
        return pdu


class Shown:
    """A connection as tshark shows it."""

    def __init__(self) -> None:
        self.deals: list[Deal] = []
        self.client = ""
        self.tsaps: dict[str, str] = {}
        self.sizes = [0, 0]  # granted, asked
        self.begun = False
        self.iso = False
        self.confirmed = False
        self.refused = ""
        self.ended = ""
        self.farewell = ""
        self._heard: set[str] = set()
        self._lost: set[str] = set()
        self._waiting: dict[tuple[str, bool, int], list[Deal]] = defaultdict(list)

    def lose(self, sender: str) -> None:
        """Note that octets of ``sender`` are missing here; they may contain its answers."""
        self._lost.add(sender)
        for deal in self.deals:
            if deal.told is None and deal.first.sender != sender:
                deal.reason = deal.reason or "hole"

    def take_tcp(self, sender: str, flags: int) -> None:
        """Note how a connection begins and ends, and which sides were captured."""
        self._heard.add(sender)
        if flags & _SYN:
            self.begun = True
            if not flags & _ACKNOWLEDGES:
                self.client = sender
        if flags & (_FIN | _RESET) and not self.ended:  # the first one: S7-1200 and S7-1500 answer a FIN by a RST
            self.ended = f"{'reset' if flags & _RESET else 'fin'} {sender}"

    def take_tpdu(self, sender: str, tpdu: Tree) -> None:
        """Note the negotiated values, and a DR or ER."""
        self.iso = True
        kind = number(tpdu, "cotp.type")
        if kind == _CR:
            self.client, self.begun = sender, True
        if kind == _CR or (kind == _CC and not self.tsaps):
            for role, name in (("client", "cotp.src-tsap-bytes"), ("server", "cotp.dst-tsap-bytes")):
                if name in tpdu:
                    self.tsaps[role] = str(listed(tpdu[name])[0]).replace(":", " ")
        if kind in {_CR, _CC}:
            self.sizes[kind == _CR] = number(tpdu, "cotp.tpdu_size")
        self.confirmed = self.confirmed or kind == _CC
        if kind == _DR and not self.confirmed:
            self.refused = DISCONNECTS[number(tpdu, "cotp.cause")]
        elif kind in {_DR, _ER} and not self.ended:
            self.ended = f"{'disconnect' if kind == _DR else 'error_tpdu'} {sender}"
            causes = DISCONNECTS if kind == _DR else REJECTIONS
            self.farewell = causes[number(tpdu, "cotp.cause" if kind == _DR else "cotp.reject_cause")]

    def take(self, pdu: Pdu) -> None:
        """Put a PDU in its place."""
        if pdu.asks:
            deal = Deal(pdu, None)
            self.deals.append(deal)
            waits = self._waiting[pdu.sender, pdu.rosctr == USERDATA, pdu.reference]
            for earlier in waits:
                earlier.reason = "reference_reused"
            waits.append(deal)
            return
        waiting = [
            deals
            for (sender, userdata, reference), deals in self._waiting.items()
            if deals and sender != pdu.sender and userdata == (pdu.rosctr == USERDATA) and reference == pdu.reference
        ]
        if waiting and not pdu.pushes:
            waiting[0].pop(0).told = pdu
        else:
            orphan = Deal(None, pdu)
            orphan.reason = "hole" if self._lost - {pdu.sender} else ""
            self.deals.append(orphan)

    def finish(self, servers: frozenset[str]) -> None:
        """Determine client and server, by ports if the beginning is missing, and the side that began each deal."""
        senders = [deal.first.sender for deal in self.deals]
        if not self.client:
            self.client = next((sender for sender in senders if sender.rpartition(" ")[2] not in servers), "")
        for deal in self.deals:
            pdu = deal.first
            client = (pdu.sender == self.client) == (deal.asked is not None or pdu.pushes)
            deal.who = "client" if client else "server"
            if deal.asked is not None and deal.told is None and self._heard == {deal.asked.sender}:
                deal.reason = "one_sided"
            elif deal.asked is not None:
                closed = self.ended and not self.ended.startswith("error_tpdu")
                deal.reason = deal.reason or ("connection_closed" if closed else "capture_ended")
        how, _, sender = self.ended.partition(" ")
        if sender:
            role = "client" if sender == self.client else "server"
            self.ended = f"{how} by {role}"
            if self.farewell:
                self.ended += f' "{"DR" if how == "disconnect" else "ER"} from the {role}: {self.farewell}"'


def ports_of(path: Path) -> list[int]:
    """Return the ports that are treated as TPKT: the file beside a capture names them."""
    table = path.parent / f"{path.name.partition('.')[0]}.toml"
    told = tomllib.loads(table.read_text(encoding="utf-8")) if table.exists() else {}
    return sorted({102, *told.get("ports", []), *listed(told.get("port"))})


def read_frames(path: Path) -> list[Tree]:
    """Return the layers of every packet. Raises AssertionError where tshark fails, unless the file is cut off."""
    answer = ask(path, ports_of(path))
    assert answer.code == 0 or "cut short" in answer.complaint, answer.complaint
    return answer.packets


def _ends(layers: Tree) -> tuple[str, str, str]:
    """Return the sender, the two ends, and the connection: Wireshark ignores VLANs, so they are told apart here."""
    tcp = inner(layers, "tcp")
    network = inner(layers, "ip") or inner(layers, "ipv6")
    source, target = (
        f"{network.get(f'ip.{end}') or network.get(f'ipv6.{end}')} {tcp[f'tcp.{end}port']}" for end in ("src", "dst")
    )
    stacks = [(name, tree) for name in ("vlan", "ieee8021ad") for tree in listed(layers.get(name))]
    tags = [f"{name} {tag}" for name, tree in stacks if isinstance(tree, dict) and (tag := number(tree, f"{name}.id"))]
    return source, " ".join([*sorted((source, target)), *tags]), " ".join([tcp["tcp.stream"], *tags])


def read_shown(path: Path) -> list[Shown]:
    """Return the connections with S7 or a protocol below it, as tshark shows them."""
    connections: list[Shown] = []
    streams: dict[str, Shown] = {}
    latest: dict[str, Shown] = {}
    for layers in read_frames(path):
        if "tcp.stream" not in inner(layers, "tcp"):
            continue
        sender, pair, stream = _ends(layers)
        tpdus = [tpdu for tpdu in listed(layers.get("cotp")) if isinstance(tpdu, dict)]
        known = streams.get(stream)
        # A stream is one TCP connection, in which a CR begins another ISO connection.
        anew = known is not None and known.deals and any(number(tpdu, "cotp.type") == _CR for tpdu in tpdus)
        if known is None or anew:
            before = latest.get(pair)
            if before is not None and not before.ended:
                before.ended = "replaced" if anew else "reused"
            streams[stream] = latest[pair] = Shown()
            connections.append(streams[stream])
        shown = streams[stream]
        if _lost(layers["tcp"].get("tcp.analysis")):
            shown.lose(sender)
        for tpdu in tpdus:
            shown.take_tpdu(sender, tpdu)
        for tree, (octets, at) in _messages(layers):
            shown.take(Pdu(tree, octets, at, sender))
        shown.take_tcp(sender, number(layers["tcp"], "tcp.flags"))
    servers = frozenset(str(port) for port in ports_of(path))
    for shown in connections:
        shown.finish(servers)
    return [shown for shown in connections if shown.deals or shown.iso]


def _lost(tree: Any) -> bool:
    """Return whether tshark misses octets before a segment, according to its remarks."""
    if isinstance(tree, dict):
        return "tcp.analysis.lost_segment" in tree or any(_lost(value) for value in tree.values())
    return isinstance(tree, list) and any(_lost(value) for value in tree)


def _messages(layers: Tree) -> Iterator[tuple[Tree, tuple[bytes, int]]]:
    trees = [tree for tree in listed(layers.get("s7comm")) if isinstance(tree, dict)]
    return zip(trees, raws(layers, "s7comm"), strict=True)
