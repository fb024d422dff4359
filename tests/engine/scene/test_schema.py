"""The JSON Schema is whole, and says what the models do."""

import json
from dataclasses import fields

from engine.liquid.settings import LiquidSettings
from engine.scene.load import scene_schema
from engine.scene.steps import LiquidStep, Step, StrandStep
from engine.strands.settings import StrandSettings
from engine.yarns.settings import YarnSettings


def nodes(value):
    yield value
    for inner in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from nodes(inner)


def test_schema_is_json_and_its_references_resolve():
    schema = scene_schema()
    assert json.loads(json.dumps(schema, allow_nan=False)) == schema
    for node in nodes(schema):
        if isinstance(node, dict) and "$ref" in node:
            assert node["$ref"].removeprefix("#/$defs/") in schema["$defs"]


def test_no_object_takes_unknown_keys_and_every_part_is_described():
    schema = scene_schema()
    for part in [schema, *schema["$defs"].values()]:
        assert part["type"] == "object" and part["additionalProperties"] is False and part["description"]


def test_version_name_and_duration_are_all_that_a_scene_must_say():
    schema = scene_schema()
    assert schema["required"] == ["strandline", "name", "duration"]
    assert schema["properties"]["strandline"]["const"] == 1


def test_every_setting_of_the_yarn_method_is_a_key_of_step():
    settings = {field.name: field.default for field in fields(YarnSettings)}
    keys = {name: field.default for name, field in Step.model_fields.items() if name not in ("default", "min", "max")}
    assert keys == settings


def test_every_setting_of_the_strand_method_is_a_key_of_strand_step():
    settings = {field.name: field.default for field in fields(StrandSettings)}
    assert {name: field.default for name, field in StrandStep.model_fields.items()} == settings


def test_every_setting_of_the_liquid_method_is_a_key_of_liquid_step():
    settings = {field.name: field.default for field in fields(LiquidSettings)}
    assert {name: field.default for name, field in LiquidStep.model_fields.items()} == settings
