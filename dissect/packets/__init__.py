"""From a file, a pipe or an interface to bytes in order: what holds packets, and links, IP and TCP."""
