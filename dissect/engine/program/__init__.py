"""Blocks of a PLC's program as they were transferred: the facts in their headers, their parts, the changes between versions."""
