"""Transfers as their PDUs, in the order in which both ends send them: an upload, and downloads in both forms."""

from __future__ import annotations

import itertools

from tests.engine.findings import events
from tests.engine.transactions.talk import CLIENT, SERVER, Talk, ack_data, dt, job

Said = tuple[int, bytes]


def pieces(octets: bytes, size: int) -> list[tuple[bytes, int]]:
    """Cut a block; beside each piece whether more follow."""
    cut = [octets[at : at + size] for at in range(0, len(octets), size)] or [b""]
    return [(piece, int(number + 1 < len(cut))) for number, piece in enumerate(cut)]


def data(piece: bytes) -> bytes:
    """A piece with its head."""
    return len(piece).to_bytes(2, "big") + b"\0\xfb" + piece


def upload(octets: bytes, name: str, upload_id: int, size: int = 100, ref: int = 1) -> list[Said]:
    """The client reads a block out."""
    said = [(CLIENT, events.start_upload(ref, name)), (SERVER, events.upload_started(ref, upload_id, len(octets)))]
    for number, (piece, more) in enumerate(pieces(octets, size), ref + 1):
        said.append((CLIENT, events.upload(number, upload_id)))
        said.append((SERVER, ack_data(number, bytes((0x1E, more)), data(piece))))
    return [
        *said, (CLIENT, events.end_upload(ref + 900, upload_id)), (SERVER, events.answered(ref + 900, 0x1F)),
    ]  # fmt: skip


def download(octets: bytes, name: str, size: int = 100, ref: int = 1, asks: int = SERVER) -> list[Said]:
    """A block goes to the PLC, which requests the pieces, or, as with python-snap7, in jobs of the client."""
    other = 1 - asks
    said = [(CLIENT, events.request_download(ref, name, len(octets))), (SERVER, events.answered(ref, 0x1A))]
    for number, (piece, more) in enumerate(pieces(octets, size), ref + 1):
        if asks == SERVER:
            said.append((SERVER, events.download_block(number, name)))
            said.append((CLIENT, ack_data(number, bytes((0x1B, more)), data(piece))))
        else:
            named = b"\x1b\0\0\0\0\0\0\0\x09" + name.encode("ascii")
            said.append((CLIENT, job(number, named, data(piece))))
            said.append((SERVER, ack_data(number, bytes((0x1B, more)))))
    ended = ref + 900
    return [*said, (asks, events.download_ended(ended, name)), (other, events.answered(ended, 0x1C))]


def activate(name: str, ref: int = 1) -> list[Said]:
    """The client links a block in."""
    return [(CLIENT, events.service(ref, "_INSE", events.blocks(name))), (SERVER, events.answered(ref, 0x28))]


def carry(talk: Talk, said: list[Said], *cuts: int) -> None:
    """Send PDUs, each in segments cut at these places."""
    for side, pdu in said:
        octets = dt(pdu)
        edges = [0, *sorted({cut % len(octets) for cut in cuts} - {0}), len(octets)]
        for start, end in itertools.pairwise(edges):
            talk.packet(side, octets[start:end])
