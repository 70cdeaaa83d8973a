"""The numbers of S7comm-plus and their names, the sizes of fields, and which of these are decimal: one a line.

A number or a size on the wire never changes: whoever changes one in a table changes it in `numbers.txt` too, and says why.
After rows were added: ``PYTHONPATH=. python -m tests.protocols.s7plus.numbers``.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from dissect.protocols.s7plus import id_tables, layouts, program_tables, return_tables, tables, value_tables
from dissect.wire.codes import CodeTable
from dissect.wire.layout import Field, Layout

NUMBERS: Final = Path(__file__).with_name("numbers.txt")


def every_table() -> Iterator[CodeTable]:
    """Give each table once; members are ids under other names (`test_members_of_memory_are_no_objects`)."""
    seen: set[int] = {id(id_tables.MEMBERS)}
    for module in (tables, value_tables, program_tables, return_tables, id_tables):
        for made in vars(module).values():
            for table in made.values() if isinstance(made, dict) else (made,):
                if isinstance(table, CodeTable) and id(table) not in seen:
                    seen.add(id(table))
                    yield table


def lines() -> list[str]:
    """Return a heading for each table, and its rows."""
    made: list[str] = []
    for table in every_table():
        made.append(f"{table.title}, {table.digits} digits")
        made += [f"  {row.number:#x} {row.name}" for row in table]
    for layout in vars(layouts).values():
        if isinstance(layout, Layout):
            made.append(f"layout {layout.name}")
            made += [f"  {field.name} {sized(field)}" for field in layout.fields]
    return made


def sized(field: Field) -> str:
    """Return the size of a field (below 0: one of the kinds without a fixed size), its form and bits, and what it counts."""
    bits = f" bits {field.bits[0]:#x} >> {field.bits[1]}" if field.bits is not None else ""
    counted = f" counts {field.counts}" if field.counts else ""
    form = " decimal" if field.decimal else ""
    return f"{field.size}{form}{bits}{' of the same bytes' if field.shares else ''}{counted}"


if __name__ == "__main__":
    NUMBERS.write_text("\n".join(lines()) + "\n", encoding="utf-8")
