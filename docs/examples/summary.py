"""Sum up a capture: how much, how fast, what failed."""

import dissect

analysis = dissect.analyze("captures/item-errors.pcapng")
print(analysis.total, "transactions,", analysis.answered, "answered,", analysis.with_errors, "refused something")
print("median answer time:", analysis.latencies.quantile(0.5), "ns")
for function in analysis.functions.values():
    print(function.name, function.total, "of them", function.errors, "with errors")

# Output:
# 8 transactions, 8 answered, 7 refused something
# median answer time: 52889 ns
# Setup communication 1 of them 0 with errors
# Read Var 4 of them 4 with errors
# Write Var 3 of them 3 with errors
