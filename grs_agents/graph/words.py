"""The words of an audited task: the sentence of its goals, and a verdict on the author's words beside it."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from grs_agents.agents import roles
from grs_agents.agents.types import NoReply, WordsJudgement
from grs_agents.audit.goal_checks import pair_instances_with_rollouts
from grs_agents.audit.goal_sentences import TaskInWords, describe_task_in_words
from grs_agents.audit.side_words import describe_sides_in_photo, explain_ambiguous_sides, state_robot_sides
from grs_agents.audit.types import AuditFinding, AuditReport, JudgedWords
from grs_agents.graph.evidence import draw_from_photo
from grs_agents.graph.services import Services
from grs_agents.graph.task_instances import AuditedPrograms, write_instance
from grs_agents.models.factory import OFFLINE, is_offline
from grs_agents.models.offline.judging.judge import judge_evidence
from grs_agents.sim.instance.task_instance import TaskInstance
from grs_agents.sim.rollouts import Rollout
from grs_agents.sim.wording.sentence import TaskSentence, describe_task

_BOUND: Final = "the author's words must not differ from the sentence of the goals"
_STRICT_BOUND: Final = (
    "the judge must agree with the author's words (audit.words = agree); where it does not understand them, name a "
    "model that does with audit.judge = MODEL"
)
_GRS: Final = "grs"
_UNIVERSAL: Final = re.compile(r"\b(all|every|everything|each|clear|rest|others?)\b", re.IGNORECASE)
_SEVERITY: Final = ("agree", "not_judged", "differ")


def state_and_judge_words(
    report: AuditReport,
    audited: AuditedPrograms,
    instances: Sequence[TaskInstance],
    rollouts: Sequence[Rollout],
    services: Services,
) -> AuditReport:
    """Add the sentence of the goals to an accepted report and to the instances, and judge the author's words.

    The judge is asked once for instances that differ only in lengths and turns.
    """
    pairs = pair_instances_with_rollouts(instances, [done for done in rollouts if done.final])
    if not pairs:
        return report
    sentences: list[TaskSentence] = []
    kinds: dict[tuple[object, ...], tuple[TaskInstance, Rollout, TaskInWords, TaskSentence]] = {}
    for instance, rollout in pairs:
        sentence = describe_task(instance, services.library, rollout.initial, rollout.final)
        sentences.append(sentence)
        if (services.folder / f"instances/seed_{instance.seed}.json").is_file():
            write_instance(instance.model_copy(update={"instruction": sentence.specific}), services)
        facts = describe_task_in_words(instance, rollout, services.library, audited.scene)
        kinds.setdefault(facts.kind, (instance, rollout, facts, sentence))
    report = report.model_copy(update={"sentence": sentences[0].specific, "vague": sentences[0].vague})
    if audited.task is None:
        return report
    judged: list[JudgedWords] = []
    for instance, rollout, facts, sentence in kinds.values():
        judged.append(_judge_words(audited, instance, rollout, facts, sentence.specific, services))
        if judged[-1].verdict != "agree":
            break
    words = max(judged, key=lambda one: _SEVERITY.index(one.verdict))
    strict = services.config.audit.words == "agree"
    passed = words.verdict == "agree" or (words.verdict == "not_judged" and not strict)
    finding = AuditFinding(
        check="words",
        passed=passed,
        measured=f"{words.verdict}, says {words.by}: {words.why}",
        bound=_STRICT_BOUND if strict else _BOUND,
    )
    return report.model_copy(update={"words": words}).with_findings([finding])


def _judge_words(
    audited: AuditedPrograms,
    instance: TaskInstance,
    rollout: Rollout,
    facts: TaskInWords,
    sentence: str,
    services: Services,
) -> JudgedWords:
    """The verdict on the words of a task with an instance and its episode.

    Rules that understand all of the words may say that they differ, whoever judges. A model is asked twice, the second
    time with the evidence in reverse; where its verdicts differ, the words are not judged.
    """
    assert audited.task is not None
    frame = audited.scene.frame if audited.scene is not None else None
    words = state_robot_sides(audited.task.description, frame)
    restated = "The author gave the sides in the words as in the photo." if words != audited.task.description else ""
    other_texts = (f"name: {audited.task.name}", *facts.other_texts)
    if ambiguous := explain_ambiguous_sides(words, frame):
        return JudgedWords(verdict="not_judged", by=_GRS, why=ambiguous)
    judge = services.config.model_for_role("judge").model
    if not is_offline(judge):
        by_rules = judge_evidence(words, other_texts, facts.objects, facts.goals)
        if by_rules.verdict == "differs":
            return JudgedWords(verdict="differ", by=OFFLINE, why=by_rules.reason)
    evidence = roles.WordsEvidence(
        words=words,
        sentence=sentence,
        other_texts=other_texts,
        objects=facts.objects,
        goals=facts.goals,
        notes=list(filter(None, (_list_left_alone(words, facts), describe_sides_in_photo(frame), restated))),
        pictures=_draw_start_and_end(instance, rollout, services) if services.agents.sees_pictures("judge") else (),
    )
    first = roles.judge_words(services.agents, evidence)
    if is_offline(judge):
        return _read_judgement(first, judge)
    second = roles.judge_words(services.agents, evidence, reverse=True)
    verdicts = [_read_judgement(reply, judge) for reply in (first, second)]
    if verdicts[0].verdict == verdicts[1].verdict:
        return verdicts[0]
    answers = " and ".join(f"{judged.verdict} ({judged.why})" for judged in verdicts)
    return JudgedWords(verdict="not_judged", by=judge, why=f"asked twice, it answered {answers}")


def _read_judgement(reply: WordsJudgement | NoReply, judge: str) -> JudgedWords:
    if isinstance(reply, NoReply):
        return JudgedWords(verdict="not_judged", by=judge, why=str(reply))
    verdict = {"agrees": "agree", "differs": "differ", "unclear": "not_judged"}[reply.verdict]
    return JudgedWords.model_validate({"verdict": verdict, "by": judge, "why": reply.reason})


def _list_left_alone(words: str, facts: TaskInWords) -> str:
    """The loose objects that stay, if the words speak of all, of every one, or of what is left; else empty."""
    universal = dict.fromkeys(word.lower() for word in _UNIVERSAL.findall(words))
    if not universal:
        return ""
    staying = [row for row in facts.objects if not row.get("fixed") and "moved" not in row]
    listed = ", ".join(f"the {row['called']} #{row['id']} ({row['category']})" for row in staying) or "none"
    return f"The words say {', '.join(universal)}. Loose things that are left where they stood: {listed}."


def _draw_start_and_end(instance: TaskInstance, rollout: Rollout, services: Services) -> tuple[str, ...]:
    """Pictures of the table at the start and at the end, with names; none if either cannot be drawn."""
    if not services.config.end_picture:
        return ()
    paths = [Path("instances") / f"seed_{instance.seed}_{moment}.png" for moment in ("start", "end")]
    drawn = [
        draw_from_photo(instance, poses, services.folder / path, services)
        for path, poses in zip(paths, (rollout.initial, rollout.final), strict=True)
    ]
    return tuple(path.as_posix() for path in paths) if all(drawn) else ()
