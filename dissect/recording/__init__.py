"""Packets kept as evidence: a ring of files, the packets around a finding, or a part of a capture, all of them as pcapng.

They work beside a pipeline (docs/evidence.md).
"""
