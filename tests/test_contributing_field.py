"""The recipe "To add a field" of CONTRIBUTING.md, carried out once on a copy of the tree."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import pytest

from tests.test_contributing import RUNNING, Tree, listed

ROW: Final = """    Fact("received", COUNT, "Answers and indications.", lambda of: int(of.answered) + int(of.unsolicited)),
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
made = load("analysis")["properties"]["connections"]["items"]["properties"]["received"]
from pathlib import Path
from tests.faces.gathering import gather
from tests.meaning.report import test_contract
test_contract.test_a_connection_from_beginning_to_end()
gathered = gather([Path(sys.argv[1])])
assert (gathered.differences, [place for place in gathered.unread if "received" in place]) == ([], [])
rows = rows_of(Path(sys.argv[1]))["connections"]
where = Where("received > 3")
found = [one for one in dissect.open(sys.argv[1], where="received > 3")]
said = [one["received"] for one in told["connections"]]
print(json.dumps([said, made, [row["received"] for row in rows], len(found)]))
"""


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    return Tree(tmp_path / "tree")


def test_to_add_a_field(tree: Tree) -> None:
    tree.replace("dissect/meaning/facts/connection.py", FIRST, ROW + FIRST)
    tree.replace(
        "dissect/output/export/tables.py", '"ended_role", "open_at_end",', '"ended_role", "received", "open_at_end",'
    )
    field = '    _fact("pdus", "pdus > 1000", (CONNECTION,)),\n'
    tree.replace(
        "dissect/meaning/select/fields.py", field, field + '    _fact("received", "received > 3", (CONNECTION,)),\n'
    )
    faces = '_connection("open_requests", '
    shared = '_connection("received", COUNT, json="received", tables="received", where="received")\n'
    tree.replace("tests/faces/connection_facts.py", faces, shared + faces)
    contract = "tests/meaning/report/test_contract.py"
    tree.replace(
        contract,
        '        "answered": 2,\n        "unanswered": 1,\n',
        '        "answered": 2,\n        "received": 2,\n        "unanswered": 1,\n',
    )
    told, made, rows, found = json.loads(tree.python("-c", TRIED, "captures/item-errors.pcapng"))
    assert tree.touched() == {name.replace("NAME", "connection") for name in listed("To add a field")}
    assert told == rows
    assert told[0] > 3
    assert found > 0
    assert made == {"type": "integer", "minimum": 0, "description": "Answers and indications."}
    for page in ("json", "tables", "select"):
        assert "Answers and indications" in (tree.root / "docs" / f"{page}.md").read_text(encoding="utf-8")
