"""The audit: checks on task instances and episodes, measured by trusted code."""
