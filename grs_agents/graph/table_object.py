"""The record of an object on its way through perception, and its form in the state of a run."""

from collections.abc import Sequence
from typing import Any, Self

from grs_agents.agents.types import Description
from grs_agents.graph.state import RunState
from grs_agents.perception.types import CandidateRecord, DroppedCandidate, MatchEvidence, SceneObject


class TableObject(CandidateRecord):
    """A segment of the photo that may be an object. Each stage of perception fills one field."""

    description: Description | None = None  # stage describe
    match: MatchEvidence | None = None  # stage match; None for a segment described as no object
    placed: SceneObject | None = None  # stage register: its asset or proxy at a pose; None once dropped

    @classmethod
    def from_record(cls, record: CandidateRecord) -> Self:
        """A segment of which nothing else is known."""
        return cls.model_validate(dict(record))

    @property
    def described(self) -> Description:
        """The description; only after the stage describe."""
        assert self.description is not None
        return self.description

    @property
    def scene_object(self) -> SceneObject:
        """The entry of the scene; only of a placed object."""
        assert self.placed is not None
        return self.placed

    def place(self, **fields: object) -> Self:
        """The same object with other fields of its scene entry."""
        return self.model_copy(update={"placed": self.scene_object.model_copy(update=fields)})


def read_objects(state: RunState) -> tuple[list[TableObject], list[DroppedCandidate]]:
    """All objects of a state (placed, pending or dropped), and the reasons of dropped objects."""
    dropped = [DroppedCandidate.model_validate(item) for item in state.get("dropped", ())]
    return [TableObject.model_validate(item) for item in state.get("objects", ())], dropped


def write_objects(objects: Sequence[TableObject], dropped: Sequence[DroppedCandidate]) -> dict[str, Any]:
    """The update of a state that `read_objects` reads again."""
    return {
        "objects": [item.model_dump(mode="json") for item in objects],
        "dropped": [item.model_dump(mode="json") for item in dropped],
    }


def select_pending(objects: Sequence[TableObject], dropped: Sequence[DroppedCandidate]) -> list[TableObject]:
    """The objects that this pass of perception describes, matches and registers: neither placed nor dropped."""
    gone = {item.id for item in dropped}
    return [item for item in objects if item.placed is None and item.id not in gone]
