"""The judge by rules: compares a task's words with its goals in sentences."""
