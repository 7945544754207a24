"""The scripted expert, which solves a task by what the simulation knows."""
