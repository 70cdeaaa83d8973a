"""Lines of PDUs that are written as octets are those that are written with an object for the PDU."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from dissect.files.session import Run
from dissect.meaning.report.styled import Line
from dissect.meaning.report.writer import PduFeed
from dissect.meaning.report.writers.text import TextWriter
from tests.cases import each
from tests.meaning.report.support import ROOT, begun
from tests.output.variables.support import collected
from tests.properties.messages import Item, dt, read_answer, read_job, write_answer, write_job
from tests.properties.packets import Talk

_LARGEST: Final = 300_000
CAPTURES: Final = [
    path
    for path in sorted((ROOT / "captures").rglob("*.pcap*"))
    if path.suffix in {".pcap", ".pcapng"} and path.stat().st_size < _LARGEST
]
REAL: Final = 0x08


def texts(writer: TextWriter) -> list[str]:
    found = []
    for line in writer.lines:
        said = line.text if isinstance(line, Line) else line
        found.append(said.decode() if isinstance(said, bytes) else said)
    return found


def of_file(path: Path, plain: bool) -> list[str]:
    writer = TextWriter()
    writer.plain = plain
    run = Run([str(path)], PduFeed(writer))
    while run.step():
        pass
    run.finish()
    return texts(writer)


@each("path", CAPTURES)
def test_lines_are_the_same(path: Path) -> None:
    assert of_file(path, True) == of_file(path, False)


def odd_answers(ref: int, items: list[Item]) -> list[bytes]:
    """Return answers with one good item each, and what is wrong with nearly good ones."""
    good = read_answer(ref, items, [b"\1\2\3\4" for _ in items])
    return [
        good,
        good[:-1],
        good + b"\0",
        good[:10] + b"\x81" + good[11:],
        good[:14] + b"\x0a" + good[15:],
        good[:13] + bytes([good[13] + 1]) + good[14:],
        good[:16] + b"\xff\xff" + good[18:],
    ]


def test_odd_answers_are_the_same() -> None:
    items = [Item(REAL, 1, 1, 0x84, 8 * at) for at in range(2)]
    talk: Talk = begun()
    for ref in range(1, 8):
        talk.send(0, dt(read_job(ref, items)))
        talk.send(1, dt(odd_answers(ref, items)[ref - 1]))
    talk.send(0, dt(write_job(9, items, [b"\0\0\0\1", b"\0\0\0\2"])))
    talk.send(1, dt(write_answer(9, [0xFF, 0xFF])))
    talk.send(0, dt(write_job(10, items, [b"\0\0\0\1", b"\0\0\0\2"])))
    talk.send(1, dt(write_answer(10, [0xFF, 0x05])))
    found = []
    for plain in (True, False):
        writer = TextWriter()
        writer.plain = plain
        collected(PduFeed(writer), talk.packets())  # type: ignore[arg-type]  # any observer
        found.append(texts(writer))
    assert found[0] == found[1]
    assert len([line for line in found[0] if line.endswith("2 items, all good")]) >= 2
