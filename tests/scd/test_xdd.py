"""XDD and XDC files: what becomes of each thing in them, and what broken and hostile ones say."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dissect import scd
from dissect.scd.codec import Codec
from dissect.scd.dump import dump_toml
from dissect.scd.errors import DictionaryError
from dissect.scd.foreign import Imported
from dissect.scd.loading import import_file, load
from dissect.scd.source import parse_toml
from dissect.scd.xdd import import_xdd

HEAD = """\
<ISO15745ProfileContainer xmlns="http://www.ethernet-powerlink.org" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance">
 <ISO15745Profile><ProfileBody xsi:type="ProfileBody_Device_Powerlink" fileVersion="01.02">
  <DeviceIdentity><vendorName>nobody</vendorName><productName>Насос</productName></DeviceIdentity>
  <ApplicationProcess><parameterList>
   <parameter uniqueID="UID_1" access="readWrite"><label lang="en">Flow</label><UDINT/><defaultValue value="7"/></parameter>
  </parameterList></ApplicationProcess>
 </ProfileBody></ISO15745Profile>
 <ISO15745Profile><ProfileBody xsi:type="ProfileBody_CommunicationNetwork_Powerlink"><ApplicationLayers>
  <DataTypeList><defType dataType="0001"><Boolean/></defType></DataTypeList><ObjectList>
"""
TAIL = "</ObjectList></ApplicationLayers></ProfileBody></ISO15745Profile></ISO15745ProfileContainer>"
#: A pump of POWERLINK; mapping entries of UNSIGNED64: length, offset, sub-index, index.
OBJECTS = """\
<!-- types -->
<Object index="0006" name="UNSIGNED16" objectType="5"/>
<Object index="0040" name="pump_t" objectType="6">
 <SubObject subIndex="00" name="n" objectType="7" dataType="0005" accessType="const" defaultValue="2"/>
 <SubObject subIndex="01" name="run" objectType="7" dataType="0006" accessType="const" defaultValue="0x0001"/>
 <SubObject subIndex="02" name="speed" objectType="7" dataType="0006" accessType="const" defaultValue="0x0003"/>
</Object>
<Object index="0060" name="short" objectType="5" dataType="0010"/>
<Object index="0424" name="elsewhere" objectType="6"/>
<Object index="1000" name="NMT_DeviceType_U32" objectType="7" dataType="0007" accessType="const" defaultValue="0x000F0191"/>
<Object index="1018" name="NMT_IdentityObject_REC" objectType="9">
 <SubObject subIndex="00" name="NumberOfEntries" objectType="7" dataType="0005" accessType="const" defaultValue="4"/>
 <SubObject subIndex="01" name="VendorId_U32" objectType="7" dataType="0007" accessType="const" defaultValue="1"/>
 <SubObject subIndex="03" name="Valid_BOOL" objectType="7" dataType="0001" accessType="rw" defaultValue="true"/>
 <SubObject subIndex="04" name="Name" objectType="7" dataType="0009" accessType="ro"/>
 <SubObject subIndex="FF" name="Structure" objectType="7" dataType="0007"/>
</Object>
<Object index="1050" name="Latency" objectType="8" dataType="0007">
 <SubObject subIndex="00" name="NumberOfEntries" objectType="7" dataType="0005" accessType="ro" defaultValue="2"/>
 <SubObject subIndex="01" name="Diff" objectType="7" accessType="ro" defaultValue="1"/>
 <SubObject subIndex="02" name="Diff" objectType="7" accessType="ro" defaultValue="2"/>
</Object>
<Object index="1800" name="TPDO_CommParam" objectType="9">
 <SubObject subIndex="00" name="NumberOfEntries" objectType="7" dataType="0005" accessType="const" defaultValue="2"/>
 <SubObject subIndex="01" name="NodeID_U8" objectType="7" dataType="0005" accessType="rw" defaultValue="3"/>
 <SubObject subIndex="02" name="MappingVersion_U8" objectType="7" dataType="0005" accessType="ro" defaultValue="0x10"/>
