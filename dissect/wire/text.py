"""How all outputs write text from outside, numbers, times and durations.

Text from outside is made safe to show: nothing in the data of a device or in a file name may control a terminal or a
spreadsheet, or mislead the reader. Durations have the same units everywhere. Times are nanoseconds since 1970 and written with
integer arithmetic, so without rounding, and for any year. Only the offset of a local time comes from the system's time zones.
"""

from __future__ import annotations

import os
import re
import time
import unicodedata
from json.encoder import encode_basestring_ascii
from typing import Final

from mypy_extensions import i64

from dissect.wire.build import COMPILED

#: The function of the standard library, as a constant that is found without a lookup.
_ENCODE: Final = encode_basestring_ascii
#: Unicode categories that are escaped: control, format (bidi overrides, zero widths), surrogate, private, unassigned, line and
#: paragraph separators.
_HIDDEN: Final = frozenset(("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"))
#: The range of surrogates and of the private characters that follow them; all are escaped, so no category is looked up.
_SURROGATES: Final = 0xD800
_PRIVATE_END: Final = 0xF900

#: Characters that begin a formula in a spreadsheet; in some the full-width forms do as well.
_FORMULA: Final = "=+-@\uff1d\uff0b\uff0d\uff20"
# These patterns are strings, which `re` compiles and keeps at their first use, because most runs use none.
#: The same after a semicolon, which separates cells in countries with a decimal comma.
_LATER_FORMULA: Final = "(;\\s*)(?=[=+\\-@\uff1d\uff0b\uff0d\uff20])"
_DEFUSED: Final = "(;\\s*)'(?=[=+\\-@\uff1d\uff0b\uff0d\uff20])"
_NUMBER: Final = r"[+-]?[0-9]+(\.[0-9]+)?([eE][+-]?[0-9]+)?"

#: Numbers as text, without leading zeros, with two and with three digits. Looking them up is several times as fast as `str`,
#: and bulk outputs mostly write digits.
SHORT: Final[list[str]] = [str(number) for number in range(1000)]
TWO: Final[list[str]] = [f"{number:02d}" for number in range(100)]
THREE: Final[list[str]] = [f"{number:03d}" for number in range(1000)]
#: The same with a point after the number.
POINT: Final[list[str]] = [f"{number}." for number in range(1000)]
#: The longest text that `JsonTexts` keeps, in characters, and how many texts it keeps.
_LONGEST: Final = 200
_MAX_TEXTS: Final = 4096
#: Bytes as two hexadecimal digits.
HEX: Final[list[str]] = [f"{number:02x}" for number in range(256)]


