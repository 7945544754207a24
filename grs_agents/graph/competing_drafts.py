"""Authors that compete: each writes a simulation program of its own, and the better one goes on."""

from typing import Literal

from grs_agents.agents.types import NoReply
from grs_agents.base import Frozen
from grs_agents.base.files import write_text
from grs_agents.base.trace.events import Note
from grs_agents.graph.auditing import audit_instances
from grs_agents.graph.authoring import save_program_version, scene_from_state, task_from_state, write_simulation
from grs_agents.graph.services import Services, Update, logged_node
from grs_agents.graph.state import RunState
from grs_agents.graph.task_instances import AuditedPrograms

Author = Literal["simulation", "rival"]


class Draft(Frozen):
    """The program of one author."""

    author: Author  # the role whose model wrote it
    source: str = ""
    problem: str = ""  # why there is no program


@logged_node("draft_sim")
def draft_simulation(state: RunState, services: Services) -> Update:
    """Write a simulation program by the model of the role ``simulation``."""
    return _write_draft("simulation", state, services)


@logged_node("draft_rival")
def draft_rival(state: RunState, services: Services) -> Update:
    """Write a simulation program by the model of the role ``rival``."""
    return _write_draft("rival", state, services)


@logged_node("choose_draft")
def choose_draft(state: RunState, services: Services) -> Update:
    """Keep the draft whose task instances pass more checks of the audit, then the one that the oracle solves better.

    The words and the tests, which are written for the chosen program alone, are not judged here.
    """
    drafts = [Draft.model_validate(draft) for draft in state["drafts"]]
    drafts.sort(key=lambda draft: draft.author, reverse=True)  # the order in which they ended is a matter of chance
    written = [draft for draft in drafts if draft.source]
    if not written:
        return {"problem": "; ".join(draft.problem for draft in drafts)}
    scores = [_score_draft(draft, state, services) for draft in written]
    best = written[scores.index(max(scores))]
    return save_program_version(state, services, "simulation", best.source, best.author)


def _write_draft(author: Author, state: RunState, services: Services) -> Update:
    source = write_simulation(state, services, author)
    if isinstance(source, NoReply):
        return {"drafts": [Draft(author=author, problem=str(source)).model_dump(mode="json")]}
    write_text(services.folder / f"history/draft_{author}.py", source)
    return {"drafts": [Draft(author=author, source=source).model_dump(mode="json")]}


def _score_draft(draft: Draft, state: RunState, services: Services) -> tuple[bool, int, float]:
    """Whether its instances are accepted, how many checks hold, and the mean of the oracle's rewards."""
    audited = AuditedPrograms(draft.source, task=task_from_state(state), scene=scene_from_state(state))
    _, report = audit_instances(audited, services)
    held = sum(finding.passed for finding in report.findings)
    reward = sum(report.rewards) / services.config.audit.seeds
    verdict = f"{held} of {len(report.findings)} checks hold, mean reward {reward:.2f}"
    services.log.append(Note(level="info", text=f"draft of {draft.author}: {verdict}"))
    return report.accepted, held, reward
