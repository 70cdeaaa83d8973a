"""Sources of packets: capture files, compressed or not, pipes that carry captures, and network interfaces.

`files.open_capture` returns the `packet.Reader` that fits a file or pipe; `live.opening.open_live` returns one for an
interface. Every reader delivers packets to a `packet.PacketSink`.
"""
