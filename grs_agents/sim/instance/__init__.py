"""A task as data: objects, goals, and how an episode with them ended."""
