"""The protocols: a room for each one, which parses and builds its messages and does not know connections."""
