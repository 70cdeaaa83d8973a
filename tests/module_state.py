"""Finds the names of a module that its functions change: state that no object owns."""

from __future__ import annotations

import ast
from typing import Final

_CHANGES: Final = frozenset((
    "add", "append", "appendleft", "clear", "discard", "extend", "insert", "move_to_end", "pop", "popitem", "popleft",
    "remove", "setdefault", "sort", "update",
))  # fmt: skip


def changed_state(tree: ast.Module) -> list[tuple[int, str]]:
    """Return (line, name) of each change of a name of the module, or of its contents, within a function."""
    finder = _Finder(_names(tree))
    finder.visit(tree)
    return finder.found


def _names(tree: ast.Module) -> set[str]:
    targets: list[ast.expr] = []
    for node in tree.body:
        if isinstance(node, ast.AnnAssign):
            targets.append(node.target)
        elif isinstance(node, ast.Assign):
            targets += node.targets
    return {target.id for target in targets if isinstance(target, ast.Name)}


def _root(node: ast.expr) -> str:
    """Return the name at the beginning of ``name.attribute[index]…``, empty if there is none."""
    while isinstance(node, ast.Attribute | ast.Subscript):
        node = node.value
    return node.id if isinstance(node, ast.Name) else ""


class _Finder(ast.NodeVisitor):
    def __init__(self, names: set[str]) -> None:
        self.found: list[tuple[int, str]] = []
        self._names = names
        self._inside = 0

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self._inside += 1
        self.generic_visit(node)
        self._inside -= 1

    def visit_Global(self, node: ast.Global) -> None:
        self.found += [(node.lineno, name) for name in node.names]

    def visit_Call(self, node: ast.Call) -> None:
        if isinstance(node.func, ast.Attribute) and node.func.attr in _CHANGES:
            self._note(node.func.value, node.lineno)
        self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        if isinstance(node.ctx, ast.Store | ast.Del):
            self._note(node, node.lineno)
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        if isinstance(node.ctx, ast.Store | ast.Del):
            self._note(node, node.lineno)
        self.generic_visit(node)

    def _note(self, node: ast.expr, line: int) -> None:
        name = _root(node)
        if self._inside and name in self._names:
            self.found.append((line, name))
