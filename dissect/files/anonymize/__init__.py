"""Anonymizes captures for publication: replaces addresses, names, passwords and values; everything else is unchanged."""
