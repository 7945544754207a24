"""Sentences in English about a task instance, from its goals and poses alone."""
