"""One file for each format of records; `dissect.meaning.report.formats` has the table of them."""
