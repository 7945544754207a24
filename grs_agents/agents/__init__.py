"""The agents: describer, matcher, task author, simulation author, test author, router and the two fixers."""

from grs_agents.agents import examples, roles
from grs_agents.agents.agent import Agents, EarlierReplies
from grs_agents.agents.types import Description, Match, NoReply, RouterReply, TaskDefinition, Verdict

__all__ = [
    "Agents",
    "Description",
    "EarlierReplies",
    "Match",
    "NoReply",
    "RouterReply",
    "TaskDefinition",
    "Verdict",
    "examples",
    "roles",
]
