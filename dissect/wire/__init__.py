"""What every room shares: codes, layouts, malformed facts, octets."""