</Object>
<Object index="1A00" name="TPDO_MappParam_AU64" objectType="8" dataType="001B">
 <SubObject subIndex="00" name="NumberOfEntries" objectType="7" dataType="0005" accessType="rw" defaultValue="2"/>
 <SubObject subIndex="01" name="Mapping" objectType="7" dataType="001B" accessType="rw" defaultValue="0x0018000000016000"/>
 <SubObject subIndex="02" name="Mapping" objectType="7" dataType="001B" accessType="rw" defaultValue="0x0001002000006001"/>
 <SubObject subIndex="03" name="ObjectMapping" objectType="7" dataType="001B" accessType="rw"/>
</Object>
<Object index="1A01" name="TPDO_Bool8" objectType="8" dataType="001B">
 <SubObject subIndex="00" name="NumberOfEntries" objectType="7" dataType="0005" accessType="rw" defaultValue="1"/>
 <SubObject subIndex="01" name="Mapping" objectType="7" dataType="001B" accessType="rw" defaultValue="0x0008000000006001"/>
</Object>
<Object index="1600" name="RPDO_Missing" objectType="8" dataType="001B">
 <SubObject subIndex="00" name="NumberOfEntries" objectType="7" dataType="0005" accessType="rw" defaultValue="5"/>
 <SubObject subIndex="01" name="ObjectMapping" objectType="7" dataType="001B" accessType="rw"/>
</Object>
<Object index="1602" name="RPDO_Hole" objectType="8" dataType="001B">
 <SubObject subIndex="00" name="NumberOfEntries" objectType="7" dataType="0005" accessType="rw" defaultValue="2"/>
 <SubObject subIndex="02" name="Mapping" objectType="7" dataType="001B" accessType="rw" defaultValue="0x0001000000006001"/>
</Object>
<Object index="1601" name="RPDO_Other" objectType="8" dataType="0006">
 <SubObject subIndex="01" name="ObjectMapping" objectType="7" dataType="0006" accessType="rw"/>
</Object>
<Object index="2000" name="MAC" objectType="7" dataType="0401" accessType="rw" defaultValue="00:1B:44:11:3A:B7"/>
<Object index="2001" name="IP" objectType="7" dataType="0402" accessType="rw" defaultValue="0xC0A86401"/>
<Object index="2002" name="IP text" objectType="7" dataType="0402" accessType="rw" defaultValue="192.168.100.1"/>
<Object index="2003" name="Time" objectType="7" dataType="0403" accessType="rw" defaultValue="0x0000000500000001"/>
<Object index="2004" name="Wrong IP" objectType="7" dataType="0402" accessType="rw" defaultValue="a.b.c.d"/>
<Object index="2005" name="Flow" objectType="7" uniqueIDRef="UID_1" PDOmapping="RPDO"/>
<Object index="2006" name="Program" objectType="2"/>
<Object index="2007" name="Nothing" objectType="7"/>
<Object index="2008" name="Double" objectType="7" dataType="0011" accessType="rw" defaultValue="2.5" lowLimit="x"
 highLimit="0x4000000000000000"/>
<Object index="2009" name="Short" objectType="7" dataType="0060" accessType="rw" defaultValue="0xFFFFFE"/>
<Object index="6000" name="Torques" objectType="8" dataType="0010">
 <SubObject subIndex="00" name="NumberOfEntries" objectType="7" dataType="0005" accessType="const" defaultValue="1"/>
 <SubObject subIndex="01" name="Torque" objectType="7" dataType="0010" accessType="ro" PDOmapping="TPDO"/>
