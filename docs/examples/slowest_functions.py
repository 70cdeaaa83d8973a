"""Load transactions into pandas: how long does each function take."""

import dissect

frames = dissect.frames("captures/two-clients.pcapng")
slowest = frames.transactions.groupby("function_name", observed=True)["latency_ns"].agg(["count", "median", "max"])
print(slowest.to_string())

# Output:
#                      count   median     max
# function_name
# Read Var                24  55482.5  122432
# Setup communication      2  34378.5   45222
