"""Problems of this program itself: their kinds, which rules, metrics and the live run share."""

from __future__ import annotations

from typing import Final

#: Packets are not written: the disk is full, or gone.
EVIDENCE: Final = "evidence"
#: Tables are not written.
EXPORT: Final = "export"
#: A report is not written.
REPORT: Final = "report"
#: Packets were lost while capturing.
DROPS: Final = "drops"
#: The interface is down.
INTERFACE: Final = "interface"
#: The metrics cannot be fetched.
METRICS: Final = "metrics"
#: A part failed permanently and is switched off.
STOPPED: Final = "stopped"

#: Not a problem: the hash of the latest entry of the manifest, for anyone who keeps it elsewhere.
HEAD: Final = "head"

KINDS: Final = (EVIDENCE, EXPORT, REPORT, DROPS, INTERFACE, METRICS, STOPPED)
