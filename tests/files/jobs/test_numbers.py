"""Numbers that count over all files: marked in the rows of a task, and replaced by those of the whole."""

from __future__ import annotations

import pickle

from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.files.jobs.numbers import Marks, Offsets


def counted(connections: int, transactions: int) -> tuple[Marks, int, int]:
    """Return marks of a task with so many of both, and the first number of each."""
    marks, pipeline = Marks(), Pipeline(Observer())
    marks.begin(pipeline)
    first, second = int(pipeline.connections.count) + 1, int(pipeline.exchange.dialogue.count) + 1
    pipeline.connections.count += connections
    pipeline.exchange.dialogue.count += transactions
    marks.over(pipeline)
    return pickle.loads(pickle.dumps(marks)), first, second


@given(st.integers(0, 10**6), st.integers(0, 10**6), st.integers(1, 40), st.integers(1, 40))
def test_marks_become_numbers(before: int, also: int, connections: int, transactions: int) -> None:
    marks, first, second = counted(connections, transactions)
    rows = "".join([f"{second + at},{first + min(at, connections - 1)},x\n" for at in range(transactions)])
    said = marks.numbered(rows.encode(), Offsets(0, before, also)).decode()
    assert said == "".join(
        [f"{also + 1 + at},{before + 1 + min(at, connections - 1)},x\n" for at in range(transactions)]
    )


@given(st.text(st.sampled_from("0123456789.,#"), max_size=60))
def test_nothing_else_is_taken_for_one(text: str) -> None:
    marks, first, second = counted(3, 3)
    others = f"{first + 3} {second + 3} {first - 1} 1{first} {second}0 {text}\n".encode()
    assert marks.numbered(others, Offsets(0, 5, 7)) == others
    joined = f"{first}{first}{second}{second}{text}\n".encode()
    assert marks.numbered(joined, Offsets(0, 5, 7)) == joined


def test_a_column_keeps_its_width() -> None:
    marks, first, second = counted(2, 2)
    rows = f"#{second} {first}|\n".encode()
    assert marks.numbered(rows, Offsets(0, 0, 9998), 5) == b"#9999  1|\n"
    assert marks.numbered(rows, Offsets(0, 0, 123456), 5) == b"#123457 1|\n"


def test_numbers_fit_where_the_engine_keeps_them() -> None:
    """Connections are multiplied by up to eight (`dissect.engine.connections`), in 64 bits."""
    for _ in range(100):
        _, first, second = counted(1, 1)
        assert max(first, second) * 8 < 2**63
