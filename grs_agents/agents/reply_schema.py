"""JSON schemas of the agents' replies, for providers with structured output."""

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, Final, cast

from pydantic import BaseModel

from grs_agents.agents.types import (
    Grouping,
    RouterReply,
    SegmentMatches,
    SegmentReplies,
    TaskDefinition,
    TaskRevision,
    WordsJudgement,
)

Json = dict[str, Any]
_TYPES: Final[Mapping[str, type[BaseModel]]] = MappingProxyType(
    {
        "group": Grouping,
        "describe": SegmentReplies,
        "match": SegmentMatches,
        "task": TaskDefinition,
        "fix_task": TaskRevision,
        "route": RouterReply,
        "judge": WordsJudgement,
    }
)
"""By role; the other roles reply with programs."""
_FORM = "The whole reply, in place of the fenced block and the plain text that the prompt asks for."
_KEPT = ("type", "enum", "const", "description")


@cache
def reply_schema(role: str) -> Mapping[str, Any] | None:
    """The JSON schema of the reply of ``role``; None for a reply that is no JSON.

    It keeps to what all providers accept: references are resolved, every property is required, bounds are left to the
    parser.
    """
    if role not in _TYPES:
        return None
    schema = _TYPES[role].model_json_schema()
    return {"title": f"{role}_reply", **_simplify(schema, schema.get("$defs", {})), "description": _FORM}


def _simplify(schema: Json, definitions: Mapping[str, Json]) -> Json:
    if "$ref" in schema:
        return _simplify(definitions[str(schema["$ref"]).rpartition("/")[2]], definitions)
    if "anyOf" in schema:
        return {"anyOf": [_simplify(choice, definitions) for choice in cast("list[Json]", schema["anyOf"])]}
    simple = {key: schema[key] for key in _KEPT if key in schema}
    if schema.get("type") == "array":
        items: Json = schema["items"] if "items" in schema else schema["prefixItems"][0]  # a tuple of equal types
        return {**simple, "items": _simplify(items, definitions)}
    if "properties" in schema:
        fields = {name: _simplify(field, definitions) for name, field in schema["properties"].items()}
        return {**simple, "properties": fields, "required": list(fields), "additionalProperties": False}
    return simple
