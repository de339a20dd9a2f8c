"""Specifications come out the same from XML and from a vector file, and bad ones are refused."""

import importlib.util
import inspect
import sys
from pathlib import Path
from types import ModuleType

import pytest

from adapters.mal import (
    AttributeType,
    Codec,
    Field,
    InteractionStage,
    MalError,
    NamedValue,
    Pattern,
    Specification,
    SpecificationError,
    StandardError,
    load_specification,
)
from adapters.mal.specification import TypeRef
from adapters.mal.specification_xml import read_areas
from tests.mal.generate import generate
from tests.mal.wiretest import SPECIFICATION, XML

NAMESPACE = "http://www.ccsds.org/schema/ServiceSchema"


def load_module(path: Path, text: str) -> ModuleType:
    path.write_text(text)
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def test_xml_and_vector_file_give_the_same() -> None:
    assert load_specification(XML).areas == SPECIFICATION.areas


def test_operations_are_found_by_name_and_number() -> None:
    operation = SPECIFICATION.operation("Vectors", "monitor")
    assert operation.pattern is Pattern.PUBSUB
    assert [key.name for key in operation.keys] == ["parameter", "asset"]
    notify = operation.parts[InteractionStage.NOTIFY]
    assert [p.name for p in notify] == ["subscriptionId", "updateHeader", "value", "rec"]
    assert SPECIFICATION.resolve(177, 1, 3, 6) is operation
    with pytest.raises(KeyError):
        SPECIFICATION.operation("Vectors", "fly")


@pytest.mark.parametrize(
    ("address", "error"),
    [
        ((178, 1, 3, 6), StandardError.UNSUPPORTED_AREA),
        ((1, 3, 1, 1), StandardError.UNSUPPORTED_AREA),
        ((177, 2, 3, 6), StandardError.UNSUPPORTED_AREA_VERSION),
        ((177, 1, 4, 6), StandardError.UNSUPPORTED_SERVICE),
        ((177, 1, 3, 999), StandardError.UNSUPPORTED_OPERATION),
    ],
)
def test_absent_items_are_distinguished(
    address: tuple[int, int, int, int], error: StandardError
) -> None:
    with pytest.raises(MalError) as raised:
        SPECIFICATION.resolve(*address)
    assert raised.value.number == error.value


def test_a_generated_module_is_taken_and_its_classes_used(tmp_path: Path) -> None:
    module = load_module(tmp_path / "wiretest_types.py", generate(read_areas(XML), XML.name))
    specification = load_specification(XML, classes=module)
    assert specification.classes["Rec"] is module.Rec
    assert issubclass(module.Derived, module.Base)
    operation = specification.operation("Vectors", "derived")
    value = module.Derived(id=1, inner=module.Rec(name="r", ok=True, mode=module.Mode.STOP))
    codec = Codec(specification)
    body = codec.encode(operation.parts[InteractionStage.REQUEST], (value,))
    assert codec.decode(operation.parts[InteractionStage.REQUEST], body) == (value,)


def test_a_generated_module_retains_comments_and_units(tmp_path: Path) -> None:
    path = tmp_path / "spec.xml"
    path.write_text(
        f"""<specification xmlns="{NAMESPACE}"><area name="A" number="900" version="1"><dataTypes>
        <composite name="Step" shortFormPart="1" comment="One step. It has &quot;quotes&quot;.">
        <field name="from" canBeNull="false" comment="Where."><type area="MAL" name="URI"/></field>
        <field name="after" comment="How long."><type area="MAL" name="Duration"/></field>
        <field name="next"><type area="A" name="Step" list="true"/></field>
        <field name="of"><type area="A" name="Thing" objectRef="true"/></field>
        </composite></dataTypes></area></specification>"""
    )
    module = load_module(tmp_path / "step_types.py", generate(read_areas(path), path.name))
    assert inspect.getdoc(module.Step) == (
        "One step.\n\nIt has 'quotes'.\n\nAttributes:\n    from_: Where.\n    after: How long. (s)"
    )
    step = module.Step(from_="maltcp://a:1/b", next=(module.Step(from_=""),))
    codec = Codec(load_specification(path, classes=module))
    parts = (read_areas(path)[0].types[0].fields[2],)  # type: ignore[union-attr]
    assert codec.decode(parts, codec.encode(parts, ((step,),))) == ((step,),)


