"""The embedded chat model that answers GRS's prompts by rules."""
