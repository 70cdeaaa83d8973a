"""Captures that stand alone, a task each: processes that read them, what these send, and the sum of it."""
