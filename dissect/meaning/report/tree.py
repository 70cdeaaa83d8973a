"""The field tree of one PDU or TPDU: every field with its octet range, value and meaning, then a hex view."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, TypeVar

from dissect.meaning.report import words
from dissect.meaning.report.plus_blobs import blob_lines
from dissect.meaning.report.tree_fields import field_line, fields_text, line_head, line_of, meaning, span
from dissect.protocols.ibh import layouts as ibh
from dissect.protocols.ibh.packet import IbhPacket, parse_packet
from dissect.protocols.iso import layouts as iso
from dissect.protocols.iso.cotp import Parameter, parse_tpdu
from dissect.protocols.s7 import layouts as s7
from dissect.protocols.s7.bodies import parse_body
from dissect.protocols.s7.data_parts import CONTENT, RETURN_CODE
from dissect.protocols.s7.errors import errors_of
from dissect.protocols.s7.hiding import secret_spans, secret_spans_within
from dissect.protocols.s7.message import Pdu
from dissect.protocols.s7plus import layouts as s7plus
from dissect.protocols.s7plus.contents import Contents
from dissect.protocols.s7plus.hiding import Shown, shown_contents
from dissect.protocols.s7plus.ids import HIDDEN
from dissect.protocols.s7plus.message import PlusPdu, fixed_part
from dissect.protocols.s7plus.tables import KEEP_ALIVE, SYSTEM_EVENT
from dissect.wire.hexdump import hexdump
from dissect.wire.layout import FieldValue, Layout
from dissect.wire.malformed import Malformed
from dissect.wire.part import FILL, OCTETS, Part
from dissect.wire.text import printable, shortened

#: Maximum number of characters of the note on a part that are shown.
_NOTE: Final = 120
_TPKT_SIZE: Final = 4
#: The head of a TPKT and of the everyday DT in it.
_DT_HEAD: Final = 7
_LI_AT: Final = 4
_DT: Final = b"\x02\xf0"
#: Lines of PDUs up to this size are kept, because traffic repeats itself; each cache holds up to `_MOST` entries.
_SMALL: Final = 256
_MOST: Final = 4096
#: Maximum number of octets of a PDU in its hex view, which takes five times their memory: an S7comm-plus PDU may have 8 MiB.
MAX_HEX: Final = 1 << 20
#: Maximum number of frames of a PDU that are listed; the others are counted.
_MOST_FRAMES: Final = 100
# Why no single packet carries the whole of an S7comm-plus PDU.
REASSEMBLED: Final = "reassembled from several frames or fragments"
DECRYPTED: Final = "decrypted"
_ACK_SIZE: Final = s7.ACK_HEADER.size
#: The PDU reference in the header: the number of its field, the field, and its first octet and the one after its last.
_REF_NUMBER: Final = [field.name for field in s7.HEADER.fields].index("pdu_ref")
_REF: Final = s7.HEADER.fields[_REF_NUMBER]
_REF_AT: Final[int] = s7.PDU_REF.start
_REF_END: Final[int] = s7.PDU_REF.stop
_VARIABLES: Final = s7.VARIABLES_HEAD
_Key = TypeVar("_Key")
_Shown = TypeVar("_Shown")


def tree_lines(pdu: Pdu, packet: bytes, through_gateway: bool = False) -> list[str]:
    """Return the lines of `tree_text`."""
    return tree_text(pdu, packet, through_gateway).split("\n")


def tree_text(pdu: Pdu, packet: bytes, through_gateway: bool = False) -> str:
    """Return the tree of ``pdu`` and the hex view below it, lines with line feeds between them.

    ``packet`` is the packet that carried the whole PDU: a TPKT or, ``through_gateway``, an IBH-NetLink packet. Offsets then
    count from its first octet. It is empty if the PDU came in several fragments or was cut; offsets then count from the first
    octet of the S7 PDU.
    """
    octets = pdu.octets
    whole = packet or octets
    base = len(whole) - len(octets)
    if packet:
        top = "\n".join(_netlink(parse_packet(packet))) if through_gateway else _packet(packet, base)
    else:
        parts = "MPI packets" if through_gateway else "COTP fragments"
        why = "truncated by the capture" if pdu.cut else f"reassembled from several {parts}"
        top = f"    {why}; offsets count from the start of the S7 PDU"
    texts = [top, _header(pdu, base)]
    if pdu.error and pdu.parameters.userdata is None:
        codes = errors_of(pdu.function)
        texts.append(line_of("", "error", f"{codes.coded(pdu.error)}. {codes.text(pdu.error)}".rstrip()))
    hidden = secret_spans(octets)
    body = _body_text(pdu, base, hidden)
    if body:
        texts.append(body)
    texts.append("")
    texts += hexdump(whole, 0, [(begin + base, end + base) for begin, end in hidden], "    ")
    texts.append("")
    return "\n".join(texts)


def tpdu_tree_lines(packet: bytes) -> Iterator[str]:
    """Yield the tree of a TPKT whose TPDU carries no S7 PDU, and the hex view below it."""
    yield from _packet(packet).split("\n")
    data = parse_tpdu(_tpdu(packet)).data
    hidden = secret_spans_within(packet)
    if data:
        said = "not shown" if hidden else words.octets(data)
        yield line_of(span(len(packet) - len(data), len(packet)), "user data", said)
    yield from _octets(packet, hidden)


def carrier_tree_text(packet: bytes) -> str:
    """Return the headers of a TPKT.

    Its content is shown with its PDU, because a part of a PDU may contain a part of a secret.
    """
    return f"{_packet(packet)}\n"


def netlink_tree_lines(octets: bytes) -> Iterator[str]:
    """Yield the tree of an IBH-NetLink packet that carries no S7 PDU, and the hex view below it."""
    packet = parse_packet(octets)
    yield from _netlink(packet)
    hidden = secret_spans_within(octets)
    if packet.data:
        said = "not shown" if hidden else words.octets(packet.data)
        yield line_of(span(packet.data_at, packet.data_at + len(packet.data)), "user data", said)
    elif len(octets) > _headers(packet):
        said = "not shown" if hidden else words.octets(octets[_headers(packet) :])
        yield line_of(span(_headers(packet), len(octets)), "octets", said)
    yield from _octets(octets, hidden)


def plus_tree_lines(
    pdu: PlusPdu, packet: bytes, why: str = REASSEMBLED, contents: Shown | None = None
) -> Iterator[str]:
    """Yield the tree of an S7comm-plus PDU and the hex view below it.

    ``packet`` as for `tree_text`. ``why`` says why it is empty: `REASSEMBLED`, `DECRYPTED`, or "" if unknown. ``contents`` are
    the decoded contents with their parts, if they were decoded before.
    """
    whole = packet or pdu.octets
    base = len(whole) - len(pdu.octets)
    if packet:
        yield from _packet(packet, base).split("\n")
    else:
        why = "the end is missing" if pdu.cut else why
        yield f"    {why}{'; ' if why else ''}offsets count from the start of the S7comm-plus PDU"
    at = base
    yield from _layout(s7plus.KEEP_ALIVE if pdu.version == KEEP_ALIVE else s7plus.HEADER, whole, at)
    at += s7plus.HEADER.size
    if pdu.integrity:
        yield from _layout(s7plus.INTEGRITY, whole, at)
        yield line_of(span(at + 1, at + 1 + len(pdu.integrity)), "digest", words.octets(pdu.integrity))
    if pdu.frames > 1:
        yield from _plus_frames(pdu, base)
    layout = fixed_part(pdu)
    taken = 0
    if layout is not None:
        yield f"    {layout.name}"
        for value in layout.read(pdu.data, 0):
            yield line_of(_plus_span(pdu, int(value.offset), int(value.end), base), value.field.label, meaning(value))
        taken = layout.size
    found, hidden = contents if contents is not None else shown_contents(pdu)
    if found.parts:
        yield from _plus_parts(pdu, found, base, hidden)
    elif taken < len(pdu.data):
        rest = words.octets(pdu.data[taken:])
        yield line_of(_plus_span(pdu, taken, len(pdu.data), base), "octets", rest)
    yield from _malformed([fact.at(pdu.place(fact.offset)) for fact in found.malformed], base)
    if pdu.whole and pdu.version not in {SYSTEM_EVENT, KEEP_ALIVE}:
        yield from _layout(s7plus.HEADER, whole, len(whole) - s7plus.HEADER.size, "S7comm-plus trailer")
    yield from _malformed(pdu.malformed, base)
    yield from _octets(whole[:MAX_HEX], [(begin + base, stop + base) for begin, stop in hidden])
    if len(whole) > MAX_HEX:
        yield f"    {words.count(len(whole) - MAX_HEX, 'more byte')} left out of this view"


def _plus_span(pdu: PlusPdu, begin: int, end: int, base: int) -> str:
    """Return the place in a PDU of some octets of its data."""
    return span(pdu.place(begin) + base, pdu.place(max(begin, end - 1)) + 1 + base)


def _plus_frames(pdu: PlusPdu, base: int) -> Iterator[str]:
    """Yield the place of each frame of a PDU, its header and digest, and the size of its data."""
    yield line_of("", "data", f"{words.count(len(pdu.data), 'byte')} in {pdu.frames} frames")
    for number, (at, begin, end) in enumerate(pdu.frame_places[:_MOST_FRAMES], 1):
        yield line_of(span(at + base, end + base), f"frame {number}", words.count(end - begin, "byte"))
    if pdu.frames > _MOST_FRAMES:
        yield line_of("", "", words.count(pdu.frames - _MOST_FRAMES, "more frame"))


def _plus_parts(pdu: PlusPdu, found: Contents, base: int, hidden: Sequence[tuple[int, int]]) -> Iterator[str]:
    """Yield the contents of an S7comm-plus PDU; a part inside another part is indented under it.

    ``hidden`` are (begin, end) of secrets in the PDU, which are not shown.
    """
    blobs = found.blobs[::-1]
    for part in found.parts:
        indent = "  " * part.depth
        yield f"    {indent}{part.layout.name}{f': {shortened(part.note, _NOTE)}' if part.note else ''}"
        for value in part.read():  # not kept, because there may be many
            begin = pdu.place(int(value.offset))
            stop = pdu.place(max(int(value.offset), int(value.end) - 1)) + 1
            where = span(begin + base, stop + base)
            secret = value.octets is not None and any([low <= begin < high for low, high in hidden])
            said = HIDDEN if secret else meaning(value)
            yield f"{indent}{line_of(where, value.field.label, said)}"
        while blobs and blobs[-1][1] <= part.end:
            begin, stop = blobs.pop()
            for line in blob_lines(pdu.data[begin:stop]):
                yield f"{indent}                 {line}"


def _netlink(packet: IbhPacket) -> Iterator[str]:
    yield from _layout(ibh.IBH, packet.octets, 0)
    if packet.mpi is not None:
        yield from _layout(packet.mpi, packet.octets, ibh.IBH.size)
    yield from _malformed(packet.malformed, 0)


def _headers(packet: IbhPacket) -> int:
    return ibh.IBH.size + (packet.mpi.size if packet.mpi is not None else 0)


def _malformed(facts: list[Malformed], base: int) -> Iterator[str]:
    """Yield the faults in the wording of the other reports, and their octets in this tree."""
    for fact in facts:
        what = "TRUNCATED" if fact.limit == "snaplen" else fact.word
        yield f"    {what}  {fact}{f' (byte {fact.offset + base} here)' if base else ''}"


def _octets(whole: bytes, hidden: Sequence[tuple[int, int]] = ()) -> list[str]:
    return ["", *hexdump(whole, 0, hidden, "    "), ""]


def _packet(packet: bytes, base: int = 0) -> str:
    """Return the lines of a TPKT and the head of the TPDU in it.

    The PDU in it begins at ``base``; 0 means that there is none.
    """
    if len(packet) < _DT_HEAD or packet[_LI_AT : _LI_AT + 2] != _DT:
        return "\n".join(_tpkt(packet, base))
    head = packet[:_DT_HEAD]
    text = _heads.get(head)  # only the head of a DT without parameters is shown
    if text is None:
        text = _kept(_heads, head, "\n".join(_tpkt(packet)))
    return text


def _tpdu(packet: bytes) -> bytes:
    """Return the TPDU in a TPKT, empty if there is none."""
    return packet[_TPKT_SIZE:] if len(packet) > _TPKT_SIZE else b""


def _tpkt(packet: bytes, base: int = 0) -> Iterator[str]:
    """Yield the lines of a TPKT and the head of its TPDU, which ends where the PDU begins (``base``), whatever its length."""
    yield from _layout(iso.TPKT, packet, 0)
    tpdu = parse_tpdu(_tpdu(packet))
    yield f"    COTP {tpdu.name}"
    whole = not base or _TPKT_SIZE + len(tpdu.head) == base
    for value in tpdu.fields if whole else iso.DT.read(packet[_TPKT_SIZE:base]):
        yield field_line(value, _TPKT_SIZE)
    for parameter in tpdu.parameters if whole else ():
        yield _parameter(parameter)
    yield from _malformed(tpdu.malformed, _TPKT_SIZE)


def _parameter(parameter: Parameter) -> str:
    start = _TPKT_SIZE + parameter.offset
    said = words.octets(parameter.value)
    if parameter.code in {0xC1, 0xC2} and parameter.value.isascii():
        said += f"  {printable(parameter.value.decode('ascii'))!r}" if len(parameter.value) > 2 else ""
    # The name of 0xC1 has a second half, after "(CR", for its meaning in an ER.
    return line_of(span(start, start + 2 + len(parameter.value)), parameter.name.partition(" (CR")[0], said)


def _layout(layout: Layout, octets: bytes, at: int, title: str = "") -> list[str]:
    return [f"    {title or layout.name}", *[field_line(value, 0) for value in layout.read(octets, at)]]


def _header(pdu: Pdu, base: int) -> str:
    """Return the lines of the S7 header; those around the PDU reference, which changes most, come from a cache."""
    octets = pdu.octets
    size = int(pdu.header_size)
    if len(octets) < size:
        return "\n".join(_header_lines(octets, size, base))
    key = (octets[:_REF_AT], octets[_REF_END:size], base)
    around = _headers_kept.get(key)
    if around is None:
        lines = _header_lines(octets, size, base)
        at = 1 + _REF_NUMBER
        reference = line_head(span(_REF_AT + base, _REF_END + base), _REF.label)
        around = _kept(_headers_kept, key, ("\n".join([*lines[:at], reference]), "\n".join(lines[at + 1 :])))
    return f"{around[0]}{meaning(FieldValue(_REF, _REF_AT, _REF_END, pdu.pdu_ref))}\n{around[1]}"


def _header_lines(octets: bytes, size: int, base: int) -> list[str]:
    return _layout(s7.ACK_HEADER if size == _ACK_SIZE else s7.HEADER, bytes(base) + octets[:size], base)


def _body_text(pdu: Pdu, base: int, hidden: Sequence[tuple[int, int]]) -> str:
    """Return the lines below the header. The lines of a small PDU are kept, for PDUs that differ only in their reference."""
    octets = pdu.octets
    if not _REF_END <= len(octets) <= _SMALL or hidden:
        return "\n".join(_body(pdu, base, hidden))
    key = (octets[:_REF_AT], octets[_REF_END:], base, pdu.cut)
    text = _bodies.get(key)
    if text is None:
        text = _kept(_bodies, key, "\n".join(_body(pdu, base, hidden)))
    return text


def _body(pdu: Pdu, base: int, hidden: Sequence[tuple[int, int]]) -> list[str]:
    """Return the lines of the parts after the header, and of the faults in them.

    Parts are numbered if there are several of a kind; plain octets continue the part above them. ``hidden`` are (offset, end)
    of secrets, which are not shown.
    """
    body = parse_body(pdu)
    head = pdu.parameters.userdata
    counts: dict[Layout, int] = {}
    for part in body.parts:
        counts[part.layout] = counts.get(part.layout, 0) + 1
    numbers: dict[Layout, int] = {}
    lines: list[str] = []
    for part in body.parts:
        layout = part.layout
        if layout is RETURN_CODE:
            number = numbers.get(layout, 0) + 1
            numbers[layout] = number
            if number == 1:
                lines.append("    return codes")
            (code,) = part.values
            lines.append(line_of(str(code.offset + base), f"item {number}", meaning(code)))
            continue
        if layout not in _WITHOUT_HEADING:
            number = numbers.get(layout, 0) + 1
            numbers[layout] = number
            several = f" {number}" if counts[layout] > 1 or layout in _NUMBERED else ""
            name = f"{pdu.function_name} parameters" if layout is _VARIABLES else _NAMES.get(layout, layout.name)
            note = part.note if not hidden or not _overlap(part.offset, part.end, hidden) else ""
            lines.append(f"    {name}{several}: {shortened(note, _NOTE)}" if note else f"    {name}{several}")
        if head is None and not hidden:
            text = _part_text(part, pdu.octets, base)
            if text:
                lines.append(text)
            continue
        for value in part.values:
            said = head.subfunction_name if head is not None and value.field.name == "subfunction" else ""
            if hidden and _overlap(value.offset, value.end, hidden):
                where = span(value.offset + base, value.end + base)
                lines.append(line_of(where, value.field.label, "not shown"))
            else:
                lines.append(field_line(value, base, said))
    lines += _malformed(body.malformed, base)
    lines += _malformed(pdu.malformed, base)
    return lines


def _part_text(part: Part, octets: bytes, base: int) -> str:
    """Return the lines of the fields of a part. The lines of a part of fixed size are kept, by its place and octets."""
    if part.layout.open:
        return fields_text(part.layout, octets, part.offset, part.end, base)
    key = (part.layout, part.offset + base, octets[part.offset : part.end])
    text = _parts.get(key)
    if text is None:
        text = _kept(_parts, key, fields_text(part.layout, octets, part.offset, part.end, base))
    return text


def _overlap(begin: int, end: int, spans: Sequence[tuple[int, int]]) -> bool:
    return any([low < end and begin < high for low, high in spans])


#: Octets that belong to the part above them.
_WITHOUT_HEADING: Final = frozenset((CONTENT, FILL, OCTETS))
#: Parts that are numbered even if there is only one, as there may be several.
_NUMBERED: Final = frozenset((s7.ITEM_HEAD, s7.S7ANY_ITEM, s7.DATA_ITEM))
_NAMES: Final = {s7.S7ANY_ITEM: "item"}
#: Caches of lines: heads of DTs by their octets, S7 headers and bodies by their octets without the reference, parts.
_heads: Final[dict[bytes, str]] = {}
_headers_kept: Final[dict[tuple[bytes, bytes, int], tuple[str, str]]] = {}
_bodies: Final[dict[tuple[bytes, bytes, int, bool], str]] = {}
_parts: Final[dict[tuple[Layout, int, bytes], str]] = {}


def _kept(known: dict[_Key, _Shown], key: _Key, shown: _Shown) -> _Shown:
    """Keep ``shown`` under ``key``, and return it; a full cache is emptied first."""
    if len(known) >= _MOST:
        known.clear()
    known[key] = shown
    return shown
