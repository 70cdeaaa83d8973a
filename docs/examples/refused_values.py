"""List values together with what the PLC refused."""

import dissect

for row in dissect.values("captures/item-errors.pcapng", refusals=True):
    print(row.frame, row.how, row.name, row.refused or row.value)

# Output:
# 11 read DB99.DBB0 Object does not exist
# 13 read DB2.DBB98 Invalid address
# 15 read MB120 Invalid address
# 17 read DB1.DBB0 [0, 1, 2]
# 17 read DB99.DBB0 Object does not exist
# 17 read DB2.DBD16 3.5
# 17 read DB2.DBW99 Invalid address
# 17 read M10.0 False
# …
