"""Save the program blocks that a capture holds."""

import tempfile
from pathlib import Path

import dissect

folder = Path(tempfile.mkdtemp())
for block in dissect.blocks("captures/program-python.pcapng"):
    if not block.missing:
        (folder / f"{block.label}.mc7").write_bytes(block.octets)
print(sorted(path.name for path in folder.iterdir()))

# Output:
# ['FB7.mc7', 'FC5.mc7', 'OB1.mc7']
