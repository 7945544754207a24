"""The audit's findings."""

from grs_agents.base import Frozen, Vec3
from grs_agents.sim import Rollout


class Finding(Frozen):
    """One check of the audit.

    Attributes:
        check: its name.
        passed: whether it holds.
        detail: what was measured, with the bound.
    """

    check: str
    passed: bool
    detail: str


class Change(Frozen):
    """An object that does not stand where the photo shows it.

    Attributes:
        seed: the task instance it was seen in.
        asset: which object.
        position: where the program put it (m, robot frame).
        photo: where the photo shows that asset nearest by, if it does.
        distance: metres between the two in the table plane, if the photo shows the asset.
    """

    seed: int
    asset: str
    position: Vec3
    photo: Vec3 | None
    distance: float | None


class AuditReport(Frozen):
    """Why a run is accepted or not; measured on task instances by trusted code alone.

    Attributes:
        accepted: every finding passed.
        findings: one for each check.
        changes: every position not taken from the photo.
        rollouts: the trusted oracle's episode for each seed.
        rewards: the reward of each rollout.
        about: what the verdict is about, one sentence or two.
    """

    accepted: bool
    findings: tuple[Finding, ...]
    changes: tuple[Change, ...]
    rollouts: tuple[Rollout, ...]
    rewards: tuple[float, ...]
    about: str = ""

    def text(self) -> str:
        """What the router and the code fixer read."""
        lines = ["audit: " + ("accepted" if self.accepted else "failed")]
        for finding in self.findings:
            lines.append(f"- {finding.check}: {'passed' if finding.passed else 'FAILED'}: {finding.detail}")
        for rollout in self.rollouts:
            episode = rollout.episode
            lines.append(
                f"seed {rollout.seed}: oracle: outcome={episode.outcome} reward={episode.reward:.2f} "
                f"steps={episode.steps}/{episode.max_steps} detail={episode.detail} "
                f"objects={list(episode.objects)} strict={episode.strict:.2f}"
            )
        return "\n".join(lines)
