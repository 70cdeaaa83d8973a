"""EDS and DCF files: what becomes of each thing in them, and what broken ones say."""

from __future__ import annotations

import gc
import sys
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dissect import scd
from dissect.scd import eds
from dissect.scd.codec import Codec
from dissect.scd.dump import dump_toml
from dissect.scd.eds import import_eds
from dissect.scd.errors import DictionaryError
from dissect.scd.foreign import Imported
from dissect.scd.loading import MAX_DESCRIPTION, compile_source, import_file, load
from dissect.scd.model import CLASSES
from dissect.scd.source import parse_toml

#: A pump of CANopen: every type and class, both kinds of compact arrays, two PDOs with entries of UNSIGNED32 and a gap.
PUMP = """\
; a pump, written for these tests
[FileInfo]
FileName=pump.eds
FileVersion=1
FileRevision=2
[Comments]
Lines=9
Line1=only one
[DeviceInfo]
VendorName=nobody
ProductName=Насос
[DummyUsage]
Dummy0005=1
[MandatoryObjects]
SupportedObjects=2
1=0x1000
2=0x1018
[OptionalObjects]
SupportedObjects=1
1=0x1fff
[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=const
DefaultValue=0x000F0191
PDOMapping=0
[1003]
ParameterName=Errors
ObjectType=0x8
DataType=0x0007
AccessType=ro
CompactSubObj=3
[1003Name]
NrOfEntries=0
[1003Value]
2=0x77
[1014]
ParameterName=COB-ID EMCY
DataType=0x0007
AccessType=rw
DefaultValue=$NODEID+0x80
[1018sub1]
ParameterName=Vendor.ID
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=1
[1018]
ParameterName=Identity
ObjectType=0x9
SubNumber=3
[1018sub0]
ParameterName=Number of entries
DataType=0x0005
AccessType=ro
DefaultValue=4
[1018Sub4]
ParameterName=Serial
DataType=0x0007
AccessType=rww
[1800]
ParameterName=TPDO communication
ObjectType=0x9
[1800sub0]
ParameterName=Highest
DataType=0x0005
AccessType=const
DefaultValue=2
[1800sub1]
ParameterName=COB-ID
DataType=0x0007
AccessType=rw
DefaultValue=$NODEID+0x180
[1800sub2]
ParameterName=Transmission type
DataType=0x0005
AccessType=rw
DefaultValue=255
[1A00]
ParameterName=TPDO mapping
ObjectType=0x9
[1A00sub0]
ParameterName=Highest
DataType=0x0005
AccessType=rw
DefaultValue=3
[1A00sub1]
ParameterName=Entry 1
DataType=0x0007
AccessType=rw
DefaultValue=0x60410010
[1A00sub2]
ParameterName=Entry 2
DataType=0x0007
AccessType=rw
DefaultValue=0x00050008
[1A00sub3]
ParameterName=Entry 3
DataType=0x0007
AccessType=rw
DefaultValue=0x60000118
[1600]
ParameterName=RPDO mapping
ObjectType=0x8
[1600sub0]
ParameterName=Highest
DataType=0x0005
AccessType=rw
DefaultValue=1
[1600sub1]
ParameterName=Entry 1
DataType=0x0007
AccessType=rw
DefaultValue=0x70000008
[2000]
ParameterName=Texts
ObjectType=0x9
[2000sub1]
ParameterName=Long
DataType=0x0009
AccessType=rw
DefaultValue=abc
[2000sub2]
ParameterName=count
DataType=0x000A
AccessType=rw
DefaultValue=01 FF
[2000sub3]
ParameterName=Unknown octets
DataType=0x000A
AccessType=rw
[2000sub4]
ParameterName=Long
DataType=0x000B
AccessType=rw
DefaultValue=ab
[2001]
ParameterName=Time
DataType=0x000C
AccessType=rw
DefaultValue=1
[2002]
ParameterName=Difference
DataType=0x000D
AccessType=ro
[2003]
ParameterName=Program
ObjectType=0x2
PDOMapping=1
[2004]
ParameterName=Real
DataType=0x0008
AccessType=rw
DefaultValue=0x3F800000
LowLimit=-1.5
HighLimit=2
Unit=bar
Factor=0.5
[2005]
ParameterName=Small
DataType=0x0002
AccessType=rw
DefaultValue=0xFB
LowLimit=0x80
HighLimit=127
[2006]
ParameterName=Too much
DataType=0x0005
AccessType=rw
DefaultValue=256
LowLimit=9
HighLimit=3
[2007]
ParameterName=A structure
DataType=0x0040
AccessType=rw
[2008]
ParameterName=Limited
DataType=0x00A0
AccessType=rw
DefaultValue=7
[A0]
ParameterName=limited type
ObjectType=0x5
[A0sub1]
ParameterName=type
DefaultValue=0x06
[2009]
ParameterName=
ObjectType=0x0
[6000]
ParameterName=Torques
ObjectType=0x8
[6000sub0]
ParameterName=Number
DataType=0x0005
AccessType=const
DefaultValue=2
[6000sub1]
ParameterName=Left
DataType=0x0010
AccessType=ro
DefaultValue=-1
PDOMapping=1
[6000sub2]
ParameterName=Right
DataType=0x0010
AccessType=ro
PDOMapping=1
[6001]
ParameterName=Mixed
ObjectType=0x8
[6001sub1]
ParameterName=One
DataType=0x0005
AccessType=ro
[6001sub2]
ParameterName=Two
DataType=0x0006
AccessType=ro
[6041]
ParameterName=Status
DataType=0x0006
AccessType=ro
PDOMapping=1
[6042]
ParameterName=Status
DataType=0x0001
AccessType=
DefaultValue=1
[C000]
ParameterName=Out there
DataType=0x0005
AccessType=ro
"""


