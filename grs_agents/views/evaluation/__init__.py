"""Pages about the evaluation of policies."""
