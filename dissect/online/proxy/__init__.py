"""A TCP relay between a client and a PLC that turns the relayed data into packets: for users without the right to capture.

relay.Relay          listens, connects, relays octets, half-closes and resets; runs in a thread tap.Tap              the queue
of relayed data on its way to the dissection; it never makes the relay wait packets.Conversation relayed data as Ethernet
frames, as if the connection had been captured source.RelayReader   the packets as a live source, for `dissect.live`
"""