def imported(text: str, name: str = "pump.eds", encoding: str = "utf-8") -> Imported:
    return import_eds(text.encode(encoding), name)


@pytest.fixture(scope="module")
def pump() -> Imported:
    return imported(PUMP)


def test_head_and_mandatory(pump: Imported) -> None:
    od = pump.dictionary
    assert (od.name, od.version) == ("Насос", "1.2")
    assert {obj.index for obj in od if obj.mandatory} == {0x1000, 0x1018}
    assert od[0x1000][0].default == 0x000F0191
    assert (od[0x1000].access, od[0x1000][0].mappable) == ("const", False)


def test_classes_and_subs(pump: Imported) -> None:
    od = pump.dictionary
    found = {obj.index: CLASSES[obj.object_class] for obj in od}
    assert (found[0x1003], found[0x1018], found[0x2003], found[0x2009]) == ("ARRAY", "RECORD", "DOMAIN", "NULL")
    assert (found[0x6000], found[0x6001], found[0x1A00], found[0x1600]) == ("ARRAY", "RECORD", "ARRAY", "ARRAY")
    assert [field.default for field in od[0x1003].fields] == [None, 0x77, None]
    assert [(one.sub, one.name, one.access) for one in od[0x1018]] == [
        (0, "count", "const"), (1, "Vendor_ID", "ro"), (4, "Serial", "rw"),
    ]  # fmt: skip
    assert [field.bits for field in od[0x1018].fields] == [32, 0, 0, 32]
    assert od[0x2009].name == "0x2009"


@pytest.mark.parametrize(
    ("key", "name", "bits", "default"),
    [
        ("0x2000:1", "string", 2040, "abc"),
        ("0x2000:2", "block", 16, b"\x01\xff"),
        ("0x2000:4", "block", 32, b"a\0b\0"),
        ("0x2001", "block", 48, b"\1\0\0\0\0\0"),
        ("0x2002", "block", 48, None),
        ("0x2003", "block", 0, None),
        ("0x2004", "float32", 32, 1.0),
        ("0x2005", "int8", 8, -5),
        ("0x2006", "uint8", 8, None),
        ("0x2008", "uint16", 16, 7),
        ("0x6000:1", "int24", 24, -1),
        ("0x6042", "bool", 1, True),
    ],
)
def test_types_and_values(pump: Imported, key: str, name: str, bits: int, default: object) -> None:
    variable = pump.dictionary.variable(key)
    assert (variable.type.name, variable.bits, variable.default) == (name, bits, default)


