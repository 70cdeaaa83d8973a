"""Craft captures/scd/plant.pcapng: SCD by the dictionary beside it, over all possible carriers.

python -m captures.craft.scd

A pumping station (192.0.2.20) and its peers: PDOs and SDOs over UDP, SDOs over TCP and a TSAP, values in a data block and in a
BSEND. No device with this protocol is public: the octets come from our codec (docs/scd.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from scapy.layers.inet import IP, UDP
from scapy.packet import Raw

from captures.craft.case import Case
from captures.craft.container import write_pcapng
from captures.craft.pairing import bsend
from captures.craft.pdus import dt, read, s7, setup, tell, values, written
from captures.craft.talk import CLIENT, SERVER, Talk, ethernet
from dissect import scd
from dissect.layers import COTP_CC, COTP_CR, TPKT, COTP_Parameter, S7_WriteDataItem, S7_WriteVarRequest, at

FOLDER: Final = Path(__file__).resolve().parents[1] / "scd"
ENDS: Final = ("192.0.2.10", "192.0.2.20")
#: Ports of plant.bind.toml: messages over UDP and TCP, bare PDOs over UDP.
MESSAGES, STREAM, BARE = 5600, 5601, 5602
R_ID: Final = 0x5CD
#: Numbers of ``scd_err_t``.
READ_ONLY, NO_OBJECT = -4, -5


class Station:
    """The station: makes messages by the dictionary and captures them."""

    def __init__(self, case: Case, dictionary: scd.Dictionary) -> None:
        self.case = case
        self.dictionary = dictionary
        self.codec = scd.Codec(dictionary)
        self.ident = 1

    # ---- messages ---------------------------------------------------------------------------------------------------

    def pdo(self, pdo: str, counter: int, values_: Mapping[Any, object], *, err: int = 0) -> bytes:
        """A PDO in its envelope, with the mapping version of the dictionary."""
        version = self.codec.pdo(pdo).version
        message = scd.Message(service="pdo", phase="push", pdo=pdo, tid=counter, sub=version, err=err)
        return self.codec.encode_message(_with(message, self.dictionary, values_))

    def ask(self, tid: int, where: str, value: object = None) -> bytes:
        """A request: a read, or a write if a value is given."""
        return self._sdo("request", tid, where, value, wrote=value is not None)

    def tell(self, tid: int, where: str, value: object = None) -> bytes:
        """A good response: with a value to a read, without one to a write."""
        return self._sdo("response", tid, where, value, wrote=value is None)

    def _sdo(self, phase: Any, tid: int, where: str, value: object, *, wrote: bool) -> bytes:
        index, sub = self.dictionary.variable(where).address
        message = scd.Message(service="write" if wrote else "read", phase=phase, tid=tid, index=index, sub=sub)
        return self.codec.encode_message(_with(message, self.dictionary, {} if value is None else {where: value}))

    def refuse(self, tid: int, index: int, sub: int, err: int, *, wrote: bool = False) -> bytes:
        """An abort."""
        service: Any = "write" if wrote else "read"
        message = scd.Message(service=service, phase="abort", tid=tid, index=index, sub=sub, err=err)
        return self.codec.encode_message(message)

    # ---- packets ----------------------------------------------------------------------------------------------------

    def send(self, side: int, *messages: bytes, port: int = MESSAGES) -> None:
        """Capture a datagram with these messages, to the station's port or from it."""
        self.ident += 1
        ports = (49200, port) if side == CLIENT else (port, 49200)
        header = IP(src=ENDS[side], dst=ENDS[1 - side], id=self.ident, flags="DF")
        self.case.put(ethernet(side, header / UDP(sport=ports[0], dport=ports[1]) / Raw(b"".join(messages))))

    def exchange(self, request: bytes, answer: bytes, *, after_ms: float = 1.5) -> None:
        """Capture a request over UDP and its answer."""
        self.send(CLIENT, request)
        self.case.pause(after_ms)
        self.send(SERVER, answer)
        self.case.pause(5)


def _with(message: scd.Message, dictionary: scd.Dictionary, values_: Mapping[Any, object]) -> scd.Message:
    message.values = {dictionary.variable(key).address: value for key, value in values_.items()}  # type: ignore[misc]
    return message


def states(flow: int, word: int = 0x0237, mode: int = 8, segment: int = 1) -> dict[Any, object]:
    """The values of the PDO Состояние."""
    return {f"Слово состояния {segment}": word, f"Расход {segment}": flow, f"Режим {segment}": mode}


