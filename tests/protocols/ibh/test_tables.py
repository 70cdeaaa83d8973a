from __future__ import annotations

from dissect.protocols.ibh.tables import FUNCTIONS, KIND_OF, KINDS, MPI_INDICATION, MPI_REQUEST, SERVICES
from dissect.protocols.iso.tables import TPDU_TYPES


def test_every_function_has_a_kind_of_its_own() -> None:
    assert KIND_OF.keys() == {row.number for row in FUNCTIONS}
    assert len(set(KIND_OF.values())) == len(KIND_OF)
    assert len(set(KINDS)) == len(KINDS) == max(KIND_OF.values()) + 5


def test_functions_have_the_codes_of_tpdus() -> None:
    tpdus = {number: TPDU_TYPES.name(number >> 4) for number in KIND_OF if number >> 4 in TPDU_TYPES}
    assert tpdus == {0x80: "DR", 0xD0: "CC", 0xE0: "CR", 0xF0: "DT", 0xF1: "DT"}


def test_flags_with_an_mpi_header_are_services() -> None:
    assert {MPI_REQUEST, MPI_INDICATION} <= {row.number for row in SERVICES}