def decimal(number: i64) -> str:
    """Return ``str(number)``."""
    if not COMPILED or number < 0 or number >= 1_000_000_000:
        return str(number)
    if number < 1000:
        return SHORT[number]
    if number < 1_000_000:
        return SHORT[number // 1000] + THREE[number % 1000]
    return f"{SHORT[number // 1_000_000]}{THREE[number // 1000 % 1000]}{THREE[number % 1000]}"


def hexadecimal(octets: bytes) -> str:
    """Return ``octets.hex()``."""
    if COMPILED:
        size: i64 = len(octets)
        if size == 1:
            return HEX[octets[0]]
        if size == 2:
            return HEX[octets[0]] + HEX[octets[1]]
        if size == 4:
            return f"{HEX[octets[0]]}{HEX[octets[1]]}{HEX[octets[2]]}{HEX[octets[3]]}"
    return octets.hex()


def hex_number(number: i64, digits: i64) -> str:
    """Return a number that is not negative in hexadecimal, with ``0x`` and at least ``digits`` digits."""
    if digits == 1 and number < 16:
        return f"0x{HEX[number][1:]}"
    if digits == 2 and number < 0x100:
        return f"0x{HEX[number]}"
    if digits == 4 and number < 0x10000:
        return f"0x{HEX[number // 256]}{HEX[number % 256]}"
    if digits == 8 and number < 0x1_0000_0000:
        return f"0x{HEX[number >> 24]}{HEX[(number >> 16) & 0xFF]}{HEX[(number >> 8) & 0xFF]}{HEX[number & 0xFF]}"
    return f"0x{f'{number:x}'.rjust(digits, '0')}"


def printable(text: str) -> str:
    r"""Return ``text`` on one line, with everything escaped that is not printable (``\x1b``, ``\u202e`` …)."""
    if text.isprintable():  # True if no character is of a category in `_HIDDEN`
        return text
    parts: list[str] = []
    for character in text:
        code: i64 = ord(character)
        parts.append(_LATIN[code] if code < 0x100 else _escape(character))
    return "".join(parts)


def _escape(character: str) -> str:
    code: i64 = ord(character)
    if not _SURROGATES <= code < _PRIVATE_END and unicodedata.category(character) not in _HIDDEN:
        return character
    if 0xDC80 <= code <= 0xDCFF:
        code -= 0xDC00  # an octet that is not UTF-8, as Python keeps it in file names (surrogateescape)
    if code < 0x100:
        return f"\\x{HEX[code]}"
    return f"\\u{HEX[code >> 8]}{HEX[code & 0xFF]}" if code < 0x10000 else f"\\U{code:08x}"


#: `_escape` of the first 256 characters: unprintable texts from the wire are mostly padding and octets.
_LATIN: Final[list[str]] = [_escape(chr(code)) for code in range(256)]


def json_text(value: str) -> str:
    """Return a JSON string in ASCII; DEL, which the standard library leaves, is escaped like other control characters."""
    text = _ENCODE(value)
    return text.replace("\x7f", "\\u007f") if "\x7f" in text else text


class JsonTexts:
    """Makes JSON strings (`json_text`) of texts, and keeps all but long ones, so that repeated texts are escaped once."""

    __slots__ = ("_known",)

    def __init__(self) -> None:
        self._known: dict[str, str] = {}

    def of(self, text: str) -> str:
        """Return ``text`` as a JSON string."""
        found = self._known.get(text)
        if found is not None:
            return found
        found = json_text(text)
        if len(text) <= _LONGEST:
            if len(self._known) >= _MAX_TEXTS:
                self._known.clear()
            self._known[text] = found
        return found


def encodable(text: str) -> str:
    r"""Return ``text`` with only those characters escaped that UTF-8 cannot hold: a file name's octet 0xFF becomes ``\xff``."""
    if text.isascii():
        return text
    return "".join([_escape(character) if 0xD800 <= ord(character) <= 0xDFFF else character for character in text])


def reason(error: BaseException) -> str:
    """Return why something failed, on one line for people; an error of the system is given with its file."""
    if isinstance(error, OSError) and error.strerror:
        about = f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, (str, bytes)) else ""
        return printable(f"{about}{error.strerror}")
    return printable(str(error) or type(error).__name__)


def titled(name: str, about: str) -> str:
    """Return ``name about``; a word that ends ``name`` and begins ``about`` is written once: ``read SZL 0x0011 …``."""
    last = name.rpartition(" ")[2]
    if last and about.startswith(f"{last} "):
        about = about.removeprefix(last).lstrip()
    return f"{name} {about}" if name and about else name or about


def count(number: int, one: str, many: str = "") -> str:
    """Return a number with its noun: ``1 packet``, ``31 packets``."""
    return f"{number} {one if number == 1 else many or one + 's'}"


def some(texts: list[str], most: int, joint: str = ", ") -> str:
    """Return the first ``most`` texts, all for 0, with ``joint`` between them, and how many more there are."""
    if not most or len(texts) <= most:
        return joint.join(texts)
    return f"{joint.join(texts[:most])} and {len(texts) - most} more"


def cut_inside(text: str, most: int) -> str:
    """Return `printable` text; if it is longer than ``most`` characters, cut its middle and keep the end with the reason."""
    if len(text) <= most:
        return printable(text)
    tail: int = most // 3
    return f"{printable(text[: most - tail])} … {printable(text[len(text) - tail :])}"


def shortened(text: str, most: int) -> str:
    """Return `printable` text, cut after ``most`` characters with a note of how many there are."""
    if len(text) <= most:
        return printable(text)
    return f"{printable(text[:most])}… ({len(text)} characters)"


