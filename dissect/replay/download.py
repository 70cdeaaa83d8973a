"""Downloads: the PLC asks for a block piece by piece, and the client answers with what was recorded (reference 3.7).

A recorded download is played whole or not at all. One is whole when the recording has the client's answer to every job of the
PLC, up to the one that ends it; when the PLC refused it; or when the client sent the pieces by itself.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

from dissect.golden.exchange import S7
from dissect.golden.masking import mask_s7
from dissect.golden.model import Transaction
from dissect.s7.message import Pdu, parse_pdu
from dissect.s7.parameters import PLC_FILE_NAMES
from dissect.s7.tables import ACK_DATA, DOWNLOAD_BLOCK, DOWNLOAD_ENDED, JOB, REQUEST_DOWNLOAD

#: Jobs of a PLC that belong to a download.
DOWNLOADING_JOBS: Final = frozenset((DOWNLOAD_BLOCK, DOWNLOAD_ENDED))
