"""A PLC that says what a capture says: for clients that are to be tested without one (docs/serve.md).

recording, script   what was asked and answered on each recorded connection, of a capture or a golden
book, player         which recorded answer a request gets; reads and writes put together of recorded items
image.Image          the memory of ``memory=True``
faults, desk         what goes wrong on request; what was asked, and what nothing like was recorded of
peer.Peer            one client, without its socket: TPKT, COTP, messages
line, service        sockets, time, bounds: `Server`
"""

from dissect.playback.server.faults import Fault, parse_fault
from dissect.playback.server.model import Recording
from dissect.playback.server.recording import ServerError, load_recording
from dissect.playback.server.request_log import Request
from dissect.playback.server.service import Server

__all__ = ["Fault", "Recording", "Request", "Server", "ServerError", "load_recording", "parse_fault"]
