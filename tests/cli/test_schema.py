"""`lagsim schema`: it accepts the files of the reader, and refuses wrong shapes."""

import json
import re

import pytest
import yaml

from lagsim.api import SimulationKeys
from lagsim.errors import UNSEEN as INVISIBLE
from lagsim.language.functions import JOINING
from lagsim.methods import options
from lagsim.model.reader.fields import OPTIONS
from tests.model._files import completed
from tests.model.test_faults import CASES
from tests.support import MODELS, ROOT

SHIPPED = ROOT / "lagsim/lagsim.schema.json"
SCHEMA = json.loads(SHIPPED.read_text(encoding="utf-8"))
FILES = sorted([*MODELS.rglob("*.yaml"), *(ROOT / "lagsim/cli/templates").glob("*")])
# What a file's shape shows. Other faults need its names, its expressions or its text.
SHAPES = {
    "unknown-key", "not-a-mapping", "not-a-list", "not-a-text", "not-a-truth",
    "not-an-expression", "missing-key", "both-given", "format-version", "wrong-count",
    "bad-name", "reserved-name", "bad-model-name", "unknown-method",
}  # fmt: skip
# Names that a mapping may have beside the known ones; members of families have lists.
OPEN = {"^x-": {}, r"\(": {}}
# Letters are those of Unicode; whether a contact needs a restitution its relation says;
# `$` of Python's patterns matches before a last line break, that of JavaScript's not.
UNSEEN = {
    r'description: "a⟪\0⟫"', "parameters: {⟪x²⟫: 1}", "constraints: {⟪floor⟫: x >= -1}",
    r'parameters: {⟪"a\n"⟫: 1}',
}  # fmt: skip
FAULTY = [n for n, case in CASES.items() if case[0] in SHAPES and n not in UNSEEN]


class Loader(yaml.SafeLoader):
    """YAML 1.2, where `on` and `no` are names."""


Loader.yaml_implicit_resolvers = {
    first: found
    for first, found in yaml.SafeLoader.yaml_implicit_resolvers.items()
    if first not in tuple("oOyYnN")
}


def loaded(text):
    return yaml.load(text, Loader)  # noqa: S506  a safe one


@pytest.fixture
def faults():
    """Return a function that lists the faults of a file's data by the schema."""
    validator = pytest.importorskip("jsonschema", reason="needs jsonschema")
    validator.Draft7Validator.check_schema(SCHEMA)
    validate = validator.Draft7Validator(SCHEMA)
    return lambda data: list(validate.iter_errors(data))


def test_the_shipped_file_is_what_the_command_prints(lagsim):
    called = lagsim("schema", code=0, err="")
    assert called.out == SHIPPED.read_text(encoding="utf-8")


def test_the_shipped_file_names_what_is_declared_elsewhere():
    """Invisible letters, operators, and the present options of methods."""
    sections = SCHEMA["properties"]
    assert sections["name"]["pattern"] == rf"^[^/\\\n\t{INVISIBLE}]+$"
    refused = sections["definitions"]["propertyNames"]["not"]["anyOf"][0]["enum"]
    assert {*JOINING} < {*refused}
    keys = sections["simulation"]["properties"].items()
    own = {k for k, form in keys if "Only for the method" in form["description"]}
    assert own == {*options()}


def test_options_have_a_type_in_python_and_a_text_in_the_schema():
    assert {*SimulationKeys.__annotations__, *options()} == {*OPTIONS}
    keys = SCHEMA["properties"]["simulation"]["properties"]
    assert all(keys[name]["description"] for name in OPTIONS)


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_models_are_valid(faults, path):
    assert faults(loaded(path.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize("name", FAULTY)
def test_faulty_models_are_not(faults, name):
    text = re.sub("[⟪⟫]", "", CASES[name][2])
    data = loaded(completed(text))
    assert faults(data) != []


@pytest.mark.parametrize("section", ["coordinates", "energy", "initial"])
def test_required_sections(faults, section):
    [fault] = faults(loaded(completed("name: a", section)))
    assert fault.validator == "required"
    assert f"'{section}'" in fault.message


def walk(schema, at="lagsim"):
    yield at, schema
    for word in ("properties", "patternProperties"):
        for key, inner in schema.get(word, {}).items():
            if isinstance(inner, dict):
                yield from walk(inner, f"{at}.{key}")
    for word in ("items", "additionalProperties"):
        if isinstance(schema.get(word), dict):
            yield from walk(schema[word], at)
    for inner in schema.get("anyOf", ()):
        yield from walk(inner, at)


def test_every_key_says_what_it_is_for():
    for at, schema in walk(SCHEMA):
        if schema.get("additionalProperties") is False:
            silent = [
                k for k, s in schema["properties"].items() if not s["description"]
            ]
            assert silent == [], at


def test_mappings_take_no_unknown_keys_but_those_of_the_user(faults):
    for at, schema in walk(SCHEMA):
        if "properties" in schema or "propertyNames" in schema:
            assert schema["additionalProperties"] is not True, at
            own = schema["patternProperties"].items()
            assert {"^x-": {}}.items() <= own <= OPEN.items(), at
    data = loaded(completed("x-mine: [1, {a: b}]\nsimulation: {x-a: 1}"))
    assert faults(data) == []
    data["y-mine"] = 1
    assert faults(data) != []
