"""Exports to other tools: tables as Parquet, DuckDB, SQLite, CSV and Arrow, SQL over them, Zeek logs, ECS, STIX."""
