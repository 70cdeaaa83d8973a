"""Runs tasks on the workers of an existing Dask cluster: checks what the workers have, and provides an executor."""
