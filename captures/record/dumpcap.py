"""dumpcap as a child: live before the first packet, flushed after the last."""

from __future__ import annotations

import re
import signal
import subprocess
import threading
import time
from pathlib import Path

SETTLE = 0.7
"""Seconds between the last packet of a session and the end of its capture: longer than any kernel buffer is held."""


class Dumpcap:
    """One capture on the loopback interface; ``stop()`` returns the number of packets that dumpcap wrote.

    Raises RuntimeError if dumpcap does not start (no right to capture, no such filter) or lost packets.
    """

    def __init__(self, path: Path, capture_filter: str, comment: str) -> None:
        self.path = path
        self._lines: list[str] = []
        self._live = threading.Event()
        command = ["dumpcap", "-i", "lo", "-f", capture_filter, "-w", str(path), "--capture-comment", comment]
        self._process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        if not self._live.wait(10) or self._process.poll() is not None:
            self._process.kill()
            raise RuntimeError("dumpcap did not start: " + " ".join(self._lines))
        # "File:" is printed when the file is open, a moment before the ring of the interface is read.
        time.sleep(0.3)

    def _read(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            self._lines.append(line.strip())
            if line.startswith("File:"):
                self._live.set()
        self._live.set()

    def stop(self) -> int:
        """Wait for packets that are still in the kernel, end the capture, and return its number of packets."""
        time.sleep(SETTLE)
        self._process.send_signal(signal.SIGINT)
        self._process.wait(10)
        self._reader.join(10)
        told = "\n".join(self._lines)
        captured = re.search(r"Packets captured: (\d+)", told)
        losses = re.search(r"dropped on interface .*?: \d+/(\d+)", told)
        if captured is None or losses is None or int(losses[1]):
            raise RuntimeError(f"{self.path.name}: lost packets or ended badly: {told}")
        return int(captured[1])
