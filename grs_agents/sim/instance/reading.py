"""Task instances from files and processes that are not trusted: bounded, then parsed, then checked."""

import json
from typing import Final

from pydantic import ValidationError

from grs_agents.errors import InputError
from grs_agents.foreign import check_json
from grs_agents.sim.instance.instance import TaskInstance

MAX_BYTES: Final = 4 << 20
"""The longest text of an instance: 200 objects with goals for all of them take a tenth of it."""


class InstanceError(InputError):
    """A text that is no valid task instance."""


def read_instance(text: str | bytes, objects: int = 200) -> TaskInstance:
    """The task instance that ``text`` holds.

    Args:
        text: JSON.
        objects: the most objects it may have.

    Raises:
        InstanceError: it is too long, not JSON, off the schema or out of range; the message names what is wrong.
    """
    data = text.encode("utf-8", "surrogatepass") if isinstance(text, str) else text
    if len(data) > MAX_BYTES:
        raise InstanceError(f"the instance has {len(data)} bytes, {MAX_BYTES} are the most", "make it smaller")
    try:
        check_json(data, "the instance")
    except InputError as error:
        raise InstanceError(error.message, "write fewer values, less deep") from error
    try:
        json.loads(data, parse_constant=_refuse, object_pairs_hook=_unambiguous)
        instance = TaskInstance.model_validate_json(data, strict=True)
    except ValidationError as error:
        raise InstanceError(first_fault(error), "correct the value") from error
    except (ValueError, RecursionError) as error:
        raise InstanceError(f"the instance is not plain JSON: {str(error)[:200]}", "write JSON") from error
    if len(instance.objects) > objects:
        raise InstanceError(
            f"objects: the instance has {len(instance.objects)}, {objects} are the most (limits.objects)",
            "add fewer objects",
        )
    return instance


def first_fault(error: ValidationError) -> str:
    """Where the first fault is, and what it is."""
    first = error.errors(include_url=False)[0]
    where = ".".join(str(part) for part in first["loc"])
    return f"{where or 'instance'}: {first['msg']}"[:1000]


def _refuse(name: str) -> float:
    raise ValueError(f"{name} is not JSON")


def _unambiguous(pairs: list[tuple[str, object]]) -> dict[str, object]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError(f"an object names a key twice: {', '.join(key for key, _ in pairs)[:100]}")
    return found
