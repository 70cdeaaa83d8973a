"""Make a realistic S7 capture and the truth about it: ``python -m benchmarks.generate PACKETS OUT``."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.traffic import MISHAPS, Traffic
from benchmarks.truth import Truth
from benchmarks.writers import FORMATS, CaptureWriter

if TYPE_CHECKING:
    from collections.abc import Sequence

_UNITS = {"k": 1000, "M": 1_000_000}


def parse_count(text: str) -> int:
    """Return a number of packets written as ``100k``, ``5M`` or plain digits."""
    factor = _UNITS.get(text[-1:], 1)
    digits = text[:-1] if factor > 1 else text
    if not digits.isdecimal() or int(digits) == 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of packets; write for example 20000, 100k or 5M")
    return int(digits) * factor


def truth_path(capture: Path) -> Path:
    """Return the path of the truth about a synthetic capture."""
    return capture.with_name(capture.name + ".truth.json")


def generate(
    path: Path,
    packets: int,
    seed: int = 1,
    stations: int = 50,
    kind: str = "pcap",
    without: frozenset[str] = frozenset(),
) -> dict[str, object]:
    """Write ``packets`` packets to ``path`` and the truth beside it (``path`` + ``.truth.json``); return the truth.

    The same arguments give the same octets. Memory does not grow with ``packets``, except for 8 octets per transaction.
    """
    truth = Truth()
    traffic = Traffic(seed, truth, stations, grain_ns=1000 if kind == "pcap" else 1, without=without)
    with path.open("wb") as file:
        writer = CaptureWriter(file, kind)
        for time_ns, frame, units, empty in traffic.packets():
            writer.write(time_ns, frame)
            truth.take(time_ns, len(frame), units)
            truth.empty_segments += empty
            if writer.packets == packets:
                break
        writer.flush()
    made_with = {
        "packets": packets, "seed": seed, "stations": stations, "format": kind, "without": sorted(without),
    }  # fmt: skip
    told = {"made_with": made_with, **truth.as_dict()}
    truth_path(path).write_text(json.dumps(told, indent=1) + "\n", encoding="ascii")
    return told


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.generate", description=__doc__)
    parser.add_argument("packets", type=parse_count, help="how many: 100k, 1M, 5M ...")
    parser.add_argument("out", type=Path, help="the capture to write; the truth goes to OUT.truth.json")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--stations", type=int, default=50, help="clients, each with its connection (default 50)")
    parser.add_argument("--format", choices=FORMATS, default="pcap")
    parser.add_argument(
        "--without", action="append", default=[], choices=[name for _, name in MISHAPS], help="a mishap to leave out"
    )
    options = parser.parse_args(arguments)
    told = generate(
        options.out, options.packets, options.seed, options.stations, options.format, frozenset(options.without)
    )
    json.dump(told, sys.stdout, indent=1)
    sys.stdout.write("\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
