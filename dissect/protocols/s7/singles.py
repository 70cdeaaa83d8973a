"""Singles (IEEE 754, REAL) as text: the shortest decimal that reads back to the same four octets.

Compiled code makes the digits with native double arithmetic. A single has 24 bits, so scaling it by a power of ten has a
relative error below 2**-51. If this error could matter for the choice between two texts, the exact way of `real_text` is used
instead.
"""

from __future__ import annotations

import math
import struct
from typing import Final

from librt.strings import BytesWriter, read_f64_le, read_i64_le
from mypy_extensions import i64

from dissect.wire.build import COMPILED
from dissect.wire.digits import MINUS, write_decimal, write_digits
from dissect.wire.octets import u32

_FLOAT: Final = struct.Struct(">f")
#: Half the distance between neighbouring singles, by exponent field (the smallest two fields have the same).
_HALF_STEP: Final[list[float]] = [2.0 ** (max(exponent, 1) - 127 - 24) for exponent in range(256)]
#: Digits to begin with, by exponent field. Seven digits are enough for the numbers that people write. Fewer are needed for
#: subnormal numbers, and where the steps are wider than the seventh digit (just above a power of two that begins with nine:
#: 2**-10 = 0.000976…).
_FIRST_DIGITS: Final = bytes(
    [
        1 if exponent == 0 else 6 if 2 * step > 10.0 ** (math.floor(math.log10(2.0 ** (exponent - 127))) - 6) else 7
        for exponent, step in enumerate(_HALF_STEP)
    ]
)
#: The decimal exponent of the power of two with this exponent field, plus `_BIAS`. The exponent of the number itself may be one
#: higher.
_DECADE: Final = bytes([math.floor(math.log10(2.0 ** (exponent - 127))) + 64 for exponent in range(255)])
_BIAS: Final = 64


def _doubles(numbers: list[float]) -> bytes:
    """Return numbers packed so that compiled code reads them without creating objects."""
    return struct.pack(f"<{len(numbers)}d", *numbers)


#: `_HALF_STEP`; the value of the last of the 24 bits, by exponent field; powers of ten.
_HALF_STEPS: Final = _doubles(_HALF_STEP)
_LAST_BITS: Final = _doubles([2.0 ** (max(exponent, 1) - 127 - 23) for exponent in range(255)])
_TENS: Final = _doubles([10.0**power for power in range(64)])
_WHOLE_TENS: Final = struct.pack("<18q", *[10**power for power in range(18)])
#: The packed result of `_shortest`: in the lowest bits the exponent plus `_BIAS`; then the count of digits; the power of ten of
#: the last digit, plus `_BIAS`; and the digits.
_EXPONENT_BITS: Final = 8
_COUNT_BITS: Final = 4
_POWER_AT: Final = _EXPONENT_BITS + _COUNT_BITS
_DIGITS_AT: Final = _POWER_AT + 8
_UNDECIDED: Final = -1
#: Multiplying by this and shifting divides a number below 2**31 by ten.
_BY_10: Final = 0xCCCCCCCD
_BY_10_BITS: Final = 35
#: The greatest power of ten that a double represents exactly.
_EXACT_POWER: Final = 22

#: `repr` of a float writes an exponent from the first exponent on (1e+16), and below the second one (1e-05).
_REPR_EXPONENT: Final = 16
_LEAST_EXPONENT: Final = -4
#: Forms of numbers: as %g; as %g, but with ``.0`` for whole numbers (JSON); as `repr` of a float.
_GENERAL: Final = 0
_JSON: Final = 1
_REPR: Final = 2
_POINT: Final = 0x2E
#: Within these limits `real_text` begins with seven digits and writes no exponent, and no number of seven or eight digits is
#: exactly between two singles: so the first digits that read back are the result.
_PLAIN_LEAST: Final = 0.002
_PLAIN_END: Final = 1e6


def real(octets: bytes) -> float:
    """Return a single as the shortest decimal that reads back to the same four octets."""
    if COMPILED:
        word: i64 = u32(octets, 0)
        found = _shortest(word)
        power = _power(found)
        if found != _UNDECIDED and -_EXACT_POWER <= power <= _EXACT_POWER:
            return _double(word, found, power)
    return float(real_text(octets))


