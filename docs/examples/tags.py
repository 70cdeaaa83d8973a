"""Ask for variables by their tags, and select by their values."""

import dissect

where = dissect.Where("value[Valve.pressure] > 10")
for event in dissect.open("captures/nodes7-write.pcapng", tags="captures/tags/valve.csv", where=where, pdus=False):
    if isinstance(event, dissect.Transaction):
        print(event.request_frame, event)

# Output:
# 10 Write Var Valve.pressure = 12.5 bar (DB2.DBD16): answered
