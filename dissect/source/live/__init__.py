"""Live sources of packets: ``dumpcap``, the kernel's own packet ring, or a pipe on standard input.

`opening.open_live` chooses between them. Each gives a `reader.LiveReader`: a `Reader` that never waits long, reports what was
lost, and can be stopped. None of them sends anything.
"""
