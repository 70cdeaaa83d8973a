"""See what several transactions did together: loads, long answers, subscriptions."""

import dissect

for event in dissect.open("captures/transfer.pcapng", pdus=False):
    if isinstance(event, dissect.Operation):
        print(event, f"({event.parts} transactions)")

# Output:
# connect PDU 480, AmQ 1/1: done (1 transactions)
# upload DB 10, active: done, 100 bytes (3 transactions)
# upload DB 1, active: done, 636 bytes (4 transactions)
# upload DB 99, active: refused (1 transactions)
# download DB 10, passive: done, 60 bytes (3 transactions)
# download DB 1, passive: done, 600 bytes (4 transactions)
# download DB 99, passive: refused (1 transactions)
