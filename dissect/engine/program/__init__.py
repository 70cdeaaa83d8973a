"""Blocks of a PLC's program as they were transferred: facts in their headers, their parts, changes between two versions."""
