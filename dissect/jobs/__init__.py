"""One run as several: each analyses some of the connections, and what they find is put into the order of one run."""
