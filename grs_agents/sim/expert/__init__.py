"""The scripted expert, which solves tasks from ground truth."""
