"""Watch an interface: print what is refused or not answered, as it happens. Ctrl-C ends it."""

import signal
import sys

import dissect

with dissect.live(sys.argv[1], filter="tcp port 102", pdus=False) as events:
    signal.signal(signal.SIGINT, lambda *_: events.stop())
    for event in events:
        if isinstance(event, dissect.Transaction) and event.failed:
            print(event)
    print(events.packets, "packets,", events.drops.kernel, "lost")
