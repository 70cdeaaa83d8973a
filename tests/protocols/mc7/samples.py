"""Blocks of our own, as texts for the assembler."""

from __future__ import annotations

from typing import Final

from dissect.protocols.mc7.block import Block, parse_block
from dissect.protocols.mc7.source import assemble_block

#: Milliseconds of the day, then days since 1984-01-01.
TIME_1: Final = "02932e003c0f"
TIME_2: Final = "0296bd403c10"

_OB1: Final = """\
[header]
unknown_mark = 1
linked = 1
language = 1
block_kind = 8
block_number = 1
code_time = {time}
interface_time = 02932e003c0f
local_length = 30

[interface]
kind = 1
TEMP BYTE
TEMP BYTE
TEMP BYTE
TEMP BYTE
TEMP BYTE
TEMP BYTE
TEMP INT
TEMP INT
TEMP INT
TEMP DATE_AND_TIME

[code]
NETWORK 1
       A     I 0.0
       AN    T 4
       L     S5T#2S
       SD    T 5
NETWORK 2
       A     I 0.1
       L     S5T#{preset}
       SD    T 4
       A     T 4
       =     Q 4.0
NETWORK 3
       L     MW 20
       L     100
       >=I
       JCN   M3_1
       T     MW 22
       JU    M3_2
M3_1:  L     0
       T     MW 22
M3_2:  NOP   0
NETWORK 4
       BLD   1
       =     L 20.0
       L     MW 30
       T     LW 22
       UC    FC 5 (P#V 22.0, P#M 40.0)
       BLD   2
       BLD   3
       =     L 20.0
       CDB
       OPN   DI 7
       TAR2  LD 24
       L     MW 50
       T     DIW 0
       LAR2  P#DBX 0.0
       UC    FB 7
       LAR2  LD 24
       L     DIW 2
       T     MW 52
       CDB
       BLD   4
NETWORK 5
       OPN   DB 10
       L     DBW 2
       T     QW 6
       A     DBX 4.0
       S     Q 5.1
       BE

[tables]
present = 1

[footer]
author = "plant"
family = "demo"
name = "cycle"
version = 10
checksum = {checksum}
"""

_FC5: Final = """\
[header]
unknown_mark = 1
linked = 1
language = 1
block_kind = 12
block_number = 5
code_time = 02932e003c0f
interface_time = 02932e003c0f
local_length = 4

[interface]
kind = 1
number = 5
IN INT
OUT BOOL
TEMP INT

[code]
NETWORK 1
       L     #IN0
       T     LW 0
       L     10
       >I
       =     #OUT0
       BE

[tables]
present = 1

[footer]
name = "limit"
version = 10
"""

_FB7: Final = """\
[header]
unknown_mark = 1
linked = 1
language = 1
block_kind = 14
block_number = 7
local_length = 0

[interface]
kind = 1
number = 7
IN INT
OUT INT
STAT+08 REAL
STAT STRUCT
  STAT BOOL
  STAT ARRAY [1..4] OF
    STAT INT
start_values = 0000803f

[code]
NETWORK 1
       L     DIW 0
       L     2
       *I
       T     DIW 2
       BE

[tables]
present = 1

[footer]
name = "double"
version = 10
"""


def ob1(preset: str = "35S", time: str = TIME_1, checksum: int = 4660) -> bytes:
    """Return our OB 1; ``preset`` is the time of its timer T 4."""
    return assemble_block(_OB1.format(preset=preset, time=time, checksum=checksum))


def fc5() -> bytes:
    """Return the FC that OB 1 calls."""
    return assemble_block(_FC5)


def fb7() -> bytes:
    """Return the FB that OB 1 calls."""
    return assemble_block(_FB7)


def program() -> list[Block]:
    """Return all of them, parsed."""
    return [parse_block(octets) for octets in (ob1(), fc5(), fb7())]


#: The text of OB 1 with its placeholders filled in.
OB1_SOURCE: Final = _OB1.format(preset="35S", time=TIME_1, checksum=4660)
FC5_SOURCE: Final = _FC5