@pytest.mark.parametrize(
    ("written", "access", "notes"),
    [
        ("RO", "ro", 0),
        ("wo", "wo", 0),
        ("const", "const", 0),
        ("rwr", "rw", 1),
        ("rww", "rw", 1),
        ("", "rw", 1),
        ("x", "rw", 1),
    ],
)
def test_access(written: str, access: str, notes: int) -> None:
    found = imported(f"[2000]\nParameterName=a\nDataType=7\nAccessType={written}\n")
    assert (found.dictionary[0x2000].access, len(found.notes)) == (access, notes)


def test_a_domain_is_never_mapped(pump: Imported) -> None:
    assert not pump.dictionary.variable("0x2003").mappable


def test_traits(pump: Imported) -> None:
    real, small, wrong = [pump.dictionary.variable(key).traits for key in ("0x2004", "0x2005", "0x2006")]
    assert (real.unit, real.scale, real.low, real.high) == ("bar", 0.5, -1.5, 2.0)
    assert (small.low, small.high) == (-128, 127)
    assert (wrong.low, wrong.high) == (None, None)


def test_a_width_that_scd_has_no_index_for_is_a_type_of_its_own(pump: Imported) -> None:
    assert [(row.index, row.name, row.bits) for row in pump.dictionary.body.types] == [(0x60, "int24", 24)]


def test_a_mapping_of_unsigned32_with_a_gap(pump: Imported) -> None:
    od = pump.dictionary
    assert [(row.variable.label, row.offset, row.bits) for row in od.tpdo[1].map] == [
        ("Status", 0, 16),
        ("Torques.1", 24, 24),
    ]
    assert (od.tpdo[1].node, od.tpdo[1].version, od[0x1A00][0].default) == (0, 0, 3)
    octets = Codec(od).encode("T1", {"0x6041": 0x0237, "0x6000:1": -2})
    assert octets.hex() == "370200feffff"
    assert od.rpdo[1].map == ()


def test_every_loss_is_told_once_with_its_places(pump: Imported) -> None:
    told = {note.text: note.places for note in pump.notes}
    assert told == {
        "listed in [OptionalObjects] and not described": ("0x1fff",),
        "its value '$NODEID+0x80' is omitted: depends on the node id, which the file does not give: set it (--node)": (
            "0x1014:0",
        ),
        "its value '$NODEID+0x180' is omitted: depends on the node id, which the file does not give: set it (--node)": (
            "0x1800:1",
        ),
        "rwr and rww are rw: which PDOs may carry the variable is not kept": ("0x1018:4",),
        "the file does not give its length; assumed: 255 bytes": ("0x2000:1",),
        "the file does not give its length; assumed: the value's own length": ("0x2000:2", "0x2000:4"),
        "OCTET_STRING is read as a block, as type 10 of SCD is a text": ("0x2000:2", "0x2000:3"),
        "UNICODE_STRING (UTF-16) is read as a block, as texts of SCD are UTF-8": ("0x2000:4",),
        "a name already used by a different field was extended by its number": ("0x2000:2", "0x2000:4"),
        "omitted: a block in an object of several needs a length, which the file does not give": ("0x2000:3",),
        "TIME_OF_DAY is read as a block of 6 bytes": ("0x2001",),
        "TIME_DIFFERENCE is read as a block of 6 bytes, as the interval of SCD has 8": ("0x2002",),
        "no access is given; assumed: rw": ("0x2003:0", "0x6042:0"),
        "its value '256' is omitted: 256 is outside 0..255": ("0x2006:0",),
        "its limits are omitted: the lower one is above the upper": ("0x2006:0",),
        "omitted: SCD has no simple type for type 0x0040": ("0x2007",),
        "the names of the elements are not kept: an ARRAY numbers them": ("0x6000",),
        "an ARRAY whose elements differ is a RECORD": ("0x6001",),
        "a name already used by a different object was extended by its index": ("0x6042",),
        "omitted: SCD has no objects there (reserved)": ("0xc000",),
        "the PDO is switched off: no object 0x7000": ("0x1600",),
    }
    assert [str(note) for note in pump.notes if note.places[0] == "0x2007"] == [
        "0x2007: omitted: SCD has no simple type for type 0x0040"
    ]


def test_many_places_are_counted() -> None:
    objects = "".join(f"[{0x2000 + n:04X}]\nParameterName=o{n}\nDataType=0xA\nAccessType=rw\n" for n in range(9))
    (note,) = imported(objects).notes
    assert str(note).startswith("0x2000, 0x2001, 0x2002, 0x2003 and 5 more: OCTET_STRING")


