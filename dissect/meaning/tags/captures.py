"""Names from captures: S7comm-plus carries the declarations of a CPU's variables in answers to Explore and in downloads.

They give names to addresses of S7comm-plus, by LID, but not to addresses of S7comm: no known capture shows whether the offsets
in a declaration are those that S7comm uses.
"""

from __future__ import annotations

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.meaning.tags.tag_file import TagFile
from dissect.packets.source.files import open_capture
from dissect.packets.source.packet import CaptureError


def read_capture(file: TagFile, packed: str = "") -> None:
    """Read the declarations in a capture into ``file``, by the host of the CPU; a capture without any is an error.

    ``packed`` says how the file is compressed; a compressed file that is not a capture may be a file of tags.
    """
    file.format = "capture"
    pipeline = Pipeline(Observer())
    try:
        reader = open_capture(file.path)
        try:
            while reader.step(pipeline):
                pass
        finally:
            reader.close()
    except CaptureError as error:
        hint = f"; if it has tags, decompress it first ({packed})" if packed else ""
        file.problems.error(0, str(error).removeprefix(f"{file.path}: ") + hint)
        return
    pipeline.finish()
    file.programs = pipeline.exchange.watch.plus.programs()
    if not file.programs:
        file.problems.error(
            0,
            "is a capture without declarations of variables: S7comm-plus carries them where an engineering tool goes online, "
            "reads a program out or loads it",
        )
