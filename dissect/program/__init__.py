"""Blocks of a PLC's program as they were transferred: what they say of themselves, their parts, what changed between two."""
