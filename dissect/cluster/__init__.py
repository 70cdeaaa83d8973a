"""Tasks on the workers of a Dask cluster that already runs: who they are, what they have, and an executor that uses them."""
