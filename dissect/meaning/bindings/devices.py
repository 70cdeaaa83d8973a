"""Facts about each device: its constants, and mappings that were rewritten during the capture (R104-R106)."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING, Final

from dissect.meaning.bindings.pushes import LatestEnd
from dissect.scd.codec import Codec
from dissect.scd.ranges import STRUCTURE_SUB, is_mapping

if TYPE_CHECKING:
    from dissect.engine.transactions.side import Side
    from dissect.meaning.bindings.binding import Binding
    from dissect.packets.tcp.stream import Endpoint
    from dissect.scd.dictionary import Dictionary
    from dissect.scd.layout import Key
    from dissect.scd.model import Pdo
    from dissect.scd.types import Value

#: Maximum number of devices that are remembered; beyond that, the one with the oldest last message is forgotten.
MAX_DEVICES: Final = 4096
#: Maximum number of constants that are remembered of one device.
MAX_CONSTANTS: Final = 1024
_ABSENT: Final = object()


class ScdDevice:
    """One device: the codec with its current mappings, and the latest values of its constants.

    ``overlooked`` counts values of constants beyond the limit.
    """

    def __init__(self, dictionary: Dictionary, codec: Codec) -> None:
        self.codec = codec
        self.overlooked = 0
        self.constants: dict[Key, Value] = {}
        self._dictionary = dictionary
        self._own_codec = False
        self._mappings: dict[int, dict[int, int]] = {}

    def constant(self, key: Key, value: Value) -> Value | None:
        """Note the value of a constant; return the earlier value if it was different, else None."""
        old = self.constants.get(key, _ABSENT)
        if old is _ABSENT and len(self.constants) >= MAX_CONSTANTS:
            self.overlooked += 1
            return None
        self.constants[key] = value
        if old is _ABSENT or old == value or (old != old and value != value):  # noqa: PLR0124 - NaN
            return None
        return old  # type: ignore[return-value]

    def write_mapping(self, index: int, sub: int, value: int) -> Pdo | None:
        """Note that an element of a mapping object was written; return the current PDO, None while it is switched off.

        Raises `Error` for entries that no PDO can have; the mapping then stays as it was.
        """
        obj = self._dictionary.objects[index]
        written = self._mappings.setdefault(index, {})
        written[sub] = value
        used = written.get(0, _default(obj[0].default))
        fields = obj.fields[:used]
        entries = [written.get(number, _default(field.default)) for number, field in enumerate(fields, 1)]
        pdo = self._dictionary.with_mapping(index, entries)
        if not self._own_codec:
            self.codec = Codec(self._dictionary)
            self._own_codec = True
        self.codec.remap(pdo)
        return pdo if used else None


class ScdDevices:
    """Devices by address and port. ``forgotten`` counts dropped devices, `overlooked` values of constants beyond the limit."""

    def __init__(self, dictionary: Dictionary) -> None:
        self.dictionary = dictionary
        self.codec = Codec(dictionary)
        self.forgotten = 0
        self._overlooked = 0
        self._known: OrderedDict[tuple[bytes, int], ScdDevice] = OrderedDict()
        self.latest = LatestEnd()
        self._latest: ScdDevice | None = None  # the device of the latest end
        _ = self.codec.envelope  # so that an unusable envelope raises before the first packet

    @property
    def overlooked(self) -> int:
        """Values of constants that were not compared, because the device has too many constants."""
        return self._overlooked + sum([device.overlooked for device in self._known.values()])

    def restart(self) -> None:
        """Another capture begins: forget all devices. They do not count as ``forgotten``."""
        self._overlooked = self.overlooked
        self._known.clear()
        self.look_again()

    def look_again(self) -> None:
        """The device that was found last may have other mappings now."""
        self.latest.end = None

    def of(self, side: Side, binding: Binding) -> ScdDevice:
        """Return the device of a conversation: the end that owns the dictionary."""
        connection = side.connection
        return self.at(connection.client if binding.device == "peer" else connection.server)

    def at(self, end: Endpoint) -> ScdDevice:
        """Return the device with an address and port."""
        if self._latest is not None and self.latest.end is end:
            return self._latest
        key = (end.address, end.port)
        found = self._known.get(key)
        if found is None:
            found = ScdDevice(self.dictionary, self.codec)
            self._known[key] = found
            if len(self._known) > MAX_DEVICES:
                _, gone = self._known.popitem(last=False)
                self.forgotten += 1
                self._overlooked += gone.overlooked
        else:
            self._known.move_to_end(key)
        self._latest = found
        self.latest.end = end
        self.latest.usual = found.codec is self.codec
        return found


def is_rewritten(dictionary: Dictionary, key: Key) -> bool:
    """Return whether a value is sub-index 0 or an element of a mapping object of the dictionary."""
    return isinstance(key, tuple) and is_mapping(key[0]) and key[0] in dictionary.objects and key[1] != STRUCTURE_SUB


def _default(value: object) -> int:
    return value if isinstance(value, int) else 0
