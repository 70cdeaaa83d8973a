"""The HTML report: one page with a verdict, plots and tables, which works offline and neither loads nor sends anything."""
