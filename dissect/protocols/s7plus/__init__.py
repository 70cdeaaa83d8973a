"""S7comm-plus: frames, PDUs, and their contents: objects, attributes, variables and values (docs/s7plus.md)."""
