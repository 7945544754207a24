"""Grading: the difficulty of a task by its scene, its expert, and policies without the expert's knowledge."""

from grs_agents.tasks.grading.primitive_policy import PrimitivePolicy as PrimitivePolicy
from grs_agents.tasks.grading.primitive_task import PrimitiveTask as PrimitiveTask
from grs_agents.tasks.grading.primitive_task import decide as decide
from grs_agents.tasks.grading.primitive_task import demonstrate as demonstrate
from grs_agents.tasks.grading.primitive_task import evaluate_policy as evaluate_policy
