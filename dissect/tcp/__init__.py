"""From a frame to each direction's octets in order, holes told as holes."""
