"""A TCP relay between a client and a PLC that makes packets of the relayed data: for users who may not capture.

relay.Relay          listens, connects, passes on: octets, half-closes, resets; a thread of its own
tap.Tap              what passed, on its way to those who look at it; it never makes the relay wait
packets.Conversation what passed as Ethernet frames, as if the connection had been captured
source.RelayReader   the packets as a live source, for `dissect.live`
"""
