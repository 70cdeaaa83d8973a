"""A function takes at most eight parameters, but where more is the shape of a thing: each such place has its reason."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Final

PACKAGE: Final = Path(__file__).resolve().parent.parent / "dissect"
MOST: Final = 8

_PDU: Final = "a PDU at hand, field by field: an object for each would be the cost of the engine (decision 12)"
_ROW: Final = "a row of a table in the code, which is called once for each row"
_LIBRARY: Final = "the choices of a program, each by its name"
_RUN: Final = "what a run was told, each by its name, once a process"
#: Functions with more, by class and name, with the reason. Those of `click` have a parameter for each option of a command.
LONGER: Final = {
    "S7.take": _PDU,
    "S7._request": _PDU,
    "Dialogue.ask": _PDU,
    "Dialogue.answer": _PDU,
    "unasked": _PDU,
    "Message.__init__": _PDU,
    "Fact.__init__": _ROW,
    "Field.__init__": _ROW,
    "live": _LIBRARY,
    "open": _LIBRARY,
    "stream": _LIBRARY,
    "values": _LIBRARY,
    "Options.__init__": _RUN,
    "Reading.__init__": _RUN,
    "reading_options": _RUN,
    "Beside.__init__": _RUN,
    "replay": _RUN,
    "Server.__init__": _RUN,
}


def functions(path: Path) -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    """Yield every function of a file with its name and that of its class."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    owners = {child: node.name for node in ast.walk(tree) if isinstance(node, ast.ClassDef) for child in node.body}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield (f"{owners[node]}.{node.name}" if node in owners else node.name), node


def parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Return the names of the parameters that a caller passes."""
    given = function.args
    names = [one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return names[1:] if names[:1] in (["self"], ["cls"]) else names


def is_command(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Return whether `click` calls it, with the options of a command or a part of them."""
    return any(ast.unparse(one).startswith(("click.", "functools.wraps")) for one in function.decorator_list)


def test_a_function_takes_at_most_eight_parameters() -> None:
    longer = {
        name
        for path in sorted(PACKAGE.rglob("*.py"))
        for name, function in functions(path)
        if len(parameters(function)) > MOST and not is_command(function)
    }
    assert longer == LONGER.keys()


def test_parameters_are_counted_as_a_caller_sees_them() -> None:
    tree = ast.parse("class A:\n def f(self, a, /, b, *, c): ...\n@click.command('x')\ndef g(a): ...\n")
    owner, command = tree.body
    assert isinstance(owner, ast.ClassDef)
    (method,) = owner.body
    assert isinstance(method, ast.FunctionDef)
    assert isinstance(command, ast.FunctionDef)
    assert parameters(method) == ["a", "b", "c"]
    assert (is_command(method), is_command(command)) == (False, True)
