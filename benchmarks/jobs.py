"""The transactions of the synthetic plant: requests, answers, and their errors."""

from __future__ import annotations

from random import Random

from benchmarks.pdus import ACK, ACK_DATA, JOB, READ, USERDATA, WRITE, Variables, userdata_answer, userdata_request


class Job:
    """One request with its answer, both without their PDU reference. ``function`` -1: the answer has no parameters."""

    __slots__ = (
        "answer_data", "answer_function", "answer_param", "answer_rosctr", "data", "error", "failed", "function", "items",
        "param", "refusals", "rosctr",
    )  # fmt: skip

    def __init__(self, rosctr: int, param: bytes, data: bytes, answer_param: bytes, answer_data: bytes) -> None:
        self.rosctr = rosctr
        self.param = param
        self.data = data
        self.function = param[0]
        self.answer_rosctr = USERDATA if rosctr == USERDATA else ACK_DATA
        self.answer_param = answer_param
        self.answer_data = answer_data
        self.answer_function = answer_param[0]
        #: Error class and code of the answer's header (class << 8 | code).
        self.error = 0
        self.failed = False
        self.items = 0
        self.refusals = 0

    def refuse(self, error: int) -> None:
        """Let the answer be an Ack that only has ``error``."""
        self.answer_rosctr = ACK
        self.answer_param = self.answer_data = b""
        self.answer_function = -1
        self.error = error
        self.failed = True
        self.refusals = 0


def read_job(rng: Random, read: Variables) -> Job:
    """Return a Read Var; one in 300 has an item that is refused this once."""
    bits = rng.getrandbits(30)
    also = bits % len(read.items) if bits % 300 == 0 else -1
    count = len(read.items)
    job = Job(JOB, read.param, b"", bytes((READ, count)), read.values(bits, 0xFF, also))
    job.items = count
    if read.refused or also >= 0:
        job.failed = True
        job.refusals = sum(1 for number, item in enumerate(read.items) if item.refusal or number == also)
    return job


def write_job(rng: Random, write: Variables) -> Job:
    """Return a Write Var; one in 100 has an item that is refused."""
    bits = rng.getrandbits(30)
    also = bits % len(write.items) if bits % 100 == 0 else -1
    count = len(write.items)
    job = Job(JOB, write.param, write.values(bits, 0x00), bytes((WRITE, count)), write.codes(also))
    job.items = count
    if also >= 0:
        job.failed = True
        job.refusals = 1
    return job


_LISTS = ((0x0011, 0, 28, 4), (0x001C, 0, 34, 5), (0x0232, 4, 40, 1), (0x0424, 0, 20, 1), (0x00A0, 0, 20, 21))


def szl_jobs(rng: Random, room: int, sequence: int) -> list[Job]:
    """Return the reading of a system status list: one job for each part of at most ``room`` octets; some are refused."""
    szl, index, size, count = rng.choice(_LISTS)
    wanted = szl.to_bytes(2, "big") + index.to_bytes(2, "big")
    first = userdata_request(4, 1, wanted)
    if rng.random() < 0.1:
        job = Job(USERDATA, *first, *userdata_answer(4, 1, sequence, b"", error=0xD402))
        job.failed = True
        return [job]
    payload = wanted + size.to_bytes(2, "big") + count.to_bytes(2, "big") + rng.randbytes(size * count)
    parts = [payload[at : at + room] for at in range(0, len(payload), room)]
    unit = 213 if len(parts) > 1 else 0
    jobs: list[Job] = []
    for number, part in enumerate(parts):
        asked = userdata_request(4, 1, b"", sequence) if number else first
        more = number + 1 < len(parts)
        jobs.append(Job(USERDATA, *asked, *userdata_answer(4, 1, sequence, part, unit=unit, more=more)))
    return jobs


def clock_job(sequence: int) -> Job:
    """Return the reading of the clock."""
    clock = bytes.fromhex("00202311142215306213")
    return Job(USERDATA, *userdata_request(7, 1, b""), *userdata_answer(7, 1, sequence, clock))


def upload_jobs(rng: Random, room: int) -> list[Job]:
    """Return the upload of a data block: start, pieces of at most ``room`` octets, end."""
    name = f"_0A{rng.randrange(1, 400):05d}A".encode()
    block = rng.randbytes(rng.randint(40, 900))
    number = rng.randint(1, 200).to_bytes(4, "big")
    ask = b"\x00\x00\x00" + number
    start_answer = b"\x1d\x00\x01\x00" + number + b"\x07" + f"{len(block):07d}".encode()
    jobs = [Job(JOB, b"\x1d" + bytes(7) + b"\x09" + name, b"", start_answer, b"")]
    for at in range(0, len(block), room):
        piece = block[at : at + room]
        status = bytes((0x1E, int(at + room < len(block))))
        jobs.append(Job(JOB, b"\x1e" + ask, b"", status, len(piece).to_bytes(2, "big") + b"\x00\xfb" + piece))
    jobs.append(Job(JOB, b"\x1f" + ask, b"", b"\x1f", b""))
    return jobs


def service_job() -> Job:
    """Return the program invocation that compresses the memory."""
    return Job(JOB, b"\x28" + bytes(6) + b"\xfd\x00\x00\x05_GARB", b"", b"\x28", b"")
