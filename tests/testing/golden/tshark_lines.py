"""tshark's view of a request and its answer, written line by line like a golden, only by tables."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Final

from tests.testing.golden.tshark_names import (
    ACK_DATA,
    BIT,
    BLOCK_TYPES,
    CHAR,
    DB_AREA,
    DI_AREA,
    FILE_SYSTEMS,
    FORMS,
    JOB,
    LETTERS,
    NAMED,
    NUMBERED,
    PBC,
    READ,
    REALS,
    RECORD_AREA,
    RESPONSE,
    ROSCTRS,
    S7ANY,
    SETUP,
    SIZES,
    TYPES,
    WRITE,
)
from tests.testing.golden.tshark_view import Deal, Pdu, Shown, inner, listed, number, raws
from tests.tshark import Tree

GOOD: Final = 0xFF
_ITEM: Final = "s7comm.param.item"
_DATA: Final = "s7comm.data.item"


def link_lines(shown: Shown) -> list[str]:
    """Return the facts of a connection."""
    lines = ["protocol s7comm"] if shown.deals else []
    lines += [f"{role} TSAP <{shown.tsaps[role]}>" for role in ("client", "server") if role in shown.tsaps]
    if any(shown.sizes):
        lines.append(f"TPDU size {shown.sizes[0]}, asked {shown.sizes[1]}")
    if not shown.begun:
        lines.append("begins before the capture")
    lines += [f'refused "{shown.refused}"'] if shown.refused else []
    return [*lines, *([f"ends {shown.ended}"] if shown.ended else [])]


def deal_lines(deal: Deal, by_form: bool, plain: bool, whole: frozenset[str]) -> list[str]:
    """Return the block of a request and its answer.

    The form is that of a golden, and everything it contains must then be here, too: ``by_form`` with items or sizes, ``plain``
    with the answer in them, ``whole`` names the halves written as octets of the whole PDU.
    """
    asked, told = deal.asked, deal.told
    first = deal.first
    by_form = by_form and asked is not None and asked.rosctr == JOB and asked.function in FORMS
    lines = [f"{deal.who} {FORMS[first.function] if by_form else first.name}"]
    if told is None:
        lines.append(f"no answer: {deal.reason}")
    elif asked is None:
        orphan = f"answer without request{f': {deal.reason}' if deal.reason else ''}"
        lines.append("wants no answer" if told.pushes else orphan)
    if by_form and asked is not None:
        shown = told if plain else None
        lines += _setup_lines(asked, shown) if first.function == SETUP else _item_lines(asked, shown)
    elif asked is not None:
        lines += _half("request", asked, "request" in whole)
        lines += [f"# {fact}" for fact in facts(asked)]
    if told is not None and not (by_form and plain):
        name = "says" if told.pushes else "answer"
        lines += _half(name, told, name in whole)
        # A remark on an answer that does not belong to the request has no form.
        lines += [f"# {fact}" for fact in facts(told)] if told.name == first.name else []
    return lines


# ---- blocks ---------------------------------------------------------------------------------------------------------


def _half(name: str, pdu: Pdu, whole: bool) -> Iterator[str]:
    if whole:
        yield f"{name} octets <{pdu.octets.hex(' ')}>"
    else:
        yield f"{name} {ROSCTRS.get(pdu.rosctr, pdu.rosctr)}"
        if pdu.error:
            yield f"refused 0x{pdu.error:04x}"
        if pdu.parameter_octets:
            yield f"parameters <{pdu.parameter_octets.hex(' ')}>"
        if pdu.data_octets:
            yield f"data <{pdu.data_octets.hex(' ')}>"


def facts(pdu: Pdu) -> Iterator[str]:
    """Yield the facts of a remark on a PDU, as `tests.testing.golden.golden_said` finds them there."""
    parameters, data = pdu.parameters, pdu.data
    if "s7comm.data.userdata.szl_id" in data:
        szl = number(data, "s7comm.data.userdata.szl_id"), number(data, "s7comm.data.userdata.szl_index")
        yield f"SZL 0x{szl[0]:04x} index 0x{szl[1]:04x}"
    if "s7comm.param.pistart.servicename" in parameters:
        yield f"service {parameters['s7comm.param.pistart.servicename']}"
    for block in [parameters, inner(parameters, "s7comm.param.pistart.parameterblock")]:
        yield from _files(block)
    if "s7comm.data.blockcontrol.loadmem_len" in parameters:
        code = parameters["s7comm.data.blockcontrol.mc7code_len"]
        yield f"{int(parameters['s7comm.data.blockcontrol.loadmem_len'])} bytes, {int(code)} of them MC7 code"
    if parameters.get("s7comm.param.blockcontrol.upl_lenstring"):
        yield f"{int(parameters['s7comm.param.blockcontrol.upl_lenstring'])} bytes"
    if pdu.rosctr == ACK_DATA and number(
        inner(parameters, "s7comm.param.blockcontrol.functionstatus_tree"),
        "s7comm.param.blockcontrol.functionstatus.more",
    ):
        yield "more to come"
    if pdu.rosctr == ACK_DATA and "s7comm.data.blockcontrol.unknown1" in data:
        yield f"{number(data, 's7comm.data.length')} bytes"
    yield from _blocks(pdu)
    if "s7comm.data.ts_tree" in data and pdu.group != PBC:
        yield from _time(inner(data, "s7comm.data.ts_tree"))
    if "s7comm.pbc.req.bsend.r_id" in data:
        yield f"R_ID 0x{number(data, 's7comm.pbc.req.bsend.r_id'):08x}"
        if "s7comm.pbc.req.bsend.len" in data:
            yield f"{number(data, 's7comm.pbc.req.bsend.len')} bytes"


def _files(tree: Tree) -> Iterator[str]:
    for name in listed(tree.get("s7comm.param.blockcontrol.filename_tree")):
        kind, block, system = (
            str(name[f"s7comm.data.blockcontrol.{part}"]) for part in ("block_type", "block_number", "dest_filesys")
        )
        yield f"{BLOCK_TYPES.get(kind, kind)} {int(block)}, {FILE_SYSTEMS.get(system, system)}"


def _blocks(pdu: Pdu) -> Iterator[str]:
    data = pdu.data
    if "s7comm.data.blockinfo.block_number" in data:
        kind = BLOCK_TYPES[data["s7comm.blockinfo.blocktype"]]
        system = FILE_SYSTEMS[data["s7comm.data.blockinfo.filesys"]]
        yield f"{kind} {int(data['s7comm.data.blockinfo.block_number'])}, {system}"
    elif pdu.kind == RESPONSE and "s7comm.blockinfo.block_num" in data:
        yield f"block {data['s7comm.blockinfo.block_num']}"
    elif "s7comm.blockinfo.blocktype" in data:
        yield BLOCK_TYPES[data["s7comm.blockinfo.blocktype"]]
    for item in listed(data.get(_DATA)):
        if "s7comm.blockinfo.block_count" in item:
            kind = item["s7comm.blockinfo.blocktype"]
            yield f"{item['s7comm.blockinfo.block_count']} {BLOCK_TYPES.get(kind, kind)}"
        elif "s7comm.blockinfo.block_num" in item:
            yield f"block {item['s7comm.blockinfo.block_num']}"


def _time(tree: Tree) -> Iterator[str]:
    parts = [number(tree, f"s7comm.data.ts_{name}") for name in ("year2", "month", "day", "hour", "minute", "second")]
    if any(parts):
        year = parts[0] + (1900 if parts[0] >= 90 else 2000)
        date = f"{year}-{parts[1]:02}-{parts[2]:02}"
        clock = f"{parts[3]:02}:{parts[4]:02}:{parts[5]:02}.{number(tree, 's7comm.data.ts_millisecond'):03}"
        yield f"DT#{date}-{clock}"


# ---- forms ----------------------------------------------------------------------------------------------------------


def _setup_lines(asked: Pdu, told: Pdu | None) -> Iterator[str]:
    for verb, pdu in (("asks", asked), ("gets", told)):
        if pdu is not None:
            names = ("pdu_length", "maxamq_calling", "maxamq_called")
            size, calling, called = (number(pdu.parameters, f"s7comm.param.{name}") for name in names)
            yield f"{verb} PDU {size}, AmQ {calling}/{called}"


def _item_lines(asked: Pdu, told: Pdu | None) -> Iterator[str]:
    items = listed(asked.parameters.get(_ITEM))
    octets = [each for each, _ in raws(asked.parameters, _ITEM)]
    written = listed(asked.data.get(_DATA)) if asked.function == WRITE else []
    answers = listed(told.data.get(_DATA)) if told is not None else []
    heads = [each for each, _ in raws(told.data, _DATA)] if told is not None else []
    for index, item in enumerate(items):
        text, size = _item(item, octets[index])
        answer = answers[index] if index < len(answers) else None
        code = number(answer, "s7comm.data.returncode", -1) if answer is not None else -1
        holder = written[index] if index < len(written) else answer if code == GOOD and asked.function == READ else None
        if holder is not None:
            data = bytes.fromhex(str(holder.get("s7comm.resp.data", "")).replace(":", ""))
            text += f" = {_value(item, data)}"
            came = number(holder, "s7comm.data.transportsize")
            text += f" as {SIZES.get(came, hex(came))}" if came != size else ""
        if code not in {-1, GOOD}:
            text += f" refused 0x{code:02x}"
            # tshark does not read the part after the code, but gives its octets (docs/oracle.md, kept-from-before).
            head = heads[index][1:4] if asked.function == READ and index < len(heads) else b""
            text += f" head <{head.hex(' ')}>" if any(head) else ""
        yield text


def _item(item: Tree, octets: bytes) -> tuple[str, int]:
    """Return the name of a request item, and the data transport size for its type."""
    if (
        number(item, "s7comm.param.item.syntaxid") != S7ANY
        or number(item, "s7comm.param.item.transp_size") not in TYPES
    ):
        return f"item <{octets.hex(' ')}>", 4
    if "s7comm.readrec.id" in item:  # docs/oracle.md, address-of-a-record
        number_, index, count = (number(item, f"s7comm.readrec.{name}") for name in ("id", "index", "mlen"))
        return f"RECORD{number_}@{index} BYTE x{count}", 4
    kind, area = number(item, "s7comm.param.item.transp_size"), number(item, "s7comm.param.item.area")
    name, width, _, size = TYPES[kind]
    place = inner(item, "s7comm.param.item.address_tree")
    octet = f"{place.get('s7comm.param.item.address.byte', '')}" + (
        f".{place['s7comm.param.item.address.bit']}" if kind == BIT else ""
    )
    db = number(item, "s7comm.param.item.db")
    if area in {DB_AREA, DI_AREA}:
        letters = "DB" if area == DB_AREA else "DI"
        text = f"{letters}{db}.{letters}{width}{octet}"
    elif area in NUMBERED:
        text = f"{NUMBERED[area]}{number(item, 's7comm.param.item.address')}"
    elif area == RECORD_AREA:
        text = f"RECORD{db}@{number(item, 's7comm.param.item.address')}"
    elif area in LETTERS:
        text = f"{LETTERS[area]}{'' if kind == BIT else width}{octet}"
    else:
        text = f"{NAMED[area]}:{width}{octet}"
    count = number(item, "s7comm.param.item.length")
    text += f" {name}" + (f" x{count}" if count != 1 else "")
    return text + (f" db {db}" if db and area not in {DB_AREA, DI_AREA, RECORD_AREA} else ""), size


def _value(item: Tree, data: bytes) -> str:
    """Return the value of an item from its octets; floating-point numbers and texts as their octets."""
    if number(item, "s7comm.param.item.transp_size", -1) not in TYPES:
        return f"<{data.hex(' ')}>"
    kind, count = number(item, "s7comm.param.item.transp_size"), number(item, "s7comm.param.item.length")
    name, _, form, _ = TYPES[kind]
    if kind == CHAR and len(data) == count:
        return f"chars {data.hex()}"
    if kind in REALS and len(data) == struct.calcsize(form) * count:
        return data.hex()
    bits_only = kind != BIT or all(octet in {0, 1} for octet in data)
    if form and data and bits_only and not (name == "BYTE" and len(data) > 1) and kind not in REALS:
        if len(data) == struct.calcsize(form) * count:
            found = [value for (value,) in struct.iter_unpack(form, data)]
            texts = [str(value).lower() if kind == BIT else repr(value) for value in found]
            return texts[0] if len(texts) == 1 else f"[{', '.join(texts)}]"
    return f"<{data.hex(' ')}>"
