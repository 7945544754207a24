"""Match a scene in this process: the order is read from standard input, the outcome written into the named folder."""

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from evals.benchmark.ground_truth import LabelledScene, TrueObject, read_labelled
from evals.benchmark.match_types import Matching, MatchOrder, Outcome, ScoredAnswer, matching_file
from evals.benchmark.segmentation_metrics import overlaps
from evals.benchmark.twin_figures import first_of_same_look
from grs_agents.agents.agent import Agents
from grs_agents.agents.types import Description, NoReply
from grs_agents.base import content
from grs_agents.base.config.load import load_config
from grs_agents.base.config.schema import Limits
from grs_agents.base.errors import GrsError
from grs_agents.base.files import write_json
from grs_agents.base.terminal import print_escaped
from grs_agents.base.trace.events import Reply
from grs_agents.base.trace.log import EventLog, read_events
from grs_agents.graph.recognition import (
    ask_describer,
    make_describer_question,
    make_model_matcher,
    make_placeholder_description,
)
from grs_agents.library.library import Library
from grs_agents.perception.annotated_pictures import outlined_segment_file_name, write_outlines
from grs_agents.perception.matching.types import MatchResult, Segment
from grs_agents.perception.picture_files import save_candidates, save_frame
from grs_agents.perception.segmentation.candidates import measure_candidates
from grs_agents.perception.table_finding import find_table
from grs_agents.perception.types import Candidate, CandidateRecord, MatchEvidence, TableFrame
from grs_agents.sandbox.host.sandbox import Sandbox
from grs_agents.toolkit import ToolContext, load_tool


def match_scene(order: MatchOrder, out: Path) -> Matching:
    """Match a scene that is there, and write the outcome below ``out``.

    Raises:
        GrsError: the scene cannot be read, there is no such tool, or a model cannot be reached.
    """
    scene, library = read_labelled(Path(order.scene.source)), Library()
    table = find_table(scene.frame, np.random.default_rng(order.scene.seed))
    cv2.setNumThreads(1)
    with Sandbox() as sandbox:
        context = ToolContext(sandbox=sandbox, library=library, limits=Limits())
        candidates: Sequence[Candidate]
        if order.scene.tool:
            tool = load_tool(order.scene.tool)
            candidates = tool.run(tool.Request(frame=scene.frame, table=table), context).candidates
        else:
            candidates = measure_candidates(scene.frame, table, scene.labels)
        folder = out / "pictures" / order.scene.name
        save_frame(scene.frame, folder)
        records = save_candidates(scene.frame, candidates, folder)
        log = EventLog(out / "events" / f"{order.stem}.jsonl")
        before = log.sequence
        begin = time.process_time()
        model = [] if order.model == "-" else [f"models.default={order.model}"]
        result = _matched(
            order,
            scene,
            table,
            candidates,
            records,
            context,
            Agents(load_config(None, [*model, f"seed={order.run}", *order.settings]).config, log, folder),
        )
    seconds = time.process_time() - begin
    log.close()
    replies = [event for event in read_events(log.path) if isinstance(event, Reply) and event.sequence >= before]
    answers, unseen = _answers(scene, candidates, records, result.matches, library)
    matching = Matching(
        order=order,
        answers=answers,
        unseen=unseen,
        input_tokens=sum(event.input_tokens for event in replies),
        output_tokens=sum(event.output_tokens for event in replies),
        cpu_seconds=seconds,
    )
    write_json(matching_file(out, order), matching.model_dump(mode="json"))
    return matching


def _matched(
    order: MatchOrder,
    scene: LabelledScene,
    table: TableFrame,
    candidates: Sequence[Candidate],
    records: Sequence[CandidateRecord],
    context: ToolContext,
    agents: Agents,
) -> MatchResult:
    described: dict[int, Description] = {}
    if order.method.models:
        write_outlines(scene.frame, records, records, agents.folder)
        for record in records:
            images = [record.crop, outlined_segment_file_name(record.id)]
            said = ask_describer(agents, make_describer_question([record], records, images))
            silent = isinstance(said, NoReply)
            described[record.id] = make_placeholder_description(record.shape) if silent else said[record.id]
    config, tool = agents.config, load_tool(order.method.tool)
    objects = [
        candidate for candidate in candidates if candidate.id not in described or described[candidate.id].is_object
    ]
    crops = {record.id: agents.folder / record.crop for record in records}
    segments = [
        Segment(candidate.id, candidate.mask, candidate.upright, crops[candidate.id], candidate.points)
        for candidate in objects
    ]
    words, frame = described if order.method.worded else {}, scene.frame if order.method.pictured else None
    matcher = make_model_matcher(agents, records, words, frame, [])
    request = tool.Request(
        segments=segments,
        frame=scene.frame,
        table=table,
        ask=matcher if order.method.models else None,
        seed=order.run,
        model=config.match.model,
        index=config.match.index,
        ocr=order.method.ocr,
        sized=order.method.sized,
    )
    result: MatchResult = tool.run(request, context)
    return result


def _answers(
    scene: LabelledScene,
    candidates: Sequence[Candidate],
    records: Sequence[CandidateRecord],
    matches: Mapping[int, MatchEvidence],
    library: Library,
) -> tuple[tuple[ScoredAnswer, ...], int]:
    labels = np.zeros(scene.labels.shape, np.int32)
    for candidate in candidates:
        labels[candidate.mask] = candidate.id
    common = overlaps(labels, scene.labels, scene.ignored())
    partner, counting = common.matched(), set(common.segments.tolist())
    known, looks = {item.id: item for item in scene.truth.objects}, first_of_same_look(library)
    silent = MatchEvidence(match="no_object", reason="described as no object")
    answers: list[ScoredAnswer] = []
    for record in records:
        if record.id in counting:
            label = partner.get(record.id)
            one = None if label is None else known.get(label, TrueObject(id=label))
            answer, truth = matches.get(record.id, silent), None if one is None else one.asset
            scored = ScoredAnswer(
                id=record.id,
                truth=truth,
                answer=answer,
                outcome=_outcome(truth, answer, looks),
                visible=None if one is None else (one.visible / one.whole if one.visible and one.whole else None),
                crop=f"pictures/{scene.name}/{record.crop}",
            )
            answers.append(scored)
    assets = {label for label in common.truths.tolist() if label in known and known[label].asset}
    return tuple(answers), len(assets - set(partner.values()))


def _outcome(truth: str | None, answer: MatchEvidence, looks: Mapping[str, str]) -> Outcome:
    if answer.match != "asset" or answer.asset is None:
        return "missed" if truth else "rightly none"
    if not truth:
        return "false alarm"
    return "right" if looks.get(answer.asset, answer.asset) == looks.get(truth, truth) else "wrong asset"


def main(arguments: Sequence[str]) -> int:
    """The folder for outcomes; the order is read from standard input.

    Returns:
        0, or the error's exit status.
    """
    order = MatchOrder.model_validate_json(sys.stdin.read())
    for root in reversed(order.scene.content):
        content.add_overlay_folder(Path(root))
    try:
        match_scene(order, Path(arguments[0]))
    except GrsError as error:
        print_escaped(error, error=True)
        return error.exit_status
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
