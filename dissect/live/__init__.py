"""A line that is watched: a live source joined to the pipeline, and what happens handed to whoever shows it.

`run.LiveRun` reads, lets the time pass and tells of lost packets; `session.Session` runs it in a thread of its own and keeps
what happened in a bounded queue, which the plain lines of `s7dissect monitor` and its screens empty alike.
"""
