"""The same facts through pyshark: a second way to Wireshark's dissection, with a different parser of its JSON.

pyshark drives tshark from its own event loop, and fails in a process that ever ran another one. It therefore runs in a child
(``python -m dissect.testing.oracle.pyshark_reader``), which writes one JSON line per packet. Its exact mode is
``use_json=True``: several PDUs of a packet are in ``duplicate_layers``, while EK mode raises on them.
"""

from __future__ import annotations

import asyncio
import os
import sys
from asyncio.subprocess import Process
from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import Any, Final

import msgspec

from dissect.testing.oracle.theirs import OF_FRAME, PROTOCOLS, WANTED, WHOLE, Frame, Tree
from dissect.testing.oracle.tshark import FILTER, Child, OracleError, preferences

#: Seconds for a tshark to exit after its last output.
_LEAVING: Final = 10


def read_pyshark(path: str, ports: Iterable[int] = (), reorder: bool = False) -> Iterator[Frame]:
    """Dissect a capture with pyshark and yield every packet that contains a TPKT, as `read_tshark` does.

    Raises OracleError if pyshark or tshark is missing or fails.
    """
    command = [sys.executable, "-m", __name__, path, str(int(reorder)), *map(str, sorted(ports))]
    child = Child(command, f"pyshark, reading {path}")
    whole = False
    try:
        for line in child.stdout:
            if not line.endswith(b"\n"):
                break  # the child ended within a line: its error says why, the partial line does not
            yield Frame(_decoded(line, path))
        whole = True
    finally:
        child.close(stop=not whole)


def _decoded(line: bytes, path: str) -> Tree:
    """Return the content of a line of the child. Raises OracleError, with the position, for a line that is not JSON."""
    try:
        return msgspec.json.decode(line, type=dict[str, Any])
    except msgspec.DecodeError as error:
        where = int(str(error).rpartition("byte ")[2].rstrip(")") or 0) if "byte " in str(error) else 0
        near = line[max(where - 60, 0) : where + 20]
        raise OracleError(f"pyshark, reading {path}: {error}, near {near!r}") from error


def _plain(name: str, value: Any) -> Any:
    """Return pyshark's form of a field, a list or a tree as JSON-ready values; only the wanted fields of a tree."""
    if isinstance(value, list):
        return [_plain(name, part) for part in value]
    if not hasattr(value, "get_field"):
        return value.raw_value
    if name in WHOLE:
        # All its fields are wanted, but pyshark only finds fields by names that are known in advance.
        return value._all_fields  # noqa: SLF001 - its public names are lossy
    tree: Tree = {}
    # pyshark turns Wireshark's remarks into field names, too, so a tree may have the name of a field.
    for wanted in sorted(WANTED.get(name, ())):
        for key in (wanted, f"{wanted}_raw"):
            with suppress(AttributeError):  # pyshark's way to say that there is none
                tree[key] = _plain(wanted, value.get_field(key))
    return tree


def _raw(layer: Any) -> list[Any]:
    """Return the raw entry of a layer, or a list of them: pyshark takes every list for a list of layers."""
    more = layer.duplicate_layers
    if not isinstance(layer.value, list):
        return [layer.value, *[part.value for part in more]]
    return [layer.value, *[_raw(part) for part in more]]


def _layers(packet: Any) -> Tree:
    """Return a packet's layers in the form that tshark gives them."""
    tree: Tree = {"frame": {name: packet.frame_info.get_field(name).raw_value for name in OF_FRAME}}
    for layer in packet.layers:
        name = layer.layer_name
        if name in PROTOCOLS:
            tree[name] = [_plain(name, part) for part in (layer, *layer.duplicate_layers)]
        elif name.removesuffix("_raw") in PROTOCOLS:
            tree[name] = _raw(layer)
    return tree


def main(path: str, reorder: str, *ports: str) -> None:
    """Write the layers of every packet with a TPKT to stdout, one JSON line each."""
    try:
        import pyshark
        from pyshark.capture.capture import TSharkCrashException
        from pyshark.tshark.tshark import TSharkNotFoundException
    except ImportError:
        sys.exit("pyshark is not installed: pip install 's7dissect[tshark]'")

    class Capture(pyshark.FileCapture):  # type: ignore[misc]  # pyshark has no types
        """A pyshark capture that lets tshark exit by itself at the end of its output.

        pyshark kills tshark there. If tshark exits between pyshark's check and the signal, the signal takes its status from the
        event loop, which then reports 255, and pyshark raises for a crash that did not happen. For a tshark that was ended by a
        signal it reports nothing, although the last packet is lost: pyshark completes a packet only with the next one, or with
        the end of the array.
        """

        async def _cleanup_subprocess(self, process: Process) -> None:
            if self._eof_reached:
                with suppress(asyncio.TimeoutError):  # then pyshark may kill it
                    code = await asyncio.wait_for(process.wait(), _LEAVING)
                    if code < 0:
                        raise TSharkCrashException(f"tshark was ended by signal {-code}")
            await super()._cleanup_subprocess(process)

    try:
        capture = Capture(
            path,
            use_json=True,
            include_raw=True,
            keep_packets=False,
            display_filter=FILTER,
            override_prefs=preferences(map(int, ports), reorder == "1"),
            custom_parameters=["-J", " ".join(PROTOCOLS)],
        )
        try:
            for packet in capture:
                sys.stdout.buffer.write(msgspec.json.encode(_layers(packet)) + b"\n")
        finally:
            capture.close()
    except (FileNotFoundError, TSharkCrashException, TSharkNotFoundException) as error:
        # After the first two lines comes advice for pyshark's developers; and it raises once more while Python shuts down.
        sys.stderr.write(" ".join(str(error).splitlines()[:2]) + "\n")
        sys.stderr.flush()
        sys.stdout.flush()
        os._exit(1)


if __name__ == "__main__":
    main(*sys.argv[1:])