def cycles(station: Station) -> None:
    """Both pumps send their state every 20 ms; two PDOs of the first one were not captured, the last has an error."""
    for cycle in range(12):
        if cycle not in {6, 7}:
            station.send(SERVER, station.pdo("T1", 250 + cycle & 0xFF, states(1200 - 7 * cycle)))
        if cycle % 4 == 0:
            both = station.pdo("T65", cycle // 4, states(900 + cycle, segment=2))
            pump = {"Насос 1.run": True, "Насос 1.fault": False, "Давление 1": 2748 - cycle, "Насос 1.speed": 1480}
            station.send(SERVER, both, station.pdo("T2", cycle // 4, pump))
        if cycle % 5 == 1:
            station.send(CLIENT, station.pdo("R1", cycle // 5, {"Насос 1.run": True, "Насос 1.speed": 1500}))
        station.case.pause(19)
    station.send(SERVER, station.pdo("T1", 6, states(0, mode=0), err=-16))


def services(station: Station) -> None:
    """SDOs: read, written, refused, unanswered; then the mapping of T1 is rewritten."""
    conf_id = int.from_bytes(station.dictionary.wire_id[:4], "little")
    for tid, (where, value) in enumerate(
        (
            ("Тип устройства", 0x00010002),
            ("Проверка конфигурации.ConfId", conf_id),
            ("Имя станции", "Насосная № 1"),
            ("Слово состояния 1", 0x0237),
            ("Последняя авария.time", scd.NetTime(1_445_126_400, 123_456_789)),
            ("Последняя авария.code", 1),
        ),
        1,
    ):
        station.exchange(station.ask(tid, where), station.tell(tid, where, value))
    station.exchange(station.ask(8, "Насос 1.run", value=False), station.tell(8, "Насос 1.run"))
    station.exchange(station.ask(9, "Давление 1", value=100), station.refuse(9, 0x6001, 0, READ_ONLY, wrote=True))
    unknown = station.codec.encode_message(scd.Message(service="read", phase="request", tid=10, index=0x6FFF, sub=0))
    station.exchange(unknown, station.refuse(10, 0x6FFF, 0, NO_OBJECT))
    station.send(CLIENT, station.ask(11, "Расход 2"))
    station.case.pause(2500)
    index = station.codec.pdo("T1").mapping.index
    where = f"0x{index:04x}"
    flow, mode = (station.dictionary.variable(name).index for name in ("Расход 1", "Режим 1"))
    entries = [flow | 32 << 48, mode | 32 << 32 | 8 << 48]
    for tid, (sub, number) in enumerate(((0, 0), (1, entries[0]), (2, entries[1]), (0, 2)), 12):
        key = f"{where}:{sub}"
        station.exchange(station.ask(tid, key, number), station.tell(tid, key))
    pdo = station.dictionary.with_mapping(index, entries)
    station.codec.remap(pdo)
    station.send(SERVER, station.pdo("T1", 7, {"Расход 1": 1111, "Режим 1": 1}))


def bare(station: Station) -> None:
    """The PDO T2 alone in a datagram."""
    for speed in (1500, 1490):
        pump = {"Насос 1.run": True, "Насос 1.fault": speed < 1500, "Давление 1": 2700, "Насос 1.speed": speed}
        station.send(SERVER, station.codec.encode("T2", pump), port=BARE)


def stream(station: Station) -> None:
    """SDOs over TCP, cut in the middle of messages."""
    talk = Talk(station.case, *ENDS, client_port=49300, port=STREAM)
    talk.open()
    requests = station.ask(1, "Расход 1") + station.ask(2, "Расход 2")
    talk.send(CLIENT, requests, 5)
    answers = station.tell(1, "Расход 1", -1000) + station.tell(2, "Расход 2", 77)
    talk.send(SERVER, answers, 3, len(answers) - 4)
    talk.close()


def tsap(station: Station) -> None:
    """SDOs in TSDUs of a connection to the TSAP SCD1."""
    talk = Talk(station.case, *ENDS, client_port=49301)
    talk.open()
    names = [COTP_Parameter.tpdu_size(1024), COTP_Parameter.calling("01.00"), COTP_Parameter.called("SCD1")]
    talk.send(CLIENT, bytes(TPKT() / COTP_CR(src_ref=1, parameters=names)))
    talk.send(SERVER, bytes(TPKT() / COTP_CC(dst_ref=1, src_ref=2, parameters=names)))
    talk.send(CLIENT, dt(station.ask(1, "Режим 1")))
    talk.send(SERVER, dt(station.tell(1, "Режим 1", 8)))
    talk.close()


def block(station: Station) -> None:
    """A data block with a pump's struct at 0 and the PDO T1 at 8, read and written; and a BSEND with a message."""
    codec = scd.Codec(station.dictionary)
    talk = Talk(station.case, *ENDS, client_port=49302)
    talk.open()
    talk.connect()
    talk.send(CLIENT, dt(setup(0, 480, 8, 8)))
    talk.send(SERVER, dt(setup(0, 480, 8, 8, answer=True)))
    for number, speed in enumerate((1480, 1510), 1):
        pump = codec.encode_type("pump_t", {"run": True, "fault": False, "speed": speed})
        octets = pump.ljust(8, b"\0") + codec.encode("T1", states(1200 + number))
        talk.send(CLIENT, dt(read(number, "DB10.DBB0", count=len(octets))))
        talk.send(SERVER, dt(values(number, octets)))
        station.case.pause(100)
    pump = codec.encode_type("pump_t", {"run": False, "fault": False, "speed": 0})
    job = S7_WriteVarRequest(items=[at("DB10.DBB0", len(pump))], data=[S7_WriteDataItem(octets=pump)])
    talk.send(CLIENT, dt(s7(3, job)))
    talk.send(SERVER, dt(written(3)))
    message = codec.encode_message(_pdo(station, 42))
    payload = b"\x12\x06\x13\x00" + R_ID.to_bytes(4, "big") + len(message).to_bytes(2, "big") + message
    talk.send(CLIENT, dt(bsend(4, payload)))
    talk.send(SERVER, dt(tell(4, 6, 1)))
    talk.close()


def _pdo(station: Station, counter: int) -> scd.Message:
    message = scd.Message(service="pdo", phase="push", pdo="T65", tid=counter, sub=1)
    return _with(message, station.dictionary, states(905, segment=2))


def plant() -> Case:
    """The whole capture."""
    case = Case("plant", "SCD by plant.toml in everything that carries it.")
    station = Station(case, scd.compile(FOLDER / "plant.toml"))
    for part in (cycles, services, bare, stream, tsap, block):
        part(station)
        case.pause(50)
    return case


def main() -> None:
    """Write the capture."""
    case = plant()
    octets = write_pcapng(case.packets, case.link_types)
    (FOLDER / case.file).write_bytes(octets)
    print(f"{case.file}: {len(case.packets)} packets, {len(octets)} octets")


if __name__ == "__main__":
    main()