</Object>
<Object index="6001" name="Run" objectType="7" dataType="0001" accessType="rw" PDOmapping="optional" defaultValue="false"/>
"""
PUMP = HEAD + OBJECTS + TAIL


def imported(text: str, name: str = "pump.xdd") -> Imported:
    return import_xdd(text.encode(), name)


def with_objects(objects: str) -> str:
    return HEAD + objects + TAIL


@pytest.fixture(scope="module")
def pump() -> Imported:
    return imported(PUMP)


def test_head_and_objects(pump: Imported) -> None:
    od = pump.dictionary
    assert (od.name, od.version) == ("Насос", "01.02")
    assert " ".join(f"{obj.index:x}" for obj in od) == (
        "1000 1018 1050 1600 1602 1800 1a00 1a01 2000 2001 2002 2003 2004 2005 2006 2008 2009 6000 6001"
    )
    assert [(one.sub, one.name, one.default) for one in od[0x1018]] == [
        (0, "count", 4), (1, "VendorId_U32", 1), (3, "Valid_BOOL", True), (4, "Name", None),
    ]  # fmt: skip
    assert [field.default for field in od[0x1050].fields] == [1, 2]


def test_types_of_the_file(pump: Imported) -> None:
    od = pump.dictionary
    assert [(row.index, row.name, row.bits) for row in od.body.types] == [(0x60, "short", 24), (0x61, "int24", 24)]
    assert Codec(od).decode_type("pump_t", b"\xff\xff\x01").values == {"run": True, "speed": -1}
    assert (od.variable("0x2009").type.name, od.variable("0x2009").default) == ("short", -2)


@pytest.mark.parametrize(
    ("key", "default"),
    [
        ("0x2000", "00:1B:44:11:3A:B7"),
        ("0x2001", "192.168.100.1"),
        ("0x2002", "192.168.100.1"),
        ("0x2003", "1970-01-01T00:00:01.000000005Z"),
        ("0x2004", "None"),
        ("0x2005", "7"),
        ("0x2008", "2.5"),
    ],
)
def test_values(pump: Imported, key: str, default: str) -> None:
    assert str(pump.dictionary.variable(key).default) == default


def test_a_parameter_of_the_application_gives_what_the_object_leaves_out(pump: Imported) -> None:
    flow = pump.dictionary.variable("0x2005")
    assert (flow.type.name, flow.access, flow.mappable) == ("uint32", "rw", True)


def test_a_mapping_of_unsigned64(pump: Imported) -> None:
    od = pump.dictionary
    assert [(row.variable.label, row.offset, row.bits) for row in od.tpdo[1].map] == [
        ("Torques.1", 0, 24),
        ("Run", 32, 1),
    ]
    assert (od.tpdo[1].node, od.tpdo[1].version) == (3, 16)
    assert Codec(od).encode("T1", {"0x6000:1": -2, "0x6001": True}).hex() == "feffff0001"
    assert (od.tpdo[2].map, od.rpdo[1].map, od.rpdo[3].map) == ((), (), ())


def test_every_loss_is_told(pump: Imported) -> None:
    assert {note.text: note.places for note in pump.notes} == {
        "omitted: a definition of a type where SCD has none": ("0x0424",),
        "the file does not give its length; assumed: 255 bytes": ("0x1018:4",),
        "the PDO is switched off: 5 entries, not all of them have a value": ("0x1600",),
        "the PDO is switched off: 2 entries, not all of them have a value": ("0x1602",),
        "omitted: no mapping of UNSIGNED32 (CANopen) or UNSIGNED64 (POWERLINK) elements": ("0x1601",),
        "its value 'a.b.c.d' is omitted: is not an IP address: Only decimal digits permitted in 'a' in 'a.b.c.d'": (
            "0x2004:0",
        ),
        "no access is given; assumed: rw": ("0x2006:0",),
        "omitted: no type is given": ("0x2007",),
        "its limit 'x' is omitted: is not a number": ("0x2008:0",),
        "the PDO is switched off: Run has 1 bit, not 8": ("0x1a01",),
    }


def test_round_trip(pump: Imported) -> None:
    assert parse_toml(dump_toml(pump.dictionary)).octets == pump.dictionary.octets


def test_an_xdc_has_the_values_of_a_configured_device() -> None:
    text = PUMP.replace('defaultValue="0x000F0191"', 'defaultValue="0x000F0191" actualValue="5"')
    assert imported(text, "pump.xdc").dictionary.variable("0x1000").default == 5


def test_canopen_of_cia_311() -> None:
    text = PUMP.replace("<SubObject", "<CANopenSubObject").replace("</Object>", "</CANopenObject>")
    text = text.replace("<Object ", "<CANopenObject ").replace("ObjectList", "CANopenObjectList")
    assert imported(text).dictionary.octets == imported(PUMP).dictionary.octets


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "windows-1251"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "x.XDD"
    path.write_bytes(f'<?xml version="1.0" encoding="{encoding}"?>\n{PUMP}'.encode(encoding))
    assert scd.compile(path).name == load(path).name == import_file(path).dictionary.name == "Насос"


VAR = '<Object index="{}" name="a" objectType="{}" dataType="{}" accessType="ro"/>'
SUBS = '<SubObject subIndex="1" dataType="7"/><SubObject subIndex="01" dataType="7"/>'
TWICE = f'<Object index="1018" objectType="9">{SUBS}</Object>'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "x.xdd:1: XML: no element found"),
        ("<a>\n<b></a>", "x.xdd:2: XML: mismatched tag"),
        ("<a/>", "x.xdd: XDD: no Object in an ObjectList"),
        ('<?xml version="1.0" encoding="klingon"?><a/>', "XML: "),
        (with_objects(VAR.format("", 7, "7")), "Object '': index '' is not a hexadecimal number (R57)"),
        (with_objects(VAR.format("12345", 7, "7")), "index '12345' is not a hexadecimal number"),
        (with_objects(VAR.format("1000", 3, "7")), "Object 1000: objectType '3' is not a class of objects (R63)"),
        (with_objects(VAR.format("1000", 7, "seven")), "Object 1000: dataType 'seven' is not a hexadecimal number"),
        (with_objects(VAR.format("1000", 7, "7") * 2), "Object 1000: the index occurs twice (R57)"),
        (with_objects(TWICE), "Object 1018, SubObject 01: occurs twice (R62)"),
        (with_objects(TWICE.replace('"1"', '"100"')), "Object 1018, SubObject 100: sub-indices have 8 bits (R62)"),
    ],
)
def test_what_is_broken_is_told_with_its_place(text: str, told: str) -> None:
    with pytest.raises(DictionaryError) as error:
        imported(text, "x.xdd")
    assert told in str(error.value)
    assert str(error.value).startswith("x.xdd:")


LAUGHS = "".join(f'<!ENTITY l{n} "{f"&l{n - 1};" * 10 if n else "ha"}">' for n in range(10))


@pytest.mark.parametrize(
    "head",
    [
        f"<!DOCTYPE a [{LAUGHS}]>",
        '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/hostname">]>',
        '<!DOCTYPE a SYSTEM "http://127.0.0.1:9/a.dtd">',
        "<!DOCTYPE a>",
    ],
)
def test_entities_and_dtds_are_refused(head: str) -> None:
    text = head + with_objects(VAR.format("1000", 7, "7").replace('name="a"', 'name="&l9;&x;"'))
    with pytest.raises(DictionaryError, match="XML: a DTD or an entity"):
        imported(text)


def test_elements_in_elements_without_end() -> None:
    with pytest.raises(DictionaryError):
        imported("<a>" * 100_000)
    deep = "<a>" * 2_000 + VAR.format("1000", 7, "7") + "</a>" * 2_000
    assert len(imported(deep).dictionary) == 1


def test_without_defusedxml(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "defusedxml.common", None)
    with pytest.raises(DictionaryError, match=r"package defusedxml: pip install 's7dissect\[eds\]'"):
        imported(PUMP)


ATTRIBUTES = (
    'index="{}"', 'subIndex="{}"', 'objectType="{}"', 'dataType="{}"', 'accessType="{}"', 'defaultValue="{}"', 'highLimit="{}"',
    'name="{}"',
)  # fmt: skip
WRITTEN = (
    "",
    "0",
    "7",
    "8",
    "9",
    "10",
    "1B",
    "40",
    "1A00",
    "FFFF",
    "-1",
    "1e999",
    "0x" + "F" * 30,
    "true",
    "a.b",
    "&#x202e;",
)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.lists(st.tuples(st.sampled_from(ATTRIBUTES), st.sampled_from(WRITTEN)), max_size=5), max_size=4))
def test_nothing_else_is_raised(objects: list[list[tuple[str, str]]]) -> None:
    rows = []
    for attributes in objects:
        given_ = {form.partition("=")[0]: form.format(value) for form, value in attributes}
        sub = f"<SubObject {' '.join(given_.values())}/>"
        rows.append(f"<Object {' '.join(given_.values())}>{sub}</Object>")
    text = with_objects("".join(rows) + OBJECTS)
    try:
        found = imported(text)
    except DictionaryError:
        return
    assert parse_toml(dump_toml(found.dictionary)).octets == found.dictionary.octets


@settings(max_examples=50, deadline=None)
@given(st.integers(0, len(PUMP)), st.binary(max_size=8))
def test_a_file_cut_and_spoilt_anywhere(at: int, spoil: bytes) -> None:
    with pytest.raises(DictionaryError):
        import_xdd(PUMP.encode()[:at] + spoil, "x.xdd")