def cell(text: str) -> str:
    """Return ``text`` as a spreadsheet cell that is never a formula; numbers stay numbers."""
    safe = printable(text)
    begun = safe.lstrip()  # some spreadsheets ignore leading blanks
    if begun and begun[0] in _FORMULA and not re.fullmatch(_NUMBER, begun):
        safe = "'" + safe
    return re.sub(_LATER_FORMULA, r"\1'", safe) if ";" in safe else safe


def uncell(text: str) -> str:
    """Return the text from which `cell` made a cell, except for escapes."""
    if text[:1] == "'" and text[1:].lstrip()[:1] in tuple(_FORMULA):
        text = text[1:]
    return re.sub(_DEFUSED, r"\1", text) if ";" in text else text


_NS_PER_S: Final = 1_000_000_000
#: What `short_duration` adds to hundredths of a millisecond, and the range of durations that it is for, in nanoseconds.
HUNDREDTHS: Final = 1000
_SHORT_LEAST: Final = 10_000
_SHORT_END: Final = 99_995_000


def duration_text(ns: int) -> str:
    """Return nanoseconds in the unit that suits them, for example ``412 µs``, ``3.21 ms``, ``1.54 s``, ``2 h 5 min 0 s``."""
    short: i64 = short_duration(ns) if _SHORT_LEAST <= ns < _SHORT_END else 0
    if short >= HUNDREDTHS:
        short -= HUNDREDTHS
        return f"{SHORT[short // 100]}.{TWO[short % 100]} ms"
    if short:
        return f"{SHORT[short]} µs"
    size = abs(ns)
    if 0 < size < 10_000:
        return f"{ns / 1e3:.1f} µs"
    if size < 999_500:
        return f"{ns / 1e3:.0f} µs"
    if size < 99_995_000:
        return f"{ns / 1e6:.2f} ms"
    if size < 999_500_000:
        return f"{ns / 1e6:.0f} ms"
    if size < 600 * _NS_PER_S:
        return f"{ns / 1e9:.2f} s"
    minutes, seconds = divmod(size // _NS_PER_S, 60)
    hours, minutes = divmod(minutes, 60)
    days, hours = divmod(hours, 24)
    units = [(days, "d"), (hours, "h"), (minutes, "min"), (seconds, "s")]
    first = next(index for index, (number, _) in enumerate(units) if number)
    sign = "-" if ns < 0 else ""
    return sign + " ".join([f"{number} {unit}" for number, unit in units[first:]])


def short_duration(ns: i64) -> i64:
    """Return the digits of a duration from 10 µs to 99.99 ms, as most answer times are.

    A number below `HUNDREDTHS` is microseconds. Any other is `HUNDREDTHS` plus hundredths of a millisecond. 0 for other
    durations, and where rounding would have to decide a tie.
    """
    if ns < _SHORT_LEAST or ns >= _SHORT_END:
        return 0
    if ns < 999_500:
        return (ns + 500) // 1000 if ns % 1000 != 500 else 0
    return HUNDREDTHS + (ns + 5000) // 10_000 if ns % 10_000 != 5000 else 0


def over_limit(ns: int, limit_ns: int) -> str:
    """Return how long something took, and its limit; if both look the same, return by how much the limit was exceeded."""
    took, limit = duration_text(ns), duration_text(limit_ns)
    return (
        f"{took}, the limit is {limit}"
        if took != limit
        else f"{duration_text(ns - limit_ns)} over the limit of {limit}"
    )


def distance_text(ns: int) -> str:
    """Return how much earlier something was, for example ``965 µs earlier``; if it came after, ``1.20 s later``."""
    return f"{duration_text(ns)} earlier" if ns >= 0 else f"{duration_text(-ns)} later"


_S_PER_DAY: Final = 86400


def civil(days: int) -> tuple[int, int, int]:
    """Return (year, month, day) of the day that is ``days`` after 1970-01-01; Gregorian calendar, any year."""
    shifted = days + 719468
    era, of_era = divmod(shifted, 146097)
    year_of_era = (of_era - of_era // 1460 + of_era // 36524 - of_era // 146096) // 365
    day_of_year = of_era - (365 * year_of_era + year_of_era // 4 - year_of_era // 100)
    shifted_month = (5 * day_of_year + 2) // 153
    day = day_of_year - (153 * shifted_month + 2) // 5 + 1
    month = shifted_month + 3 if shifted_month < 10 else shifted_month - 9
    return year_of_era + era * 400 + (1 if month <= 2 else 0), month, day


class Clock:
    """Writes times; keeps the text of the last second, because many packets come in each second.

    With ``local``, `moment` uses the time zone of this machine (``TZ``), else UTC; `iso` always uses UTC.
    """

    __slots__ = ("_local_second", "_local_text", "_moment", "_second", "_text", "_zone", "local")

    def __init__(self, local: bool = False) -> None:
        self.local: bool = local
        self._local_second: i64 = 0
        self._local_text: str = ""
        self._zone: str = "UTC"
        self._second: i64 = 0
        self._text: str = "1970-01-01T00:00:00."
        self._moment: str = ""  # the same as `moment` writes it, made on demand

    def iso(self, time_ns: i64) -> str:
        """Return ISO 8601 in UTC with nanoseconds, for example ``2016-02-08T14:51:37.916123000Z``."""
        begin = self.iso_second(time_ns)
        rest: i64 = time_ns % _NS_PER_S
        return f"{begin}{THREE[rest // 1_000_000]}{THREE[rest // 1000 % 1000]}{THREE[rest % 1000]}Z"

    def iso_second(self, time_ns: i64) -> str:
        """Return `iso` up to the point before the nanoseconds, for callers that write the rest themselves."""
        second: i64 = time_ns // _NS_PER_S
        if second != self._second:
            self._turn(second)
        return self._text

    def _turn(self, second: i64) -> None:
        """Make the text of another second."""
        day: i64 = second // _S_PER_DAY
        rest: i64 = second % _S_PER_DAY
        year, month, of_month = civil(day)
        of_day = f"{TWO[rest // 3600]}:{TWO[rest // 60 % 60]}:{TWO[rest % 60]}."
        self._text = f"{str(year).zfill(4)}-{TWO[month]}-{TWO[of_month]}T{of_day}"
        self._moment = ""
        self._second = second

    def moment(self, time_ns: i64) -> str:
        """Return a time for people, with its zone: ``2016-02-08 14:51:37.916123 UTC``, local ``… +01:00``."""
        if not self.local:
            second: i64 = time_ns // _NS_PER_S
            if second != self._second:
                self._turn(second)
            if not self._moment:
                self._moment = self._text.replace("T", " ")
            rest: i64 = time_ns % _NS_PER_S
            return f"{self._moment}{THREE[rest // 1_000_000]}{THREE[rest // 1000 % 1000]} UTC"
        self._localise(time_ns)
        digits = str(_NS_PER_S + time_ns % _NS_PER_S)
        return f"{self._local_text}.{digits[1:7]} {self._zone}"

    def time_of_day(self, time_ns: i64) -> str:
        """Return the time of day to the microsecond, without its zone (see `zone`): ``14:51:37.916123``."""
        return self.moment(time_ns).split(" ")[1]

    def zone(self, time_ns: i64) -> str:
        """Return the zone that `moment` writes for this time: ``UTC``, or an offset such as ``+01:00``."""
        if self.local:
            self._localise(time_ns)
        return self._zone

    def _localise(self, time_ns: i64) -> None:
        second: i64 = time_ns // _NS_PER_S
        if second == self._local_second and self._local_text:
            return
        there = time.localtime(second)
        self._local_text = (
            f"{there.tm_year:04d}-{there.tm_mon:02d}-{there.tm_mday:02d}"
            f" {there.tm_hour:02d}:{there.tm_min:02d}:{there.tm_sec:02d}"
        )
        hours, minutes = divmod(abs(there.tm_gmtoff) // 60, 60)
        self._zone = f"{'-' if there.tm_gmtoff < 0 else '+'}{hours:02d}:{minutes:02d}"
        self._local_second = second
