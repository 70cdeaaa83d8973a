"""Packets kept as evidence: a ring of files, the packets around a finding, or a part of a capture, all of them as pcapng.

They run next to a pipeline (docs/evidence.md).
"""
