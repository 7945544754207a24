"""The audit's finding ``words``: who judged, what it said, and when nobody is asked."""

from dataclasses import replace

import pytest

from grs_agents.agents.types import TaskDefinition
from grs_agents.audit.types import AuditFinding, AuditReport
from grs_agents.base.config.schema import AuditConfig, Config, ModelConfig
from grs_agents.graph.auditing import audit_programs
from grs_agents.graph.services import Services
from grs_agents.graph.state import RunState
from grs_agents.graph.task_instances import AuditedPrograms
from grs_agents.sim.instance.task_instance import parse_instance_json
from tests.graph.conftest import SIMULATION, TASK, Make, kinds

WORDS = str(TASK["task-description"])
SEES = {"default": ModelConfig(model="openai:any")}
DIFFERS = '{"verdict": "differs", "reason": "The words stack them."}'
AGREES = '{"verdict": "agrees", "reason": "It is what the words say."}'


def audit_words(words: str, services: Services, simulation: str = SIMULATION) -> AuditReport:
    """The audit of a program without tests and photo for a task of these words."""
    task = TaskDefinition.model_validate({**TASK, "task-description": words})
    return audit_programs(AuditedPrograms(simulation=simulation, task=task), services)


def words_finding(words: str, services: Services, simulation: str = SIMULATION) -> AuditFinding | None:
    """What the audit finds of the words."""
    report = audit_words(words, services, simulation)
    found = [finding for finding in report.findings if finding.check == "words"]
    assert report.accepted == (bool(found) and found[0].passed), report.findings
    return found[0] if found else None


@pytest.mark.parametrize(
    ("words", "verdict"),
    [
        ("move the red and the blue block", "agree"),
        ("Stack the red block on the blue block.", "differ"),
        ("Move the red block.", "differ"),
        ("Fold the towel, pour the milk and sing.", "differ"),
        ("Do as you like.", "not_judged"),
    ],
)
def test_rules_judge_where_the_model_is_offline(make_services: Make, words: str, verdict: str) -> None:
    """Words that nobody could judge are refused only if the configuration asks for agreement."""
    for strictness in ("sentence", "agree"):
        services = make_services()
        audit = services.config.audit.model_copy(update={"words": strictness})
        services = replace(services, config=services.config.model_copy(update={"audit": audit}))
        report = audit_words(words, services)
        assert report.words is not None and (report.words.verdict, report.words.by) == (verdict, "offline")
        assert report.accepted == (verdict == "agree" or (verdict == "not_judged" and strictness == "sentence"))
        assert report.sentence.startswith("Move the red block 10 cm to the left"), report.sentence
        found = report.findings[-1]
        assert found.check == "words" and found.passed == report.accepted
        assert found.measured.startswith(f"{verdict}, says offline: ")
        assert ("audit.judge = MODEL" in found.bound) == (strictness == "agree")


def test_the_sentence_of_the_goals_is_the_instruction_of_the_instances(make_services: Make) -> None:
    """Whatever the author's words, also without any."""
    services = make_services()
    report = audit_programs(AuditedPrograms(simulation=SIMULATION), services)
    assert report.accepted and report.sentence and report.words is None
    instance = parse_instance_json((services.folder / "instances/seed_0.json").read_text(encoding="utf-8"))
    assert instance.language == report.sentence


def test_sides_that_the_photo_shows_otherwise_are_not_judged(state: RunState, make_services: Make) -> None:
    """The camera looks straight down, its right is away from the robot."""
    task = TaskDefinition.model_validate({**TASK, "task-description": "move the red block left of the blue block"})
    scene = state["scene"]
    report = audit_programs(AuditedPrograms(simulation=SIMULATION, task=task, scene=scene), make_services())
    assert report.words is not None and (report.words.verdict, report.words.by) == ("not_judged", "grs")
    assert "'left' is another side" in report.words.why


