"""From a frame to each direction's octets in order, gaps reported as gaps."""
