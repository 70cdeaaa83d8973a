"""Where packets come from: capture files, compressed or not, and pipes that carry them.

`files.open_capture` looks at a path and returns the `packet.Reader` that fits; every reader delivers to a
`packet.PacketSink`. `live.opening.open_live` gives one for what passes on an interface now.
"""
