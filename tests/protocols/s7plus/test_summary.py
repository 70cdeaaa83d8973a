"""What an object is called in a line; what PDUs are about is tested with their bodies and items."""

from __future__ import annotations

import pytest

from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.message import parse_plus
from dissect.protocols.s7plus.objects import Attribute, PlusObject
from dissect.protocols.s7plus.session import NAME
from dissect.protocols.s7plus.summary import object_text, summary
from dissect.protocols.s7plus.tables import CREATE_OBJECT, SET_MULTI_VARIABLES, SET_VARIABLE
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, UDINT, WSTRING
from dissect.protocols.s7plus.values import Value
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed, told


@pytest.mark.parametrize(
    ("rid", "class_id", "name", "text"),
    [
        (1, 2478, "ASRoot", "ASRoot 'ASRoot'"),
        (3, 2478, "", "ASRoot PLCProgram"),
        (211, 287, "Session", "ClassServerSession 'Session'"),
        (0x8A0E0001, 2520, "a\tb", "PLCProgram DB1 'a\\tb'"),
    ],
)
def test_an_object_is_its_class_its_id_and_its_name(rid: int, class_id: int, name: str, text: str) -> None:
    elements = [Attribute(NAME, Value(0, WSTRING, name))] if name else []
    assert object_text(PlusObject(rid, class_id, 0, 0, 0, list(elements))) == text


@pytest.mark.parametrize(("result", "said"), [("00", ["0x70400007"]), ("ca 82 d2 c0 80 82 a1 ff 94", [])])
def test_an_object_whose_creation_was_refused_is_not_there(result: str, said: list[str]) -> None:
    pdu = parse_plus(framed(told(1, CREATE_OBJECT, bytes.fromhex(f"{result} 01 87 82 80 80 07"))))
    assert summary(pdu, parse_contents(pdu)) == said


def test_a_request_says_what_a_new_reference_list_is_about() -> None:
    written = Value(ADDRESS_ARRAY, UDINT, [0x80020000, 1, 1, 7, 0x80140001, 2, 0, 52, 0, 2237])
    said = "0x70400008.SubscriptionReferenceList = new list: CPUexecUnit.DIS; removed: 1 reference"
    one = asked(1, SET_VARIABLE, body=bodies.set_variable(0x70400008, [1048], written))
    several = asked(
        1, SET_MULTI_VARIABLES, body=bodies.set_multi([(VariableAddress(0, 0x70400008, 1048, []), written)])
    )
    for data in (one, several):
        pdu = parse_plus(framed(data, 3))
        assert summary(pdu, parse_contents(pdu)) == [said]
