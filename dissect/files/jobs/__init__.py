"""Reads independent captures in parallel, one task for each: processes, the transfer of results, and their sum."""