def real_text(octets: bytes) -> str:
    """Return a single as the text of `real`, for example ``123.456``, ``1e+20``, ``inf`` or ``nan``.

    A decimal that is less than half a single-precision step from the exact value reads back to it, with any rounding of ties.
    %g drops trailing zeros. Nine digits always read back.
    """
    if COMPILED:
        word: i64 = u32(octets, 0)
        found = _shortest(word)
        if found != _UNDECIDED:
            return _written(word, found, _GENERAL)
    exact: float = _FLOAT.unpack(octets)[0]
    exponent: i64 = ((octets[0] & 0x7F) << 1) | (octets[1] >> 7)
    if exponent == 255:
        return repr(exact)
    half_step: float = _HALF_STEP[exponent]
    if exponent > 1 and octets[1] & 0x7F == 0 and octets[2] == 0 and octets[3] == 0:
        half_step *= 0.5  # just below a power of two the steps are half as wide
    digits: i64 = _FIRST_DIGITS[exponent]
    while digits < 7:
        text = f"{exact:.{digits}g}"
        if abs(float(text) - exact) < half_step:
            return text
        digits += 1
    text = f"{exact:.7g}"
    if abs(float(text) - exact) < half_step:
        return text
    text = f"{exact:.8g}"
    if abs(float(text) - exact) < half_step:
        return text
    return f"{exact:.9g}"


def real_json(octets: bytes, at: i64 = 0) -> str:
    """Return `real_text` of the octets at ``at`` as JSON.

    Whole numbers get ``.0``; NaN and infinities, which do not exist in JSON, are strings.
    """
    if COMPILED:
        word: i64 = u32(octets, at)
        found = _shortest(word)
        if found != _UNDECIDED:
            return _written(word, found, _JSON)
    exact: float = _FLOAT.unpack_from(octets, at)[0]
    if _PLAIN_LEAST <= exact < _PLAIN_END or _PLAIN_LEAST <= -exact < _PLAIN_END:
        text = f"{exact:.7g}"
        if _FLOAT.unpack(_FLOAT.pack(float(text)))[0] != exact:
            text = f"{exact:.8g}"
            if _FLOAT.unpack(_FLOAT.pack(float(text)))[0] != exact:
                text = f"{exact:.9g}"
        return text if "." in text else text + ".0"
    text = real_text(octets[at : at + 4])
    if "." in text or "e" in text:
        return text
    return f'"{text}"' if "n" in text else text + ".0"


def write_real_json(out: BytesWriter, octets: bytes, at: i64) -> None:
    """Write `real_json` of the octets at ``at``."""
    word: i64 = u32(octets, at)
    found = _shortest(word)
    if found != _UNDECIDED:
        _write(out, word, found, _JSON)
    elif word == 0:
        out.write(b"0.0")
    else:
        out.write(real_json(octets, at).encode("ascii"))


def write_real_repr(out: BytesWriter, octets: bytes, at: i64) -> None:
    """Write `real_repr` of the octets at ``at``."""
    word: i64 = u32(octets, at)
    found: i64 = _UNDECIDED
    if word & 0x7FFFFFFF:
        found = _shortest(word)
    if found != _UNDECIDED:
        _write(out, word, found, _REPR)
    else:
        out.write(real_repr(octets[at : at + 4]).encode("ascii"))


def real_repr(octets: bytes) -> str:
    """Return ``repr(real(octets))``."""
    if COMPILED:
        word: i64 = u32(octets, 0)
        if word & 0x7FFFFFFF == 0:
            return "-0.0" if word else "0.0"
        found = _shortest(word)
        if found != _UNDECIDED:
            return _written(word, found, _REPR)
    text = real_text(octets)
    return text if "." in text and "e" not in text else repr(float(text))


