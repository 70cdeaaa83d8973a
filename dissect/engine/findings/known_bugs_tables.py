"""Known bugs and habits of S7 clients, servers and gateways: the sign on the wire, the products, and the remedy.

The facts come from public issue threads of the named projects; ``sources`` has their numbers. The rules add the sentence of a
bug to a finding when they see its sign. A sign does not prove which program sent it: others may do the same.
"""

from __future__ import annotations

from typing import Final

#: The text of a finding about a known bug begins with this.
SEEN: Final = "; seen with "


class KnownBug:
    """A known bug: its ``sign`` on the wire, ``who`` has it, what it ``means``, the ``remedy``, and the ``sources``.

    ``slugs`` are the findings that show it; those in ``told`` mention it in their detail when the sign is seen. ``note`` is the
    text for that.
    """

    __slots__ = ("key", "means", "remedy", "sign", "slugs", "sources", "told", "who")

    def __init__(
        self,
        key: str,
        sign: str,
        who: str,
        means: str,
        remedy: str,
        sources: str,
        slugs: tuple[str, ...] = (),
        told: bool = True,
    ) -> None:
        self.key = key
        self.sign = sign
        self.who = who
        self.means = means
        self.remedy = remedy
        self.sources = sources
        self.slugs = slugs
        self.told = told and bool(slugs)

    def __repr__(self) -> str:
        return f"KnownBug({self.key!r})"

    @property
    def note(self) -> str:
        """The text about it in a finding, after the finding's own detail."""
        return f"{SEEN}{self.who}: {self.remedy}"


_ROWS: Final[tuple[KnownBug, ...]] = (
    KnownBug(
        "one_reference",
        "several requests are pending under one reference, often 0",
        "S7netplus (reference 0 always, when several threads use a connection) and nodes7",
        "an answer may reach the thread that asked for something else",
        "give each thread a connection of its own, or one lock for all requests",
        "S7netplus #204, #250, #295, #384, #387, #467; nodes7 #91",
        ("session.shared_reference",),
        told=False,
    ),
    KnownBug(
        "late_answer",
        "an answer arrives after the client's time-out and is taken for that of the next request",
        "python-snap7, and clients with one reference for all requests",
        "each value belongs to the request before its own",
        "raise the time-out, or close the connection after one",
        "python-snap7 #70",
        ("transaction.unanswered", "transaction.slow"),
        told=False,
    ),
    KnownBug(
        "no_fill_byte",
        "no fill byte stands between the items of a write after one of odd length",
        "nodes7 1.1.2",
        "every later item begins one byte early, and the PLC refuses the whole write (0x8104)",
        "update the library, or write one item at a time",
        "nodes7 #16",
        ("s7.malformed",),
    ),
    KnownBug(
        "numbered_tpdu",
        "the TPDU number counts up (02 f0 81, 02 f0 82 …) instead of staying 0 (02 f0 80)",
        "PLC4X",
        "most devices ignore the number, but some gateways and python-snap7's server answer only TPDUs with number 0",
        "have the client send number 0 (02 f0 80)",
        "PLC4X pull request 1704",
        ("cotp.number_unanswered",),
    ),
    KnownBug(
        "fragments",
        "after a confirm without TPDU size, a request comes in TPDUs of 121 bytes each, or in a DT with length indicator 3",
        "python-snap7",
        "the client falls back to the smallest TPDU size; simple servers do not join the parts",
        "ask for a TPDU size of 1024 in the connect request",
        "python-snap7 #804, #865",
        ("cotp.fragments_unanswered",),
    ),
    KnownBug(
        "short_confirm",
        "the connect confirm has 14 bytes: a TPDU size and no TSAPs",
        "the server of python-snap7",
        "Snap7, what derives from it, and gos7 expect 22 bytes and hang up",
        "have the server repeat both TSAPs in its confirm",
        "python-snap7 #889",
        ("cotp.bare_confirm",),
    ),
    KnownBug(
        "bare_command",
        "a PLC stop (0x29) or a PI service (0x28) has one byte of parameters, the function alone",
        "python-snap7 before pull request 743",
        "a PLC refuses it (0x8104), because the name of the service is missing",
        "update the library",
        "python-snap7 #733",
        ("s7.malformed",),
    ),
    KnownBug(
        "bit_count",
        "an item of type BIT has a count above 1",
        "programs on node-snap7 and python-snap7",
        "a PLC refuses the item (0x06), whatever its address",
        "read the bytes and take the bits from them",
        "node-snap7 #8, #31; python-snap7 #27",
        ("transaction.bit_count",),
    ),
    KnownBug(
        "length_in_bits",
        "a read of 0x4000 or more DINTs or REALs gets too few bytes",
        "servers on python-snap7",
        "the length field counts bits in 16 bits and cannot hold as many",
        "read fewer elements at a time",
        "python-snap7 #804",
        ("transaction.size_mismatch",),
    ),
    KnownBug(
        "small_tpdu",
        "the connect request asks for a TPDU size of 512, the setup for a PDU length of 960",
        "S7netplus",
        "an answer above 491 bytes of data does not fit the TPDU, and the PLC resets the connection",
        "ask for a TPDU size of 1024",
        "S7netplus #21, #145, #327",
        ("session.tpdu_too_small",),
    ),
    KnownBug(
        "fill_bytes_forgotten",
        "a read of many items of odd length fits the PDU length only without their fill bytes",
        "nodes7 and node-red-contrib-s7",
        "18 items give an answer of 241 bytes where 240 were negotiated",
        "count a fill byte for each item of odd length but the last",
        "nodes7 #17; node-red-contrib-s7 #134",
        ("session.read_too_long",),
    ),
    KnownBug(
        "empty_tpdu",
        "an empty TPDU (03 00 00 07 02 f0 00) comes before each answer",
        "CPs of S7-300 and S7-400, and WinAC",
        "nothing is wrong; clients that take it for the answer fail",
        "skip empty TPDUs in the client",
        "S7netplus #107; nodes7 #44",
    ),
    KnownBug(
        "piled_up",
        "connections of one client to a PLC pile up until one is refused",
        "node-red-contrib-s7 and homebridge-plc",
        "the client does not close its connections, and a CPU has few of them (8, 16, 32)",
        "close connections in the client, or use one for all",
        "node-red-contrib-s7 #102, #142; homebridge-plc #32",
        ("cotp.refused", "stream.refused", "session.cut"),
    ),
    KnownBug(
        "last_byte_late",
        "the last byte of an answer comes in a segment of its own, 100 to 300 ms later",
        "LOGO! 0BA8",
        "nothing is wrong; clients that do not wait for the length in the TPKT fail",
        "have the client wait for the whole TPKT",
        "nodes7 #78",
    ),
    KnownBug(
        "not_permitted",
        "an S7-1200 or S7-1500 refuses a read or write with 0x8104 or 0x8304",
        "S7-1200 and S7-1500 as they are delivered",
        "PUT/GET is not permitted, or the block is optimised and has no addresses",
        "permit PUT/GET in the protection settings, and clear optimised block access",
        "many threads in all projects named here",
        ("transaction.refused", "security.protected"),
        told=False,
    ),
)

#: The known bugs by their keys.
KNOWN_BUGS: Final[dict[str, KnownBug]] = {bug.key: bug for bug in _ROWS}
