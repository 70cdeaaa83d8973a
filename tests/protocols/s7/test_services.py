from __future__ import annotations

import csv
from pathlib import Path

from dissect.protocols.s7.services import BLOCK_SERVICES, COMPRESS, COPY_TO_ROM, NC_PREFIX, PI_SERVICES, PROGRAM, SECRET
from dissect.protocols.s7.tables import MEMORY, START


def test_they_are_those_of_the_reference(reference: Path) -> None:
    with (reference / "tables" / "pi_services.tsv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t", quoting=csv.QUOTE_NONE))
    told = [(one.name, one.arguments, one.meaning) for one in PI_SERVICES.values()]
    assert told == [(row["name"], row["arguments"], row["meaning"]) for row in rows]
    finer = {PROGRAM: START, COPY_TO_ROM: MEMORY, COMPRESS: MEMORY}
    expected = {row["name"]: finer.get(row["name"], row["security_class"]) for row in rows}
    assert {one.name: one.effect for one in PI_SERVICES.values()} == expected


def test_names_of_arguments() -> None:
    login = PI_SERVICES["_N_LOGIN_"]
    assert [login.argument(number) for number in range(3)] == ["address", SECRET, ""]
    search = PI_SERVICES["_N_TSEARC"]
    assert [search.argument(number) for number in range(3)] == ["address", "", ""]


def test_every_service_has_one_kind_of_parameter_block() -> None:
    own = {*BLOCK_SERVICES, PROGRAM, COPY_TO_ROM, COMPRESS}
    assert {name for name in PI_SERVICES if not name.startswith(NC_PREFIX)} == own
