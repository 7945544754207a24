"""The state that the graphs pass from node to node: plain data, checkpointed after each step."""

import operator
from typing import Annotated, Any, TypedDict


class RunState(TypedDict):
    """Pictures and recordings stay in files; only their paths (relative to the run folder) are kept here.

    A run begins with ``scene_path`` and ``max_fixes``; the graph's edges see to it that a node finds what it needs.
    """

    scene_path: str  # the scene: a folder, a file, or `bop:` and an image of a data set
    max_fixes: int  # how many code and test fixes together
    notes: list[str]  # what a reader of the scene should know about how it was read
    image: str  # the scene image that vision agents see; empty for graphs without one
    camera: dict[str, Any]  # that took the photo, `Camera` as JSON
    table: dict[str, Any]  # the table and the robot frame laid on it, `TableFrame` as JSON
    candidates: list[dict[str, Any]]  # one record for each segmented candidate, with the paths of its mask and crop
    pending: list[int]  # ids of the candidates that this pass of perception describes, matches and registers
    descriptions: dict[str, dict[str, Any]]  # what the describer said, by candidate id: `Description` as JSON
    matches: dict[str, dict[str, Any]]  # what stands for a candidate, by its id: `MatchEvidence` as JSON
    objects: list[dict[str, Any]]  # the objects placed so far, `SceneObject` as JSON
    left_out: str  # the picture of what is neither table nor candidate: the robot, walls of a bin
    robot: str  # the picture of the pixels that are known to show the robot
    blur: str  # the picture of pixels beside candidates that have their depth, but not their colour
    dropped: list[dict[str, Any]]  # the candidates that are no object, `DroppedCandidate` as JSON
    background: str  # library name of the reconstructed background; empty without one
    scene: dict[str, Any]  # `SceneDescription` as JSON
    task: dict[str, Any]  # the task definition, in the paper's spelling
    # programs of authors that compete, each with its author's role and, if there is none, why: `Draft` as JSON
    drafts: Annotated[list[dict[str, Any]], operator.add]
    simulation: str
    tests: str
    simulation_version: int  # how many versions of the program there were
    tests_version: int
    revisable: bool  # whether the task was defined in this run, and not revised yet
    revised: dict[str, Any]  # the task before its revision and what was given up; empty without one
    static: list[dict[str, Any]]  # what is wrong with the programs before they run, `StaticFinding` as JSON
    report: dict[str, Any]  # the latest `TestReport` as JSON
    decision: dict[str, Any]  # the latest `RoutingDecision` as JSON
    audit: dict[str, Any]  # the latest `AuditReport` as JSON
    fixes: Annotated[int, operator.add]
    history: list[dict[str, Any]]  # each fix with the score before and after it, `FixRecord` as JSON
    best: dict[str, Any]  # the best version of the two programs so far, `BestVersion` as JSON
    # each decision with the report it was made on, `EarlierDecision` as JSON
    routed: Annotated[list[dict[str, Any]], operator.add]
    problem: str  # why the run cannot go on, if it cannot
    status: str  # `accepted` or `rejected` once it is known
    reason: str  # why
