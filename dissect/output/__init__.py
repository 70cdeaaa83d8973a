"""What is made of captures: blocks, values over time, what is normal, tables and logs, HTML."""
