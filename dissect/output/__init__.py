"""The products of captures: blocks, values over time, baselines, tables and logs, HTML."""
