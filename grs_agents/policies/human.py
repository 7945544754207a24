"""The policy that asks a person."""

from grs_agents.agents import Verdict
from grs_agents.policies.rules import Rules
from grs_agents.policies.types import RoutingContext, RoutingDecision
from grs_agents.questions import ask_person, first_word


class Human:
    """Pause the run and ask what to fix; what ``Rules`` would do is told, and the reply's reason goes to the fixer."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Ask; a reply is a verdict, then the reason, e.g. ``fix_code: the can is to end inside the box``."""
        ruled = Rules().decide(context)
        text = f"What is to be fixed in {context.task.name!r}? Begin with the choice, then say why."
        details = f"{context.results}\n\nThe rules would say {ruled.verdict}: {ruled.explanation}"
        reply = ask_person(text, context.verdicts, details)
        verdict: Verdict = next(one for one in context.verdicts if one == first_word(reply))
        reason = reply.strip()[len(verdict) :].lstrip(" :.,;") or "the person who was asked gave no reason"
        return RoutingDecision(verdict=verdict, explanation=reason, policy="human", sure=True)
