"""The client's side of a recorded session, played to a real server and checked against the recording (docs/replay.md).

`load_recorded` reads a capture or a golden, `make_plan` selects what is played, `places_of` returns the addresses to connect to
(only of this machine, unless more is allowed), and `replay` plays the plan: only reads, unless `Permissions` allow more. Its
`ReplayOutcome` has both sessions for `dissect.testing.golden.diff_sessions`.
"""

from dissect.protocols.s7.tables import CONTROL, READ, WRITE
from dissect.testing.playback.client.permissions import Permissions, kind_of
from dissect.testing.playback.client.plan import Part, Withheld, make_plan, plan_lines
from dissect.testing.playback.client.recorded import ReplayError, load_recorded
from dissect.testing.playback.client.run import ReplayOutcome, replay
from dissect.testing.playback.client.schedule import expect_few
from dissect.testing.playback.client.settings import Settings
from dissect.testing.playback.client.target import places_of, read_target

__all__ = [
    "CONTROL",
    "READ",
    "WRITE",
    "Part",
    "Permissions",
    "ReplayError",
    "ReplayOutcome",
    "Settings",
    "Withheld",
    "expect_few",
    "kind_of",
    "load_recorded",
    "make_plan",
    "places_of",
    "plan_lines",
    "read_target",
    "replay",
]
