"""Packets as they pass: from ``dumpcap``, from the kernel's own ring, or from a pipe on standard input.

`opening.open_live` chooses between them; each gives a `reader.LiveReader`, which is a `Reader` that never waits long, tells
what was lost, and can be stopped. All of it only receives.
"""

from __future__ import annotations

from typing import Final

#: The size of the kernel's buffer in MiB, unless another one is asked for, and at most. They stand here because commands say
#: them in their help, before anything is imported that captures.
BUFFER_MIB: Final = 32
MAX_BUFFER_MIB: Final = 1024
