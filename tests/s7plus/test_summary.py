"""What an object is called in a line; what PDUs are about is tested with their bodies and items."""

from __future__ import annotations

import pytest

from dissect.s7plus.objects import Attribute, PlusObject
from dissect.s7plus.session import NAME
from dissect.s7plus.summary import object_text
from dissect.s7plus.value_tables import WSTRING
from dissect.s7plus.values import Value


@pytest.mark.parametrize(
    ("rid", "class_id", "name", "text"),
    [
        (1, 2478, "ASRoot", "ASRoot 'ASRoot'"),
        (3, 2478, "", "ASRoot PLCProgram"),
        (0x8A0E0001, 2520, "a\tb", "PLCProgram DB1 'a\\tb'"),
    ],
)
def test_an_object_is_its_class_its_id_and_its_name(rid: int, class_id: int, name: str, text: str) -> None:
    elements = [Attribute(NAME, Value(0, WSTRING, name))] if name else []
    assert object_text(PlusObject(rid, class_id, 0, 0, 0, list(elements))) == text
