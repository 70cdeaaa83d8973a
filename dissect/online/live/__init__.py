"""Live runs: packets from a live source go through the pipeline, and produce events for display.

`run.LiveRun` reads packets, advances the clock and reports lost packets. `session.Session` runs it in a thread of its own and
keeps events in a bounded queue, from which the plain lines of `s7dissect monitor` and its screens take them. `iterating.live`
gives events to a program.
"""
