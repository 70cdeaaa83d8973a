"""The HTML report: one page with a verdict, plots and tables, which opens without a network and lets nothing in or out."""