def _shortest(word: i64) -> i64:
    """Return the digits and the exponent of the shortest decimal of a single, packed; `_UNDECIDED` if doubles cannot decide."""
    exponent: i64 = (word >> 23) & 0xFF
    if exponent == 0 or exponent == 255:
        return _UNDECIDED
    mantissa: i64 = (word & 0x7FFFFF) | 0x800000
    size: float = float(mantissa) * read_f64_le(_LAST_BITS, 8 * exponent)
    half_step: float = read_f64_le(_HALF_STEPS, 8 * exponent)
    if mantissa == 0x800000 and exponent > 1:
        half_step *= 0.5
    decade: i64 = _DECADE[exponent] - _BIAS
    if decade >= -1:
        if size >= read_f64_le(_TENS, 8 * (decade + 1)):
            decade += 1
    elif size * read_f64_le(_TENS, -8 * (decade + 1)) >= 1.0:
        decade += 1
    digits: i64 = _FIRST_DIGITS[exponent]
    number: i64 = 0
    power: i64 = 0
    ten: float = 0.0
    scaled: float = 0.0
    step: float = 0.0  # half a step of singles, scaled like `scaled`
    away: float = 0.0
    while True:
        power = digits - 1 - decade
        if power >= 0:
            ten = read_f64_le(_TENS, 8 * power)
            scaled = size * ten
            step = half_step * ten
        else:
            ten = read_f64_le(_TENS, -8 * power)
            scaled = size / ten
            step = half_step / ten
        number = int(scaled)
        away = scaled - float(number)
        if away > 0.50001:
            number += 1
            away = 1.0 - away
        elif away > 0.49999:
            return _UNDECIDED
        if digits == 9 or away < 0.99999 * step:
            break
        if away < 1.00001 * step:
            return _UNDECIDED
        digits += 1
    if number >= read_i64_le(_WHOLE_TENS, 8 * digits):
        decade += 1  # rounding reached the next power of ten
    while True:
        tenth: i64 = number * _BY_10 >> _BY_10_BITS
        if tenth * 10 != number:
            break
        number = tenth
        power -= 1
    return (number << _DIGITS_AT) | ((_BIAS - power) << _POWER_AT) | (digits << _EXPONENT_BITS) | (decade + _BIAS)


def _ten(power: i64) -> float:
    """Return a power of ten, 0 to 63."""
    return read_f64_le(_TENS, 8 * power)


def _power(found: i64) -> i64:
    """Return the power of ten of the last digit in a result of `_shortest`."""
    return ((found >> _POWER_AT) & 0xFF) - _BIAS


def _double(word: i64, found: i64, power: i64) -> float:
    """Return a result of `_shortest` as a double: a product or quotient of two exact doubles is the nearest to the decimal."""
    number: float = float(found >> _DIGITS_AT)
    number = number * _ten(power) if power >= 0 else number / _ten(-power)
    return -number if word >> 31 else number


def _written(word: i64, found: i64, form: i64) -> str:
    """Return what `_write` writes."""
    out = BytesWriter()
    _write(out, word, found, form)
    return out.getvalue().decode("ascii")


def _write(out: BytesWriter, word: i64, found: i64, form: i64) -> None:
    """Write a result of `_shortest` in one of the forms above."""
    exponent: i64 = (found & 0xFF) - _BIAS
    number: i64 = found >> _DIGITS_AT
    power: i64 = _power(found)
    if word >> 31:
        out.append(MINUS)
    tens: i64
    most: i64 = _REPR_EXPONENT
    if form != _REPR:
        most = (found >> _EXPONENT_BITS) & 0x0F
    if exponent < _LEAST_EXPONENT or exponent >= most:
        behind: i64 = exponent - power
        tens = _whole_ten(behind)
        write_decimal(out, number // tens)
        if behind:
            out.append(_POINT)
            write_digits(out, number % tens, behind)
        out.write(b"e-" if exponent < 0 else b"e+")
        write_digits(out, exponent if exponent >= 0 else -exponent, 2)
    elif exponent < 0:
        out.write(b"0.")
        write_digits(out, number, -power)
    elif power < 0:  # most numbers: digits on both sides of the point
        tens = _whole_ten(-power)
        whole: i64 = number // tens
        write_decimal(out, whole)
        out.append(_POINT)
        write_digits(out, number - whole * tens, -power)
    else:
        write_decimal(out, number * _whole_ten(power))
        if form != _GENERAL:
            out.write(b".0")


def _whole_ten(power: i64) -> i64:
    """Return a power of ten, 0 to 17."""
    return read_i64_le(_WHOLE_TENS, 8 * power)
