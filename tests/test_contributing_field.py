"""The recipe "To add a field" of CONTRIBUTING.md, carried out once on a copy of the tree."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import pytest

from tests.test_contributing import RUNNING, Tree, listed

ROW: Final = """    Fact("payload", COUNT, "Payload both ways.", lambda of: _octets(of, 0) + _octets(of, 1), unit="bytes"),
"""
FIRST: Final = """    Fact("open_at_end", COUNT, "Requests without answer"""
TRIED: Final = f"""
{RUNNING}
import json
run("tests/meaning/report/schemas.py")
run("scripts/tables_doc.py", "docs/tables.md")
run("scripts/select_doc.py")
import dissect
from dissect.meaning.facts.connection import CONNECTION
from dissect.output.export.tables import CONNECTIONS
from dissect.meaning.select import Where
from tests.output.export.support import rows_of
from tests.meaning.report.schemas import complaints, load
told = dissect.analyze(sys.argv[1]).as_dict()
assert complaints("analysis", told, exact=True) == []
made = load("analysis")["properties"]["connections"]["items"]["properties"]["payload"]
from pathlib import Path
rows = rows_of(Path(sys.argv[1]))["connections"]
where = Where("payload > 3")
found = [one for one in dissect.open(sys.argv[1], where="payload > 3")]
said = [one["payload"] for one in told["connections"]]
print(json.dumps([said, made, [row["payload"] for row in rows], len(found)]))
"""


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    return Tree(tmp_path / "tree")


def test_to_add_a_field(tree: Tree) -> None:
    tree.replace("dissect/meaning/facts/connection.py", FIRST, ROW + FIRST)
    tree.replace(
        "dissect/output/export/tables.py", '"ended_role", "open_at_end",', '"ended_role", "payload", "open_at_end",'
    )
    field = '    _fact("pdus", "pdus > 1000", (CONNECTION,)),\n'
    tree.replace("dissect/meaning/select/fields.py", field, field + '    _fact("payload", "payload > 3"),\n')
    faces = '_connection("open_requests", '
    shared = '_connection("payload", COUNT, json="payload", tables="payload", where="payload")\n'
    tree.replace("tests/faces/connection_facts.py", faces, shared + faces)
    told, made, rows, found = json.loads(tree.python("-c", TRIED, "captures/item-errors.pcapng"))
    assert tree.touched() == {name.replace("NAME", "connection") for name in listed("To add a field")}
    assert told == rows
    assert told[0] > 3
    assert found > 0
    assert made == {"type": "integer", "minimum": 0, "description": "Payload both ways."}
    for page in ("json", "tables", "select"):
        assert "Payload both ways" in (tree.root / "docs" / f"{page}.md").read_text(encoding="utf-8")
