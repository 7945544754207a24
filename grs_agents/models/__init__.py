"""Chat models: one seam for intelligence, from the embedded ``offline`` model to any provider."""

from grs_agents.models.answer import Answer, ReplyProblem
from grs_agents.models.factory import OFFLINE, PROVIDERS, chat_model, installed
from grs_agents.models.retry import Retries, invoke

__all__ = ["OFFLINE", "PROVIDERS", "Answer", "ReplyProblem", "Retries", "chat_model", "installed", "invoke"]
