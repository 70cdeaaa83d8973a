"""Check a capture in CI: end with code 1 when there is a finding that is an error."""

import sys

import dissect

analysis = dissect.analyze("captures/plc-control.pcapng")
for finding in analysis.findings:
    print(finding)
sys.exit(any(finding.severity == "error" for finding in analysis.findings))

# Output:
# error security.plc_stop, packets 12, 13: 127.0.0.1:53454 to 127.0.0.1:102: PLC stop, accepted
# error security.plc_stop, packets 16, 17: 127.0.0.1:53454 to 127.0.0.1:102: PLC stop, accepted
# error security.plc_start, packets 18, 19: 127.0.0.1:53454 to 127.0.0.1:102: PI service P_PROGRAM: start the CPU, warm restart, accepted
# error security.plc_start, packets 22, 23: 127.0.0.1:53454 to 127.0.0.1:102: PI service P_PROGRAM: start the CPU, "C ", cold restart, accepted
# error security.memory, packets 24, 25: 127.0.0.1:53454 to 127.0.0.1:102: PI service _GARB: compress memory, accepted
# error security.memory, packets 26, 27: 127.0.0.1:53454 to 127.0.0.1:102: PI service _MODU: copy RAM to ROM, "EP", accepted
# error security.program_change, packets 28, 29: 127.0.0.1:53454 to 127.0.0.1:102: PI service _DELE: delete blocks, block DB 2, active and passive, accepted
