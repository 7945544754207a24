"""The audit's finding ``words``: who judged, what it said, and when nobody is asked."""

import pytest

from grs_agents.agents.types import TaskDefinition
from grs_agents.audit.types import AuditFinding
from grs_agents.base.config.schema import AuditConfig, Config, ModelConfig
from grs_agents.graph.auditing import audit_programs
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState
from grs_agents.graph.task_instances import AuditedPrograms
from tests.graph.conftest import SIMULATION, TASK, Make, kinds

WORDS = str(TASK["task-description"])
SEES = {"default": ModelConfig(model="openai:any")}
AGREES = '{"verdict": "agrees", "reason": "It is what the words say."}'


def words_finding(words: str, services: Services, simulation: str = SIMULATION) -> AuditFinding | None:
    """What the audit finds of the words; a program without tests and photo."""
    task = TaskDefinition.model_validate({**TASK, "task-description": words})
    report = audit_programs(AuditedPrograms(simulation=simulation, task=task), services)
    found = [finding for finding in report.findings if finding.check == "words"]
    assert report.accepted == (bool(found) and found[0].passed), report.findings
    return found[0] if found else None


@pytest.mark.parametrize(
    ("words", "verdict"),
    [
        ("move the red and the blue block", "agrees"),
        ("Stack the red block on the blue block.", "differs"),
        ("Move the red block.", "differs"),
        ("Fold the towel, pour the milk and sing.", "differs"),
        ("Do as you like.", "unclear"),
    ],
)
def test_rules_judge_where_the_model_is_offline(make_services: Make, words: str, verdict: str) -> None:
    found = words_finding(words, make_services())
    assert found is not None
    assert (found.passed, found.measured.split(",")[0]) == (verdict == "agrees", verdict)
    assert "(offline)" in found.measured
    assert ("audit.judge = MODEL" in found.bound) == (verdict == "unclear")


def test_sides_that_the_photo_shows_otherwise_are_unclear(state: RunState, make_services: Make) -> None:
    """The camera looks straight down, its right is away from the robot."""
    task = TaskDefinition.model_validate({**TASK, "task-description": "move the red block left of the blue block"})
    scene = state["scene"]
    report = audit_programs(AuditedPrograms(simulation=SIMULATION, task=task, scene=scene), make_services())
    found = next(finding for finding in report.findings if finding.check == "words")
    assert not found.passed and "'left' is another side" in found.measured and "as the robot sees it" in found.bound


def test_nobody_is_asked_of_what_fails_anyway(make_services: Make) -> None:
    services = make_services()
    assert words_finding(WORDS, services, SIMULATION.replace("(0.6, 0.0)", "(1.6, 0.0)")) is None
    assert not kinds(services, "prompt")


def test_there_is_no_finding_without_words(make_services: Make) -> None:
    report = audit_programs(AuditedPrograms(simulation=SIMULATION), make_services())
    assert report.accepted
    assert "words" not in {finding.check for finding in report.findings}


def test_a_model_sees_goals_and_pictures_but_no_program(make_services: Make) -> None:
    services = make_services(AGREES, models=SEES)
    found = words_finding(WORDS, services)
    assert found is not None and found.passed
    assert "(openai:any)" in found.measured
    [prompt] = kinds(services, "prompt")
    assert prompt.images == ("instances/seed_0_start.png", "instances/seed_0_end.png")
    assert all((services.folder / image).is_file() for image in prompt.images)
    assert "the red block #1 ends on the bare table" in prompt.text
    assert "import" not in prompt.text and "MoveTwoBlocks" not in prompt.text


def test_a_judge_without_a_usable_reply_accepts_nothing(make_services: Make) -> None:
    found = words_finding(WORDS, make_services("I would rather not.", reply_retries=0))
    assert found is not None and not found.passed
    assert "no usable reply" in found.measured


def test_the_audit_names_its_judge_before_the_models_do() -> None:
    models = {"default": ModelConfig(model="a:x"), "judge": ModelConfig(model="b:y", base_url="http://c")}
    assert Config(models=models).model_for_role("judge").model == "b:y"
    assert Config(models={"default": models["default"]}).model_for_role("judge").model == "a:x"
    chosen = Config(models=models, audit=AuditConfig(judge="offline")).model_for_role("judge")
    assert (chosen.model, chosen.base_url) == ("offline", None)


def test_a_program_that_knows_the_audited_seeds_is_found_by_one_more(make_services: Make) -> None:
    """That seed follows from the text of the programs: a repeated audit is the same, another program has another."""
    knows = SIMULATION.replace(
        "        flat = (0, 0, 0, 1)\n",
        "        flat = (0, 0, 0, 1)\n"
        "        known = [np.random.RandomState(seed).rand() for seed in (0, 1, 2)]\n"
        "        far = 0.0 if np.random.rand() in known else 9.0\n",
    ).replace("((*target, 0.02), flat)", "((target[0] + far, target[1], 0.02), flat)")
    reports = [audit_programs(AuditedPrograms(simulation=knows), make_services()) for _ in range(2)]
    assert reports[0] == reports[1]
    assert [one.check for one in reports[0].findings if not one.passed] == ["unforeseen"], reports[0].findings
    assert not set(reports[0].unforeseen_seeds) & {rollout.seed for rollout in reports[0].rollouts}
    honest = audit_programs(AuditedPrograms(simulation=SIMULATION), make_services())
    assert honest.accepted and len(honest.unforeseen_seeds) == 1
    assert honest.unforeseen_seeds[0] not in reports[0].unforeseen_seeds
