"""List what clients did to devices: stops, loads, forces, passwords."""

import dissect


class Acts(dissect.Observer):
    """Prints each act."""

    def act(self, act: dissect.Act) -> None:
        print("packet", act.first_frame, act.kind, "-", act)


dissect.Run("captures/plc-control.pcapng", Acts()).read()

# Output:
# packet 12 stop - 127.0.0.1 to 127.0.0.1: PLC stop, accepted
# packet 16 stop - 127.0.0.1 to 127.0.0.1: PLC stop, accepted
# packet 18 start - 127.0.0.1 to 127.0.0.1: P_PROGRAM: start the CPU, warm restart, accepted
# packet 22 restart - 127.0.0.1 to 127.0.0.1: P_PROGRAM: start the CPU, "C ", cold restart, accepted
# packet 24 compress - 127.0.0.1 to 127.0.0.1: _GARB: compress memory, accepted
# packet 26 copy_ram_to_rom - 127.0.0.1 to 127.0.0.1: _MODU: copy RAM to ROM, "EP", accepted
# packet 28 delete - 127.0.0.1 to 127.0.0.1: DB 2, active and passive, accepted
