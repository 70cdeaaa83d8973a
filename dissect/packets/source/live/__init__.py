"""Live sources of packets: ``dumpcap``, the kernel's own packet ring, or a pipe on standard input.

`opening.open_live` chooses between them. Each gives a `reader.LiveReader`: a `Reader` that never waits long, reports what was
lost, and can be stopped. None of them sends anything.
"""

from __future__ import annotations

from typing import Final

#: The default and the largest size of the kernel's buffer, in MiB. They are here because the help of commands shows them,
#: before anything is imported that captures.
BUFFER_MIB: Final = 32
MAX_BUFFER_MIB: Final = 1024
