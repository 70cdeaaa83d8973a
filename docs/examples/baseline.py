"""Learn what is normal from one capture, and list what is new in another."""

import dissect
from dissect.output.baseline import BaselineComparison, Learner

learner = Learner()
dissect.Run("captures/nodes7-poll.pcapng", learner).read()
today = BaselineComparison(learner.baseline())
dissect.Run("captures/plc-control.pcapng", today).read()
for deviation in today.found:
    print(deviation)

# Output:
# first CPU functions: read SZL request to 127.0.0.1 by 127.0.0.1
# first PLC stop request to 127.0.0.1 by 127.0.0.1
# stop on 127.0.0.1 by 127.0.0.1 (accepted)
# first PI service request to 127.0.0.1 by 127.0.0.1
# start on 127.0.0.1 by 127.0.0.1 (accepted)
# restart on 127.0.0.1 by 127.0.0.1 (accepted)
# compress on 127.0.0.1 by 127.0.0.1 (accepted)
# copy ram to rom on 127.0.0.1 by 127.0.0.1 (accepted)
# …
