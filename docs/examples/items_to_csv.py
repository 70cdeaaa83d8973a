"""Write every item that was read or written as a line of CSV, with the names of a tag table."""

import csv
import sys

import dissect

table = csv.writer(sys.stdout)
table.writerow(["time", "client", "function", "tag", "address", "value", "unit", "result"])
for event in dissect.open("captures/nodes7-write.pcapng", tags="captures/tags/valve.csv", pdus=False):
    if isinstance(event, dissect.Transaction):
        for item in event.items:
            client = event.connection.client.host
            table.writerow(
                [
                    event.request_ns,
                    client,
                    event.function_name,
                    item.tag,
                    item.address,
                    item.value,
                    item.unit,
                    item.result,
                ]
            )

# Output:
# time,client,function,tag,address,value,unit,result
# 1795224677465235117,127.0.0.1,Write Var,Valve.pressure,DB2.DBD16,12.5,bar,ok
# 1795224677516623054,127.0.0.1,Write Var,Valve.position,DB2.DBW4,-7,%,ok
# 1795224677567979193,127.0.0.1,Write Var,Valve.open,DB2.DBX0.0,False,,ok
# 1795224677619786077,127.0.0.1,Write Var,Heartbeat,MW20,99,,ok
# 1795224677619786077,127.0.0.1,Write Var,Valve.cycles,DB2.DBW6,4711,,ok
# 1795224677619786077,127.0.0.1,Write Var,Valve.balance,DB2.DBD8,-100.0,l,ok
# 1795224677671192652,127.0.0.1,Write Var,,QB6,"[2, 1]",,ok
# …
