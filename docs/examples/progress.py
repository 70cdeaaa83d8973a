"""Read a large capture step by step, with progress, and count only what is needed."""

from collections import Counter

import dissect


class Writers(dissect.Observer):
    """Counts who writes."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_facts = False
        self.writes: Counter[str] = Counter()

    def transaction(self, transaction: dissect.Transaction) -> None:
        if transaction.function_name == "Write Var":
            self.writes[transaction.connection.client.host] += 1


writers = Writers()
run = dissect.Run("captures/nodes7-write.pcapng", writers)
while run.step():
    pass
print(run.pipeline.frames, "packets,", dict(writers.writes))

# Output:
# 30 packets, {'127.0.0.1': 6}