def test_round_trip(pump: Imported) -> None:
    assert parse_toml(dump_toml(pump.dictionary)).octets == pump.dictionary.octets


def test_a_dcf_has_the_values_of_a_configured_device() -> None:
    values = PUMP.replace("DefaultValue=0x000F0191", "DefaultValue=0x000F0191\nParameterValue=0x2\nDenotation=mine")
    commissioned = "[DeviceComissioning]\nNodeID=0x05\nNodeName=pump 5\nBaudrate=250\n"
    od = imported(commissioned + values, "pump.dcf").dictionary
    assert [od.variable(key).default for key in ("0x1000", "0x1014", "0x1800:1")] == [2, 0x85, 0x185]
    assert (od.tpdo[1].node, od.tpdo[1].version) == (0, 0)  # a COB-ID is no address


@pytest.mark.parametrize(
    ("encoding", "given", "name", "notes"),
    [
        ("utf-8", "", "Насос", 0),
        ("utf-8-sig", "", "Насос", 0),
        ("utf-16", "", "Насос", 0),
        ("cp1251", "cp1251", "Насос", 0),
        ("latin-1", "", "Größe", 1),
    ],
)
def test_encodings(tmp_path: Path, encoding: str, given: str, name: str, notes: int) -> None:
    path = tmp_path / "D.EDS"
    path.write_bytes(f"[1000]\r\nParameterName={name}\r\nDataType=7\r\nAccessType=ro\r\n".encode(encoding))
    found = import_file(path, given)
    assert found.dictionary[0x1000].name == name
    assert found.dictionary.name == "D"
    assert len(found.notes) == notes
    if not given:
        assert scd.compile(path).octets == load(path).octets == compile_source(path).octets == found.dictionary.octets
        assert scd.import_file(path).notes == found.notes


OBJECT = "[1000]\nParameterName=a\nDataType=7\nAccessType=ro\n"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "x.eds: file: no object is described"),
        ("hello\n", "x.eds:1: INI: no section"),
        (OBJECT + "nothing\n", "x.eds:5: INI: 'nothing"),
        (OBJECT + OBJECT, "x.eds:5: [1000]: occurs twice"),
        (OBJECT + "DataType=8\n", "x.eds:5: [1000], DataType: occurs twice"),
        ("[1a00]\nParameterName=a\n[1A00]\nParameterName=b\n", "x.eds:3: [1A00]: the same as [1a00] of line 1 (R57)"),
        ("\n[1000]\nDataType=7\n", "x.eds:2: [1000], ParameterName: is missing (R71)"),
        ("[1000]\nParameterName=a\n", "x.eds:1: [1000], DataType: is missing"),
        ("[1000]\nParameterName=a\nDataType=seven\n", "x.eds:1: [1000], DataType: 'seven' is not a whole number"),
        ("[1000]\nParameterName=a\nObjectType=3\n", "x.eds:1: [1000], ObjectType: 3 is not a class of objects (R63)"),
        (OBJECT + "[1001sub1]\nParameterName=a\nDataType=7\n", "x.eds:5: [1001sub1]: belongs to no object: [1001] is missing"),
        (OBJECT + "PDOMapping=x\n", "x.eds:1: [1000], PDOMapping: 'x' is not a whole number"),
        (OBJECT + "[1003]\nParameterName=e\nObjectType=8\nDataType=7\nCompactSubObj=999\n", "CompactSubObj: 999 elements"),
        (OBJECT + "[MandatoryObjects]\n1=none\n", "x.eds:5: [MandatoryObjects], 1: 'none' is not a whole number"),
        (OBJECT + "[DeviceComissioning]\nNodeID=me\n", "[DeviceComissioning], NodeID: 'me'"),
        (OBJECT + "[1000sub1]\nParameterName=a\nDataType=7\n[1000sub01]\nParameterName=a\nDataType=7\n",
         "the same as [1000sub1]"),
        (OBJECT + "[A0sub1]\nDefaultValue=0xA0\n[2000]\nParameterName=b\nDataType=0xA0\n[2000Name]\nNrOfEntries=z\n",
         "[2000Name], NrOfEntries: 'z'"),
        (OBJECT + "Factor=nan\n", "scale and shift are finite"),
    ],
)  # fmt: skip
def test_what_is_broken_is_told_with_its_place(text: str, told: str) -> None:
    with pytest.raises(DictionaryError) as error:
        imported(text, "x.eds")
    assert told in str(error.value)
    assert str(error.value).startswith("x.eds:")