def test_nobody_is_asked_of_what_fails_anyway(make_services: Make) -> None:
    services = make_services()
    assert words_finding(WORDS, services, SIMULATION.replace("(0.6, 0.0)", "(1.6, 0.0)")) is None
    assert not kinds(services, "prompt")


def test_there_is_no_finding_without_words(make_services: Make) -> None:
    report = audit_programs(AuditedPrograms(simulation=SIMULATION), make_services())
    assert report.accepted
    assert "words" not in {finding.check for finding in report.findings}


def test_a_model_sees_goals_and_pictures_but_no_program(make_services: Make) -> None:
    services = make_services(AGREES, AGREES, models=SEES)
    report = audit_words(WORDS, services)
    assert report.words is not None and (report.words.verdict, report.words.by) == ("agree", "openai:any")
    first, second = kinds(services, "prompt")
    assert first.images == ("instances/seed_0_start.png", "instances/seed_0_end.png")
    assert all((services.folder / image).is_file() for image in first.images)
    assert second.images == first.images[::-1] and "at the end of the robot's work, then at the start" in second.text
    assert "the red block #1 ends on the bare table" in first.text and report.sentence in first.text
    assert "import" not in first.text and "MoveTwoBlocks" not in first.text


@pytest.mark.parametrize(
    ("replies", "verdict"),
    [((AGREES, DIFFERS), "not_judged"), ((DIFFERS, AGREES), "not_judged"), ((DIFFERS, DIFFERS), "differ")],
)
def test_a_model_that_gives_two_answers_has_not_judged(
    make_services: Make, replies: tuple[str, str], verdict: str
) -> None:
    report = audit_words("Tidy up the blocks.", make_services(*replies, models=SEES))
    assert report.words is not None and report.words.verdict == verdict
    assert report.accepted == (verdict == "not_judged")


def test_rules_that_understand_all_of_the_words_refuse_a_lie_before_a_model_is_asked(make_services: Make) -> None:
    services = make_services(AGREES, AGREES, models=SEES)
    report = audit_words("Stack the red block on the blue block.", services)
    assert report.words is not None and (report.words.verdict, report.words.by) == ("differ", "offline")
    assert not report.accepted and not kinds(services, "prompt")


def test_a_judge_of_all_things_is_told_what_is_left_alone(make_services: Make) -> None:
    """The yellow block stays."""
    simulation = SIMULATION.replace(
        "        flat = (0, 0, 0, 1)\n",
        '        flat = (0, 0, 0, 1)\n        env.add_object("block/yellow_block.urdf", ((0.4, 0.3, 0.02), flat))\n',
    )
    services = make_services(AGREES, AGREES, models=SEES)
    task = TaskDefinition.model_validate(
        {
            **TASK,
            "task-description": "Tidy all blocks.",
            "assets-used": [*TASK["assets-used"], "block/yellow_block.urdf"],
        }
    )
    audit_programs(AuditedPrograms(simulation=simulation, task=task), services)
    told = kinds(services, "prompt")[0].text
    assert "The words say all" in told and "the yellow block #" in told.partition("left where they stood: ")[2]


def test_a_judge_without_a_usable_reply_has_not_judged(make_services: Make) -> None:
    report = audit_words(WORDS, make_services("I would rather not.", "Nor now.", models=SEES, reply_retries=0))
    assert report.words is not None and report.words.verdict == "not_judged"
    assert "no usable reply" in report.words.why


def test_the_audit_names_its_judge_before_the_models_do() -> None:
    models = {"default": ModelConfig(model="a:x"), "judge": ModelConfig(model="b:y", base_url="http://c")}
    assert Config(models=models).model_for_role("judge").model == "b:y"
    assert Config(models={"default": models["default"]}).model_for_role("judge").model == "a:x"
    others = {"default": ModelConfig(model="a:x"), "tests": ModelConfig(model="b:y", base_url="http://c")}
    other = Config(models=others).model_for_role("judge")  # not the author of the words
    assert (other.model, other.base_url) == ("b:y", "http://c")
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
