"""MITRE ATT&CK for ICS v18.1: the tactics of each technique, and the id of its object in STIX.

From attack-stix-data, ics-attack.json, 2025-11-13. Names of techniques, and the findings that refer to them, are in
`dissect.engine.findings.mitre` and the catalogue.
"""

from __future__ import annotations

from typing import Final, NamedTuple


class Tactic(NamedTuple):
    """A tactic: its id, its name, and its name as a phase of the kill chain in STIX."""

    id: str
    name: str
    phase: str


#: By id.
TACTICS: Final[dict[str, Tactic]] = {
    row[0]: Tactic(*row)
    for row in (
        ("TA0100", "Collection", "collection"),
        ("TA0101", "Command and Control", "command-and-control"),
        ("TA0102", "Discovery", "discovery"),
        ("TA0103", "Evasion", "evasion"),
        ("TA0104", "Execution", "execution"),
        ("TA0105", "Impact", "impact"),
        ("TA0106", "Impair Process Control", "impair-process-control"),
        ("TA0107", "Inhibit Response Function", "inhibit-response-function"),
        ("TA0108", "Initial Access", "initial-access"),
        ("TA0109", "Lateral Movement", "lateral-movement"),
        ("TA0110", "Persistence", "persistence"),
        ("TA0111", "Privilege Escalation", "privilege-escalation"),
    )
}

#: Tactics and the id of the STIX object, by the id of the technique.
TECHNIQUES: Final[dict[str, tuple[tuple[str, ...], str]]] = {
    "T0801": (("TA0100",), "2d0d40ad-22fa-4cc8-b264-072557e1364b"),
    "T0803": (("TA0107",), "008b8f56-6107-48be-aa9f-746f927dbb61"),
    "T0804": (("TA0107",), "3f1f4ccb-9be2-4ff8-8f69-dd972221169b"),
    "T0806": (("TA0106",), "8e7089d3-fba2-44f8-94a8-9a79c53920c4"),
    "T0809": (("TA0107",), "493832d9-cea6-4b63-abe7-9a65a6473675"),
    "T0814": (("TA0107",), "1b22b676-9347-4c55-9a35-ef0dc653db5b"),
    "T0816": (("TA0107",), "25dfc8ad-bd73-4dfd-84a9-3c3d383f76e9"),
    "T0821": (("TA0104",), "09a61657-46e1-439e-b3ed-3e4556a78243"),
    "T0830": (("TA0100",), "9a505987-ab05-4f46-a9a6-6441442eec3b"),
    "T0831": (("TA0105",), "1af9e3fd-2bcc-414d-adbd-fe3b95c02ca1"),
    "T0832": (("TA0105",), "4c2e1408-9d68-4187-8e6b-a77bc52700ec"),
    "T0835": (("TA0107",), "36e9f5bc-ac13-4da4-a2f4-01f4877d9004"),
    "T0836": (("TA0106",), "097924ce-a9a9-4039-8591-e0deedfb8722"),
    "T0838": (("TA0107",), "e5de767e-f513-41cd-aa15-33f6ce5fbf92"),
    "T0839": (("TA0110", "TA0106"), "efbf7888-f61b-4572-9c80-7e2965c60707"),
    "T0840": (("TA0102",), "ea0c980c-5cf0-43a7-a049-59c4c207566e"),
    "T0842": (("TA0102",), "38213338-1aab-479d-949b-c81b66ccca5c"),
    "T0843": (("TA0109",), "be69c571-d746-4b1f-bdd0-c0c9817e9068"),
    "T0845": (("TA0100",), "3067b85e-271e-4bc5-81ad-ab1a81d411e3"),
    "T0846": (("TA0102",), "d5a69cfb-fc2a-46cb-99eb-74b236db5061"),
    "T0848": (("TA0108",), "b14395bd-5419-4ef4-9bd8-696936f509bb"),
    "T0855": (("TA0106",), "40b300ba-f553-48bf-862e-9471b220d455"),
    "T0856": (("TA0103", "TA0106"), "8535b71e-3c12-4258-a4ab-40257a1becc4"),
    "T0857": (("TA0110", "TA0107"), "b9160e77-ea9e-4ba9-b1c8-53a3c466b13d"),
    "T0858": (("TA0104", "TA0103"), "2883c520-7957-46ca-89bd-dab1ad53b601"),
    "T0859": (("TA0110", "TA0109"), "cd2c76a4-5e23-4ca5-9c40-d5e0604f7101"),
    "T0861": (("TA0100",), "25852363-5968-4673-b81d-341d5ed90bd1"),
    "T0868": (("TA0100",), "2aa406ed-81c3-4c1d-ba83-cfbee5a2847a"),
    "T0869": (("TA0101",), "e076cca8-2f08-45c9-aff7-ea5ac798b387"),
    "T0878": (("TA0107",), "2900bbd8-308a-4274-b074-5b8bde8347bc"),
    "T0881": (("TA0107",), "063b5b92-5361-481a-9c3f-95492ed9a2d8"),
    "T0882": (("TA0105",), "b7e13ee8-182c-4f19-92a4-a88d7d855d54"),
    "T0885": (("TA0101",), "e6c31185-8040-4267-83d3-b217b8a92f07"),
    "T0886": (("TA0108", "TA0109"), "e1f9cdd2-9511-4fca-90d7-f3e92cfdd0bf"),
    "T0888": (("TA0102",), "2fedbe69-581f-447d-8a78-32ee7db939a9"),
    "T0889": (("TA0110",), "fc5fda7e-6b2c-4457-b036-759896a2efa2"),
    "T0891": (("TA0109", "TA0110"), "c9a8d958-fcdb-40d2-af4c-461c8031651a"),
    "T0892": (("TA0107",), "fab8fc7d-f27f-4fbb-9de6-44740aade05f"),
}
