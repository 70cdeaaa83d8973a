"""Names from captures: what S7comm-plus says of the variables of a CPU, in answers to Explore and in downloads.

They are names for the addresses of S7comm-plus, by LID. Where a variable stands for S7comm is not taken from them: no capture
at hand shows whether the offsets in a declaration are those that S7comm uses.
"""

from __future__ import annotations

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.source.files import open_capture
from dissect.source.packet import CaptureError
from dissect.tags.tag_file import TagFile


def read_capture(file: TagFile, packed: str = "") -> None:
    """Take the declarations that a capture holds, by the host of the CPU; none at all is an error of the file.

    ``packed`` says how it is compressed; what is compressed and no capture may be a file of tags.
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
