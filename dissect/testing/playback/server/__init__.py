"""A fake PLC that answers from a capture, to test clients without a PLC (docs/serve.md).

recording, model       requests and answers of each recorded connection, from a capture or a golden
answer_index, player   the recorded answer for a request; reads and writes built from recorded items
image.Image            the memory of ``memory=True``
faults, request_log    faults on demand; the requests, and those without a recorded match
session.ClientSession  one client, without its socket: TPKT, COTP, messages
socket, service        sockets, time, bounds: `Server`
"""

from dissect.testing.playback.server.faults import Fault, parse_fault
from dissect.testing.playback.server.model import Recording
from dissect.testing.playback.server.recording import ServerError, load_recording
from dissect.testing.playback.server.request_log import Request
from dissect.testing.playback.server.service import Server

__all__ = ["Fault", "Recording", "Request", "Server", "ServerError", "load_recording", "parse_fault"]
