"""captures/scd/plant.pcapng: it is what its recipe makes, and it says what the recipe says, written down here by hand."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any, Final

import pytest

import dissect
from captures.craft.container import write_pcapng
from captures.craft.scd import FOLDER, plant
from dissect import scd
from dissect.cli.main import main
from dissect.engine.findings.reporter import Finding
from dissect.engine.transactions.transaction import Transaction
from tests.meaning.report.schemas import complaints

FILES: Final = [str(FOLDER / name) for name in ("plant.toml", "plant.bind.toml", "plant.pcapng")]
DICT, BIND, CAPTURE = FILES
OPTIONS: Final = ["--scd", DICT, "--bind", BIND]

#: Names of the variables of each PDO.
STATE: Final = ["Слово состояния", "Расход", "Режим"]
PUMP: Final = ["Насос 1.run", "Насос 1.fault", "Давление 1", "Насос 1.speed"]
COMMAND: Final = ["Насос 1.run", "Насос 1.speed"]
Told = tuple[str, str, tuple[int, int], list[tuple[str, object]]]


def state(segment: int, word: int, flow: int, mode: int) -> list[tuple[str, object]]:
    return [(f"{name} {segment}", value) for name, value in zip(STATE, (word, flow, mode), strict=True)]


def pushes() -> list[Told]:
    """Twelve cycles, of which the seventh and eighth are lost; every fourth T65 and T2, the second of five R1; an error."""
    told: list[Told] = []
    frame = 0
    for cycle in range(12):
        if cycle not in {6, 7}:
            frame += 1
            told.append(("SCD PDO T1", "unsolicited", (0, frame), state(1, 567, 1200 - 7 * cycle, 8)))
        if cycle in {0, 4, 8}:
            frame += 1
            told.append(("SCD PDO T65", "unsolicited", (0, frame), state(2, 567, 900 + cycle, 8)))
            pump: list[tuple[str, object]] = list(zip(PUMP, (True, False, 2748 - cycle, 1480), strict=True))
            told.append(("SCD PDO T2", "unsolicited", (0, frame), pump))
        if cycle in {1, 6, 11}:
            frame += 1
            told.append(("SCD PDO R1", "unsolicited", (0, frame), list(zip(COMMAND, (True, 1500), strict=True))))
    told.append(("SCD PDO T1", "unsolicited", (0, 17), state(1, 567, 0, 0)))
    return told


def entry(index: int, offset: int, bits: int) -> int:
    return bits << 48 | offset << 32 | index


def expected() -> list[Told]:
    conf_id = int.from_bytes(scd.compile(DICT).wire_id[:4], "little")
    answered = "answered"
    alarm = scd.NetTime(1_445_126_400, 123_456_789)
    return [
        *pushes(),
        ("SCD read", answered, (18, 19), [("Тип устройства", 65538)]),
        ("SCD read", answered, (20, 21), [("Проверка конфигурации.ConfId", conf_id)]),
        ("SCD read", answered, (22, 23), [("Имя станции", "Насосная № 1")]),
        ("SCD read", answered, (24, 25), [("Слово состояния 1", 567)]),
        ("SCD read", answered, (26, 27), [("Последняя авария.time", alarm)]),
        ("SCD read", answered, (28, 29), [("Последняя авария.code", 1)]),
        ("SCD write", answered, (30, 31), [("Насос 1.run", False)]),
        ("SCD write", answered, (32, 33), [("Давление 1", 100)]),
        ("SCD read", answered, (34, 35), []),
        ("SCD read", "unanswered", (36, 0), []),
        ("SCD write", answered, (37, 38), [("0x1a00:0", 0)]),
        ("SCD write", answered, (39, 40), [("0x1a00:1", entry(0x6044, 0, 32))]),
        ("SCD write", answered, (41, 42), [("0x1a00:2", entry(0x6061, 32, 8))]),
        ("SCD write", answered, (43, 44), [("0x1a00:0", 2)]),
        ("SCD PDO T1", "unsolicited", (0, 45), [("Расход 1", 1111), ("Режим 1", 1)]),
        ("SCD PDO T2", "unsolicited", (0, 46), list(zip(PUMP, (True, False, 2700, 1500), strict=True))),
        ("SCD PDO T2", "unsolicited", (0, 47), list(zip(PUMP, (True, True, 2700, 1490), strict=True))),
        ("SCD read", answered, (52, 54), [("Расход 1", -1000)]),
        ("SCD read", answered, (52, 55), [("Расход 2", 77)]),
        ("SCD read", answered, (64, 65), [("Режим 1", 8)]),
        ("Setup communication", answered, (74, 75), []),
        ("Read Var", answered, (76, 77),
         [("run", True), ("fault", False), ("speed", 1480), *state(1, 567, 1201, 8)]),
        ("Read Var", answered, (78, 79),
         [("run", True), ("fault", False), ("speed", 1510), *state(1, 567, 1202, 8)]),
        ("Write Var", answered, (80, 81), [("run", False), ("fault", False), ("speed", 0)]),
        ("PBC (programmable block communication): BSEND", answered, (82, 83), state(2, 567, 905, 8)),
    ]  # fmt: skip


@cache
def events() -> list[object]:
    return list(dissect.open(CAPTURE, scd=DICT, bind=BIND))


def transactions() -> list[Transaction]:
    return [event for event in events() if isinstance(event, Transaction)]


def test_the_recipe_makes_it_to_the_octet() -> None:
    case = plant()
    assert write_pcapng(case.packets, case.link_types) == Path(CAPTURE).read_bytes()
    assert len(case.packets) == 86


def test_it_says_what_the_recipe_says() -> None:
    told = [
        (
            one.function_name,
            one.outcome,
            (one.request_frame, one.response_frame),
            [(row.name if row.name and "mapping of" not in found.subject else row.address, row.value)
             for found in one.scd for row in found.values],
        )
        for one in sorted(transactions(), key=lambda one: one.number)
    ]  # fmt: skip
    assert told == expected()


def test_who_sent_what() -> None:
    """The station sends T, the control room R, asks and writes."""
    for one in transactions():
        ends = one.connection.tcp.ends
        for found in one.scd:
            from_station = str(ends[found.side]).startswith("192.0.2.20")
            if found.message.pdo:
                assert from_station is (found.message.pdo[0] == "T" and not found.place.startswith("BSEND"))
            elif found.message.content:
                assert from_station is (one.function_name == "Read Var")
            else:
                assert from_station is (found.message.phase != "request")


def test_each_binding_found_its_own() -> None:
    found = [(one.binding, one.message.service or one.message.content) for each in transactions() for one in each.scd]
    names = ["обмен", "насос и давление", "поток", "канал", "насос в DB10", "состояние в DB10", "блоки"]
    assert [sum(binding == name for binding, _ in found) for name in names] == [48, 2, 4, 2, 3, 2, 1]
    folded: dict[str, Any] = dict(dissect.analyze(CAPTURE, scd=DICT, bind=BIND).as_dict())
    told = folded["scd"]
    assert [(row["name"], row["messages"], row["not_decoded"], row["cut"]) for row in told["bindings"]] == [
        ("обмен", 48, 1, 0), ("насос и давление", 2, 0, 0), ("поток", 4, 0, 0), ("канал", 2, 0, 0),
        ("насос в DB10", 3, 0, 0), ("состояние в DB10", 2, 0, 0), ("блоки", 1, 0, 0),
    ]  # fmt: skip
    limits = {key: value for key, value in told.items() if key not in {"bindings", "dictionary", "version", "wire_id"}}
    assert set(limits.values()) == {0}


def test_errors_and_findings() -> None:
    refused = [(one.request_frame, one.errors[0].code, one.errors[0].text) for one in transactions() if one.has_errors]
    assert refused == [(32, -4, "write of a read-only object"), (34, -5, "no such object")]
    told = {(event.slug, tuple(event.frames)) for event in events() if isinstance(event, Finding)}
    assert told == {
        ("scd.pdo_gap", (11,)),
        ("scd.pdo_error", (17,)),
        ("scd.access", (32,)),
        ("transaction.refused", (32, 33)),
        ("scd.unknown_object", (34,)),
        ("transaction.refused", (34, 35)),
        ("scd.remapped", (37,)),
        ("scd.remapped", (43,)),
        ("transaction.unanswered", (36,)),
        ("security.write", (80, 81)),
    }


def test_answer_times_are_those_of_the_recipe() -> None:
    assert {one.latency_ns for one in transactions() if one.request_frame in range(18, 45) and one.response_frame} == {
        2_000_000
    }
    (unanswered,) = [one for one in transactions() if one.outcome == "unanswered"]
    assert (unanswered.reason, unanswered.pdu_ref) == ("capture_ended", 11)


def ran(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    with pytest.raises(SystemExit) as end:
        main(list(arguments))
    assert end.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize(("command", "schema"), [("transactions", "transaction"), ("show", "pdu")])
@pytest.mark.parametrize("files", [1, 2])
def test_every_line_holds_to_its_schema(
    capsys: pytest.CaptureFixture[str], command: str, schema: str, files: int
) -> None:
    lines = ran(capsys, command, "-T", "jsonl", *OPTIONS, *[CAPTURE] * files).splitlines()
    told: list[dict[str, Any]] = [json.loads(line) for line in lines]
    assert [complaints(schema, line, exact=True) for line in told] == [[]] * len(told)
    assert len(told) == files * {"transactions": 45, "show": 76}[command]
    assert all(line.isascii() for line in lines)
    for line in told:
        found = line.get("scd", [])
        for one in found if isinstance(found, list) else [found]:
            assert 1 <= one["frame"] <= 86
            assert ("file" in one) is (files > 1)


def test_show_jsonl_tells_pdus_of_s7_and_scd(capsys: pytest.CaptureFixture[str]) -> None:
    every = [json.loads(line) for line in ran(capsys, "show", "-T", "jsonl", *OPTIONS, CAPTURE).splitlines()]
    told = [line for line in every if line["protocol"] != "cotp"]
    assert [line["protocol"] for line in told].count("scd") == 62
    (line,) = [line for line in told if line["frame"] == 33]
    assert (line["src"], line["dst"], line["pdu_ref"]) == ("192.0.2.20:5600", "192.0.2.10:49200", 9)
    assert line["function"] == {"code": None, "name": "write"}
    message = line["scd"]
    assert (message["phase"], message["err"], message["err_text"]) == ("abort", -4, "write of a read-only object")
    assert (message["index"], message["sub"], message["values"], message["flags"]) == (0x6001, 0, [], ["access"])


@pytest.mark.parametrize("files", [1, 2])
def test_the_analysis_holds_to_its_schema(capsys: pytest.CaptureFixture[str], files: int) -> None:
    told = json.loads(ran(capsys, "analyze", "-T", "json", *OPTIONS, *[CAPTURE] * files))
    assert complaints("analysis", told, exact=True) == []
    assert told["scd"]["dictionary"] == "Насосная"
    assert told["packets"]["used"]["payload"] == files * (47 + 5 + 4 + 12)  # UDP, TCP, TSAP, S7


def test_several_files_name_file_and_packet_and_share_no_device(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """The second file is another capture: T1 has the mapping of the dictionary again."""
    other = str(tmp_path / "second.pcapng")
    Path(other).write_bytes(Path(CAPTURE).read_bytes())
    lines = ran(capsys, "transactions", "-T", "jsonl", *OPTIONS, CAPTURE, other).splitlines()
    found = [one for line in lines for one in json.loads(line).get("scd", [])]
    files = {name: [{**one, "file": ""} for one in found if one["file"] == name] for name in (CAPTURE, other)}
    assert files[CAPTURE] == files[other]
    assert len(files[other]) == 62
    assert f"{other}:45 " in ran(capsys, "show", *OPTIONS, CAPTURE, other)


def test_without_the_options_it_is_s7_alone(capsys: pytest.CaptureFixture[str]) -> None:
    told = json.loads(ran(capsys, "analyze", "-T", "json", CAPTURE))
    assert told["scd"] is None
    assert told["packets"]["ignored"] == {"not_tcp": 47, "other_protocol": 5}
