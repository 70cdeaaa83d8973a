"""A Scapy class for each row of `dissect.layers.part_tables`, with the name in the row.

The names are added to this module when it is imported; ``part_classes.pyi``, made by ``scripts/layers_stub.py``, declares them
for type checkers and editors.
"""

from __future__ import annotations

from typing import Final

from dissect.layers.fields import header_fields
from dissect.layers.part_row import Row
from dissect.layers.part_tables import SECTIONS
from dissect.layers.parts import S7_Part


def _class_of(row: Row) -> type[S7_Part]:
    fields = header_fields(row.layout, row.defaults, row.replace)
    names = [f"``{field.name}``" for field in fields if field.default is None]
    filled = " and ".join([part for part in (", ".join(names[:-1]), *names[-1:]) if part])
    verb = "are" if len(names) > 1 else "is"
    return type(S7_Part)(
        row.name,
        (S7_Part,),
        {
            "__doc__": f"{row.text} {filled} {verb} filled in when left out." if filled else row.text,
            "__module__": __name__,
            "name": row.title or f"{'S7comm-plus' if row.name.startswith('S7Plus_') else 'S7'} {row.layout.name}",
            "layout": row.layout,
            "fields_desc": fields,
            "counted": row.counted,
            "counting": row.counting,
            "computed": row.computed,
        },
    )


ROWS: Final = [row for rows in SECTIONS.values() for row in rows]
__all__ = [row.name for row in ROWS]  # a list of names all the same
globals().update({row.name: _class_of(row) for row in ROWS})
