"""TLS 1.2 and 1.3 as captures show it: records, handshakes, session keys of a key log, and what they open."""
