"""The state that the graphs pass from node to node: plain data, checkpointed after each step."""

import operator
from typing import Annotated, Any, TypedDict


class RunState(TypedDict):
    """Pictures and recordings stay in files; only their paths (relative to the run folder) are kept here.

    A run begins with ``scene_path`` and ``max_fixes``; the graph's edges see to it that a node finds what it needs.

    Attributes:
        scene_path: the scene: a folder, a file, or ``bop:`` and an image of a data set.
        max_fixes: how many code and test fixes together.
        camera: that took the photo, ``Camera`` as JSON.
        table: the table and the robot frame laid on it, ``TableFrame`` as JSON.
        notes: what a reader of the scene should know about how it was read.
        image: the scene image that vision agents see; empty for graphs without one.
        candidates: one record for each segmented candidate, with the paths of its mask and crop.
        pending: ids of the candidates that this pass of perception describes, matches and registers.
        descriptions: what the describer said, by candidate id: ``Description`` as JSON.
        matches: what stands for a candidate, by its id: ``MatchEvidence`` as JSON.
        objects: the objects placed so far, ``SceneObject`` as JSON.
        dropped: the candidates that are no object, ``DroppedCandidate`` as JSON.
        background: library name of the reconstructed background; empty without one.
        scene: ``SceneDescription`` as JSON.
        task: the task definition, in the paper's spelling.
        simulation: the present simulation program.
        tests: the present tests.
        simulation_version: how many versions of the program there were.
        tests_version: how many versions of the tests there were.
        report: the latest ``TestReport`` as JSON.
        decision: the latest ``RoutingDecision`` as JSON.
        audit: the latest ``AuditReport`` as JSON.
        fixes: fixes made so far.
        history: one line for each decision.
        routed: each decision with the report it was made on, ``Routed`` as JSON.
        problem: why the run cannot go on, if it cannot.
        status: ``accepted`` or ``rejected`` once it is known.
        reason: why.
    """

    scene_path: str
    max_fixes: int
    notes: list[str]
    image: str
    camera: dict[str, Any]
    table: dict[str, Any]
    candidates: list[dict[str, Any]]
    pending: list[int]
    descriptions: dict[str, dict[str, Any]]
    matches: dict[str, dict[str, Any]]
    objects: list[dict[str, Any]]
    dropped: list[dict[str, Any]]
    background: str
    scene: dict[str, Any]
    task: dict[str, Any]
    simulation: str
    tests: str
    simulation_version: int
    tests_version: int
    report: dict[str, Any]
    decision: dict[str, Any]
    audit: dict[str, Any]
    fixes: Annotated[int, operator.add]
    history: Annotated[list[str], operator.add]
    routed: Annotated[list[dict[str, Any]], operator.add]
    problem: str
    status: str
    reason: str
