"""Suites of accepted tasks, and the evaluation of policies on them."""
