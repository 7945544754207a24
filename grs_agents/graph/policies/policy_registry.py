"""The policies by name: built in, from a content folder, by dotted path, or from an entry point.

Here are those that ask the router model or a person, and the policy that never blames the tests.
"""

from collections.abc import Sequence
from typing import cast

from grs_agents.agents import roles
from grs_agents.agents.roles import JudgedPrograms
from grs_agents.agents.types import NoReply, RouterReply, Verdict
from grs_agents.base import content
from grs_agents.base.errors import ConfigError
from grs_agents.base.plugins import broken_class_error, load_named_class
from grs_agents.base.questions import ask_person, first_word
from grs_agents.graph.policies.rules import Rules
from grs_agents.graph.policies.types import Policy, RoutingContext, RoutingDecision


class Llm:
    """Ask the router model (paper, Listing 3); where it gives no usable reply, decide by ``Rules`` and say so."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Ask; the model's explanation is passed on to the fixer."""
        return _decide_by_reply(_ask_router(context, context.verdicts), context, "llm")


class Hybrid:
    """Decide by ``Rules`` where they are sure, and ask the router model where they are not."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Decide by the rules; ask where they leave a doubt."""
        ruled = Rules().decide(context)
        if ruled.sure:
            return ruled.model_copy(update={"policy": "hybrid (rules)"})
        return _decide_by_reply(_ask_router(context, context.verdicts), context, "hybrid")


class Vote:
    """Ask the router model twice, with its two options in either order; where it contradicts itself, use ``Rules``."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Ask twice."""
        replies = [_ask_router(context, verdicts) for verdicts in (context.verdicts, context.verdicts[::-1])]
        verdicts = [reply.verdict for reply in replies if isinstance(reply, RouterReply)]
        if len(verdicts) == 2 and verdicts[0] == verdicts[1]:
            return _decide_by_reply(replies[0], context, "vote")
        answers = ", ".join(verdicts) or "nothing usable"
        return _decide_by_rules(context, "vote", f"asked with the options in either order, the model said {answers}")


class Human:
    """Pause the run and ask what to fix; what ``Rules`` would do is told, and the reply's reason goes to the fixer."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Ask; a reply is a verdict, then the reason, e.g. ``fix_code: the can is to end inside the box``."""
        ruled = Rules().decide(context)
        text = f"What is to be fixed in {context.task.name!r}? Begin with the choice, then say why."
        details = f"{context.results}\n\nThe rules would say {ruled.verdict}: {ruled.explanation}"
        reply = ask_person(text, context.verdicts, details)
        verdict: Verdict = next(verdict for verdict in context.verdicts if verdict == first_word(reply))
        reason = reply.strip()[len(verdict) :].lstrip(" :.,;") or "the person who was asked gave no reason"
        return RoutingDecision(verdict=verdict, explanation=reason, policy="human", sure=True)


class AlwaysCode:
    """Never blame the tests (the paper's ``no router`` ablation as a policy)."""

    def decide(self, context: RoutingContext) -> RoutingDecision:
        """Say ``fix_code``."""
        why = "this policy always fixes the program"
        return RoutingDecision(verdict="fix_code", explanation=why, policy="always_code")


def _ask_router(context: RoutingContext, verdicts: Sequence[Verdict]) -> RouterReply | NoReply:
    judged = JudgedPrograms(
        task=context.task,
        scene=context.scene,
        code=context.simulation,
        tests=context.tests,
        results=context.results,
        history=context.history,
        images=context.images,
    )
    return roles.decide_what_to_fix(context.agents, judged, verdicts)


def _decide_by_reply(reply: RouterReply | NoReply, context: RoutingContext, policy: str) -> RoutingDecision:
    if isinstance(reply, NoReply):
        return _decide_by_rules(context, policy, str(reply))
    return RoutingDecision(verdict=reply.verdict, explanation=reply.explanation, policy=policy)


def _decide_by_rules(context: RoutingContext, policy: str, why: str) -> RoutingDecision:
    ruled = Rules().decide(context)
    explanation = f"{why}; decided by rules instead: {ruled.explanation}"
    return ruled.model_copy(update={"explanation": explanation, "policy": f"{policy} (rules)"})


POLICIES: dict[str, type[Policy]] = {
    "llm": Llm,
    "rules": Rules,
    "hybrid": Hybrid,
    "vote": Vote,
    "always_code": AlwaysCode,
    "human": Human,
}
ENTRY_POINTS = "grs_agents.policies"
"""The entry-point group of packages with policies."""


def load_policy(name: str) -> Policy:
    """Make the policy ``name``: built in, the class ``Policy`` of ``policies/NAME.py`` in a content folder,
    ``package.module:Class``, or an entry point in the group ``ENTRY_POINTS``.

    Raises:
        UnknownNameError: nothing has that name.
        ConfigError: it cannot be imported or made, or has no ``decide``.
    """
    if name in POLICIES:
        return POLICIES[name]()
    known = [*POLICIES, *content.content_names("policies")]
    make = content.find_class("policies", name, "Policy") or load_named_class("policy", name, ENTRY_POINTS, known)
    try:
        policy = make()
    except Exception as error:  # the user's code may raise anything
        raise broken_class_error("policy", name, error) from error
    if not callable(getattr(policy, "decide", None)):
        raise ConfigError(f"policy {name!r} has no decide(context)", "see grs_agents.graph.policies.types.Policy")
    return cast(Policy, policy)
