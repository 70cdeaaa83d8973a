"""What all packages below `dissect` share: codes, layouts, faults of octets, texts, files."""
