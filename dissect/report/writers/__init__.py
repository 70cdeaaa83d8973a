"""One file for each format of records; `dissect.report.formats` has the table of them."""
