"""A task as data: objects, goals, and the result of an episode."""
