"""A run as an HTML page: task, verdict, photo and film, then every step with its prompts, replies and diffs."""
