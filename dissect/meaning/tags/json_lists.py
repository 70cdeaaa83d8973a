"""Tags in JSON: python-snap7, nodes7 (names with addresses), Node-RED flows, Ignition tags (sheet 5.1, 5.3, 5.6)."""

from __future__ import annotations

from typing import Any, Final

from dissect.meaning.tags.tag_file import Row, TagFile
from dissect.wire.config.hostile import ContentError
from dissect.wire.config.hostile import read_json as read_any

_MAX_DEPTH: Final = 64
#: Ignition's key for the address of a tag.
_ATOMIC: Final = "opcItemPath"


def read_json(text: str, into: TagFile) -> None:
    """Read a file in any of these forms."""
    try:
        content = read_any(text, lambda pairs: _object(pairs, into))
    except ContentError as error:
        into.problems.error(error.line, f"is not valid JSON: {error}")
        return
    if isinstance(content, list) and any([isinstance(node, dict) and "vartable" in node for node in content]):
        into.format = "Node-RED flow"
        for node in content:
            for row in _rows(node.get("vartable")) if isinstance(node, dict) else []:
                _add(into, row.get("name"), row.get("addr"), "")
        return
    if _has_path(content):
        into.format = "Ignition tags"
        _ignition(content, "", into, 0)
        return
    if isinstance(content, dict) and content and all([isinstance(value, str) for value in content.values()]):
        into.format = "nodes7 tag list"
        for name, address in content.items():
            _add(into, name, address, "")
        return
    if isinstance(content, dict) and any([isinstance(value, dict) and "offset" in value for value in content.values()]):
        into.format = "python-snap7 tags (JSON)"
        for name, value in content.items():
            if not isinstance(value, dict) or not {"db", "offset", "type"} <= value.keys():
                into.problems.error(0, f"{str(name)[:60]!r}: expected an object with db, offset and type")
                continue
            bit = value.get("bit", 0)
            offset = str(value["offset"])
            wants = str(value["type"]).upper().startswith("BOOL") and "." not in offset
            _add(into, name, f"DB{value['db']}:{offset}{f'.{bit}' if wants else ''}", str(value["type"]))
        return
    into.problems.error(
        0,
        "JSON without tags: expected name to address (nodes7), name to db, offset and type (python-snap7), a flow or "
        "an export of tags",
    )


def _object(pairs: list[tuple[str, Any]], into: TagFile) -> dict[str, Any]:
    """Return a JSON object; note a problem for a name that occurs twice, because the json module only keeps the last one."""
    found = dict(pairs)
    if len(found) < len(pairs):
        for name in [name for name, value in pairs if found[name] != value]:
            into.problems.error(0, f"{name[:60]!r} occurs twice in one object, with two values: remove one")
    return found


def _add(into: TagFile, name: Any, address: Any, type_: str) -> None:
    if not isinstance(name, str) or not isinstance(address, str):
        into.problems.error(0, f"{str(name)[:60]!r}: name and address are texts")
        return
    into.add(Row(0, name, address, type_))


def _rows(table: Any) -> list[dict[str, Any]]:
    return [row for row in table if isinstance(row, dict)] if isinstance(table, list) else []


def _has_path(content: Any, depth: int = 0) -> bool:
    if depth > _MAX_DEPTH:
        return False
    if isinstance(content, dict):
        return _ATOMIC in content or any([_has_path(value, depth + 1) for value in content.values()])
    return isinstance(content, list) and any([_has_path(value, depth + 1) for value in content])


def _ignition(node: Any, path: str, into: TagFile, depth: int) -> None:
    if depth > _MAX_DEPTH:
        into.problems.error(0, f"folders within folders more than {_MAX_DEPTH} deep")
        return
    if isinstance(node, list):
        for each in node:
            _ignition(each, path, into, depth + 1)
        return
    if not isinstance(node, dict):
        return
    name = str(node.get("name", ""))
    here = f"{path}.{name}" if path and name else name or path
    item = node.get(_ATOMIC)
    if isinstance(item, dict):
        item = item.get("binding")
    if isinstance(item, str):
        _add(into, here, item.rpartition("]")[2], "")
    _ignition(node.get("tags", []), here, into, depth + 1)
