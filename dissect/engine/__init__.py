"""From bytes in order to transactions, operations and findings: requests paired, acts of clients, what is wrong."""
