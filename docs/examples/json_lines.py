"""Write the JSON lines of `s7dissect transactions -T jsonl` from a program, and add a field of your own."""

import json

import dissect

for event in dissect.open("captures/answer-lost.pcapng", pdus=False):
    if isinstance(event, dissect.Transaction):
        line = event.as_dict()
        print(json.dumps({"plant": "north", "outcome": line["outcome"], "function": line["function"]}))

# Output:
# {"plant": "north", "outcome": "answered", "function": {"code": 240, "name": "Setup communication"}}
# {"plant": "north", "outcome": "answered", "function": {"code": 4, "name": "Read Var"}}
# {"plant": "north", "outcome": "answered", "function": {"code": 4, "name": "Read Var"}}
# {"plant": "north", "outcome": "answered", "function": {"code": 4, "name": "Read Var"}}
# {"plant": "north", "outcome": "answered", "function": {"code": 4, "name": "Read Var"}}
# {"plant": "north", "outcome": "answered", "function": {"code": 4, "name": "Read Var"}}
# {"plant": "north", "outcome": "unanswered", "function": {"code": 4, "name": "Read Var"}}