def test_octets_of_another_encoding(tmp_path: Path) -> None:
    path = tmp_path / "x.eds"
    path.write_bytes(b"[1000]\nParameterName=\xff\n")
    with pytest.raises(DictionaryError, match=r"x\.eds:2: byte 21: not utf-8"):
        import_file(path, "utf-8")
    with pytest.raises(DictionaryError, match="'klingon' is not an encoding"):
        import_file(path, "klingon")


def test_a_file_too_large_or_of_another_kind(tmp_path: Path) -> None:
    path = tmp_path / "x.eds"
    with path.open("wb") as file:
        file.truncate(MAX_DESCRIPTION + 1)
    with pytest.raises(DictionaryError, match="bytes, a dictionary has at most"):
        import_file(path)
    with pytest.raises(DictionaryError, match=r"'\.toml' is not one of \.eds"):
        import_file(tmp_path / "x.toml")


def test_a_large_file_is_read_in_portions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """python-canopen takes many times the memory of a file, so it gets a part of the objects at a time."""
    objects = range(0x2000, 0x2000 + 600)
    listed = "\n".join(f"{number}=0x{index:04X}" for number, index in enumerate(objects, 1))
    sections = "\n".join(
        f"[{index:04X}]\nParameterName=Object {index:04X}\nObjectType=7\nDataType=7\nAccessType=rw\nPDOMapping=0\n"
        for index in objects
    )
    path = tmp_path / "large.eds"
    path.write_text(f"[ManufacturerObjects]\nSupportedObjects={len(objects)}\n{listed}\n{sections}", encoding="ascii")
    peaks, names = [], []
    rarely = gc.get_threshold()
    gc.set_threshold(2000)  # its objects refer to each other; else it would depend on the tests before this one
    for portion in (10**9, 50):
        monkeypatch.setattr(eds, "_PORTION", portion)
        gc.collect()
        tracemalloc.start()
        names.append(list(import_file(path).dictionary.objects))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    gc.set_threshold(*rarely)
    assert names[0] == names[1]
    assert len(names[0]) == len(objects)
    assert peaks[1] < 0.9 * peaks[0]


def test_without_canopen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "canopen", None)
    with pytest.raises(DictionaryError, match=r"package canopen: pip install 's7dissect\[eds\]'"):
        imported(OBJECT)


LINES = PUMP.splitlines()


SPOILT = (
    *(
        "",
        "[",
        "[1000",
        "=",
        "[DEFAULT]",
        "[FFFFsubFF]",
        "ObjectType=0x9",
        "ObjectType=2",
        "DataType=0x1B",
        "DataType=-1",
    ),
    *(
        "SubNumber=" + "9" * 50,
        "CompactSubObj=254",
        "ParameterName=\x1b[2J",
        "DefaultValue=1e999",
        "DefaultValue=$NODEID",
    ),
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(st.integers(0, len(LINES) - 1), st.sampled_from(SPOILT)), max_size=6))
def test_nothing_else_is_raised(changes: list[tuple[int, str]]) -> None:
    lines = list(LINES)
    for at, line in changes:
        lines[at] = line
    try:
        found = imported("\n".join(lines))
    except DictionaryError:
        return
    assert parse_toml(dump_toml(found.dictionary)).octets == found.dictionary.octets


@settings(max_examples=50, deadline=None)
@given(st.binary(max_size=200))
def test_octets_are_no_reason_to_raise_anything_else(octets: bytes) -> None:
    with pytest.raises(DictionaryError):
        import_eds(octets, "x.eds")


