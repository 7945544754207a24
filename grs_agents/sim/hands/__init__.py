"""Hands: the tools that a robot's flange carries, by their data sheets."""
