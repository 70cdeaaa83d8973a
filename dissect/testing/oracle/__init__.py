"""The oracle: compares this package's reading of a capture with Wireshark's, field by field (docs/oracle.md)."""
