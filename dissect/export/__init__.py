"""Results for other tools: tables as Parquet, DuckDB, SQLite, CSV and Arrow, SQL over them, logs of Zeek, ECS, STIX."""
