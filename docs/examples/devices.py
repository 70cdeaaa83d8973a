"""Take an inventory: each station, its order number and firmware, and who talks to it."""

import dissect

for device in dissect.devices("captures/szl.pcapng"):
    print(device.address, device.role, device.get("order_number"), device.get("firmware"))
    for talk in device.asked_by:
        print("   asked by", talk)

# Output:
# 127.0.0.1 CPU 6ES7 315-2EH14-0AB0 V3.2.6
#    asked by Talk(127.0.0.1 → 127.0.0.1, 16 transactions)