TYPES = """
[FileInfo]
FileName=x
[1000]
ParameterName=Device
DataType=0x7
AccessType=ro
DefaultValue=010
PDOMapping=01
[0040]
ParameterName=a struct
ObjectType=0x6
[0040sub0]
ParameterName=count
DataType=5
[0060]
ParameterName=a type
ObjectType=0x5
[0060sub1]
ParameterName=bits
DataType=5
[2000]
ParameterName=nothing
ObjectType=0x0
[2000sub1]
ParameterName=of nothing
DataType=5
[2001]
ParameterName=one
ObjectType=0x7
DataType=0x3
AccessType=rw
DefaultValue=-017
LowLimit=-020
HighLimit=0x7FFF
[2001sub1]
ParameterName=too many
DataType=5
[2002]
ParameterName=named
ObjectType=0x8
DataType=0x6
AccessType=rw
CompactSubObj=02
[2002Name]
NrOfEntries=01
1=first
[2003]
ParameterName=cob
DataType=0x7
AccessType=rw
DefaultValue=$NODEID+0600
"""


def test_sub_sections_where_nothing_can_be_cost_nothing_else() -> None:
    found = import_eds(TYPES.encode(), "x.eds")
    assert [obj.index for obj in found.dictionary] == [0x1000, 0x2000, 0x2001, 0x2002, 0x2003]
    told = {note.text: note.places for note in found.notes}
    assert told["omitted: a definition of a type in an EDS"] == ("0x0040", "0x0060")
    assert told["sub-indices of a NULL are omitted"] == ("0x2000",)
    assert told["sub-indices of a VAR are omitted"] == ("0x2001",)


def test_numbers_with_a_zero_in_front_are_octal() -> None:
    od = import_eds(TYPES.encode(), "x.eds").dictionary
    one = od[0x2001][0]
    assert (od[0x1000][0].default, one.default, one.traits.low, one.traits.high) == (8, -15, -16, 0x7FFF)
    assert len(od[0x2002].fields) == 2
    with pytest.raises(DictionaryError, match=r"\[2002\], CompactSubObj: '08' begins with 0 like an octal number"):
        import_eds(TYPES.replace("CompactSubObj=02", "CompactSubObj=08").encode(), "x.eds")


def test_a_node_id_that_is_given_counts(tmp_path: Path) -> None:
    path = tmp_path / "x.eds"
    path.write_text(TYPES)
    without, given = import_file(path), import_file(path, node=5)
    assert without.dictionary[0x2003][0].default is None
    assert any("--node" in note.text for note in without.notes)
    assert given.dictionary[0x2003][0].default == 0o600 + 5
    dcf = TYPES + "[DeviceComissioning]\nNodeID=3\n"
    assert import_eds(dcf.encode(), "x.dcf").dictionary[0x2003][0].default == 0o600 + 3
    assert import_eds(dcf.encode(), "x.dcf", node=4).dictionary[0x2003][0].default == 0o600 + 4


def test_a_limit_that_the_type_does_not_have_is_left_out() -> None:
    text = TYPES.replace("HighLimit=0x7FFF", "HighLimit=40000")
    found = import_eds(text.encode(), "x.eds")
    assert found.dictionary[0x2001][0].traits.high is None
    assert any("its limit '40000' is omitted: 40000 is outside" in note.text for note in found.notes)


def test_an_eds_as_toml_can_be_edited() -> None:
    """A mapping is written as a [[pdo]] that names its variables, so that it can be read and changed."""
    od = import_eds(PUMP.encode(), "pump.eds").dictionary
    text = dump_toml(od)
    assert parse_toml(text).octets == od.octets
    assert 'map = ["0x6041:0", {reserved = 8}' in text
    edited = parse_toml(text.replace('"0x6041:0", {reserved = 8}', '"0x6041:0", {reserved = 16}'))
    first, second = od.tpdo[1], edited.tpdo[1]
    assert second.bits == first.bits + 8


def test_every_wrong_section_is_reported() -> None:
    text = (
        "[FileInfo]\nA=1\n[1000]\nParameterName=a\nDataType=x\n[2000]\nDataType=5\n[2000sub1]\nA=1\n[1001sub1]\nA=1\n"
    )
    with pytest.raises(DictionaryError) as caught:
        import_eds(text.encode(), "x.eds")
    assert [str(error).split(": ")[:2] for error in (caught.value, *caught.value.others)] == [
        ["x.eds:3", "[1000], DataType"], ["x.eds:6", "[2000], ParameterName"], ["x.eds:10", "[1001sub1]"],
    ]  # fmt: skip
