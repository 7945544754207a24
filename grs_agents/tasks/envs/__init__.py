"""Environments of a task instance: one episode core, gymnasium, LeRobot."""
