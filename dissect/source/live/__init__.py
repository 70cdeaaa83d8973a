"""Packets as they pass: from ``dumpcap``, from the kernel's own ring, or from a pipe on standard input.

`opening.open_live` chooses between them; each gives a `reader.LiveReader`, which is a `Reader` that never waits long, tells
what was lost, and can be stopped. All of it only receives.
"""
