"""Packets kept as evidence: a ring of files, the packets around a finding, and a part of a capture, all of them pcapng.

Who runs a pipeline puts these beside it; see docs/evidence.md.
"""
