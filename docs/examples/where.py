"""Keep only what is wanted, with an expression."""

import dissect

where = dissect.Where('function contains "Read" and error')
for event in dissect.open("captures/item-errors.pcapng", where=where, pdus=False):
    print(event)

# Output:
# Read Var DB99.DBB0 x4: answered, Object does not exist
# warning transaction.item_error, packets 10, 11: Read Var DB99.DBB0 x4: 0x0a Object does not exist
# Read Var DB2.DBB98 x10: answered, Invalid address
# warning transaction.item_error, packets 12, 13: Read Var DB2.DBB98 x10: 0x05 Invalid address
# Read Var MB120 x20: answered, Invalid address
# warning transaction.item_error, packets 14, 15: Read Var MB120 x20: 0x05 Invalid address
# Read Var DB1.DBB0 x3, DB99.DBB0 x4, DB2.DBD16 and 4 more: answered, Object does not exist, Invalid address, Invalid address
# warning transaction.item_error, packets 16, 17: Read Var DB99.DBB0 x4: 0x0a Object does not exist
# …
