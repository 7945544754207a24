"""The embedded chat model that answers GRS's prompts by rules."""

from grs_agents.models.offline.chat import OfflineChatModel

__all__ = ["OfflineChatModel"]
