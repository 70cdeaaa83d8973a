"""What bytes say: a room for each protocol, which parses and builds its messages and knows of no connection."""
