"""List what went wrong: each transaction that was refused or not answered, and why."""

import dissect

for event in dissect.open("captures/nodes7-poll-missing.pcapng", pdus=False):
    if isinstance(event, dissect.Transaction) and event.failed:
        print(event.request_frame, event)
        for error in event.errors:
            print("   ", error)

# Output:
# 10 Read Var MB20 x2, DB2.DBB4 x2, DB2.DBB400 x4 and 1 more: answered, Invalid address, Object does not exist
#     item 3 DB2.DBB400: Invalid address
#     item 4 DB99.DBB0: Object does not exist
# 13 Read Var MB20 x2, DB2.DBB4 x2, DB2.DBB400 x4 and 1 more: answered, Invalid address, Object does not exist
#     item 3 DB2.DBB400: Invalid address
#     item 4 DB99.DBB0: Object does not exist
