"""`s7dissect scd decode` and `encode`: every selector, every way to give octets and values, what is refused."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from dissect import scd
from dissect.scd.codec import Codec
from tests.cli.support import Ran, run

PLANT = Path(__file__).resolve().parents[2] / "captures" / "scd" / "plant.toml"
Capture = pytest.CaptureFixture[bytes]

READ = "DC 02 07 00 41 60 00 00 00 00 D5 D2"
RESPONSE = "DC 82 07 00 41 60 00 00 02 00 37 02 1F 30"
ABORT = "DC C2 07 FB 41 60 00 00 00 00 09 56"
TPDO = "DC 10 2A 00 00 1A 00 00 07 00 37 02 18 FC FF FF 08 BB 4D"


def decode(capture: Capture, *arguments: str | Path) -> Ran:
    return run(capture, "scd", "decode", "-d", PLANT, *arguments)


def encode(capture: Capture, *arguments: str | Path) -> Ran:
    return run(capture, "scd", "encode", "-d", PLANT, *arguments)


def told(ran: Ran) -> list[dict[str, Any]]:
    assert ran.out.isascii()
    return [json.loads(line) for line in ran.out.splitlines()]


def test_a_pdo_as_a_table(capfdbinary: Capture) -> None:
    ran = decode(capfdbinary, "--pdo", "T2", "C1 AB 24 FA")
    assert (ran.code, ran.err) == (0, "")
    assert ran.out == (
        "PDO T2 Насос и давление 1  4 bytes\n"
        "  address   name           value  unit    raw\n"
        "  0x6000:1  Насос 1.run    true\n"
        "  0x6000:2  Насос 1.fault  false\n"
        "  0x6001:0  Давление 1     1374   кПа     2748 (0xabc)\n"
        "  0x6000:4  Насос 1.speed  -1500  об/мин\n"
    )


def test_what_the_dictionary_calls_a_value_and_what_is_odd(capfdbinary: Capture) -> None:
    ran = decode(capfdbinary, "--pdo", "Состояние 1", "37 02 18 FC FF FF 08 11 22")
    assert ran.code == 0
    assert ran.out.splitlines()[1] == "  odd: trailing: 11 22"
    assert ran.out.splitlines()[-1] == "  0x6061:0  Режим 1            8 автомат  8 (0x8)"
    late = decode(capfdbinary, "--type", "alarm_t", "00" * 4 + "00CA9A3B" + "00" * 33)
    assert late.out.splitlines()[2].endswith("time_ns_range")
    assert late.out.splitlines()[1].split() == ["address", "name", "value", "raw", "flags"]


@pytest.mark.parametrize(
    ("selector", "octets", "values"),
    [
        (("--type", "pump_t"), "0124fa", {"pump_t.run": True, "pump_t.fault": False, "pump_t.speed": -1500}),
        (("--object", "Насос 1"), "0124fa", {"0x6000:1": True, "0x6000:2": False, "0x6000:4": -1500}),
        (("--object", "0x2001"), "6400fa009001", {"0x2001:1": 100, "0x2001:2": 250, "0x2001:3": 400}),
        (("--value", "0x6001"), "bc0a", {"0x6001:0": 2748}),
        (("--value", "Насос 1.speed"), "24fa", {"0x6000:4": -1500}),
        (("--value", "0x2003"), "00ff", {"0x2003:0": "00ff"}),
        (("--value", "Имя станции"), "D090", {"0x2002:0": "А"}),
    ],
)
def test_selectors(capfdbinary: Capture, selector: tuple[str, str], octets: str, values: dict[str, object]) -> None:
    (found,) = told(decode(capfdbinary, *selector, octets, "-T", "json"))
    assert {row["address"]: row["value"] for row in found["values"]} == values
    assert (found["schema"], found["error"], found["data"]) == ("s7dissect.scd-decode/1", None, octets.lower())
    assert found["content"] == selector[1]


def test_json_has_physical_values_units_and_texts(capfdbinary: Capture) -> None:
    (found,) = told(decode(capfdbinary, "--pdo", "T2", "C1AB24FA", "-T", "json"))
    assert (found["service"], found["phase"], found["pdo"], found["envelope"]) == ("pdo", "push", "T2", None)
    assert found["values"][2] == {
        "address": "0x6001:0", "name": "Давление 1", "value": 2748, "physical": 1374.0, "unit": "кПа", "text": None,
        "flags": [],
    }  # fmt: skip
    (found,) = told(decode(capfdbinary, "--value", "0x6061", "08", "-T", "json"))
    assert found["values"][0]["text"] == "автомат"


def test_messages(capfdbinary: Capture) -> None:
    ran = decode(capfdbinary, "--message", READ, RESPONSE, ABORT, TPDO)
    assert (ran.code, ran.err) == (0, "")
    assert [line for line in ran.out.splitlines() if not line.startswith(" ")] == [
        "request  read 0x6041:0 Слово состояния 1  tid 7  port 0  err 0 good  0 bytes",
        "response  read 0x6041:0 Слово состояния 1  tid 7  port 0  err 0 good  2 bytes",
        "abort  read 0x6041:0 Слово состояния 1  tid 7  port 0  err -5 no such object  0 bytes",
        "push  PDO T1 Состояние 1  tid 42  port 0  err 0 good  7 bytes",
    ]
    found = told(decode(capfdbinary, "--message", READ, RESPONSE, ABORT, TPDO, "-T", "json"))
    assert [one["phase"] for one in found] == ["request", "response", "abort", "push"]
    assert found[2]["envelope"]["err"] == -5
    assert found[2]["err_text"] == "no such object"


def test_a_damaged_message_is_shown_as_far_as_it_goes(capfdbinary: Capture) -> None:
    ran = decode(capfdbinary, "--message", RESPONSE, "DC", "02")
    assert (ran.code, ran.err) == (3, "")
    assert "567" in ran.out
    assert ran.out.splitlines()[-1] == "  not decoded: E_SHORT: envelope: 2 bytes, the header has 10"
    wrong = decode(capfdbinary, "--message", RESPONSE[:-2] + "31")
    assert wrong.code == 3
    assert "not decoded: E_CRC: envelope: 0x311f received" in wrong.out
    assert wrong.out.splitlines()[-1] == "  data: 37 02"
    assert told(decode(capfdbinary, "--message", "DC", "-T", "json"))[0]["error"]["code"] == "E_SHORT"


@pytest.mark.parametrize(
    "words", [("C1AB24FA",), ("C1", "AB", "24", "FA"), ("0xC1", "0xAB,0x24", "fa"), ("c1:ab:24:fa",), ("C1-AB-24-FA",)]
)
def test_ways_to_write_octets(capfdbinary: Capture, words: tuple[str, ...]) -> None:
    assert told(decode(capfdbinary, "--pdo", "T2", *words, "-T", "json"))[0]["data"] == "c1ab24fa"


def test_octets_of_files_and_pipes(capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written, plain = tmp_path / "octets.txt", tmp_path / "octets.bin"
    written.write_text("c1 ab\n24 fa\n")
    plain.write_bytes(b"\xc1\xab\x24\xfa")
    monkeypatch.chdir(tmp_path)
    wanted = decode(capfdbinary, "--pdo", "T2", "C1AB24FA").out
    assert decode(capfdbinary, "--pdo", "T2", written).out == wanted
    assert decode(capfdbinary, "--pdo", "T2", "--raw", plain).out == wanted
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(written.read_bytes())))
    assert decode(capfdbinary, "--pdo", "T2", "-").out == wanted
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(plain.read_bytes())))
    assert decode(capfdbinary, "--pdo", "T2", "--raw", "-").out == wanted
    refused = decode(capfdbinary, "--pdo", "T2", plain)
    assert (refused.code, refused.out) == (2, "")
    assert "not hexadecimal text; use --raw for raw bytes" in refused.err


def test_a_file_too_large_and_an_empty_one(capfdbinary: Capture, tmp_path: Path) -> None:
    large = tmp_path / "large"
    with large.open("wb") as file:
        file.truncate((1 << 20) + 1)
    assert "more than 1048576 bytes" in decode(capfdbinary, "--message", "--raw", large).err
    (tmp_path / "empty").touch()
    ran = decode(capfdbinary, "--pdo", "T2", tmp_path / "empty")
    assert (ran.code, ran.err) == (2, "s7dissect: E_SHORT: T2 Насос и давление 1: 0 bytes of 4\n")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("C1",), "Give one of --pdo, --type, --object, --value, --message."),
        (("--pdo", "T1", "--message", "C1"), "Give one of"),
        (("--pdo", "T1", "C1A"), "C1A: neither hexadecimal bytes (two digits each) nor a file."),
        (("--pdo", "T1", "C1", "no", "file"), "C1 no file: neither hexadecimal bytes"),
        (("--pdo", "T1", "--raw", "C1", "C2"), "--raw takes one FILE, or -."),
        (("--pdo", "T9", "C1"), "no PDO T9 in the dictionary 'Насосная'; there are T1, T2, T65, T66, R1, R65"),
        (("--pdo", "Состояние", "C1"), "no PDO 'Состояние' in the dictionary 'Насосная'; close to it: 'Состояние "),
        (("--type", "uint12", "C1"), "uint12 is a simple type, not a struct"),
        (("--type", "nothing", "C1"), "E_TYPE: nothing: no type 'nothing'"),
        (("--type", "pumpt", "C1"), "E_TYPE: pumpt: no type 'pumpt'; close to it: 'pump_t'"),
        (("--object", "Насос 3", "C1"), "no object is called 'Насос 3'; close to it: 'Насос "),
        (("--object", "0x9000", "C1"), "E_INDEX: 0x9000: no object 0x9000"),
        (("--object", "Насос 1.run", "C1"), "this is a variable, not a whole object"),
        (("--value", "0x6000:9", "C1"), "E_SUB: 0x6000:9: 'Насос 1' has no sub-index 9"),
        (("--value", "0x6001", "C1"), "E_SHORT: Давление 1: 1 byte, the value has 2"),
        (("--value", "0x2002", "FF"), "E_UTF8: "),
    ],
)
def test_what_decode_refuses(capfdbinary: Capture, arguments: tuple[str, ...], said: str) -> None:
    ran = decode(capfdbinary, *arguments)
    assert (ran.code, ran.out) == (2, "")
    assert said in ran.err
    assert "Traceback" not in ran.err


def test_undefined_bits_are_flagged_when_asked(capfdbinary: Capture) -> None:
    assert told(decode(capfdbinary, "--value", "0x6001", "BCFA", "-T", "json"))[0]["flags"] == []
    (found,) = told(decode(capfdbinary, "--strict-pad", "--value", "0x6001", "BCFA", "-T", "json"))
    assert found["flags"] == ["pad"]


# encode

STATE = ("0x6041=0x0237", "0x6044=-1000", "0x6061=8")


@pytest.mark.parametrize(
    ("arguments", "octets"),
    [
        (("--pdo", "T2", "Насос 1.run=true", "0x6000:2=false", "0x6001=0xABC", "0x6000.4=-1500"), "C1 AB 24 FA"),
        (
            ("--pdo", "T2", "Насос 1.run=true", "0x6000:2=false", "0x6001=1374 кПа", "0x6000.4=-1500 об/мин"),
            "C1 AB 24 FA",
        ),
        (("--value", "Насос 1.speed", "3001", "--no-limits"), "B9 0B"),
        (("--pdo", "T2", "--partial", "0x6000:1=1"), "01 00 00 00"),
        (("--pdo", "T1", "--partial"), "37 02 00 00 00 00 00"),
        (("--type", "pump_t", "run=true", "pump_t.fault=0", "speed=0xFA24"), "01 24 FA"),
        (("--type", "pump_t", "--partial", "run=true"), "01 00 00"),
        (("--object", "0x2001", "0x2001:1=100", "0x2001:2=250", "0x2001:3=400"), "64 00 FA 00 90 01"),
        (("--object", "Насос 1", "0x6000:1=1", "0x6000:2=0", "0x6000:4=-1500"), "01 24 FA"),
        (("--value", "0x6001", "0xABC"), "BC 0A"),
        (("--value", "0x6044", "0x6044=-1000"), "18 FC FF FF"),
        (("--value", "0x6061", "автомат"), "08"),
        (("--value", "0x2003", "00 FF"), "00 FF"),
        (("--message", "read", "0x6041", "--tid", "7"), READ),
        (("--message", "read-response", "Слово состояния 1=0x237", "--tid", "7"), RESPONSE),
        (("--message", "read-abort", "0x6041:0", "--tid", "7", "--err", "-5"), ABORT),
        (("--message", "read-response", "0x6041", "--err", "3"), "DC 82 00 03 41 60 00 00 00 00 FD 72"),
        (("--message", "write", "0x6000:1=true", "--tid", "8"), "DC 01 08 00 00 60 01 00 01 00 01 69 FF"),
        (("--message", "write-response", "0x6000:1", "--tid", "8"), "DC 81 08 00 00 60 01 00 00 00 E5 C0"),
        (("--message", "pdo", "--pdo", "T1", *STATE, "--tid", "42"), TPDO),
    ],
)
def test_encode(capfdbinary: Capture, arguments: tuple[str, ...], octets: str) -> None:
    ran = encode(capfdbinary, *arguments)
    assert (ran.code, ran.err) == (0, "")
    assert ran.out == octets + "\n"


def test_a_device_may_be_asked_for_what_it_does_not_have(capfdbinary: Capture) -> None:
    ran = encode(capfdbinary, "--message", "read", "0x9000:3", "--port", "200")
    message = Codec(scd.compile(PLANT)).parse_message(bytes.fromhex(ran.out))
    assert (message.index, message.sub, message.port, message.service) == (0x9000, 3, 200, "read")


def test_octets_go_through_a_pipe() -> None:
    command = [sys.executable, "-m", "dissect", "scd"]
    made = subprocess.run(
        [*command, "encode", "-d", PLANT, "--pdo", "T2", "--partial", "--raw", "0x6001=0xABC"],
        capture_output=True,
        check=True,
    )
    assert made.stdout == b"\xc0\xab\x00\x00"
    read = subprocess.run(
        [*command, "decode", "-d", PLANT, "--pdo", "T2", "--raw", "-T", "json", "-"],
        input=made.stdout, capture_output=True, check=True,
    )  # fmt: skip
    assert json.loads(read.stdout)["values"][2]["value"] == 0xABC


def test_a_name_may_have_an_equals_sign_in_it(capfdbinary: Capture, tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    path.write_text(
        '[dictionary]\nname = "x"\n[[object]]\nindex = 0x2000\nname = "a=b"\ntype = "string"\nsize = 4\n'
        '[[pdo]]\ndir = "T"\nnumber = 1\nmap = ["0x2000"]\n'
    )
    assert run(capfdbinary, "scd", "encode", "-d", path, "--pdo", "T1", "a=b=c=d").out == "63 3D 64 00\n"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "Give one of"),
        (("--pdo", "T2", "0x6001"), "expected VARIABLE=VALUE, got '0x6001'."),
        (
            ("--pdo", "T2", "--partial", "0x6001=1374"),
            "may be the raw or the physical value: write raw:1374 or '1374 кПа'",
        ),
        (
            ("--pdo", "T2", "--partial", "Насос 1.speed=3001"),
            "3001 is outside the limits of its raw value, -3000..3000",
        ),
        (("--pdo", "T2", "0x6001=raw:1", "Давление 1=1кПа"), "a variable was given twice."),
        (("--pdo", "T2", "0x6001=0x1"), "E_COUNT: T2 Насос и давление 1: no value for Насос 1.run"),
        (("--pdo", "T2", "--partial", "0x6044=1"), "no place for a value of 0x6044:0"),
        (("--pdo", "T2", "nothing=1"), "E_INDEX: nothing: no object is called 'nothing'"),
        (("--pdo", "T2", "nothing=1=2"), "E_INDEX: nothing: no object"),
        (("--pdo", "T2", "Насос.speed=1"), "no object is called 'Насос.speed'; close to it: 'Насос "),
        (("--pdo", "T2", "Насос 1.spd=1"), "E_SUB: 0x6000:spd: 'Насос 1' has no field 'spd'; close to it: 'speed'"),
        (("--pdo", "T2", "Насос 1.x=1"), "'Насос 1' has no field 'x'; it has 'run', 'fault', 'speed'"),
        (("--pdo", "T2", "Давление 1.x=1"), "'Давление 1' has no field 'x': it is one variable, without fields"),
        (("--object", "0x2001", "Пороги давления.x=1"), "has no field 'x'; its sub-indices are 1 to 3"),
        (("--value", "0x6061", "автомт"), "'автомт' is not a whole number; close to it: 'автомат'"),
        (("--value", "0x6061", "x"), "'x' is not a whole number, nor one of 'стоп', 'ручной', 'автомат'"),
        (("--pdo", "T2", "--partial", "0x6001=raw:4096"), "E_RANGE: Давление 1: 4096 is outside 0..4095"),
        (("--pdo", "T2", "--partial", "0x6001=much"), "E_VALUE: Давление 1: 'much' is not a whole number"),
        (("--type", "pump_t", "flow=1"), "E_SUB: pump_t: no field 'flow'"),
        (("--type", "uint12", "a=1"), "no field 'a'"),
        (("--object", "0x2001", "--partial"), "--partial needs --pdo or --type."),
        (("--value", "0x6001"), "--value takes one VALUE."),
        (("--value", "0x6001", "1", "--tid", "1"), "--tid needs --message."),
        (("--message", "read"), "a read concerns one variable"),
        (("--message", "write", "0x6000:1"), "expected VARIABLE=VALUE, got '0x6000:1'."),
        (("--message", "pdo", "0x6000:1=1"), "--message pdo needs --pdo"),
        (("--message", "read", "--pdo", "T1", "0x6000:1"), "--message pdo needs --pdo"),
        (("--message", "read", "0x6041", "--tid", "256"), "E_RANGE: envelope field tid: 256 is outside 0..255"),
        (("--message", "read", "0x6041", "--src", "1"), "E_VALUE: envelope: it has no field src, only kind, "),
        (("--message", "read", "0x6041=5"), "a read carries no value: give 0x6041 alone."),
        (
            ("--message", "write-response", "Насос 1.run=true"),
            "a write-response carries no value: give Насос 1.run alone.",
        ),
        (("--message", "read", "Ничего"), "no object is called 'Ничего'"),
        (("--message", "sing", "0x6041"), "'sing' is not one of"),
    ],
)
def test_what_encode_refuses(capfdbinary: Capture, arguments: tuple[str, ...], said: str) -> None:
    ran = encode(capfdbinary, *arguments)
    assert (ran.code, ran.out) == (2, "")
    assert said in ran.err
    assert "Traceback" not in ran.err
