"""What works on a network: addresses, alerts, live runs and their screens, counters, a relay."""
