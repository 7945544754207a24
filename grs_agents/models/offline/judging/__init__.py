"""The judge by rules: what a task's words ask for, compared with its goals told in sentences."""
