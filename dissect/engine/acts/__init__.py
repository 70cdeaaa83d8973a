"""Acts: what clients do to devices beyond reading and writing values, over all protocols."""
