"""Follow variables: every change of a value, and who made it."""

from datetime import UTC, datetime

import dissect

for row in dissect.values("captures/nodes7-write.pcapng", tags="captures/tags/valve.csv", changes=True):
    time = datetime.fromtimestamp(row.time_ns / 1_000_000_000, UTC)
    print(f"{time:%H:%M:%S}", row.client.host, row.how, row.name, row.previous, "->", row.value, row.unit)

# Output:
# 01:31:17 127.0.0.1 write Valve.pressure None -> 12.5 bar
# 01:31:17 127.0.0.1 write Valve.position None -> -7 %
# 01:31:17 127.0.0.1 write Valve.open None -> False
# 01:31:17 127.0.0.1 write Heartbeat None -> 99
# 01:31:17 127.0.0.1 write Valve.cycles None -> 4711
# 01:31:17 127.0.0.1 write Valve.balance None -> -100.0 l
# 01:31:17 127.0.0.1 write QB6 None -> [2, 1]
# 01:31:17 127.0.0.1 write Remote None -> True
# …
