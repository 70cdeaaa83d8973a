"""Findings: the catalogue, and the rules that make them."""
