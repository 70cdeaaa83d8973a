"""TLS 1.2 and 1.3 in captures: records, handshakes, session keys from a key log, and decryption."""
