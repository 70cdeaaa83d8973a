"""Examples that the help of each command ends with. tests/cli/test_examples.py runs every one of them."""

from __future__ import annotations

from typing import Final

#: Command → its examples, as typed in a shell. Each fits on a line of 80 columns.
EXAMPLES: Final = {
    "analyze": (
        "s7dissect analyze trace.pcapng",
        "s7dissect analyze --fail-on 'security.*' --per-file ring_*.pcapng",
        "s7dissect analyze --separate -j auto ring_*.pcapng",
        "ssh gateway cat trace.pcap.gz | s7dissect analyze -T json -",
    ),
    "transactions": (
        "s7dissect transactions --failed trace.pcapng",
        "s7dissect transactions -Y 'port == 102 and not failed' -c 5 trace.pcapng",
        "s7dissect transactions --separate -j auto -T jsonl ring_*.pcapng",
        "s7dissect transactions -T csv trace.pcapng > trace.csv",
    ),
    "values": (
        "s7dissect values press.pcapng DB2.DBD16:REAL MW20",
        "s7dissect values --tags plc_tags.xlsx --changes press.pcapng",
        "s7dissect values --summary press.pcapng",
        "s7dissect values -T csv --every 1s press.pcapng > values.csv",
    ),
    "operations": (
        "s7dissect operations trace.pcapng",
        "s7dissect operations --kind download --kind upload trace.pcapng",
    ),
    "report": (
        "s7dissect report trace.pcapng -o report.html",
        "s7dissect report --plot DB10.DBW0 ring_*.pcapng -o report.html",
        "s7dissect report --diff old.pcapng new.pcapng -o change.html",
    ),
    "browser": (
        "s7dissect browser -o s7dissect.html",
        "s7dissect browser --verify s7dissect.html",
    ),
    "blocks": (
        "s7dissect blocks trace.pcapng",
        "s7dissect blocks trace.pcapng -o blocks --tags plc_tags.xlsx",
        "s7dissect blocks --code trace.pcapng",
        "s7dissect blocks --diff trace.pcapng",
    ),
    "devices": (
        "s7dissect devices trace.pcapng",
        "s7dissect devices -T csv ring_*.pcapng > devices.csv",
        "s7dissect devices --separate -j auto ring_*.pcapng",
        "s7dissect devices --tags plc_tags.xlsx -Y 'port == 102' trace.pcapng",
    ),
    "index": (
        "s7dissect index captures",
        "s7dissect index -Y 'slug == security.program_change' captures",
    ),
    "cluster-check": (
        "s7dissect cluster-check tcp://scheduler:8786",
        "s7dissect cluster-check -T json tcp://scheduler:8786",
    ),
    "tags": (
        "s7dissect tags check plc_tags.xlsx tank.awl",
        "s7dissect tags list plc_tags.xlsx",
    ),
    "tags check": (
        "s7dissect tags check symbols.asc tank.awl",
        "s7dissect tags check --capture trace.pcapng plc_tags.xlsx",
    ),
    "tags list": (
        "s7dissect tags list symbols.asc tank.awl",
        "s7dissect tags list -T json plc_tags.xlsx",
    ),
    "tags convert": (
        "s7dissect tags convert symbols.asc tank.awl -o tags.csv",
        "s7dissect tags convert --tags-encoding cp1251 plc_tags.sdf",
    ),
    "show": (
        "s7dissect show -V --frame 17 trace.pcapng",
        "s7dissect show -T jsonl trace.pcapng",
    ),
    "cut": (
        "s7dissect cut trace.pcapng -o part.pcapng --connection 1",
        "s7dissect cut trace.pcapng -o bad.pcapng --finding warning --around 2s",
    ),
    "open": (
        "s7dissect open trace.pcapng",
        "s7dissect open -Y 'slug == security.program_change' --around 2s trace.pcapng",
        "s7dissect open --frame 12 trace.pcapng -o marked.pcapng",
    ),
    "extcap": (
        "s7dissect extcap --install",
        "s7dissect extcap --install wireshark/extcap",
    ),
    "anonymize": (
        "s7dissect anonymize trace.pcapng -o shared.pcapng",
        "s7dissect anonymize trace.pcapng -o shared.pcapng --key plant.key",
    ),
    "alerts test": ("s7dissect alerts test alerts.toml", "s7dissect alerts test /etc/s7dissect/alerts.toml"),
    "evidence export": (
        "s7dissect evidence export /var/lib/s7dissect -o out --time 2026-11-29T04:01",
        "s7dissect evidence export /var/lib/s7dissect -o day --time 2026-11-29",
    ),
    "evidence verify": (
        "s7dissect evidence verify /var/lib/s7dissect",
        "s7dissect evidence verify /var/lib/s7dissect --head 5f2c1d3b",
    ),
    "baseline": (
        "s7dissect baseline old.pcapng -o plant.toml",
        "s7dissect baseline --against plant.toml new.pcapng",
        "s7dissect baseline --rules alerts.toml new.pcapng",
    ),
    "export": (
        "s7dissect export trace.pcapng -o trace.parquet",
        "s7dissect export trace.pcapng -o trace.sqlite --only items --only findings",
        "s7dissect export trace.pcapng -o findings.stix",
        "s7dissect export ring_*.pcapng -o tables.csv -Y 'function == write'",
    ),
    "sql": (
        "s7dissect sql slowest trace.pcapng",
        "s7dissect sql 'SELECT count(*) FROM transactions' trace.pcapng",
        "s7dissect sql -T csv off-shift ring_*.pcapng",
    ),
    "golden": (
        "s7dissect golden trace.pcapng -o session.s7.txt",
        "s7dissect golden --with time,latency trace.pcapng",
    ),
    "diff": (
        "s7dissect diff session.s7.txt new.pcapng",
        "s7dissect diff --ignore 'values:DB10.*' --latency 20% old.pcapng new.pcapng",
    ),
    "verify": (
        "s7dissect verify trace.pcapng",
        "s7dissect verify --known --reorder trace.pcapng",
    ),
    "monitor": (
        "s7dissect monitor -i eth0",
        "s7dissect monitor --plain -i eth0 --alerts alerts.toml --fail-on error",
        "ssh gateway tcpdump -U -w - tcp port 102 | s7dissect monitor --plain -",
    ),
    "interfaces": (
        "s7dissect interfaces",
        "s7dissect interfaces -T json",
    ),
    "proxy": (
        "s7dissect proxy --to 192.168.0.10 -w session.pcapng",
        "s7dissect proxy --listen 127.0.0.1:0 --to 192.168.0.10:102 --only findings",
    ),
    "serve": (
        "s7dissect serve trace.pcapng",
        "s7dissect serve --fault delay:3:500 --fault 'refuse:DB10.*' trace.pcapng",
    ),
    "replay": (
        "s7dissect replay trace.pcapng --dry-run",
        "s7dissect replay trace.pcapng --to 127.0.0.1:10102 --timing recorded",
    ),
    "scd": (
        "s7dissect scd check plant.toml",
        "s7dissect scd decode -d plant.toml --pdo T2 C1 AB 24 FA",
    ),
    "scd compile": (
        "s7dissect scd compile plant.toml -o plant.scd",
        "s7dissect scd compile device.eds --encoding cp1251 -o device.scd",
    ),
    "scd dump": (
        "s7dissect scd dump plant.scd",
        "s7dissect scd dump --json device.eds > device.json",
    ),
    "scd check": (
        "s7dissect scd check plant.toml",
        "s7dissect scd check -T json plant.scd device.eds",
    ),
    "scd diff": (
        "s7dissect scd diff plant.scd plant.toml",
        "s7dissect scd diff -T json device.eds plant.toml",
    ),
    "scd decode": (
        "s7dissect scd decode -d plant.scd --pdo T2 C1 AB 24 FA",
        "echo C1AB24FA | s7dissect scd decode -d plant.scd --pdo T2 -T json -",
    ),
    "scd encode": (
        "s7dissect scd encode -d plant.scd --message read 0x6041 --tid 7",
        "s7dissect scd encode -d plant.scd --value 0x6001 0x05DC",
    ),
    "fields": (
        "s7dissect fields",
        "s7dissect fields function latency",
    ),
    "schema": (
        "s7dissect schema",
        "s7dissect schema analysis > analysis.schema.json",
    ),
    "completion": (
        "s7dissect completion bash > s7dissect.bash",
        "s7dissect completion fish | head",
    ),
    "help": (
        "s7dissect help live",
        "s7dissect help findings | grep security",
    ),
}


def examples_of(path: str) -> str:
    """Return the examples of a command, such as ``scd decode``, as a paragraph of its help; empty when it has none."""
    examples = EXAMPLES.get(path, ())
    return "\b\nExamples:\n" + "\n".join([f"  {line}" for line in examples]) if examples else ""