def test_a_class_that_does_not_fit_is_refused() -> None:
    stale = ModuleType("stale")
    stale.Rec = NamedValue  # type: ignore[attr-defined]
    with pytest.raises(SpecificationError, match="class Rec must have the fields"):
        load_specification(XML, classes=stale)
    stale = ModuleType("stale")
    stale.Mode = AttributeType  # type: ignore[attr-defined]
    with pytest.raises(SpecificationError, match="class Mode must have the items"):
        load_specification(XML, classes=stale)


@pytest.mark.parametrize(
    ("before", "after", "why"),
    [
        ('name="Mode" area="WireTest"', 'name="Mood" area="WireTest"', "unknown type"),
        ('name="Mode" area="WireTest"', 'name="Mode" area="Other"', "unknown type"),
        ('name="Composite" area="MAL"', 'name="Base" area="WireTest"', "extends itself"),
        ('shortFormPart="13"', 'shortFormPart="12"', "the same short form"),
        ('name="Derived2"', 'name="Derived"', "duplicate"),
        ('name="doSubmit" number="2"', 'name="doSend" number="2"', "duplicate"),
        ('name="label"', 'name="id"', "has a duplicate field"),
        ('number="177"', "", "has no 'number'"),
        ('number="177"', 'number="many"', "many"),
        ("mal:sendIP", "mal:shoutIP", "SHOUT"),
        ("</mal:specification>", "", "no element found"),
        ("mal:area", "mal:volume", "has no area"),
        ('<mal:type list="false" name="Mode" area="WireTest"/>', "", "has 0 types"),
    ],
)
def test_a_bad_specification_is_refused(tmp_path: Path, before: str, after: str, why: str) -> None:
    path = tmp_path / "bad.xml"
    path.write_text(XML.read_text().replace(before, after))
    with pytest.raises(SpecificationError, match=why):
        load_specification(path)


def test_objects_carry_their_identity_first(tmp_path: Path) -> None:
    path = tmp_path / "objects.xml"
    path.write_text(
        f"""<specification xmlns="{NAMESPACE}"><area name="A" number="900" version="1"><dataTypes>
        <composite name="Plan" shortFormPart="1"><extends><type area="MAL" name="Object"/></extends>
        <field name="text"><type area="MAL" name="String"/></field></composite>
        </dataTypes></area></specification>"""
    )
    specification: Specification = load_specification(path)
    fields = specification.types[TypeRef("A", "Plan")].fields
    assert [field.name for field in fields] == ["objectIdentity", "text"]


def test_parts_may_be_without_names_and_errors_within_operations(tmp_path: Path) -> None:
    path = tmp_path / "plain.xml"
    path.write_text(
        f"""<specification xmlns="{NAMESPACE}"><area name="A" number="900" version="1">
        <service name="S" number="1"><capabilitySet number="1">
        <submitIP name="go" number="1" supportInReplay="false"><messages><submit>
        <type area="MAL" name="Long"/><type area="MAL" name="String" list="true"/>
        </submit></messages><errors><errorRef><type area="MAL" name="UNKNOWN"/></errorRef>
        <error name="Late" number="7"/></errors></submitIP>
        </capabilitySet></service></area></specification>"""
    )
    operation = load_specification(path).operation("S", "go")
    assert operation.errors == ("UNKNOWN", "Late")
    assert operation.parts[InteractionStage.SUBMIT] == (
        Field("part0", TypeRef("MAL", "Long"), nullable=True),
        Field("part1", TypeRef("MAL", "String", is_list=True), nullable=True),
    )
