"""The oracle: what this package makes of a capture beside what Wireshark makes of it, field by field (docs/oracle.md)."""
