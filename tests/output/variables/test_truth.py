"""Values against a real peer: the series that python-snap7 wrote is the series that is read back, n of n."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Final

from snap7 import util

import dissect
from dissect.meaning.tags import load_tags
from dissect.online.live.events import CLOSED
from tests.online.live.support import client, plc, taken
from tests.online.proxy.test_source import dissected

SOURCE: Final = """DATA_BLOCK "Press"
{ S7_Optimized_Access := 'FALSE' }
VERSION : 0.1
   STRUCT
      force : Real;
      running : Bool;
      fault : Bool;
      stroke : Int;
      part : String[7];
   END_STRUCT;
BEGIN
END_DATA_BLOCK
"""
SIZE: Final = 17
ROUNDS: Final = 60


def test_the_series_that_a_peer_wrote_is_read_back_exactly(tmp_path: Path) -> None:
    roll = random.Random(14)
    source = tmp_path / "press.db"
    source.write_text(SOURCE, encoding="utf-8")
    path = tmp_path / "press.pcapng"
    series: dict[str, list[object]] = {"force": [], "running": [], "fault": [], "stroke": [], "part": []}
    with plc() as server, dissected(server.port, path) as (_, session, port):
        with client(port) as panel:
            for _ in range(ROUNDS):
                octets = bytearray(SIZE)
                force, stroke = roll.randrange(-8000, 8000) / 8, roll.randrange(-32768, 32768)
                running, fault = roll.random() < 0.5, roll.random() < 0.5
                part = "".join(roll.choices("ABCxyz 012", k=roll.randrange(8)))
                util.set_real(octets, 0, force)
                util.set_bool(octets, 4, 0, running)
                util.set_bool(octets, 4, 1, fault)
                util.set_int(octets, 6, stroke)
                util.set_string(octets, 8, part, 7)
                for name, value in zip(series, (force, running, fault, stroke, part), strict=True):
                    series[name].append(value)
                panel.db_write(1, 0, octets)
                assert panel.db_read(1, 0, SIZE) == octets
        taken(session, lambda events: any([event.kind == CLOSED for event in events]))
    tags = load_tags([source], numbers={"Press": 1})

    written: dict[str, list[object]] = {name: [] for name in series}
    seen: dict[str, list[object]] = {name: [] for name in series}
    for row in [
        row for row in dissect.values(path, tags=tags) if row.tag
    ]:  # beside it the byte behind the truth values
        (written if row.how == "write" else seen)[row.tag.removeprefix("Press.")].append(row.value)
    assert written == series
    assert seen == series

    # The same by what is asked for: a tag, an address with its type, the structure; and what changed is what changes.
    for of, name in (("Press.force", "force"), ("press.PART", "part"), ("DB1.DBD0", "force"), ("DB1,INT6", "stroke")):
        rows = list(dissect.values(path, tags=tags, of=of))
        assert [row.value for row in rows if row.how == "write"] == series[name], of
    assert {row.tag for row in dissect.values(path, tags=tags, of="Press")} == {f"Press.{name}" for name in series}
    plain = [row.value for row in dissect.values(path, of="DB1.DBD0:REAL") if row.how == "write"]
    assert plain == series["force"]
    changes = [row.value for row in dissect.values(path, tags=tags, of="Press.running", changes=True)]
    expected = series["running"]
    assert changes == [value for at, value in enumerate(expected) if at == 0 or value != expected[at - 1]]

    tables = dissect.value_tables(dissect.values(path, tags=tags))
    for name, told in series.items():
        table = tables[f"Press.{name}"].to_pydict()
        assert [value for value, how in zip(table["value"], table["how"], strict=True) if how == "write"] == told
