"""Chat models: one seam for intelligence, from the embedded ``offline`` model to any provider."""

from grs_agents.models.factory import PROVIDERS, chat_model, installed
from grs_agents.models.retry import ReplyProblem, Retries, invoke

__all__ = ["PROVIDERS", "ReplyProblem", "Retries", "chat_model", "installed", "invoke"]
