"""The parts that use a network: addresses, alerts, live runs and their screens, counters, a relay."""
