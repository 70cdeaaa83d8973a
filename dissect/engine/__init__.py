"""From packets to transactions: the pipeline and one part for each protocol."""
