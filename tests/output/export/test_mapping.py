"""What ECS and Zeek call the columns of tables: every name is that of a fact, or is said to be the format's own."""

from __future__ import annotations

import pytest

from dissect.output.export import ecs
from dissect.output.export.mapping import Mapped, mapped, told
from dissect.output.export.tables import ACTS, TABLES
from dissect.output.export.zeek import columns

#: The names that no column has: a key that joins with other tools, and facts in another form.
ALONE = {
    "s7comm_transaction": {"community_id", "errors"},
    "s7comm_act": {"community_id"},
    "s7comm_finding_count": set[str](),
    "transactions": {"frames", "latency_ms"},
    "connections": set[str](),
    "findings": set[str](),
    "finding_counts": set[str](),
}


@pytest.mark.parametrize(("name", "names"), [*columns.OWN.items(), *ecs._OWN.items()])
def test_every_name_is_a_fact(name: str, names: tuple[Mapped, ...]) -> None:
    tables = [TABLES[name]] if name in TABLES else [TABLES["transactions"], TABLES["acts"], TABLES["finding_counts"]]
    known = {column.name: column.source for table in tables for column in table.stored}
    assert {one.name for one in names if not one.column} == ALONE[name]
    for one in names:
        if one.column:
            assert any([fact.name == known[one.column] for table in tables for fact in table.facts])
            assert one.kind is not None


def test_a_name_that_no_table_has_is_an_error() -> None:
    with pytest.raises(KeyError):
        mapped(ACTS, columns._KINDS, "act kind nothing")


def test_a_planted_difference_is_found() -> None:
    """A name that is mapped to another column tells another value."""
    row = {column.name: column.name for column in ACTS.stored}
    right = dict(told(mapped(ACTS, columns._KINDS, "act bytes=bytes"), row, {}))
    wrong = dict(told(mapped(ACTS, columns._KINDS, "act bytes=error_code"), row, {}))
    assert right == {"act": "act", "bytes": "bytes"} != wrong
    assert dict(told(mapped(ACTS, columns._KINDS, "end=end_ns:time uid=:string"), row, {"uid": 1})) == {
        "end": "end_ns",
        "uid": 1,
    }
