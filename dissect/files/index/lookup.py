"""The facts about files, in their present state, from the indexes of folders."""

from __future__ import annotations

from pathlib import Path

from dissect.files.index.facts import FileFacts
from dissect.files.index.place import index_of
from dissect.files.index.store import Store, StoreError
from dissect.packets.source.remote import is_remote


class Indexes:
    """Indexes of this ``version``, each read once. ``used``: one could be read; ``troubles`` say why others could not."""

    def __init__(self, version: str) -> None:
        self.used = False
        self.troubles: list[str] = []
        self._version = version
        self._by_folder: dict[Path, dict[str, FileFacts] | None] = {}

    def facts(self, file: str) -> FileFacts | None:
        """Return the facts of a file in its present state; None if there are none."""
        if file == "-" or is_remote(file):
            return None
        path = Path(file).absolute()
        try:
            state = path.stat()
        except OSError:  # it is reported where it is read
            return None
        for folder in path.parents:
            known = self._index(folder)
            if known is not None:
                facts = known.get(path.relative_to(folder).as_posix())
                now = (state.st_size, state.st_mtime_ns)
                return facts if facts is not None and (facts.size, facts.mtime_ns) == now else None
        return None

    def _index(self, folder: Path) -> dict[str, FileFacts] | None:
        if folder not in self._by_folder:
            self._by_folder[folder] = self._read(folder)
        return self._by_folder[folder]

    def _read(self, folder: Path) -> dict[str, FileFacts] | None:
        path = index_of(folder)
        if not path.is_file():
            return None
        try:
            with Store(path, self._version, changes=False) as store:
                found = {facts.name: facts for facts in store.files()}
        except StoreError as error:
            self.troubles.append(str(error))
            return {}
        self.used = True
        return found
